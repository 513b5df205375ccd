"""The day as the page draws it: no extreme is lost at any width, nothing is drawn where nothing is valid."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acromion.app.store.day_file import DayFile, DaySegment, Stretch, open_day, write_day

RATE_HZ = 100.0


def make_day(path: Path, *runs: tuple[float, np.ndarray]) -> DayFile:
    """Write runs of (start, angles) without samples, and open them again."""
    quiet = np.empty((0, 6), np.float32)
    segments = [
        DaySegment(start_s, RATE_HZ, angles.astype(np.float32), 1.0, quiet) for start_s, angles in runs
    ]
    write_day(path / "day.bin", segments, {"device": "gt9x"})
    return open_day(path / "day.bin")


def find_extremes(stretch: Stretch) -> tuple[float, float]:
    low = [value for value in stretch.low if value is not None]
    high = [value for value in stretch.high if value is not None]
    return min(low), max(high)


def test_one_raised_sample_in_a_day_is_seen_at_full_width(tmp_path: Path) -> None:
    angles = np.full(1_000_000, 10.0)
    angles[654_321] = 170.0
    day = make_day(tmp_path, (0.0, angles))

    (stretch,) = day.cut(0.0, 10_000.0, 1000)

    assert find_extremes(stretch) == (10.0, 170.0)
    assert stretch.high.index(170.0) == int(6543.21 / stretch.step_s)
    assert 500 <= len(stretch.low) <= 2000


def test_close_up_every_sample_is_given(tmp_path: Path) -> None:
    day = make_day(tmp_path, (0.0, np.arange(1000) % 180))

    (stretch,) = day.cut(1.0, 1.1, 1000)

    assert stretch.step_s == pytest.approx(0.01)
    assert stretch.low == stretch.high
    assert stretch.low[:11] == [float(angle) for angle in range(100, 111)]


def test_nothing_is_given_where_nothing_is_valid(tmp_path: Path) -> None:
    angles = np.full(1600, 45.0)
    angles[320:480] = np.nan
    day = make_day(tmp_path, (0.0, angles))

    (stretch,) = day.cut(0.0, 16.0, 10)

    assert stretch.low == [45.0, 45.0, None, *[45.0] * 7]


def test_a_hole_lies_between_two_stretches(tmp_path: Path) -> None:
    day = make_day(tmp_path, (0.0, np.full(1000, 10.0)), (60.0, np.full(1000, 20.0)))

    first, second = day.cut(0.0, 70.0, 70)

    assert 10.0 <= first.start_s + first.step_s * len(first.low) < 10.0 + first.step_s
    assert second.start_s == 60.0


def test_what_lies_outside_is_not_given(tmp_path: Path) -> None:
    day = make_day(tmp_path, (0.0, np.full(1000, 10.0)))

    assert day.cut(20.0, 30.0, 100) == []


@settings(max_examples=40)
@given(st.lists(st.integers(0, 18_000), min_size=1, max_size=2000), st.integers(1, 500))
def test_the_extremes_of_the_whole_are_those_of_the_samples(
    tmp_path_factory: pytest.TempPathFactory, hundredths: list[int], points: int
) -> None:
    angles = np.array(hundredths) / 100
    day = make_day(tmp_path_factory.mktemp("day"), (0.0, angles))

    (stretch,) = day.cut(0.0, len(angles) / RATE_HZ, points)

    assert find_extremes(stretch) == pytest.approx((angles.min(), angles.max()), abs=0.006)


def test_a_still_arm_is_told_from_a_moving_one(tmp_path: Path) -> None:
    still, moving = [0, 0, 1.0, 0, 0, 1.0], [0, 0, 1.0, 0.04, 0, 1.0]  # means and mean squares of x, y, z
    quiet = np.array([still] * 40 + [moving] * 40, np.float32)
    write_day(tmp_path / "day.bin", [DaySegment(5.0, RATE_HZ, np.zeros(2000, np.float32), 0.25, quiet)], {})
    day = open_day(tmp_path / "day.bin")

    gravity, sd_g = day.measure_quiet(5.0, 10.0) or pytest.fail("not in one piece")
    moved = day.measure_quiet(15.0, 20.0)

    assert gravity.tolist() == [0.0, 0.0, 1.0]
    assert sd_g == 0.0
    assert moved is not None
    assert moved[1] == pytest.approx(0.2)
    assert day.measure_quiet(24.0, 26.0) is None


def above(*lengths: tuple[float, float]) -> np.ndarray:
    """Angles in pieces of (seconds, degrees)."""
    return np.concatenate([np.full(round(length_s * RATE_HZ), angle) for length_s, angle in lengths])


def test_the_highest_episodes_come_first_and_short_ones_are_none(tmp_path: Path) -> None:
    angles = above((10, 20.0), (2, 70.0), (10, 20.0), (0.4, 150.0), (10, 20.0), (3, 90.0), (1, 20.0))
    day = make_day(tmp_path, (100.0, angles))

    found = [(e.start_s, e.end_s, e.highest_deg) for e in day.find_highest(60.0, 0.5, 10)]

    assert found == [pytest.approx(each) for each in ((132.4, 135.4, 90.0), (110.0, 112.0, 70.0))]
    assert len(day.find_highest(60.0, 0.5, 1)) == 1


def test_a_short_dip_ends_no_episode_and_a_hole_does(tmp_path: Path) -> None:
    dip = above((1, 20.0), (2, 70.0), (0.4, 50.0), (2, 80.0), (1, 20.0))
    hole = above((1, 20.0), (2, 70.0), (0.4, np.nan), (2, 80.0), (1, 20.0))
    day = make_day(tmp_path, (0.0, dip), (60.0, hole))

    found = sorted((e.start_s, e.end_s) for e in day.find_highest(60.0, 0.5, 10))

    assert found == [pytest.approx(each) for each in ((1.0, 5.4), (61.0, 63.0), (63.4, 65.4))]


def test_time_above_is_a_part_of_the_valid_time_of_a_stretch(tmp_path: Path) -> None:
    angles = above((10, 20.0), (5, 60.0), (5, np.nan), (10, 20.0))
    day = make_day(tmp_path, (0.0, angles), (100.0, np.full(1000, 90.0)))

    assert day.measure_above(8.0, 22.0, 60.0) == pytest.approx((9.0, 5.0))
    assert day.measure_above(25.0, 104.0, 60.0) == pytest.approx((9.0, 4.0))
    assert day.measure_above(40.0, 90.0, 60.0) == (0.0, 0.0)


def test_what_is_just_below_a_threshold_does_not_count_as_above_it(tmp_path: Path) -> None:
    day = make_day(tmp_path, (0.0, np.array([59.996, 60.0, 60.004, 59.0])))

    assert day.measure_above(0.0, 0.04, 60.0) == pytest.approx((0.04, 0.02))
