"""Two arms of one shift, and the arm beside the trunk, worked out by hand."""

import numpy as np
import pytest

from fusion.arms import pair_arms, relate_to_trunk
from fusion.errors import TooShort
from tests.factories import elevate


def hold(*angles_deg: float, seconds: float = 10.0, rate_hz: float = 10.0) -> np.ndarray:
    return np.repeat(np.array(angles_deg, np.float64), round(seconds * rate_hz))


def test_simultaneous_time_above_60_is_that_of_both_at_once() -> None:
    paired = pair_arms(elevate(hold(70, 70, 10, 10), rate_hz=10), elevate(hold(10, 70, 70, 10), rate_hz=10))

    assert (paired.shared_s, paired.both_above_60_percent) == (40.0, 25.0)
    assert (paired.left.percent_above[60], paired.right.percent_above[60]) == (50.0, 50.0)


def test_the_ratio_is_right_to_left() -> None:
    paired = pair_arms(elevate(hold(20, 20, 20, 70), rate_hz=10), elevate(hold(30, 30, 70, 70), rate_hz=10))

    assert paired.ratio_above_60 == 2.0
    assert paired.ratio_p50 == pytest.approx(50 / 20)


def test_without_time_above_on_the_left_there_is_no_ratio() -> None:
    assert pair_arms(elevate(hold(10), rate_hz=10), elevate(hold(70), rate_hz=10)).ratio_above_60 is None


def test_an_offset_puts_the_right_arm_on_the_clock_of_the_left() -> None:
    left, right = elevate(hold(10, 70), rate_hz=10), elevate(hold(70, 10), rate_hz=10)

    assert pair_arms(left, right).both_above_60_percent == 0.0
    assert pair_arms(left, right, offset_s=10.0).both_above_60_percent == 100.0
    assert pair_arms(left, right, offset_s=10.0).shared_s == 10.0


def test_time_in_which_one_arm_is_missing_is_not_compared() -> None:
    right = elevate(hold(10), hold(10), rate_hz=10, hole_s=10.0)

    assert pair_arms(elevate(hold(70, 70, 70), rate_hz=10), right).shared_s == 20.0


def test_arms_recorded_at_different_rates_are_compared_in_time() -> None:
    paired = pair_arms(elevate(hold(10, 70), rate_hz=10), elevate(hold(10, 70, rate_hz=16), rate_hz=16))

    assert paired.both_above_60_percent == pytest.approx(50.0)


def test_arms_that_never_overlap_are_refused() -> None:
    with pytest.raises(TooShort):
        pair_arms(elevate(hold(10), rate_hz=10), elevate(hold(10), rate_hz=10), offset_s=60.0)


def test_bending_forward_with_a_hanging_arm_leaves_it_behind_the_trunk() -> None:
    relative = relate_to_trunk(elevate(hold(0), rate_hz=10), elevate(hold(40), rate_hz=10))

    assert (relative.limit, relative.percentiles_deg) == (
        "sagittal plane only",
        {10: -40.0, 50: -40.0, 90: -40.0, 99: -40.0},
    )


def test_without_a_trunk_sensor_only_what_is_missing_is_said() -> None:
    relative = relate_to_trunk(elevate(hold(0), rate_hz=10), None)

    assert (relative.limit, relative.percentiles_deg) == ("no trunk sensor", None)
