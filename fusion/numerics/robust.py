"""Weights of observations by how far they depart, so that a few wild ones do not decide a fit."""

import numpy as np

from fusion.recording import Float64Array

CAUCHY = 2.385
"""Standard deviations at which Cauchy's weight has fallen to a half: 95 % efficient on normal errors."""
HUBER = 1.345
"""Standard deviations up to which Huber's weight is one (Huber 1964)."""
NORMAL_PER_MEDIAN = 1.4826
"""Standard deviation of normal errors over their median size."""


def weigh_cauchy(departure: Float64Array, variance: Float64Array | float) -> Float64Array:
    """Return Cauchy's weights over the variance of each observation."""
    return np.asarray(1.0 / (variance + (departure / CAUCHY) ** 2))


def weigh_huber(departure: Float64Array) -> Float64Array:
    """Return Huber's weights, 0 to 1; the scale is the median absolute departure."""
    scale = max(NORMAL_PER_MEDIAN * float(np.median(np.abs(departure))), 1e-6)
    size = np.abs(departure) / scale
    return np.asarray(np.where(size <= HUBER, 1.0, HUBER / np.maximum(size, HUBER)))
