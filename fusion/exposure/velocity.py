"""Four speeds of the upper arm, deg/s (EXPOSURE.md A3). They are not interchangeable.

- ``inclination``: change of elevation. Blind to axial rotation, turning round and circumduction.
- ``generalised``: speed of the vertical on the unit sphere, seen from the sensor (Hansson 2001).
- ``generalised_accelerometer``: the same from low-passed acceleration alone on a 20 Hz grid; the kind for
  which the level of 60 deg/s was proposed (Arvidsson 2021).
- ``gyroscope``: magnitude of the angular rate less its offset, axis by axis behind the metric filter.
"""

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.elevation import ElevationSegment
from fusion.exposure.bins import find_percentile_cells
from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.types import Velocity
from fusion.exposure.vector_filter import filter_blocks
from fusion.recording import BoolArray, Segment

CELL_DPS = 0.01
CELLS = 400_000
PERCENTS = (10, 50, 90, 99)
GRID_HZ = 20.0


def _empty_cells() -> NDArray[np.float64]:
    return np.zeros(CELLS + 1)


@dataclass(frozen=True, slots=True, eq=False)
class SpeedTally:
    """Seconds in each 0.01 deg/s cell, filled in place; the first cell holds speeds of exactly nought.

    ``sums``, shape (1,), is the way turned, deg; speeds past 4000 deg/s share the last cell.
    """

    cell_s: NDArray[np.float64] = field(default_factory=_empty_cells)
    sums: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))

    def add_inclination(self, angle: MetricAngle) -> None:
        """Count a segment's change of elevation."""
        _tally_inclination(angle.elevation_deg, angle.valid, angle.rate_hz, self.cell_s, self.sums)

    def add_generalised(self, segment: ElevationSegment, valid: BoolArray) -> None:
        """Count how fast a segment's filtered, renormalised vertical moves; no rows without a vertical."""
        if segment.vertical is None:
            return
        for first, vertical in filter_blocks(segment.vertical, segment.rate_hz):
            rows = valid[first : first + len(vertical)]
            _tally_turns(vertical, rows, segment.rate_hz, self.cell_s, self.sums)

    def add_accelerometer(self, segment: Segment, valid: BoolArray) -> None:
        """Count how fast a segment's low-passed acceleration turns, on a 20 Hz grid."""
        rows_per_step = segment.rate_hz / GRID_HZ
        grid_g = np.zeros((int((len(segment) - 1) / rows_per_step) + 1, 3))
        for first, acc_g in filter_blocks(segment.acc_g, segment.rate_hz):
            _fill_grid(acc_g, first, rows_per_step, grid_g)
        steps = _find_valid_steps(valid, rows_per_step, len(grid_g))
        _tally_turns(grid_g, steps, GRID_HZ, self.cell_s, self.sums)

    def add_gyroscope(self, segment: Segment, bias_dps: NDArray[np.float64], valid: BoolArray) -> None:
        """Count the magnitude of the filtered angular rate less its offset."""
        for first, gyr_dps in filter_blocks(segment.gyr_dps, segment.rate_hz):
            fresh = slice(1 if first else 0, None)  # a block repeats the last row of the one before
            rows = valid[first : first + len(gyr_dps)]
            turning_dps = gyr_dps[fresh] - bias_dps
            _tally_magnitude(turning_dps, rows[fresh], segment.rate_hz, self.cell_s, self.sums)

    def summarise(self) -> Velocity | None:
        """Give percentiles and mean, None where no speed was counted."""
        total_s = float(self.cell_s.sum())
        if total_s == 0.0:
            return None
        places = find_percentile_cells(self.cell_s[np.newaxis], np.array(PERCENTS, np.float64))[0]
        speeds_dps = np.maximum(places - 1.0, 0.0) * CELL_DPS
        p10, p50, p90, p99 = (float(speed) for speed in speeds_dps)
        return Velocity(p10, p50, p90, p99, float(self.sums[0]) / total_s)


@njit(cache=True, nogil=True)
def _tally_speed(speed_dps, period_s, cell_s, sums):  # type: ignore[no-untyped-def]
    """Add one step's speed."""
    cell = 0 if speed_dps == 0.0 else 1 + min(int(speed_dps / CELL_DPS), CELLS - 1)
    cell_s[cell] += period_s
    sums[0] += speed_dps * period_s


@njit(cache=True, nogil=True)
def _tally_inclination(angle_deg, valid, rate_hz, cell_s, sums):  # type: ignore[no-untyped-def]
    """Steps between successive valid rows."""
    for i in range(1, len(angle_deg)):
        if valid[i] and valid[i - 1]:
            _tally_speed(abs(angle_deg[i] - angle_deg[i - 1]) * rate_hz, 1.0 / rate_hz, cell_s, sums)


@njit(cache=True, nogil=True)
def _tally_turns(vectors, valid, rate_hz, cell_s, sums):  # type: ignore[no-untyped-def]
    """Angle between the directions of successive valid rows, from the chord of the unit sphere."""
    bx, by, bz, before = 0.0, 0.0, 0.0, False
    for i in range(len(vectors)):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        here = valid[i] and length > 1e-9
        if here:
            x, y, z = x / length, y / length, z / length
        if here and before:
            chord = np.sqrt((x - bx) ** 2 + (y - by) ** 2 + (z - bz) ** 2)
            turn_deg = np.degrees(2.0 * np.arcsin(min(0.5 * chord, 1.0)))
            _tally_speed(turn_deg * rate_hz, 1.0 / rate_hz, cell_s, sums)
        bx, by, bz, before = x, y, z, here


@njit(cache=True, nogil=True)
def _tally_magnitude(rates_dps, valid, rate_hz, cell_s, sums):  # type: ignore[no-untyped-def]
    """Length of each valid row's vector."""
    for i in range(len(rates_dps)):
        if valid[i]:
            x, y, z = rates_dps[i, 0], rates_dps[i, 1], rates_dps[i, 2]
            _tally_speed(np.sqrt(x * x + y * y + z * z), 1.0 / rate_hz, cell_s, sums)


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
