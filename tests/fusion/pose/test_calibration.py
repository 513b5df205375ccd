"""Windows asked for, the axis that they give, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.elevation import estimate_elevation
from fusion.errors import UnusableCalibration
from fusion.pose.calibrate import calibrate
from fusion.pose.rules import score_still_period
from fusion.pose.windows import share_between
from fusion.quality.flags import flag_pose
from fusion.recording import Recording, Segment
from fusion.settings import AnalysisSettings
from tests.factories import hold, record


def rest(*stretches: tuple[float, NDArray[np.float64] | None], rate_hz: float = 50.0) -> Recording:
    """Stretches (seconds, direction of gravity); None is a stretch of restless movement."""
    rng = np.random.default_rng(0)
    acc, gyr = [], []
    for seconds, direction in stretches:
        rows = round(seconds * rate_hz)
        moving = direction is None
        acc.append(np.tile([0.0, 0.0, 1.0] if direction is None else direction, (rows, 1)))
        acc[-1] = acc[-1] + rng.normal(0.0, 0.3 if moving else 0.002, (rows, 3))
        gyr.append(rng.normal(0.0, 60.0 if moving else 0.1, (rows, 3)))
    return record(np.concatenate(acc), np.concatenate(gyr), rate_hz)


def tilted(degrees: float) -> NDArray[np.float64]:
    return np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])


def why_refused(recording: Recording, *windows_s: tuple[float, float], pose: str = "n-pose") -> object:
    with pytest.raises(UnusableCalibration) as refusal:
        calibrate(recording, AnalysisSettings(pose=pose, calibration_windows_s=windows_s))  # type: ignore[arg-type]
    return refusal.value.facts["why"]


def test_the_arm_axis_is_gravity_in_the_still_window() -> None:
    samples = calibrate(
        rest((20.0, tilted(30.0)), (20.0, tilted(80.0))),
        AnalysisSettings(calibration_windows_s=((5.0, 15.0),)),
    )

    assert np.abs(samples.calibration.arm_axis - tilted(30.0)).max() < 0.001


def test_the_window_asked_for_is_the_window_used() -> None:
    still = calibrate(
        rest((30.0, tilted(0.0))), AnalysisSettings(pose="side-lean", calibration_windows_s=((5.0, 15.0),))
    ).calibration.windows[0]

    assert (still.start_s, still.duration_s) == (5.0, 10.0)


def test_the_mean_rate_of_the_window_is_its_bias() -> None:
    acc = np.tile([0.0, 0.0, 1.0], (3000, 1))
    recording = record(acc, np.tile([1.0, -2.0, 3.0], (3000, 1)), 100.0)

    still = calibrate(recording).calibration.windows[0]

    assert still.gyro_bias_dps == pytest.approx([1.0, -2.0, 3.0])


def test_the_samples_are_not_copied() -> None:
    recording = rest((20.0, tilted(0.0)))

    assert calibrate(recording).recording is recording


def test_without_five_quiet_seconds_the_best_two_are_taken_and_flagged() -> None:
    samples = calibrate(rest((10.0, None), (3.0, tilted(0.0)), (10.0, None)))

    assert samples.calibration.windows[0].duration_s == pytest.approx(2.0, abs=0.1)
    assert [flag.code for flag in flag_pose(samples, AnalysisSettings())] == ["W-NO-STILL"]


def test_a_recording_in_constant_motion_is_refused() -> None:
    assert why_refused(rest((30.0, None))) == "moving"


def test_a_recording_shorter_than_two_seconds_is_refused() -> None:
    assert why_refused(rest((1.5, tilted(0.0)))) == "none"


@pytest.mark.parametrize(
    ("window_s", "why"),
    [
        ((15.0, 31.0), "outside"),
        ((5.0, 5.5), "short"),
        ((18.0, 24.0), "moving"),
    ],
)
def test_a_window_that_is_not_usable_is_refused(window_s: tuple[float, float], why: str) -> None:
    assert why_refused(rest((20.0, tilted(0.0)), (10.0, None)), window_s) == why


def test_a_window_in_a_hole_is_refused() -> None:
    whole = rest((20.0, tilted(0.0)))
    segment = whole.segments[0]
    later = Segment(40_000_000, segment.rate_hz, segment.acc_g, segment.gyr_dps)
    holed = replace(whole, duration_us=60_000_000, segments=(segment, later))

    assert why_refused(holed, (18.0, 42.0)) == "hole"


def test_a_window_far_from_1_g_is_refused() -> None:
    assert why_refused(rest((20.0, 1.3 * tilted(0.0))), (5.0, 10.0)) == "gravity"


def test_two_point_needs_two_windows() -> None:
    assert why_refused(rest((20.0, tilted(0.0))), (1.0, 5.0), pose="two-point") == "count"


def test_two_point_refuses_two_poses_that_are_not_a_right_angle_apart() -> None:
    recording = rest((10.0, tilted(0.0)), (10.0, tilted(40.0)))

    assert why_refused(recording, (1.0, 9.0), (11.0, 19.0), pose="two-point") == "angle"


def test_two_point_shares_the_departure_from_a_right_angle() -> None:
    # Hanging reads 0, level reads 74: the axis moves 8 deg away from level. Hanging then reads 8, level 82.
    axis = share_between(tilted(0.0), tilted(74.0))

    assert axis == pytest.approx(tilted(-8.0), abs=1e-12)


def test_two_point_keeps_both_periods() -> None:
    recording = rest((10.0, tilted(0.0)), (10.0, tilted(90.0)))

    calibration = calibrate(
        recording, AnalysisSettings(pose="two-point", calibration_windows_s=((1.0, 9.0), (11.0, 19.0)))
    ).calibration

    assert [still.start_s for still in calibration.windows] == [1.0, 11.0]
    assert calibration.arm_axis == pytest.approx(tilted(0.0), abs=0.002)


def test_the_score_is_a_half_at_the_limit_of_quiet() -> None:
    assert score_still_period(5.0, 0.01, np.array([0.0, 0.0, 1.0])) == pytest.approx(0.5)


def test_the_score_falls_with_the_distance_from_1_g() -> None:
    assert score_still_period(10.0, 0.0, np.array([0.0, 0.0, 1.1])) == pytest.approx(0.5)


def test_the_score_falls_with_a_short_duration() -> None:
    assert score_still_period(2.0, 0.0, np.array([0.0, 0.0, 1.0])) == pytest.approx(0.4)


def test_an_arm_held_at_95_deg_after_hanging_is_calibrated_on_the_hanging() -> None:
    made = hold((0.0, 20.0), (95.0, 20.0), rate_hz=50.0)

    assert calibrate(made.recording).calibration.windows[0].start_s < 15.0


@pytest.mark.parametrize(("raised_deg", "read_deg"), [(90.0, 74.1), (60.0, 44.1), (30.0, 14.1)])
def test_an_arm_held_away_from_the_body_while_calibrating_reads_low_by_as_much(
    raised_deg: float, read_deg: float
) -> None:
    # Oracle D22: calibrated at 15.9 deg of abduction, an abduction of q reads q - 15.9.
    made = hold((15.9, 10.0), (raised_deg, 10.0))

    segment = estimate_elevation(
        calibrate(made.recording, AnalysisSettings(calibration_windows_s=((1.0, 8.0),)))
    ).segments[0]

    assert segment.elevation_deg[1500] == pytest.approx(read_deg, abs=0.05)


def test_two_points_share_that_error_between_hanging_and_level() -> None:
    # Held at 15.9 and 90: 74.1 apart in place of 90, so hanging reads 7.95 and level 82.05.
    made = hold((15.9, 10.0), (90.0, 10.0))
    samples = calibrate(
        made.recording, AnalysisSettings(pose="two-point", calibration_windows_s=((1.0, 8.0), (12.0, 18.0)))
    )

    elevation_deg = estimate_elevation(samples).segments[0].elevation_deg

    assert elevation_deg[[500, 1500]] == pytest.approx([7.95, 82.05], abs=0.05)


def test_a_lean_that_nobody_pointed_at_is_flagged() -> None:
    samples = calibrate(rest((30.0, tilted(0.0))), AnalysisSettings(pose="side-lean"))

    assert "W-LEAN" in [flag.code for flag in flag_pose(samples, AnalysisSettings())]


def test_a_lean_whose_window_was_given_is_not_flagged() -> None:
    samples = calibrate(
        rest((30.0, tilted(0.0))), AnalysisSettings(pose="side-lean", calibration_windows_s=((5.0, 15.0),))
    )

    assert "W-LEAN" not in [flag.code for flag in flag_pose(samples, AnalysisSettings())]
