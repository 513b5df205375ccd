"""Middleware that refuses text which no database, log or response can hold: a lone surrogate, a NUL."""

import json
import re
from collections.abc import Callable, Iterator
from typing import Any

from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.api.middleware.guard import SAFE_METHODS, takes_file
from app.errors import AppError, BadParameter

_UNFIT = re.compile(r"[\0\ud800-\udfff]")
_MAY_BE_UNFIT = re.compile(rb"\\u(?:0000|[dD][89a-fA-F])|\xed[\xa0-\xbf]|\0")
"""How such text is written in JSON: as an escape, or as bytes that are not UTF-8 (Python reads them)."""
_NUL_IN_ADDRESS = re.compile(rb"%00|\0")

Respond = Callable[[Request, AppError], Response]


class PlainText:
    """Checks every address and every body of JSON."""

    def __init__(self, app: ASGIApp, respond: Respond) -> None:
        self._app, self._respond = app, respond

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse unfit text; hand everything else on as it came."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        try:
            check_address_text(scope)
            messages = await _read_json(scope, receive)
            check_json(b"".join(message.get("body", b"") for message in messages))
        except AppError as refusal:
            await self._respond(Request(scope), refusal)(scope, receive, send)
            return
        await self._app(scope, _replay(messages, receive), send)


def check_address_text(scope: Scope) -> None:
    """Refuse a NUL in path or query; bytes that are not UTF-8 are replaced where they are read.

    Raises
    ------
    BadParameter
    """
    if _NUL_IN_ADDRESS.search(scope.get("raw_path") or b"") or _NUL_IN_ADDRESS.search(scope["query_string"]):
        raise BadParameter(name="URL", value="%00", allowed="UTF-8")


def check_json(body: bytes) -> None:
    """Refuse JSON with a lone surrogate or a NUL in any of its texts; what is no JSON is for the route.

    Raises
    ------
    BadParameter
    """
    if not _MAY_BE_UNFIT.search(body):
        return
    try:
        values = json.loads(body)
    except (ValueError, RecursionError):
        return
    for text in _walk_texts(values):
        if unfit := _UNFIT.search(text):
            raise BadParameter(name="body", value=repr(unfit.group())[1:-1], allowed="UTF-8")


def _walk_texts(values: Any) -> Iterator[str]:
    """Give every name and every text, however deep."""
    waiting = [values]
    while waiting:
        value = waiting.pop()
        if isinstance(value, str):
            yield value
        elif isinstance(value, dict):
            waiting += [*value, *value.values()]
        elif isinstance(value, list):
            waiting += value


async def _read_json(scope: Scope, receive: Receive) -> list[Message]:
    """Give the messages of a body that may be JSON, which the guard keeps short; none of any other."""
    kind = dict(scope["headers"]).get(b"content-type", b"").lower()
    is_file = takes_file(scope) and b"json" not in kind
    if scope["method"] in SAFE_METHODS or is_file or kind.startswith(b"multipart/"):
        return []
    messages = [await receive()]
    while messages[-1].get("more_body", False):
        messages.append(await receive())
    return messages


def _replay(messages: list[Message], receive: Receive) -> Receive:
    waiting = iter(messages)

    async def receive_again() -> Message:
        return next(waiting, None) or await receive()

    return receive_again
