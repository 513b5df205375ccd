"""Stretches whose rows come at a rate of their own (every second one lost, say), or at none."""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.errors import UnusableTime
from fusion.readers.grid import COARSE_CLOCK_US, FASTEST_HZ, SLOWEST_HZ, Holes, find_quantum_us
from fusion.readers.timing import flag_spans
from fusion.recording import MICROSECONDS, QualityFlag, Span

PACE_ROWS = 32
LARGEST_CHANGE = 0.03
"""A pace further from the usual one than this is another rate: no clock drifts so far."""
EVEN_PART, SAME_PACE = 0.4, 0.02
SHORTEST_SLOW_US = 10 * MICROSECONDS
"""For less, rows that are lacking are bridged, and the segment goes on."""
LEAST_EVEN_PART = 0.5
"""With fewer rows in even stretches the stamps are not those of a sampling."""
WINDOW_ROWS = 1000
MOST_HOLES_PART, FREE_HOLES = 0.1, 100
"""One row in ten that begins a hole is no even sampling; a few are free, for short files."""
Stretches = NDArray[np.int64]
"""First row and the one after the last, shape (n, 2)."""


@njit(cache=True, nogil=True)
def is_even_step(stamps: NDArray[np.int64], row: int, pace_us: float, quantum_us: float) -> bool:
    """Whether the step to ``row`` can be one of a sampling at this pace."""
    return abs(stamps[row] - stamps[row - 1] - pace_us) <= EVEN_PART * pace_us + quantum_us


@njit(cache=True, nogil=True)
def is_even_run(stamps: NDArray[np.int64], row: int, pace_us: float, quantum_us: float) -> bool:
    """Whether two times ``PACE_ROWS`` rows come evenly at this pace: the change is not among them."""
    later = row + PACE_ROWS
    later_us = (stamps[later + PACE_ROWS] - stamps[later]) / PACE_ROWS
    if abs(later_us - pace_us) > SAME_PACE * pace_us:
        return False
    for k in range(row + 1, later + PACE_ROWS + 1):  # noqa: SIM110 (numba takes no generator)
        if not is_even_step(stamps, k, pace_us, quantum_us):
            return False
    return True


@njit(cache=True, nogil=True)
def find_stretches(
    stamps: NDArray[np.int64], period_us: float, quantum_us: float, found: NDArray[np.int64]
) -> int:
    """Write stretches whose rows come evenly at another pace; return how many there are in all."""
    least_us = max(LARGEST_CHANGE * period_us, 2 * quantum_us / PACE_ROWS)
    count = reached = row = 0
    while row + 2 * PACE_ROWS < len(stamps):
        pace_us = (stamps[row + PACE_ROWS] - stamps[row]) / PACE_ROWS
        is_usual = abs(pace_us - period_us) <= least_us or pace_us <= 0
        if is_usual or not is_even_run(stamps, row, pace_us, quantum_us):
            row += PACE_ROWS
            continue
        first, stop = row, row + PACE_ROWS + 1
        while first > reached and is_own_step(stamps, first, pace_us, period_us, quantum_us):
            first -= 1
        while stop < len(stamps) and is_own_step(stamps, stop, pace_us, period_us, quantum_us):
            stop += 1
        if count < len(found):
            found[count, 0], found[count, 1] = first, stop
        count += 1
        row = stop
        reached = stop - 1  # that row belongs to the rate at which the next one follows
    return count


@njit(cache=True, nogil=True)
def is_own_step(
    stamps: NDArray[np.int64], row: int, pace_us: float, period_us: float, quantum_us: float
) -> bool:
    """Whether the step to ``row`` is even at this pace, and nearer to it than to the usual one."""
    step = stamps[row] - stamps[row - 1]
    is_near = abs(step - pace_us) < abs(step - period_us)
    return is_near and is_even_step(stamps, row, pace_us, quantum_us)


def find_rate_changes(stamps: NDArray[np.int64], period_us: float) -> Stretches:
    """Find the stretches that are to be segments of their own rate.

    A row belongs to the rate at which the next one follows.
    """
    quantum_us = float(find_quantum_us(stamps))
    quantum_us *= quantum_us <= COARSE_CLOCK_US
    found = np.empty((find_stretches(stamps, period_us, quantum_us, np.empty((0, 2), np.int64)), 2), np.int64)
    if len(found) == 0:
        return found
    find_stretches(stamps, period_us, quantum_us, found)
    length_us = stamps[found[:, 1] - 1] - stamps[found[:, 0]]
    pace_us = length_us / (found[:, 1] - found[:, 0] - 1)
    is_rate = (pace_us >= MICROSECONDS / FASTEST_HZ) & (pace_us <= MICROSECONDS / SLOWEST_HZ)
    return found[is_rate & ((pace_us < period_us) | (length_us >= SHORTEST_SLOW_US))]


def leave_stretches(holes: Holes, stretches: Stretches, rows: int) -> tuple[Holes, Stretches]:
    """Give the holes outside the stretches, and the stretches without a last row that leads on elsewhere."""
    kept = np.ones(len(holes.row), np.bool_)
    for first, stop in stretches:
        kept[np.searchsorted(holes.row, first, "right") : np.searchsorted(holes.row, stop)] = False
    outside = Holes(holes.row[kept], holes.step_us[kept], holes.added[kept])
    ends_there = np.isin(stretches[:, 1], outside.row[outside.added == 0]) | (stretches[:, 1] == rows)
    return outside, np.stack([stretches[:, 0], stretches[:, 1] - ~ends_there], axis=1)


def choose_period_us(stamps: NDArray[np.int64], stretches: Stretches, period_us: float) -> float:
    """Give the period that most rows have: that of the longest stretch, where stretches hold most rows."""
    rows = stretches[:, 1] - stretches[:, 0]
    if 2 * rows.sum() <= len(stamps):
        return period_us
    first, stop = stretches[np.argmax(rows)]
    return float((stamps[stop - 1] - stamps[first]) / (stop - 1 - first))


def flag_rates(stamps: NDArray[np.int64], stretches: Stretches) -> tuple[QualityFlag, ...]:
    """Say how often and for how long rows came at another rate (W-RATE-CHANGE), and at which the longest."""
    if len(stretches) == 0:
        return ()
    steps = stretches[:, 1] - stretches[:, 0] - 1
    step_us = (stamps[stretches[:, 1] - 1] - stamps[stretches[:, 0]]) / np.maximum(steps, 1)
    length_us = np.rint((steps + 1) * step_us)
    rate_hz = round(MICROSECONDS / float(step_us[np.argmax(length_us)]), 2)
    spans = [
        Span(int(stamps[a] - stamps[0]), int(us)) for (a, _), us in zip(stretches, length_us, strict=True)
    ]
    return flag_spans("W-RATE-CHANGE", spans, rate_hz=rate_hz)


def are_too_many(holes: Holes, rows: int) -> bool:
    """Whether so many holes are none of an even sampling."""
    return len(holes.row) > MOST_HOLES_PART * rows + FREE_HOLES


def find_even_rows(holes: Holes, rows: int) -> NDArray[np.bool_]:
    """Mark the rows of windows in which at most one row in ten begins a hole, shape (rows,).

    Raises
    ------
    UnusableTime
        They are fewer than half.
    """
    windows = np.bincount(holes.row // WINDOW_ROWS, minlength=-(-rows // WINDOW_ROWS))
    is_even = np.repeat(windows <= MOST_HOLES_PART * WINDOW_ROWS, WINDOW_ROWS)[:rows]
    if np.count_nonzero(is_even) < LEAST_EVEN_PART * rows:
        raise UnusableTime(why="irregular")
    return is_even
