"""Offset and scale of the accelerometer from still moments."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusion.sensor.accelerometer import calibrate_accelerometer, leave_accelerometer
from fusion.sensor.stillness import QuietTable

OFFSET_G = np.array([0.03, -0.02, 0.04])
SCALE = np.array([1.01, 0.995, 0.99])
EVERY_S = 2.0


def moments(
    directions: NDArray[np.float64], warming_g: NDArray[np.float64] | None = None, every_s: float = EVERY_S
) -> QuietTable:
    """What a sensor with the offset and scale above reads at rest in these directions, one after the other;
    ``warming_g`` is added to its offset little by little until the end.
    """
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    count = len(unit)
    drift = np.linspace(0.0, 1.0, count)[:, None] * (np.zeros(3) if warming_g is None else warming_g)
    return QuietTable(
        np.asarray(every_s * np.arange(count), dtype=np.float64),
        1.5,
        unit / SCALE + OFFSET_G + drift,
        np.zeros((count, 3)),
        np.zeros(count),
        np.zeros(count),
    )


def test_many_directions_tell_offset_and_scale() -> None:
    directions = np.random.default_rng(0).normal(size=(200, 3))

    correction = calibrate_accelerometer(moments(directions))

    assert correction.mean_offset_g == pytest.approx(OFFSET_G, abs=0.001)
    assert correction.gain == pytest.approx(np.diag(SCALE), abs=0.001)


def test_the_correction_makes_every_direction_1_g() -> None:
    still = moments(np.random.default_rng(1).normal(size=(200, 3)))

    corrected = calibrate_accelerometer(still).apply(still.gravity_g, still.middle_s)

    assert np.abs(np.linalg.norm(corrected, axis=1) - 1.0).max() < 0.002


def test_an_offset_that_grows_as_the_sensor_warms_up_is_followed() -> None:
    # 4 mg more on x over a day of 4000 moments, 7.2 s apart: 8 h.
    warming = np.array([0.004, 0.0, 0.0])
    still = moments(np.random.default_rng(6).normal(size=(4000, 3)), warming, every_s=7.2)

    correction = calibrate_accelerometer(still)

    assert correction.offset_g[0] == pytest.approx(OFFSET_G, abs=0.001)
    assert correction.offset_g[-1] == pytest.approx(OFFSET_G + warming, abs=0.001)


def test_a_single_pose_tells_only_what_lies_along_it() -> None:
    # Reads 1/0.99 + 0.04 = 1.0501 g upwards: 0.0501 g too long. The offset's expected 0.04 g takes
    # 16/17 of it and the scale's 1 % the rest; across the pose nothing is known and nothing is taken off.
    still = moments(np.tile([0.0, 0.0, 1.0], (300, 1)))
    still.gravity_g[:, :2] = 0.0

    correction = calibrate_accelerometer(still)

    assert correction.mean_offset_g == pytest.approx([0.0, 0.0, 0.0501 * 16.0 / 17.0], abs=0.001)
    assert correction.offset_sd_g > 0.03


def test_a_single_pose_that_reads_1_g_gives_no_correction() -> None:
    still = moments(np.tile([0.0, 0.0, 1.0], (300, 1)))
    still.gravity_g[:] = [0.0, 0.0, 1.0]

    correction = calibrate_accelerometer(still)

    assert correction.offset_g == pytest.approx(np.zeros_like(correction.offset_g), abs=1e-9)
    assert correction.gain == pytest.approx(np.eye(3), abs=1e-9)


def test_a_small_departure_in_a_single_pose_is_left_alone() -> None:
    # 8 mg: as likely the gain of a good part as an offset.
    still = moments(np.tile([0.0, 0.0, 1.0], (300, 1)))
    still.gravity_g[:] = [0.0, 0.0, 1.008]

    assert calibrate_accelerometer(still).directions == 0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_a_sensor_strapped_on_another_way_gets_the_same_correction_turned(seed: int) -> None:
    still = moments(np.random.default_rng(7).normal(size=(60, 3)))
    turn = Rotation.random(random_state=seed).as_matrix()

    straight = calibrate_accelerometer(still).apply(still.gravity_g, still.middle_s)
    still.gravity_g[:] = still.gravity_g @ turn.T
    turned = calibrate_accelerometer(still).apply(still.gravity_g, still.middle_s)

    assert turned == pytest.approx(straight @ turn.T, abs=1e-9)


def test_a_direction_held_all_day_does_not_outvote_the_others() -> None:
    varied = np.random.default_rng(2).normal(size=(100, 3))
    still = moments(np.vstack([varied, np.tile([0.0, 0.0, 1.0], (5000, 1))]))

    assert calibrate_accelerometer(still).mean_offset_g == pytest.approx(OFFSET_G, abs=0.002)


def test_a_few_wrong_moments_do_not_bend_it() -> None:
    still = moments(np.random.default_rng(3).normal(size=(200, 3)))
    still.gravity_g[::20] *= 1.3

    assert calibrate_accelerometer(still).mean_offset_g == pytest.approx(OFFSET_G, abs=0.004)


def test_an_accelerometer_that_is_right_is_left_as_it_is() -> None:
    directions = np.random.default_rng(4).normal(size=(200, 3))
    still = moments(directions)
    still.gravity_g[:] = directions / np.linalg.norm(directions, axis=1, keepdims=True)

    correction = calibrate_accelerometer(still)

    assert correction.offset_g == pytest.approx(np.zeros_like(correction.offset_g), abs=1e-6)


def test_what_is_beyond_any_part_is_not_believed() -> None:
    still = moments(np.random.default_rng(5).normal(size=(200, 3)))
    still.gravity_g[:] += [0.3, 0.0, 0.0]

    assert calibrate_accelerometer(still).mean_offset_g.tolist() == [0.0, 0.0, 0.0]


def test_no_still_moment_gives_no_correction() -> None:
    assert (
        calibrate_accelerometer(moments(np.zeros((0, 3)))).directions == leave_accelerometer().directions == 0
    )
