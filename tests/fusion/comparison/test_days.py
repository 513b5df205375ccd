"""Several days overlaid by the clock, and the spread between days and people, worked out by hand."""

from datetime import datetime
from math import sqrt

import numpy as np
import pytest

from fusion.comparison.change import BETWEEN_DAY_SD
from fusion.comparison.days import (
    compare_people,
    describe_days,
    describe_group,
    find_detectable_between,
    find_telling,
    lay_on_clock,
    overlay_days,
    pool_deviation,
)
from fusion.exposure.types import Interval
from fusion.recording import Float64Array
from tests.factories import elevate

EIGHT = datetime.fromisoformat("2026-03-03T08:00:00")
RATE_HZ = 1.0


def held(*angles_deg: float, start: datetime = EIGHT, quarter_s: float = 900.0) -> Float64Array:
    """A day that holds each angle for a quarter of an hour."""
    angles = np.repeat(np.array(angles_deg, np.float64), round(quarter_s * RATE_HZ))
    return lay_on_clock(elevate(angles, rate_hz=RATE_HZ), start)


@pytest.mark.parametrize(
    ("start", "quarters"), [(EIGHT, (32, 33)), (EIGHT.replace(hour=23, minute=45), (95, 0))]
)
def test_time_lies_at_the_hour_that_the_clock_showed(start: datetime, quarters: tuple[int, int]) -> None:
    day = held(10.05, 50.05, start=start)

    assert np.flatnonzero(day.sum(axis=1)).tolist() == sorted(quarters)
    assert (day[quarters[0], 100], day[quarters[1], 500]) == (900.0, 900.0)


def test_what_is_not_valid_is_not_counted() -> None:
    elevation = elevate(np.full(1800, 20.0), rate_hz=RATE_HZ, valid=False)

    assert lay_on_clock(elevation, EIGHT).sum() == 0.0


def test_the_median_of_days_counts_each_day_once() -> None:
    (band,) = overlay_days([held(10.0), *[held(50.0, quarter_s=450.0)] * 2])

    # a third of the time at 10, two thirds at 50: the median is a quarter into the cell of 50
    assert band.days == 3
    assert band.percentiles_deg is not None
    assert band.percentiles_deg[50] == pytest.approx(50.025, abs=1e-6)
    assert band.percentiles_deg[25] == pytest.approx(10.075, abs=1e-6)


@pytest.mark.parametrize(("both", "first"), [(1, 1), (2, 3)], ids=["one day alone", "fewer than half"])
def test_a_quarter_hour_of_one_day_or_of_fewer_than_half_of_the_days_is_not_shown(
    both: int, first: int
) -> None:
    bands = overlay_days([held(10.0, 20.0)] * both + [held(10.0)] * first)

    assert [band.days for band in bands] == [both + first, both]
    assert [band.percentiles_deg is None for band in bands] == [False, True]


def test_a_day_with_less_than_half_of_a_quarter_hour_does_not_count_in_it() -> None:
    (band,) = overlay_days([held(10.0), held(10.0), held(80.0, quarter_s=440.0)])

    assert band.days == 2


def test_a_night_shift_is_drawn_from_its_beginning() -> None:
    night = held(10.0, 10.0, 10.0, start=EIGHT.replace(hour=23, minute=30))

    assert [band.start_s / 3600 for band in overlay_days([night, night])] == [23.5, 23.75, 0.0]
    assert overlay_days([]) == ()


@pytest.mark.parametrize(
    ("values", "low", "high"),
    [
        ([4.0, 8.0, 6.0], 1.032, 10.968),  # t(2; 0.975) = 4.303; 4.303 x 2 / sqrt(3) = 4.968
        ([4.0, 6.0], 0.0, 17.706),  # t(1; 0.975) = 12.706, SE = 1; not below nothing
        ([94.0, 96.0], 82.294, 100.0),  # not more than the whole
    ],
)
def test_the_mean_of_days_has_the_range_of_students_t_inside_the_scale(
    values: list[float], low: float, high: float
) -> None:
    days = describe_days(values, most=100.0)

    assert days.mean == sum(values) / len(values)
    assert days.mean_range is not None
    assert (days.mean_range.low, days.mean_range.high) == pytest.approx((low, high), abs=1e-3)


def find_factors(interval: Interval | None, value: float | None) -> list[float]:
    assert interval is not None
    assert value
    return [interval.low / value, interval.high / value]


def test_the_deviation_of_five_days_is_known_to_a_factor() -> None:
    days = describe_days([1.0, 2.0, 3.0, 4.0, 5.0])

    assert days.sd == pytest.approx(sqrt(2.5))
    assert find_factors(days.sd_range, days.sd) == pytest.approx([0.599, 2.874], abs=1e-3)


def test_one_day_has_no_spread_and_days_that_do_not_differ_no_range_of_it() -> None:
    day, equal = describe_days([6.0]), describe_days([6.0, 6.0])

    assert (day.sd, day.mean_range, day.sd_range) == (None, None, None)
    assert (equal.sd, equal.sd_range) == (0.0, None)


def test_four_days_are_judged_by_the_published_deviation() -> None:
    telling = find_telling(describe_days([4.0, 8.0, 4.0, 8.0]), 2.0)

    # mean 6, half of it 3: 5.54, 3.92, 3.20 and 2.48 points with 1, 2, 3 and 5 days
    assert (telling.sd_from, telling.days, telling.more_days) == ("published", 5, 1)
    assert telling.detectable == pytest.approx(2.479, abs=1e-3)


def test_five_days_are_judged_by_their_own_and_known_as_well_as_it() -> None:
    telling = find_telling(describe_days([9.0, 10.0, 10.0, 10.0, 11.0]), 2.0)

    # SD sqrt(0.5); 1.96 x sqrt(2) x 0.7071 = 1.96, less than half of 10
    assert (telling.sd_from, telling.days, telling.more_days) == ("person", 1, 0)
    assert telling.detectable == pytest.approx(1.96 * sqrt(2 / 5) * sqrt(0.5))
    factors = find_factors(telling.detectable_range, telling.detectable)
    assert factors == pytest.approx([0.599, 2.874], abs=1e-3)


def test_a_change_between_unequal_numbers_of_days() -> None:
    assert find_detectable_between(BETWEEN_DAY_SD["time_above_60_percent"], 4, 1) == pytest.approx(
        1.96 * 2.0 * sqrt(1.25)
    )


def test_the_deviation_of_two_series_is_pooled() -> None:
    # squares 2 and 2, one degree of freedom and two
    assert pool_deviation([[4.0, 6.0], [9.0, 10.0, 11.0]]) == pytest.approx((sqrt(4 / 3), 3))
    assert pool_deviation([[4.0], [6.0]]) is None


@pytest.mark.parametrize(
    ("people", "mean", "within_sd", "between_sd"),
    [
        # MSW = 4 / 2, MSB = 2 x 9 + 2 x 9, n0 = 2
        ({"A": [4.0, 6.0], "B": [10.0, 12.0]}, 8.0, sqrt(2.0), sqrt((36.0 - 2.0) / 2.0)),
        # each person once: (5 + 10) / 2; MSW = 4/3, MSB = 2 x 9 + 3 x 4, n0 = 5 - 13/5
        ({"A": [4.0, 6.0], "B": [9.0, 10.0, 11.0]}, 7.5, sqrt(4 / 3), sqrt((30.0 - 4 / 3) / 2.4)),
        # people who differ no more than their days
        ({"A": [4.0, 8.0], "B": [5.0, 7.0]}, 6.0, sqrt(5.0), 0.0),
    ],
)
def test_the_spread_of_a_group_is_split_between_and_within_people(
    people: dict[str, list[float]], mean: float, within_sd: float, between_sd: float
) -> None:
    group = describe_group(people)

    assert (group.people, group.days) == (2, sum(map(len, people.values())))
    assert (group.mean, group.within_sd, group.between_sd) == pytest.approx((mean, within_sd, between_sd))


def test_one_day_of_each_person_cannot_be_split() -> None:
    group = describe_group({"A": [4.0], "B": [8.0]})

    assert (group.within_sd, group.between_sd) == (None, None)
    assert group.mean_range is not None


def test_a_change_is_that_of_people_measured_on_both_sides() -> None:
    change = compare_people(
        {"A": [4.0, 6.0], "B": [10.0], "C": [50.0]}, {"A": [7.0], "B": [14.0], "D": [1.0]}
    )

    assert change is not None  # A 5 to 7, B 10 to 14: t(1) x sqrt(2) / sqrt(2)
    assert (change.people, change.before, change.after, change.change) == (2, 7.5, 10.5, 3.0)
    assert change.change_range is not None
    assert (change.change_range.low, change.change_range.high) == pytest.approx((-9.706, 15.706), abs=1e-3)


def test_without_a_person_on_both_sides_there_is_no_change() -> None:
    assert compare_people({"A": [4.0]}, {"B": [4.0]}) is None
