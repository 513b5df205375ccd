"""Scale of the accelerometer: how long gravity reads at rest, in all the directions that were seen.

A part's own few per cent belong to the fusion (:mod:`fusion.sensor_errors.accelerometer`), whose fit is held
to what parts have. A factor past that, as a wrong sensitivity leaves, makes it give up, or pass the factor
off as an offset, which bends every angle. Offset and factor are told apart by rests in many directions only:
at one, both read alike.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.rest_probes import tell_directions

Table = NDArray[np.float64]

CELL_DEG, FEWEST_DIRECTIONS = 10.0, 6
CELL_G, STILL_G = 0.002, 0.004
"""Standard deviation of the length at a direction, and of a single rest."""
OFFSET_G = 0.04
"""What parts have, one standard deviation (LSM9DS1: 90 mg at most)."""
SCALE_TOLERANCE, AXIS_TOLERANCE = 0.03, 0.05
"""Simulated parts, ten of each device, come out within 0.015, their axes within 0.021."""
ERRORS = 6.0
MOST_LEFT_G = 0.015
"""What may be left unexplained: rests of a part read within this of 1 g once it is calibrated."""
ROUNDS = 12


@dataclass(frozen=True, slots=True, eq=False)
class RestScale:
    """What to multiply the acceleration by: on all axes alike, and on each (3,), with standard errors.

    ``left_g``: how far from 1 g rests still read with either (root mean square over directions).
    """

    overall: float
    error: float
    left_g: float
    axes: Table
    axes_errors: Table
    axes_left_g: float

    @property
    def is_overall_off(self) -> bool:
        """Surely by more than parts are."""
        away = abs(self.overall - 1.0)
        return self.is_even and away > max(SCALE_TOLERANCE, ERRORS * self.error)

    @property
    def is_even(self) -> bool:
        """Whether a factor and an offset explain what is read at rest."""
        return self.left_g < MOST_LEFT_G

    @property
    def is_axis_off(self) -> bool:
        """Whether one axis surely has a scale of its own."""
        away = np.abs(self.axes / np.median(self.axes) - 1.0)
        is_far = away > np.maximum(AXIS_TOLERANCE, ERRORS * self.axes_errors)
        return self.axes_left_g < MOST_LEFT_G and bool(np.any(is_far))


def measure_rest_scale(rests_g: Table) -> RestScale | None:
    """Fit factors and offset to mean accelerations at rest, (n, 3); None from too few directions."""
    length_g = np.linalg.norm(rests_g, axis=1)
    rests_g, length_g = rests_g[length_g > 0.0], length_g[length_g > 0.0]
    cell = tell_directions(rests_g / length_g[:, None], CELL_DEG)
    if len(cell) == 0 or cell.max() + 1 < FEWEST_DIRECTIONS:
        return None
    reading_g, count = _average(rests_g, cell)
    variance = CELL_G**2 + STILL_G**2 / count
    values, errors, left_g = _fit(reading_g, variance, np.ones((3, 1)))
    axes, axes_errors, axes_left_g = _fit(reading_g, variance, np.eye(3))
    return RestScale(float(values[0]), float(errors[0]), left_g, axes, axes_errors, axes_left_g)


def _average(rests_g: Table, cell: NDArray[np.intp]) -> tuple[Table, Table]:
    """One reading for each direction, (c, 3), so that no pose outvotes the others, and how many rests, (c,).

    The median length in the mean direction: the mean itself is too short by the spread of the directions.
    """
    length_g, count = np.linalg.norm(rests_g, axis=1), np.bincount(cell)
    mean_g = np.array([rests_g[cell == k].mean(axis=0) for k in range(len(count))])
    median_g = np.array([np.median(length_g[cell == k]) for k in range(len(count))])
    return mean_g * (median_g / np.linalg.norm(mean_g, axis=1))[:, None], count.astype(np.float64)


def _fit(reading_g: Table, variance: Table, shape: Table) -> tuple[Table, Table, float]:
    """Factors along the columns of ``shape`` (3, p), their errors, and what is left, with Cauchy weights."""
    p = shape.shape[1]
    values = np.concatenate([np.ones(p), np.zeros(3)])
    prior = np.diag(np.concatenate([np.full(p, 1.0), np.full(3, OFFSET_G**-2.0)]))
    start = values.copy()
    for _ in range(ROUNDS):
        factors, bare = shape @ values[:p], reading_g - values[p:]
        length = np.linalg.norm(bare * factors, axis=1)
        by_axis = bare**2 * factors / length[:, None]
        slope = np.hstack([by_axis @ shape, -bare * factors**2 / length[:, None]])
        weight = 1.0 / (variance + ((length - 1.0) / 2.385) ** 2)
        normal = (weight[:, None] * slope).T @ slope + prior
        values = values - np.linalg.solve(
            normal, slope.T @ (weight * (length - 1.0)) + prior @ (values - start)
        )
    errors = np.sqrt(np.diag(np.linalg.inv(normal)))
    return shape @ values[:p], shape @ errors[:p], float(np.sqrt(np.mean((length - 1.0) ** 2)))
