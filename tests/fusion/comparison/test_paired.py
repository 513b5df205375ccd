"""Two arms of one shift, and the arm beside the trunk, worked out by hand."""

import numpy as np
import pytest

from acromion.fusion.comparison.arms import PairedArms, pair_arms, relate_to_trunk
from acromion.fusion.elevation import Elevation
from acromion.fusion.errors import TooShort
from acromion.fusion.exposure.types import Interval
from tests.factories import elevate


def hold(*angles_deg: float, rate_hz: float = 10.0) -> Elevation:
    """Hold each angle for ten seconds."""
    return elevate(np.repeat(np.array(angles_deg, np.float64), round(10.0 * rate_hz)), rate_hz=rate_hz)


def test_simultaneous_time_above_60_is_that_of_both_at_once() -> None:
    paired = pair_arms(hold(70, 70, 10, 10), hold(10, 70, 70, 10))

    assert (paired.shared_s, paired.both_above_60_percent) == (40.0, 25.0)
    assert (paired.left.time_above_percent[60], paired.right.time_above_percent[60]) == (50.0, 50.0)


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


# The figures of two arms have ranges: an error of each arm's angle, and the day's blocks drawn again.

MINUTES = 60


def spend(above_minutes: int, raised_deg: float = 70.0, *, first: int = 0) -> np.ndarray:
    """An hour at 20 deg, 1 Hz, with minutes at ``raised_deg`` from ``first`` on."""
    minute = np.full(MINUTES, 20.0)
    minute[first : first + above_minutes] = raised_deg
    return np.repeat(minute, 60)


def pair(left: np.ndarray, right: np.ndarray, sigmas_deg: tuple[float, float] | None) -> PairedArms:
    return pair_arms(elevate(left, rate_hz=1.0), elevate(right, rate_hz=1.0), sigmas_deg=sigmas_deg)


def test_without_a_known_error_or_under_half_an_hour_there_is_no_range() -> None:
    left, right = spend(15), spend(30)

    assert pair(left, right, None).intervals == {}
    assert pair(left[:1799], right[:1799], (3.0, 3.0)).intervals == {}
    assert (
        "right_to_left_time_above_60" not in pair(spend(0), right, (1.0, 1.0)).intervals
    )  # left: never above


def test_an_even_day_with_an_exact_angle_has_ranges_of_one_value() -> None:
    intervals = pair(spend(60), spend(60), (1e-9, 1e-9)).intervals

    assert intervals["both_above_60_percent"] == Interval(100.0, 100.0)
    assert intervals["right_to_left_time_above_60"] == Interval(1.0, 1.0)


def test_each_range_holds_its_figure() -> None:
    paired = pair(spend(15), spend(30, first=5), (3.0, 3.0))

    told = {
        "left_time_above_60_percent": paired.left.time_above_percent[60],
        "right_time_above_60_percent": paired.right.time_above_percent[60],
        "left_elevation_p90_deg": paired.left.percentiles_deg[90],
        "both_above_60_percent": paired.both_above_60_percent,
        "right_to_left_time_above_60": paired.ratio_above_60 or 0.0,
    }
    assert [n for n, v in told.items() if not paired.intervals[n].low <= v <= paired.intervals[n].high] == []


def test_the_errors_of_the_arms_know_nothing_of_each_other() -> None:
    """An angle 1 sd below 60 is read above it in 16 % of the draws; both at once in 2.5 %, not in 16 %."""
    below = spend(60, 57.0)

    intervals = pair(below, below, (3.0, 3.0)).intervals
    assert intervals["left_time_above_60_percent"] == Interval(0.0, 100.0)
    assert intervals["both_above_60_percent"].low == 0.0
    assert intervals["right_to_left_elevation_p50"].high == pytest.approx(
        1 + 1.96 * 3 * 2**0.5 / 57, abs=0.03
    )
