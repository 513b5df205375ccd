"""Find the shifts of a recording of several days: by clock hours, by the days of a diary, or proposed."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, time, timedelta
from functools import partial
from typing import TypeGuard

from acromion.fusion.clocks import ShiftWindow, find_instants, measure_us, read_clock
from acromion.fusion.diary import DiaryEntry, parse_clock, refuse_slips
from acromion.fusion.errors import UnusableDiary
from acromion.fusion.exposure.periods import place_moment
from acromion.fusion.recording import MICROSECONDS, Span, join_overlapping

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
    """Parse ``07:00-15:30`` in any form of :func:`acromion.fusion.diary.parse_clock`.

    Raises ValueError, also if both are the same.
    """
    try:
        start, end = (time.fromisoformat(parse_clock(part)) for part in _DASH.split(text.strip()))
    except UnusableDiary:
        raise ValueError(HOURS_HINT) from None
    if start == end:
        raise ValueError(HOURS_HINT)
    return Hours(start, end)


def find_by_hours(start: datetime, duration_us: int, hours: Hours) -> tuple[ShiftWindow, ...]:
    """Return one shift for each calendar day on which the recording has time in these hours.

    A window whose start or end the zone has twice or never that day has no offset from UTC, so that
    :meth:`acromion.fusion.clocks.ShiftWindow.place` refuses it.
    """
    first_day, last_day = start.date() - DAY, read_clock(start, duration_us).date()
    windows = []
    for number in range((last_day - first_day).days + 1):
        day = first_day + number * DAY
        end_day = day if hours.end > hours.start else day + DAY
        shown = datetime.combine(day, hours.start), datetime.combine(end_day, hours.end)
        instants = [find_instants(one, start.tzinfo) if start.tzinfo else (one,) for one in shown]
        is_unique = all(len(found) == 1 for found in instants)
        window = ShiftWindow(*(found[0] for found in instants) if is_unique else shown)
        first_us, stop_us = (
            choose(measure_us(start, one.replace(tzinfo=start.tzinfo, fold=fold)) for fold in (0, 1))
            for choose, one in zip((min, max), shown, strict=True)
        )
        if _is_inside(first_us, stop_us, duration_us):
            windows.append(window)
    return tuple(windows)


def find_by_diary(
    entries: Sequence[DiaryEntry], start: datetime, duration_us: int
) -> tuple[ShiftWindow, ...]:
    """Return the shifts of a diary whose rows have dates.

    Each row of the kind "shift" is a shift. Without one, the rows of each date are one shift, from the first
    start to the last end. A last row without an end lasts until midnight.

    Raises UnusableDiary with every row that ends before it starts, or whose time the clock of the recording
    has twice or never that day.
    """
    rows = (entry for entry in entries if entry.kind != "posture" and _is_dated(entry.start))
    dated = sorted(rows, key=lambda entry: str(entry.start))
    stated = [entry for entry in dated if entry.kind == "shift" and entry.end is not None]
    days: dict[str, list[tuple[datetime, datetime]]] = {}
    row_errors: list[UnusableDiary] = []
    for rank, entry in enumerate(stated or dated):
        try:
            begin = _read_moment(str(entry.start), entry.line, start)
            end = begin.replace(hour=0, minute=0, second=0, microsecond=0) + DAY
            if entry.end is not None:
                end = _read_end(entry.end, begin, entry.line, start)
            if measure_us(begin, end) <= 0:
                value = f"{entry.start} - {entry.end}"
                raise UnusableDiary(line=entry.line, why="end first", cure="order", value=value)
        except UnusableDiary as error:
            row_errors.append(error)
            continue
        key = f"{begin:%Y-%m-%d} {rank if stated else ''}"
        days.setdefault(key, []).append((begin, end))
    refuse_slips(row_errors)
    ranked = (
        [sorted(ends, key=partial(measure_us, start)) for ends in zip(*spans, strict=True)]
        for spans in days.values()
    )
    windows = [ShiftWindow(begins[0], ends[-1]) for begins, ends in ranked]
    return tuple(window for window in windows if _is_inside(*window.place(start), duration_us))


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


def _read_moment(moment: str, line: int, start: datetime) -> datetime:
    """Return a time with a date on the recording's clock. Raises UnusableDiary."""
    return read_clock(start, place_moment(moment, line, start, 0))


def _read_end(end: float | str, begin: datetime, line: int, start: datetime) -> datetime:
    """Return the end of a dated row; a clock time alone is the next such time after its start."""
    if _is_dated(end):
        return _read_moment(end, line, start)
    same = datetime.combine(begin.date(), time.fromisoformat(str(end)))
    later = same if same > begin.replace(tzinfo=None) else same + DAY
    return _read_moment(later.isoformat(), line, start)


def _is_inside(first_us: int, stop_us: int, duration_us: int) -> bool:
    """Return whether a recording has at least a second of a window."""
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

    rows, postures = ([e for e in entries if (e.kind == "posture") is chosen] for chosen in (False, True))
    return tuple(
        replace(entry, start=move(entry.start), end=None if entry.end is None else move(entry.end))
        for entry, following in zip((*rows, *postures), (*rows[1:], None, *postures), strict=False)
        if not is_outside(entry, following)
    )
