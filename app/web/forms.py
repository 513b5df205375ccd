"""Forms of short text fields, as browsers send them (urlencoded); forms with a file take other roads."""

from collections.abc import Mapping
from typing import Annotated
from urllib.parse import parse_qsl

from fastapi import Depends, Request

from app.errors import BadParameter

MOST_BYTES = 4 << 20
MOST_FIELDS = 50_000

Form = Mapping[str, list[str]]


async def read_form(request: Request) -> Form:
    """Read ``application/x-www-form-urlencoded``; each name with its values in order. Raises BadParameter."""
    body = await read_body(request)
    try:
        pairs = parse_qsl(body.decode(), keep_blank_values=True, max_num_fields=MOST_FIELDS)
    except ValueError:
        raise BadParameter(name="form", value="", allowed=f"≤ {MOST_FIELDS}") from None
    form: dict[str, list[str]] = {}
    for name, value in pairs:
        form.setdefault(name, []).append(value)
    return form


UsedForm = Annotated[Form, Depends(read_form)]


async def read_body(request: Request) -> bytes:
    """Read a body of at most 4 MiB. Raises BadParameter."""
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > MOST_BYTES:
            raise BadParameter(name="form", value="", allowed=f"≤ {MOST_BYTES}")
    return bytes(body)


def first(form: Form, name: str) -> str:
    """Return the first value of a name, "" where there is none."""
    return form.get(name, [""])[0].strip()


def take_secret(form: Form, name: str) -> str:
    """Return the first value of a name as it was typed, with every space."""
    return form.get(name, [""])[0]
