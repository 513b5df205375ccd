"""The arm axis from two poses, hanging and level."""

import numpy as np
from numpy.typing import NDArray

from fusion.postures import find_angle_deg

Vector = NDArray[np.float64]


def share_between(hanging_g: Vector, level_g: Vector) -> Vector:
    """Arm axis for the two-point pose.

    With ``gamma`` the angle between both gravity directions, the axis lies in their plane, turned from the
    hanging direction towards the level one by ``(gamma - 90 deg) / 2``: hanging then reads ``|gamma - 90| /
    2`` and level ``90 + (gamma - 90) / 2``, the least-squares answer when both poses are trusted alike.
    """
    first, second = scale_to_unit(hanging_g), scale_to_unit(level_g)
    across = scale_to_unit(second - (first @ second) * first)
    turn = np.radians(find_angle_deg(first, second) - 90.0) / 2.0
    return np.asarray(np.cos(turn) * first + np.sin(turn) * across)


def scale_to_unit(vector: Vector) -> Vector:
    """The same direction at length 1."""
    return np.asarray(vector / np.linalg.norm(vector))
