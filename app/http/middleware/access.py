"""Authentication and permissions of each request, and its audit log entry.

The middleware finds the subject of the request. Every route has a dependency (:data:`CHECKED`) that checks
the permission once the route is known. Long-running requests (events, live sessions) end with the session.
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

from acromion.app.accounts.gate import Credentials, Gate
from acromion.app.accounts.routes import ROUTE_TABLE, Route
from acromion.app.accounts.sign_in import find_network
from acromion.app.accounts.subjects import Permission, Subject
from acromion.app.errors import AppError, NotConfirmed, NotPermitted, NotSignedIn, TokenInAddress
from acromion.app.http.middleware.guard import SESSION_COOKIE, get_client_address, name_cookie
from acromion.app.http.middleware.problems import contains_token
from acromion.app.library.audit_log import (
    NOBODY,
    Act,
    begin_collecting_reads,
    record_alone,
    record_readings,
    record_refusal,
    set_actor,
)
from acromion.app.services import SUBJECT, find_services
from acromion.app.store.reserve import free_reserve

ONE_READING_S = 15 * 60.0
MAX_RECENT_READS = 10_000
WINDOW_S = 15 * 60.0
MAX_LINES, MAX_UNAUTHENTICATED_LINES = 50, 300
"""Most refusal entries per window: of one subject or address, and of all unauthenticated requests."""
MAX_COUNTED_CLIENTS = 10_000
"""Most clients counted at a time; the one seen longest ago is dropped first."""
STRANGERS = ""

Share = Literal["line", "more", "none"]
"""How a refusal is logged: by its own entry, by one entry for all further refusals, or not at all."""
REFUSALS = (401, 403, 404)
NOT_MODIFIED, PART_OF_FILE = 304, 206
EXPORTS = frozenset({"file.exported", "trail.exported"})
"""A download of a whole file always has its own entry."""
FOLDED = frozenset({"report.read", "recording.read"})
"""Reads of one object through several routes share one entry."""
MAX_LOGGED_IDS = 20
"""Most ids of one refused request that are logged."""
_ANY_ID = re.compile(r"\b(?:rec|an|ba|up|wh|per|tok|view|live)_[0-9a-f]{16,28}\b", re.ASCII)
_FILE_NAME = re.compile(r"[\w.]{1,60}", re.ASCII)


@dataclass(slots=True)
class RecentReads:
    """Reads of the last 15 minutes that have an entry, by subject and object; per server process."""

    _at_s: dict[tuple[str, ...], float] = field(default_factory=dict)
    _turn: Lock = field(default_factory=Lock)

    def is_new(self, key: tuple[str, ...]) -> bool:
        """Return whether a read needs a new entry. The read is not counted."""
        with self._turn:
            return time.monotonic() - self._at_s.get(key, -ONE_READING_S) >= ONE_READING_S

    def begin(self, key: tuple[str, ...]) -> None:
        """Count a logged read; drop the oldest one if there are too many."""
        with self._turn:
            self._at_s.pop(key, None)
            if len(self._at_s) >= MAX_RECENT_READS:
                del self._at_s[next(iter(self._at_s))]
            self._at_s[key] = time.monotonic()


@dataclass(slots=True)
class RefusedLines:
    """Count the refusals of each client in a fixed window; each server process counts its own."""

    clock: Callable[[], float] = time.monotonic
    _counts: dict[str, tuple[float, int]] = field(default_factory=dict)
    _turn: Lock = field(default_factory=Lock)

    def take(self, asker: str, *, is_stranger: bool) -> Share:
        """Count a refusal of a subject, or of the address of an unauthenticated client."""
        with self._turn:
            share = self._count(asker, MAX_LINES)
            if share == "none" or not is_stranger:
                return share
            of_all = self._count(STRANGERS, MAX_UNAUTHENTICATED_LINES)
            return share if of_all == "line" else of_all

    def _count(self, asker: str, most: int) -> Share:
        now_s = self.clock()
        began_s, number = self._counts.pop(asker, (now_s, 0))
        if now_s - began_s >= WINDOW_S:
            began_s, number = now_s, 0
        elif not number and len(self._counts) >= MAX_COUNTED_CLIENTS:
            del self._counts[next(iter(self._counts))]
        self._counts[asker] = (began_s, number + 1)
        if number < most:
            return "line"
        return "more" if number == most else "none"


class AuditRecorder:
    """Send the messages of one response; write its audit log entry before the first message."""

    def __init__(self, scope: Scope, send: Send, known: RecentReads, refused: RefusedLines) -> None:
        self._scope, self._send, self._known, self._refused = scope, send, known, refused
        self._touched = begin_collecting_reads()
        self.refusal: Exception | None = None
        self._is_open = False

    async def send(self, message: Message) -> None:
        """Send a message.

        Raises
        ------
        Exception
            If the entry could not be written. The response must not be sent in that case.
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
        # A browser without a session is redirected to the sign-in page, which counts as 401. Other redirects
        # return no data.
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
        who = self._get_subject_id()
        key = (who, act, *map(str, other.values()), *(one for pair in read for one in pair))
        if (is_whole and act in EXPORTS) or self._known.is_new(key):
            await run_sync(record_readings, self._get_engine(), act, read, other)
            self._known.begin(key)

    async def _write_refusal(self, facts: Mapping[str, str | int]) -> None:
        who, connection = self._get_subject_id(), HTTPConnection(self._scope)
        is_stranger = who == NOBODY
        asker = find_network(get_client_address(connection)) if is_stranger else who
        # Log the ids in the address, even unknown ones; "" if there are none.
        address = f"{self._scope['path']}?{self._scope.get('query_string', b'').decode('latin-1')}"
        for one in list(dict.fromkeys(_ANY_ID.findall(address)))[:MAX_LOGGED_IDS] or [""]:
            key = (who, "refused", *map(str, facts.values()), one)
            if not self._known.is_new(key):
                continue
            share, engine = self._refused.take(asker, is_stranger=is_stranger), self._get_engine()
            if share == "line":
                await run_sync(record_refusal, engine, one, facts)
                self._known.begin(key)
            elif share == "more":
                most = {"most": MAX_LINES, "most_of_strangers": MAX_UNAUTHENTICATED_LINES}
                await run_sync(record_alone, engine, "refused.more", most | {"minutes": int(WINDOW_S / 60)})

    def _get_engine(self) -> Engine:
        return find_services(HTTPConnection(self._scope)).store.engine

    def _get_subject_id(self) -> str:
        subject: Subject | None = self._scope.get(SUBJECT)
        return subject.id if subject else NOBODY


def _is_whole(status: int, headers: Headers, method: str) -> bool:
    """Return whether a response starts a download; later ranges of the same file do not."""
    if method == "HEAD" or status == NOT_MODIFIED:
        return False
    return status != PART_OF_FILE or headers.get("content-range", "").startswith("bytes 0-")


def _find_status(message: Message, *, is_open: bool) -> int | None:
    """Return the status of a message that starts a response, or 403 if a WebSocket is rejected."""
    if message["type"] in ("http.response.start", "websocket.http.response.start"):
        return int(message["status"])
    return 403 if message["type"] == "websocket.close" and not is_open else None


CHECK_PERIOD_S = 2.0
"""Interval at which the session of a long-running request is checked."""

HEALTH = frozenset({"/healthz", "/readyz"})
"""Health checks also answer if the database is down, so they look up no subject."""

Respond = Callable[[Request, Exception], Response]


class Access:
    """Middleware that identifies the subject of each request."""

    def __init__(self, app: ASGIApp, gate: Gate, respond: Respond) -> None:
        self._app, self._gate, self._respond = app, gate, respond
        self._known, self._refused = RecentReads(), RefusedLines()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Find the subject and pass the request on; refuse an address that contains a token."""
        path = str(scope.get("path", ""))
        if scope["type"] == "lifespan" or path.removeprefix(scope.get("root_path", "")) in HEALTH:
            await self._app(scope, receive, send)
            return
        try:
            if contains_token(f"{path}?{scope['query_string'].decode('latin-1')}"):
                raise TokenInAddress
            subject = await run_sync(self._find_subject, HTTPConnection(scope))
            if subject is not None:
                scope[SUBJECT] = subject
        except AppError as refusal:
            await self._refuse(scope, receive, send, refusal)
            return
        set_actor(subject.id if subject else NOBODY)
        recorder = AuditRecorder(scope, send, self._known, self._refused)
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
        if subject is None or not _is_long_running(scope):
            await self._app(scope, receive, send)
            return
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(self._end_with_session, subject, tasks.cancel_scope)
            await self._app(scope, receive, send)
            tasks.cancel_scope.cancel()

    async def _refuse(self, scope: Scope, receive: Receive, send: Send, refusal: Exception) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": WS_1008_POLICY_VIOLATION})
            return
        await self._respond(Request(scope), refusal)(scope, receive, send)

    async def _end_with_session(self, subject: Subject, lasting: anyio.CancelScope) -> None:
        while await run_sync(self._gate.is_alive, subject):
            await anyio.sleep(CHECK_PERIOD_S)
        lasting.cancel()


def _is_long_running(scope: Scope) -> bool:
    return scope["type"] == "websocket" or str(scope["path"]).endswith("/events")


def _read_credentials(connection: HTTPConnection) -> Credentials:
    """Read the credentials in cookie and headers; a secret in the address is ignored."""
    cookie = connection.cookies.get(name_cookie(connection, SESSION_COOKIE), "")
    scheme, _, value = connection.headers.get("authorization", "").partition(" ")
    bearer = value.strip() if scheme.lower() == "bearer" else ""
    is_attended = "x-unattended" not in connection.headers and not _is_long_running(connection.scope)
    return Credentials(bearer, cookie, is_attended)


async def check_permission(connection: HTTPConnection) -> None:
    """Check that the subject may use the route; a WebSocket is closed before it is accepted.

    Raises NotSignedIn, NotPermitted, NotConfirmed.
    """
    method, path = connection.scope.get("method", "WS"), connection.scope["route"].path
    route = ROUTE_TABLE.get((method, path))
    try:
        if route is None or (route.needed != "public" and not get_subject(connection).may(route.needed)):
            raise NotPermitted(permission=str(route and route.needed))
    except AppError as refusal:
        if method != "WS":
            raise
        raise WebSocketException(WS_1008_POLICY_VIOLATION, refusal.code) from refusal
    if route is not None and route.asks_again:
        await run_sync(check_confirmed, connection)


def check_confirmed(connection: HTTPConnection) -> None:
    """Check that the person entered the password a short time ago. Raises NotConfirmed."""
    if not get_gate(connection).is_confirmed(get_subject(connection)):
        raise NotConfirmed


def get_gate(connection: HTTPConnection) -> Gate:
    """Return the gate of the application."""
    return cast("Gate", connection.app.state.gate)


CHECKED = [Depends(check_permission)]


def get_subject(connection: HTTPConnection) -> Subject:
    """Return the subject of the request. Raises NotSignedIn."""
    subject: Subject | None = connection.scope.get(SUBJECT)
    if subject is None:
        raise NotSignedIn
    return subject


UsedSubject = Annotated[Subject, Depends(get_subject)]


def may(connection: HTTPConnection, permission: Permission) -> bool:
    """Return whether the subject has a permission; without a subject, False."""
    subject: Subject | None = connection.scope.get(SUBJECT)
    return subject is not None and subject.may(permission)


def check_may(subject: Subject, permission: Permission) -> None:
    """Check a permission that depends on the content of the request. Raises NotPermitted."""
    if not subject.may(permission):
        raise NotPermitted(permission=permission)
