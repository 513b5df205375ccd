"""Find the shifts of a recording of several days: by clock hours, by the days of a diary, or proposed."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, time, timedelta
from typing import TypeGuard

from fusion.clocks import ShiftWindow, read_clock
from fusion.diary import DiaryEntry, parse_clock
from fusion.errors import UnusableDiary
from fusion.exposure.periods import place_moment
from fusion.recording import MICROSECONDS, Span, join_overlapping

HOURS_HINT = "07:00-15:30"
DAY = timedelta(days=1)
LEAST_WORN_S = 3600.0
"""A shorter stretch of wear is not proposed as a shift."""
LONGEST_BREAK_S = 7200.0
"""A longer stretch off the arm ends a proposed shift."""
_DASH = re.compile(r"\s*[-–]\s*")


@dataclass(frozen=True, slots=True)
class Hours:
    """The hours of a shift on each calendar day; if they end at or before their start, on the next day."""

    start: time
    end: time


def parse_hours(text: str) -> Hours:
    """Parse ``07:00-15:30`` in any form of :func:`fusion.diary.parse_clock`. Raises ValueError."""
    try:
        start, end = (time.fromisoformat(parse_clock(part)) for part in _DASH.split(text.strip()))
    except UnusableDiary:
        raise ValueError(HOURS_HINT) from None
    return Hours(start, end)


def find_by_hours(start: datetime, duration_us: int, hours: Hours) -> tuple[ShiftWindow, ...]:
    """Return one shift for each calendar day on which the recording has time in these hours."""
    last = read_clock(start, duration_us)
    first_day = datetime.combine(start.date() - DAY, time(), start.tzinfo)
    windows = []
    for number in range((last.date() - first_day.date()).days + 1):
        day = (first_day + number * DAY).date()
        end_day = day if hours.end > hours.start else day + DAY
        windows.append(
            ShiftWindow(
                datetime.combine(day, hours.start, start.tzinfo),
                datetime.combine(end_day, hours.end, start.tzinfo),
            )
        )
    return tuple(window for window in windows if _is_inside(window, start, duration_us))


def find_by_diary(
    entries: Sequence[DiaryEntry], start: datetime, duration_us: int
) -> tuple[ShiftWindow, ...]:
    """Return the shifts of a diary whose rows have dates.

    Each row of the kind "shift" is a shift. Without one, the rows of each date are one shift, from the first
    start to the last end. A last row without an end lasts until midnight.
    """
    dated = sorted((entry for entry in entries if _is_dated(entry.start)), key=lambda entry: str(entry.start))
    stated = [entry for entry in dated if entry.kind == "shift" and entry.end is not None]
    days: dict[str, list[tuple[datetime, datetime]]] = {}
    for rank, entry in enumerate(stated or dated):
        begin = _read_moment(entry.start, start)
        end = begin.replace(hour=0, minute=0, second=0, microsecond=0) + DAY
        if entry.end is not None:
            end = _read_end(entry.end, begin, start)
        key = f"{begin:%Y-%m-%d} {rank if stated else ''}"
        days.setdefault(key, []).append((begin, end))
    windows = [ShiftWindow(min(a for a, _ in spans), max(b for _, b in spans)) for spans in days.values()]
    return tuple(window for window in windows if _is_inside(window, start, duration_us))


def propose(nonwear: Iterable[Span], start: datetime, duration_us: int) -> tuple[ShiftWindow, ...]:
    """Propose shifts: the stretches of wear of an hour or more between stretches off the arm.

    ``nonwear``: stretches in which the sensor did not move, or has no samples. A person confirms every
    proposal.
    """
    off = join_overlapping((span.start_us, span.end_us) for span in nonwear)
    off = [span for span in off if span[1] - span[0] >= LONGEST_BREAK_S * MICROSECONDS]
    edges = [0, *(edge for span in off for edge in span), duration_us]
    worn = [pair for pair in zip(edges[::2], edges[1::2], strict=True) if pair[1] > pair[0]]
    return tuple(
        ShiftWindow(*(read_clock(start, edge_us) for edge_us in pair))
        for pair in worn
        if pair[1] - pair[0] >= LEAST_WORN_S * MICROSECONDS
    )


def _is_dated(moment: float | str | None) -> TypeGuard[str]:
    return isinstance(moment, str) and "T" in moment


def _read_moment(moment: float | str, start: datetime) -> datetime:
    read = datetime.fromisoformat(str(moment))
    return read if read.tzinfo or start.tzinfo is None else read.replace(tzinfo=start.tzinfo)


def _read_end(end: float | str, begin: datetime, start: datetime) -> datetime:
    """Return the end of a dated row; a clock time alone is the next such time after its start."""
    if _is_dated(end):
        return _read_moment(end, start)
    same = datetime.combine(begin.date(), time.fromisoformat(str(end)), begin.tzinfo)
    return same if same > begin else same + DAY


def _is_inside(window: ShiftWindow, start: datetime, duration_us: int) -> bool:
    """Return whether the recording has at least a second of the window."""
    first_us, stop_us = window.place(start)
    return min(stop_us, duration_us) - max(first_us, 0) >= MICROSECONDS


def cut_diary(
    entries: Sequence[DiaryEntry], start: datetime, duration_us: int, first_us: int, stop_us: int
) -> tuple[DiaryEntry, ...]:
    """Return the rows of a diary that concern a stretch of a recording.

    Seconds then count from the start of the stretch. A clock time without a date remains: within the shift it
    is unambiguous. A row in seconds or with a date that is outside belongs to another shift.
    """

    def is_outside(entry: DiaryEntry, following: DiaryEntry | None) -> bool:
        end = entry.end if entry.end is not None or following is None else following.start
        start_us, end_us = (
            place_moment(moment, entry.line, start, duration_us)
            if isinstance(moment, int | float) or _is_dated(moment)
            else None
            for moment in (entry.start, end)
        )
        return (start_us is not None and start_us >= stop_us) or (end_us is not None and end_us <= first_us)

    def move(moment: float | str) -> float | str:
        return moment if isinstance(moment, str) else moment - first_us / MICROSECONDS

    return tuple(
        replace(entry, start=move(entry.start), end=None if entry.end is None else move(entry.end))
        for entry, following in zip(entries, [*entries[1:], None], strict=False)
        if not is_outside(entry, following)
    )
