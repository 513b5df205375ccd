"""Unit and hand are found from the samples and changed on strong evidence only; a scale is doubted."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.checks.physics import check_physics, refuse_impossible_rates
from fusion.checks.rests import find_rests
from fusion.errors import MixedColumns, NoGravity, UnknownUnit, WrongScale
from fusion.recording import Recording, Segment, Stated
from tests.fusion.made_motion import rest_and_turn

RATE_HZ = 100.0
MIRROR = np.array([-1.0, 1.0, 1.0])


def swinging_arm(duration_s: int = 240) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """An arm that turns by 40 to 80 deg in a second, rests, and turns back, about x and y in turn.

    No two swings are alike: of one and the same swing a rate several times as fast, once round more, would
    tell as much. Gravity in the sensor frame is the zenith turned by minus the angle, so that da/dt = a x w
    holds exactly.
    """
    t = np.arange(int(duration_s * RATE_HZ)) / RATE_HZ
    phase = t % 4
    angle = np.radians(40.0 + 40.0 * (t // 4 * 0.618 % 1.0)) * (
        np.where(phase < 1, 0.5 - 0.5 * np.cos(np.pi * phase), 1.0)
        - np.where((phase > 2) & (phase < 3), 0.5 - 0.5 * np.cos(np.pi * (phase - 2)), 0.0)
        - np.where(phase >= 3, 1.0, 0.0)
    )
    rate = np.degrees(np.gradient(angle, 1 / RATE_HZ))
    about_x = (t // 4) % 2 == 0
    zero = np.zeros_like(t)
    acc_x = np.column_stack([zero, np.sin(angle), np.cos(angle)])
    acc_y = np.column_stack([-np.sin(angle), zero, np.cos(angle)])
    acc = np.where(about_x[:, None], acc_x, acc_y)
    gyr = np.where(about_x[:, None], np.column_stack([rate, zero, zero]), np.column_stack([zero, rate, zero]))
    return acc, gyr


def recording_of(
    acc: NDArray[np.float64], gyr: NDArray[np.float64], device: str = "other", **stated: Any
) -> Recording:
    segment = Segment(0, RATE_HZ, acc.astype(np.float32), gyr.astype(np.float32))
    return Recording(device, "", None, None, segment.duration_us, (segment,), stated=Stated(**stated))


def told(recording: Recording) -> list[object]:
    return [flag.facts["what"] for flag in recording.flags]


STATED = {"acc_unit": "g", "gyr_unit": "dps"}
UNSTATED = {"acc_unit": "", "gyr_unit": ""}
KNOWN: dict[str, Any] = {**STATED, "is_known": True}


def test_a_right_recording_comes_through_untouched() -> None:
    acc, gyr = swinging_arm()
    recording = recording_of(acc, gyr, **STATED)

    checked = check_physics(recording)

    assert np.array_equal(checked.segments[0].acc_g, acc.astype(np.float32))
    assert np.array_equal(checked.segments[0].gyr_dps, gyr.astype(np.float32))
    assert checked.flags == ()


def test_an_axis_that_stuck_for_half_of_the_time_is_not_taken_for_one_of_another_scale() -> None:
    acc, gyr = swinging_arm()
    gyr[10_400:22_400, 0] = 0.5

    checked = check_physics(recording_of(acc, gyr, **STATED))

    assert checked.flags == ()
    assert np.array_equal(checked.segments[0].gyr_dps, gyr.astype(np.float32))


def test_what_is_corrected_is_corrected_in_place() -> None:
    """A shift is too large to be held twice."""
    acc, gyr = swinging_arm()
    recording = recording_of(9.80665 * acc, -gyr, **STATED)

    checked = check_physics(recording)

    assert told(checked) == ["acceleration", "left-handed"]
    assert np.shares_memory(checked.segments[0].acc_g, recording.segments[0].acc_g)
    assert np.shares_memory(checked.segments[0].gyr_dps, recording.segments[0].gyr_dps)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_left_handed_frame_becomes_right_handed(axis: int) -> None:
    acc, gyr = swinging_arm()
    mirror = np.ones(3)
    mirror[axis] = -1.0

    checked = check_physics(recording_of(acc * mirror, gyr * mirror, **STATED))

    (segment,) = checked.segments
    slope = np.gradient(segment.acc_g, 1 / RATE_HZ, axis=0).ravel()
    expected = np.cross(segment.acc_g, np.radians(segment.gyr_dps)).ravel()
    assert np.corrcoef(slope, expected)[0, 1] > 0.99
    assert told(checked) == ["left-handed"]


def test_a_known_header_is_not_overruled_on_the_axes() -> None:
    """What fits otherwise is refused, with what would fit: nothing is turned."""
    acc, gyr = swinging_arm()

    with pytest.raises(MixedColumns) as refusal:
        check_physics(recording_of(acc, -gyr, **KNOWN))

    assert refusal.value.facts["factor"] == pytest.approx(-1.0, abs=0.01)


def test_a_known_header_is_not_overruled_on_the_unit() -> None:
    acc, gyr = swinging_arm()

    with pytest.raises(MixedColumns) as refusal:
        check_physics(recording_of(acc, np.radians(gyr), **KNOWN))

    assert refusal.value.facts["factor"] == pytest.approx(57.3, abs=0.5)


@pytest.mark.parametrize(
    ("factor", "unit"),
    [
        *((9.80665, ""), (1000.0, ""), (2 / 3, "")),
        *((2 / 3, "g"), (9.80665, "g"), (1000.0, "g")),
        *((1e-3, "mg"), (9.80665e-3, "mg"), (1 / 9.80665, "m/s2"), (1000 / 9.80665, "m/s2")),
        *((1000.0, "lsb"), (1 / 0.000732, "raw")),
    ],
)
def test_acceleration_in_another_unit_becomes_g(factor: float, unit: str) -> None:
    acc, gyr = swinging_arm()

    checked = check_physics(recording_of(acc * factor, gyr, acc_unit=unit, gyr_unit="dps"))

    assert np.linalg.norm(checked.segments[0].acc_g, axis=1) == pytest.approx(1.0, abs=1e-4)
    assert told(checked) == ["acceleration"]


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_rest_that_no_unit_explains_is_refused(factor: float) -> None:
    acc, gyr = swinging_arm()

    with pytest.raises(WrongScale) as refusal:
        check_physics(recording_of(acc * factor, gyr, **STATED))

    assert refusal.value.facts == {"g": factor}


def test_an_acceleration_of_nothing_at_rest_has_no_gravity() -> None:
    acc, gyr = swinging_arm()

    with pytest.raises(NoGravity):
        check_physics(recording_of(0.0 * acc, gyr, **STATED))


@pytest.mark.parametrize("factor", [1e3, 1e-3], ids=["mdps under dps", "dps under mdps"])
def test_thousandths_of_a_degree_are_told_from_degrees(factor: float) -> None:
    acc, gyr = swinging_arm()

    checked = check_physics(recording_of(acc, factor * gyr, **STATED))

    assert checked.segments[0].gyr_dps == pytest.approx(gyr, abs=1e-3)
    assert told(checked) == ["angular rate"]


@pytest.mark.parametrize("unit", ["", "dps"], ids=["not stated", "stated wrongly"])
def test_radians_are_told_from_degrees(unit: str) -> None:
    acc, gyr = swinging_arm()

    checked = check_physics(recording_of(acc, np.radians(gyr), acc_unit="g", gyr_unit=unit))

    assert checked.segments[0].gyr_dps == pytest.approx(gyr, abs=1e-3)
    assert told(checked) == ["angular rate"]


@pytest.mark.parametrize("unit", ["", "registers"])
def test_an_unstated_rate_without_motion_is_asked_for(unit: str) -> None:
    acc = np.tile([0.0, 0.0, 1.0], (3000, 1))

    with pytest.raises(UnknownUnit) as refusal:
        check_physics(recording_of(acc, np.zeros((3000, 3)), acc_unit="g", gyr_unit=unit))

    assert refusal.value.facts == {"sensor": "gyroscope"}


@pytest.mark.parametrize(
    ("g_per_count", "dps_per_count", "ranges"),
    [(0.000061, 0.00875, (2.0, 245.0)), (0.000244, 0.07, (8.0, 2000.0)), (0.000732, 0.0175, (16.0, 500.0))],
)
def test_the_ranges_of_a_register_dump_are_found(
    g_per_count: float, dps_per_count: float, ranges: tuple[float, float]
) -> None:
    acc, gyr = swinging_arm()

    checked = check_physics(
        recording_of(
            np.round(acc / g_per_count),
            np.round(gyr / dps_per_count),
            acc_unit="registers",
            gyr_unit="registers",
        )
    )

    assert (checked.acc_range_g, checked.gyr_range_dps) == ranges
    assert checked.segments[0].gyr_dps == pytest.approx(gyr, abs=0.04)


def slow_turns(change: NDArray[np.float64], **stated: Any) -> Recording:
    """Turns by 40 to 120 deg in two seconds each, the rates read through a matrix, as it comes out."""
    motion = rest_and_turn(80, rate_hz=2.0 * RATE_HZ)
    return check_physics(recording_of(motion.acc_g, 0.5 * motion.gyr_dps @ change.T, **STATED, **stated))


@pytest.mark.parametrize("order", [(1, 0, 2), (0, 2, 1), (1, 2, 0)])
def test_columns_in_another_order_are_refused(order: tuple[int, ...]) -> None:
    with pytest.raises(MixedColumns):
        slow_turns(np.eye(3)[list(order)])


def test_a_single_sign_is_refused() -> None:
    with pytest.raises(MixedColumns):
        slow_turns(np.diag(MIRROR))


@pytest.mark.parametrize("factor", [0.5, 0.87, 1.3, 2.0])
def test_a_scale_that_no_part_has_is_doubted_and_left(factor: float) -> None:
    (flag,) = slow_turns(factor * np.eye(3)).flags

    assert (flag.code, flag.facts["sensor"]) == ("W-SCALE-DOUBT", "gyroscope")
    assert flag.facts["factor"] == pytest.approx(1.0 / factor, rel=0.01)


def test_a_scale_is_doubted_if_all_movement_is_fast() -> None:
    motion = rest_and_turn(80)

    (flag,) = check_physics(recording_of(motion.acc_g, 2.0 * motion.gyr_dps, **STATED)).flags

    assert (flag.code, flag.facts["sensor"]) == ("W-SCALE-DOUBT", "gyroscope")
    assert flag.facts["factor"] == pytest.approx(0.5, abs=0.02)


def test_a_scale_where_somebody_told_the_rate_may_be_a_wrong_rate() -> None:
    """100 Hz were told for 50: all durations are halved, and the gyroscope seems to read half."""
    (flag,) = slow_turns(0.5 * np.eye(3), is_counted=True).flags

    assert flag.code == "W-RATE"
    assert flag.facts["other_hz"] == pytest.approx(50.0, abs=0.5)


def test_the_error_of_a_devices_library_is_undone_where_the_frame_is_left_handed() -> None:
    """Arduino_LSM9DS1 prints 61.04 mdps for a count of 70 mdps, in the left-handed frame of the chip."""
    motion = rest_and_turn(80)
    rates = motion.gyr_dps * MIRROR / 1.14688
    recording = recording_of(motion.acc_g * MIRROR, rates, **STATED, left_gyr_factor=1.14688)

    checked = check_physics(recording)

    assert np.abs(checked.segments[0].gyr_dps) == pytest.approx(np.abs(motion.gyr_dps), rel=1e-4, abs=1e-3)
    assert (told(checked), checked.device) == (["left-handed", "angular rate"], "lsm9ds1")


def test_a_scale_within_that_of_parts_is_left_to_the_fusion() -> None:
    assert slow_turns(1.02 * np.eye(3)).flags == ()


def test_a_gyroscope_of_another_moment_is_refused() -> None:
    motion = rest_and_turn(80)

    with pytest.raises(MixedColumns):
        check_physics(recording_of(motion.acc_g, np.roll(motion.gyr_dps, 300, axis=0), **STATED))


@pytest.mark.parametrize("factor", [0.93, 1.05])
def test_an_accelerometer_that_is_off_on_all_axes_alike_is_doubted_and_left(factor: float) -> None:
    motion = rest_and_turn(80)

    (flag,) = check_physics(recording_of(factor * motion.acc_g, motion.gyr_dps, **STATED)).flags

    assert (flag.code, flag.facts) == (
        "W-SCALE-DOUBT",
        {"sensor": "accelerometer", "g": pytest.approx(factor, abs=2e-3)},
    )


def test_an_accelerometer_within_what_parts_are_is_left_to_the_fusion() -> None:
    motion = rest_and_turn(80)

    checked = check_physics(recording_of(1.02 * motion.acc_g + 0.03, motion.gyr_dps, **STATED))

    assert checked.flags == ()


def test_an_offset_of_the_accelerometer_is_no_scale() -> None:
    motion = rest_and_turn(80)

    checked = check_physics(recording_of(motion.acc_g + np.array([0.0, 0.0, 0.09]), motion.gyr_dps, **STATED))

    assert checked.flags == ()


def test_an_accelerometer_that_reads_up_to_a_quarter_off_at_rest_is_doubted_and_left() -> None:
    acc = np.tile([0.0, 0.0, 1.2], (3000, 1))

    (flag,) = check_physics(recording_of(acc, np.zeros((3000, 3)), **STATED)).flags

    assert (flag.code, flag.facts) == ("W-SCALE-DOUBT", {"sensor": "accelerometer", "g": 1.2})


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


@pytest.mark.parametrize("rate_dps", [300.0, 700.0, 1500.0])
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


def test_lengths_at_rest_that_no_scale_explains_are_refused() -> None:
    motion = rest_and_turn(80)
    uneven = 1.0 + 0.12 * np.sin(6.0 * motion.acc_g[:, :1])

    with pytest.raises(WrongScale) as refusal:
        check_physics(recording_of(motion.acc_g * uneven, motion.gyr_dps, **STATED))

    assert set(refusal.value.facts) == {"low_g", "high_g"}


def test_a_rate_that_no_part_can_read_is_refused_with_its_place() -> None:
    acc, gyr = np.tile([0.0, 0.0, 1.0], (3000, 1)), np.zeros((3000, 3))
    gyr[1000:1010] = 5000.0

    with pytest.raises(WrongScale) as refusal:
        refuse_impossible_rates(recording_of(acc, gyr, **STATED))

    assert refusal.value.facts == {"dps": 5000, "clock": "+10.00 s"}


def test_an_acceleration_that_is_lively_and_never_at_rest_is_doubted() -> None:
    chance = np.random.default_rng(1)
    acc, gyr = 0.8 * chance.standard_normal((2, 24_000, 3)) * [[[1.0]], [[100.0]]]
    smooth = np.ones(25) / 5.0
    acc, gyr = (np.stack([np.convolve(a, smooth, "same") for a in of.T], axis=1) for of in (acc, gyr))

    waxing = 1.0 + 0.8 * np.sin(np.arange(24_000) / 500.0)[:, None]

    checked = check_physics(recording_of(waxing * acc, gyr, is_known=True, **STATED))

    assert "W-SCALE-DOUBT" in [flag.code for flag in checked.flags]
