"""Find the shifts of a recording of several days: by clock hours, by the days of a diary, or proposed."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, time, timedelta
from itertools import pairwise
from typing import NamedTuple, TypeGuard

from acromion.fusion.clocks import ShiftWindow, find_instants, measure_us, read_clock
from acromion.fusion.diary import LONGEST_NIGHT_H, DiaryEntry, Kind, parse_clock, refuse_slips
from acromion.fusion.errors import UnusableDiary
from acromion.fusion.exposure.periods import OVERLAP_US, pair_with_next, place_moment
from acromion.fusion.recording import MICROSECONDS, Span, join_overlapping

HOURS_HINT = "07:00-15:30"
DAY = timedelta(days=1)
LEAST_WORN_S = 3600.0
"""A shorter stretch of wear is not proposed as a shift."""
LONGEST_BREAK_S = 7200.0
"""A longer stretch off the arm ends a proposed shift. A pose held earlier before a shift is not its pose."""
LONGEST_SHIFT_US = LONGEST_NIGHT_H * 3600 * MICROSECONDS
ON_SHIFT: tuple[Kind, ...] = ("shift", "work", "task", "seated", "upright", "supported")
"""The kinds of rows that show when a shift began and ended: a break, a pose or a mark does not."""
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


def find_by_hours(
    start: datetime, duration_us: int, hours: Hours, covered_us: Sequence[Sequence[int]] = ()
) -> tuple[ShiftWindow, ...]:
    """Return one shift for each calendar day on which the recording has samples in these hours.

    ``covered_us``: the stretches with samples (start, end); empty for the whole recording. A window whose
    start or end the zone has twice or never that day has no offset from UTC, so that
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
        if has_samples(first_us, stop_us, covered_us or ((0, duration_us),)):
            windows.append(window)
    return tuple(windows)


def find_by_diary(
    entries: Sequence[DiaryEntry], start: datetime, duration_us: int
) -> tuple[ShiftWindow, ...]:
    """Return the shifts of a diary whose rows have dates.

    Each row of the kind "shift" is a shift. Without one, the rows of the kinds :data:`ON_SHIFT` are joined:
    rows of one date, and rows over midnight, until a shift would be longer than
    :data:`LONGEST_SHIFT_US`. A row without an end lasts until the next row.

    Raises UnusableDiary with every row that ends before it starts or never, that overlaps another shift, or
    whose time the clock of the recording has twice or never that day.
    """
    pairs = [
        pair for pair in pair_with_next(entries) if pair[0].kind in ON_SHIFT and _is_dated(pair[0].start)
    ]
    stated = [pair for pair in pairs if pair[0].kind == "shift"]
    rows: list[_Row] = []
    row_errors: list[UnusableDiary] = []
    for entry, following in stated or pairs:
        try:
            rows.append(_read_row(entry, following, start))
        except UnusableDiary as error:
            row_errors.append(error)
    refuse_slips(row_errors)
    rows.sort(key=lambda row: measure_us(start, row.begin))
    overlaps = [
        UnusableDiary(line=after.line, why="overlap", cure="overlap", other=before.line)
        for before, after in pairwise(rows if stated else ())
        if measure_us(after.begin, before.end) > OVERLAP_US
    ]
    refuse_slips(overlaps)
    windows = (ShiftWindow(shift.begin, shift.end) for shift in (rows if stated else _join_rows(rows)))
    return tuple(window for window in windows if has_samples(*window.place(start), ((0, duration_us),)))


class _Row(NamedTuple):
    """Start and end of a row of the diary, or of the first of several rows, and its line."""

    begin: datetime
    end: datetime
    line: int


def _read_row(entry: DiaryEntry, following: DiaryEntry | None, start: datetime) -> _Row:
    """Return start and end of a dated row. Raises UnusableDiary."""
    begin = _read_moment(str(entry.start), entry.line, start)
    if entry.end is not None:
        end = _read_end(entry.end, begin, entry.line, start)
    elif entry.kind == "shift" or following is None or not _is_dated(following.start):
        raise UnusableDiary(line=entry.line, why="no end", cure="end", value=str(entry.start))
    else:
        end = _read_moment(following.start, following.line, start)
    if measure_us(begin, end) <= 0:
        value = f"{entry.start} - {entry.end or end.isoformat()}"
        raise UnusableDiary(line=entry.line, why="end first", cure="order", value=value)
    if entry.end is None and measure_us(begin, end) > LONGEST_SHIFT_US:
        raise UnusableDiary(line=entry.line, why="no end", cure="end", value=str(entry.start))
    return _Row(begin, end, entry.line)


def _join_rows(rows: Sequence[_Row]) -> list[_Row]:
    """Join the rows of each shift, in the order of their starts."""
    shifts: list[_Row] = []
    for row in rows:
        if not shifts:
            shifts.append(row)
            continue
        first, last, line = shifts[-1]
        is_near = measure_us(last, row.begin) <= LONGEST_BREAK_S * MICROSECONDS
        is_same_day = row.begin.date() == first.date()
        is_short = measure_us(first, row.end) <= LONGEST_SHIFT_US
        if (is_near and is_same_day) or ((is_near or is_same_day) and is_short):
            shifts[-1] = _Row(first, last if measure_us(row.end, last) > 0 else row.end, line)
        else:
            shifts.append(row)
    return shifts


def widen_to_pose(first_us: int, stop_us: int, earliest_us: int, begins_us: Sequence[int]) -> int:
    """Return where a shift begins: at the pose that a person stated, if it was held shortly before the shift.

    ``begins_us``: when a pose began. ``earliest_us``: end of the shift before. A pose in the shift leaves its
    start unchanged.
    """
    if any(first_us <= begin_us < stop_us for begin_us in begins_us):
        return first_us
    earliest_us = max(earliest_us, first_us - round(LONGEST_BREAK_S * MICROSECONDS))
    return min((begin_us for begin_us in begins_us if earliest_us <= begin_us < first_us), default=first_us)


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


def has_samples(first_us: int, stop_us: int, covered_us: Iterable[Sequence[int]]) -> bool:
    """Return whether one of the stretches (start, end) has at least a second of a window."""
    return any(
        min(stop_us, end_us) - max(first_us, begin_us) >= MICROSECONDS for begin_us, end_us in covered_us
    )


def cut_diary(
    entries: Sequence[DiaryEntry], start: datetime, duration_us: int, first_us: int, stop_us: int
) -> tuple[DiaryEntry, ...]:
    """Return the rows of a diary that concern a stretch of a recording.

    Seconds become clock times, because they then count from the first sample of the stretch. A clock time
    without a date remains: it must be unambiguous within the shift. A row in seconds or with a date that is
    outside belongs to another shift. A row without an end lasts until the next row, for
    :data:`LONGEST_SHIFT_US` at most.
    """

    def place(moment: float | str | None, line: int) -> int | None:
        if moment is None or is_undated(moment):
            return None
        return place_moment(moment, line, start, duration_us)

    def is_inside(entry: DiaryEntry, following: DiaryEntry | None) -> bool:
        start_us, end_us = place(entry.start, entry.line), place(entry.end, entry.line)
        if start_us is not None and entry.end is not None and end_us is None:
            begin = read_clock(start, start_us)
            end_us = measure_us(start, _read_end(entry.end, begin, entry.line, start))
        if start_us is not None and entry.end is None:
            next_us = place(following.start, following.line) if following else None
            longest_us = start_us + LONGEST_SHIFT_US
            is_open = next_us is None or next_us > longest_us
            end_us = start_us + 1 if is_open or entry.kind == "mark" else next_us
        return (start_us is None or start_us < stop_us) and (end_us is None or end_us > first_us)

    def move(moment: float | str) -> str:
        if isinstance(moment, str):
            return moment
        return read_clock(start, round(moment * MICROSECONDS)).isoformat()

    marks = ((entry, None) for entry in entries if entry.kind == "mark")
    return tuple(
        replace(entry, start=move(entry.start), end=None if entry.end is None else move(entry.end))
        for entry, following in (*pair_with_next(entries), *marks)
        if is_inside(entry, following)
    )


def is_undated(moment: float | str) -> bool:
    """Return whether a time is a clock time without a date."""
    return isinstance(moment, str) and "T" not in moment
