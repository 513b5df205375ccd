"""Sensors too coarse or too unsteady for stillness: the caveat names the cause, and so does a refusal."""

import numpy as np
import pytest

from fusion.checks.summary import flag_resolution
from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import TooShort
from fusion.pipeline import analyse
from fusion.quality.flags import flag_accelerometer_drift
from fusion.quality.time_account import account_time
from fusion.recording import QualityFlag
from fusion.sensor.accelerometer import leave_accelerometer
from fusion.sensor.stillness import QuietTable
from tests.badfiles.arm import minute
from tests.factories import record


def rounded(step_g: float, step_dps: float) -> list[QualityFlag]:
    acc_g, gyr_dps = minute()
    made = record(np.rint(acc_g / step_g) * step_g, np.rint(gyr_dps / step_dps) * step_dps, 100.0)
    return list(flag_resolution(made))


@pytest.mark.parametrize(
    ("step_g", "step_dps", "facts"),
    [
        (32 / 1024, 0.061, {"step_mg": 31.2}),
        (0.0005, 4000 / 1024, {"step_dps": 3.91}),
    ],
)
def test_ten_bits_are_flagged_with_their_step(
    step_g: float, step_dps: float, facts: dict[str, float]
) -> None:
    (flag,) = rounded(step_g, step_dps)

    assert (flag.code, flag.facts) == ("W-RESOLUTION", facts)


@pytest.mark.parametrize(("step_g", "step_dps"), [(0.0005, 0.061), (0.0102, 0.573), (1e-6, 1e-6)])
def test_twelve_bits_two_decimals_and_no_rounding_are_not(step_g: float, step_dps: float) -> None:
    assert rounded(step_g, step_dps) == []


def stills(first_g: float, last_g: float, count: int = 40) -> QuietTable:
    """Rests in one direction, a minute apart, of a length that changes evenly."""
    gravity_g = np.outer(np.linspace(first_g, last_g, count), [0.6, 0.8, 0.0])
    nothing = np.zeros(count)
    start_s = np.linspace(0.0, 60.0 * count, count)
    return QuietTable(start_s, 1.5, gravity_g, np.zeros((count, 3)), nothing, nothing)


def test_a_length_at_rest_that_changes_is_flagged() -> None:
    (flag,) = flag_accelerometer_drift(stills(1.00, 1.04), leave_accelerometer())

    assert (flag.code, flag.facts) == ("W-ACC-DRIFT", {"mg": 31})


@pytest.mark.parametrize("count", [0, 7, 40])
def test_a_steady_length_or_few_rests_are_not(count: int) -> None:
    last_g = 1.01 if count == 40 else 1.04

    assert flag_accelerometer_drift(stills(1.0, last_g, count), leave_accelerometer()) == ()


def test_a_recording_of_which_too_little_is_trusted_is_refused_with_the_cause() -> None:
    acc_g, gyr_dps = minute()
    drift = QualityFlag("W-ACC-DRIFT")
    run = ElevationSegment(0, 100.0, np.zeros(6000, np.float32), np.arange(6000) < 500)
    elevation = Elevation((run,), None)

    with pytest.raises(TooShort) as refusal:
        account_time(record(acc_g, gyr_dps, 100.0), elevation, (), (drift,))

    assert refusal.value.facts == {"s": 5.0, "left_out": "untrusted", "left_out_s": 55.0, "cure": "drift"}


def test_an_hour_that_the_accelerometer_drifts_through_says_so() -> None:
    acc_g, gyr_dps = minute(times=20)
    warm_g = 0.06 * np.linspace(0.0, 1.0, len(acc_g))[:, None]

    analysis = analyse(record(acc_g + warm_g * [1.0, 0.0, 1.0], gyr_dps, 100.0))

    assert "W-ACC-DRIFT" in [flag.code for flag in analysis.quality.flags]
