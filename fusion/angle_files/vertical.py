"""From an orientation to the vertical in the frame of the segment, and from the vertical to the elevation.

An orientation R turns the segment's frame into a world frame whose z points to the zenith, as Xsens exports
it (MVN: global frame z up; MT Manager and DOT: ENU). The zenith in the segment's frame is then the third row
of R, whatever the heading: elevation needs no more of an orientation than that.
"""

import numpy as np
from numpy.typing import NDArray

from fusion.elevation import measure_elevation
from fusion.recording import Float64Array

Up = NDArray[np.float32]

SHORTEST_QUATERNION = 0.5
"""Quaternions shorter than this are no rotation: the row is missing. Xsens writes unit ones to 1e-6."""


def take_up_of_quaternion(quaternion_wxyz: Float64Array) -> Up:
    """Give the third row of R for each quaternion (n, 4), segment to world; NaN where it is none."""
    length = np.linalg.norm(quaternion_wxyz, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        w, x, y, z = (quaternion_wxyz / np.where(length < SHORTEST_QUATERNION, np.nan, length)).T
    up = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)
    return up.astype(np.float32)


def take_up_of_euler(roll_deg: Float64Array, pitch_deg: Float64Array) -> Up:
    """Give the third row of R = Rz(yaw) Ry(pitch) Rx(roll), Xsens's order (aerospace sequence)."""
    roll, pitch = np.radians(roll_deg), np.radians(pitch_deg)
    up = [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)]
    return np.stack(up, axis=1).astype(np.float32)


def take_up_of_row(third_row: Float64Array) -> Up:
    """Give the third row of R, (n, 3), at length one; NaN where it has none."""
    length = np.linalg.norm(third_row, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return (third_row / np.where(length < SHORTEST_QUATERNION, np.nan, length)).astype(np.float32)


def measure_from_up(up: Up, axis: Float64Array) -> NDArray[np.float32]:
    """Elevation of an axis that points to the shoulder: 0 where it points to the zenith (the arm hangs)."""
    return measure_elevation(np.ascontiguousarray(up), axis)
