"""Sensors too coarse or too unsteady for stillness: the caveat names the cause, and so does a refusal."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from acromion.fusion.checks import summary
from acromion.fusion.checks.physics import check_physics, cut_windows
from acromion.fusion.checks.summary import find_flat_range, flag_resolution, summarise_sensor
from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.errors import TooShort
from acromion.fusion.pipeline import analyse
from acromion.fusion.quality.time_account import account_time, find_exclusions
from acromion.fusion.quality.verdict import flag_accelerometer_drift
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import QualityFlag, Recording, Segment
from acromion.fusion.sensor.model import build_identity_accelerometer
from acromion.fusion.sensor.stillness import QuietTable
from tests.badfiles.arm import minute
from tests.factories import record
from tests.fusion.made_motion import rest_and_turn
from tests.validation.broad import load_trials


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
    (flag,) = flag_accelerometer_drift(stills(1.00, 1.04), build_identity_accelerometer())

    assert (flag.code, flag.facts) == ("W-ACC-DRIFT", {"mg": 31})


@pytest.mark.parametrize("count", [0, 7, 40])
def test_a_steady_length_or_few_rests_are_not(count: int) -> None:
    last_g = 1.01 if count == 40 else 1.04

    assert flag_accelerometer_drift(stills(1.0, last_g, count), build_identity_accelerometer()) == ()


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


# Summaries of the samples: made once for each segment while the checks run, and freed after them.


def test_a_segment_is_summarised_once(shift_gt3x: Path) -> None:
    segment = read_recording(shift_gt3x).segments[0]

    assert summary.summarise(segment) is summary.summarise(segment)


def test_a_recording_that_was_read_holds_no_summary(shift_gt3x: Path) -> None:
    recording = read_recording(shift_gt3x)

    assert [segment for segment in recording.segments if segment in summary._SUMMARIES] == []


# A sensor cut off below the range that its file states is told by its flat tops.


def swings(size: float, rows: int = 4000) -> NDArray[np.float32]:
    """About z, 0.5 Hz at 100 samples a second, on the steps of a part."""
    swing = size * np.sin(np.pi * np.arange(rows) / 100.0 + 0.3)
    return np.column_stack([0.0 * swing, 0.0 * swing, np.round(swing / 0.07) * 0.07]).astype(np.float32)


@pytest.mark.parametrize(
    ("samples", "top"),
    [
        (np.clip(swings(200.0), -100.0, 100.0), 100.0),
        (np.clip(swings(200.0), -100.0, 99.93), 100.0),
        (swings(300.0), None),
        (np.clip(swings(200.0, 350), -100.0, 100.0), None),
        (np.random.default_rng(0).integers(-1, 2, (5000, 3)).astype(np.float32), None),
    ],
    ids=["flat tops", "ends a count apart", "round tops", "four flat tops", "coarse noise at rest"],
)
def test_the_size_at_which_swings_are_cut_off_is_found(
    samples: NDArray[np.float32], top: float | None
) -> None:
    assert find_flat_range([summarise_sensor(samples)], 50.0) == top


def test_what_is_cut_off_below_the_stated_range_is_excluded() -> None:
    motion = rest_and_turn(80)
    cut = np.clip(motion.gyr_dps, -100.0, 100.0).astype(np.float32)
    segment = Segment(0, 100.0, motion.acc_g.astype(np.float32), cut)
    recording = Recording(
        "other", "", None, None, segment.duration_us, (segment,), acc_range_g=16.0, gyr_range_dps=2000.0
    )

    checked = check_physics(recording)

    assert (checked.acc_range_g, checked.gyr_range_dps) == (16.0, 100.0)
    assert {span.reason for span in find_exclusions(checked)} == {"clipped"}


def test_windows_of_a_gyroscope_that_reads_zero_throughout_are_kept() -> None:
    motion = rest_and_turn(9)
    segment = Segment(0, 100.0, motion.acc_g.astype(np.float32), np.zeros((len(motion.acc_g), 3), np.float32))

    assert find_flat_range([summarise_sensor(segment.gyr_dps)]) == 0.0
    assert len(cut_windows([segment])) > 0


@pytest.mark.real_recordings
def test_no_trial_of_broad_is_cut_off(shared_data: Callable[[str], Path]) -> None:
    trials = load_trials(shared_data("broad"))

    found = [find_flat_range([summarise_sensor(trial.gyr_dps.astype(np.float32))], 50.0) for trial in trials]

    assert found == [None] * len(trials)
