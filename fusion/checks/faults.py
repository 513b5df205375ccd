"""Rows that are no readings: not measured, of a channel that is dead or stuck for a time, isolated spikes.

What was not measured is missing time; the faults of a sensor are excluded from the analysed time and flagged.
A held arm, an impact and a sensor on a table are no faults: at these limits none of the recordings in hand,
taps on the sensor included, gives a false alarm.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.checks.summary import BLOCK_ROWS, SensorSummary, summarise
from fusion.errors import DeadSensor, UnusableTime
from fusion.numba_kernels import inner, kernel
from fusion.recording import (
    LONGEST_BRIDGE_US,
    MICROSECONDS,
    Recording,
    Segment,
    Span,
    flag_gaps,
    flag_spans,
    join_overlapping,
)
from fusion.runs import find_runs

Rows = NDArray[np.int64]
"""Ranges of rows, shape (m, 2): first row and first row after, in order."""
Values = NDArray[np.float32]
Pair = tuple[int, int]


# Ranges of rows: found, placed in time, and taken out of a segment.


def find_held_runs(acc: SensorSummary, gyr: SensorSummary, shortest_rows: int, axes: Pair = (0, 3)) -> Rows:
    """Return the runs in which some axes (first, first after) of both sensors keep their values."""
    if not all(sensor.keeps(axis, shortest_rows) for sensor in (acc, gyr) for axis in range(*axes)):
        return np.empty((0, 2), np.int64)
    runs = np.empty((len(acc.samples) // max(shortest_rows - 1, 1) + 1, 2), np.int64)
    return runs[: _find_held(acc.samples, gyr.samples, shortest_rows, axes, runs)]


@kernel
def _find_held(acc: Any, gyr: Any, shortest_rows: int, axes: Any, runs: Any) -> int:  # pragma: no cover
    """Such a run holds one of any ``shortest - 1`` repeats that follow each other: look around these only."""
    stride = max(shortest_rows - 1, 1)
    found, k = 0, stride
    while k < len(acc):
        first, stop = k, k
        while first > 0 and k - first < shortest_rows and _is_repeat(acc, gyr, first, axes):
            first -= 1
        while first < k and stop < len(acc) and _is_repeat(acc, gyr, stop, axes):
            stop += 1
        if stop - first >= shortest_rows:
            runs[found, 0], runs[found, 1] = first, stop
            found += 1
        k = max(k, stop - 1) + stride
    return found


@inner
def _is_repeat(acc: Any, gyr: Any, row: int, axes: Any) -> bool:  # pragma: no cover
    """Whether a row equals the one before on some axes of both sensors."""
    for axis in range(axes[0], axes[1]):
        if acc[row, axis] != acc[row - 1, axis] or gyr[row, axis] != gyr[row - 1, axis]:
            return False
    return True


def place_rows(segment: Segment, first_row: int, stop_row: int, reason: str = "") -> Span:
    """Return rows as a stretch of the recording."""
    start_us, end_us = (
        segment.start_us + round(row * MICROSECONDS / segment.rate_hz) for row in (first_row, stop_row)
    )
    return Span(start_us, end_us - start_us, reason)


def cut_rows(segment: Segment, ranges: Sequence[Pair]) -> list[Segment]:
    """Return what is left of a segment without some of its rows.

    Pieces begin at whole microseconds, yet none lasts beyond the end of the segment.
    """
    if not ranges:
        return [segment]
    edges = [0, *(row for pair in ranges for row in pair), len(segment)]
    pieces = []
    for first, stop in zip(edges[::2], edges[1::2], strict=True):
        if stop <= first:
            continue
        bridged = [(max(a, first) - first, min(b, stop) - first) for a, b in segment.bridged]
        piece = replace(
            segment,
            start_us=place_rows(segment, 0, first).end_us,
            acc_g=segment.acc_g[first:stop],
            gyr_dps=segment.gyr_dps[first:stop],
            bridged=tuple((a, b) for a, b in bridged if b > a),
        )
        pieces.append(replace(piece, start_us=piece.start_us - max(0, piece.end_us - segment.end_us)))
    return pieces


# Rows in which nothing was measured: zeros on all six channels, and values that were carried forward.
#
# A sensor that measures never reads zero on all channels at once: at rest there is gravity, in free fall
# there is noise. Nor does it read one and the same on the axes of both sensors, at a size that gravity does
# not have, as -1 (all bits set) of a chip that does not answer. Such rows fill a hole, however short, as
# repeats do that a program wrote. Their time is missing: up to 50 ms it is bridged for the filters only, like
# any hole; longer, the segment ends.

HELD_S, HELD_ROWS = 0.5, 50
"""Identical readings on six channels for so long and so often: no sensor of this kind is that quiet."""
BLIND_S, BLIND_ROWS = 0.05, 5
"""Three exact zeros of an accelerometer alone, for so long and so often, are no free fall: it has noise."""
LEAST_PART, MOST_TIMES = 0.1, 3.0
"""An axis reads 0.58 of gravity where all read alike."""
COARSE_STEPS = 5.0
LOOKED_AT_ROWS = 10_000
MOST_RUNS_SHARE, FREE_RUNS = 0.1, 100
"""One row in ten that begins a hole is no sampling, as with stamps (fusion.readers.time.grid)."""


def leave_out_zeros(recording: Recording) -> Recording:
    """Take rows that are zero on all six channels, or otherwise no reading, for missing (W-STUCK-PART).

    Where no row is left, the recording comes back as it is: the sensor is dead.

    Raises UnusableTime: one row in ten begins such a hole.
    """
    usual = max(measure_usual(segment.acc_g) for segment in recording.segments)
    found = [_find_fillers(segment, usual) for segment in recording.segments]
    return _leave_out(recording, found, "zeros")


def leave_out_held(recording: Recording) -> Recording:
    """Take rows that only repeat the last measured one, for long, for missing (W-STUCK-PART)."""
    found = []
    for segment in recording.segments:
        runs = find_held_runs(*summarise(segment), max(HELD_ROWS, round(HELD_S * segment.rate_hz)))
        runs[:, 0] += 1  # the row that they repeat was measured
        found.append(runs)
    return _leave_out(recording, found, "held")


def measure_usual(acc: Values) -> float:
    """Return the median length of the acceleration, in its unit, over some of the rows that are not zero."""
    rows = acc[:: max(1, len(acc) // LOOKED_AT_ROWS)]
    lengths = np.linalg.norm(rows[rows.any(axis=1)], axis=1)
    return float(np.median(lengths)) if len(lengths) else 0.0


def mark_fillers(acc: Values, gyr: Values, usual_g: float) -> NDArray[np.bool_]:
    """Mark rows with one size on all axes of each sensor, of the first one that gravity cannot have, (n,).

    ``usual_g``: length of the acceleration as a rule. So reads a sensor that does not answer: 0, or -1 count.
    """
    marked = _mark_equal(acc, LEAST_PART * usual_g, MOST_TIMES * usual_g)
    if marked.any():  # few files have such
        marked &= _mark_equal(gyr, np.inf, np.inf)
    return marked


def _mark_equal(values: Values, low: float, high: float) -> NDArray[np.bool_]:
    """Mark the rows that show one size on all axes, under ``low`` or over ``high``, shape (n,)."""
    marked = np.empty(len(values), np.bool_)
    _fill_equal(values, low, high, marked)
    return marked


@kernel
def _fill_equal(values: Any, low: float, high: float, marked: Any) -> None:  # pragma: no cover
    for row in range(len(values)):
        size = abs(values[row, 0])
        is_equal = size == abs(values[row, 1]) and size == abs(values[row, 2])
        marked[row] = is_equal and (size < low or size > high)


def _find_fillers(segment: Segment, usual_g: float) -> Rows:
    """Find rows of both sensors, however few; of one of them, for 50 ms.

    A gyroscope of coarse counts rests at zero, or next to it; any other value on all its axes at once it does
    not keep.
    """
    acc, gyr = segment.acc_g, segment.gyr_dps
    shortest = max(BLIND_ROWS, round(BLIND_S * segment.rate_hz))
    blind = find_runs(_mark_equal(gyr, 0.0, 0.0), shortest)
    if len(blind):
        sizes = np.abs(gyr[:: max(1, len(gyr) // LOOKED_AT_ROWS)])
        smallest = float(np.min(sizes, where=sizes > 0.0, initial=np.inf))
        blind = blind[np.abs(gyr[blind[:, 0], 0]) > COARSE_STEPS * smallest]
    found = [blind]
    is_blind = _mark_equal(acc, LEAST_PART * usual_g, MOST_TIMES * usual_g)
    if is_blind.any():
        fillers = find_runs(is_blind & _mark_equal(gyr, np.inf, np.inf))
        if is_too_frequent(len(fillers), len(segment)):
            raise UnusableTime(why="irregular")
        found += [fillers, find_runs(is_blind, shortest)]
    joined = join_overlapping((int(a), int(b)) for runs in found for a, b in runs)
    return np.array(joined, np.int64).reshape(-1, 2)


def is_too_frequent(runs: int, rows: int) -> bool:
    """Return whether so many runs of rows are no holes of a sampling."""
    return runs > MOST_RUNS_SHARE * rows + FREE_RUNS


def _leave_out(recording: Recording, found: Sequence[Rows], filled: str) -> Recording:
    lost = sum(int((runs[:, 1] - runs[:, 0]).sum()) for runs in found)
    rows = sum(len(segment) for segment in recording.segments)
    if lost == 0 or rows - lost <= len(recording.segments):
        return recording
    pairs = list(zip(recording.segments, found, strict=True))
    spans = [place_rows(segment, int(a), int(b)) for segment, runs in pairs for a, b in runs]
    segments = tuple(piece for segment, runs in pairs for piece in _open_hole(segment, runs))
    flags = tuple(flag for flag in recording.flags if flag.code != Caveat.GAP)
    flags += flag_gaps(segments, recording.duration_us, recording.excluded)
    flags += flag_spans(Caveat.STUCK_PART, spans, filled=filled)
    return replace(recording, segments=segments, flags=flags)


def _open_hole(segment: Segment, runs: Rows) -> list[Segment]:
    """Return what is left of a segment without some runs of rows; the short ones are bridged, in place."""
    if len(runs) == 0:
        return [segment]
    bridged = set(segment.bridged)
    every = join_overlapping([*bridged, *((int(first), int(stop)) for first, stop in runs)])
    holes = [pair for pair in every if pair not in bridged]
    most_rows = int(LONGEST_BRIDGE_US * segment.rate_hz / MICROSECONDS + 1e-3) - 1
    short = {(a, b) for a, b in holes if a > 0 and b < len(segment) and b - a <= most_rows}
    for first, stop in short:
        weights = np.linspace(0.0, 1.0, stop - first + 2)[1:-1, None]
        for values in (segment.acc_g, segment.gyr_dps):
            values[first:stop] = (1.0 - weights) * values[first - 1] + weights * values[stop]
    kept = replace(segment, bridged=tuple(pair for pair in every if pair in short or pair in bridged))
    return cut_rows(kept, [pair for pair in holes if pair not in short])


# Stretches in which a channel, or a whole sensor, stuck: found, and taken out of the analysed time.

SENSORS = ("accelerometer", "gyroscope")
STUCK_S, STUCK_ROWS = 0.5, 40
"""An axis keeps one value so long, while something moves and the sensor's others show noise: it stuck."""
LONG_S = 2.0
"""So long, it is enough that any other moves."""
SILENT_S = 0.5
"""So long a whole sensor keeps its three values only where it does not answer, while the other moves."""
COARSE_PART, LIVE_PART = 0.5, 0.25
"""How many of its rows a coarse channel repeats, at least, and one with noise, at most."""
MOVING_G, MOVING_DPS = 0.15, 30.0
MOVED_G, MOVED_DPS = 0.05, 5.0


def exclude_stuck(recording: Recording) -> Recording:
    """Exclude the stretches in which a channel stuck from the analysed time, and flag them (W-STUCK-PART).

    Each ends the segment. The search may be repeated once the units are known.
    """
    segments = recording.segments
    pairs = list(zip(segments, _find_stuck(segments), strict=True))
    stuck = [
        place_rows(segment, *rows, "stuck") for segment, some in pairs for rows in _leave_holes(segment, some)
    ]
    if not stuck:
        return recording
    kept = tuple(piece for segment, some in pairs for piece in cut_rows(segment, some))
    excluded = (*recording.excluded, *stuck)
    spans = sorted((span for span in excluded if span.reason == "stuck"), key=lambda span: span.start_us)
    others = (
        flag
        for flag in recording.flags
        if not (flag.code == Caveat.STUCK_PART and flag.facts.get("filled") == "stuck")
    )
    flags = (*others, *flag_spans(Caveat.STUCK_PART, spans, filled="stuck"))
    return replace(recording, segments=kept or segments[:1], excluded=excluded, flags=flags)


def _leave_holes(segment: Segment, stuck: Sequence[Pair]) -> list[Pair]:
    """Return the rows of ``stuck`` without the holes that were bridged before: those stay missing time."""
    is_stuck = np.zeros(len(segment) if stuck else 0, np.bool_)
    for first, stop in stuck:
        is_stuck[first:stop] = True
    for first, stop in segment.bridged:
        is_stuck[first:stop] = False
    return [(first, stop) for first, stop in find_runs(is_stuck).tolist()]


def _find_stuck(segments: Sequence[Segment]) -> list[list[Pair]]:
    """Find the rows of each segment, apart and in order, in which a channel, or a whole sensor, stuck."""
    found: list[list[Pair]] = [[] for _ in segments]
    for sensor in range(2):
        samples = [_read(segment, sensor) for segment in segments]
        for axes in ((0,), (1,), (2,), (0, 1, 2)):
            length_s, least_rows = (STUCK_S, STUCK_ROWS) if len(axes) == 1 else (SILENT_S, 2)
            runs = []
            for segment in segments:
                seen, shortest = (
                    summarise(segment)[sensor],
                    max(round(length_s * segment.rate_hz), least_rows),
                )
                runs.append(find_held_runs(seen, seen, shortest, (axes[0], axes[-1] + 1)))
            if not any(map(len, runs)) or any(_is_coarse(samples, axis, runs) for axis in axes):
                continue
            for rows, segment, some in zip(found, segments, runs, strict=True):
                rows += [(a, b) for a, b in some.tolist() if _is_stuck(segment, sensor, axes, (a, b))]
    return [join_overlapping(some) for some in found]


def _read(segment: Segment, sensor: int) -> Values:
    return segment.gyr_dps if sensor else segment.acc_g


def _is_stuck(segment: Segment, sensor: int, axes: tuple[int, ...], rows: Pair) -> bool:
    """Whether what keeps its value should not: a sensor while anything moves, an axis as STUCK_S says.

    An axis is not stuck if coarse steps explain it: another axis of the sensor changes in the same rows, but
    seldom.
    """
    first, stop = rows
    ranges = [np.ptp(_read(segment, one)[first:stop], axis=0).max() for one in range(2)]
    steps = np.diff(np.delete(_read(segment, sensor)[first:stop], axes, axis=1), axis=0)
    repeats = (steps == 0.0).mean(axis=0)
    if ((repeats > COARSE_PART) & steps.any(axis=0)).any():
        return False
    is_long = len(axes) > 1 or stop - first >= LONG_S * segment.rate_hz
    if is_long and bool(ranges[0] > MOVING_G or ranges[1] > MOVING_DPS):
        return True
    is_live = len(axes) == 1 and bool(repeats.max() < LIVE_PART)
    return is_live and bool(ranges[0] > MOVED_G or ranges[1] > MOVED_DPS)


def _is_coarse(samples: Sequence[Values], axis: int, runs: Sequence[Rows]) -> bool:
    """Whether a channel repeats its value so often elsewhere too that flat stretches prove nothing."""
    inside = sum(int((some[:, 1] - some[:, 0] - 1).sum()) for some in runs)
    elsewhere = sum(len(values) - 1 for values in samples) - inside
    repeats = sum(int(np.count_nonzero(values[1:, axis] == values[:-1, axis])) for values in samples)
    return repeats - inside > COARSE_PART * elsewhere


# Channels with one value throughout, and readings far outside of their neighbours.

DEAD_US = 10 * MICROSECONDS
SPIKE_RATIO = 20.0
"""A spike stands out of the steps around it by this factor: hard taps on a sensor reach 10."""
LEAST_SPIKE_G, LEAST_SPIKE_DPS = 1.0, 150.0
AROUND_ROWS = 5


def refuse_dead(recording: Recording) -> Recording:
    """Return the recording unless a channel has one value throughout; raises DeadSensor."""
    if sum(segment.duration_us for segment in recording.segments) < DEAD_US:
        return recording
    for sensor, name in enumerate(SENSORS):
        seen = [summarise(segment)[sensor] for segment in recording.segments]
        ends = np.concatenate([end for one in seen for end in (one.low, one.high)], axis=1)
        dead = "".join("xyz"[axis] for axis in range(3) if (ends[axis] == ends[axis, 0]).all())
        if dead == "xyz":
            raise DeadSensor(sensor=name)
        if dead:
            raise DeadSensor(sensor=name, axis=", ".join(dead))
    return recording


def exclude_faults(recording: Recording, searched: Recording | None = None) -> Recording:
    """Exclude spikes, and stretches in which a channel stuck, from the analysed time, and flag them.

    Spikes are replaced by the mean of their neighbours, for the filters only, in place. ``searched``: the
    recording as the last search for stuck channels left it; it is not searched again without a new flag.
    """
    spikes: list[Span] = []
    segments = []
    for segment in recording.segments:
        marked = np.zeros(len(segment), np.bool_)
        for sensor, least in zip(summarise(segment), (LEAST_SPIKE_G, LEAST_SPIKE_DPS), strict=True):
            blocks = np.flatnonzero((sensor.step >= least).any(axis=0))
            if len(blocks):
                _mend_blocks(sensor.samples, least, blocks, marked)
        rows = np.flatnonzero(marked).tolist()
        spikes += [place_rows(segment, row, row + 1, "spikes") for row in rows]
        segments.append(replace(segment) if rows else segment)  # other samples, another object
    if spikes:
        flags = (*recording.flags, *flag_spans(Caveat.SPIKE, spikes))
        excluded = (*recording.excluded, *spikes)
        recording = replace(recording, segments=tuple(segments), excluded=excluded, flags=flags)
    is_same = searched is not None and _find_notes(recording) == _find_notes(searched)
    return recording if is_same else exclude_stuck(recording)


def _find_notes(recording: Recording) -> tuple[object, object]:
    return recording.flags, recording.understood


@kernel
def _mend_blocks(values: Any, least: float, blocks: Any, marked: Any) -> None:  # pragma: no cover
    """Replace single readings far outside of their neighbours, in the blocks with such a step; mark the rows.

    Compared to Hampel's filter (median and MAD of a window): the reading must leave both neighbours the same
    way, they must agree, and every step of the five rows on either side must be far smaller.
    """
    last = len(values) - AROUND_ROWS - 1
    for block in blocks:
        for row in range(max(block * BLOCK_ROWS, AROUND_ROWS + 1), min((block + 1) * BLOCK_ROWS, last)):
            for axis in range(3):
                up = values[row, axis] - values[row - 1, axis]
                down = values[row, axis] - values[row + 1, axis]
                height = min(abs(up), abs(down))
                if height < least or up * down <= 0.0:
                    continue
                if _measure_step(values, row, axis) * SPIKE_RATIO < height:
                    values[row, axis] = 0.5 * (values[row - 1, axis] + values[row + 1, axis])
                    marked[row] = True


@inner
def _measure_step(values: Any, row: int, axis: int) -> Any:  # pragma: no cover
    """The largest step among the five rows on either side, and from the one side to the other."""
    largest = abs(values[row + 1, axis] - values[row - 1, axis])
    for k in range(1, AROUND_ROWS + 1):
        before = abs(values[row - k, axis] - values[row - k - 1, axis])
        after = abs(values[row + k + 1, axis] - values[row + k, axis])
        largest = max(largest, before, after)
    return largest
