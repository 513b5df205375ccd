"""Stamped rows before they are cut into segments: their order and their stamps are repaired.

:func:`repair_row_times` stands first; the steps follow in the order in which it takes them.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import UnusableTime
from fusion.readers.samples import SampleColumns
from fusion.readers.timebase.clock import datetime_at_us, is_change_of_wall_clock
from fusion.readers.timebase.grid import COARSE_ROWS, steps_between
from fusion.readers.timebase.row_kernels import (
    LONGEST_DELAY_US,
    add_wraps,
    count_alike,
    count_backward,
    count_forward,
    find_alike,
    find_backward,
    find_edges,
    find_equal_runs,
    lift_wraps,
    reverse_rows,
)
from fusion.recording import LONGEST_BRIDGE_US, MICROSECONDS, QualityFlag, flag_counts


def repair_row_times(
    columns: SampleColumns, *, tick_us: int = 0, is_wall_clock: bool = False
) -> tuple[QualityFlag, ...]:
    """Bring rows into the order of time and mend their stamps, in place; give the caveats.

    A table whose stamps only advance is passed once and left as it is.

    Parameters
    ----------
    columns
        Rows with stamps in microseconds.
    tick_us
        Microseconds of one count, where the stamps are those of a counter that may start over; else 0.
    is_wall_clock
        The stamps are those of a clock that may follow daylight saving.

    Raises
    ------
    UnusableTime
        The clock stands still for most rows.
    """
    flags = reverse_table(columns)
    if is_wall_clock:
        flags += undo_daylight_saving(columns.stamps)
    flags += unwrap_counter(columns.stamps, tick_us)
    flags += mend_stopped(columns)
    if count_backward(columns.stamps) == 0 and not has_outlying_ends(columns.stamps):
        return flags
    flags += mend_stuck(columns) + leave_out_repeats(columns)
    if count_backward(columns.stamps):
        flags += order_pieces(columns)
    if count_backward(columns.stamps):
        flags += place_outliers(columns)
    return flags


# How the stamps advance, and the pieces between two long steps of the clock.


PACE_ROWS = 1024


@dataclass(frozen=True, slots=True)
class Pace:
    """How the stamps of a table usually advance: from row to row on average, and in one step of the clock."""

    period_us: float
    step_us: float

    @property
    def is_coarse(self) -> bool:
        """Whether many rows share a stamp."""
        return self.step_us >= COARSE_ROWS * self.period_us

    @property
    def longest_us(self) -> float:
        """A longer step forward than this separates two pieces."""
        return max(1.5 * self.step_us, LONGEST_BRIDGE_US)


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Rows between two long steps of the clock, in the order of the file; shape (n,) each."""

    first: NDArray[np.int64]
    stop: NDArray[np.int64]
    low_us: NDArray[np.int64]
    high_us: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.first)


def measure_pace(stamps: NDArray[np.int64]) -> Pace:
    """Measure how the stamps usually advance; zeros where they do not."""
    steps = steps_between(stamps, 1)
    paces = steps_between(stamps, min(PACE_ROWS, max(1, len(stamps) // 8)))
    usual = [float(np.median(found[found > 0])) if np.any(found > 0) else 0.0 for found in (paces, steps)]
    return Pace(*usual)


def find_pieces(stamps: NDArray[np.int64], pace: Pace) -> Pieces:
    """Cut the rows at long steps of the clock; rows at most a second late stay where they are."""
    limits = (pace.longest_us, LONGEST_DELAY_US)
    edges = np.empty(find_edges(stamps, *limits, np.empty(0, np.int64)), np.int64)
    find_edges(stamps, *limits, edges)
    first = np.concatenate([np.zeros(1, np.int64), edges])
    stop = np.append(edges, len(stamps))
    return Pieces(first, stop, np.minimum.reduceat(stamps, first), np.maximum.reduceat(stamps, first))


# A table that stands with its newest row first.


TURNED_SHARE = 0.9
"""So many of the steps run backwards in a table that was turned round."""


def reverse_table(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Put a table that stands with its newest row first into the order of time, in place (W-REVERSED)."""
    stamps = columns.stamps[: columns.rows]
    backward = count_backward(stamps)
    if backward == 0 or backward < TURNED_SHARE * (backward + count_forward(stamps)) or len(stamps) < 3:
        return ()
    for values in (columns.acc, columns.gyr, columns.stamps):
        reverse_rows(values.reshape(len(values), -1), columns.rows)
    return (QualityFlag(Caveat.REVERSED),)


# A wall clock that followed daylight saving.


HOUR_US = 3600 * MICROSECONDS
CHANGE_US = HOUR_US // 2
"""Clocks are changed at a full hour; here and there at half past."""
LONGEST_LOSS_US = 600 * MICROSECONDS
CHANGE_TOLERANCE_US = 2 * MICROSECONDS
FIRST_ROWS = 4097
PART_ROWS = 1 << 14


def undo_daylight_saving(stamps: NDArray[np.int64]) -> tuple[QualityFlag, ...]:
    """Take an hour's step out of wall-clock stamps where the clocks were changed, in place.

    Only a step of one hour, at a moment at which the clocks of some zone step so, is taken for that; rows may
    be lost around it for up to ten minutes. The stamps go on by the clock of the first row.
    """
    first_steps = np.diff(stamps[:FIRST_ROWS])
    advances = first_steps[first_steps > 0]  # many rows share a coarse stamp
    usual_us = float(np.median(advances)) if len(advances) else 0.0
    flags: tuple[QualityFlag, ...] = ()
    for place in _find_long_steps(stamps, HOUR_US // 2):
        step_us = int(stamps[place + 1] - stamps[place])
        hour_us = HOUR_US if step_us > 0 else -HOUR_US
        lost_us = step_us - hour_us - usual_us
        if not -max(1.5 * usual_us, 1.0) <= lost_us <= LONGEST_LOSS_US:
            continue
        next_us = int(stamps[place]) + round(usual_us)
        changed_us = -(-next_us // CHANGE_US) * CHANGE_US if lost_us > CHANGE_TOLERANCE_US else next_us
        reading = (
            datetime_at_us(changed_us) if changed_us <= next_us + lost_us + CHANGE_TOLERANCE_US else None
        )
        if reading is None or not is_change_of_wall_clock(reading, hour_us // MICROSECONDS):
            continue
        at_s = float(stamps[place + 1] - hour_us - stamps[0]) / MICROSECONDS
        stamps[place + 1 :] -= np.int64(hour_us)
        flags += (QualityFlag(Caveat.DST, 1, 0.0, at_s, at_s, {"step_s": hour_us // MICROSECONDS}),)
    return flags


def _find_long_steps(stamps: NDArray[np.int64], longer_than_us: int) -> list[int]:
    """Rows after which the clock steps far either way; in parts, so that no array as long is made."""
    return [
        first + int(place)
        for first in range(0, len(stamps), PART_ROWS)
        for place in np.flatnonzero(np.abs(np.diff(stamps[first : first + PART_ROWS + 1])) > longer_than_us)
    ]


# Counters that start over: micros() and millis() of 32 bits, and loggers' own of 24 or 16.


BITS = (32, 24, 16)
MARGIN_US = 60 * MICROSECONDS
"""A wrap is one only near both ends of the counter: a logger that started again is none."""
ON_TIME_US = MICROSECONDS
"""So soon after the last row the next one comes at a wrap, but for holes."""


def unwrap_counter(stamps: NDArray[np.int64], tick_us: int) -> tuple[QualityFlag, ...]:
    """Undo the wraps of a counter of ``tick_us`` a count, in place (W-WRAP); 0 where stamps are no counts."""
    if tick_us == 0 or count_backward(stamps) == 0:
        return ()
    wraps = _unwrap_even(stamps, tick_us) or lift_wraps(stamps, 2 ** BITS[0] * tick_us, MARGIN_US)
    return flag_counts({Caveat.WRAP: wraps})


def _unwrap_even(stamps: NDArray[np.int64], tick_us: int) -> int:
    """Undo wraps where every long step back, made up for by the counter's whole range, can be one.

    Most lead on without a hole, which a clock that was set does not; returns how many. A counter may have a
    sign: then it starts over at half its range below zero.
    """
    lowest, highest = int(stamps.min()), int(stamps.max())
    for bits in BITS:
        wrap_us = 2**bits * tick_us
        start_us = -wrap_us // 2 if lowest < 0 else 0
        if lowest < start_us or highest >= start_us + wrap_us:
            continue
        rows = find_backward(stamps, count_backward(stamps))
        rows = rows[stamps[rows - 1] - stamps[rows] > wrap_us // 2]
        led_us = stamps[rows] + wrap_us - stamps[rows - 1]
        if len(rows) and 2 * np.count_nonzero(led_us <= min(ON_TIME_US, wrap_us // 2)) > len(rows):
            add_wraps(stamps, rows, wrap_us)
            return len(rows)
    return 0


# Stamps that their neighbours contradict: a clock that stood still, fell to zero, or was away a while.


LEAST_STUCK_ROWS = 3
FIT_PERIODS, FIT_SHARE = 0.5, 0.02
"""How well rows must fill the time between their neighbours to be timed by them."""
FAR_US = 60 * MICROSECONDS
"""A single row at either end of a file, so far from the others, is an outlier."""
LOOKED_AT_ROWS = 8193
SHORTEST_STOP_US, SHORTEST_STOP_STEPS = 500_000, 3.0
"""So long, and so many steps of the clock, rows bear one stamp only where the clock stopped."""
LEAST_TIMED_PART = 0.5
FREE_STOPS, BETWEEN_STOPS_US = 3, 60 * MICROSECONDS
"""More than a few, and more than one a minute, are rows that came in bunches."""


@dataclass(frozen=True, slots=True, eq=False)
class TimestampOutliers:
    """Pieces whose stamps lie outside the time between their neighbours; shape (n,) each.

    ``before_us``, ``after_us``: the stamps of the rows around them; ``span_us``: from their first to last.
    """

    first: NDArray[np.int64]
    stop: NDArray[np.int64]
    before_us: NDArray[np.int64]
    after_us: NDArray[np.int64]
    span_us: NDArray[np.int64]


def has_outlying_ends(stamps: NDArray[np.int64]) -> bool:
    """Whether the first stamps, or the last one, lie over a minute before or after the others."""
    if len(stamps) < LEAST_STUCK_ROWS:
        return False
    differs = stamps[:LOOKED_AT_ROWS] != stamps[0]
    second = int(np.argmax(differs)) if differs.any() else 1
    return bool(stamps[second] - stamps[0] > FAR_US or stamps[-1] - stamps[-2] > FAR_US)


def mend_stopped(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Time rows of one and the same stamp by their neighbours (W-CLOCK-FWD), or leave them out.

    Left out are those that do not fill the time between their neighbours, and those at either end of the
    file, as :func:`mend_stuck` does where the stamp is a strange one, too.

    Raises
    ------
    UnusableTime
        Most rows would be left out.
    """
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    if pace.period_us <= 0.0 or pace.step_us <= 0.0:
        return ()
    longest_us = max(SHORTEST_STOP_US, SHORTEST_STOP_STEPS * pace.step_us)
    runs = find_equal_runs(stamps, int(longest_us / pace.period_us) + 1)
    if not 0 < len(runs) <= FREE_STOPS + columns.rows * pace.period_us / BETWEEN_STOPS_US:
        return ()
    kept = np.ones(columns.rows, np.bool_)
    timed = 0
    for first, stop in runs.tolist():
        if _fills_time(stamps, first, stop, pace):
            _time_between(stamps, first, stop, pace)
            timed += stop - first
        else:
            kept[first:stop] = False
    if np.count_nonzero(kept) < LEAST_TIMED_PART * columns.rows:
        raise UnusableTime(why="constant")
    return _leave_out(columns, kept) + _flag_timed(timed)


def _fills_time(stamps: NDArray[np.int64], first_row: int, stop_row: int, pace: Pace) -> bool:
    """Whether there are rows on both sides, and the time between them is that of the rows."""
    if first_row == 0 or stop_row == len(stamps):
        return False
    return bool(_fill_time(stop_row - first_row, stamps[stop_row] - stamps[first_row - 1], pace))


def mend_stuck(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Time rows whose stamp stood still by their neighbours (W-CLOCK-FWD), or leave them out.

    Left out are those that do not fill the time between their neighbours, and those at either end of the
    file (W-ROWS-DROPPED): nobody can say when they were measured.
    """
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    pieces = find_pieces(stamps, pace)
    found = _find_outliers(stamps, pieces, pace)
    rows = found.stop - found.first
    is_stuck = _are_stuck(rows, found.span_us, pace)
    if pace.is_coarse:  # there one stamp lasts for many rows anyway: it must be far away, too
        is_stuck |= (found.span_us == 0) & (np.abs(stamps[found.first] - found.before_us) > FAR_US)
    fits = (is_stuck | (rows < LEAST_STUCK_ROWS)) & _fill_time(rows, found.after_us - found.before_us, pace)
    for k in np.flatnonzero(fits):
        _time_between(stamps, int(found.first[k]), int(found.stop[k]), pace)
    kept = np.ones(columns.rows, np.bool_)
    for k in np.flatnonzero(is_stuck & ~fits):
        kept[found.first[k] : found.stop[k]] = False
    _leave_out_ends(pieces, pace, kept)
    return _leave_out(columns, kept) + _flag_timed(int(rows[fits].sum()))


def place_outliers(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Put rows whose clock left for a while and came back after the rows before them (W-CLOCK-FWD)."""
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    found = _find_outliers(stamps, find_pieces(stamps, pace), pace)
    slack_us = found.after_us - found.before_us - found.span_us
    chosen = np.flatnonzero(slack_us >= pace.period_us)
    for k in chosen:
        first, stop = int(found.first[k]), int(found.stop[k])
        behind_us = min(pace.period_us, 0.5 * float(slack_us[k]))
        stamps[first:stop] += round(found.before_us[k] + behind_us) - stamps[first:stop].min()
    return _flag_timed(int((found.stop - found.first)[chosen].sum()))


def _find_outliers(stamps: NDArray[np.int64], pieces: Pieces, pace: Pace) -> TimestampOutliers:
    first, stop = pieces.first[1:-1], pieces.stop[1:-1]
    before_us, after_us = stamps[first - 1], stamps[stop % len(stamps)]
    low_us, high_us = pieces.low_us[1:-1], pieces.high_us[1:-1]
    is_outside = (high_us < before_us) | (low_us > after_us)
    chosen = is_outside & (after_us > before_us - int(pace.is_coarse))
    return TimestampOutliers(
        first[chosen], stop[chosen], before_us[chosen], after_us[chosen], (high_us - low_us)[chosen]
    )


def _are_stuck(rows: NDArray[np.int64], span_us: NDArray[np.int64], pace: Pace) -> NDArray[np.bool_]:
    expected_us = (rows - 1) * pace.period_us
    least_us = np.maximum(0.5 * expected_us, 1.5 * pace.step_us)
    is_stuck: NDArray[np.bool_] = (rows >= LEAST_STUCK_ROWS) & (expected_us - span_us > least_us)
    return is_stuck


def _fill_time(rows: int | NDArray[np.int64], around_us: NDArray[np.int64], pace: Pace) -> NDArray[np.bool_]:
    """Whether so many rows fill the time from the row before them to the one after."""
    filled_us = (rows + 1) * pace.period_us
    off_us = np.abs(around_us - filled_us)
    coarse_us = pace.step_us if pace.is_coarse else 0.0
    fits: NDArray[np.bool_] = (
        off_us <= np.maximum(FIT_PERIODS * pace.period_us, FIT_SHARE * filled_us) + coarse_us
    )
    return fits


def _time_between(stamps: NDArray[np.int64], first_row: int, stop_row: int, pace: Pace) -> None:
    """Time rows evenly between those around them; on a coarse clock each stamp gets its usual rows."""
    before_us, after_us = int(stamps[first_row - 1]), int(stamps[stop_row])
    if not pace.is_coarse:
        stamps[first_row:stop_row] = np.linspace(before_us, after_us, stop_row - first_row + 2)[1:-1]
        return
    usual = max(1, round(pace.step_us / pace.period_us))
    have = int(np.count_nonzero(stamps[max(0, first_row - usual) : first_row] == before_us))
    steps = (have + np.arange(stop_row - first_row)) // usual
    stamps[first_row:stop_row] = np.minimum(before_us + steps * round(pace.step_us), after_us)


def _leave_out_ends(pieces: Pieces, pace: Pace, kept: NDArray[np.bool_]) -> None:
    """Mark the first and the last piece where they are one row, or stuck, far from the others."""
    if len(pieces) < 2:
        return
    for here, beside in ((0, 1), (-1, -2)):
        rows = pieces.stop[here : here + 1 or None] - pieces.first[here : here + 1 or None]
        span_us = (pieces.high_us - pieces.low_us)[here : here + 1 or None]
        is_alone = rows[0] == 1 and not pace.is_coarse
        away_us = max(
            pieces.low_us[here] - pieces.high_us[beside], pieces.low_us[beside] - pieces.high_us[here]
        )
        if away_us > FAR_US and (is_alone or _are_stuck(rows, span_us, pace)[0]):
            kept[pieces.first[here] : pieces.stop[here]] = False


def _leave_out(columns: SampleColumns, kept: NDArray[np.bool_]) -> tuple[QualityFlag, ...]:
    dropped = int(np.count_nonzero(~kept))
    if dropped == 0:
        return ()
    columns.keep(kept)
    return (QualityFlag(Caveat.ROWS_DROPPED, dropped),)


def _flag_timed(rows: int) -> tuple[QualityFlag, ...]:
    return flag_counts({Caveat.CLOCK_FWD: rows})


# Rows that stand in a table twice: a copy that went on from too early, or a file put after itself.


LEAST_ROWS = 10
"""So many rows alike in all readings and in their stamps, and not all one, come about by copying only."""
MOST_STEPS = 64
"""Steps back that are looked into: each takes a look through the rows before it."""


def leave_out_repeats(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Take out, in place, rows that come again after a step back of the clock (W-DUP, in rows)."""
    stamps = columns.stamps[: columns.rows]
    count = count_backward(stamps)
    if not 0 < count <= MOST_STEPS:
        return ()
    kept = np.ones(columns.rows, np.bool_)
    for row in find_backward(stamps, count).tolist():
        first = find_alike(columns.acc, columns.gyr, stamps, row)
        rows = count_alike(columns.acc, columns.gyr, stamps, first, row) if first < row else 0
        if rows >= LEAST_ROWS and np.ptp(columns.acc[row : row + rows], axis=0).any():
            kept[row : row + rows] = False
    repeated = columns.rows - int(kept.sum())
    if repeated == 0:
        return ()
    columns.keep(kept)
    return (QualityFlag(Caveat.DUP, repeated),)


# Pieces of a table that were put together in the wrong order.
#
# A logger writes in the order of time; a program that sorts, or a person who pastes, may not keep it. Pieces
# are put in order only where the stamps leave no doubt: the pieces do not overlap, except for rows that stand
# in both, and at least one continues where another ends. Everything else is a clock that was set
# (W-CLOCK-BACK).


JOIN_US = MICROSECONDS
"""A piece that begins so soon after the end of another goes on from there."""


def order_pieces(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Put pieces that stand in the wrong order into that of their stamps (W-PIECES, in pieces that moved).

    Rows that two pieces share at a seam are counted once (W-DUP).
    """
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    pieces = find_pieces(stamps, pace)
    order = np.lexsort((pieces.high_us, pieces.low_us))
    moved = int(np.count_nonzero(order != np.arange(len(order))))
    if moved == 0:
        return ()
    begins = find_first_new_rows(columns, pieces, order, pace)
    if begins is None or not is_continued(pieces, order, begins, pace):
        return ()
    repeated = int((begins - pieces.first).sum())
    places = [(int(begins[k]), int(pieces.stop[k])) for k in order]
    gather_rows(columns, places)
    flags = (QualityFlag(Caveat.PIECES, moved),)
    return (*flags, QualityFlag(Caveat.DUP, repeated)) if repeated else flags


def find_first_new_rows(
    columns: SampleColumns, pieces: Pieces, order: NDArray[np.int64], pace: Pace
) -> NDArray[np.int64] | None:
    """The first row of each piece that no earlier piece has; None where two pieces contradict each other."""
    begins = pieces.first.copy()
    stamps = columns.stamps[: columns.rows]
    for before, after in pairwise(order.tolist()):
        high_us = int(pieces.high_us[before])
        if pieces.low_us[after] > high_us - int(pace.is_coarse):
            continue
        first, stop = int(pieces.first[after]), int(pieces.stop[after])
        shared = int(np.count_nonzero(stamps[first:stop] <= high_us))
        twin = int(pieces.first[before]) + int(
            np.searchsorted(stamps[pieces.first[before] : pieces.stop[before]], stamps[first])
        )
        if shared == stop - first or not _is_copy(columns, twin, first, shared):
            return None
        begins[after] = first + shared
    return begins


def _is_copy(columns: SampleColumns, twin_row: int, first_row: int, shared_rows: int) -> bool:
    stamps = columns.stamps[: columns.rows]
    return (
        count_alike(columns.acc, columns.gyr, stamps, min(twin_row, first_row), max(twin_row, first_row))
        >= shared_rows
    )


def is_continued(pieces: Pieces, order: NDArray[np.int64], begins: NDArray[np.int64], pace: Pace) -> bool:
    """Whether a piece continues another one that does not stand just before it in the file.

    Where the rows between the two in the file fit into the time between them, that proves nothing: they may
    be rows with outlying stamps.
    """
    before, after = order[:-1], order[1:]
    step_us = pieces.low_us[after] - pieces.high_us[before]
    between_us = (pieces.first[after] - pieces.stop[before]) * pace.period_us
    is_filled = (after > before) & (between_us <= step_us + pace.period_us)
    is_new = (after != before + 1) & ~is_filled
    return bool(np.any(is_new & ((step_us <= JOIN_US) | (begins[after] > pieces.first[after]))))


def gather_rows(columns: SampleColumns, places: list[tuple[int, int]]) -> None:
    """Keep some stretches of rows, in a new order; one column at a time, so that memory holds one twice."""
    columns.acc = np.concatenate([columns.acc[first:stop] for first, stop in places])
    columns.gyr = np.concatenate([columns.gyr[first:stop] for first, stop in places])
    columns.stamps = np.concatenate([columns.stamps[first:stop] for first, stop in places])
    columns.rows = len(columns.acc)
