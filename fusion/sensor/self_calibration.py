"""Everything that the recording says about its own sensor, found in one go.

Order: still moments, clipped samples bridged, nodes (the samples are read no more after that), gyroscope
bias, accelerometer (from the moving arm, too, where it was still in few directions), gyroscope scale; then
the nodes once more with all of it applied.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.checks.summary import FLAT_ROWS, LEAST_ACC_RANGE_G, LEAST_GYR_RANGE_DPS, RANGE_SHARE
from fusion.numba_kernels import inner, kernel
from fusion.recording import Float64Array, FloatArray, Segment
from fusion.sensor.accelerometer import MovingReadings, calibrate_accelerometer, sees_few_directions
from fusion.sensor.gyroscope import GyroScale, estimate_gyro_scale, follow_gyro_bias, reduce_about_start
from fusion.sensor.model import (
    AccelerometerCorrection,
    GyroBias,
    Nodes,
    SensorRun,
    correct_nodes,
    reduce_to_nodes,
)
from fusion.sensor.stillness import QuarterSeconds, QuietTable, reduce_run

# What the accelerometer reads of gravity while the arm moves.
#
# Turned into one frame by the gyroscope and averaged over some seconds, the sensor's own acceleration
# becomes the change of its velocity by the time, next to nothing: wherever the sensor sits, as centripetal
# acceleration is a part of it. What is left is gravity and the offset as the motion turned it about, so
# that the length of the mean tells the offset along the mean direction of gravity in the sensor.


WINDOW_S = 4.0
EVERY_S = 1.0
MOST_WINDOWS = 2000
LEAST_SHARE = 0.5
"""Where the sensor turned about so much that less of the offset is left, the window tells too little."""
CALM_G = 0.15
"""A livelier one (root mean square about the mean) tells errors of scale, too, and of the gyroscope."""


def read_while_moving(nodes: Sequence[Nodes]) -> MovingReadings:
    """One reading for each window of 4 s of all runs; ``nodes`` with the bias taken off.

    Runs of one rate are read together: a day of thousands of short ones takes no longer than a whole one.
    """
    alike: dict[int, list[Nodes]] = {}
    for run in nodes:
        alike.setdefault(max(1, round(WINDOW_S / run.period_s)), []).append(run)
    parts = [_read_runs(runs, steps) for steps, runs in alike.items()]
    return MovingReadings(
        np.concatenate([part.time_s for part in parts]), np.concatenate([part.gravity_g for part in parts])
    )


def _read_runs(runs: Sequence[Nodes], steps: int) -> MovingReadings:
    first, middle_s = _place_windows(runs, steps)
    acc_g = np.concatenate([run.acc_g for run in runs])
    turn_rad = np.concatenate([run.turn_rad for run in runs])
    felt, turned, squares = _average(acc_g, turn_rad, first, steps)
    length_g = np.maximum(np.linalg.norm(felt, axis=1), 1e-9)
    spread = squares - length_g**2
    # The mean is as long as gravity and, of the offset, what points along it in the mean.
    slope = np.einsum("wij,wi->wj", turned, felt / length_g[:, None])
    share = np.linalg.norm(slope, axis=1)
    told = (share > LEAST_SHARE) & (spread < CALM_G**2)
    slope, share, length_g = slope[told], share[told], length_g[told]
    gravity_g = slope / share[:, None] * (1.0 + (length_g - 1.0) / share)[:, None]
    return MovingReadings(middle_s[told], gravity_g)


def _place_windows(runs: Sequence[Nodes], steps: int) -> tuple[NDArray[np.intp], Float64Array]:
    """First node of each window, counted through all runs, and its middle, s; none spans two runs."""
    firsts, middles_s, before = [], [], 0
    for run in runs:
        own = np.arange(0, len(run.acc_g) - steps + 1, max(1, round(EVERY_S / run.period_s)))
        firsts.append(own + before)
        middles_s.append(run.start_s + (own + steps / 2.0) * run.period_s)
        before += len(run.acc_g)
    first, middle_s = np.concatenate(firsts), np.concatenate(middles_s)
    every = -(-len(first) // MOST_WINDOWS) or 1
    return first[::every], middle_s[::every]


def _average(
    acc_g: Float64Array, turn_rad: Float64Array, first: NDArray[np.intp], steps: int
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Mean acceleration (w, 3) and rotation (w, 3, 3) in each window's first frame, and mean square (w,)."""
    weight = np.hanning(steps + 2)[1:-1]
    weight /= weight.sum()
    frame = np.repeat(np.eye(3)[None], len(first), axis=0)
    felt, turned, squares = np.zeros((len(first), 3)), np.zeros((len(first), 3, 3)), np.zeros(len(first))
    for step in range(steps):
        if step > 0:
            frame = frame @ _turn_back(turn_rad[first + step])
        felt += weight[step] * np.einsum("wij,wj->wi", frame, acc_g[first + step])
        turned += weight[step] * frame
        squares += weight[step] * (acc_g[first + step] ** 2).sum(axis=1)
    return felt, turned, squares


def _turn_back(turn_rad: Float64Array) -> Float64Array:
    """Matrices (w, 3, 3) that take what is seen after each turn (w, 3) to what was seen before."""
    angle = np.maximum(np.linalg.norm(turn_rad, axis=1), 1e-12)[:, None, None]
    x, y, z = turn_rad.T
    nil = np.zeros(len(turn_rad))
    cross = np.stack([nil, -z, y, z, nil, -x, -y, x, nil], axis=1).reshape(-1, 3, 3)
    return np.asarray(
        np.eye(3) + np.sin(angle) / angle * cross + (1.0 - np.cos(angle)) / angle**2 * (cross @ cross)
    )


# Samples at the end of a sensor's range, bridged so that the estimators lose less of the motion.
#
# A clipped run is replaced, axis by axis, by the cubic that leaves and meets the good samples on either
# side with their own slope (Hermite), never under the limit and at most three times it. Nothing is hidden:
# the rows and 100 ms about them are excluded by ``fusion.quality``; the repair is there so that the
# direction is right again at once afterwards.
#
# On BROAD cut at 2 g and 500 deg/s, without the repair 4.75 deg, with it 2.2 deg (offlineVQF 4.74, VQF
# 6.9); leaving clipped accelerations out of the mean altogether was worse (6.6): what is cut off is not at
# random.


LONGEST_REPAIR_S = 0.3
MOST_TIMES = 3.0


def bridge_saturation(
    runs: Sequence[SensorRun],
    blocks: Sequence[QuarterSeconds],
    acc_range_g: float | None = None,
    gyr_range_dps: float | None = None,
) -> list[SensorRun]:
    """Repair clipped stretches up to 0.3 s; a run without any is given back as it is, otherwise a copy.

    ``blocks`` are the same runs reduced (they know the extremes).
    """
    acc_limits, gyr_limits = find_limits(runs, blocks, acc_range_g, gyr_range_dps)
    if not (np.isfinite(acc_limits).any() or np.isfinite(gyr_limits).any()):
        return list(runs)
    return [
        replace(
            run,
            acc_g=_repair(run.acc_g, acc_limits, run.rate_hz),
            gyr_dps=_repair(run.gyr_dps, gyr_limits, run.rate_hz),
        )
        for run in runs
    ]


def find_limits(
    runs: Sequence[SensorRun | Segment],
    blocks: Sequence[QuarterSeconds],
    acc_range_g: float | None,
    gyr_range_dps: float | None,
) -> tuple[Float64Array, Float64Array]:
    """Return the values from which each axis of accelerometer and gyroscope is clipped.

    Sizes towards either side, (2, 3) each; infinite where nothing is clipped. Where the file tells the full
    scale, a sample within 0.1 % of it is clipped. Where it does not, a channel is taken to be clipped at its
    extreme of the whole recording if it rests exactly there for three rows or more and no sensor has so small
    a range (2 g, 245 deg/s).
    """
    acc = [(run.acc_g, part.acc_ends, part.rows_per_block) for run, part in zip(runs, blocks, strict=True)]
    gyr = [(run.gyr_dps, part.gyr_ends, part.rows_per_block) for run, part in zip(runs, blocks, strict=True)]
    return (
        _find_limits(acc, acc_range_g, LEAST_ACC_RANGE_G),
        _find_limits(gyr, gyr_range_dps, LEAST_GYR_RANGE_DPS),
    )


def _find_limits(
    channels: Sequence[tuple[FloatArray, Float64Array, int]], full_scale: float | None, least: float
) -> Float64Array:
    """Find the limits of one sensor: samples (n, 3), ends (6, m) of each block of rows, rows of a block."""
    low = np.min([ends[:3].min(axis=1) for _, ends, _ in channels], axis=0)
    high = np.max([ends[3:].max(axis=1) for _, ends, _ in channels], axis=0)
    size = np.stack([-low, high])
    if full_scale is not None:
        limit = RANGE_SHARE * full_scale
        return np.where(size >= limit, limit, np.inf)
    limits = np.full((2, 3), np.inf)
    for side, axis in np.argwhere(size >= least).tolist():
        extreme = float((low, high)[side][axis])
        rests = (
            _count_rest(samples, axis, extreme, np.flatnonzero(ends[3 * side + axis] == extreme), rows)
            for samples, ends, rows in channels
        )
        if max(rests) >= FLAT_ROWS:
            limits[side, axis] = size[side, axis]
    return limits


@kernel
def _count_rest(
    samples: Any, axis: int, extreme: float, blocks: Any, rows_per_block: int
) -> int:  # pragma: no cover
    """Longest rest of an axis at its extreme, rows; only the blocks in which it gets there are looked at."""
    longest, resting, last = 0, 0, -1
    for block in blocks:
        first = block * rows_per_block
        resting = resting if first == last else 0
        last = min(first + rows_per_block, len(samples))
        for row in range(first, last):
            resting = resting + 1 if float(samples[row, axis]) == extreme else 0
            longest = max(longest, resting)
    return longest


def _repair(samples: FloatArray, limits: Float64Array, rate_hz: float) -> FloatArray:
    if not np.isfinite(limits).any():
        return samples
    repaired = samples.copy()
    longest = max(1, round(LONGEST_REPAIR_S * rate_hz))
    for axis in range(3):
        for side, sign in ((0, -1.0), (1, 1.0)):
            if np.isfinite(limits[side, axis]):
                _bridge(samples, axis, sign, limits[side, axis], longest, repaired)
    return repaired


@kernel
def _bridge(
    samples: Any, axis: int, sign: float, limit: float, longest_rows: int, repaired: Any
) -> None:  # pragma: no cover
    """Find the runs at or past a limit that have two good samples on each side, and replace them."""
    row, rows = 0, len(samples)
    while row < rows:
        if sign * samples[row, axis] < limit:
            row += 1
            continue
        first = row
        while row < rows and sign * samples[row, axis] >= limit:
            row += 1
        if first < 2 or row > rows - 2 or row - first > longest_rows:
            continue
        _draw_cubic(samples, axis, sign, limit, (first - 1, row), repaired)


@inner
def _draw_cubic(
    samples: Any, axis: int, sign: float, limit: float, ends: tuple[int, int], repaired: Any
) -> None:  # pragma: no cover
    left, right = ends
    length = right - left
    start, end = float(samples[left, axis]), float(samples[right, axis])
    rise = length * (start - float(samples[left - 1, axis]))
    fall = length * (float(samples[right + 1, axis]) - end)
    for row in range(left + 1, right):
        s = (row - left) / length
        value = start + s * (rise + s * (3.0 * (end - start) - 2.0 * rise - fall))
        value += s * s * s * (2.0 * (start - end) + rise + fall)
        repaired[row, axis] = sign * min(max(sign * value, limit), MOST_TIMES * limit)


@dataclass(frozen=True, slots=True, eq=False)
class SensorCalibration:
    """What is taken off the samples, the same for all segments of a recording."""

    bias: GyroBias
    accelerometer: AccelerometerCorrection
    gyro_scale: GyroScale


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedRun:
    """One run with its clipped samples bridged, and its nodes with the calibration applied.

    ``source`` is the array of angular rates that it was made from.
    """

    run: SensorRun
    nodes: Nodes
    source: FloatArray


def calibrate_sensor(
    runs: Sequence[SensorRun],
    blocks: Sequence[QuarterSeconds],
    stills: QuietTable,
    acc_range_g: float | None = None,
    gyr_range_dps: float | None = None,
) -> tuple[SensorCalibration, tuple[CalibratedRun, ...]]:
    """Find bias, accelerometer correction and gyroscope scale, and apply them."""
    bridged = bridge_saturation(runs, blocks, acc_range_g, gyr_range_dps)
    rough = reduce_about_start(bridged, stills)
    bias = follow_gyro_bias(rough, stills)
    moving = None
    if sees_few_directions(stills):
        moving = read_while_moving([correct_nodes(nodes, bias) for nodes in rough])
    accelerometer = calibrate_accelerometer(stills, moving=moving)
    gyro_scale = estimate_gyro_scale(rough, stills, bias, accelerometer)
    calibration = SensorCalibration(bias, accelerometer, gyro_scale)
    return calibration, tuple(
        CalibratedRun(run, _apply(nodes, calibration), source.gyr_dps)
        for source, run, nodes in zip(runs, bridged, rough, strict=True)
    )


def apply_calibration(
    run: SensorRun,
    calibration: SensorCalibration,
    acc_range_g: float | None = None,
    gyr_range_dps: float | None = None,
) -> CalibratedRun:
    """Take a run with a calibration found elsewhere (in the whole of which it is a part)."""
    (bridged,) = bridge_saturation([run], [reduce_run(run)], acc_range_g, gyr_range_dps)
    return CalibratedRun(
        bridged, _apply(reduce_to_nodes(bridged, calibration.bias), calibration), run.gyr_dps
    )


def _apply(nodes: Nodes, calibration: SensorCalibration) -> Nodes:
    """In the place of the nodes themselves, which nothing reads any more."""
    gain, accelerometer = calibration.gyro_scale.gain, calibration.accelerometer
    return correct_nodes(nodes, calibration.bias, gain, accelerometer, in_place=True)
