"""Offset and scale of the accelerometer, from the recording's own still moments.

At rest the length of the acceleration is 1 g in whatever direction it points. With still moments in many
directions this gives three offsets and three scales. What few directions cannot tell is left to the priors:
the correction is pulled towards none, so that a file with a single pose is not bent, and it is bounded.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.sensor_errors.stillness import QuietTable

Table = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AccelerometerSettings:
    """How far the data may pull.

    ``offset_g`` and ``scale`` are the standard deviations expected of parts as delivered, the bounds are
    three times that; ``still_g`` is the error of the length in one direction, however many moments share
    it; ``cell_deg`` says what counts as one direction; fewer than ``least_directions`` give no correction.
    """

    offset_g: float = 0.04
    scale: float = 0.01
    still_g: float = 0.003
    cell_deg: float = 10.0
    least_directions: int = 4
    rounds: int = 8


@dataclass(frozen=True, slots=True, eq=False)
class AccelerometerCorrection:
    """``scale * (acceleration - offset_g)``, per axis, shapes (3,).

    ``directions`` counts the distinct directions it rests on; ``residual_g`` (before, after) is the root mean
    square departure from 1 g over them.
    """

    offset_g: Table
    scale: Table
    directions: int = 0
    residual_g: tuple[float, float] = (0.0, 0.0)

    def apply(self, acc_g: Table) -> Table:
        """Correct accelerations, shape (..., 3)."""
        return np.asarray(self.scale * (acc_g - self.offset_g))


def leave_accelerometer() -> AccelerometerCorrection:
    """No correction."""
    return AccelerometerCorrection(np.zeros(3), np.ones(3))


def calibrate_accelerometer(
    stills: QuietTable, settings: AccelerometerSettings | None = None
) -> AccelerometerCorrection:
    """Fit offset and scale so that every direction reads 1 g, by damped least squares with Cauchy weights.

    Returns no correction where there are too few directions, where a bound is passed, or where the departure
    from 1 g does not become smaller.
    """
    settings = settings or AccelerometerSettings()
    directions = _average_directions(stills.gravity_g, settings.cell_deg)
    if len(directions) < settings.least_directions:
        return leave_accelerometer()
    solution = _fit(directions, settings)
    offset_g, scale = solution[:3], 1.0 + solution[3:]
    before = float(np.sqrt(np.mean((np.linalg.norm(directions, axis=1) - 1.0) ** 2)))
    after = float(np.sqrt(np.mean((np.linalg.norm(scale * (directions - offset_g), axis=1) - 1.0) ** 2)))
    bounded = (
        np.abs(offset_g).max() < 3.0 * settings.offset_g and np.abs(scale - 1.0).max() < 3.0 * settings.scale
    )
    if not bounded or after >= before:
        return leave_accelerometer()
    return AccelerometerCorrection(offset_g, scale, len(directions), (before, after))


def _average_directions(gravity_g: Table, cell_deg: float) -> Table:
    """One reading for each occupied cell of the sphere, (d, 3), so that no pose outvotes the others."""
    unit = gravity_g / np.maximum(np.linalg.norm(gravity_g, axis=1, keepdims=True), 1e-9)
    cells = np.round(unit / np.radians(cell_deg)).astype(np.int64)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    cell = cell.ravel()
    order = np.argsort(cell, kind="stable")
    groups = np.split(gravity_g[order], np.flatnonzero(np.diff(cell[order])) + 1) if len(order) else []
    return np.array([_represent(group) for group in groups]).reshape(-1, 3)


def _represent(readings: Table) -> Table:
    """Median length in the mean direction (the mean itself would be too short by the spread of the cell)."""
    mean = readings.mean(axis=0)
    return np.asarray(mean * (np.median(np.linalg.norm(readings, axis=1)) / np.linalg.norm(mean)))


def _fit(directions: Table, settings: AccelerometerSettings) -> Table:
    """Offsets (3) and scales less one (3)."""
    solution = np.zeros(6)
    prior = 1.0 / np.repeat([settings.offset_g, settings.scale], 3) ** 2
    for _ in range(settings.rounds):
        corrected = (1.0 + solution[3:]) * (directions - solution[:3])
        length = np.linalg.norm(corrected, axis=1, keepdims=True)
        along = corrected / length
        slope = np.hstack([-along * (1.0 + solution[3:]), along * (directions - solution[:3])])
        miss = length[:, 0] - 1.0
        weight = 1.0 / (settings.still_g**2 + (miss / 2.385) ** 2)
        normal = (slope * weight[:, None]).T @ slope + np.diag(prior)
        solution = solution - np.linalg.solve(normal, slope.T @ (weight * miss) + prior * solution)
    return solution
