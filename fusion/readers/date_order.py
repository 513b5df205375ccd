"""Whether `02/03/2026` is the second of March or the third of February."""

import re
from collections.abc import Sequence
from datetime import date
from typing import Literal

from fusion.errors import UnusableTime

DateOrder = Literal["ymd", "dmy", "mdy"]
FORMAT_WORDS = re.compile(r"date[ _]format[ :=]+([Mdy])", re.IGNORECASE)
ORDERS: tuple[DateOrder, ...] = ("dmy", "mdy", "ymd")
FIRST_OF: dict[str, DateOrder] = {"m": "mdy", "d": "dmy", "y": "ymd"}
START_DATE = re.compile(
    r"^\W*start(?:[ _]date)?[ :=]+(\d{1,4})[/.\-](\d{1,2})[/.\-](\d{1,4})", re.IGNORECASE | re.MULTILINE
)
NEAR_DAYS = 14
"""How far the rows may begin from the start that the header tells, in a file that was cut. The two readings
of a date lie four weeks apart or more."""
YEAR_DIGITS = 4
CENTURY = 2000
"""Of a year of two digits: no recorder of this kind is older."""


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
        Nothing tells day and month apart, or the year of two digits.
    """
    open_to = list_orders(parts)
    if len(open_to) == 1:
        return open_to[0], False
    if order in open_to:
        return order, False
    word = _read_format(head)
    begun = _read_start(head, word)
    near = [one for one in open_to if begun and _is_near(_read_date(parts[0], one), begun)]
    if len(near) == 1:
        return near[0], False
    if word not in open_to:
        raise UnusableTime(why="date-order")
    return word, begun is not None and not near


def list_orders(parts: Sequence[tuple[str, ...]]) -> list[DateOrder]:
    """The orders of day, month and year in which all of these are dates."""
    if len(parts[0][0]) == YEAR_DIGITS:
        return ["ymd"]
    orders: tuple[DateOrder, ...] = (
        ("dmy", "mdy") if len(parts[0][2]) == YEAR_DIGITS else ("dmy", "mdy", "ymd")
    )
    return [one for one in orders if all(_read_date(part, one) for part in parts)]


def settle_by_span(first: tuple[str, ...], last: tuple[str, ...]) -> DateOrder | None:
    """The one order in which a file's first date and its last lie near each other; None where several do.

    Over midnight 03/03 becomes 04/03 by one order and 03/04 by the other; the wrong one leaps by a month.
    """
    spans = {one: (_read_date(first, one), _read_date(last, one)) for one in list_orders([first, last])}
    near = [one for one, (begun, ended) in spans.items() if begun and _is_near(ended, begun)]
    return near[0] if len(near) == 1 else None


def _read_format(head: str) -> DateOrder | None:
    found = FORMAT_WORDS.search(head)
    return FIRST_OF[found.group(1).lower()] if found else None


def _read_start(head: str, word: DateOrder | None) -> date | None:
    """The start date of the header by the format that it names; by the other where that gives no date."""
    found = START_DATE.search(head)
    if found is None:
        return None
    orders = ["ymd"] if len(found.group(1)) == YEAR_DIGITS else [word or "", "dmy", "mdy"]
    dates = [_read_date(found.groups(), one) for one in dict.fromkeys(orders) if one]
    known = [one for one in dates if one is not None]
    return known[0] if known and (word or len(known) == 1) else None


def _read_date(parts: Sequence[str], order: str) -> date | None:
    numbers = dict(zip(order, map(int, parts), strict=True))
    try:
        return date(complete_year(numbers["y"]), numbers["m"], numbers["d"])
    except ValueError:
        return None


def complete_year(year: int) -> int:
    """The year with its century."""
    return year + CENTURY if year < 100 else year


def _is_near(day: date | None, begun: date) -> bool:
    return day is not None and abs((day - begun).days) <= NEAR_DAYS
