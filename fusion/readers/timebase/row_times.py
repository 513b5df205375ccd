"""What is done to stamped rows before they are cut into segments: order, wraps, strange stamps, repeats."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import UnusableTime
from fusion.numba_kernels import njit
from fusion.readers.samples import SampleColumns
from fusion.readers.timebase.repair import (
    Pace,
    Pieces,
    count_backward,
    find_pieces,
    leave_out_repeats,
    measure_pace,
    order_pieces,
    turn_round,
    undo_daylight_saving,
    unwrap_counter,
)
from fusion.recording import MICROSECONDS, QualityFlag

# Stamps that their neighbours contradict: a clock that stood still, fell to zero, or was away a while.


# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)


LEAST_STUCK_ROWS = 3
FIT_PERIODS, FIT_SHARE = 0.5, 0.02
"""How well rows must fill the time between their neighbours to be timed by them."""
FAR_US = 60 * MICROSECONDS
"""A row at either end of a file, alone and so far from the others: one stamp is no proof of a minute."""
LOOKED_AT_ROWS = 8193
SHORTEST_STOP_US, SHORTEST_STOP_STEPS = 500_000, 3.0
"""So long, and so many steps of the clock, rows bear one stamp only where the clock stopped."""
LEAST_TIMED_PART = 0.5
FREE_STOPS, BETWEEN_STOPS_US = 3, 60 * MICROSECONDS
"""More than a few, and more than one a minute, are rows that came in bunches."""


@dataclass(frozen=True, slots=True, eq=False)
class Strangers:
    """Pieces whose stamps lie outside the time between their neighbours; shape (n,) each.

    ``before_us``, ``after_us``: the stamps of the rows around them; ``span_us``: from their first to last.
    """

    first: NDArray[np.int64]
    stop: NDArray[np.int64]
    before_us: NDArray[np.int64]
    after_us: NDArray[np.int64]
    span_us: NDArray[np.int64]


def has_strange_ends(stamps: NDArray[np.int64]) -> bool:
    """Whether the first stamps, or the last one, may not be believed."""
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
    return _take_out(columns, kept) + _tell_timed(timed)


def _fills_time(stamps: NDArray[np.int64], first: int, stop: int, pace: Pace) -> bool:
    """Whether there are rows on both sides, and the time between them is that of the rows."""
    if first == 0 or stop == len(stamps):
        return False
    return bool(_tell_fit(stop - first, stamps[stop] - stamps[first - 1], pace))


@njit(cache=True, nogil=True)
def find_equal_runs(stamps: NDArray[np.int64], shortest: int) -> NDArray[np.int64]:
    """Rows that share a stamp, ``shortest`` of them or more: first and first after, shape (m, 2).

    In such a run some row at a multiple of half its least length has its like so many rows later.
    """
    half = max(1, shortest // 2)
    runs = np.empty((len(stamps) // max(shortest, 1) + 1, 2), np.int64)
    found = reached = 0
    for row in range(0, len(stamps) - half, half):
        if row < reached or stamps[row] != stamps[row + half]:
            continue
        first, stop = row, row
        while first > 0 and stamps[first - 1] == stamps[row]:
            first -= 1
        while stop < len(stamps) and stamps[stop] == stamps[row]:
            stop += 1
        if stop - first >= shortest:
            runs[found, 0], runs[found, 1] = first, stop
            found += 1
        reached = max(stop, row + 1)
    return runs[:found]


def mend_stuck(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Time rows whose stamp stood still by their neighbours (W-CLOCK-FWD), or leave them out.

    Left out are those that do not fill the time between their neighbours, and those at either end of the
    file (W-ROWS-DROPPED): nobody can say when they were measured.
    """
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    pieces = find_pieces(stamps, pace)
    found = _find_strangers(stamps, pieces, pace)
    rows = found.stop - found.first
    is_stuck = _tell_stuck(rows, found.span_us, pace)
    if pace.is_coarse:  # there one stamp lasts for many rows anyway: it must be far away, too
        is_stuck |= (found.span_us == 0) & (np.abs(stamps[found.first] - found.before_us) > FAR_US)
    fits = (is_stuck | (rows < LEAST_STUCK_ROWS)) & _tell_fit(rows, found.after_us - found.before_us, pace)
    for k in np.flatnonzero(fits):
        _time_between(stamps, int(found.first[k]), int(found.stop[k]), pace)
    kept = np.ones(columns.rows, np.bool_)
    for k in np.flatnonzero(is_stuck & ~fits):
        kept[found.first[k] : found.stop[k]] = False
    _leave_out_ends(pieces, pace, kept)
    return _take_out(columns, kept) + _tell_timed(int(rows[fits].sum()))


def _time_between(stamps: NDArray[np.int64], first: int, stop: int, pace: Pace) -> None:
    """Time rows evenly between those around them; on a coarse clock each stamp gets its usual rows."""
    before_us, after_us = int(stamps[first - 1]), int(stamps[stop])
    if not pace.is_coarse:
        stamps[first:stop] = np.linspace(before_us, after_us, stop - first + 2)[1:-1]
        return
    usual = max(1, round(pace.step_us / pace.period_us))
    have = int(np.count_nonzero(stamps[max(0, first - usual) : first] == before_us))
    steps = (have + np.arange(stop - first)) // usual
    stamps[first:stop] = np.minimum(before_us + steps * round(pace.step_us), after_us)


def place_strangers(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Put rows of a clock that was away for a while, and came back, behind those before (W-CLOCK-FWD)."""
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    found = _find_strangers(stamps, find_pieces(stamps, pace), pace)
    slack_us = found.after_us - found.before_us - found.span_us
    chosen = np.flatnonzero(slack_us >= pace.period_us)
    for k in chosen:
        first, stop = int(found.first[k]), int(found.stop[k])
        behind_us = min(pace.period_us, 0.5 * float(slack_us[k]))
        stamps[first:stop] += round(found.before_us[k] + behind_us) - stamps[first:stop].min()
    return _tell_timed(int((found.stop - found.first)[chosen].sum()))


def _find_strangers(stamps: NDArray[np.int64], pieces: Pieces, pace: Pace) -> Strangers:
    first, stop = pieces.first[1:-1], pieces.stop[1:-1]
    before_us, after_us = stamps[first - 1], stamps[stop % len(stamps)]
    low_us, high_us = pieces.low_us[1:-1], pieces.high_us[1:-1]
    is_outside = (high_us < before_us) | (low_us > after_us)
    chosen = is_outside & (after_us > before_us - int(pace.is_coarse))
    return Strangers(
        first[chosen], stop[chosen], before_us[chosen], after_us[chosen], (high_us - low_us)[chosen]
    )


def _tell_stuck(rows: NDArray[np.int64], span_us: NDArray[np.int64], pace: Pace) -> NDArray[np.bool_]:
    expected_us = (rows - 1) * pace.period_us
    least_us = np.maximum(0.5 * expected_us, 1.5 * pace.step_us)
    is_stuck: NDArray[np.bool_] = (rows >= LEAST_STUCK_ROWS) & (expected_us - span_us > least_us)
    return is_stuck


def _tell_fit(rows: int | NDArray[np.int64], around_us: NDArray[np.int64], pace: Pace) -> NDArray[np.bool_]:
    """Whether so many rows fill the time from the row before them to the one after."""
    filled_us = (rows + 1) * pace.period_us
    off_us = np.abs(around_us - filled_us)
    coarse_us = pace.step_us if pace.is_coarse else 0.0
    fits: NDArray[np.bool_] = (
        off_us <= np.maximum(FIT_PERIODS * pace.period_us, FIT_SHARE * filled_us) + coarse_us
    )
    return fits


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
        if away_us > FAR_US and (is_alone or _tell_stuck(rows, span_us, pace)[0]):
            kept[pieces.first[here] : pieces.stop[here]] = False


def _take_out(columns: SampleColumns, kept: NDArray[np.bool_]) -> tuple[QualityFlag, ...]:
    dropped = int(np.count_nonzero(~kept))
    if dropped == 0:
        return ()
    columns.keep(kept)
    return (QualityFlag(Caveat.ROWS_DROPPED, dropped),)


def _tell_timed(rows: int) -> tuple[QualityFlag, ...]:
    return (QualityFlag(Caveat.CLOCK_FWD, rows),) if rows else ()


def settle_rows(
    columns: SampleColumns, *, tick_us: int = 0, is_wall_clock: bool = False
) -> tuple[QualityFlag, ...]:
    """Bring rows into the order of time and mend their stamps, in place; say what was done.

    ``tick_us``: microseconds in a count, where the stamps are those of a counter that may start over;
    ``is_wall_clock``: the stamps are a clock's that may follow daylight saving. A table whose stamps only
    advance is looked through once and left as it is.
    """
    flags = turn_round(columns)
    if is_wall_clock:
        flags += undo_daylight_saving(columns.stamps)
    flags += unwrap_counter(columns.stamps, tick_us)
    flags += mend_stopped(columns)
    if count_backward(columns.stamps) == 0 and not has_strange_ends(columns.stamps):
        return flags
    flags += mend_stuck(columns) + leave_out_repeats(columns)
    if count_backward(columns.stamps):
        flags += order_pieces(columns)
    if count_backward(columns.stamps):
        flags += place_strangers(columns)
    return flags
