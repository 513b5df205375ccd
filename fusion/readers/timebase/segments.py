"""Cutting stamped rows into the segments of a recording."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import UnknownRate, UnusableTime
from fusion.readers.samples import SampleColumns
from fusion.readers.tables.careful_path import PAUSE
from fusion.readers.timebase.grid import (
    FASTEST_HZ,
    FITTED_ROWS,
    LONGEST_GAP_US,
    SLOWEST_HZ,
    Grid,
    Holes,
    Stretches,
    are_too_many,
    bridged_ranges,
    choose_period_us,
    estimate_period_us,
    find_even_rows,
    find_holes,
    find_rate_changes,
    fit_line,
    flag_rates,
    leave_stretches,
    mend_stamps,
)
from fusion.readers.timebase.repair import sort_late_rows, spread_coarse_stamps
from fusion.recording import MICROSECONDS, QualityFlag, Segment, flag_gaps

JITTER_PART = 0.25
"""Stamps that scatter by more than this part of a period are worth a word."""


def cut_stamped(columns: SampleColumns) -> Grid:
    """Cut rows with stamps in microseconds, mended by :func:`fusion.readers.timebase.row_times.settle_rows`.

    Raises
    ------
    fusion.errors.UnusableTime, fusion.errors.UnknownRate
        The stamps give no even sampling at a usable rate.
    """
    stamps = columns.stamps
    mended = spread_coarse_stamps(stamps)
    period_us = estimate_period_us(stamps)
    mended += sort_late_rows(columns, period_us)
    replaced = mend_stamps(stamps, period_us)
    holes = find_holes(stamps, period_us)
    stretches = find_rate_changes(stamps, period_us)
    if len(stretches):
        holes, stretches = leave_stretches(holes, stretches, columns.rows)
        period_us = choose_period_us(stamps, stretches, period_us)
    if are_too_many(holes, columns.rows):
        return _cut_even_rows(columns, find_even_rows(holes, columns.rows), mended)
    mended += flag_rates(stamps, stretches)
    fits = _fit_runs(stamps, holes, stretches, period_us)
    segments = place_segments(columns, holes, fits)
    duration_us = segments[-1].end_us
    jitter_us = max(fit.jitter_us for fit in fits)
    flags = mended + flag_time(holes, replaced, jitter_us / period_us)
    flags += flag_gaps(segments, duration_us)
    return Grid(segments, duration_us, flags, period_us, jitter_us)


@dataclass(frozen=True, slots=True)
class FittedRun:
    """Unbroken rows: the first and the one after the last, and the line through their stamps.

    ``first_us``: the first row's own stamp; ``offset_us``: from there to its fitted time; ``is_set``: the
    clock was set before it.
    """

    first: int
    stop: int
    first_us: int
    offset_us: float
    period_us: float
    jitter_us: float
    is_set: bool


def _cut_even_rows(
    columns: SampleColumns, is_even: NDArray[np.bool_], mended: tuple[QualityFlag, ...]
) -> Grid:
    """Leave out the stretches that are no sampling, whose time is then missing, and cut the rest."""
    dropped = int(np.count_nonzero(~is_even))
    columns.keep(is_even)
    grid = cut_stamped(columns)
    return replace(grid, flags=(*mended, QualityFlag(Caveat.ROWS_DROPPED, dropped), *grid.flags))


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
        runs.append(FittedRun(first, stop, int(stamps[first]), *line, first in sets))
    return runs


def place_segments(columns: SampleColumns, holes: Holes, runs: list[FittedRun]) -> tuple[Segment, ...]:
    """Put the bridged rows in and lay the runs on the recording's clock."""
    is_bridge = holes.added > 0
    columns.open_holes(holes.row[is_bridge], holes.added[is_bridge])
    segments: list[Segment] = []
    clock_us = runs[0].first_us
    first = 0
    for run in runs:
        inside = holes.take(run.first, run.stop)
        stop = first + run.stop - run.first + int(inside.added.sum())
        reached_us = segments[-1].end_us if segments else 0
        if run.is_set:
            # nothing says how long the break was, so the segment follows at once
            clock_us = run.first_us - reached_us
        start_us = round(run.first_us - clock_us + run.offset_us) if segments else 0
        acc, gyr = columns.acc[first:stop], columns.gyr[first:stop]
        rate_hz = MICROSECONDS / run.period_us
        segments.append(Segment(max(reached_us, start_us), rate_hz, acc, gyr, bridged_ranges(inside)))
        first = stop
    return tuple(segments)


def flag_time(holes: Holes, replaced: int, jitter: float) -> tuple[QualityFlag, ...]:
    """Say how the clock was; ``replaced``: stamps that were put into line."""
    found = {
        Caveat.CLOCK_FWD: replaced + int(np.count_nonzero(holes.step_us > LONGEST_GAP_US)),
        Caveat.CLOCK_BACK: int(np.count_nonzero(holes.step_us < 0)),
        Caveat.JITTER: int(jitter > JITTER_PART),
    }
    return tuple(QualityFlag(code, count) for code, count in found.items() if count)


def cut_counted(columns: SampleColumns, rate_hz: float) -> Grid:
    """Cut rows that have numbers instead of stamps, at a rate that was told.

    A number that is skipped is a row that was there and could not be read; a pause is a break of unknown
    length, so the next segment follows at once.

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
