"""Lines of the trail for what changes no row: readings, downloads, exports and refusals.

One place for every route: a response is held back until its line is written. What was read is named by the
ids of the path; where it names none, by the analyses whose files were read.

- A **download** is an answer that leaves the server as a file: marked as an attachment, or of a route that
  asks for the permission ``export``. Each is a line, but for a piece of one (a range that does not begin the
  file, an answer without its bytes), which is folded.
- All else is a **reading**: its pieces (curves, rows, events) are one line for 15 minutes.
- A **refusal** is a line for each id that was asked for, once in 15 minutes; how many lines an asker may
  leave says :mod:`app.api.middleware.refused_lines`.
"""

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from threading import Lock

from anyio.to_thread import run_sync
from sqlalchemy import Engine
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.types import Message, Scope, Send

from app.access.routes import Needed, find_needed
from app.access.subjects import Subject
from app.access.throttle import find_network
from app.api.middleware.callers import find_address
from app.api.middleware.refused_lines import MOST_LINES, MOST_OF_STRANGERS, WINDOW_S, RefusedLines
from app.jobs.trail import NOBODY, Act, begin_touching, record_alone, record_readings, record_refusal
from app.services import SUBJECT, find_services

ONE_READING_S = 15 * 60.0
MOST_KNOWN = 10_000
REFUSALS = (401, 403, 404)
NOT_MODIFIED, PART_OF_FILE = 304, 206
WRITES_NOTHING = frozenset({"/metrics"})
LISTED = frozenset({"/api/v1/webhooks"})
"""What asks for the permission to export and is no file."""
MOST_NAMED = 20
"""So many ids of one refused request have a line."""
_IDS = re.compile(r"\b(rec|an)_[0-9a-f]{16}\b", re.ASCII)
_ANY_ID = re.compile(r"\b(rec|an|ba|up|wh|per|tok|org|view|live)_[0-9a-f]{16,28}\b", re.ASCII)
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
    """What has its line since 15 minutes or less, by who and what; each server process has its own."""

    _at_s: dict[tuple[str, ...], float] = field(default_factory=dict)
    _turn: Lock = field(default_factory=Lock)

    def is_new(self, key: tuple[str, ...]) -> bool:
        """Tell whether a reading begins, without counting it."""
        with self._turn:
            return time.monotonic() - self._at_s.get(key, -ONE_READING_S) >= ONE_READING_S

    def begin(self, key: tuple[str, ...]) -> None:
        """Count a reading whose line is written; the oldest is forgotten where there are too many."""
        with self._turn:
            self._at_s.pop(key, None)
            if len(self._at_s) >= MOST_KNOWN:
                del self._at_s[next(iter(self._at_s))]
            self._at_s[key] = time.monotonic()


@dataclass(frozen=True, slots=True)
class KnownLines:
    """What the requests of a server process have left in the trail."""

    readings: KnownReadings = field(default_factory=KnownReadings)
    refused: RefusedLines = field(default_factory=RefusedLines)


@dataclass(frozen=True, slots=True)
class _Reading:
    """What was read; ``is_whole``: a file left as a whole, which is a line of its own."""

    act: Act
    read: Sequence[tuple[str, str]]
    other: dict[str, str | int]
    is_whole: bool = False

    def find_key(self, who: str, engine: Engine) -> tuple[str, ...]:
        ids = [one for pair in self.read for one in pair]
        return str(id(engine)), who, self.act, *map(str, self.other.values()), *ids


class Recorder:
    """Sends the messages of one response, the first once the line of the request is written."""

    def __init__(self, scope: Scope, send: Send, known: KnownLines) -> None:
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
                await self._write(status, Headers(raw=list(message.get("headers", ()))))
            except Exception as error:
                self.refusal = error
                raise
        await self._send(message)

    async def _write(self, status: int, headers: Headers) -> None:
        route = getattr(self._scope.get("route"), "path", None)
        if route is None:
            return
        method = self._scope.get("method", "WS")
        needed = find_needed(method, route) or "public"
        if self._leads_to_login(status, method, needed):
            status = 401
        if status in REFUSALS:
            await self._write_refusal({"status": status, "method": method, "route": route})
        elif (status < 300 or status == NOT_MODIFIED) and route not in WRITES_NOTHING:
            found = self._describe(status, headers, needed, (method, route))
            if found is not None:
                await self._write_reading(found)

    def _leads_to_login(self, status: int, method: str, needed: Needed) -> bool:
        """Tell a refusal of a browser by its redirect; any other redirect reads nothing."""
        is_led = 300 <= status < 400 and status != NOT_MODIFIED and method in ("GET", "HEAD")
        return is_led and needed != "public" and SUBJECT not in self._scope

    async def _write_reading(self, found: _Reading) -> None:
        engine, who = self._find_engine(), self._find_who()
        key = found.find_key(who, engine)
        if found.is_whole or self._known.readings.is_new(key):
            await run_sync(record_readings, engine, found.act, found.read, found.other)
            self._known.readings.begin(key)

    async def _write_refusal(self, told: Mapping[str, str | int]) -> None:
        engine, who = self._find_engine(), self._find_who()
        is_stranger = who == NOBODY
        asker = find_network(find_address(HTTPConnection(self._scope))) if is_stranger else who
        for kind, one in self._find_asked():
            key = (str(id(engine)), who, "refused", *map(str, told.values()), one)
            if not self._known.readings.is_new(key):
                continue
            share = self._known.refused.take(asker, is_stranger=is_stranger)
            if share == "line":
                await run_sync(record_refusal, engine, kind, one, told)
                self._known.readings.begin(key)
            elif share == "more":
                most = {"most": MOST_LINES, "most_of_strangers": MOST_OF_STRANGERS}
                await run_sync(record_alone, engine, "refused.more", most | {"minutes": int(WINDOW_S / 60)})

    def _find_asked(self) -> Sequence[tuple[str, str]]:
        """Give the ids of the address with their kinds, whether or not they are anybody's."""
        address = f"{self._scope['path']}?{self._scope.get('query_string', b'').decode('latin-1')}"
        found = {one[0]: one[1] for one in _ANY_ID.finditer(address)}
        return [(kind, one) for one, kind in found.items()][:MOST_NAMED] or [("", "")]

    def _describe(
        self, status: int, headers: Headers, needed: Needed, asked: tuple[str, str]
    ) -> _Reading | None:
        act, (method, route) = _READ.get(needed), asked
        is_attached = headers.get("content-disposition", "").startswith("attachment")
        if act is None or not (is_attached or method in ("GET", "HEAD")):
            return None
        if route in LISTED:
            act = "list.read"
        elif is_attached and act == "list.read":
            act = "file.exported"
        return self._name(act, route, is_whole=_is_whole(status, headers, method))

    def _name(self, act: Act, route: str, *, is_whole: bool) -> _Reading:
        read = [
            ("", found[0]) if found[1] == "an" else (found[0], "")
            for found in _IDS.finditer(str(self._scope["path"]))
        ]
        read = read or [(recording_id, one) for one, recording_id in sorted(self._touched.items())]
        if route.startswith("/api/v1/trail/trail."):
            return _Reading("trail.exported", [("", "")], {"route": route}, is_whole)
        if act != "list.read":
            last = str(self._scope["path"]).rpartition("/")[2]
            name = last if re.fullmatch(r"[\w.]{1,60}", last, re.ASCII) else route.rpartition("/")[2]
            is_whole = is_whole and act == "file.exported"
            return _Reading(act, read or [("", "")], {"route": route, "name": name}, is_whole)
        if not read:
            return _Reading(act, [("", "")], {"route": route})
        is_report = any(analysis_id for _, analysis_id in read)
        return _Reading("report.read" if is_report else "recording.read", read, {})

    def _find_engine(self) -> Engine:
        return find_services(HTTPConnection(self._scope)).store.engine

    def _find_who(self) -> str:
        subject: Subject | None = self._scope.get(SUBJECT)
        return subject.id if subject else NOBODY


def _is_whole(status: int, headers: Headers, method: str) -> bool:
    """Tell whether a file begins to leave: not the later ranges of one that is fetched in pieces."""
    if method == "HEAD" or status == NOT_MODIFIED:
        return False
    return status != PART_OF_FILE or headers.get("content-range", "").startswith("bytes 0-")


def _find_status(message: Message, *, is_open: bool) -> int | None:
    """Give the status of a message that begins a response; that of a socket that was not accepted."""
    if message["type"] in ("http.response.start", "websocket.http.response.start"):
        return int(message["status"])
    return 403 if message["type"] == "websocket.close" and not is_open else None
