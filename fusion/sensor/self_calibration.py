"""Calibrate the sensor from its own recording, in one pass.

Order: still moments, bridging of clipped samples, nodes (the samples are not read after that), gyroscope
bias, accelerometer (also from the moving arm, if it was still in few directions), gyroscope scale. Then all
corrections are applied to the nodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.checks.summary import (
    FLAT_ROWS,
    LEAST_ACC_RANGE_G,
    LEAST_GYR_RANGE_DPS,
    RANGE_SHARE,
    number_directions,
)
from acromion.fusion.numba_kernels import inner, kernel
from acromion.fusion.numerics import weigh_cauchy
from acromion.fusion.recording import Float64Array, FloatArray, Segment
from acromion.fusion.sensor.gyroscope import (
    GyroScale,
    estimate_gyro_bias_track,
    estimate_gyro_scale,
    reduce_about_start,
)
from acromion.fusion.sensor.model import (
    PART_OFFSET_G,
    AccelerometerCorrection,
    GyroBias,
    LinearInterpolator,
    Nodes,
    SensorRun,
    build_identity_accelerometer,
    build_random_walk,
    correct_nodes,
    reduce_to_nodes,
    solve_band,
)
from acromion.fusion.sensor.stillness import QuarterSeconds, QuietTable, reduce_run

# Offset and gain of the accelerometer, from the recording's own still moments.
#
# At rest the length of the acceleration is 1 g in every direction. Still moments in many directions determine
# three offsets and a symmetric gain (scale and the mutual misalignment of the axes), and how the offsets
# change through the day: a sensor that was cold when strapped on warms up, so its offset differs from that in
# the calibration pose.
#
# Priors determine what the directions do not show. They pull the correction towards none and the offset
# towards a constant, so a file with few poses is not distorted. The correction is also bounded. Priors,
# weights and directions are independent of the axes: a sensor strapped on in another orientation gets the
# same correction, rotated.

FIRST_AXIS, SECOND_AXIS = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])
"""Rows and columns of the six numbers of a symmetric matrix."""
PAIRS = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
"""How often each occurs in the matrix."""


@dataclass(frozen=True, slots=True)
class AccelerometerSettings:
    """Settings of the accelerometer calibration.

    ``offset_g``, ``scale``: expected standard deviations of parts as delivered (``scale``: the same in every
    direction). A correction may be at most three times as large.
    ``wander_g_per_root_min``: the random walk of the offset, between knots ``knot_s`` apart.
    ``cell_deg``: still moments within this angle and between the same two knots are one observation. The
    variance of that observation is ``cell_g`` squared (the common error) plus ``still_g`` squared over the
    number of moments.
    ``rest_directions``: with fewer directions at rest, a correction is applied only if it removes a departure
    from 1 g of more than ``scale``. A good accelerometer departs less from 1 g, and a few directions cannot
    separate scale from offset. (BROAD trials at rest in one direction, 1 to 10 mg off, lost up to 0.05 deg.
    On shifts of recorded motion, three directions found 31 and 57 mg to within 5 mg with a departure of 4 and
    7.)
    ``least_directions``: with fewer directions at rest, the moving arm is also used
    (:mod:`acromion.fusion.sensor.self_calibration`), if it shows this many directions.
    ``moving_cell_g``, ``moving_g``: errors of the readings of the moving arm.
    ``moving_doubt``: factor for the remaining uncertainty, because the errors of these readings are not
    independent. Without it the band contained the truth 88 % of the time on four sessions of simulated tasks.

    Chosen on simulated shifts with even seeds (1 and 8 h, both devices). Half or twice any value changes the
    angle by less than 0.01 deg RMSE.
    """

    offset_g: float = PART_OFFSET_G
    scale: float = 0.01
    wander_g_per_root_min: float = 0.0007
    knot_s: float = 300.0
    cell_deg: float = 10.0
    least_directions: int = 4
    rest_directions: int = 3
    cell_g: float = 0.0015
    still_g: float = 0.002
    moving_cell_g: float = 0.004
    moving_g: float = 0.01
    moving_doubt: float = 1.5
    rounds: int = 8


SETTINGS = AccelerometerSettings()


@dataclass(frozen=True, slots=True, eq=False)
class MovingReadings:
    """Readings of the moving arm, as if at rest: ``gravity_g`` (w, 3) at ``time_s`` (w,)."""

    time_s: Float64Array
    gravity_g: Float64Array


def has_few_directions(stills: QuietTable) -> bool:
    """Return whether still moments alone do not determine the offset in every direction."""
    return _count_directions(stills) < SETTINGS.least_directions


def _count_directions(stills: QuietTable) -> int:
    return int(_number_cells(stills.gravity_g).max(initial=-1)) + 1


def _number_cells(gravity_g: Float64Array) -> NDArray[np.intp]:
    unit = gravity_g / np.maximum(np.linalg.norm(gravity_g, axis=1), 1e-9)[:, None]
    return number_directions(unit, SETTINGS.cell_deg)


def calibrate_accelerometer(
    stills: QuietTable, moving: MovingReadings | None = None
) -> AccelerometerCorrection:
    """Fit offset and gain so that every direction reads 1 g, by damped least squares with Cauchy weights.

    ``moving``: readings of the moving arm, for a recording that was still in few directions. If they give no
    correction, only the still moments are used. Returns no correction if there is no still moment, if a bound
    is exceeded, if the departure from 1 g does not decrease, or if it decreases only a little with still
    moments in few directions.
    """
    if len(stills) == 0:
        return build_identity_accelerometer()
    if moving is not None:
        found = _find_correction(_average_cells(stills, moving), is_few=True)
        if found is not None and found.directions >= SETTINGS.least_directions:
            return replace(
                found, offset_sd_g=min(SETTINGS.moving_doubt * found.offset_sd_g, SETTINGS.offset_g)
            )
    is_few = _count_directions(stills) < SETTINGS.rest_directions
    return _find_correction(_average_cells(stills, None), is_few=is_few) or build_identity_accelerometer()


def _find_correction(cells: "_Cells", *, is_few: bool) -> AccelerometerCorrection | None:
    """Return None if a bound is exceeded, or if less is removed than the usual error of a good accelerometer.

    The criterion is the part of the departure that the correction removes. The departure of a few noisy
    readings may be their own error, and then a fitted correction removes little of it.
    """
    offset_g, gain = _fit(cells)
    corrected = (cells.reading_g - cells.interpolator.read(offset_g)) @ gain
    before, after = (
        float(np.mean((np.linalg.norm(table, axis=1) - 1.0) ** 2)) for table in (cells.reading_g, corrected)
    )
    farthest_g, most = np.linalg.norm(offset_g, axis=1).max(), np.abs(np.linalg.eigvalsh(gain) - 1.0).max()
    least = SETTINGS.scale**2 if is_few else 0.0
    if farthest_g > 3.0 * SETTINGS.offset_g or most > 3.0 * SETTINGS.scale or before - after <= least:
        return None
    # the remaining uncertainty of a constant offset that is estimated together with the gain
    slope = np.hstack([-corrected, _slope_by_gain(corrected, corrected)])
    weight = weigh_cauchy(np.linalg.norm(corrected, axis=1) - 1.0, cells.variance)
    prior = np.concatenate([np.full(3, SETTINGS.offset_g**-2.0), PAIRS / SETTINGS.scale**2])
    covariance = np.linalg.inv((weight[:, None] * slope).T @ slope + np.diag(prior))
    left_g = float(np.sqrt(np.trace(covariance[:3, :3]) / 3.0))
    return AccelerometerCorrection(cells.knots_s, offset_g, gain, cells.directions, left_g)


def _slope_by_gain(along: Float64Array, bare: Float64Array) -> Float64Array:
    """Return the derivative of the length along a direction (w, 3) by the six numbers of the gain, (w, 6)."""
    once = along[:, FIRST_AXIS] * bare[:, SECOND_AXIS] + along[:, SECOND_AXIS] * bare[:, FIRST_AXIS]
    return np.asarray(PAIRS / 2.0 * once)


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """One reading for each direction between each two knots, so that no pose dominates.

    ``reading_g`` (c, 3), ``variance`` (c,) of its length; ``hats`` interpolates between the knots.
    """

    knots_s: Float64Array
    reading_g: Float64Array
    variance: Float64Array
    directions: int
    interpolator: LinearInterpolator = field(repr=False)


def _average_cells(stills: QuietTable, moving: MovingReadings | None) -> _Cells:
    time_s, gravity_g = stills.middle_s, stills.gravity_g
    if moving is not None:
        time_s = np.concatenate([time_s, moving.time_s])
        gravity_g = np.concatenate([gravity_g, moving.gravity_g])
    is_moving = np.arange(len(time_s)) >= len(stills)
    pieces = max(1, round((time_s.max() - time_s.min()) / SETTINGS.knot_s))
    knots_s = np.linspace(time_s.min(), max(time_s.max(), time_s.min() + 1.0), pieces + 1)
    direction = _number_cells(gravity_g)
    between = np.clip(np.searchsorted(knots_s, time_s, side="right") - 1, 0, pieces - 1)
    cell = (2 * direction + is_moving) * pieces + between
    length_g = np.linalg.norm(gravity_g, axis=1)
    order = np.lexsort((length_g, cell))
    first = np.flatnonzero(np.diff(cell[order], prepend=-1))
    count = np.diff(first, append=len(order))
    mean_g = np.add.reduceat(gravity_g[order], first) / count[:, None]
    # The mean vector of spread directions is too short, so take the mean direction with the median length.
    median_g = (length_g[order][first + (count - 1) // 2] + length_g[order][first + count // 2]) / 2.0
    reading_g = mean_g * (median_g / np.maximum(np.linalg.norm(mean_g, axis=1), 1e-9))[:, None]
    middle_s = np.add.reduceat(time_s[order], first) / count
    moves = is_moving[order][first]
    common_g = np.where(moves, SETTINGS.moving_cell_g, SETTINGS.cell_g)
    variance = common_g**2 + np.where(moves, SETTINGS.moving_g, SETTINGS.still_g) ** 2 / count
    return _Cells(
        knots_s, reading_g, variance, int(direction.max()) + 1, LinearInterpolator(knots_s, middle_s)
    )


def _fit(cells: _Cells) -> tuple[Float64Array, Float64Array]:
    """Return the offsets at the knots (k, 3) and the gain (3, 3)."""
    offset_g, gain = np.zeros((len(cells.knots_s), 3)), np.eye(3)
    for _ in range(SETTINGS.rounds):
        bare = cells.reading_g - cells.interpolator.read(offset_g)
        corrected = bare @ gain
        length = np.linalg.norm(corrected, axis=1)
        along = corrected / np.maximum(length, 1e-9)[:, None]
        by_offset = -along @ gain
        by_gain = _slope_by_gain(along, bare)
        departure = length - 1.0
        weight = weigh_cauchy(departure, cells.variance)
        # Linear about the present solution, so that the unknowns are the solution itself.
        present = (by_offset * cells.interpolator.read(offset_g)).sum(axis=1)
        aim = present + by_gain @ (gain - np.eye(3))[FIRST_AXIS, SECOND_AXIS] - departure
        offset_g, six = _solve(cells, by_offset, by_gain, aim, weight)
        gain = np.eye(3)
        gain[FIRST_AXIS, SECOND_AXIS] += six
        gain[SECOND_AXIS, FIRST_AXIS] = gain[FIRST_AXIS, SECOND_AXIS]
    return offset_g, gain


def _solve(
    cells: _Cells, by_offset: Float64Array, by_gain: Float64Array, aim: Float64Array, weight: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Run one round: eliminate the knots' offsets (they form a band), then solve for the gain."""
    band = build_random_walk(cells.knots_s, SETTINGS.wander_g_per_root_min)
    band[0] += 1.0 / (SETTINGS.offset_g**2 * len(cells.knots_s))
    right = np.zeros((1 + len(PAIRS), band.shape[1]))
    heavy = weight[:, None] * by_offset
    cells.interpolator.add(band, right[0], heavy[:, :, None] * by_offset[:, None, :], heavy * aim[:, None])
    for k in range(len(PAIRS)):
        cells.interpolator.pull(right[1 + k], heavy * by_gain[:, k, None])
    solved = solve_band(band, right).T
    both = right[1:] @ solved
    normal = (weight[:, None] * by_gain).T @ by_gain + np.diag(PAIRS / SETTINGS.scale**2) - both[:, 1:]
    six = np.linalg.solve(normal, by_gain.T @ (weight * aim) - both[:, 0])
    return (solved[:, 0] - solved[:, 1:] @ six).reshape(-1, 3), np.asarray(six, dtype=np.float64)


# Accelerometer readings of gravity while the arm moves.
#
# The acceleration is rotated into one frame by the gyroscope and averaged over some seconds. The sensor's own
# acceleration then becomes its change of velocity divided by the time, almost zero. This holds for any
# position of the sensor, because centripetal acceleration is included. Gravity and the rotated offset remain.
# The length of the mean therefore shows the offset along the mean direction of gravity in the sensor.


WINDOW_S = 4.0
EVERY_S = 1.0
MOST_WINDOWS = 2000
LEAST_SHARE = 0.5
"""If the sensor rotated so much that a smaller share of the offset remains, the window is not used."""
CALM_G = 0.15
"""A window with more motion (root mean square about the mean) also contains errors of scale and of the
gyroscope.
"""


def read_while_moving(nodes: Sequence[Nodes]) -> MovingReadings:
    """Return one reading for each window of 4 s of all runs; ``nodes`` with the bias subtracted.

    Runs with the same rate are processed together, so that thousands of short runs take no longer than one
    long run.
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
    # The length of the mean is gravity plus the mean component of the offset along it.
    slope = np.einsum("wij,wi->wj", turned, felt / length_g[:, None])
    share = np.linalg.norm(slope, axis=1)
    told = (share > LEAST_SHARE) & (spread < CALM_G**2)
    slope, share, length_g = slope[told], share[told], length_g[told]
    gravity_g = slope / share[:, None] * (1.0 + (length_g - 1.0) / share)[:, None]
    return MovingReadings(middle_s[told], gravity_g)


def _place_windows(runs: Sequence[Nodes], steps: int) -> tuple[NDArray[np.intp], Float64Array]:
    """Return the first node of each window, counted over all runs, and its middle, s; none spans two runs."""
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
    """Return acceleration (w, 3) and rotation (w, 3, 3) in the first frame, and mean square (w,): means."""
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
    """Return matrices (w, 3, 3) that transform vectors after each turn (w, 3) to the frame before it."""
    angle = np.maximum(np.linalg.norm(turn_rad, axis=1), 1e-12)[:, None, None]
    x, y, z = turn_rad.T
    nil = np.zeros(len(turn_rad))
    cross = np.stack([nil, -z, y, z, nil, -x, -y, x, nil], axis=1).reshape(-1, 3, 3)
    return np.asarray(
        np.eye(3) + np.sin(angle) / angle * cross + (1.0 - np.cos(angle)) / angle**2 * (cross @ cross)
    )


# Samples at the end of a sensor's range, bridged so that the estimators lose less of the motion.
#
# A clipped run is replaced, axis by axis, by the cubic that matches value and slope of the good samples on
# either side (Hermite), never below the limit and at most three times it. The repair does not hide anything:
# ``acromion.fusion.quality`` excludes the rows and 100 ms around them. It only keeps the direction correct
# after the clipped run.
#
# On BROAD cut at 2 g and 500 deg/s: 4.75 deg without the repair, 2.2 deg with it (offlineVQF 4.74, VQF 6.9).
# Leaving clipped accelerations out of the mean altogether was worse (6.6), because the cut-off values are not
# random.


LONGEST_REPAIR_S = 0.3
MOST_TIMES = 3.0


def bridge_saturation(
    runs: Sequence[SensorRun],
    blocks: Sequence[QuarterSeconds],
    acc_range_g: float | None = None,
    gyr_range_dps: float | None = None,
) -> list[SensorRun]:
    """Repair clipped stretches up to 0.3 s; return a copy, or the run itself if nothing is clipped.

    ``blocks`` are the same runs reduced; they contain the extremes.
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

    Absolute values in the negative and positive direction, (2, 3) each; infinite if nothing is clipped. If
    the file states the full scale, a sample within 0.1 % of it is clipped. Otherwise a channel counts as
    clipped at its extreme of the whole recording if it stays exactly there for three rows or more and the
    extreme is not below the smallest range of any sensor (2 g, 245 deg/s).
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
    """Return the limits of one sensor: samples (n, 3), ends (6, m) of each block of rows, rows of a block."""
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
    """Return the longest rest of an axis at its extreme, rows; only reads blocks with the extreme."""
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
    """Replace the runs at or past a limit that have two good samples on each side."""
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
    """Corrections of the samples, the same for all segments of a recording."""

    bias: GyroBias
    accelerometer: AccelerometerCorrection
    gyro_scale: GyroScale


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedRun:
    """One run with its clipped samples bridged, and its nodes with the calibration applied.

    ``source``: the array of angular rates that it was made from.
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
    """Estimate bias, accelerometer correction and gyroscope scale, and apply them."""
    bridged = bridge_saturation(runs, blocks, acc_range_g, gyr_range_dps)
    rough = reduce_about_start(bridged, stills)
    bias = estimate_gyro_bias_track(rough, stills)
    moving = None
    if has_few_directions(stills):
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
    """Apply a given calibration (for example that of the whole recording)."""
    (bridged,) = bridge_saturation([run], [reduce_run(run)], acc_range_g, gyr_range_dps)
    return CalibratedRun(
        bridged, _apply(reduce_to_nodes(bridged, calibration.bias), calibration), run.gyr_dps
    )


def _apply(nodes: Nodes, calibration: SensorCalibration) -> Nodes:
    """Apply in place; the original nodes are not used after this."""
    gain, accelerometer = calibration.gyro_scale.gain, calibration.accelerometer
    return correct_nodes(nodes, calibration.bias, gain, accelerometer, in_place=True)
