"""What counts as still enough to calibrate on."""

from dataclasses import dataclass

import numpy as np

from fusion.recording import Float64Array
from fusion.still_limits import POSE


@dataclass(frozen=True, slots=True)
class CalibrationRules:
    """What counts as still, and as too much motion to calibrate on.

    The first block is EXPOSURE.md A15: at least ``length_s`` with the acceleration's standard deviation
    (largest axis) under ``quiet_acc_sd_g`` and its mean within ``one_g_within`` of 1 g; see
    :data:`fusion.still_limits.POSE`. The second block refuses windows; the third orders proposals.
    """

    length_s: float = POSE.window_s
    quiet_acc_sd_g: float = POSE.acc_sd_g
    quiet_gyro_sd_dps: float = POSE.gyro_sd_dps
    one_g_within: float = 0.10

    fallback_s: float = 2.0
    shortest_window_s: float = 1.0
    refuse_acc_sd_g: float = 0.05
    refuse_gyro_sd_dps: float = 15.0
    refuse_from_one_g: float = 0.20

    longest_proposal_s: float = 10.0
    same_direction_deg: float = 20.0
    hanging_deg: float = 10.0
    good_score: float = 0.5
    good_agreement: float = 0.25
    elsewhere: float = 0.02
    held_deg: tuple[float, ...] = (10.0, 20.0)
    held: tuple[float, ...] = (1.0, 0.5)
    unheld_deg: tuple[float, ...] = (3.0, 10.0, 20.0)
    unheld: tuple[float, ...] = (1.0, 0.5, 0.1)
    early_s: float = 600.0


NPOSE_ERROR_DEG = 15
"""With the arm along the body as the reference, a raised arm may read too low by so much."""
GT9X_RULES = CalibrationRules(one_g_within=0.05)
OTHER_RULES = CalibrationRules()


def rules_for(device: str) -> CalibrationRules:
    """An LSM9DS1, an AX6 (BMI160: 0.04 g on each axis) and anything unknown may read 0.10 g off at rest, a
    GT9X 0.05 g.
    """
    return GT9X_RULES if device == "gt9x" else OTHER_RULES


def score_still_period(
    duration_s: float, acc_sd_g: float, gravity_g: Float64Array, rules: CalibrationRules = OTHER_RULES
) -> float:
    """Grade a still period, 0 to 1, as :func:`score_still_periods` does several."""
    return float(score_still_periods(duration_s, np.array([acc_sd_g]), gravity_g[None], rules)[0])


def score_still_periods(
    duration_s: float, acc_sd_g: Float64Array, gravity_g: Float64Array, rules: CalibrationRules
) -> Float64Array:
    """Grade still periods of one length, (w,) and (w, 3): the product of how still, how near 1 g, how long.

    Still: ``1 / (1 + (sd / 0.01 g)^2)``, a half at the limit. Near: ``1 - ||a| - 1| / (2 x tolerance)``, a
    half at the limit, not below 0. Long: ``duration / 5 s``, at most 1.
    """
    still = 1.0 / (1.0 + (acc_sd_g / rules.quiet_acc_sd_g) ** 2)
    length_g = np.linalg.norm(gravity_g, axis=1)
    near = np.maximum(0.0, 1.0 - np.abs(length_g - 1.0) / (2.0 * rules.one_g_within))
    return np.asarray(still * near * min(1.0, duration_s / rules.length_s))
