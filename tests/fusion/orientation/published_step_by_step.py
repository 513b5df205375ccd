"""The published algorithm, every step and sample by sample, to be read beside the paper.

Matrices turn sensor coordinates into world coordinates, world z up. Nothing is left out, nothing is fast.
"""

from math import atan2, pi

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from acromion.fusion.orientation.published import PublishedParameters

Array = NDArray[np.float64]


def follow_paper(
    acc_g: Array,
    gyr_dps: Array,
    rate_hz: float,
    bias_dps: Array,
    arm_axis: Array,
    settings: PublishedParameters,
) -> Array:
    """Elevation in degrees at each sample, shape (n,)."""
    gyr_rad = np.radians(gyr_dps - bias_dps)
    acc = low_pass(acc_g, settings.lowpass_acc_hz, rate_hz)
    gyr = high_pass(low_pass(gyr_rad, settings.lowpass_gyr_hz, rate_hz), settings.highpass_gyr_hz, rate_hz)
    weight = settings.accelerometer_weight(rate_hz)
    arm = arm_frame(arm_axis)
    orientation = orientation_from_ratios(acc[0])
    elevation = [tilt_deg(orientation @ arm)]
    for step in range(1, len(acc)):
        from_acc = orientation_from_ratios(acc[step])
        from_gyr = orientation @ turn_by_resultant(gyr[step], 1.0 / rate_hz)
        orientation = combine(from_acc, from_gyr, weight)
        elevation.append(tilt_deg(orientation @ arm))
    return np.array(elevation)


def low_pass(samples: Array, cutoff_hz: float, rate_hz: float) -> Array:
    """One-pole RC low-pass, y' = (x - y) / RC, backward Euler, from the first sample."""
    rc_s, period_s = 1.0 / (2.0 * pi * cutoff_hz), 1.0 / rate_hz
    out = samples.copy()
    for step in range(1, len(samples)):
        out[step] = (rc_s * out[step - 1] + period_s * samples[step]) / (rc_s + period_s)
    return out


def high_pass(samples: Array, cutoff_hz: float, rate_hz: float) -> Array:
    """One-pole RC high-pass, y' = x' - y / RC, backward Euler, from the first sample; 0 Hz leaves it out."""
    if cutoff_hz == 0.0:
        return samples
    rc_s, period_s = 1.0 / (2.0 * pi * cutoff_hz), 1.0 / rate_hz
    out = samples.copy()
    for step in range(1, len(samples)):
        out[step] = rc_s / (rc_s + period_s) * (out[step - 1] + samples[step] - samples[step - 1])
    return out


def orientation_from_ratios(acc: Array) -> Array:
    """Roll and pitch by AN3461's ratios (equations 25 and 26, rotation order xyz), heading nil."""
    x, y, z = acc
    roll, pitch = atan2(y, z), atan2(-x, np.hypot(y, z))
    return np.asarray(Rotation.from_euler("xyz", [roll, pitch, 0.0]).as_matrix())


def turn_by_resultant(rate_rad: Array, period_s: float) -> Array:
    """Rotation about the resultant angular velocity vector, by its length times the period."""
    return np.asarray(Rotation.from_rotvec(rate_rad * period_s).as_matrix())


def combine(from_acc: Array, from_gyr: Array, weight: float) -> Array:
    """Four matrices: the XY parts are joined by slerp, the gyroscope's Z part is put back."""
    acc_z, acc_xy = split(from_acc)
    gyr_z, gyr_xy = split(from_gyr)
    assert np.allclose(acc_z @ acc_xy, from_acc)
    assert np.allclose(gyr_z @ gyr_xy, from_gyr)
    joined = slerp(quaternion(gyr_xy), quaternion(acc_xy), weight)
    return np.asarray(gyr_z @ Rotation.from_quat(joined).as_matrix())


def split(orientation: Array) -> tuple[Array, Array]:
    """(about world Z, about an axis in the world's XY plane); their product is the orientation."""
    up = orientation[2]  # world z in sensor coordinates
    tilt = atan2(np.hypot(up[0], up[1]), up[2])
    axis = np.array([up[1], -up[0], 0.0])
    length = np.linalg.norm(axis)
    axis = axis / length if length > 1e-12 else np.array([1.0, 0.0, 0.0])
    about_xy = np.asarray(Rotation.from_rotvec(tilt * axis).as_matrix())
    return orientation @ about_xy.T, about_xy


def quaternion(matrix: Array) -> Array:
    """(x, y, z, w)."""
    return np.asarray(Rotation.from_matrix(matrix).as_quat())


def slerp(start: Array, end: Array, weight: float) -> Array:
    """Shoemake 1985, the short way round."""
    end = -end if start @ end < 0.0 else end
    angle = 2.0 * np.arctan2(np.linalg.norm(end - start), np.linalg.norm(end + start))
    if angle < 1e-12:
        return start
    return np.asarray((np.sin((1.0 - weight) * angle) * start + np.sin(weight * angle) * end) / np.sin(angle))


def arm_frame(arm_axis: Array) -> Array:
    """A frame whose third axis is the arm's, in sensor coordinates (columns)."""
    helper = np.eye(3)[np.argmin(np.abs(arm_axis))]
    first = np.cross(helper, arm_axis)
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(arm_axis, first), arm_axis], axis=1)


def tilt_deg(orientation: Array) -> float:
    """Bonev's tilt-and-torsion angles: R = Rz(azimuth) Ry(tilt) Rz(torsion - azimuth); the tilt."""
    return float(np.degrees(atan2(np.hypot(orientation[0, 2], orientation[1, 2]), orientation[2, 2])))
