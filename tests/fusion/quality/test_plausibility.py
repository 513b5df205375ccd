"""A gyroscope that wandered, and an arm that would have been raised most of the day."""

import numpy as np
import pytest

from fusion.exposure import summarise_exposure
from fusion.quality.flags import flag_gyro_drift, flag_upside_down
from fusion.sensor.model import GyroBias
from tests.factories import elevate


def wander(*last_axis_dps: float) -> GyroBias:
    bias_dps = np.zeros((len(last_axis_dps), 3))
    bias_dps[:, 2] = last_axis_dps
    return GyroBias(np.linspace(0.0, 600.0 * (len(bias_dps) - 1), len(bias_dps)), bias_dps)


def test_an_offset_that_wanders_by_1_dps_is_flagged_from_one_extreme_to_the_other() -> None:
    (flag,) = flag_gyro_drift(wander(0.2, 0.5, -0.5, 0.1))

    assert (flag.code, flag.first_s, flag.last_s, flag.facts) == ("W-GYRO-DRIFT", 600, 1200, {"dps": 1.0})


@pytest.mark.parametrize(
    "offset_dps", [(0.0, 0.99), (12.0, 12.0)], ids=["wanders by less", "large but steady"]
)
def test_a_smaller_wander_and_a_large_steady_offset_are_no_drift(offset_dps: tuple[float, ...]) -> None:
    assert flag_gyro_drift(wander(*offset_dps)) == ()


@pytest.mark.parametrize(
    ("angle_deg", "seconds", "codes"),
    [(91.0, 3600, ["W-UPSIDE"]), (89.9, 3600, []), (91.0, 3599, [])],
)
def test_an_arm_above_level_for_most_of_an_hour_is_a_sensor_upside_down(
    angle_deg: float, seconds: int, codes: list[str]
) -> None:
    exposure = summarise_exposure(elevate(np.full(seconds, angle_deg), rate_hz=1.0))

    assert [flag.code for flag in flag_upside_down(exposure)] == codes
