"""Stamps written as people write them: `14/03/2026 08:00:00.01`, date and time apart, a zone behind.

They are rewritten to the ISO form of the other tables before the rows are read, line by line.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from fusion.errors import UnusableTime

DateOrder = Literal["ymd", "dmy", "mdy"]
DAY = r"(?<![\d:/.\-])(\d{1,4})([/.\-])(\d{1,2})\2(\d{1,4})"
BETWEEN = r"(T| +| *\"?[,;\t|]\"? *)"
CLOCK = r"(\d{1,2}):(\d{2}):(\d{2}(?:[%s]\d+)?)( ?[AaPp][Mm])?(?:Z|[+\-]\d{2}:?\d{2})?(?![\d:])"
NO_SECONDS = re.compile(DAY + BETWEEN + r"\d{1,2}:\d{2}(?: ?[AaPp][Mm])?(?![\d:])")
MINUTES_ONLY = re.compile(r"(?<![\d:])\d{1,2}:\d{2}[.,]\d(?![\d:])")
"""What Excel shows of a time of day with a fraction: `58:00.1`, the hour left out."""
PLAIN = re.compile(r"\d{4}-\d{1,2}-\d{1,2}[T ]\d{1,2}:\d{2}:\d{2}(?:[.,]\d++)?+Z?(?![\d:+\- ]|[AaPp][Mm])")
ZONE = re.compile(r"\d{1,2}:\d{2}:\d{2}(?:[.,]\d+)?(?:([+\-]\d{2}):?(\d{2}))")
FORMAT_WORDS = re.compile(r"date[ _]format[ :=]+([Mdy])", re.IGNORECASE)
SNIFFED_LINES = 400
FIELDS_OF_A_ROW = 5
NOON = 12


@dataclass(frozen=True, slots=True)
class DateDialect:
    """How stamps are written: a pattern over lines, and the order of day, month and year.

    ``offset_s``: seconds east of UTC, where the first row tells them.
    """

    pattern: re.Pattern[str]
    order: DateOrder
    offset_s: int | None = None

    def rewrite(self, text: str) -> str:
        """Write every stamp as `2026-03-14T08:00:00.010`; a time column of its own is left empty."""
        return self.pattern.sub(self._write, text)

    def _write(self, found: re.Match[str]) -> str:
        first, _, second, third, between, hour, minute, seconds, half = found.groups()
        year, month, day = _sort_date((first, second, third), self.order)
        kept = re.sub(r"[T \"]", "", between)
        return f"{year}-{month:0>2}-{day:0>2}T{_count_hour(hour, half):02d}:{minute}:{seconds}{kept}"


def _sort_date(parts: tuple[str, str, str], order: DateOrder) -> tuple[str, str, str]:
    first, second, third = parts
    return {"ymd": (first, second, third), "dmy": (third, second, first), "mdy": (third, first, second)}[
        order
    ]


def _count_hour(hour: str, half: str | None) -> int:
    if half is None:
        return int(hour)
    return int(hour) % NOON + (NOON if half.strip().lower() == "pm" else 0)


def find_dates(head: str, order: DateOrder | None = None) -> DateDialect | None:
    """Tell how the rows of a table's head write date and time; None where they need no rewriting.

    ``order`` is what a person said of day, month and year.

    Raises
    ------
    UnusableTime
        Day and month cannot be told apart, or a spreadsheet has cut the seconds off.
    """
    lines = [line for line in head.split("\n")[:SNIFFED_LINES] if _is_wide(line)]
    if not any(":" in line for line in lines):
        return None
    mark = ".," if any(";" in line or "\t" in line for line in lines) else "."
    pattern = re.compile(DAY + BETWEEN + CLOCK % mark)
    found = [match for line in lines if (match := pattern.search(line))]
    if not found:
        _refuse_cut_times(lines)
        return None
    if all(PLAIN.search(line) for line in lines if pattern.search(line)):
        return None
    parts = [match.groups() for match in found]
    return DateDialect(pattern, _find_order(parts, head, order), _find_offset_s(found[0].group()))


def _find_offset_s(stamp: str) -> int | None:
    zone = ZONE.search(stamp)
    if zone is None:
        return None
    hours, minutes = int(zone.group(1)), int(zone.group(2))
    return 3600 * hours + (-60 if zone.group(1).startswith("-") else 60) * minutes


def _is_wide(line: str) -> bool:
    return max(line.count(mark) for mark in ",;\t|") >= FIELDS_OF_A_ROW


def _refuse_cut_times(lines: Sequence[str]) -> None:
    cut = sum(bool(NO_SECONDS.search(line) or MINUTES_ONLY.search(line)) for line in lines)
    if 2 * cut > len(lines):
        raise UnusableTime(why="seconds")


def _find_order(parts: Sequence[tuple[str, ...]], head: str, order: DateOrder | None) -> DateOrder:
    if all(len(part[0]) == 4 for part in parts):
        return "ymd"
    if max(int(part[0]) for part in parts) > 12:
        return "dmy"
    if max(int(part[2]) for part in parts) > 12:
        return "mdy"
    word = FORMAT_WORDS.search(head)
    told = order or ({"M": "mdy", "d": "dmy"}.get(word.group(1)) if word else None)
    if told not in ("dmy", "mdy"):
        raise UnusableTime(why="date-order")
    return "dmy" if told == "dmy" else "mdy"


def rewrite_pieces(pieces: Iterable[bytes], dialect: DateDialect | None) -> Iterator[bytes]:
    """Rewrite the stamps of pieces of any length, whole lines at a time."""
    if dialect is None:
        yield from pieces
        return
    carried = b""
    for piece in pieces:
        cut = piece.rfind(b"\n") + 1
        if cut:
            yield dialect.rewrite((carried + piece[:cut]).decode("latin-1")).encode("latin-1")
            carried = b""
        carried += piece[cut:]
    yield dialect.rewrite(carried.decode("latin-1")).encode("latin-1")
