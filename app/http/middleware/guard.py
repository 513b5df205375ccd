"""Middleware that checks the caller, upload speed and text of each request, and sets security headers."""

import asyncio
import json
import math
import re
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, ClassVar, cast
from urllib.parse import urlsplit

import anyio
import h11
from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from acromion.app.accounts.sign_in import Caller, SignIn
from acromion.app.errors import AppError, BadParameter, ForeignHostName, ForeignOrigin, SlowUpload
from acromion.app.settings import Settings
from acromion.app.store.folder import too_large

SESSION_COOKIE = "acromion_session"
BROWSER_COOKIE = "acromion_browser"
STATE_COOKIE = "acromion_state"
_HOST_PREFIX = "__Host-"
"""Browsers keep a cookie with this prefix only if this host set it over HTTPS for every path."""
MAX_COOKIE_LENGTH = 200


def get_settings(connection: HTTPConnection) -> Settings:
    """Return the settings of the server."""
    return cast("Settings", connection.app.state.services.settings)


def get_logins(connection: HTTPConnection) -> SignIn:
    """Return the sign-in service."""
    return cast("SignIn", connection.app.state.sign_in)


def get_client_address(connection: HTTPConnection) -> str:
    """Return the address of the peer or, behind the configured proxy, its last ``X-Forwarded-For`` entry."""
    peer, proxy = connection.client.host if connection.client else "unix", get_settings(connection).proxy
    forwarded = connection.headers.get("x-forwarded-for", "").rpartition(",")[2].strip()
    return forwarded if forwarded and proxy and (peer or "unix") == proxy else peer or "unix"


def get_caller(connection: HTTPConnection) -> Caller:
    """Return the address and browser of a sign-in attempt."""
    browser = connection.cookies.get(name_cookie(connection, BROWSER_COOKIE), "")
    return Caller(get_client_address(connection), browser[:MAX_COOKIE_LENGTH])


def is_secure(connection: HTTPConnection) -> bool:
    """Return whether the browser uses HTTPS, with this server or with the proxy before it."""
    return connection.url.scheme in ("https", "wss") or bool(get_settings(connection).proxy)


def get_host_url(connection: HTTPConnection) -> str:
    """Return the scheme and host that the browser used."""
    scheme = "https" if is_secure(connection) else "http"
    return f"{scheme}://{connection.headers.get('host', '')}"


def name_cookie(connection: HTTPConnection, name: str) -> str:
    """Return the name of a cookie; it contains the port, so that two servers on one computer do not clash."""
    _, _, port = connection.headers.get("host", "").rpartition(":")
    named = f"{name}_{port}" if re.fullmatch(r"[0-9]{1,5}", port) else name
    is_bound = is_secure(connection) and get_cookie_path(connection) == "/"
    return f"{_HOST_PREFIX}{named}" if is_bound else named


def set_cookie(connection: HTTPConnection, response: Response, name: str, value: str, age_s: int) -> None:
    """Set a cookie that scripts cannot read."""
    response.set_cookie(
        name_cookie(connection, name),
        value,
        max_age=age_s,
        httponly=True,
        secure=is_secure(connection),
        samesite="lax",
        path=get_cookie_path(connection),
    )


def drop_cookie(connection: HTTPConnection, response: Response, name: str) -> None:
    """Delete a cookie in the browser."""
    set_cookie(connection, response, name, "", 0)


def get_cookie_path(connection: HTTPConnection) -> str:
    """Return the path of the server's cookies."""
    return str(connection.scope.get("root_path", "")).rstrip("/") or "/"


# A time limit for the header of each request; uvicorn has none.


class HeaderTimeoutProtocol(H11Protocol):
    """uvicorn's HTTP/1.1 protocol; closes a connection if its request header does not arrive in time."""

    header_timeout_s: ClassVar[float] = 10.0
    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """Start the timer."""
        super().connection_made(transport)
        self._watch()

    def data_received(self, data: bytes) -> None:
        """Stop the timer once the header is complete; more bytes do not extend the limit."""
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timer."""
        self._stop_watching()
        super().connection_lost(exc)

    def _watch(self) -> None:
        if self.conn.their_state is not h11.IDLE:
            self._stop_watching()
        elif self._timer is None:
            self._timer = self.loop.call_later(self.header_timeout_s, self._time_out)

    def _stop_watching(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _time_out(self) -> None:
        self._timer = None
        if self.conn.their_state is h11.IDLE and not self.transport.is_closing():
            self.transport.close()


def build_timeout_protocol(header_timeout_s: float) -> type[H11Protocol]:
    """Build a protocol class with the given time limit."""
    return type("HeaderTimeoutProtocol", (HeaderTimeoutProtocol,), {"header_timeout_s": header_timeout_s})


SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
_PORTS = {"http": 80, "https": 443}
LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})

FILE_PATHS = (
    "/api/v1/analyze",
    "/api/v1/recordings",
    "/api/v1/uploads",
    "/api/v1/validations",
    "/validations",
)
DRAINED_BYTES, DRAIN_LIMIT_S = 64 << 20, 5.0
"""Most bytes read of a refused body (one part of an upload from the page) before the response is sent."""
MAX_TEXT_BODY_BYTES = 8 << 20
"""Largest body of a request that contains no file."""

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; "
    "frame-ancestors 'none'; sandbox"
)

SECURITY_HEADERS: dict[str, str] = {
    "Content-Security-Policy": PAGE_POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",  # browsers send "Origin: null" without it, and that is refused
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}

TRANSPORT_SECURITY = "max-age=31536000; includeSubDomains"
"""Browsers use only TLS for this host and its subdomains for a year."""

Respond = Callable[[Request, AppError], Response]


class Guard:
    """Refuse foreign hosts, foreign origins and slow uploads; add the security headers to every response."""

    def __init__(
        self,
        app: ASGIApp,
        respond: Respond,
        min_rate_bytes_per_s: float,
        body_timeout_s: float,
        host_names: frozenset[str] = frozenset(),
    ) -> None:
        self._app, self._respond, self._host_names = app, respond, LOOPBACK_NAMES | host_names
        # Strict transport security is only set if the server has a host name; never for localhost.
        bound = {"Strict-Transport-Security": TRANSPORT_SECURITY} if host_names else {}
        self._headers = SECURITY_HEADERS | bound
        self._min_rate_bytes_per_s, self._body_timeout_s = min_rate_bytes_per_s, body_timeout_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check the request, then pass it on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] == "websocket":  # browsers apply no same-origin policy to WebSockets
            try:
                check_caller("POST", HTTPConnection(scope), self._host_names)
            except AppError:
                await send({"type": "websocket.close", "code": 1008})
                return
            await self._app(scope, receive, send)
            return
        request, sealed = Request(scope), _add_headers(send, self._headers)
        try:
            check_caller(request.method, request, self._host_names)
        except AppError as refusal:
            await self._respond(request, refusal)(scope, receive, sealed)
            return
        most_bytes = math.inf if accepts_file(scope) else MAX_TEXT_BODY_BYTES
        watch = _BodyWatch(receive, self._min_rate_bytes_per_s, self._body_timeout_s, most_bytes)
        sealed = _drain_refused(sealed, watch, request)
        if scope["method"] == "HEAD":  # HEAD works for every GET route (RFC 9110, 9.3.2)
            scope = {**scope, "method": "GET"}  # uvicorn leaves out the body
        await self._app(scope, watch.receive, sealed)


def accepts_file(scope: Scope) -> bool:
    """Return whether a path, without the proxy's prefix, accepts files of any size."""
    path: str = scope["path"]
    return path.removeprefix(scope.get("root_path", "")).startswith(FILE_PATHS)


def check_caller(
    method: str, connection: HTTPConnection, host_names: frozenset[str] = LOOPBACK_NAMES
) -> None:
    """Refuse unknown host names (DNS rebinding) and state changes requested by another site.

    The origin of a page must have the same scheme, name and port; behind a proxy the scheme is the proxy's.

    Raises ForeignHostName, ForeignOrigin.
    """
    headers = connection.headers
    host = headers.get("host", "")
    if _read_host_name(host) not in host_names:
        raise ForeignHostName(host=host[:100])
    if method in SAFE_METHODS:
        return
    origin = headers.get("origin")
    if origin is not None and _read_origin(origin) != _read_origin(get_host_url(connection)):
        raise ForeignOrigin
    if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
        raise ForeignOrigin


def _read_origin(origin: str) -> tuple[str, str, int | None] | None:
    """Parse scheme, name and port; return None if it is not an origin ("null")."""
    try:
        parts = urlsplit(origin)
        port = parts.port or _PORTS.get(parts.scheme)
    except ValueError:
        return None
    return (parts.scheme, parts.hostname, port) if parts.hostname else None


def _read_host_name(host: str) -> str:
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _add_headers(send: Send, added: Mapping[str, str]) -> Send:
    """Add the headers that the route has not set."""

    async def sealed(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in added.items():
                headers.setdefault(name, value)
        await send(message)

    return sealed


def _drain_refused(send: Send, watch: "_BodyWatch", request: Request) -> Send:
    """Read a refused body before the response: closing with unread bytes would cut the response off."""
    announced = request.headers.get("content-length", "")
    is_drained = announced.isdecimal() and int(announced) <= DRAINED_BYTES

    async def patient(message: Message) -> None:
        if is_drained and message["type"] == "http.response.start" and message["status"] >= 400:
            with anyio.move_on_after(DRAIN_LIMIT_S):
                await watch.finish()
        await send(message)

    return patient


class _BodyWatch:
    """Measure how long the server waited for the body; the server's processing time does not count."""

    def __init__(
        self,
        receive: Receive,
        min_rate_bytes_per_s: float,
        body_timeout_s: float,
        most_bytes: float = math.inf,
    ) -> None:
        self._receive, self._most_bytes = receive, most_bytes
        self._min_rate_bytes_per_s, self._body_timeout_s = min_rate_bytes_per_s, body_timeout_s
        self._waited_s, self._got_bytes, self._all_bytes, self._more = 0.0, 0, 0, True

    async def receive(self) -> Message:
        """Return the next message. Raises SlowUpload, FileTooLarge."""
        if not self._more:
            return await self._receive()
        began_s = time.monotonic()
        with anyio.move_on_after(self._body_timeout_s) as scope:
            message = await self._receive()
        if scope.cancelled_caught:
            raise SlowUpload
        self._waited_s += time.monotonic() - began_s
        self._got_bytes += len(message.get("body", b""))
        self._all_bytes += len(message.get("body", b""))
        self._more = message.get("more_body", False)
        if self._all_bytes > self._most_bytes:
            raise too_large(self._all_bytes, int(self._most_bytes))
        # The rate is checked per window, so a fast start does not excuse a later standstill.
        if self._waited_s >= self._body_timeout_s:
            if self._more and self._got_bytes < self._min_rate_bytes_per_s * self._waited_s:
                raise SlowUpload
            self._waited_s, self._got_bytes = 0.0, 0
        return message

    async def finish(self) -> None:
        """Read and discard the rest of the body."""
        with suppress(AppError):  # the request is already being refused
            while self._more and (await self.receive())["type"] == "http.request":
                pass


# Text that databases, logs and responses cannot represent: lone surrogates and NUL.

_UNFIT = re.compile(r"[\0\ud800-\udfff]")
_MAY_BE_UNFIT = re.compile(rb"\\u(?:0000|[dD][89a-fA-F])|\xed[\xa0-\xbf]|\0")
"""Such text in raw JSON: as an escape, or as invalid UTF-8 that Python decodes."""
_NUL_IN_ADDRESS = re.compile(rb"%00|\0")


class PlainText:
    """Refuse lone surrogates and NUL in the address and in JSON bodies."""

    def __init__(self, app: ASGIApp, respond: Respond) -> None:
        self._app, self._respond = app, respond

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse invalid text; pass everything else on unchanged."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        try:
            # invalid UTF-8 in an address is replaced during decoding
            if any(map(_NUL_IN_ADDRESS.search, (scope.get("raw_path") or b"", scope["query_string"]))):
                raise BadParameter(name="URL", value="%00", allowed="UTF-8")
            messages = await _read_json(scope, receive)
            check_json(b"".join(message.get("body", b"") for message in messages))
        except AppError as refusal:
            await self._respond(Request(scope), refusal)(scope, receive, send)
            return
        waiting = iter(messages)

        async def receive_again() -> Message:
            return next(waiting, None) or await receive()

        await self._app(scope, receive_again, send)


def check_json(body: bytes) -> None:
    """Refuse JSON that contains a lone surrogate or a NUL; a body that is not JSON is left to the route.

    Raises BadParameter.
    """
    if not _MAY_BE_UNFIT.search(body):
        return
    try:
        values = json.loads(body)
    except (ValueError, RecursionError):
        return
    waiting = [values]
    while waiting:  # names and texts at every depth
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += [*value, *value.values()]
        elif isinstance(value, list):
            waiting += value
        elif isinstance(value, str) and (unfit := _UNFIT.search(value)):
            raise BadParameter(name="body", value=repr(unfit.group())[1:-1], allowed="UTF-8")


async def _read_json(scope: Scope, receive: Receive) -> list[Message]:
    """Return the messages of a body that may be JSON; none of any other body."""
    kind = dict(scope["headers"]).get(b"content-type", b"").lower()
    is_file = accepts_file(scope) and b"json" not in kind
    if scope["method"] in SAFE_METHODS or is_file or kind.startswith(b"multipart/"):
        return []
    messages = [await receive()]
    while messages[-1].get("more_body", False):
        messages.append(await receive())
    return messages
