"""The published algorithm: the fast kernel does what the paper's steps do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fusion.orientation.published import (
    PublishedParameters,
    estimate_published,
    highpass_gain,
    lowpass_gain,
)
from fusion.sensor.model import SensorRun
from tests.fusion.made_motion import angle_between_deg, tumble
from tests.fusion.orientation.published_step_by_step import follow_paper

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
