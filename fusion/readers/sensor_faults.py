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
from fusion.readers.row_ranges import place_rows
from fusion.readers.stuck_channels import SENSORS, exclude_stuck
from fusion.readers.timing import flag_spans
from fusion.recording import MICROSECONDS, Recording, Segment, Span

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
    """Take spikes, and stretches in which a channel stuck, out of the analysed time, and say so.

    Spikes are replaced by the mean of their neighbours, for the filters only, in place. ``searched``: as it
    was when last searched for what stuck; not again where nothing was said of it since.
    """
    spikes = [span for segment in recording.segments for span in _mend_spikes(segment)]
    if spikes:
        flags = (*recording.flags, *flag_spans("W-SPIKE", spikes))
        recording = replace(recording, excluded=(*recording.excluded, *spikes), flags=flags)
    is_same = searched is not None and _tell(recording) == _tell(searched)
    return recording if is_same else exclude_stuck(recording)


def _tell(recording: Recording) -> tuple[object, object]:
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
