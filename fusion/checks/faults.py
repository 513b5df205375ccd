"""Find rows that are not readings: not measured, from a dead or stuck channel, or isolated spikes.

Time that was not measured is missing. Sensor faults are excluded from the analysed time and flagged. A held
arm, an impact and a sensor on a table are not faults: with these limits no recording of the project gives a
false alarm, including taps on the sensor.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.checks.summary import BLOCK_ROWS, SensorSummary, measure_step, summarise
from acromion.fusion.errors import DeadSensor, UnusableTime
from acromion.fusion.numba_kernels import inner, kernel
from acromion.fusion.recording import (
    LONGEST_BRIDGE_US,
    MICROSECONDS,
    Recording,
    Segment,
    Span,
    flag_gaps,
    flag_spans,
    join_overlapping,
)
from acromion.fusion.runs import find_runs

Rows = NDArray[np.int64]
"""Ranges of rows, shape (m, 2): first row and first row after, in order."""
Values = NDArray[np.float32]
Pair = tuple[int, int]


# Ranges of rows: find them, convert them to time, and remove them from a segment.


def find_held_runs(acc: SensorSummary, gyr: SensorSummary, shortest_rows: int, axes: Pair = (0, 3)) -> Rows:
    """Return the runs in which the axes (first, first after) of both sensors keep their values."""
    if not all(sensor.keeps(axis, shortest_rows) for sensor in (acc, gyr) for axis in range(*axes)):
        return np.empty((0, 2), np.int64)
    runs = np.empty((len(acc.samples) // max(shortest_rows - 1, 1) + 1, 2), np.int64)
    return runs[: _find_held(acc.samples, gyr.samples, shortest_rows, axes, runs)]


@kernel
def _find_held(acc: Any, gyr: Any, shortest_rows: int, axes: Any, runs: Any) -> int:  # pragma: no cover
    """Such a run contains one of any ``shortest - 1`` consecutive repeats: only check rows around these."""
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
    """Return whether a row equals the previous one on some axes of both sensors."""
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
    """Return the pieces of a segment without some of its rows.

    Pieces begin at whole microseconds, but none ends after the segment.
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


# Rows that were not measured: zeros on all six channels, and repeated last values.
#
# A measuring sensor never reads zero on all channels at once: at rest there is gravity, in free fall there is
# noise. It also never reads the same value on the axes of both sensors at a size that gravity cannot have,
# such as -1 (all bits set) from a chip that does not answer. A program wrote such rows, or repeats of the
# last value, into a gap of any length. Their time is missing: up to 50 ms it is bridged for the filters only,
# like any gap; a longer one ends the segment.

HELD_S, HELD_ROWS = 0.5, 50
"""A sensor of this kind is never this quiet: identical readings on six channels for this long and this many
rows.
"""
BLIND_S, BLIND_ROWS = 0.05, 5
"""Three exact zeros of an accelerometer alone, for this long, are not free fall, because it has noise."""
LEAST_PART, MOST_TIMES = 0.1, 3.0
"""If all axes read the same, each reads 0.58 of gravity."""
COARSE_STEPS = 5.0
LOOKED_AT_ROWS = 10_000
MOST_RUNS_SHARE, FREE_RUNS = 0.1, 100
"""If more than one row in ten starts a gap, the file is not evenly sampled (see
acromion.fusion.readers.time.grid).
"""


def leave_out_zeros(recording: Recording) -> Recording:
    """Treat rows that are zero on all six channels, or otherwise not readings, as missing (W-STUCK-PART).

    If no row is left, the recording is returned unchanged: the sensor is dead.

    Raises UnusableTime: one row in ten starts such a gap.
    """
    usual = max(measure_usual(segment.acc_g) for segment in recording.segments)
    found = [_find_fillers(segment, usual) for segment in recording.segments]
    return _leave_out(recording, found, "zeros")


def leave_out_held(recording: Recording) -> Recording:
    """Treat long runs of rows that repeat the last measured one as missing (W-STUCK-PART)."""
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
    """Mark rows with the same absolute value on all axes of each sensor, if gravity cannot have it, (n,).

    ``usual_g``: usual length of the acceleration. A sensor that does not answer reads like this: 0, or -1
    count.
    """
    marked = _mark_equal(acc, LEAST_PART * usual_g, MOST_TIMES * usual_g)
    if marked.any():  # few files have such rows
        marked &= _mark_equal(gyr, np.inf, np.inf)
    return marked


def _mark_equal(values: Values, low: float, high: float) -> NDArray[np.bool_]:
    """Mark the rows with the same absolute value on all axes, under ``low`` or over ``high``, shape (n,)."""
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
    """Return such rows of both sensors, in any number, or of one sensor for at least 50 ms.

    A gyroscope with coarse counts rests at zero or next to it; it does not keep any other value on all axes
    at once.
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
    """Return whether this many runs are too frequent to be gaps."""
    return runs > MOST_RUNS_SHARE * rows + FREE_RUNS


def _leave_out(recording: Recording, found: Sequence[Rows], filled: str) -> Recording:
    lost = sum(int((runs[:, 1] - runs[:, 0]).sum()) for runs in found)
    rows = sum(len(segment) for segment in recording.segments)
    if lost == 0 or rows - lost <= len(recording.segments):
        return recording
    pairs = list(zip(recording.segments, found, strict=True))
    spans = [place_rows(segment, int(a), int(b)) for segment, runs in pairs for a, b in runs]
    segments = tuple(piece for segment, runs in pairs for piece in _remove_rows(segment, runs))
    flags = tuple(flag for flag in recording.flags if flag.code != Caveat.GAP)
    flags += flag_gaps(segments, recording.duration_us, recording.excluded)
    flags += flag_spans(Caveat.STUCK_PART, spans, filled=filled)
    return replace(recording, segments=segments, flags=flags)


def _remove_rows(segment: Segment, runs: Rows) -> list[Segment]:
    """Return the pieces of a segment without some runs of rows; short runs are bridged in place."""
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


# Stretches in which a channel or a whole sensor was stuck: find them, and exclude them from the analysis.

SENSORS = ("accelerometer", "gyroscope")
STUCK_S, STUCK_ROWS = 0.5, 40
"""An axis is stuck if it keeps one value this long while something moves and the sensor's other axes show
noise.
"""
LONG_S = 2.0
"""After this long it is enough that any other axis moves."""
SILENT_S = 0.5
"""A sensor that keeps its three values this long while the other one moves does not respond."""
COARSE_PART, LIVE_PART = 0.5, 0.25
"""Least share of repeated rows of a coarse channel, and the most of one with noise."""
MOVING_G, MOVING_DPS = 0.15, 30.0
MOVED_G, MOVED_DPS = 0.05, 5.0
FAR_STEPS = 20.0
"""Steps of a coarse sensor: an axis is stuck while another one is farther than this from its median for two
seconds. In 2 h of real movement, rounded to two decimals or to 10 bits, the longest such time is 0.5 s.
"""


def exclude_stuck(recording: Recording) -> Recording:
    """Exclude stretches with a stuck channel from the analysed time, and flag them (W-STUCK-PART).

    Each stretch ends the segment. The search may be repeated once the units are known.
    """
    segments = recording.segments
    pairs = list(zip(segments, _find_stuck(segments), strict=True))
    stuck = [
        place_rows(segment, *rows, "stuck")
        for segment, some in pairs
        for rows in _exclude_bridged(segment, some)
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


def _exclude_bridged(segment: Segment, stuck: Sequence[Pair]) -> list[Pair]:
    """Return the rows of ``stuck`` outside gaps that were already bridged: those stay missing time."""
    is_stuck = np.zeros(len(segment) if stuck else 0, np.bool_)
    for first, stop in stuck:
        is_stuck[first:stop] = True
    for first, stop in segment.bridged:
        is_stuck[first:stop] = False
    return [(first, stop) for first, stop in find_runs(is_stuck).tolist()]


def _find_stuck(segments: Sequence[Segment]) -> list[list[Pair]]:
    """Return the rows of each segment, in order, in which a channel or a whole sensor was stuck."""
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
            if not any(map(len, runs)):
                continue
            is_coarse, step = any(_is_coarse(samples, axis, runs) for axis in axes), measure_step(samples)
            for rows, segment, some in zip(found, segments, runs, strict=True):
                rows += [
                    (a, b)
                    for a, b in some.tolist()
                    if _is_stuck(segment, sensor, axes, (a, b), step, is_coarse=is_coarse)
                ]
    return [join_overlapping(some) for some in found]


def _read(segment: Segment, sensor: int) -> Values:
    return segment.gyr_dps if sensor else segment.acc_g


def _is_stuck(
    segment: Segment, sensor: int, axes: tuple[int, ...], rows: Pair, step: float, *, is_coarse: bool
) -> bool:
    """Return whether a constant value is a fault: of a sensor if anything moves, of an axis as in STUCK_S.

    Coarse steps explain it, unless the arm clearly moves: the axis is coarse, or another axis of the sensor
    changes in the same rows, but seldom. ``step``: that of the sensor.
    """
    first, stop = rows
    is_long = stop - first >= LONG_S * segment.rate_hz
    if is_coarse and not is_long:
        return False
    ranges = [np.ptp(_read(segment, one)[first:stop], axis=0).max() for one in range(2)]
    steps = np.diff(np.delete(_read(segment, sensor)[first:stop], axes, axis=1), axis=0)
    repeats = (steps == 0.0).mean(axis=0)
    if is_coarse or ((repeats > COARSE_PART) & steps.any(axis=0)).any():
        return _moves_far(segment, sensor, axes, rows, step)
    if (is_long or len(axes) > 1) and bool(ranges[0] > MOVING_G or ranges[1] > MOVING_DPS):
        return True
    is_live = len(axes) == 1 and bool(repeats.max() < LIVE_PART)
    return is_live and bool(ranges[0] > MOVED_G or ranges[1] > MOVED_DPS)


def _moves_far(segment: Segment, sensor: int, axes: tuple[int, ...], rows: Pair, step: float) -> bool:
    """Return whether the other axes, or the other sensor if all are constant, move far for two seconds."""
    first, stop = rows
    if len(axes) == 1:
        values = np.delete(_read(segment, sensor)[first:stop], axes, axis=1)
        far = max(FAR_STEPS * step, (MOVED_G, MOVED_DPS)[sensor])
    else:
        values = _read(segment, 1 - sensor)[first:stop]
        far = (MOVING_DPS, MOVING_G)[sensor]
    away = np.abs(values - np.median(values, axis=0)).max(axis=1)
    return bool(np.count_nonzero(away > far) >= LONG_S * segment.rate_hz)


def _is_coarse(samples: Sequence[Values], axis: int, runs: Sequence[Rows]) -> bool:
    """Return whether a channel repeats its value so often elsewhere that flat stretches prove nothing."""
    inside = sum(int((some[:, 1] - some[:, 0] - 1).sum()) for some in runs)
    elsewhere = sum(len(values) - 1 for values in samples) - inside
    repeats = sum(int(np.count_nonzero(values[1:, axis] == values[:-1, axis])) for values in samples)
    return repeats - inside > COARSE_PART * elsewhere


# Channels with a single value, and readings far outside their neighbours.

DEAD_US = 10 * MICROSECONDS
SPIKE_RATIO = 20.0
"""A spike exceeds the steps around it by this factor; hard taps on a sensor reach 10."""
LEAST_SPIKE_G, LEAST_SPIKE_DPS = 1.0, 150.0
AROUND_ROWS = 5


def refuse_dead(recording: Recording) -> Recording:
    """Return the recording; raises DeadSensor if a channel has one value throughout."""
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
    """Exclude spikes and stretches with a stuck channel from the analysed time, and flag them.

    Spikes are replaced in place by the mean of their neighbours, for the filters only. ``searched``: the
    recording after the last search for stuck channels; it is only searched again if it has a new flag.
    """
    spikes: list[Span] = []
    segments = []
    for segment in recording.segments:
        marked = np.zeros(len(segment), np.bool_)
        for sensor, least in zip(summarise(segment), (LEAST_SPIKE_G, LEAST_SPIKE_DPS), strict=True):
            blocks = np.flatnonzero((sensor.step >= least).any(axis=0))
            if len(blocks):
                _repair_blocks(sensor.samples, least, blocks, marked)
        rows = np.flatnonzero(marked).tolist()
        spikes += [place_rows(segment, row, row + 1, "spikes") for row in rows]
        # the samples changed, so the segment must be a new object
        segments.append(replace(segment) if rows else segment)
    if spikes:
        flags = (*recording.flags, *flag_spans(Caveat.SPIKE, spikes))
        excluded = (*recording.excluded, *spikes)
        recording = replace(recording, segments=tuple(segments), excluded=excluded, flags=flags)
    is_same = searched is not None and _find_notes(recording) == _find_notes(searched)
    return recording if is_same else exclude_stuck(recording)


def _find_notes(recording: Recording) -> tuple[object, object]:
    return recording.flags, recording.understood


@kernel
def _repair_blocks(values: Any, least: float, blocks: Any, marked: Any) -> None:  # pragma: no cover
    """Replace single readings far outside their neighbours, in the blocks with such a step; mark the rows.

    Compared to Hampel's filter (median and MAD of a window): the reading must differ from both neighbours in
    the same direction, these must agree, and every step of the five rows on either side must be far smaller.
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
    """Return the largest step among the five rows on either side, and across the row."""
    largest = abs(values[row + 1, axis] - values[row - 1, axis])
    for k in range(1, AROUND_ROWS + 1):
        before = abs(values[row - k, axis] - values[row - k - 1, axis])
        after = abs(values[row + k + 1, axis] - values[row + k, axis])
        largest = max(largest, before, after)
    return largest
