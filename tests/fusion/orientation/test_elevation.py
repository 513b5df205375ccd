"""From calibrated samples to the angle, and which samples are valid."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from acromion.fusion.conventions import MethodName
from acromion.fusion.elevation import Elevation, describe_method, estimate_elevation, measure_elevation
from acromion.fusion.orientation.published import (
    PublishedParameters,
    estimate_published,
    highpass_gain,
    lowpass_gain,
)
from acromion.fusion.orientation.smoothed import (
    SmoothedNodes,
    UncertaintySettings,
    average_around,
    estimate_sigma,
)
from acromion.fusion.pose.calibrate import calibrate
from acromion.fusion.recording import Recording, Segment
from acromion.fusion.sensor.model import AccelerometerCorrection, SensorRun, build_identity_accelerometer
from acromion.fusion.settings import AnalysisSettings
from acromion.fusion.simulation import simulate_shift
from acromion.fusion.simulation.sensor import Device
from tests.factories import hold, move_arm, record
from tests.fusion.made_motion import angle_between_deg, tumble
from tests.fusion.orientation.published_step_by_step import follow_paper
from tests.simulated_shifts import play_shift


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


# How uncertain the angle is said to be, and whether that is true.


def smoothed(*disagreement_deg: float) -> SmoothedNodes:
    return SmoothedNodes(np.zeros((1, 3)), np.array(disagreement_deg), 20)


def test_the_parts_are_added_as_variances() -> None:
    # Offset left 5 mg = 0.2865 deg, times 0.5: 0.1432. Disagreement 2 deg: 4 / 2 x 0.15 = 0.3 deg^2.
    correction = AccelerometerCorrection(np.zeros(1), np.zeros((1, 3)), np.eye(3), 20, 0.005)

    sigma_deg = estimate_sigma(smoothed(*[2.0] * 20), correction)

    assert sigma_deg == pytest.approx(np.full(20, np.sqrt(0.10**2 + 0.1432**2 + 0.3)), abs=1e-4)


def test_an_accelerometer_that_could_not_be_calibrated_counts_as_delivered() -> None:
    sigma_deg = estimate_sigma(
        smoothed(0.0), build_identity_accelerometer(), UncertaintySettings(floor_deg=0.0)
    )

    # 0.04 g = 2.292 deg, times 0.5.
    assert sigma_deg == pytest.approx([1.146], abs=1e-3)


@pytest.mark.parametrize("count", [1, 4, 3600])
def test_nine_seconds_are_averaged_as_scipy_does_to_the_bit(count: int) -> None:
    values = np.random.default_rng(count).exponential(5.0, count)

    assert np.array_equal(average_around(values, 9), uniform_filter1d(values, 9, mode="nearest"))


def test_there_is_one_value_for_each_second_and_the_recordings_own_is_their_root_mean_square() -> None:
    elevation = estimate_elevation(calibrate(hold((0.0, 5.0), (80.0, 5.4)).recording))

    sigma_deg = elevation.segments[0].sigma_deg
    assert sigma_deg is not None
    assert sigma_deg.shape == (11,)
    assert sigma_deg.dtype == np.float32
    assert elevation.bias_sigma_deg == pytest.approx(np.sqrt(np.mean(sigma_deg.astype(float) ** 2)))


@pytest.mark.parametrize(("method", "typical_deg"), [("published", 4.2), ("live", 1.3)])
def test_methods_without_a_measure_of_their_own_tell_their_typical_error(
    method: MethodName, typical_deg: float
) -> None:
    elevation = estimate_elevation(calibrate(hold((0.0, 10.0)).recording), method)

    assert elevation.segments[0].sigma_deg is None
    assert elevation.bias_sigma_deg == typical_deg


@pytest.mark.slow
@pytest.mark.parametrize("device", ["gt9x", "lsm9ds1"])
def test_on_simulated_days_the_band_of_95_percent_covers_the_truth_about_as_often(device: Device) -> None:
    # Four days of two hours; the pose is left out, for the arm axis is the true one within the sensor's
    # error. `python -m benchmarks.fusion band` prints each day.
    inside = [cover(device, seed) for seed in (1, 3, 5, 7)]

    assert 0.93 <= np.mean(inside) <= 0.97


def cover(device: Device, seed: int) -> float:
    made = play_shift(simulate_shift(device, 2.0, seed, 50.0))
    recording = record(made.acc_g.astype(float), made.gyr_dps.astype(float), made.rate_hz)
    segment = estimate_elevation(calibrate(recording)).segments[0]
    assert segment.sigma_deg is not None
    sigma_deg = segment.sigma_deg[(np.arange(len(segment)) / made.rate_hz).astype(int)]
    return float((np.abs(segment.elevation_deg - made.elevation_deg) < 1.96 * sigma_deg).mean())


# The published algorithm: the fast kernel does what the paper's steps do.

NO_BIAS = np.zeros(3)


def fast_elevation_deg(
    acc: NDArray[np.float64], gyr: NDArray[np.float64], axis: NDArray[np.float64], how: PublishedParameters
) -> NDArray[np.float64]:
    up = estimate_published(SensorRun(0.0, 100.0, acc, gyr), NO_BIAS, how)
    return angle_between_deg(np.asarray(up, dtype=np.float64), np.broadcast_to(axis, up.shape))


@pytest.mark.parametrize(("highpass_hz", "time_constant_s"), [(0.0, 0.05), (0.002, 1.0), (0.002, 10.0)])
def test_the_fast_kernel_agrees_with_every_step_of_the_paper(
    highpass_hz: float, time_constant_s: float
) -> None:
    motion = tumble(12.0, seed=3)
    noise = np.random.default_rng(1).normal(0.0, 0.3, motion.acc_g.shape)
    how = PublishedParameters(highpass_gyr_hz=highpass_hz, time_constant_s=time_constant_s)
    axis = np.array([0.6, 0.0, 0.8])

    fast = fast_elevation_deg(motion.acc_g + noise, motion.gyr_dps, axis, how)
    slow = follow_paper(motion.acc_g + noise, motion.gyr_dps, 100.0, NO_BIAS, axis, how)

    assert np.abs(fast - slow).max() < 1e-6


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000))
def test_the_fast_kernel_agrees_whatever_the_samples(seed: int) -> None:
    rng = np.random.default_rng(seed)
    acc, gyr = rng.normal(0.0, 1.0, (40, 3)), rng.normal(0.0, 500.0, (40, 3))
    axis = np.array([0.0, 1.0, 0.0])

    fast = fast_elevation_deg(acc, gyr, axis, PublishedParameters())
    slow = follow_paper(acc, gyr, 100.0, NO_BIAS, axis, PublishedParameters())

    assert np.abs(fast - slow).max() < 1e-6


def test_a_sensor_at_rest_upside_down_reads_down() -> None:
    acc = np.tile([0.0, 0.0, -1.0], (50, 1))

    up = estimate_published(SensorRun(0.0, 100.0, acc, np.zeros((50, 3))), NO_BIAS)

    assert np.abs(up - [0.0, 0.0, -1.0]).max() < 1e-9


def test_the_static_bias_is_taken_off() -> None:
    acc = np.tile([0.0, 0.0, 1.0], (500, 1))
    gyr = np.tile([5.0, -3.0, 1.0], (500, 1))

    up = estimate_published(SensorRun(0.0, 100.0, acc, gyr), np.array([5.0, -3.0, 1.0]))

    assert np.abs(up - [0.0, 0.0, 1.0]).max() < 1e-9


def test_the_one_pole_low_pass_at_100_hz_takes_76_percent_of_the_new_sample() -> None:
    # RC = 1 / (2 pi 50) = 3.183 ms; 10 / (10 + 3.183) = 0.7585.
    assert lowpass_gain(50.0, 100.0) == pytest.approx(0.7585, abs=1e-4)
    assert highpass_gain(0.0, 100.0) == 1.0  # no high-pass keeps everything


def test_the_weight_belongs_to_a_time_constant_so_both_devices_are_treated_alike() -> None:
    how = PublishedParameters(time_constant_s=1.0)

    five_short_steps = 1.0 - (1.0 - how.accelerometer_weight(500.0)) ** 5

    assert five_short_steps == pytest.approx(how.accelerometer_weight(100.0), rel=1e-12)
