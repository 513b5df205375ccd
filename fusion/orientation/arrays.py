"""Checks of the arrays that callers pass to the estimators."""

from math import isfinite

import numpy as np
from numpy.typing import NDArray

from fusion.errors import UnusableArrays
from fusion.recording import Float64Array, FloatArray

UNIT_WITHIN = 0.01
OTHER_UNIT = 3.0
"""A median length this factor from 1 g means another unit: nobody moves so hard throughout."""


def check_arrays(acc_g: object, gyr_dps: object, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Return both as float32 or float64 arrays of shape (n, 3), C order; views where no change is needed.

    Raises UnusableArrays: other shapes, unequal lengths, values that are not finite, or a rate that is not
    positive.
    """
    acc, gyr = _as_floats(acc_g), _as_floats(gyr_dps)
    if acc.ndim != 2 or acc.shape[1] != 3 or acc.shape != gyr.shape:
        raise UnusableArrays(why="shape", acc=str(acc.shape), gyr=str(gyr.shape))
    check_rate(rate_hz)
    if not (np.isfinite(acc).all() and np.isfinite(gyr).all()):
        raise UnusableArrays(why="finite")
    return acc, gyr


def check_rate(rate_hz: float) -> None:
    """Refuse a rate that is not positive; raises UnusableArrays."""
    if not (isfinite(rate_hz) and rate_hz > 0.0):
        raise UnusableArrays(why="rate", rate_hz=float(rate_hz))


def check_direction(axis: object) -> Float64Array:
    """Return a unit vector as a separate array, shape (3,).

    A length more than 1 % from 1 means that it is not a direction but an acceleration, or a typing error.

    Raises UnusableArrays.
    """
    try:
        vector = np.array(axis, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise UnusableArrays(why="axis", axis=repr(axis)[:60]) from error
    if vector.shape != (3,) or not abs(np.linalg.norm(vector) - 1.0) <= UNIT_WITHIN:
        raise UnusableArrays(why="axis", axis=str(vector.tolist()))
    return vector


def check_gravity(acc_g: FloatArray) -> None:
    """Refuse no sample at all, and an acceleration that is not in g: its median length is far from 1.

    Raises UnusableArrays.
    """
    if len(acc_g) == 0:
        raise UnusableArrays(why="empty")
    few = acc_g[:: -(-len(acc_g) // 10_000)].astype(np.float64)
    length_g = float(np.median(np.linalg.norm(few, axis=1)))
    if not 1.0 / OTHER_UNIT < length_g < OTHER_UNIT:
        raise UnusableArrays(why="unit", g=round(length_g, 3))


def _as_floats(values: object) -> FloatArray:
    array: NDArray[np.generic] = np.asarray(values)
    if array.dtype == np.float32:
        return np.ascontiguousarray(array, dtype=np.float32)
    try:
        return np.ascontiguousarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise UnusableArrays(why="numbers") from error
