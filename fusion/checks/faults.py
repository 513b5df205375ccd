"""Faults of a sensor that show in its readings: a dead channel, one that stuck for a time, isolated spikes.

RELIABILITY.md §1.3, rows 89 and 90. A fault is excluded from the analysed time and flagged. A held arm, an
impact and a sensor on a table are no faults: at these limits none of the recordings in hand, taps on the
sensor included, gives a false alarm.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fusion.caveats import Caveat
from fusion.checks.stopped import (
    Ranges,
    Rows,
    Values,
    cut_rows,
    find_held_runs,
    place_rows,
)
from fusion.checks.summary import BLOCK_ROWS, SegmentSummary, SensorSummary, Summaries, summarise
from fusion.errors import DeadSensor
from fusion.numba_kernels import inner, kernel
from fusion.numerics.intervals import join_overlapping
from fusion.recording import (
    MICROSECONDS,
    QualityFlag,
    Recording,
    Segment,
    Span,
    flag_spans,
)

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

Pair = tuple[int, int]


def exclude_stuck(recording: Recording, known: Summaries = ()) -> Recording:
    """Exclude the stretches in which a channel stuck from the analysed time, and flag them (W-STUCK-PART).

    Each ends the segment. The search may be repeated once the units are known.
    """
    segments = recording.segments
    seen = summarise(segments, known)
    pairs = list(zip(segments, find_stuck_rows(seen), strict=True))
    stuck = [
        place_rows(segment, *rows, "stuck") for segment, some in pairs for rows in _leave_holes(segment, some)
    ]
    if not stuck:
        return recording
    kept = tuple(piece for segment, some in pairs for piece in cut_rows(segment, some))
    excluded = (*recording.excluded, *stuck)
    others = (flag for flag in recording.flags if not _is_stuck_flag(flag))
    return replace(
        recording,
        segments=kept or segments[:1],
        excluded=excluded,
        flags=(*others, *_flag_stuck(excluded)),
    )


def _leave_holes(segment: Segment, stuck: Ranges) -> list[Pair]:
    """Rows of ``stuck`` without the holes that were bridged before: those stay missing time."""
    if not stuck:
        return []
    is_stuck = np.zeros(len(segment) + 1, np.bool_)
    for first, stop in stuck:
        is_stuck[first:stop] = True
    for first, stop in segment.bridged:
        is_stuck[first:stop] = False
    edges = np.flatnonzero(np.diff(is_stuck.view(np.int8), prepend=np.int8(0)))
    return [(first, stop) for first, stop in edges.reshape(-1, 2).tolist()]


def _is_stuck_flag(flag: QualityFlag) -> bool:
    return flag.code == Caveat.STUCK_PART and flag.facts.get("filled") == "stuck"


def _flag_stuck(excluded: tuple[Span, ...]) -> tuple[QualityFlag, ...]:
    spans = sorted((span for span in excluded if span.reason == "stuck"), key=lambda span: span.start_us)
    return flag_spans(Caveat.STUCK_PART, spans, filled="stuck")


def find_stuck_rows(seen: Summaries) -> list[list[Pair]]:
    """For each segment, row ranges, apart and in order, in which a channel, or a whole sensor, stuck."""
    found: list[list[Pair]] = [[] for _ in seen]
    for sensor in range(2):
        samples = [_read(one.segment, sensor) for one in seen]
        for axes in ((0,), (1,), (2,), (0, 1, 2)):
            runs = [_find_flat(one, sensor, axes) for one in seen]
            if not any(map(len, runs)) or any(is_coarse(samples, axis, runs) for axis in axes):
                continue
            for rows, one, some in zip(found, seen, runs, strict=True):
                rows += [(a, b) for a, b in some.tolist() if _is_stuck(one.segment, sensor, axes, (a, b))]
    return [join_overlapping(some) for some in found]


def _read(segment: Segment, sensor: int) -> Values:
    return segment.gyr_dps if sensor else segment.acc_g


def _find_flat(one: SegmentSummary, sensor: int, axes: tuple[int, ...]) -> Rows:
    """Runs of one value on one axis, or on all three."""
    seen, rate_hz = one.gyr if sensor else one.acc, one.segment.rate_hz
    if len(axes) == 1:
        shortest = max(round(STUCK_S * rate_hz), STUCK_ROWS)
    else:
        shortest = max(round(SILENT_S * rate_hz), 2)
    return find_held_runs(seen, seen, shortest, (axes[0], axes[-1] + 1))


def _is_stuck(segment: Segment, sensor: int, axes: tuple[int, ...], rows: Pair) -> bool:
    """Whether what keeps its value should not: a sensor while anything moves, an axis as STUCK_S says."""
    first, stop = rows
    is_long = len(axes) > 1 or stop - first >= LONG_S * segment.rate_hz
    if is_long and _has_range(segment, rows, MOVING_G, MOVING_DPS):
        return True
    others = np.delete(_read(segment, sensor)[first:stop], axes, axis=1)
    repeats = (np.diff(others, axis=0) == 0.0).mean(axis=0)
    is_live = len(axes) == 1 and bool(repeats.max() < LIVE_PART)
    return is_live and _has_range(segment, rows, MOVED_G, MOVED_DPS)


def _has_range(segment: Segment, rows: Pair, acc_g: float, gyr_dps: float) -> bool:
    """Whether any channel changes by so much."""
    ranges_g, ranges_dps = (np.ptp(_read(segment, sensor)[slice(*rows)], axis=0) for sensor in range(2))
    return bool(ranges_g.max() > acc_g or ranges_dps.max() > gyr_dps)


def is_coarse(samples: Sequence[Values], axis: int, runs: Sequence[Rows]) -> bool:
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


def refuse_dead(recording: Recording, known: Summaries = ()) -> Recording:
    """Give the recording back unless a channel has one value throughout.

    Raises
    ------
    DeadSensor
    """
    if sum(segment.duration_us for segment in recording.segments) < DEAD_US:
        return recording
    seen = summarise(recording.segments, known)
    for name, sensors in zip(SENSORS, ([one.acc for one in seen], [one.gyr for one in seen]), strict=True):
        dead = "".join("xyz"[axis] for axis in range(3) if _has_only(sensors, axis))
        if dead == "xyz":
            raise DeadSensor(sensor=name)
        if dead:
            raise DeadSensor(sensor=name, axis=", ".join(dead))
    return recording


def _has_only(sensors: Sequence[SensorSummary], axis: int) -> bool:
    """Whether an axis has one value throughout."""
    ends = np.concatenate([end[axis] for sensor in sensors for end in (sensor.low, sensor.high)])
    return bool((ends == ends[0]).all())


def exclude_faults(
    recording: Recording, searched: Recording | None = None, known: Summaries = ()
) -> Recording:
    """Exclude spikes, and stretches in which a channel stuck, from the analysed time, and flag them.

    Spikes are replaced by the mean of their neighbours, for the filters only, in place. ``searched``: the
    recording as the last search for stuck channels left it; it is not searched again without a new flag.
    """
    mended = [_mend_spikes(one) for one in summarise(recording.segments, known)]
    spikes = [span for _, spans in mended for span in spans]
    if spikes:
        segments = tuple(segment for segment, _ in mended)
        flags = (*recording.flags, *flag_spans(Caveat.SPIKE, spikes))
        excluded = (*recording.excluded, *spikes)
        recording = replace(recording, segments=segments, excluded=excluded, flags=flags)
    is_same = searched is not None and _find_notes(recording) == _find_notes(searched)
    return recording if is_same else exclude_stuck(recording, known)


def _find_notes(recording: Recording) -> tuple[object, object]:
    return recording.flags, recording.understood


def _mend_spikes(seen: SegmentSummary) -> tuple[Segment, list[Span]]:
    """The segment, another object where samples changed, and where spikes were."""
    segment, rows = seen.segment, set[int]()
    for sensor, least in ((seen.acc, LEAST_SPIKE_G), (seen.gyr, LEAST_SPIKE_DPS)):
        blocks = np.flatnonzero((sensor.step >= least).any(axis=0))
        if len(blocks):
            marked = np.zeros(len(segment), np.bool_)
            _mend_blocks(sensor.samples, least, blocks, marked)
            rows.update(np.flatnonzero(marked).tolist())
    spikes = [place_rows(segment, row, row + 1, "spikes") for row in sorted(rows)]
    return (replace(segment) if spikes else segment), spikes


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
