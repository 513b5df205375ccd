"""From stamped rows to even segments: what is missing, what is bridged, where a segment ends (CONTRACT §5).

Compared to the contract's rule (a step longer than 1.5 periods is a hole): a step is not a hole where the
stamps after it make up for it, because then the row was stamped late, not lost; and a clock too coarse for
the rate (whole milliseconds at 952 Hz) is allowed its own step.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import UnknownRate, UnusableTime
from fusion.numba_kernels import njit
from fusion.recording import LONGEST_BRIDGE_US, MICROSECONDS, QualityFlag, Segment, Span, flag_spans

LONGEST_GAP_US = 86_400 * MICROSECONDS
LATE_ROWS = 32
"""How far to look for stamps that make up for a late one."""
SLOWEST_HZ, FASTEST_HZ = 10.0, 4000.0
BLOCK_ROWS = 32
MAX_STEPS = 20_000
ALIKE_SHARE = 0.6
"""Rows in bunches have no usual step."""
COARSE_CLOCK_US = 1000
FITTED_ROWS = 64
"""A shorter run takes the period of the whole recording: its own would be too uncertain."""


@dataclass(frozen=True, slots=True, eq=False)
class Holes:
    """Where time is missing or the clock was set, in order, one entry each.

    ``row``: the first row after it; ``step_us``: since the row before; ``added``: rows that are to be put in
    (0: the segment ends).
    """

    row: NDArray[np.int64]
    step_us: NDArray[np.int64]
    added: NDArray[np.int64]

    @property
    def is_set(self) -> NDArray[np.bool_]:
        """Where the clock was set: nothing says how long the break was."""
        is_set: NDArray[np.bool_] = (self.step_us <= 0) | (self.step_us > LONGEST_GAP_US)
        return is_set

    def take(self, first: int, stop: int) -> "Holes":
        """Those inside a run of rows, counted from its first."""
        chosen = slice(np.searchsorted(self.row, first, "right"), np.searchsorted(self.row, stop))
        return Holes(self.row[chosen] - first, self.step_us[chosen], self.added[chosen])


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Even segments, and the caveats found on the way."""

    segments: tuple[Segment, ...]
    duration_us: int
    flags: tuple[QualityFlag, ...]
    period_us: float
    jitter_us: float


def estimate_period_us(stamps: NDArray[np.int64]) -> float:
    """Estimate the sample period, whatever share of the rows is lost.

    The mean of the single steps, where most steps are alike: lost rows make steps of two periods and more,
    and those do not count. Where the clock is too coarse to tell a single step from a double one, and where
    rows arrive in bunches, the median over blocks of 32 rows, which is right while few rows are lost.

    Raises
    ------
        UnusableTime
            Fewer than two rows, or stamps that do not advance.
        UnknownRate
            The rate is none that shows an arm's movement.
    """
    if len(stamps) < 2:
        raise UnusableTime(why="rows")
    period_us = _estimate_period_us(stamps)
    if period_us <= 0.0:
        raise UnusableTime(why="constant")
    if not SLOWEST_HZ <= MICROSECONDS / period_us <= FASTEST_HZ:
        raise UnknownRate(m=round(MICROSECONDS / period_us, 4), cure="time unit")
    return period_us


def _estimate_period_us(stamps: NDArray[np.int64]) -> float:
    steps = steps_between(stamps, 1)
    if len(steps) == 0:
        return 0.0
    usual_us = float(np.median(steps))
    alike = steps[np.abs(steps - usual_us) <= 0.5 * usual_us]
    if len(alike) < ALIKE_SHARE * len(steps) or usual_us <= 0.0:
        return _median_or_zero(steps_between(stamps, BLOCK_ROWS))
    if _tells_single_steps(find_quantum_us(stamps), usual_us):
        return float(alike.mean())
    return _median_or_zero(steps_between(stamps, BLOCK_ROWS))


def _tells_single_steps(quantum_us: int, usual_us: float) -> bool:
    """Whether a double step looks unlike a single one: not at 952 Hz on a clock of whole milliseconds."""
    is_exact = quantum_us == usual_us and quantum_us > COARSE_CLOCK_US
    return is_exact or usual_us >= 2 * quantum_us


def steps_between(stamps: NDArray[np.int64], rows: int) -> NDArray[np.float64]:
    """Time from a row to the ``rows``-th after it, divided by ``rows``; where it advances, thinned evenly."""
    if len(stamps) < 2:
        return np.zeros(0)
    rows = min(rows, len(stamps) - 1)
    starts = np.arange(0, len(stamps) - rows, max(1, len(stamps) // MAX_STEPS))
    steps = (stamps[starts + rows] - stamps[starts]) / rows
    return np.asarray(steps[steps >= 0], dtype=np.float64)


def _median_or_zero(values: NDArray[np.float64]) -> float:
    return float(np.median(values)) if len(values) else 0.0


def find_quantum_us(stamps: NDArray[np.int64]) -> int:
    """The coarseness of the stamps: the greatest common divisor of their first steps."""
    steps = np.abs(np.diff(stamps[:4096]))
    return int(np.gcd.reduce(steps[steps > 0], initial=0))


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
    last = np.float64(n - 1 + added.sum())
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


def longest_even_step_us(stamps: NDArray[np.int64], period_us: float) -> float:
    """How long a step an unbroken run can show on so coarse a clock: 2 ms at 952 Hz in whole milliseconds."""
    quantum_us = find_quantum_us(stamps)
    return quantum_us * math.ceil(period_us / quantum_us - 1e-6) if quantum_us else 0.0


def find_holes(stamps: NDArray[np.int64], period_us: float) -> Holes:
    """Where rows are missing."""
    limit_us = max(1.5 * period_us, longest_even_step_us(stamps, period_us))
    rows = np.empty(len(stamps) // 10 + 100, np.int64)
    found = find_long_steps(stamps, limit_us, period_us, rows)
    if found > len(rows):
        rows = np.empty(found, np.int64)
        find_long_steps(stamps, limit_us, period_us, rows)
    rows = rows[:found].copy()
    step_us = stamps[rows] - stamps[rows - 1]
    whole = np.maximum(1, np.round(step_us / period_us).astype(np.int64) - 1)
    is_short = (step_us > 0) & (step_us <= LONGEST_BRIDGE_US)
    return Holes(rows, step_us, np.where(is_short, whole, 0))


@njit(cache=True, nogil=True)
def open_rows(
    values: NDArray[np.float32], n_rows: int, rows: NDArray[np.int64], added: NDArray[np.int64]
) -> None:
    """Put rows in before each of ``rows`` by linear interpolation, in place, from the end backwards.

    ``values`` has room for them after its ``n_rows``.
    """
    to = n_rows + added.sum()
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


def bridged_ranges(holes: Holes) -> tuple[tuple[int, int], ...]:
    """Row ranges that were put into a run."""
    stops = (holes.row + np.cumsum(holes.added)).tolist()
    return tuple((stop - k, stop) for stop, k in zip(stops, holes.added.tolist(), strict=True) if k)


# Stretches whose rows come at a rate of their own (every second one lost, say), or at none.


# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)


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
    return flag_spans(Caveat.RATE_CHANGE, spans, rate_hz=rate_hz)


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
