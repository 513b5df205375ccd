"""Gyroscope scale from still moments in different directions."""

import numpy as np
import pytest

from fusion.recording import Float64Array
from fusion.sensor.gyroscope import GyroScale
from fusion.sensor.model import SensorRun
from fusion.sensor.self_calibration import calibrate_sensor
from fusion.sensor.stillness import find_still_moments, reduce_run
from tests.fusion.made_motion import Motion, rest_and_turn, tumble

GAIN = np.array([1.01, 0.985, 1.006])
OFFSET = np.array([10.0, -20.0, 15.0])


def find_scale(motion: Motion, change: Float64Array, offset_dps: Float64Array | float = 0.0) -> GyroScale:
    run = SensorRun(0.0, motion.rate_hz, motion.acc_g, motion.gyr_dps @ change.T + offset_dps)
    blocks = [reduce_run(run)]
    return calibrate_sensor([run], blocks, find_still_moments(blocks))[0].gyro_scale


SKEW = np.array([[1.0, 0.004, 0.0], [0.0, 1.0, -0.003], [0.002, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("change", "offset_dps"),
    [(np.diag(GAIN), OFFSET), (SKEW, np.zeros(3)), (np.eye(3), np.zeros(3))],
    ids=["gain and offset", "axes that are not square", "a good gyroscope"],
)
def test_the_scale_is_found_from_rests_between_turns(change: Float64Array, offset_dps: Float64Array) -> None:
    found = find_scale(rest_and_turn(200, seed=1), change, offset_dps)

    assert found.gain == pytest.approx(np.linalg.inv(change), abs=5e-4)
    assert found.pairs == 199


@pytest.mark.parametrize(
    "motion", [rest_and_turn(6, seed=2), tumble(60.0, still_s=0.0)], ids=["six turns", "no rests"]
)
def test_with_little_evidence_the_scale_is_left_alone(motion: Motion) -> None:
    assert find_scale(motion, np.diag(GAIN), OFFSET).gain.tolist() == np.eye(3).tolist()
