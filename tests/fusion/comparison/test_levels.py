"""A day beside a proposed level: below, above, or cannot tell."""

from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime

import pytest

from acromion.fusion.comparison.change import find_planned_change
from acromion.fusion.comparison.levels import (
    Extent,
    Standing,
    combine_days,
    compare_with_level,
    compare_with_levels,
    find_extent,
)
from acromion.fusion.conventions import CalibrationState
from acromion.fusion.diary import DiaryEntry, Kind
from acromion.fusion.exposure.periods import place_diary
from acromion.fusion.exposure.types import Interval, Velocity
from acromion.fusion.quality import TimeAccount, Verdict
from acromion.fusion.recording import Span
from tests.app.analysis_factory import make_exposure, with_velocity

HOUR_US = 3_600_000_000
RANGES = {30: Interval(27.0, 38.0, 27.0, 45.0), 60: Interval(5.2, 9.3, 5.2, 9.8), 90: Interval(1.4, 3.0)}
WITHOUT_POSE = {deg: Interval(interval.low, interval.high) for deg, interval in RANGES.items()}


@pytest.mark.parametrize(
    ("interval", "standing"),
    [
        (Interval(5.2, 9.3), "below"),
        (Interval(5.2, 9.3, 5.2, 9.94), "below"),
        (Interval(5.2, 9.3, 5.2, 9.96), "cannot tell"),  # printed as 10.0
        (Interval(5.2, 9.3, 5.2, 14.7), "cannot tell"),
        (Interval(5.2, 10.0), "cannot tell"),
        (Interval(10.0, 12.0), "cannot tell"),
        (Interval(10.1, 12.0), "cannot tell"),  # the value itself, 7.6, is below
        (None, "cannot tell"),
    ],
)
def test_any_bound_that_crosses_the_level_leaves_it_open(interval: Interval | None, standing: str) -> None:
    assert compare_with_level(7.6, interval, 10.0) == standing


def test_a_range_above_the_level_reads_above() -> None:
    assert compare_with_level(14.0, Interval(10.1, 18.0), 10.0) == "above"


def judge(
    verdict: Verdict = "good",
    extent: Extent = "day",
    state: CalibrationState | None = "given",
    ranges: Mapping[int, Interval] = RANGES,
) -> list[tuple[Standing | None, str]]:
    """Compare 32.5 % above 30 deg, 7.6 % above 60 deg and 41 deg/s with 50 %, 10 % and 60 deg/s."""
    exposure = with_velocity(
        make_exposure(), "generalised_accelerometer", Velocity(2.0, 41.0, 120.0, 260.0, 58.0)
    )
    above = tuple(replace(t, interval=ranges[int(t.threshold_deg)]) for t in exposure.time_above)
    speeds = {"generalised_accelerometer_velocity_p50_dps": Interval(38.0, 44.0)}
    day = replace(exposure, time_above=above, intervals=speeds)
    return [(one.standing, one.reason) for one in compare_with_levels(day, verdict, extent, state)]


def test_a_good_day_is_compared_with_each_of_three_proposals() -> None:
    assert judge() == [("below", "")] * 3


@pytest.mark.parametrize("extent", ["part", "unknown"])
def test_part_of_a_day_is_compared_as_well(extent: Extent) -> None:
    assert judge(extent=extent) == [("below", "")] * 3


def test_poor_data_and_less_than_four_hours_are_not_compared() -> None:
    assert judge("poor") == [(None, "poor")] * 3
    assert judge("poor", "short") == [(None, "short")] * 3


def test_an_assumed_pose_reads_below_only_with_its_error_in_the_range() -> None:
    assert judge(state="assumed")[1] == ("below", "")
    assert judge(state="assumed", ranges=WITHOUT_POSE) == [("cannot tell", "")] * 2 + [("below", "")]


def test_ready_angle_series_never_read_below() -> None:
    assert judge(state=None) == [("cannot tell", "")] * 3


def test_a_velocity_that_was_not_computed_is_not_compared() -> None:
    exposure = with_velocity(make_exposure(), "generalised_accelerometer", None)

    compared = compare_with_levels(exposure, "good", "day", "given")

    assert [(one.reference.key, one.reason) for one in compared][2] == ("velocity", "not computed")


@pytest.mark.parametrize(
    ("analysed_h", "break_h", "shift_h", "extent"),
    [
        (3.9, 0.0, 8.0, "short"),
        (4.0, 0.0, None, "unknown"),
        (7.1, 0.5, 8.0, "day"),  # 7.6 of 8 h is 95 %
        (7.0, 0.5, 8.0, "part"),
        (4.0, 0.0, 4.0, "day"),
    ],
)
def test_a_day_is_whole_when_shift_and_breaks_are_covered(
    analysed_h: float, break_h: float, shift_h: float | None, extent: str
) -> None:
    shift_us = None if shift_h is None else round(shift_h * HOUR_US)
    time = TimeAccount(8 * HOUR_US, round(analysed_h * HOUR_US), 0, 0, shift_us=shift_us)
    left_out = (Span(0, round(break_h * HOUR_US), "break"), Span(0, HOUR_US, "docked"))

    assert find_extent(time, left_out) == extent


def test_the_range_of_other_days_adds_the_squares_of_its_parts() -> None:
    days = combine_days(7.6, Interval(5.2, 9.9, 5.2, 14.7))

    # days: 1.96 x 2.0 = 3.92; below 2.4, above 7.1; sqrt(5.76 + 15.37) = 4.60, sqrt(50.41 + 15.37) = 8.11
    assert (days.between.low, days.between.high) == pytest.approx((3.68, 11.52))
    assert days.combined is not None
    assert (days.combined.low, days.combined.high) == pytest.approx((3.00, 15.71), abs=0.005)


def test_a_share_of_other_days_is_never_negative_and_needs_the_range_of_the_day() -> None:
    combined = combine_days(1.0, Interval(0.5, 2.0)).combined

    assert combined is not None
    assert (combined.low, combined.high) == pytest.approx((0.0, 5.046), abs=0.001)  # sqrt(1 + 3.92²) = 4.046
    assert combine_days(1.0, None).combined is None


@pytest.mark.parametrize(("days", "points"), [(1, 7.92), (2, 5.6), (3, 4.57), (5, 3.54)])
def test_a_planned_change_is_detected_with_eighty_percent_power(days: int, points: float) -> None:
    # (1.96 + 0.84) x sqrt(2 / days) x 2.0
    assert find_planned_change(2.0, days) == pytest.approx(points, abs=0.01)


@pytest.mark.parametrize(
    ("rows", "shift_h"),
    [
        ([("07:00", "15:00", "shift")], 8),  # from before the recording until after it
        ([("08:00", "10:00", "shift"), ("11:00", "13:00", "shift")], 4),
        ([("08:00", None, "shift")], None),  # its end is not stated
        ([("08:00", "12:00", "task")], None),
    ],
)
def test_the_shift_is_as_long_as_its_rows_say(
    rows: list[tuple[str, str | None, Kind]], shift_h: int | None
) -> None:
    diary = [DiaryEntry(start, end, kind) for start, end, kind in rows]

    placed = place_diary(diary, datetime.fromisoformat("2026-03-03T08:00"), 6 * HOUR_US)

    assert placed.shift_us == (None if shift_h is None else shift_h * HOUR_US)
