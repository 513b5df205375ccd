"""Whether `02/03/2026` is the second of March or the third of February."""

import re
from collections.abc import Sequence
from datetime import date
from typing import Literal

from fusion.errors import UnusableTime

DateOrder = Literal["ymd", "dmy", "mdy"]
FORMAT_WORDS = re.compile(r"date[ _]format[ :=]+([Mdy])", re.IGNORECASE)
FIRST_OF = {"m": "mdy", "d": "dmy", "y": "ymd"}
START_DATE = re.compile(
    r"^\W*start(?:[ _]date)?[ :=]+(\d{1,4})[/.\-](\d{1,2})[/.\-](\d{1,4})", re.IGNORECASE | re.MULTILINE
)
NEAR_DAYS = 14
"""How far the rows may begin from the start that the header tells, in a file that was cut. The two readings
of a date lie four weeks apart or more."""
MONTHS = 12


def order_dates(
    parts: Sequence[tuple[str, ...]], head: str, order: DateOrder | None
) -> tuple[DateOrder, bool]:
    """Tell the order of day, month and year of the dates in rows, and whether the header contradicts it.

    Where the dates themselves leave it open, a person's word goes first, then the header's start date, to
    which one reading alone may come near, then its format: a program that saves a file again writes the
    dates in another form, and leaves the words of the header as they were.

    Raises
    ------
    UnusableTime
        Nothing tells day and month apart.
    """
    if all(len(part[0]) == 4 for part in parts):
        return "ymd", False
    for place, one in enumerate(("dmy", "mdy")):
        if max(int(part[place]) for part in parts) > MONTHS:
            return as_order(one), False
    if order in ("dmy", "mdy"):
        return order, False
    word = _read_format(head)
    begun = _read_start(head, word)
    near = [one for one in ("dmy", "mdy") if begun and _is_near(_read_date(parts[0], one), begun)]
    if len(near) == 1:
        return as_order(near[0]), False
    if word not in ("dmy", "mdy"):
        raise UnusableTime(why="date-order")
    return as_order(word), begun is not None and not near


def as_order(word: str) -> DateOrder:
    """The word as a type."""
    return "dmy" if word == "dmy" else "mdy"


def _read_format(head: str) -> str:
    found = FORMAT_WORDS.search(head)
    return FIRST_OF[found.group(1).lower()] if found else ""


def _read_start(head: str, word: str) -> date | None:
    """The start date of the header by the format that it names; by the other where that gives no date."""
    found = START_DATE.search(head)
    if found is None:
        return None
    orders = ["ymd"] if len(found.group(1)) == 4 else [word, *({"dmy", "mdy"} - {word})]
    dates = [_read_date(found.groups(), one) for one in orders if one]
    known = [one for one in dates if one is not None]
    return known[0] if known and (word or len(known) == 1) else None


def _read_date(parts: Sequence[str], order: str) -> date | None:
    numbers = dict(zip(order, map(int, parts), strict=True))
    try:
        return date(numbers["y"], numbers["m"], numbers["d"])
    except ValueError:
        return None


def _is_near(day: date | None, begun: date) -> bool:
    return day is not None and abs((day - begun).days) <= NEAR_DAYS
