"""Stamps that need mending before they are cut into segments: rows out of order, stamps too coarse, a clock
that followed daylight saving.
"""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)

from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.readers.samples import SampleColumns
from fusion.readers.timing import datetime_at_us
from fusion.readers.zones import is_change_of_wall_clock
from fusion.recording import MICROSECONDS, QualityFlag

LONGEST_DELAY_US = MICROSECONDS
"""A row that comes later than this is no late row: its clock was set."""
LONGEST_WINDOW_ROWS = 8192
EVEN_STEP = 0.4
"""Sorted rows lie at least so many periods apart, else two runs of samples would be mixed."""
COARSE_ROWS = 4.0
"""Rows that share a stamp on average, from which on the stamp is a count of something coarser."""
FULL_RUN = 0.1
EVEN_RUNS, SAME_COUNT = 10, 0.02
"""So many stamps one after the other with as many rows each, give or take one or 2 %, are a rate."""
HOUR_US = 3600 * MICROSECONDS
CHANGE_US = HOUR_US // 2
"""Clocks are changed at a full hour; here and there at half past."""
LONGEST_LOSS_US = 600 * MICROSECONDS
CLOCK_US = 2 * MICROSECONDS
FIRST_ROWS = 4097
PART_ROWS = 1 << 14


@njit(cache=True, nogil=True)
def find_late_window(stamps: NDArray[np.int64], row: int) -> tuple[int, int]:
    """The rows among which ``row`` and what follows it belong: first, and first after; (row, row): none."""
    highest = stamps[row - 1]
    if highest - stamps[row] > LONGEST_DELAY_US:
        return row, row
    first = row - 1
    while first > 0 and stamps[first - 1] > stamps[row]:
        first -= 1
    stop = row
    while stop < len(stamps) and stamps[stop] < highest:
        if stop - first > LONGEST_WINDOW_ROWS:
            return row, row
        stop += 1
    return first, stop


@njit(cache=True, nogil=True)
def is_even(
    stamps: NDArray[np.int64], order: NDArray[np.int64], window: tuple[int, int], least: float
) -> bool:
    """Whether the sorted window and its neighbours are never closer than ``least``."""
    first, stop = window
    before = stamps[first - 1] if first > 0 else stamps[first + order[0]] - 2 * np.int64(least) - 1
    for k in order:
        if stamps[first + k] - before < least:
            return False
        before = stamps[first + k]
    return stop == len(stamps) or stamps[stop] - before >= least


@njit(cache=True, nogil=True)
def sort_windows(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], stamps: NDArray[np.int64], least_us: float
) -> int:
    """Put rows that came late into their place, in place; return how many came late."""
    late = 0
    row = 1
    while row < len(stamps):
        if stamps[row] >= stamps[row - 1]:
            row += 1
            continue
        first, stop = find_late_window(stamps, row)
        if stop > first:
            order = np.argsort(stamps[first:stop], kind="mergesort")
            if is_even(stamps, order, (first, stop), least_us):
                late += stop - row
                stamps[first:stop] = stamps[first:stop][order]
                acc[first:stop] = acc[first:stop][order]
                gyr[first:stop] = gyr[first:stop][order]
                row = stop
                continue
        row += 1
    return late


@njit(cache=True, nogil=True)
def count_backward(stamps: NDArray[np.int64]) -> int:
    """How many stamps are earlier than the one before."""
    backward = 0
    for row in range(1, len(stamps)):
        backward += int(stamps[row] < stamps[row - 1])
    return backward


@njit(cache=True, nogil=True)
def find_backward(stamps: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """The ``count`` rows whose stamps are earlier than the one before; nothing as long as the log is made."""
    rows = np.empty(count, np.int64)
    found = 0
    for row in range(1, len(stamps)):
        if found < count and stamps[row] < stamps[row - 1]:
            rows[found] = row
            found += 1
    return rows


def sort_late_rows(columns: SampleColumns, period_us: float) -> tuple[QualityFlag, ...]:
    """Sort rows that came at most a second late; whatever is more is a clock that was set."""
    if count_backward(columns.stamps) == 0:
        return ()  # of all kernels this one takes longest to compile, and few files need it
    late = sort_windows(columns.acc, columns.gyr, columns.stamps, EVEN_STEP * period_us)
    return (QualityFlag("W-ORDER", late),) if late else ()


@njit(cache=True, nogil=True)
def spread_runs(
    stamps: NDArray[np.int64], edges: NDArray[np.int64], step_us: float, usual: NDArray[np.float64]
) -> None:
    """Place the rows of each run of equal stamps evenly over the time until the next stamp, in place.

    ``usual``: how many rows such a run has where none is lost, one for each.
    """
    for run in range(len(edges) - 1):
        first, stop = edges[run], edges[run + 1]
        rows = stop - first
        length_us = step_us
        if stop < len(stamps) and 0 < stamps[stop] - stamps[first] < 1.5 * step_us:
            length_us = float(stamps[stop] - stamps[first])
        is_full = abs(rows - usual[run]) <= FULL_RUN * usual[run]
        share_us = length_us / (rows if is_full or rows > usual[run] else usual[run])
        began_within = run == 0 and rows < usual[run]
        late = usual[run] - rows if began_within else 0.0
        base = stamps[first]
        for k in range(rows):
            stamps[first + k] = base + np.int64(np.round((k + late) * share_us))


def find_usual_counts(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Give the rows that a stamp has where none is lost: those of its stretch, if it is one of an even rate.

    Others take those of the even stretch before, or of the first one; without any, the median holds for all.
    """
    usual = np.full(len(counts), float(np.median(counts)))
    differs = np.abs(np.diff(counts)) > np.maximum(1.0, SAME_COUNT * counts[1:])
    edges = np.concatenate([[0], np.flatnonzero(differs) + 1, [len(counts)]])
    stretches = [(int(a), int(b)) for a, b in pairwise(edges) if b - a >= EVEN_RUNS]
    starts = [0, *(first for first, _ in stretches[1:]), len(counts)]
    for (first, stop), (start, end) in zip(stretches, pairwise(starts), strict=False):
        usual[start:end] = float(np.median(counts[first:stop]))
    return usual


@njit(cache=True, nogil=True)
def count_runs(stamps: NDArray[np.int64]) -> int:
    """How many runs of equal stamps there are."""
    runs = 1
    for k in range(1, len(stamps)):
        runs += int(stamps[k] != stamps[k - 1])
    return runs


def spread_coarse_stamps(stamps: NDArray[np.int64]) -> tuple[QualityFlag, ...]:
    """Give the rows that share a stamp (whole seconds, say) times of their own, in place.

    The n rows of a second T lie at T + k/n, as those of a `.gt3x` do; where clearly fewer than usual share a
    stamp, they keep the usual distance and the rest is a hole.
    """
    if count_runs(stamps) < 3 or len(stamps) < COARSE_ROWS * count_runs(stamps):
        return ()
    edges = np.concatenate([[0], np.flatnonzero(np.diff(stamps)) + 1, [len(stamps)]])
    counts = np.diff(edges)
    steps = np.diff(stamps[edges[:-1]])
    if not np.any(steps > 0):
        return ()
    step_us = float(np.median(steps[steps > 0]))
    spread_runs(stamps, edges.astype(np.int64), step_us, find_usual_counts(counts))
    return (QualityFlag("W-JITTER"),)


def undo_daylight_saving(stamps: NDArray[np.int64]) -> tuple[QualityFlag, ...]:
    """Take an hour's step out of wall-clock stamps where the clocks were changed, in place.

    Only a step of one hour, at a moment at which the clocks of some zone step so, is taken for that; rows may
    be lost around it for up to ten minutes. The stamps go on by the clock of the first row.
    """
    first_steps = np.diff(stamps[:FIRST_ROWS])
    advances = first_steps[first_steps > 0]  # many rows share a coarse stamp
    usual = float(np.median(advances)) if len(advances) else 0.0
    flags: tuple[QualityFlag, ...] = ()
    for place in _find_long_steps(stamps, HOUR_US // 2):
        step_us = int(stamps[place + 1] - stamps[place])
        hour_us = HOUR_US if step_us > 0 else -HOUR_US
        lost_us = step_us - hour_us - usual
        if not -max(1.5 * usual, 1.0) <= lost_us <= LONGEST_LOSS_US:
            continue
        next_us = int(stamps[place]) + round(usual)
        changed_us = -(-next_us // CHANGE_US) * CHANGE_US if lost_us > CLOCK_US else next_us
        reading = datetime_at_us(changed_us) if changed_us <= next_us + lost_us + CLOCK_US else None
        if reading is None or not is_change_of_wall_clock(reading, hour_us // MICROSECONDS):
            continue
        at_s = float(stamps[place + 1] - hour_us - stamps[0]) / MICROSECONDS
        stamps[place + 1 :] -= np.int64(hour_us)
        flags += (QualityFlag("W-DST", 1, 0.0, at_s, at_s, {"step_s": hour_us // MICROSECONDS}),)
    return flags


def _find_long_steps(stamps: NDArray[np.int64], longer_than_us: int) -> list[int]:
    """Rows after which the clock steps far either way; in parts, so that no array as long is made."""
    return [
        first + int(place)
        for first in range(0, len(stamps), PART_ROWS)
        for place in np.flatnonzero(np.abs(np.diff(stamps[first : first + PART_ROWS + 1])) > longer_than_us)
    ]
