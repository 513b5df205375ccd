"""A change between two days is told beside what days differ by anyway."""

from dataclasses import replace
from datetime import datetime
from typing import Any

import numpy as np
import pytest

from acromion.fusion.comparison.change import (
    NOT_SHIPPED,
    REFERENCES,
    STATEMENTS,
    ComparedDay,
    FigureChange,
    compare_days,
    compare_with_references,
    find_detectable_change,
)
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.exposure.types import Exposure, Velocity
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


# Published values stand beside the figure they were made for, or say why not; conventions add up bins.


def work(hours: float) -> Exposure:
    """A quarter of the time in each of 10, 40, 70 and 100 deg."""
    return summarise_exposure(elevate(np.tile([10.0, 40.0, 70.0, 100.0], round(hours * 900)), rate_hz=1.0))


def find_reference(exposure: Exposure, key: str, verdict: str = "good") -> tuple[float | None, str]:
    found = {item.reference.key: item for item in compare_with_references(exposure, verdict)}
    return found[key].measured, found[key].reason


def test_a_figure_of_a_whole_day_of_good_data_stands_beside_its_reference() -> None:
    assert find_reference(work(5), "above_60") == (50.0, "")
    assert find_reference(work(8), "above_90_hours") == (2.0, "")
    assert find_reference(work(3.9), "above_60")[1] == "short"
    assert find_reference(work(5), "above_60", "poor")[1] == "poor"


def test_only_the_accelerometers_speed_is_set_beside_the_60_deg_per_s() -> None:
    fused = replace(work(5), velocity_dps={"generalised": Velocity(1, 2, 3, 4, 5)})
    unfused = replace(work(5), velocity_dps={"generalised_accelerometer": Velocity(1, 71, 3, 4, 5)})

    assert find_reference(fused, "velocity") == (None, "not computed")
    assert find_reference(unfused, "velocity") == (71, "")


def test_every_reference_the_brief_marks_as_read_is_shipped_with_its_values() -> None:
    assert {(item.key, item.low, item.high, item.status) for item in REFERENCES} == {
        ("above_30", None, 50.0, "proposal"),
        ("above_60", None, 10.0, "proposal"),
        ("velocity", None, 60.0, "proposal"),
        ("p99", 49.0, 124.0, "context"),
        ("above_90_hours", 2.0, 4.0, "guidance"),
        ("above_60_others", 4.4, 7.9, "context"),
        ("above_90_others", 1.0, 2.8, "context"),
    }
    assert set(STATEMENTS) == {"svendsen", "dalboge", "seidler", "waersted", "nfa", "gupta"}


def test_what_is_not_shipped_is_named_with_its_reason() -> None:
    assert {name.split(",")[0]: why for name, why in NOT_SHIPPED.items()} == {
        "Dalboge 2017": "read in a table that quotes it, without the kind of speed",
        "ISO 11226": "not read in the standard",
        "EN 1005-4": "not read in the standard",
        "ISO 11228-3 and OCRA": "not read in the standard",
        "RAMP II": "the height of the hand, which this angle does not show",
    }
