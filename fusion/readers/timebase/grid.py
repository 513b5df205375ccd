"""From stamped rows to even segments: what is missing, what is bridged, where a segment ends.

:func:`cut_stamped` and :func:`cut_counted` go first; what they call follows in the order of the calls.

A step longer than 1.5 periods is a hole. Compared to that rule, a step is not a hole where the
stamps after it make up for it, because the row was then stamped late, not lost; and a clock too coarse for
the rate (whole milliseconds at 952 Hz) is allowed its own step.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import UnknownRate, UnusableTime
from fusion.readers.samples import PAUSE, SampleColumns
from fusion.readers.timebase.row_kernels import (
    find_long_steps,
    find_stretches,
    fit_line,
    mend_stamps,
    sort_windows,
    spread_runs,
)
from fusion.recording import (
    LONGEST_BRIDGE_US,
    MICROSECONDS,
    QualityFlag,
    Segment,
    Span,
    flag_counts,
    flag_gaps,
    flag_spans,
)

LONGEST_GAP_US = 86_400 * MICROSECONDS
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

    def take(self, first_row: int, stop_row: int) -> "Holes":
        """Those inside a run of rows, counted from its first."""
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
    """Cut rows with stamps in microseconds that :mod:`fusion.readers.timebase.row_times` has repaired.

    Raises
    ------
    fusion.errors.UnusableTime, fusion.errors.UnknownRate
        The stamps give no even sampling at a usable rate.
    """
    stamps = columns.stamps
    mended = spread_coarse_stamps(stamps)
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

    A skipped number is a row that could not be read; a pause is a break of unknown length, so the next
    segment follows at once.

    Raises
    ------
    UnknownRate
        The rate is none that shows an arm's movement.
    """
    if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise UnknownRate(m=rate_hz)
    period_us = MICROSECONDS / rate_hz
    numbers = columns.stamps
    pauses = numbers // PAUSE
    breaks = np.flatnonzero(np.diff(numbers) != 1) + 1
    edges = [0, *breaks.tolist(), columns.rows]
    segments: list[Segment] = []
    for first, stop in pairwise(edges):
        start_us = segments[-1].end_us if segments else 0
        if segments and pauses[first] == pauses[first - 1]:
            start_us += round((numbers[first] - numbers[first - 1] - 1) * period_us)
        segments.append(Segment(start_us, rate_hz, columns.acc[first:stop], columns.gyr[first:stop]))
    duration_us = segments[-1].end_us
    flags = flag_gaps(segments, duration_us)
    n_pauses = int(np.count_nonzero(np.diff(pauses)))
    if n_pauses:
        flags += (QualityFlag(Caveat.PAUSE, n_pauses),)
    return Grid(tuple(segments), duration_us, flags, period_us, 0.0)


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
    """Put the bridged rows in and lay the runs on the recording's clock."""
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

    ``replaced_rows``: stamps that were put into line; ``jitter_periods``: their RMS from the even grid.
    """
    found = {
        Caveat.CLOCK_FWD: replaced_rows + int(np.count_nonzero(holes.step_us > LONGEST_GAP_US)),
        Caveat.CLOCK_BACK: int(np.count_nonzero(holes.step_us < 0)),
        Caveat.JITTER: int(jitter_periods > JITTER_PERIODS),
    }
    return flag_counts(found)


# Rows that share a coarse stamp get times of their own.

COARSE_ROWS = 4.0
"""Rows that share a stamp on average, from which on the stamp is a count of something coarser."""
EVEN_RUNS, SAME_COUNT = 10, 0.02
"""So many stamps one after the other with as many rows each, give or take one or 2 %, are a rate."""


def spread_coarse_stamps(stamps: NDArray[np.int64]) -> tuple[QualityFlag, ...]:
    """Give the rows that share a stamp (whole seconds, say) times of their own, in place.

    The n rows of a second T lie at T + k/n, as those of a `.gt3x` do; where clearly fewer than usual share a
    stamp, they keep the usual distance and the rest is a hole.
    """
    runs = 1 + np.count_nonzero(stamps[1:] != stamps[:-1])
    if runs < 3 or len(stamps) < COARSE_ROWS * runs:
        return ()
    edges = np.concatenate([[0], np.flatnonzero(np.diff(stamps)) + 1, [len(stamps)]])
    counts = np.diff(edges)
    steps = np.diff(stamps[edges[:-1]])
    if not np.any(steps > 0):
        return ()
    step_us = float(np.median(steps[steps > 0]))
    spread_runs(stamps, edges.astype(np.int64), step_us, find_usual_counts(counts))
    return (QualityFlag(Caveat.JITTER),)


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


EVEN_STEP_PERIODS = 0.4
"""Sorted rows lie at least so many periods apart, else two runs of samples would be mixed."""


def count_backward(stamps: NDArray[np.int64]) -> int:
    """How many stamps are earlier than the one before."""
    return int(np.count_nonzero(stamps[1:] < stamps[:-1]))


# The sample period.

BLOCK_ROWS = 32
MAX_STEPS = 20_000
ALIKE_SHARE = 0.6
"""Rows in bunches have no usual step."""
COARSE_CLOCK_US = 1000


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
    """Time from a row to the ``rows``-th after it, divided by ``rows``; where it advances, thinned evenly."""
    if len(stamps) < 2:
        return np.zeros(0)
    rows = min(rows, len(stamps) - 1)
    starts = np.arange(0, len(stamps) - rows, max(1, len(stamps) // MAX_STEPS))
    steps = (stamps[starts + rows] - stamps[starts]) / rows
    return np.asarray(steps[steps >= 0], dtype=np.float64)


def find_quantum_us(stamps: NDArray[np.int64]) -> int:
    """The coarseness of the stamps: the greatest common divisor of their first steps."""
    steps = np.abs(np.diff(stamps[:4096]))
    return int(np.gcd.reduce(steps[steps > 0], initial=0))


# Holes.


def find_holes(stamps: NDArray[np.int64], period_us: float) -> Holes:
    """Where rows are missing."""
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
"""One row in ten that begins a hole is no even sampling; a few are free, for short files."""
LEAST_EVEN_PART = 0.5
"""With fewer rows in even stretches the stamps are not those of a sampling."""


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


# Stretches whose rows come at a rate of their own (every second one lost, say).

SHORTEST_SLOW_US = 10 * MICROSECONDS
"""For less, rows that are lacking are bridged, and the segment goes on."""


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
    """Flag stretches at another rate, with that of the longest one (W-RATE-CHANGE)."""
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
