"""``Idempotency-Key`` on every POST: a repeated request is done once and answered alike.

Source: IETF draft httpapi-idempotency-key-header-07: the same key with another request is a 422, a key whose
request is still under way a 409. Responses that a repetition may change (409, 423, 429, 5xx) are not kept.
What was purged since is a 410: the repetition makes nothing anew.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field

from fastapi.concurrency import run_in_threadpool
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.access.subjects import MACHINE, Subject
from app.errors import AppError, KeyInUse, KeyReused, PurgedSince
from app.jobs.idempotency import GONE, KeptResponse, ResponseStore
from app.services import SUBJECT, find_services

LONGEST_KEY = 255
SECRET_PATHS = ("/api/v1/tokens", "/account", "/login", "/people")
"""Responses that hold what is shown once are never kept."""
PASSING = frozenset({408, 409, 423, 429})

Respond = Callable[[Request, AppError], Response]


class Idempotency:
    """Middleware that keeps the responses of the routes."""

    def __init__(self, app: ASGIApp, respond: Respond) -> None:
        self._app, self._respond = app, respond

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Run the route, or repeat its kept response."""
        key = _find_key(scope)
        if not key:
            await self._app(scope, receive, send)
            return
        listener = _Listener(receive, send, _begin_fingerprint(scope))
        responses = find_services(HTTPConnection(scope)).responses
        known = await run_in_threadpool(responses.reserve, key)
        if known is None:
            await self._run_first(key, responses, scope, listener)
        else:
            response = await self._repeat(known, responses, scope, listener)
            await response(scope, receive, send)

    async def _repeat(
        self, known: KeptResponse, responses: ResponseStore, scope: Scope, listener: "_Listener"
    ) -> Response:
        """Give the kept response once the whole request has proved to be the same; else the refusal."""
        if known.status is None:
            return self._respond(Request(scope), KeyInUse())
        if not responses.is_of(known, await listener.read_to_end()):
            return self._respond(Request(scope), KeyReused())
        if known.status == GONE:
            return self._respond(Request(scope), PurgedSince())
        return Response(known.body, known.status, dict(known.headers))

    async def _run_first(
        self, key: str, responses: ResponseStore, scope: Scope, listener: "_Listener"
    ) -> None:
        kept = False
        try:
            await self._app(scope, listener.receive, listener.send)
            if listener.is_final:
                await run_in_threadpool(responses.keep, key, listener.keep())
                kept = True
        finally:
            if not kept:
                await run_in_threadpool(responses.free, key)


@dataclass(slots=True)
class _Listener:
    """Records a request and its response on their way."""

    receive_next: Receive
    send_on: Send
    digest: "hashlib._Hash"
    is_drained: bool = False
    status: int = 0
    headers: list[tuple[str, str]] = field(default_factory=list)
    body: bytearray = field(default_factory=bytearray)

    async def receive(self) -> Message:
        message = await self.receive_next()
        if message["type"] == "http.request":
            self.digest.update(message.get("body", b""))
            self.is_drained = self.is_drained or not message.get("more_body", False)
        return message

    async def read_to_end(self) -> str:
        """Read what is left of the request; gives its fingerprint."""
        while not self.is_drained:
            if (await self.receive())["type"] == "http.disconnect":
                break
        return self.digest.hexdigest()

    async def send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.status = message["status"]
            self.headers = [
                (name.decode("latin-1"), value.decode("latin-1")) for name, value in message["headers"]
            ]
        elif message["type"] == "http.response.body":
            self.body += message.get("body", b"")
        await self.send_on(message)

    @property
    def is_final(self) -> bool:
        return self.is_drained and self.status < 500 and self.status not in PASSING

    def keep(self) -> KeptResponse:
        return KeptResponse(self.digest.hexdigest(), self.status, tuple(self.headers), bytes(self.body))


def _find_key(scope: Scope) -> str:
    """Give the key of the kept response; "" where the client sent none, or is nobody known.

    It is the asker's own: nobody is given the response of another, nor one that may no longer be had.
    """
    subject: Subject | None = scope.get(SUBJECT)
    if scope["type"] != "http" or scope["method"] != "POST" or subject is None:
        return ""
    if scope["path"].removeprefix(scope.get("root_path", "")).startswith(SECRET_PATHS):
        return ""
    stated = dict(scope["headers"]).get(b"idempotency-key", b"")[:LONGEST_KEY]
    who = "" if subject.id == MACHINE else f"{subject.id} {' '.join(sorted(subject.permissions))} "
    return hashlib.sha256(who.encode() + stated).hexdigest() if stated else ""


def _begin_fingerprint(scope: Scope) -> "hashlib._Hash":
    return hashlib.sha256(
        b"\n".join((scope["method"].encode(), scope["raw_path"], scope["query_string"], b""))
    )
