"""Movement of the arm: four speeds, frequency, and rainflow cycles."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.elevation import ElevationSegment, Vertical
from acromion.fusion.exposure.bins import find_percentile_cells
from acromion.fusion.exposure.metric_filter import MetricAngle, filter_rows
from acromion.fusion.exposure.resampling import Figures, Resampling, scale_draws
from acromion.fusion.exposure.types import Cycles, Frequency, Velocity
from acromion.fusion.numba_kernels import inner, kernel, kernel_making_arrays
from acromion.fusion.recording import MICROSECONDS, BoolArray, Float64Array, IntArray, Segment
from acromion.fusion.runs import EvenRun, find_part, find_part_rows, find_parts, find_runs

# Four speeds of the upper arm, deg/s. They are not interchangeable.
#
# - ``inclination``: change of elevation. Does not include axial rotation, turning round and circumduction.
# - ``generalised``: speed of the vertical on the unit sphere, seen from the sensor (Hansson 2001).
# - ``generalised_accelerometer``: the same from low-passed acceleration alone on a 20 Hz grid; the kind for
#   which the level of 60 deg/s was proposed (Arvidsson 2021).
# - ``gyroscope``: magnitude of the angular rate minus its offset, after the metric filter on each axis.

# The metric filter on vectors, in overlapping blocks, so that memory does not grow with the recording.


BLOCK_ROWS = 32_768
MARGIN_S = 2.0  # after 2 s the effect of a cut on the 5 Hz filter is below 1e-19


def filter_blocks(vectors: Vertical, rate_hz: float) -> Iterator[tuple[int, Float64Array]]:
    """Yield the filtered vectors, shape (n, 3), as blocks (first row, vectors).

    Each block but the first begins with the last row of the one before, so that steps can be computed inside
    blocks. The result is that of filtering the whole.
    """
    margin = round(MARGIN_S * rate_hz)
    for first in range(0, max(len(vectors) - 1, 1), BLOCK_ROWS):
        stop = min(first + BLOCK_ROWS + 1, len(vectors))
        around = slice(max(first - margin, 0), stop + margin)
        filtered = filter_rows(vectors[around], rate_hz)
        yield first, filtered[first - around.start : stop - around.start]


# Frequency of the movement: mean power frequency and zero crossings of its speed.
#
# Both of the signed derivative of elevation. Those of elevation itself differ strongly (0.24 against 0.99 Hz
# for the same two-tone movement), so the name contains ``velocity``.


GRID_HZ = 20.0
WINDOW_STEPS = 1200  # a minute
HIGHEST_HZ = 5.0
DEAD_BAND_DPS = 10.0


class FrequencyTally:
    """Crossings and power of the speed of inclination in each 5-minute block.

    ``sums``: shape (2,): MPF times seconds, and seconds with an MPF.
    ``crossings``: shape (b,).
    ``moments``: shape (b, 2): sums of :func:`find_power_moments` over windows with their middle in the block.
    """

    def __init__(self, edges_us: IntArray) -> None:
        """Start with nothing counted."""
        self.edges_us, self.sums = edges_us, np.zeros(2)
        self.crossings, self.moments = np.zeros(len(edges_us) - 1), np.zeros((len(edges_us) - 1, 2))

    def add(self, angle: MetricAngle) -> None:
        """Count a segment."""
        rows = find_part_rows(angle, self.edges_us)
        count_crossings(angle.elevation_deg, angle.valid, angle.rate_hz, rows, self.crossings)
        for first, stop in find_runs(angle.valid):
            moments = find_power_moments(angle.elevation_deg[first:stop], angle.rate_hz)
            frequency_hz = divide_moments(moments)
            if frequency_hz is not None:
                seconds = (stop - first) / angle.rate_hz
                self.sums[:] += (frequency_hz * seconds, seconds)
                np.add.at(self.moments, self._find_blocks(angle, first, len(moments)), moments)

    def _find_blocks(self, angle: MetricAngle, first_row: int, windows: int) -> IntArray:
        """Return the block of the middle of each window; windows overlap by half."""
        middles_s = first_row / angle.rate_hz + (np.arange(windows) + 1) * (WINDOW_STEPS / 2 / GRID_HZ)
        middles_us = angle.start_us + middles_s * MICROSECONDS
        return np.asarray(np.clip(find_parts(self.edges_us, middles_us), 0, len(self.moments) - 1), np.int64)

    def summarise(self, analysed_s: float) -> Frequency:
        """Return the mean over the unbroken runs of a minute or more, and crossings per hour."""
        weighted, seconds = (float(value) for value in self.sums)
        crossings = float(self.crossings.sum())
        return Frequency(weighted / seconds if seconds else None, crossings * 3600.0 / analysed_s)

    def draw(self, frequency: Frequency, draws: Resampling, block_s: Float64Array) -> Figures:
        """Draw the figures with the sampling of the day only: a constant error does not change a speed."""
        found: Figures = {}
        if frequency.inclination_velocity_mpf_hz is not None:
            drawn = draws.sum(self.moments)
            drawn_hz = drawn[:, 0] / np.where(drawn[:, 1] > 0, drawn[:, 1], np.nan)
            coarse_hz = divide_moments(self.moments) or 0.0
            found["inclination_velocity_mpf_hz"] = scale_draws(
                frequency.inclination_velocity_mpf_hz, drawn_hz, coarse_hz
            )
        drawn_per_h = draws.sum(self.crossings) * 3600.0 / draws.sum(block_s)
        return {**found, "inclination_velocity_zero_crossings_per_h": drawn_per_h}


def find_mean_power_frequency(angle_deg: Float64Array, rate_hz: float) -> float | None:
    """Return sum(f P) / sum(P) of the speed of inclination; None under a minute or without movement."""
    return divide_moments(find_power_moments(angle_deg, rate_hz))


def divide_moments(moments: Float64Array) -> float | None:
    """Return the mean power frequency of all windows, shape (w, 2); None without power."""
    weighted, power = moments.sum(axis=0)
    return float(weighted / power) if power > 0.0 else None


def find_power_moments(angle_deg: Float64Array, rate_hz: float) -> Float64Array:
    """Return sum(f P) and sum(P) of each window of the speed of inclination, 0 to 5 Hz, shape (w, 2).

    Welch: Hann windows of 60 s that overlap by half, each minus its mean, of the speed on a 20 Hz grid. The
    attenuation of high frequencies by the difference between grid points is compensated. Under a minute: no
    window.
    """
    steps = int(len(angle_deg) * GRID_HZ / rate_hz)
    if rate_hz < GRID_HZ or steps <= WINDOW_STEPS:
        return np.zeros((0, 2))
    speeds_dps = np.diff(_take_grid(angle_deg, rate_hz / GRID_HZ, steps)) * GRID_HZ
    windows = np.lib.stride_tricks.sliding_window_view(speeds_dps, WINDOW_STEPS)[:: WINDOW_STEPS // 2]
    frequencies_hz = np.fft.rfftfreq(WINDOW_STEPS, 1 / GRID_HZ)
    wanted = (frequencies_hz > 0) & (frequencies_hz <= HIGHEST_HZ)
    put_back = np.where(wanted, 1.0 / np.sinc(frequencies_hz / GRID_HZ) ** 2, 0.0)
    return _sum_spectra(windows, np.stack([frequencies_hz * put_back, put_back], axis=1))


def _sum_spectra(windows: Float64Array, weights: Float64Array) -> Float64Array:
    """Sum each window's power spectrum with weights, (601, 2): shape (w, 2); a few windows at a time."""
    hann = np.hanning(WINDOW_STEPS + 1)[:-1]
    sums = np.empty((len(windows), 2))
    for first in range(0, len(windows), 64):
        part = windows[first : first + 64]
        spectra = np.fft.rfft((part - part.mean(axis=1, keepdims=True)) * hann)
        power = spectra.real**2 + spectra.imag**2
        for column in range(2):  # not by BLAS, whose sums differ between machines
            sums[first : first + 64, column] = (power * weights[:, column]).sum(axis=1)
    return sums


@kernel_making_arrays
def _take_grid(angle_deg, rows_per_step, steps):  # type: ignore[no-untyped-def]
    """Interpolate linearly to the grid."""
    grid = np.empty(steps)
    for k in range(steps):
        row = min(int(k * rows_per_step), max(len(angle_deg) - 2, 0))
        following = min(row + 1, len(angle_deg) - 1)
        share = k * rows_per_step - row
        grid[k] = angle_deg[row] + share * (angle_deg[following] - angle_deg[row])
    return grid


@kernel
def count_crossings(angle_deg, valid, rate_hz, part_rows, counts):  # type: ignore[no-untyped-def]
    """Count the reversals in each part.

    A reversal is a change from a speed beyond the dead band in one direction to one beyond it in the other.
    """
    part, direction = 0, 0
    for i in range(1, len(angle_deg)):
        if not (valid[i] and valid[i - 1]):
            direction = 0
            continue
        speed_dps = (angle_deg[i] - angle_deg[i - 1]) * rate_hz
        way = 1 if speed_dps > DEAD_BAND_DPS else (-1 if speed_dps < -DEAD_BAND_DPS else 0)
        if way != 0:
            if way == -direction:
                while i >= part_rows[part + 1]:
                    part += 1
                counts[part] += 1
            direction = way


CELL_DPS = 0.01
CELLS = 400_000
PERCENTS = (10, 50, 90, 99)

WIDENING = 1.02
WHOLE_US = np.array([0, 1 << 62], np.int64)
DEG_PER_HALF_RAD = 360.0 / np.pi


COARSE_OF_CELL: NDArray[np.int32] = np.concatenate(
    [[0], 1 + np.floor(np.log(np.arange(1, CELLS + 1)) / np.log(WIDENING))]
).astype(np.int32)
"""The coarse cell that contains each cell. The first stays alone; each later one is 2 % wider."""
COARSE_CELLS = int(COARSE_OF_CELL[-1]) + 1


class SpeedTally:
    """Seconds in each 0.01 deg/s cell, ``cell_s``; the first cell contains speeds of exactly 0.

    ``block_s``: shape (b, 654): the same seconds for each 5-minute block, in cells that widen by 2 %.
    ``way_deg``: shape (b,): the total rotation. Speeds over 4000 deg/s share the last cell.
    """

    def __init__(self, edges_us: IntArray = WHOLE_US) -> None:
        """Start with nothing counted; by default in one block."""
        self.edges_us, self.cell_s = edges_us, np.zeros(CELLS + 1)
        self.block_s = np.zeros((len(edges_us) - 1, COARSE_CELLS))
        self.way_deg = np.zeros(len(edges_us) - 1)

    def add(self, run: EvenRun, first_row: int, speeds_dps: Float64Array, rate_hz: float) -> None:
        """Count speeds (NaN: none) of a run's rows from ``first_row`` on, at their own rate."""
        start_us = run.start_us + round(first_row * MICROSECONDS / run.rate_hz)
        step_us = MICROSECONDS / rate_hz
        cells = (self.cell_s, self.block_s, self.way_deg)
        _tally_speeds(speeds_dps, 1.0 / rate_hz, (start_us, step_us, self.edges_us, COARSE_OF_CELL), cells)

    def add_inclination(self, angle: MetricAngle) -> None:
        """Count a segment's change of elevation."""
        for first in range(0, max(len(angle) - 1, 1), BLOCK_ROWS):
            rows = slice(first, first + BLOCK_ROWS + 1)
            speeds_dps = measure_inclination(angle.elevation_deg[rows], angle.valid[rows], angle.rate_hz)
            self.add(angle, first, speeds_dps[1:], angle.rate_hz)

    def add_accelerometer(self, segment: Segment, valid: BoolArray) -> None:
        """Count the rotation speed of a segment's low-passed acceleration, on a 20 Hz grid."""
        rows_per_step = segment.rate_hz / GRID_HZ
        grid_g = np.zeros((int((len(segment) - 1) / rows_per_step) + 1, 3))
        for first, acc_g in filter_blocks(segment.acc_g, segment.rate_hz):
            _fill_grid(acc_g, first, rows_per_step, grid_g)
        steps = _find_valid_steps(valid, rows_per_step, len(grid_g))
        self.add(segment, 0, measure_turns(grid_g, steps, GRID_HZ), GRID_HZ)

    def add_gyroscope(self, segment: Segment, bias_dps: Float64Array, valid: BoolArray) -> None:
        """Count the magnitude of the filtered angular rate minus its offset."""
        for first, gyr_dps in filter_blocks(segment.gyr_dps, segment.rate_hz):
            fresh = slice(1 if first else 0, None)  # a block repeats the last row of the previous one
            rows = valid[first : first + len(gyr_dps)]
            speeds_dps = measure_magnitude(gyr_dps[fresh], bias_dps, rows[fresh])
            self.add(segment, first, speeds_dps, segment.rate_hz)

    def summarise(self) -> Velocity | None:
        """Return percentiles and mean; None if no speed was counted."""
        total_s = float(self.cell_s.sum())
        if total_s == 0.0:
            return None
        places = find_percentile_cells(self.cell_s[np.newaxis], np.array(PERCENTS, np.float64))[0]
        speeds_dps = np.maximum(places - 1.0, 0.0) * CELL_DPS
        p10, p50, p90, p99 = (float(speed) for speed in speeds_dps)
        return Velocity(p10, p50, p90, p99, float(self.way_deg.sum()) / total_s)

    def draw(self, kind: str, velocity: Velocity, draws: Resampling) -> Figures:
        """Draw the speeds of one kind with the sampling of the day only."""
        drawn_s = draws.sum(self.block_s)
        drawn, coarse = _find_speeds(drawn_s), _find_speeds(self.block_s.sum(axis=0)[np.newaxis])[0]
        values = (velocity.p10_dps, velocity.p50_dps, velocity.p90_dps, velocity.p99_dps)
        total_s = drawn_s.sum(axis=1)
        lacking = np.full(len(total_s), np.nan)  # a draw that contains only short pieces has no speed
        means = np.divide(draws.sum(self.way_deg), total_s, out=lacking, where=total_s > 0.0)
        found = {
            f"{kind}_velocity_p{p}_dps": scale_draws(value, drawn[:, k], coarse[k])
            for k, (p, value) in enumerate(zip(PERCENTS, values, strict=True))
        }
        return {**found, f"{kind}_velocity_mean_dps": means}


def _find_speeds(block_s: Float64Array) -> Float64Array:
    """Return P10, P50, P90 and P99 from cells that widen by 2 %, shape (k, 654): shape (k, 4), deg/s."""
    edges_dps = np.concatenate([[0.0, 0.0], CELL_DPS * WIDENING ** np.arange(1, COARSE_CELLS)])
    places = find_percentile_cells(block_s, np.array(PERCENTS, np.float64))
    return np.asarray(np.interp(places, np.arange(len(edges_dps)), edges_dps))


def measure_generalised(segment: ElevationSegment, valid: BoolArray) -> Iterator[tuple[int, Float64Array]]:
    """Yield the speed of a segment's filtered, renormalised vertical: (first row, speeds) block by block.

    The speed of a row is that of the step to it; NaN if there is none.
    """
    if segment.vertical is None:
        return
    for first, vertical in filter_blocks(segment.vertical, segment.rate_hz):
        speeds_dps = measure_turns(vertical, valid[first : first + len(vertical)], segment.rate_hz)
        yield (first + 1, speeds_dps[1:]) if first else (0, speeds_dps)


@kernel
def _tally_speeds(speeds_dps, period_s, where, cells):  # type: ignore[no-untyped-def]
    """Add each step's speed to its cell, and to that of its 5-minute block."""
    start_us, step_us, edges_us, coarse_of_cell = where
    cell_s, block_s, way_deg = cells
    block = max(find_part(edges_us, start_us), 0)
    last = len(block_s) - 1
    next_row = (edges_us[block + 1] - start_us) / step_us
    for i in range(len(speeds_dps)):
        speed_dps = speeds_dps[i]
        while i >= next_row and block < last:
            block += 1
            next_row = (edges_us[block + 1] - start_us) / step_us
        if speed_dps >= 0.0:  # not NaN
            cell = 0 if speed_dps == 0.0 else 1 + min(int(speed_dps / CELL_DPS), CELLS - 1)
            cell_s[cell] += period_s
            block_s[block, coarse_of_cell[cell]] += period_s
            way_deg[block] += speed_dps * period_s


@kernel_making_arrays
def measure_inclination(angle_deg, valid, rate_hz):  # type: ignore[no-untyped-def]
    """Return the speed of each step between successive valid rows, NaN for the others."""
    speeds_dps = np.full(len(angle_deg), np.nan)
    for i in range(1, len(angle_deg)):
        if valid[i] and valid[i - 1]:
            speeds_dps[i] = abs(angle_deg[i] - angle_deg[i - 1]) * rate_hz
    return speeds_dps


@kernel_making_arrays
def measure_turns(vectors, valid, rate_hz):  # type: ignore[no-untyped-def]
    """Return the angle between the directions of successive valid rows, from the chord of the unit sphere."""
    speeds_dps = np.full(len(vectors), np.nan)
    bx, by, bz, before = 0.0, 0.0, 0.0, False
    for i in range(len(vectors)):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        here = valid[i] and length > 1e-9
        if here:
            scale = 1.0 / length
            x, y, z = x * scale, y * scale, z * scale
        if here and before:
            half = 0.5 * np.sqrt((x - bx) ** 2 + (y - by) ** 2 + (z - bz) ** 2)
            if half < 0.01:  # series of the arcsine: within 1e-13, and much faster
                half *= 1.0 + half * half * (1.0 / 6.0 + half * half * 0.075)
            else:
                half = np.arcsin(min(half, 1.0))
            speeds_dps[i] = half * rate_hz * DEG_PER_HALF_RAD
        bx, by, bz, before = x, y, z, here
    return speeds_dps


@kernel_making_arrays
def measure_magnitude(rates_dps, bias_dps, valid):  # type: ignore[no-untyped-def]
    """Return the length of each valid row's vector minus the offset."""
    speeds_dps = np.full(len(rates_dps), np.nan)
    for i in range(len(rates_dps)):
        if valid[i]:
            x = rates_dps[i, 0] - bias_dps[0]
            y = rates_dps[i, 1] - bias_dps[1]
            z = rates_dps[i, 2] - bias_dps[2]
            speeds_dps[i] = np.sqrt(x * x + y * y + z * z)
    return speeds_dps


@kernel
def _fill_grid(vectors, first, rows_per_step, grid):  # type: ignore[no-untyped-def]
    """Interpolate the grid points within this block linearly between its rows."""
    stop = first + len(vectors) - 1
    for k in range(int(np.ceil(first / rows_per_step)), len(grid)):
        place = k * rows_per_step - first
        if place > stop - first:
            break
        row = min(int(place), max(len(vectors) - 2, 0))
        following = min(row + 1, len(vectors) - 1)
        for c in range(3):
            grid[k, c] = vectors[row, c] + (place - row) * (vectors[following, c] - vectors[row, c])


@kernel_making_arrays
def _find_valid_steps(valid, rows_per_step, steps):  # type: ignore[no-untyped-def]
    """Return valid grid points: all rows since the previous point, and the row after it, must be valid."""
    valid_steps = np.ones(steps, np.bool_)
    for k in range(steps):
        first = int((k - 1) * rows_per_step) if k else 0
        for i in range(first, min(int(np.ceil(k * rows_per_step)) + 1, len(valid))):
            valid_steps[k] &= valid[i]
    return valid_steps


# Rainflow cycles of elevation (ASTM E1049-85 §5.4.4).

HYSTERESIS_DEG = 5.0
RANGE_EDGES_DEG = (10.0, 30.0, 60.0, 90.0, None)
USUAL_POINTS = 65536


class CycleTally:
    """Cycles by error of the angle, 5-minute block and class of range: ``counts``, shape (g, b, 4).

    A half cycle counts 0.5. Runs of valid rows are counted separately. Ranges under 10 deg are in no class. A
    cycle belongs to the block in which its range ends.
    """

    def __init__(self, errors_deg: Float64Array, edges_us: IntArray) -> None:
        """Start with nothing counted; ``errors_deg``, shape (g,), has 0 in the middle."""
        self.errors_deg, self.edges_us = errors_deg, edges_us
        self.counts = np.zeros((len(errors_deg), len(edges_us) - 1, len(RANGE_EDGES_DEG) - 1))

    def add(self, angle: MetricAngle) -> None:
        """Count a segment: with an error b each angle is b lower, clipped to 0 and 180 deg.

        Clipping the turning points gives the same ranges as clipping the angle, except for some ranges
        smaller than the hysteresis. Those lie inside other ranges and belong to no class.
        """
        points_deg, runs, rows = find_turning_points(angle, HYSTERESIS_DEG)
        parts = find_parts(find_part_rows(angle, self.edges_us), rows)
        as_read = np.zeros(self.counts.shape[1:])
        _count_ranges(points_deg, runs, parts, as_read)
        lowest, highest = points_deg.min(initial=180.0), points_deg.max(initial=0.0)
        for error, error_deg in enumerate(self.errors_deg):
            if lowest >= error_deg and highest - error_deg <= 180.0:
                self.counts[error] += as_read  # nothing is clipped, so no range changes
            else:
                clipped_deg = np.clip(points_deg - error_deg, 0.0, 180.0)
                _count_ranges(clipped_deg, runs, parts, self.counts[error])

    def summarise(self) -> tuple[Cycles, ...]:
        """Return the counts of the angle as measured."""
        counts = self.counts[len(self.errors_deg) // 2].sum(axis=0)
        return tuple(
            Cycles(float(lower or 0.0), upper, float(count))
            for (lower, upper), count in zip(pairwise(RANGE_EDGES_DEG), counts, strict=True)
        )

    def draw(self, draws: Resampling, block_s: Float64Array) -> Figures:
        """Draw the counts: the sampling of the day, and an error of the angle.

        An error only changes a range if it moves the angle to an end of its scale.
        """
        share = draws.sum(block_s) / block_s.sum()
        drawn = draws.sum_with_error(self.counts, self.errors_deg) / share[:, np.newaxis]
        ends = [f"{edge:g}" if edge is not None else "up" for edge in RANGE_EDGES_DEG]
        return {
            f"cycles_{lower}_{upper}_count": drawn[:, k] for k, (lower, upper) in enumerate(pairwise(ends))
        }


def _count_ranges(points_deg: Float64Array, runs: IntArray, parts: IntArray, counts: Float64Array) -> None:
    ranges_deg, weights, ends = count_rainflow(points_deg, runs)
    # the angle is rounded to 1e-6 deg, so the difference of two angles is rounded too
    classes = np.searchsorted(RANGE_EDGES_DEG[:-1], np.round(ranges_deg, 6), side="right") - 1
    kept = classes >= 0
    np.add.at(counts, (parts[ends[kept]], classes[kept]), weights[kept])


def find_turning_points(angle: MetricAngle, hysteresis_deg: float) -> tuple[Float64Array, IntArray, IntArray]:
    """Return the peaks and valleys left after a hysteresis filter, the valid run of each, and its row.

    A reversal counts once the angle has returned by the hysteresis; the first and the last extreme of a run
    are turning points.
    """
    points_deg, places = np.empty(USUAL_POINTS), np.empty((USUAL_POINTS, 2), np.int64)
    count = _scan_turning_points(angle.elevation_deg, angle.valid, hysteresis_deg, points_deg, places)
    if count > len(points_deg):
        points_deg, places = np.empty(count), np.empty((count, 2), np.int64)
        _scan_turning_points(angle.elevation_deg, angle.valid, hysteresis_deg, points_deg, places)
    return points_deg[:count], places[:count, 0], places[:count, 1]


@kernel
def _scan_turning_points(angle_deg, valid, hysteresis_deg, points_deg, places):  # type: ignore[no-untyped-def]
    """Write as many turning points as the buffers can store; return how many there are.

    ``direction`` is 0 until the run has moved by the hysteresis, then 1 on the way up, -1 on the way down;
    ``low`` and ``high`` are the extremes since the last turning point, at the rows ``at_low``, ``at_high``.
    """
    count, run, direction, low, high = 0, 0, 0, np.inf, -np.inf
    at_low, at_high = 0, 0
    for i in range(len(angle_deg) + 1):
        if i == len(angle_deg) or not valid[i]:
            if direction != 0:
                point_deg, row = (high, at_high) if direction > 0 else (low, at_low)
                count = _write_point(points_deg, places, count, point_deg, (run, row))
            run, direction, low, high = run + 1, 0, np.inf, -np.inf
            continue
        x = angle_deg[i]
        if x < low:
            low, at_low = x, i
        if x > high:
            high, at_high = x, i
        if direction <= 0 and x - low >= hysteresis_deg:
            count = _write_point(points_deg, places, count, low, (run, at_low))
            direction, high, at_high = 1, x, i
        elif direction >= 0 and high - x >= hysteresis_deg:
            count = _write_point(points_deg, places, count, high, (run, at_high))
            direction, low, at_low = -1, x, i
    return count


@inner
def _write_point(points_deg, places, count, point_deg, place):  # type: ignore[no-untyped-def]
    if count < len(points_deg):
        points_deg[count] = point_deg
        places[count, 0], places[count, 1] = place
    return count + 1


@kernel_making_arrays
def count_rainflow(points, runs):  # type: ignore[no-untyped-def]
    """Return the ranges of each run, their counts (1 or 0.5) and the point at which each ends.

    ASTM E1049-85 §5.4.4 with the open points on a stack: the last range X closes the previous one, Y, if X >=
    Y. A Y that contains the starting point is a half cycle, as are all ranges that remain at the end.
    """
    ranges, weights = np.empty(len(points)), np.empty(len(points))
    ends, stack = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    count, top = 0, 0
    for k in range(len(points) + 1):
        if k == len(points) or (k > 0 and runs[k] != runs[k - 1]):
            for j in range(1, top):
                ranges[count], weights[count] = abs(points[stack[j]] - points[stack[j - 1]]), 0.5
                ends[count] = stack[j]
                count += 1
            top = 0
        if k == len(points):
            break
        stack[top] = k
        top += 1
        while top >= 3:
            x = abs(points[stack[top - 1]] - points[stack[top - 2]])
            y = abs(points[stack[top - 2]] - points[stack[top - 3]])
            if x < y:
                break
            ranges[count], weights[count], ends[count] = y, 0.5 if top == 3 else 1.0, stack[top - 2]
            count += 1
            if top == 3:
                stack[0], stack[1] = stack[1], stack[2]
                top = 2
            else:
                stack[top - 3] = stack[top - 1]
                top -= 2
    return ranges[:count], weights[:count], ends[:count]
