"""Offset and scale of the accelerometer from still moments."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.sensor_errors.accelerometer import calibrate_accelerometer, leave_accelerometer
from fusion.sensor_errors.stillness import QuietTable

OFFSET_G = np.array([0.03, -0.02, 0.04])
SCALE = np.array([1.01, 0.995, 0.99])


def moments(directions: NDArray[np.float64]) -> QuietTable:
    """What a sensor with the offset and scale above reads at rest in these directions."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    count = len(unit)
    readings = unit / SCALE + OFFSET_G
    return QuietTable(
        np.linspace(0.0, 2.0 * count, count),
        1.5,
        readings,
        np.zeros((count, 3)),
        np.zeros(count),
        np.zeros(count),
    )


def test_many_directions_tell_offset_and_scale() -> None:
    directions = np.random.default_rng(0).normal(size=(200, 3))

    correction = calibrate_accelerometer(moments(directions))

    assert correction.offset_g == pytest.approx(OFFSET_G, abs=0.001)
    assert correction.scale == pytest.approx(SCALE, abs=0.001)


def test_the_correction_makes_every_direction_1_g() -> None:
    still = moments(np.random.default_rng(1).normal(size=(200, 3)))

    corrected = calibrate_accelerometer(still).apply(still.gravity_g)

    assert np.abs(np.linalg.norm(corrected, axis=1) - 1.0).max() < 0.002


def test_a_single_pose_gives_no_correction() -> None:
    correction = calibrate_accelerometer(moments(np.tile([0.0, 0.0, 1.0], (300, 1))))

    assert correction.offset_g.tolist() == [0.0, 0.0, 0.0]
    assert correction.scale.tolist() == [1.0, 1.0, 1.0]


def test_a_direction_held_all_day_does_not_outvote_the_others() -> None:
    varied = np.random.default_rng(2).normal(size=(100, 3))
    still = moments(np.vstack([varied, np.tile([0.0, 0.0, 1.0], (5000, 1))]))

    assert calibrate_accelerometer(still).offset_g == pytest.approx(OFFSET_G, abs=0.002)


def test_a_few_wrong_moments_do_not_bend_it() -> None:
    still = moments(np.random.default_rng(3).normal(size=(200, 3)))
    still.gravity_g[::20] *= 1.3

    assert calibrate_accelerometer(still).offset_g == pytest.approx(OFFSET_G, abs=0.004)


def test_an_accelerometer_that_is_right_is_left_as_it_is() -> None:
    directions = np.random.default_rng(4).normal(size=(200, 3))
    still = moments(directions)
    still.gravity_g[:] = directions / np.linalg.norm(directions, axis=1, keepdims=True)

    correction = calibrate_accelerometer(still)

    assert correction.offset_g == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)


def test_what_is_beyond_any_part_is_not_believed() -> None:
    still = moments(np.random.default_rng(5).normal(size=(200, 3)))
    still.gravity_g[:] += [0.3, 0.0, 0.0]

    assert calibrate_accelerometer(still).offset_g.tolist() == [0.0, 0.0, 0.0]


def test_no_still_moment_gives_no_correction() -> None:
    assert (
        calibrate_accelerometer(moments(np.zeros((0, 3)))).directions == leave_accelerometer().directions == 0
    )
