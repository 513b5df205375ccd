"""Faults of a sensor that show in its readings: a dead channel, one that stuck for a time, isolated spikes.

RELIABILITY.md §1.3, rows 89 and 90. A fault is excluded from the analysed time and flagged. A held arm, an
impact and a sensor on a table are no faults: at these limits none of the recordings in hand, taps on the
sensor included, gives a false alarm.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.checks.stopped import (
    MOVED_DPS,
    MOVED_G,
    Ranges,
    Rows,
    Stop,
    Values,
    cut_rows,
    find_held_runs,
    find_stops,
    join_ranges,
    place_rows,
)
from fusion.checks.unmeasured import bridge_rows, is_too_frequent
from fusion.errors import DeadSensor
from fusion.numba_kernels import njit
from fusion.recording import (
    LONGEST_BRIDGE_US,
    MICROSECONDS,
    QualityFlag,
    Recording,
    Segment,
    Span,
    flag_spans,
)

# Stretches in which a channel, or a whole sensor, stuck: found, and taken out of the analysed time.


# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)


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

Pair = tuple[int, int]


def exclude_stuck(recording: Recording) -> Recording:
    """Exclude the stretches in which a channel stuck from the analysed time, and flag them (W-STUCK-PART).

    Up to 50 ms of one channel are bridged for the filters, in place; a longer stretch ends the segment. The
    search may be repeated once the units are known.

    Raises
    ------
    DeadSensor
        A channel stops at one row in ten.
    """
    segments = recording.segments
    stops = find_stops(segments)
    _refuse_frequent(segments, stops)
    found = zip(segments, find_stuck_rows(segments), stops, strict=True)
    pairs = [(segment, _part_rows(segment, rows, some)) for segment, rows, some in found]
    stuck = [
        place_rows(segment, *rows, "stuck")
        for segment, (bridged, cut) in pairs
        for rows in _leave_holes(segment, [*bridged, *cut])
    ]
    if not stuck:
        return recording
    kept = tuple(piece for segment, (_, cut) in pairs for piece in cut_rows(segment, cut))
    excluded = (*recording.excluded, *stuck)
    others = (flag for flag in recording.flags if not _is_stuck_flag(flag))
    return replace(
        recording,
        segments=kept or segments[:1],
        excluded=excluded,
        flags=(*others, *_flag_stuck(excluded)),
    )


def _refuse_frequent(segments: Sequence[Segment], stops: Sequence[Sequence[Stop]]) -> None:
    rows = sum(len(segment) for segment in segments)
    counts = np.bincount([channel for some in stops for channel, _, _ in some], minlength=6)
    worst = int(counts.argmax())
    if is_too_frequent(int(counts[worst]), rows):
        raise DeadSensor(sensor=SENSORS[worst // 3], axis="xyz"[worst % 3])


def _leave_holes(segment: Segment, stuck: Ranges) -> list[Pair]:
    """Rows of ``stuck`` without the holes that were bridged before: those stay missing time."""
    is_stuck = np.zeros(len(segment) + 1, np.bool_)
    for first, stop in stuck:
        is_stuck[first:stop] = True
    for first, stop in segment.bridged if stuck else ():
        is_stuck[first:stop] = False
    edges = np.flatnonzero(np.diff(is_stuck.view(np.int8), prepend=np.int8(0)))
    return [(first, stop) for first, stop in edges.reshape(-1, 2).tolist()]


def _is_stuck_flag(flag: QualityFlag) -> bool:
    return flag.code == Caveat.STUCK_PART and flag.facts.get("filled") == "stuck"


def _flag_stuck(excluded: tuple[Span, ...]) -> tuple[QualityFlag, ...]:
    spans = sorted((span for span in excluded if span.reason == "stuck"), key=lambda span: span.start_us)
    return flag_spans(Caveat.STUCK_PART, spans, filled="stuck")


def _part_rows(segment: Segment, stuck: Ranges, stops: Sequence[Stop]) -> tuple[list[Pair], list[Pair]]:
    """Rows that were bridged, and rows to cut out."""
    most = int(LONGEST_BRIDGE_US * segment.rate_hz / MICROSECONDS + 1e-3)

    def is_short(first_row: int, stop_row: int) -> bool:
        return stop_row - first_row <= most and first_row > 0 and stop_row < len(segment)

    for channel, first, stop in stops:
        if is_short(first, stop):
            axis = channel % 3
            values = (segment.acc_g, segment.gyr_dps)[channel // 3]
            bridge_rows(values[:, axis : axis + 1], first, stop)
    ranges = join_ranges(sorted([*stuck, *((first, stop) for _, first, stop in stops)]))
    return [pair for pair in ranges if is_short(*pair)], [pair for pair in ranges if not is_short(*pair)]


def find_stuck_rows(segments: Sequence[Segment]) -> list[list[Pair]]:
    """For each segment, row ranges, apart and in order, in which a channel, or a whole sensor, stuck."""
    found: list[list[Pair]] = [[] for _ in segments]
    for sensor in range(2):
        samples = [_read(segment, sensor) for segment in segments]
        for axes in ((0,), (1,), (2,), (0, 1, 2)):
            runs = [_find_flat(segment, sensor, axes) for segment in segments]
            if not any(map(len, runs)) or any(is_coarse(samples, axis, runs) for axis in axes):
                continue
            for one, segment, some in zip(found, segments, runs, strict=True):
                one += [(a, b) for a, b in some.tolist() if _is_stuck(segment, sensor, axes, (a, b))]
    return [join_ranges(sorted(some)) for some in found]


def _read(segment: Segment, sensor: int) -> Values:
    return segment.gyr_dps if sensor else segment.acc_g


def _find_flat(segment: Segment, sensor: int, axes: tuple[int, ...]) -> Rows:
    """Runs of one value on one axis, or on all three."""
    values = _read(segment, sensor)
    if len(axes) == 1:
        return find_flat_runs(values, axes[0], max(round(STUCK_S * segment.rate_hz), STUCK_ROWS))
    return find_held_runs(values, values, max(round(SILENT_S * segment.rate_hz), 2))


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
    return sum(count_repeats(values, axis) for values in samples) - inside > COARSE_PART * elsewhere


@njit(cache=True, nogil=True)
def count_repeats(values: Values, axis: int) -> int:
    """Rows whose reading is that of the row before."""
    count = 0
    for k in range(1, len(values)):
        if values[k, axis] == values[k - 1, axis]:
            count += 1
    return count


@njit(cache=True, nogil=True)
def find_flat_runs(values: Values, axis: int, shortest_rows: int) -> Rows:
    """Runs of one value, at least ``shortest_rows`` rows long, shape (m, 2): first row and first row after.

    Such a run covers one of any ``shortest_rows`` rows that follow each other: the search looks there only.
    """
    runs = np.empty((len(values) // max(shortest_rows, 1) + 1, 2), np.int64)
    found, k = 0, max(shortest_rows, 1) - 1
    while k < len(values):
        first, stop = k, k + 1
        while first > 0 and k - first < shortest_rows and values[first - 1, axis] == values[k, axis]:
            first -= 1
        while stop < len(values) and values[stop, axis] == values[k, axis]:
            stop += 1
        if stop - first >= shortest_rows:
            runs[found, 0], runs[found, 1] = first, stop
            found += 1
        k = stop - 1 + max(shortest_rows, 1)
    return runs[:found]


# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)


DEAD_US = 10 * MICROSECONDS
SPIKE_RATIO = 20.0
"""A spike stands out of the steps around it by this factor: hard taps on a sensor reach 10."""
LEAST_SPIKE_G, LEAST_SPIKE_DPS = 1.0, 150.0
AROUND_ROWS = 5
SCANNED_ROWS = 512


def refuse_dead(recording: Recording) -> Recording:
    """Give the recording back unless a channel has one value throughout.

    Raises
    ------
    DeadSensor
    """
    if sum(segment.duration_us for segment in recording.segments) < DEAD_US:
        return recording
    for sensor in range(2):
        pieces = [(segment.acc_g, segment.gyr_dps)[sensor] for segment in recording.segments]
        only = pieces[0][0]
        dead = "".join(
            name
            for axis, name in enumerate("xyz")
            if all(has_only(piece, axis, only[axis]) for piece in pieces)
        )
        if dead == "xyz":
            raise DeadSensor(sensor=SENSORS[sensor])
        if dead:
            raise DeadSensor(sensor=SENSORS[sensor], axis=", ".join(dead))
    return recording


@njit(cache=True, nogil=True)
def has_only(values: NDArray[np.float32], axis: int, value: float) -> bool:
    """Whether a channel has one value throughout; a live channel shows it in its first rows."""
    for k in range(len(values)):  # noqa: SIM110 (numba compiles no generator expressions)
        if values[k, axis] != value:
            return False
    return True


def exclude_faults(recording: Recording, searched: Recording | None = None) -> Recording:
    """Exclude spikes, and stretches in which a channel stuck, from the analysed time, and flag them.

    Spikes are replaced by the mean of their neighbours, for the filters only, in place. ``searched``: the
    recording as the last search for stuck channels left it; it is not searched again without a new flag.
    """
    spikes = [span for segment in recording.segments for span in _mend_spikes(segment)]
    if spikes:
        flags = (*recording.flags, *flag_spans(Caveat.SPIKE, spikes))
        recording = replace(recording, excluded=(*recording.excluded, *spikes), flags=flags)
    is_same = searched is not None and _find_notes(recording) == _find_notes(searched)
    return recording if is_same else exclude_stuck(recording)


def _find_notes(recording: Recording) -> tuple[object, object]:
    return recording.flags, recording.understood


def _mend_spikes(segment: Segment) -> list[Span]:
    marked = np.zeros(len(segment), np.bool_)
    found = mend_spikes(segment.acc_g, LEAST_SPIKE_G, marked)
    found += mend_spikes(segment.gyr_dps, LEAST_SPIKE_DPS, marked)
    rows = np.flatnonzero(marked).tolist() if found else []
    return [place_rows(segment, row, row + 1, "spikes") for row in rows]


@njit(cache=True, nogil=True)
def mend_spikes(values: NDArray[np.float32], least: float, marked: NDArray[np.bool_]) -> int:
    """Replace single readings far outside of their neighbours; mark their rows; return how many there were.

    Compared to Hampel's filter (median and MAD of a window): the reading must leave both neighbours the same
    way, they must agree, and every step of the five rows on either side must be far smaller.
    """
    found = 0
    last = len(values) - AROUND_ROWS - 1
    for first in range(AROUND_ROWS + 1, last, SCANNED_ROWS):
        stop = min(first + SCANNED_ROWS, last)
        if has_step(values[first - 1 : stop], least):
            for k in range(first, stop):
                found += mend_row(values, k, least, marked)
    return found


@njit(cache=True, nogil=True)
def has_step(values: NDArray[np.float32], least: float) -> bool:
    """Whether any reading is ``least`` or more from the one before; few stretches of a shift have such."""
    steps = 0
    for k in range(1, len(values)):
        for axis in range(3):
            steps |= int(abs(values[k, axis] - values[k - 1, axis]) >= least)
    return steps > 0


@njit(cache=True, nogil=True)
def mend_row(values: NDArray[np.float32], row: int, least: float, marked: NDArray[np.bool_]) -> int:
    """Mend what is a spike in one row; return how many readings were."""
    found = 0
    for axis in range(3):
        up = values[row, axis] - values[row - 1, axis]
        down = values[row, axis] - values[row + 1, axis]
        height = min(abs(up), abs(down))
        if height < least or up * down <= 0.0:
            continue
        if largest_step(values, row, axis) * SPIKE_RATIO < height:
            values[row, axis] = 0.5 * (values[row - 1, axis] + values[row + 1, axis])
            marked[row] = True
            found += 1
    return found


@njit(cache=True, nogil=True)
def largest_step(values: NDArray[np.float32], row: int, axis: int) -> float:
    """The largest step among the five rows on either side, and from the one side to the other."""
    largest = abs(values[row + 1, axis] - values[row - 1, axis])
    for k in range(1, AROUND_ROWS + 1):
        before = abs(values[row - k, axis] - values[row - k - 1, axis])
        after = abs(values[row + k + 1, axis] - values[row + k, axis])
        largest = max(largest, before, after)
    return largest
