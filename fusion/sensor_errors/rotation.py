"""The rotation between two samples, and how a vector moves with it.

Time convention: the angular rate of sample k is the instantaneous rate at the time of sample k; between two
samples it is a straight line (trapezoid), with the first coning term (Bortz 1971): the rotation vector over
one period T is ``(w0 + w1) T / 2 + (w0 x w1) T^2 / 12``.
"""

from math import pi
from typing import Any

from fusion.numba_kernels import fused

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
