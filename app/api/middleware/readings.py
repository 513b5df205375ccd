"""Lines of the trail for what changes no row: readings, downloads, exports and refusals.

One place for every route: a response is held back until its line is written. What was read is named by the
ids of the path; where it names none, by the analyses whose files were read. The pieces of one reading
(curves, rows, events, ranges of a file) are one line: the same subject and object, within 15 minutes.
"""

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from threading import Lock

from anyio.to_thread import run_sync
from sqlalchemy import Engine
from starlette.requests import HTTPConnection
from starlette.types import Message, Scope, Send

from app.access.routes import Needed, find_needed
from app.access.subjects import Subject
from app.jobs.trail import NOBODY, Act, begin_touching, record_alone, record_readings
from app.services import find_services

ONE_READING_S = 15 * 60.0
MOST_KNOWN = 10_000
REFUSALS = (401, 403, 404)
WRITES_NOTHING = frozenset({"/metrics"})
EXPORTED_BY_POST = frozenset({"/library/acts/reports.zip", "/library/acts/{name}.csv"})
_IDS = re.compile(r"\b(rec|an)_[0-9a-f]{16}\b", re.ASCII)
_READ: dict[Needed, Act] = {
    "read": "list.read",
    "correct": "list.read",
    "erase": "list.read",
    "export": "file.exported",
    "aggregate": "aggregate.read",
    "people": "people.read",
    "trail": "trail.read",
}


@dataclass(slots=True)
class KnownReadings:
    """The readings of the last 15 minutes, by who and what; each server process has its own."""

    _at_s: dict[tuple[str, ...], float] = field(default_factory=dict)
    _turn: Lock = field(default_factory=Lock)

    def is_new(self, key: tuple[str, ...]) -> bool:
        """Tell whether a reading begins, without counting it."""
        with self._turn:
            return time.monotonic() - self._at_s.get(key, -ONE_READING_S) >= ONE_READING_S

    def begin(self, key: tuple[str, ...]) -> None:
        """Count a reading whose line is written."""
        now_s = time.monotonic()
        with self._turn:
            if len(self._at_s) >= MOST_KNOWN:
                self._at_s = {one: at_s for one, at_s in self._at_s.items() if now_s - at_s < ONE_READING_S}
            self._at_s[key] = now_s


@dataclass(frozen=True, slots=True)
class _Reading:
    act: Act
    read: Sequence[tuple[str, str]]
    other: dict[str, str | int]

    def find_key(self, who: str, engine: Engine) -> tuple[str, ...]:
        ids = [one for pair in self.read for one in pair]
        return str(id(engine)), who, self.act, *map(str, self.other.values()), *ids


class Recorder:
    """Sends the messages of one response, the first once the line of the request is written."""

    def __init__(self, scope: Scope, send: Send, known: KnownReadings) -> None:
        self._scope, self._send, self._known = scope, send, known
        self._touched = begin_touching()
        self.refusal: Exception | None = None
        self._is_open = False

    async def send(self, message: Message) -> None:
        """Send a message.

        Raises
        ------
        Exception
            The line could not be written: the response must not go out.
        """
        if message["type"] == "websocket.accept":
            self._is_open = True
        status = _find_status(message, is_open=self._is_open)
        if status is not None:
            try:
                await self._write(status)
            except Exception as error:
                self.refusal = error
                raise
        await self._send(message)

    async def _write(self, status: int) -> None:
        found = self._describe(status)
        if found is None:
            return
        subject: Subject | None = self._scope.get("acromion.subject")
        who = subject.id if subject else NOBODY
        engine = find_services(HTTPConnection(self._scope)).store.engine
        key = found.find_key(who, engine)
        if not self._known.is_new(key):
            return
        if found.act == "refused":
            await run_sync(record_alone, engine, found.act, found.other, who)
        else:
            await run_sync(record_readings, engine, found.act, found.read, found.other)
        self._known.begin(key)

    def _describe(self, status: int) -> _Reading | None:
        route = getattr(self._scope.get("route"), "path", None)
        if route is None:
            return None
        method = self._scope.get("method", "WS")
        if status in REFUSALS:  # no id: that of another organisation must not be told from one of nobody
            return _Reading("refused", (), {"status": status, "method": method, "route": route})
        act = _READ.get(find_needed(method, route) or "public")
        is_reading = method in ("GET", "HEAD") or route in EXPORTED_BY_POST
        if act is None or not is_reading or status >= 400 or route in WRITES_NOTHING:
            return None
        return self._name(act, route)

    def _name(self, act: Act, route: str) -> _Reading:
        read = [
            ("", found[0]) if found[1] == "an" else (found[0], "")
            for found in _IDS.finditer(str(self._scope["path"]))
        ]
        read = read or [(recording_id, one) for one, recording_id in sorted(self._touched.items())]
        if route.startswith("/api/v1/trail/trail."):
            return _Reading("trail.exported", [("", "")], {"route": route})
        if act != "list.read":
            last = str(self._scope["path"]).rpartition("/")[2]
            name = last if re.fullmatch(r"[\w.]{1,60}", last, re.ASCII) else route.rpartition("/")[2]
            return _Reading(act, read or [("", "")], {"route": route, "name": name})
        if not read:
            return _Reading(act, [("", "")], {"route": route})
        is_report = any(analysis_id for _, analysis_id in read)
        return _Reading("report.read" if is_report else "recording.read", read, {})


def _find_status(message: Message, *, is_open: bool) -> int | None:
    """Give the status of a message that begins a response; that of a socket that was not accepted."""
    if message["type"] in ("http.response.start", "websocket.http.response.start"):
        return int(message["status"])
    return 403 if message["type"] == "websocket.close" and not is_open else None
