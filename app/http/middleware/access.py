"""Who asks, found before any route runs, and what the route asks of them.

The middleware finds the subject. The permission is checked once the
route is known, by a dependency that every route has (:data:`CHECKED`). What lasts (events, a live session)
ends with the login.
"""

import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from threading import Lock
from typing import Annotated, Literal, cast

import anyio
from anyio.to_thread import run_sync
from fastapi import Depends
from sqlalchemy import Engine
from starlette.datastructures import Headers
from starlette.exceptions import WebSocketException
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response
from starlette.status import WS_1008_POLICY_VIOLATION
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.accounts.gate import Credentials, Gate
from app.accounts.logins import find_network
from app.accounts.routes import ROUTE_TABLE, Route
from app.accounts.subjects import Permission, Subject
from app.errors import AppError, NotConfirmed, NotPermitted, NotSignedIn, TokenInAddress
from app.http.middleware.guard import SESSION_COOKIE, find_address, name_cookie
from app.http.middleware.problems import holds_token
from app.library.audit_log import (
    NOBODY,
    Act,
    begin_touching,
    record_alone,
    record_readings,
    record_refusal,
    set_actor,
)
from app.services import SUBJECT, find_services
from app.store.reserve import free_reserve

ONE_READING_S = 15 * 60.0
MOST_KNOWN = 10_000
WINDOW_S = 15 * 60.0
MOST_LINES, MOST_OF_STRANGERS = 50, 300
"""In a window: of one subject or address, and of all who are not logged in together."""
MOST_COUNTED = 10_000
"""So many askers are counted at once; whoever asked longest ago is forgotten first."""
STRANGERS = ""

Share = Literal["line", "more", "none"]
"""What a refusal leaves: its line, the one line that says that more were refused, or nothing."""
REFUSALS = (401, 403, 404)
NOT_MODIFIED, PART_OF_FILE = 304, 206
EXPORTS = frozenset({"file.exported", "trail.exported"})
"""A whole file that leaves is never folded."""
FOLDED = frozenset({"report.read", "recording.read"})
"""Readings of one thing by several routes are one line."""
MOST_NAMED = 20
"""So many ids of one refused request have a line."""
_ANY_ID = re.compile(r"\b(?:rec|an|ba|up|wh|per|tok|view|live)_[0-9a-f]{16,28}\b", re.ASCII)
_FILE_NAME = re.compile(r"[\w.]{1,60}", re.ASCII)


@dataclass(slots=True)
class KnownReadings:
    """What has its line since 15 minutes or less, by who and what; each server process has its own."""

    _at_s: dict[tuple[str, ...], float] = field(default_factory=dict)
    _turn: Lock = field(default_factory=Lock)

    def is_new(self, key: tuple[str, ...]) -> bool:
        """Return whether a reading begins, without counting it."""
        with self._turn:
            return time.monotonic() - self._at_s.get(key, -ONE_READING_S) >= ONE_READING_S

    def begin(self, key: tuple[str, ...]) -> None:
        """Count a reading whose line is written; the oldest is forgotten where there are too many."""
        with self._turn:
            self._at_s.pop(key, None)
            if len(self._at_s) >= MOST_KNOWN:
                del self._at_s[next(iter(self._at_s))]
            self._at_s[key] = time.monotonic()


@dataclass(slots=True)
class RefusedLines:
    """Counts the lines of each asker in a fixed window; each server process counts for itself."""

    clock: Callable[[], float] = time.monotonic
    _counts: dict[str, tuple[float, int]] = field(default_factory=dict)
    _turn: Lock = field(default_factory=Lock)

    def take(self, asker: str, *, is_stranger: bool) -> Share:
        """Count a refusal of a subject, or of an address that is nobody's."""
        with self._turn:
            share = self._count(asker, MOST_LINES)
            if share == "none" or not is_stranger:
                return share
            of_all = self._count(STRANGERS, MOST_OF_STRANGERS)
            return share if of_all == "line" else of_all

    def _count(self, asker: str, most: int) -> Share:
        now_s = self.clock()
        began_s, number = self._counts.pop(asker, (now_s, 0))
        if now_s - began_s >= WINDOW_S:
            began_s, number = now_s, 0
        elif not number and len(self._counts) >= MOST_COUNTED:
            del self._counts[next(iter(self._counts))]
        self._counts[asker] = (began_s, number + 1)
        if number < most:
            return "line"
        return "more" if number == most else "none"


class Recorder:
    """Sends the messages of one response, the first once the line of the request is written."""

    def __init__(self, scope: Scope, send: Send, known: KnownReadings, refused: RefusedLines) -> None:
        self._scope, self._send, self._known, self._refused = scope, send, known, refused
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
        path = getattr(self._scope.get("route"), "path", None)
        if path is None:
            return
        method = self._scope.get("method", "WS")
        route = ROUTE_TABLE.get((method, path), Route("public", None, asks_again=False))
        # a browser is refused by leading it to the login; any other redirect reads nothing
        is_led = 300 <= status < 400 and status != NOT_MODIFIED and method in ("GET", "HEAD")
        if is_led and route.needed != "public" and SUBJECT not in self._scope:
            status = 401
        if status in REFUSALS:
            await self._write_refusal({"status": status, "method": method, "route": path})
        elif (status < 300 or status == NOT_MODIFIED) and route.act is not None:
            await self._write_reading(route.act, path, headers, is_whole=_is_whole(status, headers, method))

    async def _write_reading(self, act: Act, path: str, headers: Headers, *, is_whole: bool) -> None:
        if headers.get("content-disposition", "").startswith("attachment") and act not in EXPORTS:
            act = "file.exported"
        params = self._scope.get("path_params", {})
        read = [(params.get("recording_id", ""), params.get("analysis_id", params.get("validation_id", "")))]
        if not any(read[0]) and act not in ("list.read", "trail.exported"):
            read = [(of, one) for one, of in sorted(self._touched.items())] or read
        other: dict[str, str | int] = {} if act in FOLDED and any(read[0]) else {"route": path}
        if act == "file.exported":
            last = str(self._scope["path"]).rpartition("/")[2]
            other["name"] = last if _FILE_NAME.fullmatch(last) else path.rpartition("/")[2]
        who = self._find_who()
        key = (who, act, *map(str, other.values()), *(one for pair in read for one in pair))
        if (is_whole and act in EXPORTS) or self._known.is_new(key):
            await run_sync(record_readings, self._find_engine(), act, read, other)
            self._known.begin(key)

    async def _write_refusal(self, told: Mapping[str, str | int]) -> None:
        who, connection = self._find_who(), HTTPConnection(self._scope)
        is_stranger = who == NOBODY
        asker = find_network(find_address(connection)) if is_stranger else who
        # the ids of the address, whether or not they are anybody's; "" if it has none
        address = f"{self._scope['path']}?{self._scope.get('query_string', b'').decode('latin-1')}"
        for one in list(dict.fromkeys(_ANY_ID.findall(address)))[:MOST_NAMED] or [""]:
            key = (who, "refused", *map(str, told.values()), one)
            if not self._known.is_new(key):
                continue
            share, engine = self._refused.take(asker, is_stranger=is_stranger), self._find_engine()
            if share == "line":
                await run_sync(record_refusal, engine, one, told)
                self._known.begin(key)
            elif share == "more":
                most = {"most": MOST_LINES, "most_of_strangers": MOST_OF_STRANGERS}
                await run_sync(record_alone, engine, "refused.more", most | {"minutes": int(WINDOW_S / 60)})

    def _find_engine(self) -> Engine:
        return find_services(HTTPConnection(self._scope)).store.engine

    def _find_who(self) -> str:
        subject: Subject | None = self._scope.get(SUBJECT)
        return subject.id if subject else NOBODY


def _is_whole(status: int, headers: Headers, method: str) -> bool:
    """Return whether a file begins to leave: not the later ranges of one that is fetched in pieces."""
    if method == "HEAD" or status == NOT_MODIFIED:
        return False
    return status != PART_OF_FILE or headers.get("content-range", "").startswith("bytes 0-")


def _find_status(message: Message, *, is_open: bool) -> int | None:
    """Return the status of a message that begins a response; that of a socket that was not accepted."""
    if message["type"] in ("http.response.start", "websocket.http.response.start"):
        return int(message["status"])
    return 403 if message["type"] == "websocket.close" and not is_open else None


LOOK_S = 2.0
"""How often it is looked up whether the login of a lasting request still holds."""

HEALTH = frozenset({"/healthz", "/readyz"})
"""What tells that the database is away: nobody is looked up there."""

Respond = Callable[[Request, Exception], Response]


class Access:
    """Middleware that tells who asks."""

    def __init__(self, app: ASGIApp, gate: Gate, respond: Respond) -> None:
        self._app, self._gate, self._respond = app, gate, respond
        self._known, self._refused = KnownReadings(), RefusedLines()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Find the subject, then hand the request on; an address that holds a token is refused at once."""
        path = str(scope.get("path", ""))
        if scope["type"] == "lifespan" or path.removeprefix(scope.get("root_path", "")) in HEALTH:
            await self._app(scope, receive, send)
            return
        try:
            if holds_token(f"{path}?{scope['query_string'].decode('latin-1')}"):
                raise TokenInAddress
            subject = await run_sync(self._find_subject, HTTPConnection(scope))
            if subject is not None:
                scope[SUBJECT] = subject
        except AppError as refusal:
            await self._refuse(scope, receive, send, refusal)
            return
        set_actor(subject.id if subject else NOBODY)
        recorder = Recorder(scope, send, self._known, self._refused)
        try:
            await self._run(subject, scope, receive, recorder.send)
        except Exception:
            if recorder.refusal is None:
                raise
            await self._refuse(scope, receive, send, recorder.refusal)

    def _find_subject(self, connection: HTTPConnection) -> Subject | None:
        """Find who asks; every request may write to the audit log, so room is made for that."""
        free_reserve(find_services(connection).storage.root)
        return self._gate.find_subject(_read_credentials(connection))

    async def _run(self, subject: Subject | None, scope: Scope, receive: Receive, send: Send) -> None:
        if subject is None or not _lasts(scope):
            await self._app(scope, receive, send)
            return
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(self._end_with_login, subject, tasks.cancel_scope)
            await self._app(scope, receive, send)
            tasks.cancel_scope.cancel()

    async def _refuse(self, scope: Scope, receive: Receive, send: Send, refusal: Exception) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": WS_1008_POLICY_VIOLATION})
            return
        await self._respond(Request(scope), refusal)(scope, receive, send)

    async def _end_with_login(self, subject: Subject, lasting: anyio.CancelScope) -> None:
        while await run_sync(self._gate.is_alive, subject):
            await anyio.sleep(LOOK_S)
        lasting.cancel()


def _lasts(scope: Scope) -> bool:
    return scope["type"] == "websocket" or str(scope["path"]).endswith("/events")


def _read_credentials(connection: HTTPConnection) -> Credentials:
    """Read what a request brings; a secret in the address is not looked at."""
    cookie = connection.cookies.get(name_cookie(connection, SESSION_COOKIE), "")
    scheme, _, value = connection.headers.get("authorization", "").partition(" ")
    bearer = value.strip() if scheme.lower() == "bearer" else ""
    is_attended = "x-unattended" not in connection.headers and not _lasts(connection.scope)
    return Credentials(bearer, cookie, is_attended)


async def check_permission(connection: HTTPConnection) -> None:
    """Check that the subject may use the route that was found; a WebSocket is closed before it is accepted.

    Raises NotSignedIn, NotPermitted, NotConfirmed.
    """
    method, path = connection.scope.get("method", "WS"), connection.scope["route"].path
    route = ROUTE_TABLE.get((method, path))
    try:
        if route is None or (route.needed != "public" and not find_subject(connection).may(route.needed)):
            raise NotPermitted(permission=str(route and route.needed))
    except AppError as refusal:
        if method != "WS":
            raise
        raise WebSocketException(WS_1008_POLICY_VIOLATION, refusal.code) from refusal
    if route is not None and route.asks_again:
        await run_sync(check_confirmed, connection)


def check_confirmed(connection: HTTPConnection) -> None:
    """Check that a person gave the password a short time ago. Raises NotConfirmed."""
    if not find_gate(connection).is_confirmed(find_subject(connection)):
        raise NotConfirmed


def find_gate(connection: HTTPConnection) -> Gate:
    """Return the gate of the application that answers."""
    return cast("Gate", connection.app.state.gate)


CHECKED = [Depends(check_permission)]


def find_subject(connection: HTTPConnection) -> Subject:
    """Return who asks. Raises NotSignedIn."""
    subject: Subject | None = connection.scope.get(SUBJECT)
    if subject is None:
        raise NotSignedIn
    return subject


UsedSubject = Annotated[Subject, Depends(find_subject)]


def may(connection: HTTPConnection, permission: Permission) -> bool:
    """Return whether whoever asks has a permission; nobody known has none."""
    subject: Subject | None = connection.scope.get(SUBJECT)
    return subject is not None and subject.may(permission)


def check_may(subject: Subject, permission: Permission) -> None:
    """Check a permission that depends on what the request says. Raises NotPermitted."""
    if not subject.may(permission):
        raise NotPermitted(permission=permission)
