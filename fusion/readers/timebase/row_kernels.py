"""Compiled passes over all rows and their stamps: one loop each, where numpy would need several arrays."""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import njit
from fusion.recording import LONGEST_BRIDGE_US, MICROSECONDS

LONGEST_DELAY_US = MICROSECONDS
"""A row that comes later than this is no late row: its clock was set."""
LONGEST_WINDOW_ROWS = 8192
FULL_RUN = 0.1
LATE_ROWS = 32
"""How far to look for stamps that make up for a late one."""
PACE_ROWS = 32
LARGEST_CHANGE = 0.03
"""A pace further from the usual one than this is another rate: no clock drifts so far."""
EVEN_PART, SAME_PACE = 0.4, 0.02


# Rows that came late.


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
    stamps: NDArray[np.int64], order: NDArray[np.int64], window: tuple[int, int], least_us: float
) -> bool:
    """Whether the sorted window and its neighbours are never closer than ``least_us``."""
    first, stop = window
    before = stamps[first - 1] if first > 0 else stamps[first + order[0]] - 2 * np.int64(least_us) - 1
    for k in order:
        if stamps[first + k] - before < least_us:
            return False
        before = stamps[first + k]
    return stop == len(stamps) or stamps[stop] - before >= least_us


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


# Rows that share a stamp.


@njit(cache=True, nogil=True)
def find_equal_runs(stamps: NDArray[np.int64], shortest_rows: int) -> NDArray[np.int64]:
    """Rows that share a stamp, ``shortest_rows`` of them or more: first and first after, shape (m, 2).

    In such a run some row at a multiple of half its least length has its like so many rows later.
    """
    half = max(1, shortest_rows // 2)
    runs = np.empty((len(stamps) // max(shortest_rows, 1) + 1, 2), np.int64)
    found = reached = 0
    for row in range(0, len(stamps) - half, half):
        if row < reached or stamps[row] != stamps[row + half]:
            continue
        first, stop = row, row
        while first > 0 and stamps[first - 1] == stamps[row]:
            first -= 1
        while stop < len(stamps) and stamps[stop] == stamps[row]:
            stop += 1
        if stop - first >= shortest_rows:
            runs[found, 0], runs[found, 1] = first, stop
            found += 1
        reached = max(stop, row + 1)
    return runs[:found]


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


# Rows on an even grid: single wrong stamps, holes, the line through the stamps, bridged rows.


@njit(cache=True, nogil=True)
def mend_stamps(stamps: NDArray[np.int64], period_us: float) -> int:
    """Replace single stamps that both neighbours contradict, in place; return how many."""
    mended = 0
    for k in range(1, len(stamps) - 1):
        around = stamps[k + 1] - stamps[k - 1]
        is_outside = stamps[k] < stamps[k - 1] or stamps[k] > stamps[k + 1]
        if is_outside and 0 < around <= 4 * period_us:
            stamps[k] = stamps[k - 1] + around // 2
            mended += 1
    return mended


@njit(cache=True, nogil=True)
def is_made_up(stamps: NDArray[np.int64], row: int, period_us: float) -> bool:
    """Whether the rows after a long step come so fast that nothing was lost."""
    for ahead in range(1, LATE_ROWS):
        if row + ahead >= len(stamps):
            return False
        late_us = stamps[row + ahead] - stamps[row - 1] - (ahead + 1) * period_us
        if late_us < -LONGEST_BRIDGE_US:
            return False
        if late_us <= 0.5 * period_us:
            return True
    return False


@njit(cache=True, nogil=True)
def find_long_steps(
    stamps: NDArray[np.int64], limit_us: float, period_us: float, rows: NDArray[np.int64]
) -> int:
    """Write the rows before which time is missing or runs backwards; return how many there are in all."""
    found = 0
    for k in range(1, len(stamps)):
        step = stamps[k] - stamps[k - 1]
        if step < 0 or (step > limit_us and not is_made_up(stamps, k, period_us)):
            if found < len(rows):
                rows[found] = k
            found += 1
    return found


@njit(cache=True, nogil=True)
def fit_line(
    stamps: NDArray[np.int64], rows: NDArray[np.int64], added: NDArray[np.int64]
) -> tuple[float, float, float]:
    """Least squares of stamps on their place in the grid; return offset, period and RMS of the residuals.

    Before each of ``rows`` the place grows by ``added``. What is fitted are the small distances from the line
    through the first and the last stamp: sums over the stamps themselves would lose all their digits in a
    long file.
    """
    n = len(stamps)
    last = np.float64(n - 1)
    for rows_added in added:
        last += rows_added
    guess = (stamps[n - 1] - stamps[0]) / last
    sum_x = sum_y = sum_xx = sum_xy = sum_yy = 0.0
    shift = np.int64(0)
    for hole in range(len(rows) + 1):
        first = rows[hole - 1] if hole > 0 else 0
        shift += added[hole - 1] if hole > 0 else 0
        for k in range(first, rows[hole] if hole < len(rows) else n):
            x = (k + shift) - 0.5 * last
            y = (stamps[k] - stamps[0]) - guess * (k + shift)
            sum_x += x
            sum_y += y
            sum_xx += x * x
            sum_xy += x * y
            sum_yy += y * y
    spread_xx, spread_xy = sum_xx - sum_x * sum_x / n, sum_xy - sum_x * sum_y / n
    tilt = spread_xy / spread_xx
    level = (sum_y - tilt * sum_x) / n
    squares = max(0.0, sum_yy - sum_y * sum_y / n - tilt * spread_xy)
    return level - 0.5 * tilt * last, guess + tilt, np.sqrt(squares / n)


@njit(cache=True, nogil=True)
def open_rows(
    values: NDArray[np.float32], n_rows: int, rows: NDArray[np.int64], added: NDArray[np.int64]
) -> None:
    """Put rows in before each of ``rows`` by linear interpolation, in place, from the end backwards.

    ``values`` has room for them after its ``n_rows``.
    """
    to = n_rows
    for rows_added in added:
        to += rows_added
    source = n_rows
    for hole in range(len(rows) - 1, -1, -1):
        while source > rows[hole]:
            source -= 1
            to -= 1
            for axis in range(3):
                values[to, axis] = values[source, axis]
        for k in range(added[hole], 0, -1):
            weight = k / (added[hole] + 1)
            to -= 1
            for axis in range(3):
                before, after = values[source - 1, axis], values[source, axis]
                values[to, axis] = before * (1.0 - weight) + after * weight


# Stretches whose rows come at a rate of their own.


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
def is_own_step(
    stamps: NDArray[np.int64], row: int, pace_us: float, period_us: float, quantum_us: float
) -> bool:
    """Whether the step to ``row`` is even at this pace, and nearer to it than to the usual one."""
    step = stamps[row] - stamps[row - 1]
    is_near = abs(step - pace_us) < abs(step - period_us)
    return is_near and is_even_step(stamps, row, pace_us, quantum_us)


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
