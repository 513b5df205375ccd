"""Plain arrays of one unbroken run, as the estimators take them."""

from dataclasses import dataclass
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import fused, inner, kernel
from fusion.recording import Float64Array, FloatArray, Segment

# The rotation between two samples, and how a vector moves with it.
#
# Time convention: the angular rate of sample k is the instantaneous rate at the time of sample k; between
# two samples it is a straight line (trapezoid), with the first coning term (Bortz 1971): the rotation
# vector over one period T is ``(w0 + w1) T / 2 + (w0 x w1) T^2 / 12``.


RADIANS = pi / 180.0
Scalars = tuple[float, float, float]
S1, S2, S3, S4 = 1.0 / 6.0, 1.0 / 20.0, 1.0 / 42.0, 1.0 / 72.0
C1, C2, C3, C4 = 1.0 / 24.0, 1.0 / 30.0, 1.0 / 56.0, 1.0 / 90.0
"""Ratios of successive terms of both series; products, because a division takes five times as long."""


@fused
def bend(before: Any, after: Any, period_s: float) -> Scalars:  # pragma: no cover
    """Rotation vector (rad) from one sample to the next; rates in rad/s, each a triple."""
    half, twelfth = 0.5 * period_s, period_s * period_s / 12.0
    x = half * (before[0] + after[0]) + twelfth * (before[1] * after[2] - before[2] * after[1])
    y = half * (before[1] + after[1]) + twelfth * (before[2] * after[0] - before[0] * after[2])
    z = half * (before[2] + after[2]) + twelfth * (before[0] * after[1] - before[1] * after[0])
    return x, y, z


@fused
def turn_factors(turn: Any) -> tuple[float, float]:  # pragma: no cover
    """``sin(a)/a`` and ``(1 - cos(a))/a^2`` of a rotation vector of length a, by series (1e-7 at 1 rad)."""
    square = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]
    sine = 1.0 - square * S1 * (1.0 - square * S2 * (1.0 - square * S3 * (1.0 - square * S4)))
    cosine = 0.5 - square * C1 * (1.0 - square * C2 * (1.0 - square * C3 * (1.0 - square * C4)))
    return sine, cosine


@fused
def carry(vector: Any, turn: Any, factors: Any) -> Scalars:  # pragma: no cover
    """Coordinates, after the sensor has turned by ``turn``, of a vector that is fixed in space.

    A fixed vector seen from a turning sensor turns backwards: ``exp(-[turn]x) vector``.
    """
    sine, cosine = factors
    x = turn[1] * vector[2] - turn[2] * vector[1]
    y = turn[2] * vector[0] - turn[0] * vector[2]
    z = turn[0] * vector[1] - turn[1] * vector[0]
    return (
        vector[0] - sine * x + cosine * (turn[1] * z - turn[2] * y),
        vector[1] - sine * y + cosine * (turn[2] * x - turn[0] * z),
        vector[2] - sine * z + cosine * (turn[0] * y - turn[1] * x),
    )


# Normal equations of three unknowns that are straight lines between knots.


BAND = 6
"""Three unknowns at each knot, and neighbours touch."""


JUMP_S = 0.02
"""Two knots so near each other stand for a jump, and are not held together."""


def hold_together(knots_s: Float64Array, sd_per_root_min: float) -> Float64Array:
    """Lower band of a random walk from knot to knot, the same for each of the three unknowns."""
    band = np.zeros((BAND, 3 * len(knots_s)))
    apart_s = np.diff(knots_s)
    stiffness = 1.0 / (sd_per_root_min**2 * np.maximum(apart_s, 1.0) / 60.0)
    stiffness[apart_s < 1.5 * JUMP_S] = 0.0
    per_axis = np.repeat(stiffness, 3)
    band[0, :-3] += per_axis
    band[0, 3:] += per_axis
    band[3, :-3] -= per_axis
    return band


def solve_band(band: Float64Array, right: Float64Array) -> Float64Array:
    """Solve a symmetric positive definite band for each row of the right side, by Cholesky's factors.

    ``band``: shape (d, n): the diagonal, then what stands so many places below it.
    ``right``: shape (m, n).

    Returns
    -------
    Float64Array
        Shape (m, n).

    Raises
    ------
    numpy.linalg.LinAlgError
        The band is not positive definite.
    """
    solved = right.copy()
    if not _solve_band(band.copy(), solved):
        raise np.linalg.LinAlgError("the band is not positive definite")
    return solved


@inner
def _factor_band(band):  # type: ignore[no-untyped-def] # pragma: no cover
    """Put the factor in place of the band; False where it has none."""
    depth, n = band.shape
    for j in range(n):
        if not band[0, j] > 0.0:
            return False
        band[0, j] = sqrt(band[0, j])
        end = min(depth, n - j)
        for i in range(1, end):
            band[i, j] /= band[0, j]
        for k in range(1, end):
            for i in range(k, end):
                band[i - k, j + k] -= band[i, j] * band[k, j]
    return True


@kernel
def _solve_band(band, right):  # type: ignore[no-untyped-def] # pragma: no cover
    if not _factor_band(band):
        return False
    depth, n = band.shape
    for row in range(len(right)):
        for j in range(n):
            right[row, j] /= band[0, j]
            for i in range(1, min(depth, n - j)):
                right[row, j + i] -= band[i, j] * right[row, j]
        for j in range(n - 1, -1, -1):
            for i in range(1, min(depth, n - j)):
                right[row, j] -= band[i, j] * right[row, j + i]
            right[row, j] /= band[0, j]
    return True


class Hats:
    """Shares observations at given times between the two knots about each."""

    def __init__(self, knots_s: Float64Array, time_s: Float64Array) -> None:
        self.left = np.clip(np.searchsorted(knots_s, time_s, side="right") - 1, 0, len(knots_s) - 2)
        width_s = knots_s[self.left + 1] - knots_s[self.left]
        self.share = np.clip((time_s - knots_s[self.left]) / width_s, 0.0, 1.0)

    def add(
        self, band: Float64Array, right: Float64Array, squares: Float64Array, pulls: Float64Array
    ) -> None:
        """Add ``squares`` (w, 3, 3) to the lower band and ``pulls`` (w, 3) to the right side."""
        here, there = 1.0 - self.share, self.share
        self.pull(right, pulls)
        for row in range(3):
            for column in range(3):
                value = squares[:, row, column]
                self._collect(band[3 + row - column], column, here * there * value)
                if row >= column:
                    self._collect(band[row - column], column, here**2 * value)
                    self._collect(band[row - column], column + 3, there**2 * value)

    def add_alike(
        self, band: Float64Array, right: Float64Array, weight: Float64Array, pulls: Float64Array
    ) -> None:
        """The same where each observation is of the three unknowns themselves, with one ``weight`` (w,)."""
        here, there = 1.0 - self.share, self.share
        self.pull(right, pulls)
        for place, values in (
            (band[0], here**2 * weight),
            (band[0, 3:], there**2 * weight),
            (band[3], here * there * weight),
        ):
            sums = np.bincount(self.left, weights=values)
            place[: 3 * len(sums)] += np.repeat(sums, 3)

    def pull(self, right: Float64Array, pulls: Float64Array) -> None:
        """Add ``pulls`` (w, 3) to the right side alone."""
        for row in range(3):
            self._collect(right, row, (1.0 - self.share) * pulls[:, row])
            self._collect(right, row + 3, self.share * pulls[:, row])

    def read(self, values: Float64Array) -> Float64Array:
        """Values (k, 3) of the knots at the times of the observations, (w, 3)."""
        share = self.share[:, None]
        return np.asarray((1.0 - share) * values[self.left] + share * values[self.left + 1])

    def _collect(self, target: Float64Array, offset: int, values: Float64Array) -> None:
        """Add ``values`` (w,) so many places behind the first unknown of the knot on the left."""
        sums = np.bincount(self.left, weights=values)
        target[offset : offset + 3 * len(sums) : 3] += sums


# The gyroscope's bias as a function of time.


@dataclass(frozen=True, slots=True, eq=False)
class GyroBias:
    """Bias at knots: ``time_s`` (k,), ``bias_dps`` (k, 3); a straight line between them, constant outside.

    ``still_moments`` and ``motion_windows`` count the observations it rests on.
    """

    time_s: Float64Array
    bias_dps: Float64Array
    still_moments: int = 0
    motion_windows: int = 0

    def at(self, time_s: NDArray[np.floating[Any]]) -> Float64Array:
        """Bias at the times asked for, shape (n, 3)."""
        if len(self.time_s) == 1:
            return np.repeat(self.bias_dps, len(time_s), axis=0)
        columns = [np.interp(time_s, self.time_s, self.bias_dps[:, axis]) for axis in range(3)]
        return np.stack(columns, axis=1)


def hold_bias(bias_dps: Float64Array) -> GyroBias:
    """One bias for the whole recording."""
    return GyroBias(np.zeros(1), np.asarray(bias_dps, dtype=np.float64).reshape(1, 3))


@dataclass(frozen=True, slots=True, eq=False)
class SensorRun:
    """Evenly sampled acceleration (g) and angular rate (deg/s), (n, 3); ``start_s`` places it in the file."""

    start_s: float
    rate_hz: float
    acc_g: FloatArray
    gyr_dps: FloatArray

    def __len__(self) -> int:
        return len(self.acc_g)


def view_segment(segment: Segment) -> SensorRun:
    """View a segment as a run, without a copy."""
    return SensorRun(segment.start_s, segment.rate_hz, segment.acc_g, segment.gyr_dps)
