"""The imperfect sensor: what it adds, and where it stops."""

from dataclasses import replace

import numpy as np
import pytest

from fusion.simulation.body import ArmState
from fusion.simulation.sensor import (
    GT9X,
    LSM9DS1,
    draw_errors,
    quantise,
    sense,
)
from tests.simulated_shifts import draw_perfect

TIME_S = np.arange(6000) / 100.0


def hang_still() -> ArmState:
    up, still = np.zeros((6000, 3)), np.zeros((6000, 3))
    up[:, 2] = 1.0
    return ArmState(up, still, still, np.zeros(6000))


def test_a_perfect_sensor_reads_the_arm_through_its_mounting() -> None:
    errors = draw_perfect(60.0, np.random.default_rng(1))

    readings = sense(hang_still(), errors, TIME_S, np.random.default_rng(2))

    assert np.allclose(readings.acc_g, errors.mounting[:, 2], atol=1e-12)


def test_a_mounting_is_a_rotation_with_the_arm_near_the_sensors_y_axis() -> None:
    mountings = [draw_perfect(60.0, np.random.default_rng(seed)).mounting for seed in range(50)]

    assert all(np.linalg.det(turn) == pytest.approx(1.0) and turn[1, 2] > 0.95 for turn in mountings)


def test_at_rest_the_gyroscope_reads_its_offset_and_the_wander_between_two_knots() -> None:
    errors = draw_errors(LSM9DS1, 100.0, 60.0, np.random.default_rng(1))
    errors = replace(errors, acc_noise_g=0.0, gyr_noise_dps=0.0)

    readings = sense(hang_still(), errors, TIME_S, np.random.default_rng(2))

    first, second = errors.gyr_wander_dps[:2]
    assert readings.gyr_dps[0] == pytest.approx(errors.gyr_offset_dps + first)
    assert readings.gyr_dps[3000] == pytest.approx(errors.gyr_offset_dps + (first + second) / 2)


def test_noise_has_the_stated_size() -> None:
    errors = draw_errors(GT9X, 100.0, 60.0, np.random.default_rng(1))

    readings = sense(hang_still(), errors, TIME_S, np.random.default_rng(2))

    assert np.diff(readings.acc_g, axis=0).std() / np.sqrt(2) == pytest.approx(errors.acc_noise_g, rel=0.03)


@pytest.mark.parametrize(
    ("value", "counts"), [(0.00024, 0), (0.00025, 1), (-1.0, -2048), (17.0, 32767), (-17, -32767)]
)
def test_counts_are_rounded_to_the_step_and_cut_at_full_scale(value: float, counts: int) -> None:
    assert quantise(np.array([value]), GT9X.acc_g_per_lsb, GT9X.acc_range_g)[0] == counts


def test_the_lsm9ds1_stops_at_2000_dps_though_its_counts_could_go_on() -> None:
    counts = quantise(np.array([2100.0]), LSM9DS1.gyr_dps_per_lsb, LSM9DS1.gyr_range_dps)

    assert counts[0] * LSM9DS1.gyr_dps_per_lsb == pytest.approx(2000.0, abs=0.07)
