"""Several days overlaid by the clock, and the spread between days and people, worked out by hand."""

from datetime import datetime
from math import sqrt
from typing import Any

import numpy as np
import pytest

from acromion.fusion.comparison.change import BETWEEN_DAY_SD
from acromion.fusion.comparison.days import (
    compare_people,
    describe_days,
    describe_group,
    find_designs,
    find_detectable_between,
    find_telling,
    lay_on_clock,
    overlay_days,
    pool_deviation,
)
from acromion.fusion.exposure.types import Interval
from acromion.fusion.recording import Float64Array
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


LOOMS = {
    "1": [98.0, 97.0, 99.0, 96.0],
    "2": [91.0, 90.0, 93.0, 92.0],
    "3": [96.0, 95.0, 97.0, 95.0],
    "4": [95.0, 96.0, 99.0, 98.0],
}
"""Montgomery, Design and Analysis of Experiments: strength of cloth of four looms; mean squares 29.7, 1.9."""


def test_the_components_of_a_published_example_have_its_values() -> None:
    group = describe_group(LOOMS)

    assert group.within_sd is not None
    assert group.between_sd is not None
    assert (group.between_sd**2, group.within_sd**2) == pytest.approx((6.96, 1.90), abs=0.005)


def test_the_range_of_the_deviation_within_people_is_that_of_chi_square() -> None:
    # 12 x 1.89583 = 22.75; chi square of 12: 23.337 and 4.4038
    found = describe_group(LOOMS).within_range

    assert found is not None
    assert (found.low**2, found.high**2) == pytest.approx((22.75 / 23.337, 22.75 / 4.4038), rel=1e-4)


def test_the_range_of_the_deviation_between_people_is_that_of_williams() -> None:
    # SSA = 89.1875, MSW = 1.89583; F of 3 and 12: 4.4742 and 1 / 14.337; chi square of 3: 9.3484 and 0.21580
    low = (89.1875 - 3 * 4.4742 * 1.89583) / (4 * 9.3484)
    high = (89.1875 - 3 / 14.337 * 1.89583) / (4 * 0.21580)

    found = describe_group(LOOMS).between_range

    assert found is not None
    assert (found.low**2, found.high**2) == pytest.approx((low, high), rel=1e-4)


def test_people_who_differ_no_more_than_their_days_have_a_range_from_zero() -> None:
    found = describe_group({"A": [4.0, 8.0], "B": [6.0, 9.0], "C": [3.0, 8.0]}).between_range

    assert found is not None
    assert found.low == 0.0 < found.high


def test_people_who_differ_less_than_chance_allows_have_no_range() -> None:
    assert describe_group({"A": [4.0, 8.0], "B": [5.0, 7.0], "C": [6.0, 6.2]}).between_range is None


def test_the_ranges_of_unequal_days_include_the_true_deviations_as_often_as_stated() -> None:
    chance, hits = np.random.default_rng(1), np.zeros(2)
    for _ in range(400):
        levels = chance.normal(0.0, 2.0, 8)
        people = {
            str(k): chance.normal(level, 1.5, 2 + k % 4).tolist() for k, level in enumerate(levels.tolist())
        }
        group = describe_group(people)
        assert group.within_range is not None
        assert group.between_range is not None
        hits += (
            group.within_range.low <= 1.5 <= group.within_range.high,
            group.between_range.low <= 2.0 <= group.between_range.high,
        )
    assert (hits / 400).tolist() == pytest.approx([0.95, 0.95], abs=0.03)


def test_people_for_a_margin_of_the_mean_are_the_fewest_by_students_t() -> None:
    # one day: 9 + 16 = 25, t(26) 2.0555 x 5 / sqrt 27 = 1.978, with 26 people 2.020;
    # four days: 9 + 4 = 13, t(14) 2.1448 x sqrt(13 / 15) = 1.997, with 14 people 2.082
    designs = find_designs(within_sd=4.0, between_sd=3.0, margin=2.0, days=(1, 4))

    assert [(one.people, one.days) for one in designs] == [(27, 1), (15, 4)]
    assert [one.margin for one in designs] == pytest.approx([1.978, 1.997], abs=5e-4)


def test_a_change_needs_no_knowledge_of_the_differences_between_people() -> None:
    # two days on each side: 2 x 16 / 2 = 16, t(17) 2.1098 x 4 / sqrt 18 = 1.989, with 17 people 2.057
    (design,) = find_designs(within_sd=4.0, between_sd=30.0, margin=2.0, days=(2,), of="change")

    assert design.people == 18
    assert design.margin == pytest.approx(1.989, abs=5e-4)


def test_the_margin_of_a_design_is_the_one_that_such_a_study_finds_on_average() -> None:
    chance = np.random.default_rng(2)
    (design,) = find_designs(within_sd=4.0, between_sd=3.0, margin=2.0, days=(2,))
    widths = []
    for _ in range(300):
        levels = chance.normal(50.0, 3.0, design.people)
        people = {str(k): chance.normal(level, 4.0, 2).tolist() for k, level in enumerate(levels.tolist())}
        mean_range = describe_group(people).mean_range
        assert mean_range is not None
        widths.append((mean_range.high - mean_range.low) / 2)

    assert np.sqrt(np.mean(np.square(widths))) == pytest.approx(design.margin, rel=0.03)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_day_without_a_number_is_refused_with_the_person(value: float) -> None:
    people = {"A": [1.0, 2.0], "B": [3.0, value]}
    told = rf"B has a day with the value {value}; omit days without a figure"

    with pytest.raises(ValueError, match=f"people: {told}"):
        describe_group(people)
    with pytest.raises(ValueError, match=f"after: {told}"):
        compare_people({"A": [1.0], "B": [2.0]}, people)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["within_sd", "between_sd", "margin"])
def test_a_design_names_the_argument_that_is_not_a_number(name: str, value: float) -> None:
    given: dict[str, Any] = {"within_sd": 4.0, "between_sd": 3.0, "margin": 2.0} | {name: value}

    with pytest.raises(ValueError, match=f"^{name}: {value}; allowed"):
        find_designs(**given)


@pytest.mark.parametrize("wrong", [{"margin": 0.0}, {"within_sd": -1.0}, {"days": (0,)}, {"days": ()}])
def test_a_design_that_cannot_be_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=f"^{next(iter(wrong))}: .*; allowed: "):
        find_designs(**({"within_sd": 1.0, "between_sd": 1.0, "margin": 1.0} | wrong))
