"""What of a request may stand in an answer: never a password, a token, a code or another secret."""

import re
from collections.abc import Mapping
from typing import Any
from urllib.parse import parse_qsl, unquote, urlencode

from starlette.requests import Request

from app.access.accounts import TOKEN_PREFIX

LONGEST = 60
HIDDEN = "…"
_SECRET = re.compile(r"passw|pwd|secret|token|(code|key|proof|ticket)s?(?![a-z])")
_TOKEN = re.compile(rf"{TOKEN_PREFIX}[\w-]{{43}}")


def holds_token(text: str) -> bool:
    """Return whether a token stands in a part of an address, however it is quoted."""
    return _TOKEN.search(unquote(text)) is not None


def is_secret(name: object) -> bool:
    """Return whether a field of this name may hold what opens something."""
    return isinstance(name, str) and _SECRET.search(name.lower()) is not None


def show_input(error: Mapping[str, Any]) -> str:
    """Return what a refused field held, as an answer may repeat it; ``error`` is pydantic's.

    A whole body, and what has fields of its own, may hold a secret beside what is wrong: it is not repeated.
    """
    place, given = error["loc"], error.get("input")
    is_whole = error["type"] == "missing" or place in ((), ("body",))
    if is_whole or any(map(is_secret, place)) or isinstance(given, dict | list | tuple | bytes):
        return HIDDEN
    return hide_tokens(str(given))[:LONGEST]


def hide_tokens(text: str) -> str:
    """Return a text without the tokens in it."""
    return _TOKEN.sub(HIDDEN, text)


def drop_secrets(query: str) -> str:
    """Return a query without the fields that may hold a secret."""
    pairs = parse_qsl(query, keep_blank_values=True)
    kept = [pair for pair in pairs if not is_secret(pair[0]) and not any(map(holds_token, pair))]
    return query if len(kept) == len(pairs) else urlencode(kept)


def hide_address(request: Request) -> Request:
    """Return a request whose address holds no token; the same one where it holds none."""
    scope = request.scope
    path, query = str(scope["path"]), scope["query_string"].decode("latin-1")
    if not holds_token(f"{path}?{query}"):
        return request
    hidden = hide_tokens(unquote(path))
    return Request({**scope, "path": hidden, "query_string": drop_secrets(query).encode("latin-1")})
