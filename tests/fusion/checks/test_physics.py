"""Unit and hand are found from the samples and changed on strong evidence only; a scale is doubted."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from acromion.fusion.checks.physics import are_exchanged, check_physics
from acromion.fusion.checks.summary import find_rests
from acromion.fusion.errors import NoGravity, UnknownUnit
from acromion.fusion.recording import Recording, Segment, Stated
from acromion.fusion.simulation import simulate_shift
from acromion.fusion.simulation.sensor import Device
from tests.conftest import SHARED_DATA
from tests.fusion.made_motion import rest_and_turn
from tests.simulated_shifts import play_shift
from tests.validation.broad import load_trials, resample_to_100_hz

RATE_HZ = 100.0
Array = NDArray[np.float64]
MIRROR = np.array([-1.0, 1.0, 1.0])


def recording_of(
    acc: NDArray[np.floating], gyr: NDArray[np.floating], rate_hz: float = RATE_HZ, **stated: Any
) -> Recording:
    segment = Segment(0, rate_hz, acc.astype(np.float32), gyr.astype(np.float32))
    return Recording("other", "", None, None, segment.duration_us, (segment,), stated=Stated(**stated))


def told(recording: Recording) -> list[object]:
    return [flag.facts["what"] for flag in recording.flags]


STATED: dict[str, Any] = {"acc_unit": "g", "gyr_unit": "dps"}
# each with the unit that is stated for it
ACC_UNITS = (
    *((9.80665, ""), (2 / 3, ""), (2 / 3, "g"), (1000.0, "g")),
    *((9.80665e-3, "mg"), (1 / 9.80665, "m/s2"), (1000.0, "lsb"), (1 / 0.000732, "raw")),
)
TURNS = rest_and_turn(80)
ACC, GYR = TURNS.acc_g, TURNS.gyr_dps
AT_REST = np.tile([0.0, 0.0, 1.0], (3000, 1))


@pytest.mark.parametrize("stuck", [slice(0, 0), slice(10_400, 22_400)], ids=["right", "an axis that stuck"])
def test_a_right_recording_comes_through_untouched_even_if_an_axis_stuck_for_half_of_it(stuck: slice) -> None:
    gyr = GYR.copy()
    gyr[stuck, 0] = 0.5

    checked = check_physics(recording_of(ACC, gyr, **STATED))

    assert np.array_equal(checked.segments[0].acc_g, ACC.astype(np.float32))
    assert np.array_equal(checked.segments[0].gyr_dps, gyr.astype(np.float32))
    assert checked.flags == ()


@pytest.mark.parametrize(
    ("acc_factor", "acc_unit", "gyr_factor", "gyr_unit", "what"),
    [
        *((factor, unit, 1.0, "dps", ["acceleration"]) for factor, unit in ACC_UNITS),
        (1.0, "g", np.pi / 180.0, "", ["angular rate"]),
        (1.0, "g", np.pi / 180.0, "dps", ["angular rate"]),
        (1.0, "g", 1e3, "dps", ["angular rate"]),
        (1.0, "g", 1e-3, "dps", ["angular rate"]),
    ],
)
def test_another_unit_than_stated_is_corrected_in_place(
    acc_factor: float, acc_unit: str, gyr_factor: float, gyr_unit: str, what: list[str]
) -> None:
    recording = recording_of(acc_factor * ACC, gyr_factor * GYR, acc_unit=acc_unit, gyr_unit=gyr_unit)

    checked = check_physics(recording)

    (segment,), (before,) = checked.segments, recording.segments
    assert np.linalg.norm(segment.acc_g, axis=1) == pytest.approx(1.0, abs=1e-4)
    assert segment.gyr_dps == pytest.approx(GYR, abs=1e-3)
    assert told(checked) == what
    assert np.shares_memory(segment.acc_g, before.acc_g)  # a shift is too large to be held twice
    assert np.shares_memory(segment.gyr_dps, before.gyr_dps)


@pytest.mark.parametrize(
    ("g_per_count", "dps_per_count", "ranges"),
    [(0.000061, 0.00875, (2.0, 245.0)), (0.000732, 0.0175, (16.0, 500.0))],
)
def test_the_ranges_of_a_register_dump_are_found(
    g_per_count: float, dps_per_count: float, ranges: tuple[float, float]
) -> None:
    counts = np.round(ACC / g_per_count), np.round(GYR / dps_per_count)

    checked = check_physics(recording_of(*counts, acc_unit="registers", gyr_unit="registers"))

    assert (checked.acc_range_g, checked.gyr_range_dps) == ranges
    assert checked.segments[0].gyr_dps == pytest.approx(GYR, abs=0.04)


def test_a_scale_may_be_a_wrong_rate_if_a_person_stated_the_rate() -> None:
    """100 Hz were told for 50: all durations are halved, and the gyroscope seems to read half."""
    slow = rest_and_turn(80, rate_hz=2.0 * RATE_HZ)

    (flag,) = check_physics(recording_of(slow.acc_g, 0.25 * slow.gyr_dps, **STATED, is_counted=True)).flags

    assert flag.code == "W-RATE"
    assert flag.facts["other_hz"] == pytest.approx(50.0, abs=0.5)


def test_the_error_of_a_devices_library_is_undone_if_the_frame_is_left_handed() -> None:
    """Arduino_LSM9DS1 prints 61.04 mdps for a count of 70 mdps, in the left-handed frame of the chip."""
    acc, gyr = TURNS.acc_g * MIRROR, TURNS.gyr_dps * MIRROR / 1.14688

    checked = check_physics(recording_of(acc, gyr, **STATED, left_gyr_factor=1.14688))

    assert np.abs(checked.segments[0].gyr_dps) == pytest.approx(np.abs(TURNS.gyr_dps), rel=1e-4, abs=1e-3)
    assert (told(checked), checked.device) == (["left-handed", "angular rate"], "lsm9ds1")


@pytest.mark.parametrize(
    ("acc", "gyr", "sensor", "fact", "value"),
    [
        (TURNS.acc_g, 0.87 * TURNS.gyr_dps, "gyroscope", "factor", 1 / 0.87),
        (TURNS.acc_g, 2.0 * TURNS.gyr_dps, "gyroscope", "factor", 0.5),  # all movement is fast
        (0.93 * TURNS.acc_g, TURNS.gyr_dps, "accelerometer", "g", 0.93),
        (1.05 * TURNS.acc_g, TURNS.gyr_dps, "accelerometer", "g", 1.05),
        (1.2 * AT_REST, 0.0 * AT_REST, "accelerometer", "g", 1.2),
    ],
)
def test_a_scale_that_no_part_has_is_doubted_and_left(
    acc: Array, gyr: Array, sensor: str, fact: str, value: float
) -> None:
    (flag,) = check_physics(recording_of(acc, gyr, **STATED)).flags

    assert (flag.code, flag.facts["sensor"]) == ("W-SCALE-DOUBT", sensor)
    assert flag.facts[fact] == pytest.approx(value, rel=0.02)


@pytest.mark.parametrize(
    ("acc", "gyr"),
    [
        (TURNS.acc_g, 1.02 * TURNS.gyr_dps),
        (1.02 * TURNS.acc_g + 0.03, TURNS.gyr_dps),
        (TURNS.acc_g + np.array([0.0, 0.0, 0.09]), TURNS.gyr_dps),
    ],
    ids=["gyroscope", "accelerometer", "its offset alone"],
)
def test_what_parts_are_off_by_is_left_to_the_fusion(acc: Array, gyr: Array) -> None:
    assert check_physics(recording_of(acc, gyr, **STATED)).flags == ()


def test_where_nothing_rests_nothing_follows_from_the_length_of_the_acceleration() -> None:
    """A pendulum: 2 g at the lowest point, 0.5 g at the ends, nowhere still."""
    seconds = np.arange(12_000) / RATE_HZ
    angle = np.radians(60.0) * np.sin(2.0 * np.pi * 0.9 * seconds)
    rate = np.gradient(angle, 1.0 / RATE_HZ)
    zero = np.zeros_like(angle)
    acc = np.column_stack([zero, np.sin(angle), np.cos(angle) + rate**2 * 0.3 / 9.80665])

    checked = check_physics(recording_of(acc, np.degrees(np.column_stack([rate, zero, zero])), **STATED))

    assert len(find_rests(checked.segments)) == 0
    assert checked.flags == ()


@pytest.mark.parametrize("rate_dps", [300.0, 1500.0])
def test_a_fast_spin_about_one_axis_is_not_taken_for_columns_mixed_up(rate_dps: float) -> None:
    """A scale 1 % off, as parts are: after eight seconds the angle is off by 24 to 120 deg."""
    seconds = np.arange(12_000) / RATE_HZ
    rate = rate_dps * np.clip(3.0 * np.sin(2.0 * np.pi * seconds / 16.0), 0.0, 1.0)
    angle = np.radians(np.cumsum(rate) / RATE_HZ)
    zero = np.zeros_like(angle)
    acc = np.column_stack([zero, np.sin(angle), np.cos(angle) - np.radians(rate) ** 2 * 0.02 / 9.80665])
    gyr = 1.01 * np.column_stack([rate, zero, zero])

    checked = check_physics(recording_of(acc, gyr, **STATED))

    assert checked.segments[0].gyr_dps == pytest.approx(gyr, rel=1e-6)


def test_an_acceleration_that_is_lively_and_never_at_rest_is_doubted() -> None:
    chance = np.random.default_rng(1)
    acc, gyr = 0.8 * chance.standard_normal((2, 24_000, 3)) * [[[1.0]], [[100.0]]]
    smooth = np.ones(25) / 5.0
    acc, gyr = (np.stack([np.convolve(a, smooth, "same") for a in of.T], axis=1) for of in (acc, gyr))

    waxing = 1.0 + 0.8 * np.sin(np.arange(24_000) / 500.0)[:, None]

    checked = check_physics(recording_of(waxing * acc, gyr, is_known=True, **STATED))

    assert "W-SCALE-DOUBT" in [flag.code for flag in checked.flags]


# Acceleration and angular rate under each other's names: `tests/badfiles` (row 87) has their refusal.


@pytest.mark.real_recordings
def test_real_recordings_do_not_look_exchanged_until_they_are() -> None:
    paths = sorted((SHARED_DATA / "broad").glob("*.npz"))
    if not paths:
        pytest.skip("real recordings absent: broad")

    for path in paths:
        with np.load(path) as file:
            held = dict(file)
        assert not are_exchanged(recording_of(held["acc_g"], held["gyr_dps"]).segments)
        assert are_exchanged(recording_of(held["gyr_dps"], held["acc_g"]).segments)


# Recordings that are right stay as they are.


def simulate(device: Device, seed: int) -> Recording:
    made = play_shift(simulate_shift(device, 0.5, seed))
    return recording_of(made.acc_g, made.gyr_dps, made.rate_hz, **STATED)


def assert_left_alone(recordings: Sequence[Recording]) -> None:
    for recording in recordings:
        before = [(segment.acc_g.copy(), segment.gyr_dps.copy()) for segment in recording.segments]
        checked = check_physics(recording)
        assert (checked.flags, checked.gyr_range_dps, checked.acc_range_g) == ((), None, None)
        assert np.array_equal(checked.segments[0].acc_g, before[0][0])
        assert np.array_equal(checked.segments[0].gyr_dps, before[0][1])


@pytest.mark.slow
@pytest.mark.parametrize("device", ["gt9x", "lsm9ds1"])
def test_simulated_half_hours_are_left_alone(device: Device) -> None:
    assert_left_alone([simulate(device, seed) for seed in range(1, 11)])


@pytest.mark.real_recordings
@pytest.mark.slow
def test_the_trials_of_broad_are_left_alone(shared_data: Callable[[str], Path]) -> None:
    trials = load_trials(shared_data("broad"))

    for sampled in (trials, [resample_to_100_hz(trial) for trial in trials]):
        assert_left_alone([recording_of(one.acc_g, one.gyr_dps, one.rate_hz, **STATED) for one in sampled])


UNSTATED = {"acc_unit": "", "gyr_unit": ""}


@pytest.mark.parametrize("units", [STATED, UNSTATED, STATED | {"gyr_unit": ""}])
def test_without_rest_an_acceleration_that_often_vanishes_lacks_gravity(units: dict[str, Any]) -> None:
    """Gravity was removed: 0.15 g back and forth along one axis, never at rest."""
    time_s = np.arange(6000) / RATE_HZ
    acc = np.stack([0.15 * np.sin(7.0 * time_s), 0.001 * np.cos(5.0 * time_s), 0.0 * time_s], axis=1)
    gyr = np.outer(90.0 * np.sin(3.0 * time_s), [1.0, 0.5, 0.2])

    with pytest.raises(NoGravity):
        check_physics(recording_of(acc, gyr, **units))


def test_without_rest_a_steady_acceleration_of_no_known_length_is_of_an_unknown_unit() -> None:
    time_s = np.arange(6000) / RATE_HZ
    gyr = np.outer(90.0 * np.sin(3.0 * time_s), [1.0, 0.5, 0.2])
    acc = 0.03 * np.stack([np.sin(3.0 * time_s), np.cos(3.0 * time_s), 0.0 * time_s], axis=1)

    with pytest.raises(UnknownUnit):
        check_physics(recording_of(acc, gyr, acc_unit="", gyr_unit="dps"))
