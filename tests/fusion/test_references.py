"""Published values stand beside the figure they were made for, or say why not; conventions add up bins."""

from dataclasses import replace

import numpy as np

from fusion.exposure import Exposure, Velocity, summarise_exposure
from fusion.references import REFERENCES, compare_with_references
from tests.factories import elevate


def work(hours: float) -> Exposure:
    """A quarter of the time in each of 10, 40, 70 and 100 deg."""
    return summarise_exposure(elevate(np.tile([10.0, 40.0, 70.0, 100.0], round(hours * 900)), rate_hz=1.0))


def find(exposure: Exposure, key: str, verdict: str = "good") -> tuple[float | None, str]:
    found = {item.reference.key: item for item in compare_with_references(exposure, verdict)}
    return found[key].measured, found[key].reason


def test_time_above_60_deg_stands_beside_its_proposal() -> None:
    assert find(work(5), "above_60") == (50.0, "")


def test_a_part_of_a_day_is_not_compared() -> None:
    assert find(work(3.9), "above_60")[1] == "short"


def test_poor_data_are_not_compared() -> None:
    assert find(work(5), "above_60", "poor")[1] == "poor"


def test_a_fused_speed_is_never_set_beside_the_60_deg_per_s() -> None:
    exposure = replace(work(5), velocity_dps={"generalised": Velocity(1, 2, 3, 4, 5)})

    assert find(exposure, "velocity") == (None, "not computed")


def test_the_accelerometers_speed_is() -> None:
    exposure = replace(work(5), velocity_dps={"generalised_accelerometer": Velocity(1, 71, 3, 4, 5)})

    assert find(exposure, "velocity") == (71, "")


def test_no_value_marked_unverified_is_shipped() -> None:
    assert {(item.key, item.high) for item in REFERENCES} == {
        ("above_30", 50.0),
        ("above_60", 10.0),
        ("velocity", 60.0),
        ("p99", 124.0),
    }
