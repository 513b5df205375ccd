"""What counts as still enough to calibrate on."""

from dataclasses import dataclass

import numpy as np

from fusion.recording import Float64Array
from fusion.still_limits import POSE


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


def object_to_window(
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
