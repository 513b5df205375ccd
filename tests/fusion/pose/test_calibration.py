"""Windows asked for, the axis that they give, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from acromion.fusion.conventions import MethodName, Pose
from acromion.fusion.elevation import estimate_elevation
from acromion.fusion.errors import UnusableCalibration
from acromion.fusion.pipeline import Analysis, analyse
from acromion.fusion.pose.calibrate import calibrate, compute_two_point_axis
from acromion.fusion.pose.rules import score_still_period
from acromion.fusion.quality.verdict import flag_pose, flag_published, flag_untrusted_pose
from acromion.fusion.recording import QualityFlag, Recording, Segment
from acromion.fusion.sensor.model import GyroBias
from acromion.fusion.settings import AnalysisSettings
from tests.factories import hold, record
from tests.fusion.pose.test_poses import Course, tilted


def rest(*stretches: tuple[float, NDArray[np.float64] | None]) -> Recording:
    """Stretches (seconds, direction of gravity); None is a stretch of restless movement."""
    course = Course()
    for seconds, direction in stretches:
        course = course.move(seconds) if direction is None else course.lie(seconds, direction)
    return course.record()


GIVEN = AnalysisSettings(calibration_windows_s=((5.0, 15.0),))
LEAN = replace(GIVEN, pose="side-lean")


def test_the_arm_axis_is_gravity_in_the_window_asked_for() -> None:
    recording = rest((20.0, tilted(30.0)), (20.0, tilted(80.0)))

    samples = calibrate(recording, GIVEN)

    (still,) = samples.calibration.windows
    assert np.abs(samples.calibration.arm_axis - tilted(30.0)).max() < 0.001
    assert (still.start_s, still.duration_s) == (5.0, 10.0)
    assert samples.recording is recording  # the samples are not copied


def test_the_mean_rate_of_the_window_is_its_bias() -> None:
    acc = np.tile([0.0, 0.0, 1.0], (3000, 1))
    recording = record(acc, np.tile([1.0, -2.0, 3.0], (3000, 1)), 100.0)

    still = calibrate(recording).calibration.windows[0]

    assert still.gyro_bias_dps == pytest.approx([1.0, -2.0, 3.0])


def test_without_five_quiet_seconds_the_best_two_are_taken_and_flagged() -> None:
    samples = calibrate(rest((10.0, None), (3.0, tilted(0.0)), (10.0, None)))

    assert samples.calibration.windows[0].duration_s == pytest.approx(2.0, abs=0.1)
    assert [flag.code for flag in flag_pose(samples, AnalysisSettings())] == ["W-NO-STILL"]


def leave_hole(recording: Recording) -> Recording:
    segment = recording.segments[0]
    later = Segment(40_000_000, segment.rate_hz, segment.acc_g, segment.gyr_dps)
    return replace(recording, duration_us=60_000_000, segments=(segment, later))


@pytest.mark.parametrize(
    ("recording", "windows_s", "pose", "why"),
    [
        (rest((30.0, None)), (), "n-pose", "moving"),
        (rest((1.5, tilted(0.0))), (), "n-pose", "none"),
        (rest((20.0, tilted(0.0)), (10.0, None)), ((15.0, 31.0),), "n-pose", "outside"),
        (rest((20.0, tilted(0.0)), (10.0, None)), ((5.0, 5.5),), "n-pose", "short"),
        (rest((20.0, tilted(0.0)), (10.0, None)), ((18.0, 24.0),), "n-pose", "moving"),
        (leave_hole(rest((20.0, tilted(0.0)))), ((18.0, 42.0),), "n-pose", "hole"),
        (rest((20.0, 1.3 * tilted(0.0))), ((5.0, 10.0),), "n-pose", "gravity"),
        (rest((20.0, tilted(0.0))), ((1.0, 5.0),), "two-point", "count"),
        (rest((10.0, tilted(0.0)), (10.0, tilted(40.0))), ((1.0, 9.0), (11.0, 19.0)), "two-point", "angle"),
    ],
    ids=[
        "moves throughout", "shorter than 2 s", "window outside", "window too short", "window in motion",
        "window in a hole", "far from 1 g", "one window for two points", "no right angle apart",
    ],
)  # fmt: skip
def test_what_cannot_be_calibrated_is_refused_with_its_reason(
    recording: Recording, windows_s: tuple[tuple[float, float], ...], pose: Pose, why: str
) -> None:
    with pytest.raises(UnusableCalibration) as refusal:
        calibrate(recording, AnalysisSettings(pose=pose, calibration_windows_s=windows_s))

    assert refusal.value.facts["why"] == why


def test_two_point_shares_the_departure_from_a_right_angle() -> None:
    # Hanging reads 0, level reads 74: the axis moves 8 deg away from level. Hanging then reads 8, level 82.
    axis = compute_two_point_axis(tilted(0.0), tilted(74.0))

    assert axis == pytest.approx(tilted(-8.0), abs=1e-12)


@pytest.mark.parametrize(
    ("duration_s", "acc_sd_g", "length_g", "score"),
    [(5.0, 0.01, 1.0, 0.5), (10.0, 0.0, 1.1, 0.5), (2.0, 0.0, 1.0, 0.4)],
    ids=["the limit of quiet", "away from 1 g", "short"],
)
def test_the_score_falls_with_noise_the_distance_from_1_g_and_a_short_duration(
    duration_s: float, acc_sd_g: float, length_g: float, score: float
) -> None:
    assert score_still_period(duration_s, acc_sd_g, np.array([0.0, 0.0, length_g])) == pytest.approx(score)


def test_an_arm_held_at_95_deg_after_hanging_is_calibrated_on_the_hanging() -> None:
    made = hold((0.0, 20.0), (95.0, 20.0), rate_hz=50.0)

    assert calibrate(made.recording).calibration.windows[0].start_s < 15.0


def test_two_points_share_the_error_of_a_raised_pose_between_hanging_and_level() -> None:
    # Held at 15.9 and 90: 74.1 apart in place of 90, so hanging reads 7.95 and level 82.05.
    made = hold((15.9, 10.0), (90.0, 10.0))
    asked = AnalysisSettings(pose="two-point", calibration_windows_s=((1.0, 8.0), (12.0, 18.0)))

    samples = calibrate(made.recording, asked)

    assert [still.start_s for still in samples.calibration.windows] == [1.0, 12.0]
    elevation_deg = estimate_elevation(samples).segments[0].elevation_deg
    assert elevation_deg[[500, 1500]] == pytest.approx([7.95, 82.05], abs=0.05)


@pytest.mark.parametrize(("settings", "told"), [(AnalysisSettings(pose="side-lean"), True), (LEAN, False)])
def test_a_lean_that_nobody_pointed_at_is_flagged(settings: AnalysisSettings, told: bool) -> None:
    samples = calibrate(rest((30.0, tilted(0.0))), settings)

    assert ("W-LEAN" in [flag.code for flag in flag_pose(samples, AnalysisSettings())]) is told


# What is said of a calibration, or of a method, that the figures cannot rest on as usual.

HELD = hold((0.0, 30.0), (60.0, 30.0), (0.0, 30.0)).recording


def analyse_asked(*windows_s: tuple[float, float], method: MethodName = "smoothed") -> Analysis:
    return analyse(HELD, AnalysisSettings(method, "n-pose", windows_s))


def find(analysis: Analysis, code: str) -> list[QualityFlag]:
    return [flag for flag in analysis.quality.flags if flag.code == code]


@pytest.mark.parametrize(("end_s", "told"), [(6.9, 1), (7.0, 0)])
def test_a_window_asked_for_that_is_shorter_than_5_s_is_told(end_s: float, told: int) -> None:
    flags = find(analyse_asked((2.0, end_s)), "W-POSE-SHORT")

    assert [(flag.first_s, flag.last_s) for flag in flags] == [(2.0, end_s)] * told


def test_a_short_window_widens_the_range_of_the_figures() -> None:
    # 5 deg for 5 s or more, 5 x sqrt(5 / 2) = 7.9 deg for 2 s, 10 deg for 1 s.
    recording = hold(*((0.0, 30.0), (60.0, 30.0)) * 30, rate_hz=25.0).recording
    settings = [AnalysisSettings("smoothed", "n-pose", ((2.0, end_s),)) for end_s in (12.0, 4.0, 3.0)]

    ranges = [analyse(recording, asked).exposure.intervals["elevation_p50_deg"] for asked in settings]

    widths = [interval.high - interval.low for interval in ranges]
    assert widths[0] < widths[1] < widths[2]


@pytest.mark.parametrize(("end_s", "told"), [(6.9, 0), (7.1, 1)])
def test_a_calibration_of_which_half_is_not_trusted_is_in_doubt(end_s: float, told: int) -> None:
    samples = calibrate(HELD, AnalysisSettings(calibration_windows_s=((2.0, 12.0),)))
    elevation = estimate_elevation(samples)
    elevation.segments[0].valid[: round(100.0 * end_s)] = False

    flags = flag_untrusted_pose(samples.calibration, elevation)

    assert [(flag.code, flag.first_s, flag.last_s) for flag in flags] == [("W-POSE-DOUBT", 2.0, 12.0)] * told


def test_published_tells_how_far_the_offset_went_from_the_one_it_takes() -> None:
    bias = GyroBias(np.array([0.0, 60.0]), np.array([[1.0, 0.0, 0.0], [1.0, 0.3, 0.4]]))

    (flag,) = flag_published(bias, np.array([1.0, 0.0, 0.0]))

    assert flag.facts == {"dps": 0.5}


@pytest.mark.parametrize(("method", "told"), [("published", 1), ("smoothed", 0), ("live", 0)])
def test_only_published_warns_of_its_weaknesses(method: MethodName, told: int) -> None:
    assert len(find(analyse_asked((2.0, 12.0), method=method), "W-PUBLISHED")) == told
