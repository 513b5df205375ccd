"""Published values stand beside the figure they were made for, or say why not; conventions add up bins."""

from dataclasses import replace

import numpy as np

from fusion.comparison import NOT_SHIPPED, REFERENCES, STATEMENTS, compare_with_references
from fusion.exposure import Exposure, Velocity, summarise_exposure
from tests.factories import elevate


def work(hours: float) -> Exposure:
    """A quarter of the time in each of 10, 40, 70 and 100 deg."""
    return summarise_exposure(elevate(np.tile([10.0, 40.0, 70.0, 100.0], round(hours * 900)), rate_hz=1.0))


def find(exposure: Exposure, key: str, verdict: str = "good") -> tuple[float | None, str]:
    found = {item.reference.key: item for item in compare_with_references(exposure, verdict)}
    return found[key].measured, found[key].reason


def test_a_figure_of_a_whole_day_of_good_data_stands_beside_its_reference() -> None:
    assert find(work(5), "above_60") == (50.0, "")
    assert find(work(8), "above_90_hours") == (2.0, "")
    assert find(work(3.9), "above_60")[1] == "short"
    assert find(work(5), "above_60", "poor")[1] == "poor"


def test_only_the_accelerometers_speed_is_set_beside_the_60_deg_per_s() -> None:
    fused = replace(work(5), velocity_dps={"generalised": Velocity(1, 2, 3, 4, 5)})
    unfused = replace(work(5), velocity_dps={"generalised_accelerometer": Velocity(1, 71, 3, 4, 5)})

    assert find(fused, "velocity") == (None, "not computed")
    assert find(unfused, "velocity") == (71, "")


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
    assert set(STATEMENTS) == {"svendsen", "dalboge", "seidler", "waersted", "nfa"}


def test_what_is_not_shipped_is_named_with_its_reason() -> None:
    assert {name.split(",")[0]: why for name, why in NOT_SHIPPED.items()} == {
        "Dalboge 2017": "read in a table that quotes it; which speed is not said",
        "ISO 11226": "not read in the standard",
        "EN 1005-4": "not read in the standard",
        "ISO 11228-3 and OCRA": "not read in the standard",
        "RAMP II": "the height of the hand, which this angle does not tell",
        "Lewis 2026": "of many days, which one recording is not",
    }
