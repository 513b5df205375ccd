"""Four speeds of the upper arm, deg/s (EXPOSURE.md A3). They are not interchangeable.

- ``inclination``: change of elevation. Blind to axial rotation, turning round and circumduction.
- ``generalised``: speed of the vertical on the unit sphere, seen from the sensor (Hansson 2001).
- ``generalised_accelerometer``: the same from low-passed acceleration alone on a 20 Hz grid; the kind for
  which the level of 60 deg/s was proposed (Arvidsson 2021).
- ``gyroscope``: magnitude of the angular rate less its offset, axis by axis behind the metric filter.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.elevation import ElevationSegment
from fusion.exposure.bins import find_percentile_cells
from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.rows import EvenRun, IntArray
from fusion.exposure.types import Velocity
from fusion.exposure.vector_filter import BLOCK_ROWS, filter_blocks
from fusion.recording import MICROSECONDS, BoolArray, Segment

CELL_DPS = 0.01
CELLS = 400_000
PERCENTS = (10, 50, 90, 99)
GRID_HZ = 20.0
WIDENING = 1.02
DEG_PER_HALF_RAD = 360.0 / np.pi

FloatVector = NDArray[np.float64]


def _widen_cells() -> NDArray[np.int32]:
    """Give the coarse cell of each cell: the first is its own, the others widen by 2 %."""
    cells = np.arange(1, CELLS + 1)
    coarse = 1 + np.floor(np.log(cells) / np.log(WIDENING))
    return np.concatenate([[0], coarse]).astype(np.int32)


COARSE_OF_CELL = _widen_cells()
COARSE_CELLS = int(COARSE_OF_CELL[-1]) + 1


@dataclass(frozen=True, slots=True, eq=False)
class SpeedTally:
    """Seconds in each 0.01 deg/s cell, filled in place; the first cell holds speeds of exactly nought.

    ``edges_us`` are 5-minute blocks; ``block_s``, shape (b, 654), holds the same seconds once more, for each
    block and in cells that widen by 2 %; ``way_deg``, shape (b,), is the way turned. Speeds past
    4000 deg/s share the last cell.
    """

    edges_us: IntArray = field(default_factory=lambda: np.array([0, 1 << 62], np.int64))
    cell_s: FloatVector = field(default_factory=lambda: np.zeros(CELLS + 1))
    block_s: NDArray[np.float64] = field(init=False)
    way_deg: FloatVector = field(init=False)

    def __post_init__(self) -> None:
        blocks = len(self.edges_us) - 1
        object.__setattr__(self, "block_s", np.zeros((blocks, COARSE_CELLS)))
        object.__setattr__(self, "way_deg", np.zeros(blocks))

    def add(self, run: EvenRun, first: int, speeds_dps: FloatVector, rate_hz: float) -> None:
        """Count speeds, NaN where there is none, of a run's rows from ``first`` on at a rate of their own."""
        start_us = run.start_us + round(first * MICROSECONDS / run.rate_hz)
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
        """Count how fast a segment's low-passed acceleration turns, on a 20 Hz grid."""
        rows_per_step = segment.rate_hz / GRID_HZ
        grid_g = np.zeros((int((len(segment) - 1) / rows_per_step) + 1, 3))
        for first, acc_g in filter_blocks(segment.acc_g, segment.rate_hz):
            _fill_grid(acc_g, first, rows_per_step, grid_g)
        steps = _find_valid_steps(valid, rows_per_step, len(grid_g))
        self.add(segment, 0, measure_turns(grid_g, steps, GRID_HZ), GRID_HZ)

    def add_gyroscope(self, segment: Segment, bias_dps: NDArray[np.float64], valid: BoolArray) -> None:
        """Count the magnitude of the filtered angular rate less its offset."""
        for first, gyr_dps in filter_blocks(segment.gyr_dps, segment.rate_hz):
            fresh = slice(1 if first else 0, None)  # a block repeats the last row of the one before
            rows = valid[first : first + len(gyr_dps)]
            speeds_dps = measure_magnitude(gyr_dps[fresh], bias_dps, rows[fresh])
            self.add(segment, first, speeds_dps, segment.rate_hz)

    def summarise(self) -> Velocity | None:
        """Give percentiles and mean, None where no speed was counted."""
        total_s = float(self.cell_s.sum())
        if total_s == 0.0:
            return None
        places = find_percentile_cells(self.cell_s[np.newaxis], np.array(PERCENTS, np.float64))[0]
        speeds_dps = np.maximum(places - 1.0, 0.0) * CELL_DPS
        p10, p50, p90, p99 = (float(speed) for speed in speeds_dps)
        return Velocity(p10, p50, p90, p99, float(self.way_deg.sum()) / total_s)


def measure_generalised(segment: ElevationSegment, valid: BoolArray) -> Iterator[tuple[int, FloatVector]]:
    """Give how fast a segment's filtered, renormalised vertical moves: (first row, speeds) block by block.

    The speed of a row is that of the step to it; NaN where there is none.
    """
    if segment.vertical is None:
        return
    for first, vertical in filter_blocks(segment.vertical, segment.rate_hz):
        speeds_dps = measure_turns(vertical, valid[first : first + len(vertical)], segment.rate_hz)
        yield (first + 1, speeds_dps[1:]) if first else (0, speeds_dps)


@njit(cache=True, nogil=True)
def _tally_speeds(speeds_dps, period_s, where, cells):  # type: ignore[no-untyped-def]
    """Add each step's speed to its cell, and to that of its 5-minute block."""
    start_us, step_us, edges_us, coarse_of_cell = where
    cell_s, block_s, way_deg = cells
    block = max(np.searchsorted(edges_us, start_us, side="right") - 1, 0)
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


@njit(cache=True, nogil=True)
def measure_inclination(angle_deg, valid, rate_hz):  # type: ignore[no-untyped-def]
    """Give the speed of each step between successive valid rows, NaN for the others."""
    speeds_dps = np.full(len(angle_deg), np.nan)
    for i in range(1, len(angle_deg)):
        if valid[i] and valid[i - 1]:
            speeds_dps[i] = abs(angle_deg[i] - angle_deg[i - 1]) * rate_hz
    return speeds_dps


@njit(cache=True, nogil=True)
def measure_turns(vectors, valid, rate_hz):  # type: ignore[no-untyped-def]
    """Give the angle between the directions of successive valid rows, from the chord of the unit sphere."""
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
            if half < 0.01:  # the series of the arcsine: within 1e-13 of it, and much faster
                half *= 1.0 + half * half * (1.0 / 6.0 + half * half * 0.075)
            else:
                half = np.arcsin(min(half, 1.0))
            speeds_dps[i] = half * rate_hz * DEG_PER_HALF_RAD
        bx, by, bz, before = x, y, z, here
    return speeds_dps


@njit(cache=True, nogil=True)
def measure_magnitude(rates_dps, bias_dps, valid):  # type: ignore[no-untyped-def]
    """Give the length of each valid row's vector less the offset."""
    speeds_dps = np.full(len(rates_dps), np.nan)
    for i in range(len(rates_dps)):
        if valid[i]:
            x = rates_dps[i, 0] - bias_dps[0]
            y = rates_dps[i, 1] - bias_dps[1]
            z = rates_dps[i, 2] - bias_dps[2]
            speeds_dps[i] = np.sqrt(x * x + y * y + z * z)
    return speeds_dps


@njit(cache=True, nogil=True)
def _fill_grid(vectors, first, rows_per_step, grid):  # type: ignore[no-untyped-def]
    """Take the grid points that lie in this block, linearly between its rows."""
    stop = first + len(vectors) - 1
    for k in range(int(np.ceil(first / rows_per_step)), len(grid)):
        place = k * rows_per_step - first
        if place > stop - first:
            break
        row = min(int(place), max(len(vectors) - 2, 0))
        following = min(row + 1, len(vectors) - 1)
        for c in range(3):
            grid[k, c] = vectors[row, c] + (place - row) * (vectors[following, c] - vectors[row, c])


@njit(cache=True, nogil=True)
def _find_valid_steps(valid, rows_per_step, steps):  # type: ignore[no-untyped-def]
    """A grid point is valid where every row since the grid point before, and the row after it, is."""
    valid_steps = np.ones(steps, np.bool_)
    for k in range(steps):
        first = int((k - 1) * rows_per_step) if k else 0
        for i in range(first, min(int(np.ceil(k * rows_per_step)) + 1, len(valid))):
            valid_steps[k] &= valid[i]
    return valid_steps
