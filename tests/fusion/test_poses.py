"""Which stillness is the pose: the first that was held, those that a person names, and what stands for it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.conventions import parse_arm_axis
from fusion.elevation import estimate_elevation
from fusion.pose.calibrate import CalibratedSamples, calibrate
from fusion.pose.poses import ProposedPose, estimate_repeated_sigma, propose_poses
from fusion.recording import Recording, Segment
from tests.factories import record

RATE_HZ = 50.0
Direction = NDArray[np.float64]


def tilted(degrees: float) -> Direction:
    return np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])


UP, ASIDE = tilted(0.0), tilted(60.0)


class Course:
    """What the sensor reads, stretch after stretch."""

    def __init__(self) -> None:
        self._random = np.random.default_rng(0)
        self._acc: list[NDArray[np.float64]] = []
        self._gyr: list[NDArray[np.float64]] = []

    def hold(self, seconds: float, direction: Direction = UP) -> "Course":
        return self._add(seconds, direction, 0.002, 0.1)

    def move(self, seconds: float) -> "Course":
        return self._add(seconds, UP, 0.6, 60.0)

    def walk(self, seconds: float, direction: Direction = UP) -> "Course":
        """Steps: the acceleration swings about a direction, along it, twice a second."""
        rows = round(seconds * RATE_HZ)
        steps = 0.4 * np.sin(2.0 * np.pi * 2.0 * np.arange(rows) / RATE_HZ)
        self._add(seconds, direction, 0.01, 5.0)
        self._acc[-1] += steps[:, None] * direction
        return self

    def _add(self, seconds: float, direction: Direction, acc_g: float, gyr_dps: float) -> "Course":
        rows = round(seconds * RATE_HZ)
        self._acc.append(direction + self._random.normal(0.0, acc_g, (rows, 3)))
        self._gyr.append(self._random.normal(0.0, gyr_dps, (rows, 3)))
        return self

    def record(self) -> Recording:
        return record(np.concatenate(self._acc), np.concatenate(self._gyr), RATE_HZ)

    def calibrate(self, *windows_s: tuple[float, float], slip_s: float | None = None) -> CalibratedSamples:
        slips_s = () if slip_s is None else (slip_s,)
        return calibrate(self.record(), "n-pose", windows_s, slip_times_s=slips_s)


def codes(samples: CalibratedSamples) -> list[str]:
    return [flag.code for flag in samples.flags]


def start_s(samples: CalibratedSamples) -> float:
    return samples.calibration.windows[0].start_s


# The first still stretch is the pose.


def test_the_first_still_stretch_is_the_pose_however_often_another_posture_is_held() -> None:
    course = Course().move(20.0).hold(8.0)
    for _ in range(10):
        course.move(20.0).hold(30.0, ASIDE)

    samples = course.calibrate()

    assert start_s(samples) == pytest.approx(20.0, abs=0.5)
    assert (samples.calibration.found, samples.calibration.sigma_deg) == ("held", 5.0)
    assert codes(samples) == []


def test_walking_20_deg_from_the_pose_changes_nothing() -> None:
    samples = Course().hold(10.0).walk(300.0, tilted(20.0)).hold(10.0, tilted(20.0)).calibrate()

    assert start_s(samples) == pytest.approx(0.0, abs=0.5)
    assert samples.calibration.walking_deg == pytest.approx(20.0, abs=1.0)
    assert codes(samples) == []


def test_a_stillness_of_more_than_a_minute_is_a_table_and_the_sensor_is_worn_from_its_end_on() -> None:
    samples = Course().hold(300.0, ASIDE).move(30.0).hold(10.0).move(300.0).hold(10.0, ASIDE).calibrate()

    assert start_s(samples) == pytest.approx(330.0, abs=0.5)
    assert samples.calibration.found == "held"


@pytest.mark.parametrize(("gain", "started_s"), [(1.09, 10.0), (1.25, 30.0)])
def test_the_pose_reads_1_g_within_a_tenth(gain: float, started_s: float) -> None:
    samples = Course().move(10.0).hold(10.0, gain * UP).move(10.0).hold(10.0).move(10.0).calibrate()

    assert start_s(samples) == pytest.approx(started_s, abs=0.5)


def test_of_a_long_pose_the_first_ten_seconds_are_measured() -> None:
    assert Course().hold(50.0).move(10.0).calibrate().calibration.windows[0].duration_s == pytest.approx(10.0)


# Walking can only veto.


def test_walking_more_than_30_deg_away_vetoes_and_the_next_early_stretch_is_taken() -> None:
    samples = Course().hold(10.0, ASIDE).move(20.0).hold(10.0).walk(120.0).calibrate()

    assert start_s(samples) == pytest.approx(30.0, abs=0.5)
    assert codes(samples) == []


def test_less_than_a_minute_of_walking_vetoes_nothing() -> None:
    samples = Course().hold(10.0, ASIDE).move(20.0).hold(10.0).walk(50.0).calibrate()

    assert start_s(samples) == pytest.approx(0.0, abs=0.5)


def test_shaking_that_keeps_to_no_direction_is_no_walking_and_vetoes_nothing() -> None:
    course = Course().hold(10.0, ASIDE).move(20.0).hold(10.0)
    for degrees in (0.0, 15.0, -15.0) * 3:
        course.walk(20.0, tilted(degrees))

    assert start_s(course.calibrate()) == pytest.approx(0.0, abs=0.5)


def test_where_walking_vetoes_all_the_nearest_is_taken_and_the_calibration_is_in_doubt() -> None:
    # 80 and 60 deg from walking; 60 / 1.96 = 30.6 deg.
    samples = Course().hold(10.0, tilted(80.0)).move(20.0).hold(10.0, ASIDE).walk(120.0).calibrate()

    assert start_s(samples) == pytest.approx(30.0, abs=0.5)
    assert samples.calibration.sigma_deg == pytest.approx(30.6, abs=0.5)
    assert codes(samples) == ["W-POSE-DOUBT"]


# Asking beats guessing.


def test_where_the_first_comes_later_and_others_differ_the_person_is_asked() -> None:
    # Three postures after 90 s: the first is used, and 60 / 1.96 = 30.6 deg hold the others.
    samples = Course().move(90.0).hold(10.0).move(60.0).hold(10.0, ASIDE).move(60.0).hold(10.0).calibrate()

    assert start_s(samples) == pytest.approx(90.0, abs=0.5)
    assert [round(still.start_s) for still in samples.calibration.proposals] == [90, 160, 230]
    assert samples.calibration.sigma_deg == pytest.approx(30.6, abs=0.2)
    assert codes(samples) == ["W-WHICH-POSE"]


@pytest.mark.parametrize(("apart_deg", "asked"), [(8.0, []), (12.0, ["W-WHICH-POSE"])])
def test_early_stretches_within_10_deg_of_the_first_ask_nothing(apart_deg: float, asked: list[str]) -> None:
    samples = Course().move(90.0).hold(10.0).move(60.0).hold(10.0, tilted(apart_deg)).calibrate()

    assert codes(samples) == asked


def test_what_was_held_within_the_first_minute_asks_nothing() -> None:
    assert codes(Course().move(50.0).hold(10.0).move(60.0).hold(10.0, ASIDE).calibrate()) == []


def test_what_is_held_after_ten_minutes_is_no_candidate() -> None:
    assert codes(Course().move(90.0).hold(10.0).move(620.0).hold(10.0, ASIDE).calibrate()) == []


# No pose.


def test_without_an_early_stillness_walking_stands_for_the_pose() -> None:
    samples = Course().move(620.0).hold(10.0, ASIDE).walk(120.0, tilted(15.0)).calibrate()

    assert samples.calibration.found == "walking"
    assert samples.calibration.windows == ()
    assert samples.calibration.arm_axis == pytest.approx(tilted(15.0), abs=0.01)
    assert (samples.calibration.sigma_deg, codes(samples)) == (10.0, ["W-NO-STILL"])


def test_without_walking_either_the_stillest_moment_stands_for_it_with_35_deg() -> None:
    samples = Course().move(620.0).hold(10.0, ASIDE).calibrate()

    assert samples.calibration.found == "moment"
    assert (samples.calibration.sigma_deg, codes(samples)) == (35.0, ["W-NO-STILL"])


# A window that a person gives is final.


def test_nothing_outvotes_a_window_that_a_person_gave() -> None:
    samples = Course().hold(10.0).walk(120.0).hold(10.0, ASIDE).walk(120.0).calibrate((132.0, 139.0))

    assert samples.calibration.arm_axis == pytest.approx(ASIDE, abs=0.01)
    assert samples.calibration.sigma_deg == 5.0
    assert samples.calibration.walking_deg == pytest.approx(60.0, abs=1.0)
    assert codes(samples) == []


# The pose repeated.


def test_poses_that_agree_are_averaged_and_narrow_the_range() -> None:
    # 4 deg from the mean each: sqrt(4^2 + (2 x 3^2 + 2 x 2^2) / 4 / 2) = 4.39 deg.
    course = Course().hold(10.0).move(100.0).hold(10.0, tilted(4.0))

    calibration = course.calibrate((1.0, 9.0), (111.0, 119.0)).calibration

    assert calibration.arm_axis == pytest.approx(tilted(2.0), abs=0.002)
    assert calibration.repeat_deg == pytest.approx(4.0, abs=0.1)
    assert calibration.sigma_deg == pytest.approx(4.39, abs=0.01)


@pytest.mark.parametrize("again_s", [(1.0, 9.0), (3.0, 9.5), (9.0, 9.9)])
def test_windows_that_meet_are_one_pose(again_s: tuple[float, float]) -> None:
    calibration = Course().hold(10.0).move(100.0).calibrate((1.0, 9.0), again_s).calibration

    (window,) = calibration.windows
    assert (window.start_s, window.end_s) == pytest.approx((1.0, max(9.0, again_s[1])))
    assert (calibration.sigma_deg, calibration.repeat_deg) == (5.0, None)


def test_the_more_poses_agree_the_narrower_the_range_down_to_what_a_person_always_does() -> None:
    narrower = [estimate_repeated_sigma([0.0] * count) for count in (2, 5, 100)]

    assert narrower == sorted(narrower, reverse=True)
    assert 4.0 < narrower[-1] < 4.01


def test_between_two_poses_that_disagree_nothing_is_valid_and_each_side_has_its_own() -> None:
    course = Course().hold(10.0).move(100.0).hold(10.0, tilted(20.0)).move(20.0).hold(10.0, tilted(20.0))

    samples = course.calibrate((1.0, 9.0), (111.0, 119.0), (141.0, 149.0))

    (flag,) = samples.flags
    assert (flag.code, flag.first_s, flag.last_s) == ("W-POSES-DIFFER", 9.0, 111.0)
    assert flag.facts == {"apart_deg": 20}
    segment = estimate_elevation(samples).segments[0]
    assert not segment.valid[round(9.1 * RATE_HZ) : round(110.9 * RATE_HZ)].any()
    assert samples.axis_parts[-1].arm_axis == pytest.approx(tilted(20.0), abs=0.002)


def test_a_slip_that_the_person_names_parts_two_poses_and_costs_a_minute_on_both_sides() -> None:
    course = Course().hold(10.0).move(300.0).hold(10.0, tilted(20.0))

    samples = course.calibrate((1.0, 9.0), (311.0, 319.0), slip_s=200.0)

    left_out = [(part.start_s, part.end_s) for part in samples.axis_parts if part.arm_axis is None]
    assert left_out == [(140.0, 260.0)]
    assert codes(samples) == ["W-REMOUNT"]


def test_after_a_slip_at_the_very_start_the_pose_is_sought_from_its_end_on() -> None:
    samples = Course().move(100.0).hold(10.0).move(100.0).calibrate(slip_s=20.0)

    assert (samples.calibration.found, round(start_s(samples))) == ("held", 100)


def test_a_slip_in_the_last_minute_leaves_out_what_there_is_of_it() -> None:
    samples = Course().hold(10.0).move(300.0).calibrate(slip_s=300.0)

    (flag,) = samples.flags
    assert (flag.code, flag.first_s, flag.last_s) == ("W-REMOUNT", 240.0, 310.0)


def test_a_slip_after_the_last_sample_has_no_effect() -> None:
    assert Course().hold(10.0).move(300.0).calibrate(slip_s=5000.0).axis_parts == ()


def test_a_sensor_put_back_is_read_by_the_pose_held_then() -> None:
    before, after = (
        Course().hold(10.0, direction).move(200.0).record().segments[0] for direction in (UP, ASIDE)
    )
    later = Segment(600_000_000, after.rate_hz, after.acc_g, after.gyr_dps)
    whole = replace(Course().hold(1.0).record(), duration_us=810_000_000, segments=(before, later))

    samples = calibrate(whole, "n-pose", ((1.0, 9.0), (601.0, 609.0)))

    (part,) = samples.axis_parts
    assert part.arm_axis == pytest.approx(ASIDE, abs=0.01)


def test_still_stretches_like_the_pose_in_the_last_ten_minutes_are_proposed_as_repeats() -> None:
    course = Course().hold(10.0).move(700.0).hold(10.0, ASIDE).move(600.0)
    recording = course.hold(10.0, tilted(5.0)).move(20.0).hold(10.0, ASIDE).record()

    proposed = propose_poses(recording)

    assert [describe(one) for one in proposed] == [("pose", 0), ("repeat", 1320)]


def describe(proposed: ProposedPose) -> tuple[str, int]:
    return proposed.kind, round(proposed.still.start_s)


# No pose at all: the axis that was strapped along the arm.


@pytest.mark.parametrize(("text", "axis"), [("y", "+y"), ("+y", "+y"), (" y", "+y"), ("-X", "-x")])
def test_an_axis_is_read_with_or_without_its_plus(text: str, axis: str) -> None:
    assert parse_arm_axis(text) == axis


@pytest.mark.parametrize("text", ["", "w", "yy", "+", "x y"])
def test_what_is_no_axis_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="-z"):
        parse_arm_axis(text)


def test_an_axis_that_was_given_is_the_arms_within_8_deg() -> None:
    recording = Course().move(100.0).hold(10.0, ASIDE).record()

    samples = calibrate(recording, "n-pose", arm_axis="-y")

    assert samples.calibration.arm_axis.tolist() == [0.0, -1.0, 0.0]
    assert (samples.calibration.sigma_deg, samples.calibration.found) == (8.0, "axis")
    assert codes(samples) == ["W-AXIS"]
