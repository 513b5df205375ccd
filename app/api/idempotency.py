"""``Idempotency-Key`` on every POST: asked twice, done once, answered alike.

Source: IETF draft httpapi-idempotency-key-header-07: the same key with another request is a 422, a key whose
request is still under way a 409. Answers that a repetition may change (409, 423, 429, 5xx) are not kept.
What was purged since is a 410: the repetition makes nothing anew.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field

from fastapi.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.errors import AppError, KeyInUse, KeyReused, PurgedSince
from app.jobs.idempotency import GONE, KeptResponse, ResponseStore

LONGEST_KEY = 255
PASSING = frozenset({408, 409, 423, 429})

AnswerRefusal = Callable[[Request, AppError], Response]


class Idempotency:
    """Stands before the routes and remembers what they answered."""

    def __init__(self, app: ASGIApp, responses: ResponseStore, answer: AnswerRefusal) -> None:
        self._app, self._responses, self._answer = app, responses, answer

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer anew, or as before."""
        key = _find_key(scope)
        if not key:
            await self._app(scope, receive, send)
            return
        listener = _Listener(receive, send, _begin_fingerprint(scope))
        known = await run_in_threadpool(self._responses.reserve, key)
        if known is None:
            await self._answer_first(key, scope, listener)
        else:
            response = await self._answer_again(known, scope, listener)
            await response(scope, receive, send)

    async def _answer_again(self, known: KeptResponse, scope: Scope, listener: "_Listener") -> Response:
        """Give the kept answer, once the whole request is seen to be the same; else the refusal."""
        if known.status is None:
            return self._answer(Request(scope), KeyInUse())
        if not await _is_same(known, listener):
            return self._answer(Request(scope), KeyReused())
        if known.status == GONE:
            return self._answer(Request(scope), PurgedSince())
        return Response(known.body, known.status, dict(known.headers))

    async def _answer_first(self, key: str, scope: Scope, listener: "_Listener") -> None:
        kept = False
        try:
            await self._app(scope, listener.receive, listener.send)
            if listener.is_final:
                await run_in_threadpool(self._responses.keep, key, listener.keep())
                kept = True
        finally:
            if not kept:
                await run_in_threadpool(self._responses.free, key)


@dataclass(slots=True)
class _Listener:
    """Hears what a request says and what is answered."""

    receive_next: Receive
    send_on: Send
    digest: "hashlib._Hash"
    heard_all: bool = False
    status: int = 0
    headers: list[tuple[str, str]] = field(default_factory=list)
    body: bytearray = field(default_factory=bytearray)

    async def receive(self) -> Message:
        message = await self.receive_next()
        if message["type"] == "http.request":
            self.digest.update(message.get("body", b""))
            self.heard_all = self.heard_all or not message.get("more_body", False)
        return message

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
        return self.heard_all and self.status < 500 and self.status not in PASSING

    def keep(self) -> KeptResponse:
        return KeptResponse(self.digest.hexdigest(), self.status, tuple(self.headers), bytes(self.body))


async def _is_same(known: KeptResponse, listener: _Listener) -> bool:
    while not listener.heard_all:
        if (await listener.receive())["type"] == "http.disconnect":
            break
    return listener.digest.hexdigest() == known.fingerprint


def _find_key(scope: Scope) -> str:
    """Give the key under which the answer is kept; "" where none was asked for."""
    if scope["type"] != "http" or scope["method"] != "POST":
        return ""
    told = dict(scope["headers"]).get(b"idempotency-key", b"")[:LONGEST_KEY]
    return hashlib.sha256(told).hexdigest() if told else ""


def _begin_fingerprint(scope: Scope) -> "hashlib._Hash":
    return hashlib.sha256(
        b"\n".join((scope["method"].encode(), scope["raw_path"], scope["query_string"], b""))
    )
