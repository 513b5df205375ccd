"""Unit, frame and gyroscope scale are found from the samples, changed on strong evidence only, and said."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.checks.axes import TURNS
from fusion.checks.physics import (
    ARDUINO_DPS,
    ARDUINO_FACTOR,
    check_physics,
    format_axes,
    refuse_impossible_rates,
)
from fusion.errors import MixedColumns, WrongScale
from fusion.recording import Recording, Segment
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
    acc: NDArray[np.float64], gyr: NDArray[np.float64], device: str = "other", **understood: str
) -> Recording:
    segment = Segment(0, RATE_HZ, acc.astype(np.float32), gyr.astype(np.float32))
    return Recording(device, "", None, None, segment.duration_us, (segment,), understood=understood)


def told(recording: Recording) -> list[object]:
    return [flag.facts["what"] for flag in recording.flags]


STATED = {"acceleration_unit": "g", "angular_rate_unit": "dps"}
UNSTATED = {"acceleration_unit": "", "angular_rate_unit": ""}


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
    recording = recording_of(9.80665 * acc, gyr[:, [1, 0, 2]], **STATED)

    checked = check_physics(recording)

    assert told(checked) == ["acceleration", "axes"]
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


def test_a_table_of_a_gt9x_is_judged_like_any_other() -> None:
    acc, gyr = swinging_arm()

    checked = check_physics(recording_of(acc * MIRROR, gyr * MIRROR, device="gt9x"))

    assert told(checked) == ["left-handed"]


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

    checked = check_physics(recording_of(acc * factor, gyr, acceleration_unit=unit, angular_rate_unit="dps"))

    assert np.linalg.norm(checked.segments[0].acc_g, axis=1) == pytest.approx(1.0, abs=1e-4)
    assert told(checked) == ["acceleration"]


@pytest.mark.parametrize("factor", [0.5, 2.0, 0.0])
def test_a_rest_that_no_unit_explains_is_refused(factor: float) -> None:
    acc, gyr = swinging_arm()

    with pytest.raises(WrongScale) as refusal:
        check_physics(recording_of(acc * factor, gyr, **STATED))

    assert refusal.value.facts == {"g": factor}


@pytest.mark.parametrize("factor", [1e3, 1e-3], ids=["mdps under dps", "dps under mdps"])
def test_thousandths_of_a_degree_are_told_from_degrees(factor: float) -> None:
    acc, gyr = swinging_arm()

    checked = check_physics(recording_of(acc, factor * gyr, **STATED))

    assert checked.segments[0].gyr_dps == pytest.approx(gyr, abs=1e-3)
    assert told(checked) == ["angular rate"]


@pytest.mark.parametrize("unit", ["", "dps"], ids=["not stated", "stated wrongly"])
def test_radians_are_told_from_degrees(unit: str) -> None:
    acc, gyr = swinging_arm()

    checked = check_physics(recording_of(acc, np.radians(gyr), acceleration_unit="g", angular_rate_unit=unit))

    assert checked.segments[0].gyr_dps == pytest.approx(gyr, abs=1e-3)
    assert told(checked) == ["angular rate"]


def test_an_unstated_rate_without_motion_is_taken_for_degrees_and_said() -> None:
    acc = np.tile([0.0, 0.0, 1.0], (3000, 1))

    checked = check_physics(
        recording_of(acc, np.zeros((3000, 3)), acceleration_unit="g", angular_rate_unit="")
    )

    (flag,) = checked.flags
    assert flag.facts["evidence"] == "assumed"


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
            acceleration_unit="registers",
            angular_rate_unit="registers",
        )
    )

    assert (checked.acc_range_g, checked.gyr_range_dps) == ranges
    assert checked.segments[0].gyr_dps == pytest.approx(gyr, abs=0.04)


def test_the_arduino_library_is_corrected_in_its_left_handed_frame() -> None:
    acc, gyr = swinging_arm()
    counts = np.round(gyr / 0.07)

    checked = check_physics(recording_of(acc * MIRROR, counts * ARDUINO_DPS * MIRROR, **STATED))

    assert np.abs(checked.segments[0].gyr_dps) == pytest.approx(np.abs(counts * 0.07), abs=1e-3)
    assert told(checked) == ["left-handed", "angular rate"]
    assert checked.device == "lsm9ds1"


def test_a_right_handed_part_with_the_same_grid_keeps_its_scale() -> None:
    acc, gyr = swinging_arm()
    counts = np.round(gyr / ARDUINO_DPS)

    checked = check_physics(recording_of(acc, counts * ARDUINO_DPS, **STATED))

    assert checked.flags == ()


def test_negated_columns_of_a_right_part_with_the_same_grid_keep_their_scale() -> None:
    motion = rest_and_turn(80)
    counts = np.round(motion.gyr_dps / ARDUINO_DPS)

    checked = check_physics(recording_of(motion.acc_g, -counts * ARDUINO_DPS, **STATED))

    assert told(checked) == ["left-handed"]


def test_the_arduino_factor_is_that_of_the_data_sheet() -> None:
    assert pytest.approx(1.14688) == ARDUINO_FACTOR


def judged(change: NDArray[np.float64]) -> Recording:
    """A right recording whose rates were read through a matrix, as it comes out."""
    motion = rest_and_turn(80)
    return check_physics(recording_of(motion.acc_g, motion.gyr_dps @ change.T, **STATED))


@pytest.mark.parametrize("turn", TURNS[1:48:8], ids=format_axes)
def test_order_and_signs_of_the_axes_are_undone(turn: NDArray[np.float64]) -> None:
    motion = rest_and_turn(80)

    checked = judged(turn)

    (segment,) = checked.segments
    mirror = MIRROR if told(checked) == ["left-handed"] else np.ones(3)
    slope = np.gradient(segment.acc_g, 1 / RATE_HZ, axis=0)
    expected = np.cross(segment.acc_g, np.radians(segment.gyr_dps))
    assert np.corrcoef(slope.ravel(), expected.ravel())[0, 1] > 0.99
    assert segment.acc_g == pytest.approx(motion.acc_g * mirror, abs=1e-6)


@pytest.mark.parametrize("factor", [0.5, 0.87, 1.3, 2.0])
def test_a_scale_that_no_part_has_is_undone(factor: float) -> None:
    checked = judged(factor * np.eye(3))

    assert checked.flags[0].facts["factor"] == pytest.approx(1.0 / factor, rel=0.01)


@pytest.mark.parametrize(("time", "codes"), [("number", ["W-UNITS"]), ("row number", ["W-UNITS", "W-RATE"])])
def test_a_scale_may_be_a_wrong_rate_where_somebody_told_it(time: str, codes: list[str]) -> None:
    """100 Hz were told for 50: all durations are halved, and the gyroscope seems to read half."""
    motion = rest_and_turn(80)

    checked = check_physics(recording_of(motion.acc_g, 0.5 * motion.gyr_dps, **STATED, time=time))

    assert [flag.code for flag in checked.flags] == codes
    assert [flag.facts["other_hz"] for flag in checked.flags[1:]] == pytest.approx(
        [50.0] * (len(codes) - 1), abs=0.5
    )


def test_a_scale_within_that_of_parts_is_left_to_the_fusion() -> None:
    assert judged(1.02 * np.eye(3)).flags == ()


def test_the_scale_of_one_axis_is_undone() -> None:
    (flag,) = judged(np.diag([1.0, 1.0, 2.0])).flags

    factors = [flag.facts[f"factor_{axis}"] for axis in "xyz"]
    assert factors == pytest.approx([1.0, 1.0, 0.5], abs=0.01)


def test_a_gyroscope_of_another_moment_is_refused() -> None:
    motion = rest_and_turn(80)

    with pytest.raises(MixedColumns):
        check_physics(recording_of(motion.acc_g, np.roll(motion.gyr_dps, 300, axis=0), **STATED))


@pytest.mark.parametrize("factor", [0.93, 1.05])
def test_an_accelerometer_that_is_off_on_all_axes_alike_is_undone(factor: float) -> None:
    motion = rest_and_turn(80)

    checked = check_physics(recording_of(factor * motion.acc_g, motion.gyr_dps, **STATED))

    assert told(checked) == ["accelerometer scale"]
    assert checked.segments[0].acc_g == pytest.approx(motion.acc_g, abs=2e-3)


def test_an_accelerometer_within_what_parts_are_is_left_to_the_fusion() -> None:
    motion = rest_and_turn(80)

    checked = check_physics(recording_of(1.02 * motion.acc_g + 0.03, motion.gyr_dps, **STATED))

    assert checked.flags == ()


def test_an_offset_of_the_accelerometer_is_no_scale() -> None:
    motion = rest_and_turn(80)

    checked = check_physics(recording_of(motion.acc_g + np.array([0.0, 0.0, 0.09]), motion.gyr_dps, **STATED))

    assert checked.flags == ()


def test_the_scale_of_one_axis_of_the_accelerometer_is_undone() -> None:
    motion = rest_and_turn(80)

    (flag,) = check_physics(recording_of(motion.acc_g * [1.0, 1.0, 1.2], motion.gyr_dps, **STATED)).flags

    factors = [flag.facts[f"factor_{axis}"] for axis in "xyz"]
    assert factors == pytest.approx([1.0, 1.0, 1.0 / 1.2], abs=0.005)


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
