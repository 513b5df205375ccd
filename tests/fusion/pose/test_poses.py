"""What a person states about the pose, and what is asked of the person."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from acromion.fusion.conventions import PoseHeld, parse_arm_axis
from acromion.fusion.pipeline import apply_file_settings
from acromion.fusion.pose.calibrate import CalibratedSamples, calibrate, propose_poses
from acromion.fusion.pose.rules import estimate_repeated_sigma, select_distinct_axes
from acromion.fusion.quality.verdict import flag_pose
from acromion.fusion.recording import QualityFlag, Recording, Segment
from acromion.fusion.settings import AnalysisSettings
from tests.factories import record

RATE_HZ = 50.0
Direction = NDArray[np.float64]


def tilted(degrees: float) -> Direction:
    return np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])


UP, ASIDE = tilted(0.0), tilted(60.0)


class Course:
    """What the sensor reads, stretch after stretch; a held arm sways by 1 deg/s, a table by nothing."""

    def __init__(self) -> None:
        self._random = np.random.default_rng(0)
        self._acc: list[NDArray[np.float64]] = []
        self._gyr: list[NDArray[np.float64]] = []

    def hold(self, seconds: float, direction: Direction = UP, sway_dps: float = 1.0) -> "Course":
        self._add(seconds, direction, 0.002, 0.1)
        rows = np.arange(len(self._gyr[-1]))
        self._gyr[-1][:, 0] += sway_dps * np.sin(2.0 * np.pi * 0.4 * rows / RATE_HZ)
        return self

    def lie(self, seconds: float, direction: Direction = ASIDE) -> "Course":
        return self.hold(seconds, direction, sway_dps=0.0)

    def move(self, seconds: float, direction: Direction = UP) -> "Course":
        return self._add(seconds, direction, 0.6, 60.0)

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

    def calibrate(
        self,
        *windows_s: tuple[float, float],
        slip_s: tuple[float, ...] = (),
        no_slip_s: tuple[float, ...] = (),
        held: PoseHeld | None = None,
    ) -> CalibratedSamples:
        settings = AnalysisSettings(
            calibration_windows_s=windows_s, slip_times_s=slip_s, no_slip_times_s=no_slip_s, pose_held=held
        )
        return calibrate(self.record(), settings)


def flags(samples: CalibratedSamples, **said: Any) -> tuple[QualityFlag, ...]:
    """The caveats; ``said``: what the person said, as far as they depend on it."""
    return flag_pose(samples, AnalysisSettings(**said))


def codes(samples: CalibratedSamples, **said: Any) -> list[str]:
    return [flag.code for flag in flags(samples, **said)]


def start_s(samples: CalibratedSamples) -> float:
    return samples.calibration.windows[0].start_s


def test_the_first_stillness_is_assumed_however_often_another_posture_is_held() -> None:
    course = Course().move(20.0).hold(8.0)
    for _ in range(10):
        course.move(20.0).hold(30.0, ASIDE)

    samples = course.calibrate()

    assert start_s(samples) == pytest.approx(20.0, abs=0.5)
    assert (samples.calibration.state, samples.calibration.sigma_deg) == ("assumed", 7.0)


def test_of_a_pose_that_sways_for_more_than_a_minute_the_first_ten_seconds_are_measured() -> None:
    samples = Course().hold(75.0).move(10.0).hold(10.0, ASIDE).move(100.0).calibrate()

    assert start_s(samples) == pytest.approx(0.0, abs=0.5)
    assert samples.calibration.windows[0].duration_s == pytest.approx(10.0)


def test_what_is_held_after_ten_minutes_is_no_candidate() -> None:
    samples = Course().move(90.0).hold(10.0).move(620.0).hold(10.0, ASIDE).calibrate()

    assert codes(samples) == ["W-POSE-ASSUMED"]
    assert [round(still.start_s) for still in samples.calibration.proposals] == [90]


@pytest.mark.parametrize(("apart_deg", "code"), [(8.0, "W-POSE-ASSUMED"), (12.0, "W-WHICH-POSE")])
def test_stillnesses_more_than_10_deg_apart_need_the_pose(apart_deg: float, code: str) -> None:
    samples = Course().hold(10.0).move(60.0).hold(10.0, tilted(apart_deg)).calibrate()

    assert codes(samples) == [code]
    assert samples.calibration.spread_deg == pytest.approx(apart_deg, abs=0.2)
    assert [round(still.start_s) for still in samples.calibration.proposals] == [0, 70]


def test_walking_in_another_direction_moves_no_pose() -> None:
    samples = Course().hold(10.0, ASIDE).move(20.0).hold(10.0).walk(300.0).calibrate()

    assert start_s(samples) == pytest.approx(0.0, abs=0.5)
    assert samples.calibration.walking_deg == pytest.approx(60.0, abs=1.0)


@pytest.mark.parametrize("seconds", [8.0, 120.0])
def test_a_table_does_not_sway_and_the_sensor_is_worn_from_its_end_on(seconds: float) -> None:
    samples = Course().lie(seconds).move(12.0).hold(10.0).move(100.0).calibrate(held="start")

    assert start_s(samples) == pytest.approx(seconds + 12.0, abs=0.5)
    assert samples.calibration.state == "held_at_start"


def test_a_recording_in_which_nothing_sways_was_made_without_an_arm_and_is_read_all_the_same() -> None:
    samples = Course().lie(10.0, UP).move(100.0).calibrate()

    assert samples.calibration.state == "assumed"
    assert codes(samples) == ["W-POSE-ASSUMED", "W-POSE-UNSTEADY"]


@pytest.mark.parametrize(("gain", "started_s"), [(1.09, 10.0), (1.25, 30.0)])
def test_the_pose_reads_1_g_within_a_tenth(gain: float, started_s: float) -> None:
    samples = Course().move(10.0).hold(10.0, gain * UP).move(10.0).hold(10.0).move(10.0).calibrate()

    assert start_s(samples) == pytest.approx(started_s, abs=0.5)


def test_each_candidate_is_a_reading_and_those_within_3_deg_are_one() -> None:
    course = Course().hold(10.0).move(30.0).hold(10.0, tilted(2.0)).move(30.0).hold(10.0, tilted(30.0))

    (reading,) = course.calibrate().readings

    assert reading.arm_axis == pytest.approx(tilted(30.0), abs=0.01)


def test_of_many_candidates_those_farthest_apart_are_read() -> None:
    axes = [tilted(degrees) for degrees in (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0)]

    assert select_distinct_axes(axes, most=3) == [0, 6, 3]


@pytest.mark.parametrize(
    "course",
    [
        Course().move(50.0).hold(10.0).move(60.0).hold(10.0, ASIDE),
        Course().move(5.0).hold(10.0).move(10.0).hold(10.0, ASIDE).move(60.0),
    ],
    ids=["within a minute", "at once, whatever is held after it"],
)
def test_a_stillness_that_begins_within_a_minute_confirms_a_pose_held_at_the_start(course: Course) -> None:
    samples = course.calibrate(held="start")

    assert samples.calibration.state == "held_at_start"
    assert (samples.calibration.proposals, samples.readings, codes(samples)) == ((), (), [])


def test_stillnesses_later_in_the_first_minute_that_disagree_are_asked_about_all_the_same() -> None:
    samples = Course().move(15.0).hold(8.0, ASIDE).move(10.0).hold(10.0).move(60.0).calibrate(held="start")

    assert samples.calibration.state == "held_at_start"
    assert [round(still.start_s) for still in samples.calibration.proposals] == [15, 33]
    assert codes(samples) == ["W-WHICH-POSE"]
    assert len(samples.readings) == 1


def test_without_a_stillness_within_a_minute_the_statement_does_not_hold() -> None:
    samples = Course().move(70.0).hold(10.0).move(60.0).calibrate(held="start")

    assert samples.calibration.state == "assumed"
    assert codes(samples, pose_held="start") == ["W-POSE-ASSUMED", "W-NOT-HELD"]


def test_a_person_may_say_that_what_the_file_states_does_not_hold() -> None:
    stated = replace(Course().hold(10.0).move(60.0).record(), pose_held="start")

    settings = apply_file_settings(stated, AnalysisSettings(pose_held="no"))

    assert settings.pose_held == "no"
    assert calibrate(stated, settings).calibration.state == "assumed"
    assert codes(calibrate(stated, settings), pose_held="no") == ["W-POSE-ASSUMED"]


def test_a_window_goes_before_the_statement() -> None:
    samples = Course().hold(10.0).move(60.0).hold(10.0, ASIDE).calibrate((71.0, 79.0), held="start")

    assert (samples.calibration.state, start_s(samples)) == ("given", 71.0)


@pytest.mark.parametrize(
    ("course", "axis", "sigma_deg", "windows"),
    [
        (Course().move(620.0).hold(10.0, ASIDE).walk(120.0, tilted(15.0)), tilted(15.0), 10.0, 0),
        (Course().move(620.0).hold(10.0, ASIDE), ASIDE, 35.0, 1),
    ],
    ids=["walking", "the stillest moment"],
)
def test_without_an_early_stillness_walking_or_else_the_stillest_moment_stands_for_the_pose(
    course: Course, axis: Direction, sigma_deg: float, windows: int
) -> None:
    samples = course.calibrate()

    assert (samples.calibration.state, len(samples.calibration.windows)) == ("none", windows)
    assert samples.calibration.arm_axis == pytest.approx(axis, abs=0.01)
    assert (samples.calibration.sigma_deg, codes(samples)) == (sigma_deg, ["W-NO-STILL"])


def test_nothing_outvotes_a_window_that_a_person_gave() -> None:
    samples = Course().hold(10.0).walk(120.0).hold(10.0, ASIDE).walk(120.0).calibrate((132.0, 139.0))

    assert samples.calibration.arm_axis == pytest.approx(ASIDE, abs=0.01)
    assert (samples.calibration.state, samples.calibration.sigma_deg) == ("given", 5.0)
    assert samples.calibration.walking_deg == pytest.approx(60.0, abs=1.0)
    assert codes(samples) == []


@pytest.mark.parametrize(
    ("course", "window_s", "what"),
    [
        (Course().hold(10.0)._add(10.0, UP, 0.02, 1.0).move(60.0), (11.0, 19.0), "moving"),
        (Course().lie(20.0).move(20.0).hold(10.0), (2.0, 12.0), "table"),
    ],
)
def test_a_given_window_in_motion_or_on_a_table_is_kept_with_a_caveat(
    course: Course, window_s: tuple[float, float], what: str
) -> None:
    samples = course.calibrate(window_s)

    (flag,) = flags(samples)
    assert (flag.code, flag.facts) == ("W-POSE-UNSTEADY", {"what": what})
    assert (samples.calibration.state, start_s(samples)) == ("given", window_s[0])


def test_poses_that_agree_are_averaged_and_narrow_the_range() -> None:
    # 4 deg from the mean each: sqrt(4^2 + (2 x 3^2 + 2 x 2^2) / 4 / 2) = 4.39 deg.
    course = Course().hold(10.0).move(100.0).hold(10.0, tilted(4.0))

    calibration = course.calibrate((1.0, 9.0), (111.0, 119.0)).calibration

    assert calibration.state == "repeated"
    assert calibration.arm_axis == pytest.approx(tilted(2.0), abs=0.002)
    assert calibration.repeat_deg == pytest.approx(4.0, abs=0.1)
    assert calibration.sigma_deg == pytest.approx(4.39, abs=0.01)


@pytest.mark.parametrize("again_s", [(3.0, 9.5), (9.0, 9.9)])
def test_windows_that_meet_are_one_pose(again_s: tuple[float, float]) -> None:
    calibration = Course().hold(10.0).move(100.0).calibrate((1.0, 9.0), again_s).calibration

    (window,) = calibration.windows
    assert (window.start_s, window.end_s) == pytest.approx((1.0, again_s[1]))
    assert (calibration.state, calibration.sigma_deg, calibration.repeat_deg) == ("given", 5.0, None)


def test_the_more_poses_agree_the_narrower_the_range_down_to_what_a_person_always_does() -> None:
    narrower = [estimate_repeated_sigma([0.0] * count) for count in (2, 5, 100)]

    assert narrower == sorted(narrower, reverse=True)
    assert 4.0 < narrower[-1] < 4.01


def test_between_two_poses_that_disagree_nothing_is_cut_and_the_earlier_reads_up_to_the_later() -> None:
    course = Course().hold(10.0).move(100.0).hold(10.0, tilted(20.0)).move(20.0).hold(10.0, tilted(20.0))

    samples = course.calibrate((1.0, 9.0), (111.0, 119.0), (141.0, 149.0))

    (flag,), (part,) = flags(samples), samples.axis_parts
    assert samples.calibration.state == "given"
    assert (flag.code, flag.first_s, flag.last_s) == ("W-POSES-DIFFER", 9.0, 111.0)
    assert flag.facts == {"apart_deg": 20}
    assert (part.start_s, part.end_s) == (111.0, np.inf)
    assert part.arm_axis == pytest.approx(tilted(20.0), abs=0.002)
    (reading,) = samples.readings
    assert reading.parts[-1].start_s == 9.0  # the other reading changes over at once


def test_a_slip_that_the_person_names_parts_two_poses_and_costs_a_minute_on_both_sides() -> None:
    course = Course().hold(10.0).move(300.0).hold(10.0, tilted(20.0))

    samples = course.calibrate((1.0, 9.0), (311.0, 319.0), slip_s=(200.0,))

    left_out = [(part.start_s, part.end_s) for part in samples.axis_parts if part.arm_axis is None]
    assert left_out == [(140.0, 260.0)]
    assert codes(samples) == ["W-REMOUNT"]


def test_after_a_slip_nothing_is_read_until_a_pose_is_given() -> None:
    samples = Course().hold(10.0).move(300.0).hold(10.0, tilted(20.0)).calibrate((1.0, 9.0), slip_s=(200.0,))

    assert [(part.start_s, part.end_s) for part in samples.axis_parts] == [(140.0, 260.0), (260.0, np.inf)]


def test_a_slip_in_the_last_minute_leaves_out_what_there_is_of_it() -> None:
    samples = Course().hold(10.0).move(300.0).calibrate((1.0, 9.0), slip_s=(300.0,))

    (flag,) = flags(samples)
    assert (flag.code, flag.first_s, flag.last_s) == ("W-REMOUNT", 240.0, 310.0)


def slip(degrees: float) -> Course:
    """A pose, work and walking, and both again with the sensor turned."""
    course = Course().hold(10.0)
    for direction in (UP, tilted(degrees)):
        for _ in range(3):
            course.hold(70.0, direction).walk(60.0, direction).move(30.0, direction)
    return course


def test_walking_that_shows_a_slip_asks_and_cuts_nothing() -> None:
    samples = slip(30.0).calibrate((1.0, 9.0))

    (question,), (reading,) = samples.calibration.questions, samples.readings
    assert question.kind == "slip"
    assert 400.0 < question.first_s < question.end_s < 650.0
    assert question.apart_deg == pytest.approx(30.0, abs=1.0)
    assert samples.axis_parts == ()
    assert codes(samples) == ["W-SLIP"]
    assert reading.arm_axis == pytest.approx(UP, abs=0.01)
    assert reading.parts[0].arm_axis == pytest.approx(tilted(30.0), abs=0.03)


@pytest.mark.parametrize("answer", ["slip_s", "no_slip_s"])
def test_a_person_who_answers_is_not_asked_again(answer: str) -> None:
    samples = slip(30.0).calibrate((1.0, 9.0), **{answer: (500.0,)})  # type: ignore[arg-type]

    assert samples.calibration.questions == ()
    assert ("W-REMOUNT" in codes(samples)) == (answer == "slip_s")


def test_walking_within_12_deg_asks_nothing() -> None:
    assert slip(10.0).calibrate((1.0, 9.0)).calibration.questions == ()


def test_loads_carried_with_the_arm_raised_are_no_slip_if_the_other_postures_stay() -> None:
    course = Course().hold(10.0)
    for direction in (UP, tilted(50.0)):
        for _ in range(3):
            course.hold(70.0).walk(60.0, direction).move(30.0)

    assert course.calibrate((1.0, 9.0)).calibration.questions == ()


def test_poses_that_agree_on_both_sides_show_that_nothing_slipped() -> None:
    course = slip(30.0).hold(10.0)
    end_s = course.record().duration_us / 1e6

    assert course.calibrate((1.0, 9.0), (end_s - 9.0, end_s - 1.0)).calibration.questions == ()


def take_off(after: Direction, minutes: float = 8.0) -> Course:
    """A pose and work, a while on a desk, and work again."""
    return Course().hold(10.0).move(600.0).lie(60.0 * minutes).move(20.0).hold(20.0, after).move(600.0)


def test_a_sensor_that_was_off_asks_for_the_pose_after_it_and_cuts_nothing() -> None:
    samples = take_off(ASIDE).calibrate((1.0, 9.0))

    (question,), (reading,) = samples.calibration.questions, samples.readings
    assert question.kind == "put_back"
    assert (question.first_s, question.end_s) == pytest.approx((610.0, 1090.0), abs=10.0)
    assert samples.axis_parts == ()
    assert codes(samples) == ["W-PUT-BACK"]
    assert reading.parts[-1].arm_axis == pytest.approx(ASIDE, abs=0.01)  # by the stillness held after it


def test_a_pose_given_after_it_was_off_reads_from_there_on() -> None:
    samples = take_off(ASIDE).calibrate((1.0, 9.0), (1112.0, 1128.0))

    (part,) = samples.axis_parts
    assert part.arm_axis == pytest.approx(ASIDE, abs=0.01)
    assert 610.0 < part.start_s < 1090.0
    assert samples.calibration.questions == ()


def test_a_sensor_put_back_in_the_same_place_is_asked_about_until_a_person_says_so() -> None:
    assert codes(take_off(UP).calibrate((1.0, 9.0))) == ["W-PUT-BACK"]
    assert codes(take_off(UP).calibrate((1.0, 9.0), no_slip_s=(1090.0,))) == []


def test_a_hole_of_five_minutes_may_be_a_sensor_that_was_off() -> None:
    before, after = (
        Course().hold(10.0, direction).move(200.0).record().segments[0] for direction in (UP, ASIDE)
    )
    later = Segment(600_000_000, after.rate_hz, after.acc_g, after.gyr_dps)
    whole = replace(Course().hold(1.0).record(), duration_us=810_000_000, segments=(before, later))

    samples = calibrate(whole, AnalysisSettings(calibration_windows_s=((1.0, 9.0), (601.0, 609.0))))

    (part,) = samples.axis_parts
    assert part.arm_axis == pytest.approx(ASIDE, abs=0.01)


def test_still_stretches_like_the_pose_in_the_last_ten_minutes_are_proposed_as_repeats() -> None:
    course = Course().hold(10.0).move(700.0).hold(10.0, ASIDE).move(600.0)
    recording = course.hold(10.0, tilted(5.0)).move(20.0).hold(10.0, ASIDE).record()

    proposed = [(one.kind, round(one.still.start_s)) for one in propose_poses(recording)]

    assert proposed == [("pose", 0), ("repeat", 1320)]


@pytest.mark.parametrize(("text", "axis"), [("y", "+y"), ("+y", "+y"), (" y", "+y"), ("-X", "-x")])
def test_an_axis_is_read_with_or_without_its_plus(text: str, axis: str) -> None:
    assert parse_arm_axis(text) == axis


@pytest.mark.parametrize("text", ["", "w", "yy"])
def test_what_is_no_axis_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="-z"):
        parse_arm_axis(text)


def test_an_axis_that_was_given_is_the_arms_within_8_deg() -> None:
    recording = Course().move(100.0).hold(10.0, ASIDE).record()

    samples = calibrate(recording, AnalysisSettings(arm_axis="-y"))

    assert samples.calibration.arm_axis.tolist() == [0.0, -1.0, 0.0]
    assert (samples.calibration.sigma_deg, samples.calibration.state) == (8.0, "axis")
    assert codes(samples) == ["W-AXIS"]
