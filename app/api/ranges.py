"""Parts of a file (RFC 9110, 14): what cannot be understood is as if it had not been asked for."""

import re

from fastapi import Request

from app.errors import NoSuchRange

_RANGE = re.compile(r"(\d*)-(\d*)", re.ASCII)


def check_range(request: Request, size_bytes: int) -> None:
    """Leave a ``Range`` header only where its parts can be given.

    Raises
    ------
    NoSuchRange
        When a part begins behind the end.
    """
    asked = request.headers.get("range")
    if asked is None or "if-range" in request.headers:
        return
    parts = _read_parts(asked, size_bytes)
    if not parts:
        headers = request.scope["headers"]
        request.scope["headers"] = [(name, value) for name, value in headers if name != b"range"]
    if any(first_byte >= size_bytes for first_byte in parts):
        raise NoSuchRange(size=size_bytes)


def _read_parts(asked: str, size_bytes: int) -> list[int]:
    """Give the first byte of each part; none where a part is malformed, or the unit is another."""
    unit, _, told = asked.partition("=")
    matches = [_RANGE.fullmatch(part.strip()) for part in told.split(",")]
    if unit.strip().lower() != "bytes":
        return []
    parts = []
    for match in matches:
        if match is None or match[0] == "-" or (match[1] and match[2] and int(match[1]) > int(match[2])):
            return []
        last_ones = min(int(match[2] or 0), size_bytes)
        parts.append(int(match[1]) if match[1] else size_bytes - last_ones)
    return parts
