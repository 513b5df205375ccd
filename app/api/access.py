"""Who asks, found before any route runs, and what the route asks of them.

The middleware finds the subject and the services of its organisation. The permission is checked once the
route is known, by a dependency that every route has (:data:`CHECKED`). What lasts (events, a live session)
ends with the login.
"""

from collections.abc import Callable
from typing import Annotated

import anyio
from anyio.to_thread import run_sync
from fastapi import Depends
from starlette.datastructures import Headers
from starlette.exceptions import WebSocketException
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from app.access.gate import Credentials, Gate
from app.access.routes import find_needed
from app.access.subjects import Permission, Subject
from app.api.readings import KnownReadings, Recorder
from app.errors import AppError, NotPermitted, NotSignedIn
from app.jobs.trail import NOBODY, set_actor
from app.services import SERVICES, Offices

SESSION_COOKIE = "acromion_session"
SUBJECT = "acromion.subject"
"""The key of the subject in the scope of a request."""
POLICY_VIOLATION = 1008
"""The code of a socket that is refused (RFC 6455, 7.4.1)."""
LOOK_S = 2.0
"""How often it is looked up whether the login of a lasting request still holds."""

Respond = Callable[[Request, Exception], Response]


class Access:
    """Middleware that tells who asks."""

    def __init__(self, app: ASGIApp, gate: Gate, offices: Offices, respond: Respond) -> None:
        self._app, self._gate, self._offices, self._respond = app, gate, offices, respond
        self._readings = KnownReadings()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Find the subject and its services, then hand the request on."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        try:
            subject = await run_sync(self._gate.find_subject, read_credentials(HTTPConnection(scope)))
            if subject is not None:
                scope[SUBJECT] = subject
                scope[SERVICES] = await run_sync(self._offices.find, subject.organisation)
        except AppError as refusal:
            await self._refuse(scope, receive, send, refusal)
            return
        set_actor(subject.id if subject else NOBODY)
        recorder = Recorder(scope, send, self._readings)
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
            await send({"type": "websocket.close", "code": POLICY_VIOLATION})
            return
        await self._respond(Request(scope), refusal)(scope, receive, send)

    async def _end_with_login(self, subject: Subject, lasting: anyio.CancelScope) -> None:
        while await run_sync(self._gate.is_alive, subject):
            await anyio.sleep(LOOK_S)
        lasting.cancel()


def _lasts(scope: Scope) -> bool:
    return scope["type"] == "websocket" or str(scope["path"]).endswith("/events")


def read_credentials(connection: HTTPConnection) -> Credentials:
    """Read what a request brings; a secret in the address is not looked at."""
    return Credentials(_read_bearer(connection.headers), connection.cookies.get(SESSION_COOKIE, ""))


def _read_bearer(headers: Headers) -> str:
    scheme, _, value = headers.get("authorization", "").partition(" ")
    return value.strip() if scheme.lower() == "bearer" else ""


async def check_permission(connection: HTTPConnection) -> None:
    """Check that the subject may use the route that was found.

    Raises
    ------
    NotSignedIn, NotPermitted
    WebSocketException
        The same for a socket, which is closed before it is accepted.
    """
    try:
        _check_route(connection)
    except AppError as refusal:
        if connection.scope["type"] != "websocket":
            raise
        raise WebSocketException(POLICY_VIOLATION, refusal.code) from refusal


def _check_route(connection: HTTPConnection) -> None:
    method = connection.scope.get("method", "WS")
    needed = find_needed(method, connection.scope["route"].path)
    if needed == "public":
        return
    subject = connection.scope.get(SUBJECT)
    if subject is None:
        raise NotSignedIn
    if needed is None or not subject.may(needed):
        raise NotPermitted(permission=str(needed))


CHECKED = [Depends(check_permission)]


def find_subject(connection: HTTPConnection) -> Subject:
    """Give who asks.

    Raises
    ------
    NotSignedIn
    """
    subject: Subject | None = connection.scope.get(SUBJECT)
    if subject is None:
        raise NotSignedIn
    return subject


UsedSubject = Annotated[Subject, Depends(find_subject)]


def may(connection: HTTPConnection, permission: Permission) -> bool:
    """Tell whether whoever asks has a permission; nobody known has none."""
    subject: Subject | None = connection.scope.get(SUBJECT)
    return subject is not None and subject.may(permission)


def check_may(subject: Subject, permission: Permission) -> None:
    """Check a permission that depends on what the request says.

    Raises
    ------
    NotPermitted
    """
    if not subject.may(permission):
        raise NotPermitted(permission=permission)
