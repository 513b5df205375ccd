"""The figures of two arms have ranges: an error of each arm's angle, and the day's blocks drawn again."""

import numpy as np
import pytest

from fusion.arms import PairedArms, pair_arms
from fusion.exposure.types import Interval
from tests.factories import elevate

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
        "left_time_above_60_percent": paired.left.percent_above[60],
        "right_time_above_60_percent": paired.right.percent_above[60],
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
