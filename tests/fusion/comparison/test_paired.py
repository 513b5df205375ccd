"""Two arms of one shift, and the arm beside the trunk, worked out by hand."""

import numpy as np
import pytest

from fusion.arms import pair_arms, relate_to_trunk
from fusion.elevation import Elevation
from fusion.errors import TooShort
from tests.factories import elevate


def hold(*angles_deg: float, rate_hz: float = 10.0) -> Elevation:
    """Hold each angle for ten seconds."""
    return elevate(np.repeat(np.array(angles_deg, np.float64), round(10.0 * rate_hz)), rate_hz=rate_hz)


def test_simultaneous_time_above_60_is_that_of_both_at_once() -> None:
    paired = pair_arms(hold(70, 70, 10, 10), hold(10, 70, 70, 10))

    assert (paired.shared_s, paired.both_above_60_percent) == (40.0, 25.0)
    assert (paired.left.percent_above[60], paired.right.percent_above[60]) == (50.0, 50.0)


def test_the_ratio_is_right_to_left_if_the_left_is_ever_above() -> None:
    paired = pair_arms(hold(20, 20, 20, 70), hold(30, 30, 70, 70))

    assert paired.ratio_above_60 == 2.0
    assert paired.ratio_p50 == pytest.approx(50 / 20)
    assert pair_arms(hold(10), hold(70)).ratio_above_60 is None


def test_an_offset_puts_the_right_arm_on_the_clock_of_the_left() -> None:
    left, right = hold(10, 70), hold(70, 10)

    moved = pair_arms(left, right, offset_s=10.0)

    assert pair_arms(left, right).both_above_60_percent == 0.0
    assert (moved.both_above_60_percent, moved.shared_s) == (100.0, 10.0)


def test_time_in_which_one_arm_is_missing_is_not_compared() -> None:
    right = elevate(np.full(100, 10.0), np.full(100, 10.0), rate_hz=10, hole_s=10.0)

    assert pair_arms(hold(70, 70, 70), right).shared_s == 20.0


def test_arms_recorded_at_different_rates_are_compared_in_time() -> None:
    assert pair_arms(hold(10, 70), hold(10, 70, rate_hz=16)).both_above_60_percent == pytest.approx(50.0)


def test_arms_that_never_overlap_are_refused() -> None:
    with pytest.raises(TooShort):
        pair_arms(hold(10), hold(10), offset_s=60.0)


def test_bending_forward_with_a_hanging_arm_leaves_it_behind_the_trunk() -> None:
    relative, without = relate_to_trunk(hold(0), hold(40)), relate_to_trunk(hold(0), None)

    assert relative.limit == "sagittal plane only"
    assert relative.percentiles_deg == {10: -40.0, 50: -40.0, 90: -40.0, 99: -40.0}
    assert (without.limit, without.percentiles_deg) == ("no trunk sensor", None)
