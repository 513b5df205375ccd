"""Cutting stamped rows into the segments of a recording."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from fusion.readers.grid import (
    FITTED_ROWS,
    LONGEST_GAP_US,
    Grid,
    Hole,
    bridge_rows,
    bridged_ranges,
    estimate_period_us,
    find_holes,
    find_places,
    fit_line,
    mend_stamps,
)
from fusion.readers.samples import SampleColumns
from fusion.readers.text_kernel import PAUSE
from fusion.readers.timing import find_gaps, flag_spans
from fusion.recording import MICROSECONDS, QualityFlag, Segment, Span

JITTER_PART = 0.25
"""Stamps that scatter by more than this part of a period are worth a word."""


def cut_stamped(columns: SampleColumns, wrap_us: int = 0) -> Grid:
    """Cut rows with stamps in microseconds. ``wrap_us``: where the stamps' counter starts over, 0 for never.

    Raises
    ------
    fusion.errors.UnusableTime, fusion.errors.UnknownRate
        The stamps give no even sampling at a usable rate.
    """
    stamps = columns.stamps
    period_us = estimate_period_us(stamps)
    counts = np.zeros(2, np.int64)
    mend_stamps(stamps, wrap_us, period_us, counts)
    holes = find_holes(stamps, period_us)
    cuts = [hole for hole in holes if hole.rows == 0]
    edges = [0, *(hole.row for hole in cuts), columns.rows]
    placed: list[Segment] = []
    jitter_us = 0.0
    clock_us = int(stamps[0])
    for k, (first, stop) in enumerate(pairwise(edges)):
        inside = [hole for hole in holes if first < hole.row < stop]
        segment, offset_us, residual_us = _fit_segment(columns, (first, stop), inside, period_us)
        reached_us = placed[-1].end_us if placed else 0
        if k and cuts[k - 1].gap_us == 0:
            # the clock was set: nothing says how long the break was, so the segment follows at once
            clock_us = int(stamps[first]) - reached_us
        start_us = round(int(stamps[first]) - clock_us + offset_us) if k else 0
        placed.append(replace(segment, start_us=max(reached_us, start_us)))
        jitter_us = max(jitter_us, residual_us)
    segments = tuple(placed)
    duration_us = segments[-1].end_us
    flags = _flag_time(columns, holes, (int(counts[0]), int(counts[1])), jitter_us / period_us)
    flags += flag_spans("W-GAP", [*find_gaps(segments, duration_us), *_bridged_spans(segments)])
    return Grid(segments, duration_us, flags, period_us, jitter_us)


def _fit_segment(
    columns: SampleColumns, rows: tuple[int, int], holes: list[Hole], period_us: float
) -> tuple[Segment, float, float]:
    """Return the segment (not placed yet), the fitted time of its first row, RMS scatter of its stamps."""
    first, stop = rows
    stamps = columns.stamps[first:stop]
    offset_us = jitter_us = 0.0
    if stop - first >= FITTED_ROWS:
        offset_us, period_us, jitter_us = fit_line(stamps, find_places(stop - first, holes, first))
    acc, gyr = columns.acc[first:stop], columns.gyr[first:stop]
    if holes:
        acc, gyr = bridge_rows(acc, holes, first), bridge_rows(gyr, holes, first)
    segment = Segment(0, MICROSECONDS / period_us, acc, gyr, bridged_ranges(holes, first))
    return segment, offset_us, jitter_us


def _bridged_spans(segments: tuple[Segment, ...]) -> list[Span]:
    return [
        Span(
            segment.start_us + round(first * MICROSECONDS / segment.rate_hz),
            round((stop - first) * MICROSECONDS / segment.rate_hz),
        )
        for segment in segments
        for first, stop in segment.bridged
    ]


def _flag_time(
    columns: SampleColumns, holes: list[Hole], counts: tuple[int, int], jitter: float
) -> tuple[QualityFlag, ...]:
    stamps = columns.stamps
    steps_us = [int(stamps[hole.row] - stamps[hole.row - 1]) for hole in holes]
    found = {
        "W-WRAP": counts[0],
        "W-CLOCK-FWD": counts[1] + sum(step > LONGEST_GAP_US for step in steps_us),
        "W-CLOCK-BACK": sum(step < 0 for step in steps_us),
        "W-JITTER": int(jitter > JITTER_PART),
    }
    return tuple(QualityFlag(code, count) for code, count in found.items() if count)


def cut_counted(columns: SampleColumns, rate_hz: float) -> Grid:
    """Cut rows that have numbers instead of stamps, at a rate that was told.

    A number that is skipped is a row that was there and could not be read; a pause is a break of unknown
    length, so the next segment follows at once.
    """
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
    flags = flag_spans("W-GAP", find_gaps(segments, duration_us))
    n_pauses = int(np.count_nonzero(np.diff(pauses)))
    if n_pauses:
        flags += (QualityFlag("W-PAUSE", n_pauses),)
    return Grid(tuple(segments), duration_us, flags, period_us, 0.0)
