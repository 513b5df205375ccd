"""Faults of a sensor that show in its readings: a dead channel, one that stuck for a time, isolated spikes.

RELIABILITY.md §1.3, rows 89 and 90. What is found is excluded, never mended silently. A held arm, an impact
and a sensor on a table are no faults: the limits were set so that none of the recordings in hand, taps on the
sensor included, gives a false alarm.
"""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)

from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.errors import DeadSensor
from fusion.readers.row_ranges import Ranges, Rows, cut_rows, find_held_runs, join_ranges, place_rows
from fusion.readers.timing import flag_spans
from fusion.recording import MICROSECONDS, Recording, Segment, Span

SENSORS = ("accelerometer", "gyroscope")
DEAD_US = 10 * MICROSECONDS
STUCK_S = 2.0
"""A channel that keeps one value so long while another moves is stuck."""
SILENT_S = 0.5
"""So long a whole sensor keeps its three values only where it does not answer, while the other moves."""
COARSE_PART = 0.5
MOVING_G, MOVING_DPS = 0.15, 30.0
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


def exclude_faults(recording: Recording) -> Recording:
    """Take spikes, and stretches in which a channel stuck, out of the analysed time, and say so.

    Spikes are replaced by the mean of their neighbours, for the filters only, in place; stuck stretches end
    the segment.
    """
    spikes = [span for segment in recording.segments for span in _mend_spikes(segment)]
    pairs = [(segment, find_stuck_rows(segment)) for segment in recording.segments]
    stuck = [place_rows(segment, *pair, "stuck") for segment, rows in pairs for pair in rows]
    if not spikes and not stuck:
        return recording
    segments = tuple(piece for segment, rows in pairs for piece in cut_rows(segment, rows))
    flags = flag_spans("W-SPIKE", spikes) + flag_spans("W-STUCK-PART", stuck, filled="stuck")
    return replace(
        recording,
        segments=segments or recording.segments[:1],
        excluded=(*recording.excluded, *spikes, *stuck),
        flags=(*recording.flags, *flags),
    )


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


def find_stuck_rows(segment: Segment) -> Ranges:
    """Row ranges, apart and in order, in which a channel, or a sensor, stuck while another moved."""
    found: list[tuple[int, int]] = []
    shortest, silent = round(STUCK_S * segment.rate_hz), round(SILENT_S * segment.rate_hz)
    for values in (segment.acc_g, segment.gyr_dps):
        candidates = [((axis,), find_flat_runs(values, axis, shortest)) for axis in range(3)]
        candidates.append(((0, 1, 2), find_held_runs(values, values, max(silent, 2))))
        for axes, runs in candidates:
            if len(runs) and not any(is_coarse(values, axis, runs) for axis in axes):
                found += [(int(a), int(b)) for a, b in runs if _is_moving(segment, int(a), int(b))]
    return join_ranges(sorted(found))


def is_coarse(values: NDArray[np.float32], axis: int, runs: Rows) -> bool:
    """Whether a channel repeats its value so often elsewhere too that a flat stretch proves nothing."""
    inside = int((runs[:, 1] - runs[:, 0] - 1).sum())
    elsewhere = len(values) - 1 - inside
    return count_repeats(values, axis) - inside > COARSE_PART * elsewhere


@njit(cache=True, nogil=True)
def count_repeats(values: NDArray[np.float32], axis: int) -> int:
    """Rows whose reading is that of the row before."""
    count = 0
    for k in range(1, len(values)):
        if values[k, axis] == values[k - 1, axis]:
            count += 1
    return count


def _is_moving(segment: Segment, first: int, stop: int) -> bool:
    acc_range_g = np.ptp(segment.acc_g[first:stop], axis=0).max()
    gyr_range_dps = np.ptp(segment.gyr_dps[first:stop], axis=0).max()
    return bool(acc_range_g > MOVING_G or gyr_range_dps > MOVING_DPS)


@njit(cache=True, nogil=True)
def find_flat_runs(values: NDArray[np.float32], axis: int, shortest: int) -> Rows:
    """Runs of one value, at least ``shortest`` rows long, shape (m, 2): first row and first row after.

    Such a run covers one of any ``shortest`` rows that follow each other: only from these is looked around.
    """
    runs = np.empty((len(values) // max(shortest, 1) + 1, 2), np.int64)
    found, k = 0, max(shortest, 1) - 1
    while k < len(values):
        first, stop = k, k + 1
        while first > 0 and k - first < shortest and values[first - 1, axis] == values[k, axis]:
            first -= 1
        while stop < len(values) and values[stop, axis] == values[k, axis]:
            stop += 1
        if stop - first >= shortest:
            runs[found, 0], runs[found, 1] = first, stop
            found += 1
        k = stop - 1 + max(shortest, 1)
    return runs[:found]
