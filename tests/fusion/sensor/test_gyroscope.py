"""The bias of the gyroscope through a recording, from rest and from motion."""

import numpy as np
import pytest
from numpy.typing import NDArray

from acromion.fusion.recording import Float64Array
from acromion.fusion.sensor.gyroscope import GyroScale, find_jumps
from acromion.fusion.sensor.model import GyroBias, SensorRun, solve_band
from acromion.fusion.sensor.self_calibration import calibrate_sensor
from acromion.fusion.sensor.stillness import find_still_moments, reduce_run
from acromion.fusion.simulation import simulate_shift
from tests.estimates import estimate_gyro_bias
from tests.fusion.made_motion import Motion, rest_and_turn, tumble
from tests.simulated_shifts import make_perfect, play_shift

OFFSET = np.array([10.0, -20.0, 15.0])


def as_run(motion: Motion, bias_dps: NDArray[np.float64], start_s: float = 0.0) -> SensorRun:
    return SensorRun(start_s, motion.rate_hz, motion.acc_g, motion.gyr_dps + bias_dps)


def test_an_offset_is_found_from_motion_alone() -> None:
    whole = as_run(tumble(300.0, seed=1, still_s=0.0), OFFSET)
    run = SensorRun(0.0, 100.0, whole.acc_g[6000:-6000], whole.gyr_dps[6000:-6000])

    bias = estimate_gyro_bias([run])

    assert bias.still_moments == 0
    assert np.abs(bias.bias_dps - OFFSET).max() < 0.1


def test_rest_and_motion_together_are_better_than_either() -> None:
    bias = estimate_gyro_bias([as_run(tumble(60.0, seed=2), OFFSET)])

    assert bias.still_moments >= 4
    assert bias.motion_windows > 10
    assert np.abs(bias.bias_dps - OFFSET).max() < 0.02


def test_a_bias_that_wanders_over_an_hour_is_followed() -> None:
    # Ten seconds of rest each minute; the bias rises by 0.5 deg/s in the hour.
    rate_hz, rows = 20.0, 72_000
    time_s = np.arange(rows) / rate_hz
    moving = (time_s % 60.0) > 10.0
    gyr = np.zeros((rows, 3))
    gyr[moving, 2] = 30.0 * np.sin(time_s[moving])
    true_bias = np.stack([0.5 * time_s / 3600.0, np.zeros(rows), np.zeros(rows)], axis=1)
    run = SensorRun(0.0, rate_hz, np.tile([0.0, 0.0, 1.0], (rows, 1)), gyr + true_bias)

    bias = estimate_gyro_bias([run])

    assert np.abs(bias.at(time_s) - true_bias).max() < 0.02


def test_a_steady_turn_mistaken_for_rest_is_outvoted() -> None:
    # Two seconds of a steady turn about the vertical look like rest with an offset of 8 deg/s.
    motion = tumble(120.0, seed=3)
    run = as_run(motion, np.zeros(3))
    run.gyr_dps[:200] = [0.0, 0.0, 8.0]

    bias = estimate_gyro_bias([run])

    assert np.abs(bias.at(np.array([60.0]))).max() < 0.1


def test_all_segments_share_one_bias() -> None:
    with_rest, without = tumble(60.0, seed=4), tumble(20.0, seed=5, still_s=0.0)

    bias = estimate_gyro_bias([as_run(with_rest, OFFSET), as_run(without, OFFSET, start_s=90.0)])

    assert np.abs(bias.at(np.array([100.0])) - OFFSET).max() < 0.05


def test_between_knots_the_bias_is_a_straight_line_and_beyond_them_constant() -> None:
    bias = GyroBias(np.array([0.0, 60.0]), np.array([[0.0, 0.0, 0.0], [6.0, 0.0, -6.0]]))

    assert bias.at(np.array([-5.0, 10.0, 70.0])).tolist() == [[0, 0, 0], [1, 0, -1], [6, 0, -6]]


@pytest.mark.parametrize(("rows", "moments"), [(1000, 6), (100, 0)])  # 10 s hold six moments of 1.5 s
def test_stillness_is_told_by_variation_and_not_by_level(rows: int, moments: int) -> None:
    acc_g, gyr_dps = np.tile([0.0, 0.0, 1.0], (rows, 1)), np.tile([0.0, 0.0, 40.0], (rows, 1))

    assert len(find_still_moments([reduce_run(SensorRun(0.0, 100.0, acc_g, gyr_dps))])) == moments


def rest_with_jump(jump_s: float, to_dps: NDArray[np.float64]) -> SensorRun:
    """Work whose gyroscope's offset is another from one sample to the next."""
    made = play_shift(make_perfect(simulate_shift("gt9x", 0.5, 1, 50.0)))
    gyr = made.gyr_dps.astype(np.float64)
    gyr[round(jump_s * 50.0) :] += to_dps
    return SensorRun(0.0, made.rate_hz, made.acc_g, gyr)


@pytest.mark.parametrize("jump_s", [300.0, 1500.0])
def test_an_offset_that_jumps_is_known_at_the_rests_before_and_after_it(jump_s: float) -> None:
    # Between the two rests nothing dates the jump.
    run = rest_with_jump(jump_s, OFFSET)
    rests = find_still_moments([reduce_run(run)])
    before_s = rests.middle_s[rests.start_s + rests.duration_s < jump_s][-1]
    after_s = rests.middle_s[rests.start_s > jump_s][0]

    before_dps, after_dps = estimate_gyro_bias([run]).at(np.array([before_s, after_s]))

    assert np.abs(before_dps).max() < 0.1
    assert np.abs(after_dps - OFFSET).max() < 0.1


@pytest.mark.parametrize("size_dps", [0.0, 2.0])
def test_an_offset_that_changes_by_little_is_one_line(size_dps: float) -> None:
    run = rest_with_jump(900.0, np.array([size_dps, 0.0, 0.0]))

    jumps_s = find_jumps(find_still_moments([reduce_run(run)]))

    assert jumps_s == []


# Gyroscope scale from still moments in different directions.

GAIN = np.array([1.01, 0.985, 1.006])


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


# Equations whose unknowns are tied to their neighbours only: their matrix is a band.

# 4 2 0     the diagonal, then the one below it
# 2 5 2
# 0 2 5
BAND = np.array([[4.0, 5.0, 5.0], [2.0, 2.0, 0.0]])


def test_each_row_of_the_right_side_is_solved_by_itself_and_what_is_given_stays() -> None:
    band, right = BAND.copy(), np.array([[8.0, 18.0, 19.0], [4.0, 2.0, 0.0]])
    given = right.copy()

    solved = solve_band(band, right)

    assert solved == pytest.approx(np.array([[1.0, 2.0, 3.0], [1.0, 0.0, 0.0]]), abs=1e-14)
    assert (band == BAND).all()
    assert (right == given).all()


def test_a_band_that_is_not_positive_definite_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        solve_band(np.array([[1.0, 1.0], [2.0, 0.0]]), np.ones((1, 2)))
