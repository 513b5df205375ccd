"""What the accelerometer reads of gravity while the arm moves, and what it tells of its offset."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from acromion.fusion.orientation import estimate_vertical
from acromion.fusion.sensor.model import Nodes, SensorRun, build_identity_accelerometer
from acromion.fusion.sensor.self_calibration import (
    MovingReadings,
    bridge_saturation,
    calibrate_accelerometer,
    has_few_directions,
    read_while_moving,
)
from acromion.fusion.sensor.stillness import QuietTable, reduce_run
from tests.fusion.made_motion import angle_between_deg, rest_and_turn

PERIOD_S = 0.05
ALL_AROUND = np.random.default_rng(0).normal(size=(200, 3))
OFFSET_G = np.array([0.02, -0.03, 0.01])
Table = NDArray[np.float64]


def swing(
    seconds: float,
    amplitude_deg: float,
    offset_g: Table | None = None,
    swing_s: float = 4.0,
    arm_m: float = 0.0,
) -> Nodes:
    """A sensor that swings about its y axis, ``arm_m`` along x from it; z points up in the middle."""
    time_s, axis, arm = np.arange(0.0, seconds, PERIOD_S), np.eye(3)[1], np.array([arm_m, 0.0, 0.0]) / 9.81
    phase = 2.0 * np.pi * time_s / swing_s
    angle, rate = np.radians(amplitude_deg) * np.sin(phase), np.radians(amplitude_deg) * np.cos(phase)
    rate, bend = rate * 2.0 * np.pi / swing_s, -angle * (2.0 * np.pi / swing_s) ** 2
    pose = Rotation.from_rotvec(angle[:, None] * axis)
    own_g = rate[:, None] ** 2 * np.cross(axis, np.cross(axis, arm)) + bend[:, None] * np.cross(axis, arm)
    acc_g = pose.inv().apply([0.0, 0.0, 1.0]) + own_g + (np.zeros(3) if offset_g is None else offset_g)
    turn_rad = np.diff(angle, prepend=0.0)[:, None] * axis
    nil = np.zeros_like(acc_g)
    return Nodes(0.0, PERIOD_S, 5, acc_g, turn_rad, nil, np.eye(3))


def still(direction: tuple[float, float, float], offset_g: Table, count: int = 20) -> QuietTable:
    """At rest in one direction."""
    gravity_g = np.tile(np.array(direction) + offset_g, (count, 1))
    zeros = np.zeros(count)
    return QuietTable(np.linspace(0.0, 40.0, count), 1.5, gravity_g, np.zeros((count, 3)), zeros, zeros)


def place(directions: Table, offset_g: Table) -> MovingReadings:
    """Readings of the moving arm in these directions, one a second."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return MovingReadings(np.linspace(0.0, 40.0, len(unit)), np.asarray(unit + offset_g))


def test_a_sensor_at_rest_reads_what_it_reads() -> None:
    readings = read_while_moving([swing(10.0, 0.0, np.array([0.0, 0.0, 0.02]))])

    assert len(readings.time_s) == 7  # windows of 4 s begin at 0, 1, 2, ... 6 s
    assert readings.gravity_g == pytest.approx(np.tile([0.0, 0.0, 1.02], (7, 1)), abs=1e-9)


def test_without_the_offset_a_swinging_sensor_reads_1_g() -> None:
    readings = read_while_moving([swing(20.0, 40.0, OFFSET_G)])

    # Exact to first order in the offset: what is left is its square, 0.037^2 / 2 = 0.0007 g.
    lengths_g = np.linalg.norm(readings.gravity_g - OFFSET_G, axis=1)
    assert np.abs(lengths_g - 1.0).max() < 0.001


def test_a_sensor_off_the_axis_of_the_swing_still_reads_1_g() -> None:
    # 10 cm off, 15 deg once a second: up to 1.6 rad/s, 0.028 g of centripetal acceleration, always outwards.
    readings = read_while_moving([swing(20.0, 15.0, swing_s=1.0, arm_m=0.1)])

    assert len(readings.time_s) == 17
    assert np.abs(np.linalg.norm(readings.gravity_g, axis=1) - 1.0).max() < 0.004


def test_a_lively_window_and_a_run_shorter_than_a_window_are_left_out() -> None:
    nodes = swing(10.0, 0.0)
    nodes.acc_g[::2, 0] += 0.4
    nodes.acc_g[1::2, 0] -= 0.4

    assert len(read_while_moving([nodes]).time_s) == 0
    assert len(read_while_moving([swing(3.0, 10.0)]).time_s) == 0


def test_runs_are_read_as_each_alone() -> None:
    runs = [swing(9.0, 20.0, OFFSET_G), swing(3.0, 20.0), replace(swing(12.0, 30.0, OFFSET_G), start_s=500.0)]

    together = read_while_moving(runs)

    alone = [read_while_moving([run]) for run in runs]
    assert np.array_equal(together.time_s, np.concatenate([part.time_s for part in alone]))
    assert np.array_equal(together.gravity_g, np.concatenate([part.gravity_g for part in alone]))


def test_a_day_in_thousands_of_runs_gives_no_more_readings_than_a_whole_one() -> None:
    assert len(read_while_moving([swing(5.0, 10.0)] * 3000).time_s) == 2000  # 6000 windows, every third


def test_the_moving_arm_tells_the_offset_across_the_only_pose_at_rest() -> None:
    hanging, raised = still((0.0, 0.0, 1.0), OFFSET_G), place(ALL_AROUND, OFFSET_G)

    alone, both = calibrate_accelerometer(hanging), calibrate_accelerometer(hanging, moving=raised)

    # One direction of three known leaves sqrt(2/3) of 0.04 g.
    assert has_few_directions(hanging)
    assert both.mean_offset_g == pytest.approx(OFFSET_G, abs=0.003)
    assert alone.offset_sd_g == pytest.approx(0.033, abs=0.001)
    assert both.offset_sd_g < 0.5 * alone.offset_sd_g


def test_a_good_accelerometer_is_left_alone_whatever_the_moving_arm_shows() -> None:
    # 4 mg off: under the 1 % that a good part reads.
    offset_g = np.array([0.004, 0.0, 0.0])

    correction = calibrate_accelerometer(still((0.0, 0.0, 1.0), offset_g), moving=place(ALL_AROUND, offset_g))

    assert np.array_equal(correction.offset_g, build_identity_accelerometer().offset_g)


def test_lively_readings_of_a_good_accelerometer_take_nothing_off() -> None:
    # 60 readings, each wrong by 13 mg: 10 mg of departure and more, of which a correction explains little.
    lively = place(np.random.default_rng(3).normal(size=(60, 3)), np.zeros(3))
    lively.gravity_g[:] *= 1.0 + 0.013 * np.random.default_rng(4).choice([-1.0, 1.0], size=60)[:, None]

    correction = calibrate_accelerometer(still((0.0, 0.0, 1.0), np.zeros(3)), moving=lively)

    assert np.array_equal(correction.offset_g, build_identity_accelerometer().offset_g)
    assert correction.directions == 0


# At rest 15 mg off, in motion in three directions more hardly: on average less than 1 %.
SIDEWAYS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]] * 10)


@pytest.mark.parametrize(
    ("offset_g", "moving"),
    [
        (np.array([0.0, 0.0, 0.015]), place(SIDEWAYS, np.zeros(3))),
        (OFFSET_G, place(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]] * 20), OFFSET_G)),
    ],
    ids=["takes nothing off", "few directions"],
)
def test_a_moving_arm_that_tells_no_offset_leaves_the_still_moments_alone(
    offset_g: Table, moving: MovingReadings
) -> None:
    hanging = still((0.0, 0.0, 1.0), offset_g)

    alone, both = calibrate_accelerometer(hanging), calibrate_accelerometer(hanging, moving=moving)

    assert alone.directions == 1
    assert np.array_equal(alone.offset_g, both.offset_g)


# Samples at the end of the range are bridged, and what cannot be bridged is left alone.


def bridge(gyr: Table, **ranges: float) -> Table:
    run = SensorRun(0.0, 100.0, np.zeros((400, 3)), gyr)
    return np.asarray(bridge_saturation([run], [reduce_run(run)], **ranges)[0].gyr_dps)


def swing_fast(peak_dps: float) -> Table:
    gyr = np.zeros((400, 3))
    gyr[:, 1] = peak_dps * np.sin(2.0 * np.pi * np.arange(400) / 100.0)
    return gyr


def test_a_run_that_is_nowhere_clipped_is_given_back_as_it_is() -> None:
    run = SensorRun(0.0, 100.0, np.zeros((400, 3)), swing_fast(600.0))

    assert bridge_saturation([run], [reduce_run(run)])[0] is run


def test_the_top_of_a_swing_is_drawn_again_and_the_input_is_not_modified() -> None:
    # A sine of 600 deg/s cut at 500: 18 to 19 samples at each top. The cubic with the slopes at the cut comes
    # within a twentieth of what was lost.
    true, cut = swing_fast(600.0), np.clip(swing_fast(600.0), -500.0, 500.0)

    bridged = bridge(cut)

    assert np.abs(bridged[10:-10] - true[10:-10]).max() < 10.0
    assert np.abs(bridged[:, 1]).max() > 590.0
    assert np.abs(cut).max() == 500.0


def test_a_known_range_is_used_if_the_signal_does_not_rest_at_it() -> None:
    gyr = swing_fast(2500.0)
    gyr[25, 1], gyr[24, 1], gyr[26, 1] = 2000.0, 1999.5, 1999.5

    assert bridge(np.clip(gyr, -2000.0, 2000.0), gyr_range_dps=2000.0)[25, 1] > 2000.0


@pytest.mark.parametrize("rows", [slice(0, 20), slice(380, 400), slice(100, 160)])
def test_clipping_at_an_end_or_for_long_is_left_as_it_is(rows: slice) -> None:
    gyr = np.zeros((400, 3))
    gyr[rows, 0] = 500.0

    assert np.array_equal(bridge(gyr), gyr)


def test_small_values_that_rest_at_their_extreme_are_no_clipping() -> None:
    gyr = np.clip(swing_fast(200.0), -100.0, 100.0)

    assert np.array_equal(bridge(gyr), gyr)


def test_after_clipping_the_direction_is_right_at_once() -> None:
    # Turns of 40 to 120 deg in a third of a second, up to 720 deg/s, cut at 600; rests of two thirds.
    motion = rest_and_turn(20, seed=3)
    gyr, rate_hz = 3.0 * motion.gyr_dps, 300.0

    cut = estimate_vertical(motion.acc_g, np.clip(gyr, -600.0, 600.0), rate_hz)

    resting = np.flatnonzero(np.abs(gyr).max(axis=1) == 0.0)
    assert np.abs(gyr).max() > 610.0
    assert angle_between_deg(cut[resting], motion.up[resting]).max() < 1.0
