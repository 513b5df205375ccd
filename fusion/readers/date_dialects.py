"""Stamps written as people write them: `14/03/2026 08:00:00.01`, date and time apart, a zone behind.

Here they are recognised; :mod:`fusion.readers.stamp_writing` rewrites them to the ISO form of the other
tables before the rows are read.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from fusion.errors import UnusableTime
from fusion.readers.date_order import DateOrder, list_orders, order_dates

FIELD_END = r"(?=[\" ]*(?:[,;\t|\r\n]|$))"
ZONE = (
    r"(?P<zone>Z(?![A-Za-z])|[+\-]\d{2}:?\d{2}(?!\d)|[+\-]\d{2}" + FIELD_END
    + r"| [+\-]\d{2}:?\d{2}" + FIELD_END + r"| ?[A-Za-z]{1,5}" + FIELD_END + r")?(?:\[[\w/+\-]+\])?"
)  # fmt: skip
HALF = r"(?P<half> ?[AaPp]\.?[Mm]\.?(?![A-Za-z]))?"
DATED = (
    r"(?<![\d:/.\-])(?P<first>\d{1,4})(?P<mark>[/.\-])(?P<second>\d{1,2})(?P=mark)(?P<third>\d{1,4})"
    r"(?P<between>T| +| *\"?[,;\t|]\"? *)(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<seconds>\d{2}(?:[%s]\d+)?)"
    + HALF + ZONE + r"(?![\d:])"
)  # fmt: skip
COMPACT = (
    r"(?<![\w.])(?P<first>\d{4})(?P<second>\d{2})(?P<third>\d{2})(?P<between>T)"
    r"(?P<hour>\d{2})(?P<minute>\d{2})(?P<seconds>\d{2}(?:[%s]\d+)?)(?P<half>(?!))?" + ZONE + r"(?![\d:])"
)
UNDATED = (
    r"^(?P<before>(?:[^:\n]*[,;\t|])?[\" ]*)(?P<hour>\d{1,2}):(?P<minute>\d{2})"
    r":(?P<seconds>\d{2}(?:[%s]\d+)?)" + HALF + ZONE + r"(?=[\" ]*[,;\t| ])"
)  # fmt: skip
NO_SECONDS = re.compile(
    r"(?<![\d:/.\-])\d{1,4}([/.\-])\d{1,2}\1\d{1,4}(?:T| +| *\"?[,;\t|]\"? *)"
    r"\d{1,2}:\d{2}(?: ?[AaPp][Mm])?(?![\d:])"
)
MINUTES_ONLY = re.compile(r"(?<![\d:])\d{1,2}:\d{2}[.,]\d(?![\d:])")
"""What Excel shows of a time of day with a fraction: `58:00.1`, the hour left out."""
PLAIN = re.compile(r"\d{4}-\d{1,2}-\d{1,2}[T ]\d{1,2}:\d{2}:\d{2}(?:[.,]\d++)?+(Z?)(?![\w:+\- \[])")
STAMP_LIKE = re.compile(r"\d:\d\d|\dT\d|\d{1,4}([/.\-])\d{1,2}\1\d{1,4}")
NAMED_ZONES_H = {
    **dict.fromkeys(("Z", "UT", "UTC", "GMT"), 0),
    **dict.fromkeys(("PST",), -8),
    **dict.fromkeys(("MST", "PDT"), -7),
    **dict.fromkeys(("CST", "MDT"), -6),
    **dict.fromkeys(("EST", "CDT", "HNE"), -5),
    **dict.fromkeys(("EDT", "HAE"), -4),
    **dict.fromkeys(("CET",), 1),
    **dict.fromkeys(("CEST",), 2),
}
"""Hours east of UTC: RFC 5322 §4.3, the French names of Eastern time, Central European time."""
LARGEST_OFFSET_S = 14 * 3600
SNIFFED_LINES = 400
FIELDS_OF_A_ROW = 5


@dataclass(frozen=True, slots=True)
class DateDialect:
    """How stamps are written: a pattern over lines, and the order of day, month and year.

    ``offset_s``: seconds east of UTC, where the first row tells them; ``has_date``: false where the stamps
    are a time of day only; ``is_iso``: they are as the kernels read them, nothing is to be rewritten;
    ``is_doubtful``: day and month may be the other way round.
    """

    pattern: re.Pattern[str]
    order: DateOrder
    offset_s: int | None = None
    has_date: bool = True
    is_iso: bool = False
    is_doubtful: bool = False


def find_dates(head: str, order: DateOrder | None = None) -> DateDialect | None:
    """Tell how the rows of a table's head write date and time; None where they are ISO without an offset.

    ``order`` is what a person said of day, month and year.

    Raises
    ------
    UnusableTime
        Day and month cannot be told apart, a spreadsheet has cut the seconds off, a zone's name does not tell
        its offset, or the stamps have a form that is not known.
    """
    lines = {k: line for k, line in enumerate(head.split("\n")[:SNIFFED_LINES], 1) if _is_wide(line)}
    if not any(STAMP_LIKE.search(line) for line in lines.values()):
        return None
    mark = ".," if any(";" in line or "\t" in line for line in lines.values()) else "."
    for form in (DATED, COMPACT):
        pattern = re.compile(form % mark)
        found = {k: match for k, line in lines.items() if (match := pattern.search(line))}
        if found:
            return _describe(pattern, found, (lines, head), order)
    _refuse_cut_times(list(lines.values()))
    pattern = re.compile(UNDATED % mark, re.MULTILINE)
    found = {k: match for k, line in lines.items() if (match := pattern.search(line))}
    if 2 * len(found) > len(lines):
        return DateDialect(pattern, "ymd", _find_offset_s(found), has_date=False)
    _refuse_strange_stamps(lines)
    return None


@lru_cache(maxsize=2)
def find_open_date(head: str) -> tuple[str, ...]:
    """Day, month and year of the first row as they stand there, where their order is open; else nothing."""
    found = _find_parts(head.split("\n")[:SNIFFED_LINES])
    return found[0] if found and len(list_orders(found)) > 1 else ()


def find_last_date(tail: str) -> tuple[str, ...]:
    """The same of the last whole row of a table's tail; nothing where none is found."""
    found = _find_parts(tail.split("\n")[1:-1])
    return found[-1] if found else ()


def _find_parts(lines: Sequence[str]) -> list[tuple[str, ...]]:
    pattern = re.compile(DATED % ".,")
    found = (pattern.search(line) for line in lines if _is_wide(line))
    return [match.group("first", "second", "third") for match in found if match]


def _describe(
    pattern: re.Pattern[str],
    found: dict[int, re.Match[str]],
    text: tuple[dict[int, str], str],
    order: DateOrder | None,
) -> DateDialect | None:
    lines, head = text
    plain = [PLAIN.search(lines[k]) for k in found]
    if all(plain):
        is_utc = all(match is not None and match.group(1) for match in plain)
        return DateDialect(pattern, "ymd", 0, is_iso=True) if is_utc else None
    parts = [(match["first"], match["second"], match["third"]) for match in found.values()]
    order, is_doubtful = order_dates(parts, head, order)
    return DateDialect(pattern, order, _find_offset_s(found), is_doubtful=is_doubtful)


def _find_offset_s(found: dict[int, re.Match[str]]) -> int | None:
    """The offset of the first row that tells one."""
    for line, match in found.items():
        if match["zone"]:
            offset_s = parse_zone_s(match["zone"])
            if offset_s is None:
                raise UnusableTime(why="zone name", line=line)
            return offset_s
    return None


def parse_zone_s(text: str) -> int | None:
    """Seconds east of UTC of `-04:00`, `+0530`, `Z`, `EDT`; None for a name of more than one meaning."""
    zone = text.strip().upper()
    if zone in NAMED_ZONES_H:
        return 3600 * NAMED_ZONES_H[zone]
    if zone[0] not in "+-":
        return None
    digits = zone[1:].replace(":", "").ljust(4, "0")
    offset_s = 3600 * int(digits[:2]) + 60 * int(digits[2:])
    return None if offset_s > LARGEST_OFFSET_S else -offset_s if zone[0] == "-" else offset_s


def _is_wide(line: str) -> bool:
    return max(line.count(mark) for mark in ",;\t|") >= FIELDS_OF_A_ROW


def _refuse_cut_times(lines: Sequence[str]) -> None:
    cut = sum(bool(NO_SECONDS.search(line) or MINUTES_ONLY.search(line)) for line in lines)
    if 2 * cut > len(lines):
        raise UnusableTime(why="seconds")


def _refuse_strange_stamps(lines: dict[int, str]) -> None:
    """Refuse rows that hold a clock's time or a date which nothing here understands."""
    strange = [k for k, line in lines.items() if re.search(r"\d:\d\d(?!\d)", line)]
    if 2 * len(strange) > len(lines):
        raise UnusableTime(why="form", line=strange[0])
