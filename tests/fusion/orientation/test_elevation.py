"""From calibrated samples to the angle, and which samples are valid."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.conventions import MethodName
from fusion.elevation import Elevation, describe_method, estimate_elevation, measure_elevation
from fusion.pose.calibrate import calibrate
from fusion.recording import Recording, Segment
from fusion.settings import AnalysisSettings
from tests.factories import hold, move_arm


def fuse(recording: Recording, method: MethodName = "smoothed") -> Elevation:
    settings = AnalysisSettings(calibration_windows_s=((0.5, 4.5),))
    return estimate_elevation(calibrate(recording, settings), method)


def still_then_swing(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Hang for 5 s, then raise to 90 deg and back with a period of 4 s."""
    moving = np.clip(time_s - 5.0, 0.0, None)
    return 45.0 - 45.0 * np.cos(2.0 * np.pi * moving / 4.0)


# The paper's high-pass undoes a raise of 95 deg at 2 pi 0.002 Hz x 95 deg = 1.2 deg/s; times 1 s that is
# 1.2 deg.
@pytest.mark.parametrize(("method", "within_deg"), [("smoothed", 0.1), ("published", 1.2), ("live", 0.1)])
def test_held_poses_are_read_as_held(method: MethodName, within_deg: float) -> None:
    made = hold((0.0, 10.0), (95.0, 10.0), (30.0, 10.0), rate_hz=100.0)

    elevation_deg = fuse(made.recording, method).segments[0].elevation_deg

    assert elevation_deg[[500, 1500, 2500]] == pytest.approx([0.0, 95.0, 30.0], abs=within_deg)


def test_a_swinging_arm_is_followed_although_it_accelerates() -> None:
    made = move_arm(still_then_swing, 65.0)

    (segment,) = fuse(made.recording).segments

    assert np.sqrt(np.mean((segment.elevation_deg - made.elevation_deg) ** 2)) < 0.5
    assert segment.valid.all()


def split(recording: Recording, row: int) -> Recording:
    segment = recording.segments[0]
    second_us = round(row / segment.rate_hz * 1e6)
    first = replace(segment, acc_g=segment.acc_g[:row], gyr_dps=segment.gyr_dps[:row])
    second = Segment(second_us, segment.rate_hz, segment.acc_g[row:], segment.gyr_dps[row:])
    return replace(recording, segments=(first, second))


def test_rows_that_bridge_a_hole_are_not_valid() -> None:
    recording = hold((0.0, 10.0), rate_hz=100.0).recording
    bridged = replace(recording.segments[0], bridged=((300, 303),))

    valid = fuse(replace(recording, segments=(bridged,))).segments[0].valid

    assert np.flatnonzero(~valid).tolist() == [300, 301, 302]


def test_a_segment_under_one_second_is_not_valid() -> None:
    recording = split(hold((0.0, 10.0), rate_hz=100.0).recording, 901)

    assert [bool(segment.valid.any()) for segment in fuse(recording).segments] == [True, False]


def test_seconds_in_which_past_and_future_contradict_each_other_are_not_valid() -> None:
    # The gyroscope sleeps while the arm is raised by 95 deg.
    recording = hold((0.0, 20.0), (95.0, 20.0), rate_hz=100.0).recording
    asleep = replace(recording.segments[0], gyr_dps=np.zeros((4000, 3), dtype=np.float32))

    valid = fuse(replace(recording, segments=(asleep,))).segments[0].valid

    assert not valid[1900:2100].any()
    assert valid[500:1500].all()


def test_the_vertical_of_each_sample_is_worked_out_on_demand_as_unit_vectors_in_single_precision() -> None:
    kept = fuse(hold((0.0, 10.0)).recording).segments[0].vertical

    assert kept is not None
    assert not isinstance(kept, np.ndarray)
    assert kept[:].dtype == np.float32
    assert np.abs(np.linalg.norm(kept[:], axis=1) - 1.0).max() < 1e-5


@pytest.mark.parametrize("degrees", [0.0, 1e-3, 30.0, 90.0, 179.999, 180.0])
def test_the_angle_is_exact_near_its_ends_too(degrees: float) -> None:
    up = np.array([[np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))]])

    assert measure_elevation(up, np.array([0.0, 0.0, 1.0]))[0] == pytest.approx(degrees, abs=1e-5)


@pytest.mark.parametrize("method", ["smoothed", "published", "live"])
def test_the_method_names_every_parameter(method: MethodName) -> None:
    described = describe_method(method)

    assert (described.name, described.version) == (method, "6")
    assert "time_constant_s" in described.parameters
    assert all(isinstance(value, float) for value in described.parameters.values())
