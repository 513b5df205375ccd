"""The rules of a pose: how still it has to be, and how well each way of knowing it gives the arm's axis."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from fusion.conventions import ARM_AXES, ArmAxis
from fusion.numerics import find_angle_deg
from fusion.recording import Float64Array
from fusion.still_limits import POSE

# What counts as still enough to calibrate on.


@dataclass(frozen=True, slots=True)
class CalibrationRules:
    """What counts as still (:data:`fusion.still_limits.POSE`), and as too much motion to calibrate on.

    The acceleration is within ``one_g_within`` of 1 g, before or after the accelerometer's correction. Of a
    longer stillness the first ``measured_s`` are measured. The last lines refuse windows.
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
"""Why a window that a person chose is refused, within the recording."""


def window_rejection_reason(
    duration_s: float, acc_sd_g: float, gravity_g: Float64Array, gyro_sd_dps: float = 0.0
) -> str:
    """Return why a window that a person chose is refused by its length and motion; "" if it is not.

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
    """Grade a still period, 0 to 1: the product of how still, how near 1 g, how long.

    Still: ``1 / (1 + (sd / 0.01 g)^2)``, a half at the limit. Near: ``1 - ||a| - 1| / 0.2 g``, a half at the
    limit, not below 0. Long: ``duration / 5 s``, at most 1.
    """
    still = 1.0 / (1.0 + (acc_sd_g / RULES.quiet_acc_sd_g) ** 2)
    off_g = abs(float(np.linalg.norm(gravity_g)) - 1.0)
    near = max(0.0, 1.0 - off_g / (2.0 * RULES.one_g_within))
    return float(still * near * min(1.0, duration_s / RULES.length_s))


# The arm's axis in the sensor: how well each way of knowing it ties the two together.
#
# A reading is one way to read the whole recording: an axis, and the stretches that another axis reads.

ALIKE_DEG = 10.0
"""Poses within this angle agree: two clips of one person in the same stance differ by 2 to 10 deg."""
TENDENCY_SIGMA_DEG, REPEAT_SIGMA_DEG = 4.0, 3.0
"""Standard deviations of a held pose: what this person always does (arms hang 8 to 13 deg from plumb), and
what changes from one pose to the next; 5 deg together.
"""
HELD_SIGMA_DEG = float(np.hypot(TENDENCY_SIGMA_DEG, REPEAT_SIGMA_DEG))
ASSUMED_SIGMA_DEG, AXIS_SIGMA_DEG = 7.0, 8.0
WALKING_SIGMA_DEG = 10.0
"""In ordinary gait the mean of gravity lies 14 to 18 deg from the arm's axis."""
MOMENT_SIGMA_DEG = 35.0
SAME_DEG, MOST_READINGS = 3.0, 5
"""Readings nearer to each other than this are not told apart."""


@dataclass(frozen=True, slots=True, eq=False)
class AxisPart:
    """A stretch, seconds from the first sample, that the first axis does not read.

    ``arm_axis`` (3,) is the axis there, ``sigma_deg`` what its uncertainty adds to that of the first; None
    if the stretch is left out because a person said that the sensor slipped. ``is_posed``: a pose was held
    in it.
    """

    start_s: float
    end_s: float
    arm_axis: Float64Array | None
    sigma_deg: float = 0.0
    is_posed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """One way to read a recording: the axis (3,), and the stretches that it does not read, in order."""

    arm_axis: Float64Array
    parts: tuple[AxisPart, ...] = ()


def estimate_held_sigma(held_s: float) -> float:
    """Return the standard deviation of one held pose: 5 deg, more if shorter than 5 s, up to 10."""
    return HELD_SIGMA_DEG * float(np.sqrt(np.clip(RULES.length_s / held_s, 1.0, 4.0)))


def estimate_repeated_sigma(apart_deg: Sequence[float]) -> float:
    """Return the standard deviation of the mean of poses that lie so far from it.

    What changes from pose to pose is measured, beside two poses' worth of what people show; its mean shrinks
    with the number of poses. What the person always does stays.
    """
    count = len(apart_deg)
    squares = 2.0 * REPEAT_SIGMA_DEG**2 + float(np.sum(np.square(apart_deg)))
    repeat_deg2 = squares / (2.0 + 2.0 * (count - 1))
    return float(np.sqrt(TENDENCY_SIGMA_DEG**2 + repeat_deg2 / count))


def point_along(axis: ArmAxis) -> Float64Array:
    """Return the unit vector (3,) of the sensor's axis that was strapped along the arm, to the shoulder."""
    return np.where(np.arange(3) == "xyz".index(axis[1]), -1.0 if axis[0] == "-" else 1.0, 0.0)


def find_nearest_axis(direction: Float64Array) -> tuple[ArmAxis, float]:
    """Return the sensor's axis nearest to a direction (3,), and the angle between them, deg."""
    apart_deg = {axis: find_angle_deg(point_along(axis), direction) for axis in ARM_AXES}
    nearest = min(ARM_AXES, key=lambda axis: apart_deg[axis])
    return nearest, apart_deg[nearest]


def find_spread_deg(axes: Iterable[Float64Array]) -> float:
    """Return the largest angle between any two directions; 0 for one."""
    return max((find_angle_deg(one, other) for one, other in combinations(axes, 2)), default=0.0)


def choose_apart(axes: Sequence[Float64Array], most: int = MOST_READINGS) -> list[int]:
    """Return the places of axes that stand for all: the first, then each time the one farthest from those."""
    chosen = [0] if axes else []
    while axes and len(chosen) < most:
        nearest_deg = [min(find_angle_deg(axis, axes[place]) for place in chosen) for axis in axes]
        farthest = int(np.argmax(nearest_deg))
        if nearest_deg[farthest] < SAME_DEG:
            break
        chosen.append(farthest)
    return chosen
