"""Data for the checks: a summary of every block of samples, and short stretches at rest."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import sqrt
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.numba_kernels import kernel
from acromion.fusion.numerics import weigh_cauchy
from acromion.fusion.recording import Float64Array, QualityFlag, Recording, Segment
from acromion.fusion.still_limits import MOMENT, POSE

# Summary of the samples, sixty-four rows at a time: computed in one pass, used by every check of a sensor.
#
# Most checks look for events in a few rows of a shift: a jump, a repeated value, the extreme. They only
# examine the blocks that contain one.

BLOCK_ROWS = 64


@dataclass(frozen=True, slots=True, eq=False)
class SensorSummary:
    """One sensor of a segment, by axis and block of rows; the last block may be shorter.

    ``samples`` (n, 3): the source.
    ``low``, ``high`` (3, m): minimum and maximum.
    ``step`` (3, m): largest step from one row to the next, including the step into the first row of a block.
    ``kept`` (3, m): most consecutive rows, up to one in the block, that repeat the previous value.
    """

    samples: NDArray[np.float32]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    step: NDArray[np.float32]
    kept: NDArray[np.int32]

    def find_extreme(self) -> float:
        """Return the largest absolute reading of any axis; 0 without rows."""
        return float(max(self.high.max(initial=0.0), -self.low.min(initial=0.0)))

    def keeps(self, axis: int, rows: int) -> bool:
        """Return whether an axis keeps one value for this many rows anywhere."""
        return bool(self.kept[axis].max(initial=0) >= rows - 1)


_SUMMARIES: WeakKeyDictionary[Segment, tuple[SensorSummary, SensorSummary]] = WeakKeyDictionary()


def summarise(segment: Segment) -> tuple[SensorSummary, SensorSummary]:
    """Return the summaries of accelerometer and gyroscope.

    They are computed once per object; code that changes the samples must create a new segment.
    """
    if segment not in _SUMMARIES:
        _SUMMARIES[segment] = summarise_sensor(segment.acc_g), summarise_sensor(segment.gyr_dps)
    return _SUMMARIES[segment]


def forget_summaries(recording: Recording) -> None:
    """Free the summaries of a recording after its checks: they take a sixteenth of its samples."""
    for segment in recording.segments:
        _SUMMARIES.pop(segment, None)


def summarise_sensor(samples: NDArray[np.float32]) -> SensorSummary:
    """Summarise samples, shape (n, 3), in one pass."""
    blocks = -(-len(samples) // BLOCK_ROWS)
    ends, step = np.empty((6, blocks), np.float32), np.empty((3, blocks), np.float32)
    kept = np.empty((3, blocks), np.int32)
    _walk(samples, ends, step, kept)
    return SensorSummary(samples, ends[:3], ends[3:], step, kept)


@kernel
def _walk(samples: Any, ends: Any, steps: Any, kept: Any) -> None:  # pragma: no cover
    """Fill the blocks; all three axes in one loop, three times as fast as one after the other."""
    run_x, run_y, run_z = 0, 0, 0
    for block in range(len(steps[0])):
        first, stop = block * BLOCK_ROWS, min((block + 1) * BLOCK_ROWS, len(samples))
        last = first - 1 if first > 0 else 0
        last_x, last_y, last_z = samples[last, 0], samples[last, 1], samples[last, 2]
        low_x = high_x = samples[first, 0]
        low_y = high_y = samples[first, 1]
        low_z = high_z = samples[first, 2]
        step_x = step_y = step_z = np.float32(0.0)
        kept_x, kept_y, kept_z = 0, 0, 0
        for row in range(max(first, 1), stop):
            x, y, z = samples[row, 0], samples[row, 1], samples[row, 2]
            low_x, high_x = x if x < low_x else low_x, x if x > high_x else high_x
            low_y, high_y = y if y < low_y else low_y, y if y > high_y else high_y
            low_z, high_z = z if z < low_z else low_z, z if z > high_z else high_z
            far_x, far_y, far_z = abs(x - last_x), abs(y - last_y), abs(z - last_z)
            step_x = far_x if far_x > step_x else step_x
            step_y = far_y if far_y > step_y else step_y
            step_z = far_z if far_z > step_z else step_z
            is_x, is_y, is_z = int(x == last_x), int(y == last_y), int(z == last_z)
            run_x, run_y, run_z = (run_x + 1) * is_x, (run_y + 1) * is_y, (run_z + 1) * is_z
            kept_x, kept_y, kept_z = max(kept_x, run_x), max(kept_y, run_y), max(kept_z, run_z)
            last_x, last_y, last_z = x, y, z
        ends[0, block], ends[1, block], ends[2, block] = low_x, low_y, low_z
        ends[3, block], ends[4, block], ends[5, block] = high_x, high_y, high_z
        steps[0, block], steps[1, block], steps[2, block] = step_x, step_y, step_z
        kept[0, block], kept[1, block], kept[2, block] = kept_x, kept_y, kept_z


# Where a sensor is clipped, by its flat tops, independent of the range that the file states.
#
# A clipped signal stays at its extreme, sample after sample, again and again. Otherwise a sensor reaches its
# extreme once: the next movement or noise gives another value.

RANGE_SHARE = 0.999
"""A sample is clipped from this share of the full scale or of the extreme: the two ends of a signed range
differ by one count.
"""
FLAT_ROWS, FEWEST_TOPS = 3, 5
"""An axis keeps one value for this many rows; required this often if the range is not stated."""
LEAST_ACC_RANGE_G, LEAST_GYR_RANGE_DPS = 1.9, 240.0
"""No sensor has a smaller range (2 g, 245 deg/s): a lower extreme is not the end of a range."""
LEAST_ACC_TOP_G, LEAST_GYR_TOP_DPS = 1.5, 50.0
"""For a sensor with a narrower range than stated.

Below these limits, coarse counts at rest may also stay at the extreme.
"""


def find_flat_range(sensors: Sequence[SensorSummary], least: float = 0.0) -> float | None:
    """Return the level at which samples are clipped, or None.

    It applies to all axes: an axis that is clipped below another axis's readings is not found.
    """
    extreme = max((sensor.find_extreme() for sensor in sensors), default=0.0)
    if not least <= extreme < np.inf:
        return None
    limit = np.float32(RANGE_SHARE * extreme)
    tops = sum(_count_tops(sensor, limit) for sensor in sensors)
    return extreme if tops >= FEWEST_TOPS else None


def _count_tops(sensor: SensorSummary, limit: np.float32) -> int:
    """Count how often an axis keeps one value past the limit for three rows or more."""
    count = 0
    for axis in range(3):
        for sign, ends in ((1, sensor.high), (-1, -sensor.low)):
            blocks = np.flatnonzero(ends[axis] >= limit)
            rows = (blocks[:, None] * BLOCK_ROWS + np.arange(BLOCK_ROWS)).ravel()
            rows = rows[rows < len(sensor.samples)]
            values = sign * sensor.samples[rows, axis]
            rows, values = rows[values >= limit], values[values >= limit]
            if len(rows) >= FLAT_ROWS:
                is_held = (np.diff(rows) == 1) & (np.diff(values) == 0.0)
                edges = np.flatnonzero(np.diff(np.concatenate([[False], is_held, [False]]).astype(np.int8)))
                count += int(np.count_nonzero(edges[1::2] - edges[::2] >= FLAT_ROWS - 1))
    return count


# Resolution so coarse that a held arm seems to move, or a channel of a moving arm seems stuck.

COARSE_G, COARSE_DPS = 1.5 * POSE.acc_sd_g, 2.0 * MOMENT.gyro_sd_dps
"""Readings at rest between two values scatter by half a step. Alone or with an arm's own sway, this exceeds
the limit of stillness. Sensors in use have 0.1 to 2.5 mg and 0.004 to 0.6 deg/s; ten bits of 16 g and 2000
deg/s are 31 mg and 3.9 deg/s.
"""
SMALLEST_PART = 0.01
LOOKED_AT_ROWS = 20_000


def flag_resolution(recording: Recording) -> tuple[QualityFlag, ...]:
    """Return the flag of steps so coarse that they hide stillness (W-RESOLUTION)."""
    acc_g = measure_step([segment.acc_g for segment in recording.segments])
    gyr_dps = measure_step([segment.gyr_dps for segment in recording.segments])
    facts: dict[str, str | int | float] = {}
    if acc_g > COARSE_G:
        facts["step_mg"] = round(1000.0 * acc_g, 1)
    if gyr_dps > COARSE_DPS:
        facts["step_dps"] = round(gyr_dps, 2)
    return (QualityFlag(Caveat.RESOLUTION, facts=facts),) if facts else ()


def measure_step(samples: Sequence[NDArray[np.float32]]) -> float:
    """Return the smallest change from row to row, ignoring one in a hundred, of the coarsest axis.

    Few rows are interpolated by a program. Unrounded noise has far smaller changes.
    """
    stride = max(2, sum(map(len, samples)) // LOOKED_AT_ROWS)
    pairs = [(values[1::stride], values[: len(values) - 1 : stride]) for values in samples]
    changes = np.abs(np.concatenate([after - before for after, before in pairs]))
    return max(
        (float(np.quantile(axis[axis > 0.0], SMALLEST_PART)) for axis in changes.T if axis.any()), default=0.0
    )


# Short stretches spread over a recording: find those without movement, and their readings of gravity.

Marks = NDArray[np.bool_]
PROBED_BLOCKS = 150
BLOCK_S, MEAN_S = 8.0, 0.05
REST_S, FEWEST_RESTS = 1.0, 2
REST_PART = 0.015
"""At rest the acceleration scatters by less than this part of its length."""
RESTING_PART, ROUGH = 0.02, 0.3
"""The gyroscope is at rest if it scatters by less than this part of its liveliest stretch.

It also is at rest if successive readings are nearly independent: those of noise are, those of movement are
not.
"""
STEADY_PART, SAME_DEG = 0.04, 10.0
"""At rest in one direction, the middle half of the lengths agree within this part; on a boat they do not."""


def probe_blocks(segments: Sequence[Segment]) -> list[tuple[Segment, int, int]]:
    """Return blocks of 8 s spread over the recording: all of a short one, 150 of a long one."""
    blocks = []
    for segment in segments:
        n, rows = max(8, round(BLOCK_S * segment.rate_hz)), len(segment)
        blocks += [(segment, first, min(first + n, rows)) for first in range(0, rows, n)]
    stride = max(1, -(-len(blocks) // PROBED_BLOCKS))
    return blocks[::stride]


@dataclass(frozen=True, slots=True, eq=False)
class Rests:
    """Mean readings, (n, 3) each, of seconds without movement, in the unit as read.

    An empty table (n = 0) is a separate state: a recording without rest shows nothing about gravity.
    """

    acc: Float64Array
    gyr: Float64Array

    def __len__(self) -> int:
        return len(self.acc)

    @property
    def length(self) -> float:
        """Median length of the acceleration."""
        return float(np.median(np.linalg.norm(self.acc, axis=1)))


def find_rests(segments: Sequence[Segment]) -> Rests:
    """Return the seconds in which neither sensor shows movement.

    Returns none if there are fewer than two, or if they differ in length as on a boat. A channel that keeps
    one value measures nothing (a gap filled with zeros, a stuck axis). If most of the rests look like this,
    the resolution is coarse instead.
    """
    looks = _look(segments)
    if looks is None:
        return Rests(np.zeros((0, 3)), np.zeros((0, 3)))
    acc, acc_sd, gyr, is_gyr_resting, is_stuck = looks
    is_resting = (acc_sd <= REST_PART * np.linalg.norm(acc, axis=1)) & is_gyr_resting
    is_flat = is_resting & is_stuck
    if 2 * is_flat.sum() <= is_resting.sum():
        is_resting &= ~is_flat
    rests = Rests(acc[is_resting], gyr[is_resting])
    if len(rests) < FEWEST_RESTS:
        return Rests(acc[:0], gyr[:0])
    # the middle half of the readings in one direction have the same length
    length = np.linalg.norm(rests.acc, axis=1)
    place = number_directions(rests.acc / np.maximum(length, 1e-12)[:, None], SAME_DEG)
    usual = np.array([np.median(length[place == k]) for k in range(place.max() + 1)])
    low, high = np.quantile(length - usual[place], [0.25, 0.75]).tolist()
    return rests if high - low <= STEADY_PART * rests.length else Rests(acc[:0], gyr[:0])


def measure_rest_part(segments: Sequence[Segment]) -> float | None:
    """Return the length of the acceleration while the gyroscope is at rest, relative to the longest.

    Gravity is present at rest, in any unit. If it was removed, the acceleration is almost zero then. None if
    the gyroscope is never at rest.
    """
    looks, lengths = _look(segments), measure_lengths(segments)
    if looks is None or len(lengths) == 0:
        return None
    acc, _, _, is_resting, _ = looks
    if np.count_nonzero(is_resting) < FEWEST_RESTS:
        return None
    longest = float(np.quantile(lengths, 0.95))
    return float(np.median(np.linalg.norm(acc[is_resting], axis=1))) / max(longest, 1e-12)


def _look(
    segments: Sequence[Segment],
) -> tuple[Float64Array, Float64Array, Float64Array, Marks, Marks] | None:
    """Measure stretches of a second; return None if there are none.

    Returns mean (m, 3) and scatter (m,) of the acceleration, mean rate (m, 3), whether the gyroscope is at
    rest, and whether a channel is stuck.
    """
    liveliest = 0.0
    for segment, first, stop in probe_blocks(segments):
        _, scatter, _ = _measure_stretches(segment.gyr_dps, np.array([first]), stop - first)
        liveliest = max(liveliest, float(scatter.max()))
    looks = []
    for segment, firsts, width in _place_stretches(segments, REST_S, 8):
        acc, acc_sd, _ = _measure_stretches(segment.acc_g, firsts, width)
        gyr, gyr_sd, steps = _measure_stretches(segment.gyr_dps, firsts, width)
        rough = steps.mean(axis=1) / np.maximum(2.0 * np.square(gyr_sd).mean(axis=1), 1e-12)
        is_resting = (gyr_sd.max(axis=1) <= RESTING_PART * liveliest) | (rough > ROUGH)
        is_stuck = (acc_sd == 0.0).any(axis=1) | (gyr_sd == 0.0).any(axis=1)
        looks.append((acc, acc_sd.max(axis=1), gyr, is_resting, is_stuck))
    if not looks:
        return None
    acc, acc_sd, gyr, is_resting, is_stuck = (np.concatenate(column) for column in zip(*looks, strict=True))
    return acc, acc_sd, gyr, is_resting, is_stuck


def _place_stretches(
    segments: Sequence[Segment], length_s: float, fewest_rows: int
) -> Iterator[tuple[Segment, NDArray[np.int64], int]]:
    """Split the blocks of each segment into stretches; yield their first rows (m,) and number of rows."""
    for segment, some in groupby(probe_blocks(segments), key=lambda block: block[0]):
        width = max(fewest_rows, round(length_s * segment.rate_hz))
        firsts = [np.arange(first, stop - width + 1, width) for _, first, stop in some]
        yield segment, np.concatenate(firsts), width


def _measure_stretches(
    samples: NDArray[np.float32], firsts: NDArray[np.int64], width_rows: int
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return mean, standard deviation and mean square step, (m, 3) each, of stretches of rows."""
    means, scatter, steps = (np.empty((len(firsts), 3)) for _ in range(3))
    _reduce_stretches(samples, firsts, width_rows, means, scatter, steps)
    return means, scatter, steps


@kernel
def _reduce_stretches(
    samples: Any, firsts: Any, width: int, means: Any, scatter: Any, steps: Any
) -> None:  # pragma: no cover
    for k in range(len(firsts)):
        start, stop = firsts[k], firsts[k] + width
        for axis in range(3):
            first = samples[start, axis]  # deviations from it are exactly 0 if nothing changes
            mean, square, step, last = 0.0, 0.0, 0.0, float(first)
            for row in range(start, stop):
                mean += (samples[row, axis] - first) / width
            for row in range(start, stop):
                away, value = samples[row, axis] - first - mean, float(samples[row, axis])
                square += away * away / width
                step += (value - last) * (value - last)
                last = value
            means[k, axis], scatter[k, axis], steps[k, axis] = first + mean, sqrt(square), step / (width - 1)


def measure_lengths(segments: Sequence[Segment], *, is_rate: bool = False) -> Float64Array:
    """Return lengths, (n,), of means over 50 ms (at least 3 rows), of acceleration or angular rate."""
    lengths = [np.zeros(0)]
    for segment, firsts, width in _place_stretches(segments, MEAN_S, 3):
        means, _, _ = _measure_stretches(segment.gyr_dps if is_rate else segment.acc_g, firsts, width)
        lengths.append(np.linalg.norm(means, axis=1))
    return np.concatenate(lengths)


def number_directions(unit: Float64Array, near_deg: float) -> NDArray[np.intp]:
    """Number the directions: each moment gets the number of the first earlier direction that is near it."""
    number, found = np.full(len(unit), -1, dtype=np.intp), 0
    left = np.arange(len(unit))
    while len(left):
        near = unit[left] @ unit[left[0]] > np.cos(np.radians(near_deg))
        near[0] = True
        number[left[near]] = found
        left, found = left[~near], found + 1
    return number


# Scale of the accelerometer: the length of gravity at rest, in all directions of the recording.
#
# The fusion corrects the usual few per cent of a sensor (:mod:`acromion.fusion.sensor.self_calibration`). A
# larger factor, for example from a wrong sensitivity, makes its fit fail, or looks like an offset, which
# distorts every angle. Only rests in many directions separate offset and factor: in a single direction both
# look the same.

CELL_DEG, FEWEST_DIRECTIONS = 10.0, 6
CELL_SD_G, REST_SD_G = 0.002, 0.004
"""Standard deviation of the length in one direction, and of a single rest."""
OFFSET_G = 0.04
"""Usual offset of sensors, one standard deviation (LSM9DS1: 90 mg at most)."""
SCALE_TOLERANCE = 0.03
"""Ten simulated sensors of each device are within 0.015."""
ERRORS = 6.0
MOST_LEFT_G = 0.015
"""Largest unexplained difference at rest: a calibrated sensor reads within this of 1 g."""
ROUNDS = 12


@dataclass(frozen=True, slots=True)
class RestScale:
    """The factor for the acceleration, common to all axes, with its standard error.

    ``left_g``: remaining distance of rests from 1 g with it (root mean square over directions).
    """

    factor: float
    error: float
    left_g: float

    @property
    def is_off(self) -> bool:
        """Whether it exceeds the usual error of sensors with certainty."""
        return self.is_even and abs(self.factor - 1.0) > max(SCALE_TOLERANCE, ERRORS * self.error)

    @property
    def is_even(self) -> bool:
        """Whether a factor and an offset explain the readings at rest."""
        return self.left_g < MOST_LEFT_G


def measure_rest_scale(rests_g: Float64Array) -> RestScale | None:
    """Fit a factor and three offsets to mean accelerations at rest, (n, 3); None with too few directions.

    Gauss-Newton with Cauchy weights.
    """
    length_g = np.linalg.norm(rests_g, axis=1)
    rests_g, length_g = rests_g[length_g > 0.0], length_g[length_g > 0.0]
    cell = number_directions(rests_g / length_g[:, None], CELL_DEG)
    if len(cell) == 0 or cell.max() + 1 < FEWEST_DIRECTIONS:
        return None
    # One reading per direction, so that no pose dominates: the median length in the mean direction, because
    # the mean vector itself is too short if the directions spread.
    count = np.bincount(cell)
    mean_g = np.array([rests_g[cell == k].mean(axis=0) for k in range(len(count))])
    median_g = np.array([np.median(length_g[cell == k]) for k in range(len(count))])
    reading_g = mean_g * (median_g / np.linalg.norm(mean_g, axis=1))[:, None]
    variance = CELL_SD_G**2 + REST_SD_G**2 / count.astype(np.float64)
    values = start = np.array([1.0, 0.0, 0.0, 0.0])
    prior = np.diag([1.0, *[OFFSET_G**-2.0] * 3])
    for _ in range(ROUNDS):
        bare = reading_g - values[1:]
        length = np.linalg.norm(bare, axis=1)
        slope = np.column_stack([length, -values[0] * bare / length[:, None]])
        departure = values[0] * length - 1.0
        weight = weigh_cauchy(departure, variance)
        normal = (weight[:, None] * slope).T @ slope + prior
        values = values - np.linalg.solve(normal, slope.T @ (weight * departure) + prior @ (values - start))
    error = float(np.sqrt(np.linalg.inv(normal)[0, 0]))
    return RestScale(float(values[0]), error, float(np.sqrt(np.mean(departure**2))))
