"""Gyroscope scale from still moments in different directions."""

import numpy as np
import pytest

from fusion.sensor.gyroscope import GyroScale
from fusion.sensor.model import SensorRun
from fusion.sensor.self_calibration import calibrate_sensor
from fusion.sensor.stillness import find_still_moments, reduce_run
from tests.fusion.made_motion import Motion, rest_and_turn, tumble

GAIN = np.array([1.01, 0.985, 1.006])
OFFSET = np.array([10.0, -20.0, 15.0])


def find_scale(motion: Motion) -> GyroScale:
    run = SensorRun(0.0, motion.rate_hz, motion.acc_g, motion.gyr_dps * GAIN + OFFSET)
    blocks = [reduce_run(run)]
    return calibrate_sensor([run], blocks, find_still_moments(blocks))[0].gyro_scale


def test_the_scale_of_each_axis_is_found_from_rests_between_turns() -> None:
    found = find_scale(rest_and_turn(200, seed=1))

    assert found.gain == pytest.approx(np.diag(1.0 / GAIN), abs=5e-4)
    assert found.pairs == 199


def test_axes_that_are_not_square_are_found_too() -> None:
    skew = np.array([[1.0, 0.004, 0.0], [0.0, 1.0, -0.003], [0.002, 0.0, 1.0]])
    motion = rest_and_turn(200, seed=4)
    run = SensorRun(0.0, motion.rate_hz, motion.acc_g, motion.gyr_dps @ skew.T)
    blocks = [reduce_run(run)]

    gain = calibrate_sensor([run], blocks, find_still_moments(blocks))[0].gyro_scale.gain

    assert gain == pytest.approx(np.linalg.inv(skew), abs=5e-4)


def test_with_little_evidence_the_scale_is_left_alone() -> None:
    assert find_scale(rest_and_turn(6, seed=2)).gain.tolist() == np.eye(3).tolist()


def test_without_rests_the_scale_is_left_alone() -> None:
    assert find_scale(tumble(60.0, still_s=0.0)).gain.tolist() == np.eye(3).tolist()


def test_a_good_gyroscope_is_not_made_worse() -> None:
    motion = rest_and_turn(200, seed=3)
    run = SensorRun(0.0, motion.rate_hz, motion.acc_g, motion.gyr_dps)
    blocks = [reduce_run(run)]

    gain = calibrate_sensor([run], blocks, find_still_moments(blocks))[0].gyro_scale.gain

    assert gain == pytest.approx(np.eye(3), abs=2e-4)
