"""Who asks, found before any route runs, and what the route asks of them.

The middleware finds the subject. The permission is checked once the
route is known, by a dependency that every route has (:data:`CHECKED`). What lasts (events, a live session)
ends with the login.
"""

from collections.abc import Callable
from typing import Annotated, cast

import anyio
from anyio.to_thread import run_sync
from fastapi import Depends
from starlette.exceptions import WebSocketException
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response
from starlette.status import WS_1008_POLICY_VIOLATION
from starlette.types import ASGIApp, Receive, Scope, Send

from app.accounts.gate import Credentials, Gate
from app.accounts.routes import ROUTE_TABLE
from app.accounts.subjects import Permission, Subject
from app.errors import AppError, NotConfirmed, NotPermitted, NotSignedIn, TokenInAddress
from app.http.middleware.callers import SESSION_COOKIE, name_cookie
from app.http.middleware.problems import holds_token
from app.http.middleware.readings import KnownReadings, Recorder, RefusedLines
from app.library.audit_log import NOBODY, set_actor
from app.services import SUBJECT

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
            subject = await run_sync(self._gate.find_subject, _read_credentials(HTTPConnection(scope)))
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
