"""Rows in which nothing was measured: zeros on all six channels, and values that were carried forward.

A sensor that measures never reads zero on all channels at once: at rest there is gravity, in free fall there
is noise. Nor does it read one and the same on the axes of both sensors, at a size that gravity does not have,
as -1 (all bits set) of a chip that does not answer. Such rows fill a hole, however short, as repeats do that
a program wrote. Their time is missing: up to 50 ms it is bridged for the filters only, like any hole; longer,
the segment ends (CONTRACT §5).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.checks.stopped import (
    LEAST_PART,
    MOST_TIMES,
    Rows,
    cut_rows,
    find_held_runs,
    find_runs,
    mark_equal,
    place_rows,
)
from fusion.checks.summary import SegmentSummary, Summaries, summarise
from fusion.errors import UnusableTime
from fusion.numerics.intervals import join_overlapping
from fusion.recording import (
    LONGEST_BRIDGE_US,
    MICROSECONDS,
    Recording,
    Segment,
    flag_gaps,
    flag_spans,
)

HELD_S, HELD_ROWS = 0.5, 50
"""Identical readings on six channels for so long and so often: no sensor of this kind is that quiet."""
BLIND_S, BLIND_ROWS = 0.05, 5
"""Three exact zeros of an accelerometer alone, for so long and so often, are no free fall: it has noise."""
COARSE_STEPS = 5.0
LOOKED_AT_ROWS = 10_000
MOST_RUNS_SHARE, FREE_RUNS = 0.1, 100
"""One row in ten that begins a hole is no sampling, as with stamps (fusion.readers.timebase.grid)."""


def leave_out_zeros(recording: Recording) -> Recording:
    """Take rows that are zero on all six channels, or otherwise no reading, for missing (W-STUCK-PART).

    Where no row is left, the recording comes back as it is: the sensor is dead.

    Raises
    ------
    UnusableTime
        One row in ten begins such a hole.
    """
    usual = max(measure_usual(segment.acc_g) for segment in recording.segments)
    found = [_find_fillers(segment, usual) for segment in recording.segments]
    return _leave_out(recording, found, "zeros")


def leave_out_held(recording: Recording, known: Summaries = ()) -> Recording:
    """Take rows that only repeat the last measured one, for long, for missing (W-STUCK-PART)."""
    found = [_find_held(one) for one in summarise(recording.segments, known)]
    return _leave_out(recording, found, "held")


def measure_usual(acc: NDArray[np.float32]) -> float:
    """The median length of the acceleration, in its unit, over some of the rows that are not zero."""
    rows = acc[:: max(1, len(acc) // LOOKED_AT_ROWS)]
    lengths = np.linalg.norm(rows[rows.any(axis=1)], axis=1)
    return float(np.median(lengths)) if len(lengths) else 0.0


def _find_fillers(segment: Segment, usual_g: float) -> Rows:
    """Rows of both sensors, however few; of one of them, for 50 ms.

    A gyroscope of coarse counts rests at zero, or next to it; any other value on all its axes at once it does
    not keep.
    """
    acc, gyr = segment.acc_g, segment.gyr_dps
    shortest = max(BLIND_ROWS, round(BLIND_S * segment.rate_hz))
    blind = find_runs(mark_equal(gyr, 0.0, 0.0), shortest)
    found = [blind[np.abs(gyr[blind[:, 0], 0]) > COARSE_STEPS * _find_step(gyr)] if len(blind) else blind]
    is_blind = mark_equal(acc, LEAST_PART * usual_g, MOST_TIMES * usual_g)
    if is_blind.any():
        fillers = find_runs(is_blind & mark_equal(gyr, np.inf, np.inf))
        if is_too_frequent(len(fillers), len(segment)):
            raise UnusableTime(why="irregular")
        found += [fillers, find_runs(is_blind, shortest)]
    joined = join_overlapping((int(a), int(b)) for runs in found for a, b in runs)
    return np.array(joined, np.int64).reshape(-1, 2)


def _find_step(values: NDArray[np.float32]) -> float:
    """The smallest reading that is not zero, over some of the rows."""
    sizes = np.abs(values[:: max(1, len(values) // LOOKED_AT_ROWS)])
    return float(np.min(sizes, where=sizes > 0.0, initial=np.inf))


def _find_held(seen: SegmentSummary) -> Rows:
    """Runs of repeats; the row that they repeat was measured."""
    shortest = max(HELD_ROWS, round(HELD_S * seen.segment.rate_hz))
    runs = find_held_runs(seen.acc, seen.gyr, shortest)
    runs[:, 0] += 1
    return runs


def _leave_out(recording: Recording, found: Sequence[Rows], filled: str) -> Recording:
    lost = sum(int((runs[:, 1] - runs[:, 0]).sum()) for runs in found)
    rows = sum(len(segment) for segment in recording.segments)
    if lost == 0 or rows - lost <= len(recording.segments):
        return recording
    pairs = list(zip(recording.segments, found, strict=True))
    spans = [place_rows(segment, int(a), int(b)) for segment, runs in pairs for a, b in runs]
    segments = tuple(piece for segment, runs in pairs for piece in open_hole(segment, runs))
    flags = tuple(flag for flag in recording.flags if flag.code != Caveat.GAP)
    flags += flag_gaps(segments, recording.duration_us, recording.excluded)
    flags += flag_spans(Caveat.STUCK_PART, spans, filled=filled)
    return replace(recording, segments=segments, flags=flags)


def open_hole(segment: Segment, runs: Rows) -> list[Segment]:
    """What is left of a segment without some runs of rows; the short ones are bridged, in place."""
    if len(runs) == 0:
        return [segment]
    bridged = set(segment.bridged)
    every = join_overlapping([*bridged, *((int(first), int(stop)) for first, stop in runs)])
    holes = [pair for pair in every if pair not in bridged]
    most_rows = int(LONGEST_BRIDGE_US * segment.rate_hz / MICROSECONDS + 1e-3) - 1
    is_short = {(a, b): a > 0 and b < len(segment) and b - a <= most_rows for a, b in holes}
    short = [pair for pair in holes if is_short[pair]]
    for first, stop in short:
        bridge_rows(segment.acc_g, first, stop)
        bridge_rows(segment.gyr_dps, first, stop)
    kept = replace(segment, bridged=tuple(pair for pair in every if is_short.get(pair, True)))
    return cut_rows(kept, [pair for pair in holes if not is_short[pair]])


def bridge_rows(values: NDArray[np.float32], first_row: int, stop_row: int) -> None:
    """Lay a straight line over rows, in place, from the one before to the one after."""
    weights = np.linspace(0.0, 1.0, stop_row - first_row + 2)[1:-1, None]
    values[first_row:stop_row] = (1.0 - weights) * values[first_row - 1] + weights * values[stop_row]


def is_too_frequent(runs: int, rows: int) -> bool:
    """Whether so many runs of rows are no holes of a sampling."""
    return runs > MOST_RUNS_SHARE * rows + FREE_RUNS
