"""Long lists, page by page."""

import base64
import binascii
from collections.abc import Callable, Sequence
from typing import TypeVar
from urllib.parse import urlencode

from fastapi import Request, Response

from app.errors import BadParameter
from app.jobs.recordings import Place

T = TypeVar("T")


def write_cursor(place: Place) -> str:
    """Write where a page ended, as text that nobody need understand."""
    return base64.urlsafe_b64encode("|".join(place).encode()).decode().rstrip("=")


def read_cursor(text: str) -> Place | None:
    """Read what :func:`write_cursor` wrote; None for "".

    Raises
    ------
    BadParameter
    """
    if not text:
        return None
    try:
        told = base64.urlsafe_b64decode(text + "=" * (-len(text) % 4)).decode("utf-8")
        moment, identity = told.split("|")
    except (binascii.Error, ValueError):
        raise BadParameter(name="cursor", value=text[:60], allowed="next_cursor") from None
    return moment, identity


def cut_page(
    rows: Sequence[T], limit: int, place: Callable[[T], Place], asked: Request, answer: Response
) -> tuple[Sequence[T], str | None]:
    """Give the rows of the page and the cursor of the next, from one row more than asked for.

    The answer also gets ``Link: <...>; rel="next"`` (RFC 8288).
    """
    if len(rows) <= limit:
        return rows, None
    cursor = write_cursor(place(rows[limit - 1]))
    others = [(name, value) for name, value in asked.query_params.multi_items() if name != "cursor"]
    answer.headers["Link"] = f'<{asked.url.path}?{urlencode([*others, ("cursor", cursor)])}>; rel="next"'
    return rows[:limit], cursor
