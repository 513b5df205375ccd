"""Rules for a pose: how still it has to be, and how accurate the arm axis of each source is."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from acromion.fusion.conventions import ARM_AXES, ArmAxis
from acromion.fusion.numerics import compute_angle_deg
from acromion.fusion.recording import Float64Array
from acromion.fusion.still_limits import POSE

# Limits of stillness for a calibration.


@dataclass(frozen=True, slots=True)
class CalibrationRules:
    """Limits of a still period (:data:`acromion.fusion.still_limits.POSE`), and of a moving window.

    The acceleration must be within ``one_g_within`` of 1 g, before or after the accelerometer's correction.
    Of a longer still period only the first ``measured_s`` are measured. The last fields are the limits to
    reject a window.
    """

    length_s: float = POSE.window_s
    quiet_acc_sd_g: float = POSE.acc_sd_g
    quiet_gyro_sd_dps: float = POSE.gyro_sd_dps
    one_g_within: float = 0.10
    measured_s: float = 10.0

    moment_s: float = 2.0
    shortest_window_s: float = 1.0
    refuse_acc_sd_g: float = 0.05
    refuse_gyro_sd_dps: float = 15.0
    refuse_from_one_g: float = 0.20


RULES = CalibrationRules()
WINDOW_FAULTS = ("short", "hole", "moving", "gravity")
"""Reasons to reject a window within the recording that a person chose."""


def window_rejection_reason(
    duration_s: float, acc_sd_g: float, gravity_g: Float64Array, gyro_sd_dps: float = 0.0
) -> str:
    """Return why a window that a person chose is rejected for its length or motion; "" if it is accepted.

    ``acc_sd_g``, ``gyro_sd_dps``: the largest standard deviation of an axis; ``gravity_g``, shape (3,): the
    mean acceleration.
    """
    if gyro_sd_dps > RULES.refuse_gyro_sd_dps:
        return "moving"
    if duration_s < RULES.shortest_window_s - 1e-9:
        return "short"
    if acc_sd_g > RULES.refuse_acc_sd_g:
        return "moving"
    if abs(float(np.linalg.norm(gravity_g)) - 1.0) > RULES.refuse_from_one_g:
        return "gravity"
    return ""


def score_still_period(duration_s: float, acc_sd_g: float, gravity_g: Float64Array) -> float:
    """Return the score of a still period, 0 to 1: the product of how still, how near 1 g, how long.

    Still: ``1 / (1 + (sd / 0.01 g)^2)``, a half at the limit. Near: ``1 - ||a| - 1| / 0.2 g``, a half at the
    limit, not below 0. Long: ``duration / 5 s``, at most 1.
    """
    still = 1.0 / (1.0 + (acc_sd_g / RULES.quiet_acc_sd_g) ** 2)
    off_g = abs(float(np.linalg.norm(gravity_g)) - 1.0)
    near = max(0.0, 1.0 - off_g / (2.0 * RULES.one_g_within))
    return float(still * near * min(1.0, duration_s / RULES.length_s))


# The arm axis in the sensor: accuracy by source.
#
# A reading is one interpretation of the whole recording: an axis, and the stretches with another axis.

ALIKE_DEG = 10.0
"""Poses within this angle agree: two clips of one person in the same stance differ by 2 to 10 deg."""
TENDENCY_SIGMA_DEG, REPEAT_SIGMA_DEG = 4.0, 3.0
"""Standard deviations of a held pose: a person's constant tendency (arms hang 8 to 13 deg from plumb), and
the variation from one pose to the next; 5 deg together.
"""
HELD_SIGMA_DEG = float(np.hypot(TENDENCY_SIGMA_DEG, REPEAT_SIGMA_DEG))
ASSUMED_SIGMA_DEG, AXIS_SIGMA_DEG = 7.0, 8.0
WALKING_SIGMA_DEG = 10.0
"""In ordinary gait the mean of gravity is 14 to 18 deg from the arm axis."""
MOMENT_SIGMA_DEG = 35.0
SAME_DEG, MOST_READINGS = 3.0, 5
"""Readings closer to each other than this are treated as the same."""


@dataclass(frozen=True, slots=True, eq=False)
class AxisPart:
    """A stretch, seconds from the first sample, where the first axis does not apply.

    ``arm_axis`` (3,): the axis there; None if the stretch is excluded because a person stated that the sensor
    slipped.
    ``sigma_deg``: the uncertainty that it adds to that of the first axis.
    ``is_posed``: whether a pose was held in it.
    """

    start_s: float
    end_s: float
    arm_axis: Float64Array | None
    sigma_deg: float = 0.0
    is_posed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """One interpretation of a recording: the axis (3,), and the stretches with another axis, in order."""

    arm_axis: Float64Array
    parts: tuple[AxisPart, ...] = ()


def estimate_held_sigma(held_s: float) -> float:
    """Return the standard deviation of one held pose: 5 deg, more if shorter than 5 s, up to 10."""
    return HELD_SIGMA_DEG * float(np.sqrt(np.clip(RULES.length_s / held_s, 1.0, 4.0)))


def estimate_repeated_sigma(apart_deg: Sequence[float]) -> float:
    """Return the standard deviation of the mean of several poses, from the angle of each to the mean.

    The variation from pose to pose is measured and combined with a prior that counts as two poses. Its effect
    decreases with the number of poses; the person's constant tendency remains.
    """
    count = len(apart_deg)
    squares = 2.0 * REPEAT_SIGMA_DEG**2 + float(np.sum(np.square(apart_deg)))
    repeat_deg2 = squares / (2.0 + 2.0 * (count - 1))
    return float(np.sqrt(TENDENCY_SIGMA_DEG**2 + repeat_deg2 / count))


def point_along(axis: ArmAxis) -> Float64Array:
    """Return the unit vector (3,) of the sensor axis that was strapped along the arm, to the shoulder."""
    return np.where(np.arange(3) == "xyz".index(axis[1]), -1.0 if axis[0] == "-" else 1.0, 0.0)


def find_nearest_axis(direction: Float64Array) -> tuple[ArmAxis, float]:
    """Return the sensor axis nearest to a direction (3,), and the angle between them, deg."""
    apart_deg = {axis: compute_angle_deg(point_along(axis), direction) for axis in ARM_AXES}
    nearest = min(ARM_AXES, key=lambda axis: apart_deg[axis])
    return nearest, apart_deg[nearest]


def compute_spread_deg(axes: Iterable[Float64Array]) -> float:
    """Return the largest angle between any two directions; 0 for one."""
    return max((compute_angle_deg(one, other) for one, other in combinations(axes, 2)), default=0.0)


def select_distinct_axes(axes: Sequence[Float64Array], most: int = MOST_READINGS) -> list[int]:
    """Return the indices of representative axes: the first, then always the one farthest from all chosen."""
    chosen = [0] if axes else []
    while axes and len(chosen) < most:
        nearest_deg = [min(compute_angle_deg(axis, axes[place]) for place in chosen) for axis in axes]
        farthest = int(np.argmax(nearest_deg))
        if nearest_deg[farthest] < SAME_DEG:
            break
        chosen.append(farthest)
    return chosen
