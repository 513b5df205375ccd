"""A change between two days is told beside what days differ by anyway."""

from dataclasses import replace
from datetime import datetime
from typing import Any

import numpy as np
import pytest

from fusion.comparison import ComparedDay, FigureChange, compare_days, find_detectable_change
from fusion.exposure import summarise_exposure
from tests.factories import elevate


def spend_above(percent: int, hours: int = 5) -> ComparedDay:
    """A day at 20 deg, ``percent`` of it at 70 deg."""
    minute = np.where(np.arange(100) < percent, 70.0, 20.0)
    exposure = summarise_exposure(elevate(np.tile(minute, 36 * hours), rate_hz=1.0))
    return ComparedDay(exposure, "smoothed", "n-pose", "right", "good")


def find(before: ComparedDay, after: ComparedDay, name: str) -> FigureChange:
    return next(change for change in compare_days(before, after).changes if change.name == name)


@pytest.mark.parametrize(("days", "above_60", "median"), [(1, 5.5, 9.4), (5, 2.5, 4.2)])
def test_the_least_detectable_change_is_that_of_the_published_table(
    days: int, above_60: float, median: float
) -> None:
    assert find_detectable_change(2.0, days) == pytest.approx(above_60, abs=0.05)
    assert find_detectable_change(3.4, days) == pytest.approx(median, abs=0.05)


@pytest.mark.parametrize(("after", "verdict"), [(15, "not larger"), (16, "larger"), (4, "larger")])
def test_a_change_is_larger_than_day_to_day_variation_from_5_and_a_half_points_on(
    after: int, verdict: str
) -> None:
    change = find(spend_above(10), spend_above(after), "time_above_60_percent")

    assert change.verdict == verdict
    assert change.change == pytest.approx(after - 10)


def test_a_figure_without_published_variation_gets_no_verdict() -> None:
    change = find(spend_above(10), spend_above(50), "time_above_90_percent")

    assert (change.detectable, change.verdict) == (None, "unknown")


MORNING = datetime.fromisoformat("2026-03-02T08:00")


@pytest.mark.parametrize(
    ("start", "differences"),
    [
        ("2026-03-02T12:59", ("hours",)),
        ("2026-03-02T13:00", ()),
        ("2026-03-01T08:00", ("order",)),
        ("2026-03-02T12:59+00:00", ("hours",)),
        (None, ()),
    ],
)
def test_hours_that_overlap_are_no_two_days_and_an_earlier_day_is_no_later_one(
    start: str | None, differences: tuple[str, ...]
) -> None:
    before = replace(spend_above(10), start=MORNING, duration_s=5 * 3600.0)
    after = replace(
        spend_above(50), start=datetime.fromisoformat(start) if start else None, duration_s=5 * 3600.0
    )

    compared = compare_days(before, after)

    assert compared.differences == differences
    judged = next(change for change in compared.changes if change.name == "time_above_60_percent")
    assert (judged.verdict == "no two days") == (differences == ("hours",))


def test_what_the_days_differ_in_besides_the_work_is_named() -> None:
    after = replace(
        spend_above(10, hours=3), method="published", pose="side-lean", side="left", verdict="poor"
    )

    assert compare_days(spend_above(10), after).differences == ("method", "pose", "side", "short", "poor")


@pytest.mark.parametrize(
    ("before", "after", "difference"),
    [
        ({"sha256": "0a"}, {"sha256": "0a"}, "recording"),
        ({}, {"side": "left"}, "side"),
        ({"subject": "S1"}, {"subject": "S2"}, "subject"),
    ],
)
def test_one_recording_arm_or_person_beside_another_is_no_change(
    before: dict[str, Any], after: dict[str, Any], difference: str
) -> None:
    compared = compare_days(replace(spend_above(10), **before), replace(spend_above(30), **after))

    assert compared.differences == (difference,)
    assert {(change.detectable, change.verdict) for change in compared.changes} == {(None, "no two days")}


def test_a_day_without_a_subject_code_may_be_of_the_same_person() -> None:
    assert compare_days(replace(spend_above(10), subject="S1"), spend_above(20)).differences == ()


def test_no_days_are_no_comparison() -> None:
    with pytest.raises(ValueError, match="0"):
        find_detectable_change(2.0, 0)
