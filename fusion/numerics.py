"""Mathematical functions that several steps share."""

import numpy as np

from acromion.fusion.recording import Float64Array

# Angles and rotations between directions.


def cos_deg(angle_deg: float) -> float:
    """Return the cosine of an angle in degrees."""
    return float(np.cos(np.radians(angle_deg)))


def compute_angle_deg(first: Float64Array, second: Float64Array) -> float:
    """Return the angle between two vectors (3,) of any length."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)))


def scale_to_unit(vector: Float64Array) -> Float64Array:
    """Return the same direction at length 1."""
    return np.asarray(vector / np.linalg.norm(vector))


def compute_rotation(before: Float64Array, after: Float64Array) -> Float64Array:
    """Return the smallest rotation, (3, 3), from one unit vector to another."""
    cross, cosine = np.cross(before, after), float(before @ after)
    skew = np.array([[0.0, -cross[2], cross[1]], [cross[2], 0.0, -cross[0]], [-cross[1], cross[0], 0.0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / max(1.0 + cosine, 1e-9))


# Weights by residual, so that a few outliers do not dominate a fit.

CAUCHY = 2.385
"""Standard deviations at which Cauchy's weight is one half: 95 % efficient on normal errors."""
HUBER = 1.345
"""Standard deviations up to which Huber's weight is one (Huber 1964)."""
NORMAL_PER_MEDIAN = 1.4826
"""Ratio of the standard deviation of normal errors to their median absolute value."""


def weigh_cauchy(departure: Float64Array, variance: Float64Array | float) -> Float64Array:
    """Return Cauchy's weights divided by the variance of each observation."""
    return np.asarray(1.0 / (variance + (departure / CAUCHY) ** 2))


def weigh_huber(departure: Float64Array) -> Float64Array:
    """Return Huber's weights, 0 to 1; the scale is the median absolute residual."""
    scale = max(NORMAL_PER_MEDIAN * float(np.median(np.abs(departure))), 1e-6)
    size = np.abs(departure) / scale
    return np.asarray(np.where(size <= HUBER, 1.0, HUBER / np.maximum(size, HUBER)))
