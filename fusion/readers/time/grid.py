"""From stamped rows to even segments: their stamps repaired, what is missing, where a segment ends.

:func:`repair_row_times` keeps a day-long log whole; :func:`cut_stamped` and :func:`cut_counted` lay rows on
even grids.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.errors import UnknownRate, UnusableTime
from acromion.fusion.numba_kernels import njit
from acromion.fusion.readers.samples import PAUSE, SampleColumns
from acromion.fusion.readers.time.bursts import spread_bursts
from acromion.fusion.readers.time.clock import datetime_at_us, is_change_of_wall_clock
from acromion.fusion.recording import (
    LONGEST_BRIDGE_US,
    MICROSECONDS,
    QualityFlag,
    Segment,
    Span,
    flag_counts,
    flag_gaps,
    flag_spans,
)

# Compiled passes over all rows and their stamps: one loop each, where numpy would need several arrays.

LONGEST_DELAY_US = MICROSECONDS
"""A row that comes later than this is not a late row: its clock was set."""
LONGEST_WINDOW_ROWS = 8192
LATE_ROWS = 32
"""How far to look for stamps that make up for a late one."""
PACE_ROWS = 32
LARGEST_CHANGE = 0.03
"""A pace that differs more than this from the usual one is another rate: no clock drifts that far."""
EVEN_PART, SAME_PACE = 0.4, 0.02


# Rows that came late.


@njit(cache=True, nogil=True)
def find_late_window(stamps: NDArray[np.int64], row: int) -> tuple[int, int]:
    """Return the window (first, stop) into which a late ``row`` sorts; (row, row) if there is none."""
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
    """Return whether all rows of the sorted window and its neighbours are at least ``least_us`` apart."""
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
    """Sort rows that arrived late, in place; return how many there were."""
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
    """Return runs of at least ``shortest_rows`` rows with one stamp: (first, stop), shape (m, 2).

    Only every ``half``-th row is compared with the row ``half`` later: each such run contains one such pair.
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
    """Return whether the rows after a long step catch up, so that nothing was lost."""
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
    """Fill ``rows`` with the rows that follow missing time or a step back; return the total count."""
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
    """Fit the stamps to the grid by least squares; return offset, period and RMS of the residuals.

    Before each of ``rows`` the place grows by ``added``. The fit uses the small distances from the line
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


# Stretches whose rows come at another rate.


@njit(cache=True, nogil=True)
def is_even_step(stamps: NDArray[np.int64], row: int, pace_us: float, quantum_us: float) -> bool:
    """Return whether the step to ``row`` fits sampling at this pace."""
    return abs(stamps[row] - stamps[row - 1] - pace_us) <= EVEN_PART * pace_us + quantum_us  # type: ignore[no-any-return]


@njit(cache=True, nogil=True)
def is_even_run(stamps: NDArray[np.int64], row: int, pace_us: float, quantum_us: float) -> bool:
    """Return whether the next 2 × ``PACE_ROWS`` rows keep this pace, with no change among them."""
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
    """Return whether the step to ``row`` fits this pace, and fits it better than the usual one."""
    step = stamps[row] - stamps[row - 1]
    is_near = abs(step - pace_us) < abs(step - period_us)
    return is_near and is_even_step(stamps, row, pace_us, quantum_us)


@njit(cache=True, nogil=True)
def find_stretches(
    stamps: NDArray[np.int64], period_us: float, quantum_us: float, found: NDArray[np.int64]
) -> int:
    """Fill ``found`` with the stretches that keep another pace; return the total count."""
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
        reached = stop - 1  # the step after that row decides its rate
    return count


# The grid.
#
# A step longer than 1.5 periods is a hole, with two exceptions: if the next stamps catch up, the row was
# stamped late, not lost; and if the clock is too coarse for the rate (whole milliseconds at 952 Hz), a step
# of the clock is not a hole.

LONGEST_GAP_US = 31 * 86_400 * MICROSECONDS
"""A longer step forward is a clock that was set, not a gap: it adds no time."""
SLOWEST_HZ, FASTEST_HZ = 10.0, 4000.0
JITTER_PERIODS = 0.25
"""Stamps that scatter by more are flagged."""


Stretches = NDArray[np.int64]
"""First row and the one after the last, shape (n, 2)."""


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Even segments, and the caveats found on the way."""

    segments: tuple[Segment, ...]
    duration_us: int
    flags: tuple[QualityFlag, ...]
    period_us: float
    jitter_us: float


@dataclass(frozen=True, slots=True, eq=False)
class Holes:
    """Places with missing time or a clock that was set, in order, one entry each.

    ``row``: the first row after it; ``step_us``: time since the row before; ``added``: rows to insert (0: the
    segment ends).
    """

    row: NDArray[np.int64]
    step_us: NDArray[np.int64]
    added: NDArray[np.int64]

    @property
    def is_set(self) -> NDArray[np.bool_]:
        """Whether the clock was set, so that the length of the break is unknown."""
        is_set: NDArray[np.bool_] = (self.step_us <= 0) | (self.step_us > LONGEST_GAP_US)
        return is_set

    def take(self, first_row: int, stop_row: int) -> "Holes":
        """Return the holes inside a run of rows, counted from its first row."""
        chosen = slice(np.searchsorted(self.row, first_row, "right"), np.searchsorted(self.row, stop_row))
        return Holes(self.row[chosen] - first_row, self.step_us[chosen], self.added[chosen])


@dataclass(frozen=True, slots=True)
class FittedRun:
    """Unbroken rows: the first and the one after the last, and the line through their stamps.

    ``first_us``: the first row's own stamp; ``offset_us``: from there to its fitted time; ``is_set``: the
    clock was set before it.
    """

    first_row: int
    stop_row: int
    first_us: int
    offset_us: float
    period_us: float
    jitter_us: float
    is_set: bool


def cut_stamped(columns: SampleColumns) -> Grid:
    """Cut rows with stamps in microseconds that :func:`repair_row_times` has repaired.

    Raises UnusableTime or UnknownRate if the stamps are not an even sampling at a usable rate.
    """
    stamps = columns.stamps
    mended = spread_bursts(stamps)
    period_us = estimate_period_us(stamps)
    if count_backward(stamps):  # of all kernels this one takes longest to compile, and few files need it
        late = sort_windows(columns.acc, columns.gyr, stamps, EVEN_STEP_PERIODS * period_us)
        mended += flag_counts({Caveat.ORDER: late})
    replaced = mend_stamps(stamps, period_us)
    holes = find_holes(stamps, period_us)
    stretches = find_rate_changes(stamps, period_us)
    if len(stretches):
        holes, stretches = leave_stretches(holes, stretches, columns.rows)
        period_us = choose_period_us(stamps, stretches, period_us)
    if len(holes.row) > MOST_HOLES_PART * columns.rows + FREE_HOLES:
        is_even = find_even_rows(holes, columns.rows)
        dropped = int(np.count_nonzero(~is_even))
        columns.keep(is_even)  # the time of the others is then missing
        grid = cut_stamped(columns)
        return replace(grid, flags=(*mended, QualityFlag(Caveat.ROWS_DROPPED, dropped), *grid.flags))
    mended += flag_rates(stamps, stretches)
    fits = _fit_runs(stamps, holes, stretches, period_us)
    segments = place_segments(columns, holes, fits)
    duration_us = segments[-1].end_us
    jitter_us = max(fit.jitter_us for fit in fits)
    flags = (*mended, *flag_time(holes, replaced, jitter_us / period_us), *flag_gaps(segments, duration_us))
    return Grid(segments, duration_us, flags, period_us, jitter_us)


def cut_counted(columns: SampleColumns, rate_hz: float) -> Grid:
    """Cut rows that have numbers instead of stamps, at a given rate.

    A skipped number is a row that could not be read; a few of them are bridged, as in rows with stamps. A
    pause is a break of unknown length, so the next segment follows at once.

    Raises UnknownRate if the rate is outside the range that shows arm movement.
    """
    if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise UnknownRate(m=rate_hz)
    period_us = MICROSECONDS / rate_hz
    numbers, n_rows = columns.stamps[: columns.rows].copy(), columns.rows
    row = np.flatnonzero(np.diff(numbers) != 1) + 1
    is_pause = numbers[row] // PAUSE != numbers[row - 1] // PAUSE
    steps = numbers[row] - numbers[row - 1]
    is_short = ~is_pause & (steps * period_us <= LONGEST_BRIDGE_US)
    holes = Holes(row, np.rint(steps * period_us).astype(np.int64), np.where(is_short, steps - 1, 0))
    pauses = set(row[is_pause].tolist())
    runs = [
        FittedRun(
            first, stop, round(int(numbers[first] % PAUSE) * period_us), 0.0, period_us, 0.0, first in pauses
        )
        for first, stop in pairwise([0, *row[~is_short].tolist(), n_rows])
    ]
    segments = tuple(replace(one, rate_hz=rate_hz) for one in place_segments(columns, holes, runs))
    duration_us = segments[-1].end_us
    flags = flag_gaps(segments, duration_us) + flag_counts({Caveat.PAUSE: len(pauses)})
    return Grid(segments, duration_us, flags, period_us, 0.0)


def _fit_runs(
    stamps: NDArray[np.int64], holes: Holes, stretches: Stretches, period_us: float
) -> list[FittedRun]:
    is_cut = holes.added == 0
    sets = set(holes.row[is_cut & holes.is_set].tolist())
    edges = sorted({0, *holes.row[is_cut].tolist(), *stretches.flatten().tolist(), len(stamps)})
    runs = []
    for first, stop in pairwise(edges):
        line = (0.0, period_us, 0.0)
        if stop - first >= FITTED_ROWS:
            inside = holes.take(first, stop)
            line = fit_line(stamps[first:stop], inside.row, inside.added)
        if line[1] <= 0.0:
            raise UnusableTime(why="constant")
        if not SLOWEST_HZ <= MICROSECONDS / line[1] <= FASTEST_HZ:
            raise UnknownRate(m=round(MICROSECONDS / line[1], 4), cure="time unit")
        runs.append(FittedRun(first, stop, int(stamps[first]), *line, first in sets))
    return runs


FITTED_ROWS = 64
"""A shorter run takes the period of the whole recording: its own would be too uncertain."""


def place_segments(columns: SampleColumns, holes: Holes, runs: list[FittedRun]) -> tuple[Segment, ...]:
    """Insert the bridged rows and place the runs on the recording's clock."""
    is_bridge = holes.added > 0
    columns.open_holes(holes.row[is_bridge], holes.added[is_bridge])
    segments: list[Segment] = []
    clock_us = runs[0].first_us
    first = 0
    for run in runs:
        inside = holes.take(run.first_row, run.stop_row)
        stop = first + run.stop_row - run.first_row + int(inside.added.sum())
        reached_us = segments[-1].end_us if segments else 0
        if run.is_set:
            # nothing says how long the break was, so the segment follows at once
            clock_us = run.first_us - reached_us
        start_us = round(run.first_us - clock_us + run.offset_us) if segments else 0
        acc, gyr = columns.acc[first:stop], columns.gyr[first:stop]
        rate_hz = MICROSECONDS / run.period_us
        ends = (inside.row + np.cumsum(inside.added)).tolist()
        bridged = tuple((end - k, end) for end, k in zip(ends, inside.added.tolist(), strict=True) if k)
        segments.append(Segment(max(reached_us, start_us), rate_hz, acc, gyr, bridged))
        first = stop
    return tuple(segments)


def flag_time(holes: Holes, replaced_rows: int, jitter_periods: float) -> tuple[QualityFlag, ...]:
    """Flag a clock that was set, and jitter.

    ``replaced_rows``: number of corrected stamps; ``jitter_periods``: RMS distance from the even grid.
    """
    found = {
        Caveat.CLOCK_FWD: replaced_rows + int(np.count_nonzero(holes.step_us > LONGEST_GAP_US)),
        Caveat.CLOCK_BACK: int(np.count_nonzero(holes.step_us < 0)),
        Caveat.JITTER: int(jitter_periods > JITTER_PERIODS),
    }
    return flag_counts(found)


EVEN_STEP_PERIODS = 0.4
"""Sorted rows are at least this many periods apart; closer rows would mix two runs of samples."""


def count_backward(stamps: NDArray[np.int64]) -> int:
    """Return how many stamps are earlier than the one before."""
    return int(np.count_nonzero(stamps[1:] < stamps[:-1]))


# The sample period.

BLOCK_ROWS = 32
MAX_STEPS = 20_000
ALIKE_SHARE = 0.6
"""Rows in bunches have no usual step."""
COARSE_CLOCK_US = 1000


def estimate_period_us(stamps: NDArray[np.int64]) -> float:
    """Estimate the sample period; any share of the rows may be lost.

    If most steps are alike, this is the mean of the single steps; steps of two periods and more, which lost
    rows cause, do not count. If the clock is too coarse to distinguish a single step from a double one, or if
    rows arrive in bunches, it is the median over blocks of 32 rows, which is right if few rows are lost.

    Raises
    ------
        UnusableTime
            Fewer than two rows, or stamps that do not advance.
        UnknownRate
            The rate is outside the range that shows arm movement.
    """
    if len(stamps) < 2:
        raise UnusableTime(why="rows")
    steps = steps_between(stamps, 1)
    usual_us = float(np.median(steps)) if len(steps) else 0.0
    alike = steps[np.abs(steps - usual_us) <= 0.5 * usual_us]
    quantum_us = find_quantum_us(stamps)
    # a double step looks unlike a single one: not at 952 Hz on a clock of whole milliseconds
    is_exact = quantum_us == usual_us and quantum_us > COARSE_CLOCK_US
    if usual_us > 0.0 and len(alike) >= ALIKE_SHARE * len(steps) and (is_exact or usual_us >= 2 * quantum_us):
        period_us = float(alike.mean())
    else:
        blocks = steps_between(stamps, BLOCK_ROWS)
        period_us = float(np.median(blocks)) if len(steps) and len(blocks) else 0.0
    if period_us <= 0.0:
        raise UnusableTime(why="constant")
    if not SLOWEST_HZ <= MICROSECONDS / period_us <= FASTEST_HZ:
        raise UnknownRate(m=round(MICROSECONDS / period_us, 4), cure="time unit")
    return period_us


def steps_between(stamps: NDArray[np.int64], rows: int) -> NDArray[np.float64]:
    """Return the mean step over ``rows`` rows, from evenly spaced rows."""
    if len(stamps) < 2:
        return np.zeros(0)
    rows = min(rows, len(stamps) - 1)
    starts = np.arange(0, len(stamps) - rows, max(1, len(stamps) // MAX_STEPS))
    steps = (stamps[starts + rows] - stamps[starts]) / rows
    return np.asarray(steps[steps >= 0], dtype=np.float64)


def find_quantum_us(stamps: NDArray[np.int64]) -> int:
    """Return the resolution of the stamps: the greatest common divisor of their first steps."""
    steps = np.abs(np.diff(stamps[:4096]))
    return int(np.gcd.reduce(steps[steps > 0], initial=0))


# Holes.


def find_holes(stamps: NDArray[np.int64], period_us: float) -> Holes:
    """Find the places with missing rows."""
    quantum_us = find_quantum_us(stamps)  # so coarse a clock shows 2 ms at 952 Hz in whole milliseconds
    even_us = quantum_us * math.ceil(period_us / quantum_us - 1e-6) if quantum_us else 0.0
    limit_us = max(1.5 * period_us, even_us)
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


WINDOW_ROWS = 1000
MOST_HOLES_PART, FREE_HOLES = 0.1, 100
"""If more than one row in ten begins a hole, sampling is not even; short files may have a few."""
LEAST_EVEN_PART = 0.5
"""With a smaller share of rows in even stretches, the stamps do not come from sampling."""


def find_even_rows(holes: Holes, rows: int) -> NDArray[np.bool_]:
    """Mark the rows of windows in which at most one row in ten begins a hole, shape (rows,).

    Raises UnusableTime if they are fewer than half.
    """
    windows = np.bincount(holes.row // WINDOW_ROWS, minlength=-(-rows // WINDOW_ROWS))
    is_even = np.repeat(windows <= MOST_HOLES_PART * WINDOW_ROWS, WINDOW_ROWS)[:rows]
    if np.count_nonzero(is_even) < LEAST_EVEN_PART * rows:
        raise UnusableTime(why="irregular")
    return is_even


# Stretches whose rows come at another rate (every second row lost, say).

SHORTEST_SLOW_US = 10 * MICROSECONDS
"""In a shorter stretch, missing rows are bridged and the segment continues."""


def find_rate_changes(stamps: NDArray[np.int64], period_us: float) -> Stretches:
    """Find the stretches that become segments with another rate.

    The step after a row decides to which rate the row belongs.
    """
    quantum_us = float(find_quantum_us(stamps))
    quantum_us *= quantum_us <= COARSE_CLOCK_US
    count: int = find_stretches(stamps, period_us, quantum_us, np.empty((0, 2), np.int64))
    found: Stretches = np.empty((count, 2), np.int64)
    if len(found) == 0:
        return found
    find_stretches(stamps, period_us, quantum_us, found)
    length_us = stamps[found[:, 1] - 1] - stamps[found[:, 0]]
    pace_us = length_us / (found[:, 1] - found[:, 0] - 1)
    is_rate = (pace_us >= MICROSECONDS / FASTEST_HZ) & (pace_us <= MICROSECONDS / SLOWEST_HZ)
    return found[is_rate & ((pace_us < period_us) | (length_us >= SHORTEST_SLOW_US))]


def leave_stretches(holes: Holes, stretches: Stretches, rows: int) -> tuple[Holes, Stretches]:
    """Return the holes outside the stretches, and the stretches without a last row of another rate."""
    kept = np.ones(len(holes.row), np.bool_)
    for first, stop in stretches:
        kept[np.searchsorted(holes.row, first, "right") : np.searchsorted(holes.row, stop)] = False
    outside = Holes(holes.row[kept], holes.step_us[kept], holes.added[kept])
    ends_there = np.isin(stretches[:, 1], outside.row[outside.added == 0]) | (stretches[:, 1] == rows)
    return outside, np.stack([stretches[:, 0], stretches[:, 1] - ~ends_there], axis=1)


def choose_period_us(stamps: NDArray[np.int64], stretches: Stretches, period_us: float) -> float:
    """Return the period of most rows: the longest stretch's if stretches contain most rows."""
    rows = stretches[:, 1] - stretches[:, 0]
    if 2 * rows.sum() <= len(stamps):
        return period_us
    first, stop = stretches[np.argmax(rows)]
    return float((stamps[stop - 1] - stamps[first]) / (stop - 1 - first))


def flag_rates(stamps: NDArray[np.int64], stretches: Stretches) -> tuple[QualityFlag, ...]:
    """Flag stretches at another rate; report the rate of the longest (W-RATE-CHANGE)."""
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


# Stamped rows before they are cut into segments: what keeps a day-long log whole, and nothing more.
#
# A counter that starts over, an hour of daylight saving, a copied block, a clock that stopped or left for a
# while. No other order is corrected: a table with the newest row first is refused, and a piece in the wrong
# place looks like a clock that was set (W-CLOCK-BACK). The functions below :func:`repair_row_times` are its
# steps, in order.


def repair_row_times(
    columns: SampleColumns, *, tick_us: int = 0, is_wall_clock: bool = False
) -> tuple[QualityFlag, ...]:
    """Correct the stamps of rows, in place, or drop rows; return the caveats.

    A table whose stamps only advance is read once and not changed.

    ``columns``: rows with stamps in microseconds.
    ``tick_us``: microseconds of one count if a counter that may start over made the stamps; else 0.
    ``is_wall_clock``: the stamps come from a clock that may follow daylight saving.

    Raises UnusableTime if the newest row is first, or if the clock stood still during most rows.
    """
    stamps = columns.stamps[: columns.rows]
    backward = count_backward(stamps)
    forward = np.count_nonzero(stamps[1:] > stamps[:-1]) if backward else 0
    if len(stamps) >= 3 and backward and backward >= TURNED_SHARE * (backward + forward):
        raise UnusableTime(why="reversed")
    flags = undo_daylight_saving(columns.stamps) if is_wall_clock else ()
    flags += unwrap_counter(columns.stamps, tick_us)
    flags += leave_out_stopped(columns)
    if count_backward(columns.stamps) == 0 and not has_outlying_ends(columns.stamps):
        return flags
    flags += leave_out_repeats(columns)
    return flags + place_outliers(columns) + leave_out_ends(columns)


TURNED_SHARE = 0.9
"""Share of backward steps from which a table counts as reversed."""


# A wall clock that followed daylight saving.

HOUR_US = 3600 * MICROSECONDS
CHANGE_US = HOUR_US // 2
"""Clocks are changed at a full hour; here and there at half past."""
LONGEST_LOSS_US = 600 * MICROSECONDS
CHANGE_TOLERANCE_US = 2 * MICROSECONDS
FIRST_ROWS = 4097
PART_ROWS = 1 << 14


def undo_daylight_saving(stamps: NDArray[np.int64]) -> tuple[QualityFlag, ...]:
    """Remove the one-hour step of daylight saving from wall-clock stamps, in place.

    A step counts only if it is one hour and some time zone changes its clocks by it at that moment. Up to ten
    minutes of rows may be lost around it. All stamps then follow the clock of the first row.
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
    """Return the rows that a long step in either direction follows; works in parts to save memory."""
    return [
        first + int(place)
        for first in range(0, len(stamps), PART_ROWS)
        for place in np.flatnonzero(np.abs(np.diff(stamps[first : first + PART_ROWS + 1])) > longer_than_us)
    ]


# Counters that start over: micros() and millis() of 32 bits.

BITS = 32
MARGIN_US = 60 * MICROSECONDS
"""A wrap goes from this near the counter's end to this near its start; a restarted logger does not."""


def unwrap_counter(stamps: NDArray[np.int64], tick_us: int) -> tuple[QualityFlag, ...]:
    """Undo the wraps of a counter, in place (W-WRAP); ``tick_us`` is 0 if the stamps are not counts."""
    if tick_us == 0 or count_backward(stamps) == 0:
        return ()
    wrap_us = 2**BITS * tick_us
    is_wrap = (stamps[:-1] > wrap_us - MARGIN_US) & (stamps[1:] < MARGIN_US)
    stamps[1:] += wrap_us * np.cumsum(is_wrap)
    return flag_counts({Caveat.WRAP: int(is_wrap.sum())})


# How the stamps advance, and the pieces between two long steps of the clock.

USUAL_PACE_ROWS = 1024


@dataclass(frozen=True, slots=True)
class Pace:
    """Usual advance of a table's stamps: the mean from row to row, and one step of the clock."""

    period_us: float
    step_us: float

    @property
    def longest_us(self) -> float:
        """The longest step within a piece; a longer one separates two pieces."""
        return max(1.5 * self.step_us, LONGEST_BRIDGE_US)


def measure_pace(stamps: NDArray[np.int64]) -> Pace:
    """Measure how the stamps usually advance; zeros if they do not."""
    steps = steps_between(stamps, 1)
    paces = steps_between(stamps, min(USUAL_PACE_ROWS, max(1, len(stamps) // 8)))
    usual = [float(np.median(found[found > 0])) if np.any(found > 0) else 0.0 for found in (paces, steps)]
    return Pace(*usual)


# A clock that stood still, or was wrong for a while.

FAR_US = 60 * MICROSECONDS
"""A single row at either end of a file is an outlier if it is this far from the others."""
LOOKED_AT_ROWS = 8193
SHORTEST_STOP_US, SHORTEST_STOP_STEPS = 500_000, 3.0
"""If rows share a stamp for at least this time and this many steps of the clock, the clock stopped."""
LEAST_TIMED_PART = LEAST_WAIT = 0.5
FREE_STOPS, BETWEEN_STOPS_US = 3, 60 * MICROSECONDS
"""With more stops than a few and one a minute, rows arrived in bunches and no clock stopped."""


def leave_out_stopped(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Drop rows recorded while the clock stood still: their time is unknown (W-ROWS-DROPPED).

    Rows that arrived together after a wait as long as they took are kept.

    Raises UnusableTime if most rows would be dropped.
    """
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    if pace.period_us <= 0.0 or pace.step_us <= 0.0:
        return ()
    longest_us = max(SHORTEST_STOP_US, SHORTEST_STOP_STEPS * pace.step_us)
    runs = find_equal_runs(stamps, int(longest_us / pace.period_us) + 1)
    waited_us = np.where(runs[:, 0] > 0, stamps[runs[:, 0]] - stamps[runs[:, 0] - 1], 0)
    runs = runs[waited_us < LEAST_WAIT * (runs[:, 1] - runs[:, 0]) * pace.period_us]
    if not 0 < len(runs) <= FREE_STOPS + columns.rows * pace.period_us / BETWEEN_STOPS_US:
        return ()
    kept = np.ones(columns.rows, np.bool_)
    for first, stop in runs.tolist():
        kept[first:stop] = False
    if np.count_nonzero(kept) < LEAST_TIMED_PART * columns.rows:
        raise UnusableTime(why="constant")
    return _leave_out(columns, kept)


def has_outlying_ends(stamps: NDArray[np.int64]) -> bool:
    """Return whether the first stamps or the last one are over a minute before or after the others."""
    if len(stamps) < 3:
        return False
    differs = stamps[:LOOKED_AT_ROWS] != stamps[0]
    second = int(np.argmax(differs)) if differs.any() else 1
    return bool(stamps[second] - stamps[0] > FAR_US or stamps[-1] - stamps[-2] > FAR_US)


def place_outliers(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Move rows with a temporarily wrong clock to directly after the rows before them (W-CLOCK-FWD).

    They keep the distances of their stamps; if their clock stood still, they are spaced evenly.
    """
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    steps = np.diff(stamps)  # rows at most a second late keep their place
    edges = np.flatnonzero((steps > pace.longest_us) | (steps < -LONGEST_DELAY_US)) + 1
    first, stop = edges[:-1], edges[1:]  # pieces between two long steps of the clock
    if len(first) == 0:
        return ()
    low_us, high_us = (extreme.reduceat(stamps, edges)[:-1] for extreme in (np.minimum, np.maximum))
    before_us, after_us = stamps[first - 1], stamps[stop % len(stamps)]
    span_us = high_us - low_us
    is_outside = (high_us < before_us) | (low_us > after_us)
    is_away = is_outside & (after_us - before_us - span_us >= pace.period_us)
    for k in np.flatnonzero(is_away):
        rows = int(stop[k] - first[k])
        room_us = min(float(after_us[k] - before_us[k]), (rows + 1) * pace.period_us)
        stood_still = span_us[k] < 0.5 * (rows - 1) * pace.period_us
        even_us = np.linspace(0.0, room_us, rows + 2)[1:-1]
        own_us = stamps[first[k] : stop[k]] - low_us[k] + min(pace.period_us, even_us[0])
        stamps[first[k] : stop[k]] = before_us[k] + np.rint(even_us if stood_still else own_us).astype(
            np.int64
        )
    return flag_counts({Caveat.CLOCK_FWD: int((stop - first)[is_away].sum())})


def leave_out_ends(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Drop a first or last row that is over a minute from the others (W-ROWS-DROPPED)."""
    stamps = columns.stamps[: columns.rows]
    kept = np.ones(len(stamps), np.bool_)
    if len(stamps) >= 3:
        kept[0] = abs(stamps[1] - stamps[0]) <= FAR_US
        kept[-1] = abs(stamps[-1] - stamps[-2]) <= FAR_US
    return _leave_out(columns, kept)


def _leave_out(columns: SampleColumns, kept: NDArray[np.bool_]) -> tuple[QualityFlag, ...]:
    dropped = int(np.count_nonzero(~kept))
    if dropped:
        columns.keep(kept)
    return flag_counts({Caveat.ROWS_DROPPED: dropped})


# Rows that are in a table twice: a copy resumed too early, or a file appended to itself.

LEAST_ROWS = 10
"""This many rows with repeated stamps and readings, not all the same, can only be a copy."""
MOST_STEPS = 64
"""The most steps back that are checked; each check searches all earlier rows."""


def leave_out_repeats(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Drop, in place, rows that repeat earlier ones after a step back of the clock (W-DUP, in rows)."""
    stamps = columns.stamps[: columns.rows]
    count = count_backward(stamps)
    if not 0 < count <= MOST_STEPS:
        return ()
    kept = np.ones(columns.rows, np.bool_)
    for row in (np.flatnonzero(stamps[1:] < stamps[:-1]) + 1).tolist():
        rows = _count_repeated(columns, row)
        if rows >= LEAST_ROWS and np.ptp(columns.acc[row : row + rows], axis=0).any():
            kept[row : row + rows] = False
    repeated = columns.rows - int(kept.sum())
    if repeated == 0:
        return ()
    columns.keep(kept)
    return (QualityFlag(Caveat.DUP, repeated),)


def _count_repeated(columns: SampleColumns, row: int) -> int:
    """Return how many rows from ``row`` on repeat the stamps and readings of an earlier block."""
    stamps, acc, gyr = columns.stamps[: columns.rows], columns.acc, columns.gyr
    like = np.flatnonzero(stamps[:row] == stamps[row])
    like = like[((acc[like] == acc[row]) & (gyr[like] == gyr[row])).all(axis=1)]
    if len(like) == 0:
        return 0
    first, rows = int(like[0]), len(stamps) - row
    differs = stamps[first : first + rows] != stamps[row:]
    rows = int(np.argmax(differs)) if differs.any() else rows
    is_same = (acc[first : first + rows] == acc[row : row + rows]) & (
        gyr[first : first + rows] == gyr[row : row + rows]
    )
    differs = ~is_same.all(axis=1)
    return int(np.argmax(differs)) if differs.any() else rows
