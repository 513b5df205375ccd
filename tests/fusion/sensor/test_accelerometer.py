"""Offset and scale of the accelerometer from still moments."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from acromion.fusion.sensor.self_calibration import calibrate_accelerometer
from acromion.fusion.sensor.stillness import QuietTable

OFFSET_G = np.array([0.03, -0.02, 0.04])
SCALE = np.array([1.01, 0.995, 0.99])


def moments(directions: NDArray[np.float64], drift_g: NDArray[np.float64] | float = 0.0) -> QuietTable:
    """Return what a sensor with this offset and scale reads at rest in each direction, 7.2 s apart."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    count = len(unit)
    nothing, time_s = np.zeros(count), 7.2 * np.arange(count, dtype=np.float64)
    return QuietTable(time_s, 1.5, unit / SCALE + OFFSET_G + drift_g, np.zeros((count, 3)), nothing, nothing)


def turn_about(seed: int, count: int = 200) -> NDArray[np.float64]:
    return np.random.default_rng(seed).normal(size=(count, 3))


UP = np.tile([0.0, 0.0, 1.0], (300, 1))


def test_many_directions_tell_offset_and_scale_so_that_each_reads_1_g() -> None:
    still = moments(turn_about(0))

    correction = calibrate_accelerometer(still)

    corrected = correction.apply(still.gravity_g, still.middle_s)
    assert correction.mean_offset_g == pytest.approx(OFFSET_G, abs=0.001)
    assert correction.gain == pytest.approx(np.diag(SCALE), abs=0.001)
    assert np.abs(np.linalg.norm(corrected, axis=1) - 1.0).max() < 0.002


def test_an_offset_that_grows_as_the_sensor_warms_up_is_followed() -> None:
    # 4 mg more on x over a day of 4000 moments: 8 h.
    warming = np.array([0.004, 0.0, 0.0])

    correction = calibrate_accelerometer(
        moments(turn_about(6, 4000), np.linspace(0.0, 1.0, 4000)[:, None] * warming)
    )

    assert correction.offset_g[0] == pytest.approx(OFFSET_G, abs=0.001)
    assert correction.offset_g[-1] == pytest.approx(OFFSET_G + warming, abs=0.001)


def test_a_single_pose_tells_only_what_lies_along_it() -> None:
    # Reads 1/0.99 + 0.04 = 1.0501 g upwards: 0.0501 g too long. The offset's expected 0.04 g takes
    # 16/17 of it and the scale's 1 % the rest; across the pose nothing is known and nothing is taken off.
    still = moments(UP)
    still.gravity_g[:, :2] = 0.0

    correction = calibrate_accelerometer(still)

    assert correction.mean_offset_g == pytest.approx([0.0, 0.0, 0.0501 * 16.0 / 17.0], abs=0.001)
    assert correction.offset_sd_g > 0.03


@pytest.mark.parametrize("length_g", [1.0, 1.008], ids=["1 g", "8 mg: as likely the gain of a good part"])
def test_a_small_departure_in_a_single_pose_is_left_alone(length_g: float) -> None:
    still = moments(UP)
    still.gravity_g[:] = [0.0, 0.0, length_g]

    correction = calibrate_accelerometer(still)

    assert np.abs(correction.offset_g).max() < 1e-9
    assert correction.gain == pytest.approx(np.eye(3), abs=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_sensor_strapped_on_another_way_gets_the_same_correction_turned(seed: int) -> None:
    still = moments(turn_about(7, 60))
    turn = Rotation.random(random_state=seed).as_matrix()

    straight = calibrate_accelerometer(still).apply(still.gravity_g, still.middle_s)
    still.gravity_g[:] = still.gravity_g @ turn.T
    turned = calibrate_accelerometer(still).apply(still.gravity_g, still.middle_s)

    assert turned == pytest.approx(straight @ turn.T, abs=1e-9)


def test_a_direction_held_all_day_does_not_outvote_the_others() -> None:
    still = moments(np.vstack([turn_about(2, 100), np.tile(UP[0], (5000, 1))]))

    assert calibrate_accelerometer(still).mean_offset_g == pytest.approx(OFFSET_G, abs=0.002)


def test_a_few_wrong_moments_do_not_bend_it() -> None:
    still = moments(turn_about(3))
    still.gravity_g[::20] *= 1.3

    assert calibrate_accelerometer(still).mean_offset_g == pytest.approx(OFFSET_G, abs=0.004)


def test_what_is_beyond_any_part_is_not_believed() -> None:
    still = moments(turn_about(5), np.array([0.3, 0.0, 0.0]))

    assert calibrate_accelerometer(still).mean_offset_g.tolist() == [0.0, 0.0, 0.0]


def test_no_still_moment_gives_no_correction() -> None:
    assert calibrate_accelerometer(moments(np.zeros((0, 3)))).directions == 0
