"""The ideal sensor against the same chain written out with matrices and differentiated numerically."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from acromion.fusion.recording import STANDARD_GRAVITY
from acromion.fusion.simulation.activities import Choreography
from acromion.fusion.simulation.body import Body, Channel, Motion, compute_readings, play
from acromion.fusion.simulation.shift import plan_day

FloatArray = NDArray[np.float64]

RATE_HZ = 2000.0


def play_day(first_s: float, seconds: float) -> FloatArray:
    motion = plan_day(300.0, np.random.default_rng(9))[1]
    return play(motion, int(first_s * RATE_HZ), int(seconds * RATE_HZ), RATE_HZ)


def turn_trunk(channels: FloatArray) -> Rotation:
    angles = channels[[Channel.HEADING, Channel.FLEXION], 0].T
    return Rotation.from_euler("ZY", angles, degrees=True)


def turn_arm(channels: FloatArray) -> Rotation:
    plane, elevation, axial = channels[[Channel.PLANE, Channel.ELEVATION, Channel.AXIAL], 0]
    shoulder = Rotation.from_euler("ZYZ", np.stack([plane, -elevation, axial - plane], axis=1), degrees=True)
    swing = Rotation.from_euler("Y", -channels[Channel.SWING, 0][:, None], degrees=True)
    return turn_trunk(channels) * swing * shoulder


def place_sensor(channels: FloatArray, body: Body) -> FloatArray:
    """Position in the room, m: velocity along and across the heading integrated, then the two levers."""
    heading = np.radians(channels[Channel.HEADING, 0])
    walking = channels[Channel.SPEED, 0] * np.stack([np.cos(heading), np.sin(heading), 0 * heading])
    walked = cumulative_trapezoid(walking, dx=1 / RATE_HZ, initial=0).T
    trunk, arm = turn_trunk(channels), turn_arm(channels)
    return walked + trunk.apply(body.shoulder_m) + arm.apply(body.sensor_m)


def test_the_gyroscope_reads_the_rotation_between_successive_orientations() -> None:
    channels = play_day(20.0, 30.0)
    arm = turn_arm(channels)

    state = compute_readings(channels, Body())

    turned_dps = np.degrees((arm[:-1].inv() * arm[1:]).as_rotvec()) * RATE_HZ
    assert np.abs(turned_dps - (state.gyr_dps[1:] + state.gyr_dps[:-1]) / 2).max() < 0.02


def test_the_accelerometer_reads_the_second_difference_of_the_position_and_gravity() -> None:
    channels = play_day(20.0, 30.0)
    channels[Channel.SWAY_FORWARD :] = 0.0
    place, arm = place_sensor(channels, Body()), turn_arm(channels)

    state = compute_readings(channels, Body())

    moved = (place[2:] - 2 * place[1:-1] + place[:-2]) * RATE_HZ**2
    moved[:, 2] += STANDARD_GRAVITY
    felt_g = arm[1:-1].inv().apply(moved) / STANDARD_GRAVITY
    off_g = np.abs(felt_g - state.acc_g[1:-1]).max(axis=1)
    assert np.percentile(off_g, 99.9) < 1e-4  # the rest: where a stroke begins or ends, jerk has a step
    assert off_g.max() < 0.01


def stand(**values: tuple[int, float]) -> FloatArray:
    """Return one moment with these channels at (order of the derivative, value) and all others nil."""
    channels = np.zeros((len(Channel), 3, 1))
    for name, (order, value) in values.items():
        channels[Channel[name], order] = value
    return channels


def test_the_sway_of_the_pelvis_is_felt_along_the_heading() -> None:
    swaying = stand(
        HEADING=(0, 90.0), SWAY_UP=(2, STANDARD_GRAVITY), SWAY_FORWARD=(2, 0.5 * STANDARD_GRAVITY)
    )

    assert compute_readings(swaying, Body()).acc_g[0] == pytest.approx([0.5, 0.0, 2.0])


def test_turning_while_walking_pulls_inwards() -> None:
    state = compute_readings(stand(HEADING=(1, 90.0), SPEED=(0, 1.2)), Body((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))

    assert state.acc_g[0, 1] == pytest.approx(1.2 * np.pi / 2 / STANDARD_GRAVITY)


def test_the_field_is_that_of_the_room_seen_from_the_arm() -> None:
    channels = play_day(30.0, 1.0)

    state = compute_readings(channels, Body())

    assert np.allclose(state.field_ut, turn_arm(channels).inv().apply(Body().field_ut), atol=1e-9)


@pytest.mark.parametrize(
    ("flexion_deg", "plane_deg", "raised_deg", "elevation_deg"),
    [(0, 0, 0, 0), (0, 37, 120, 120), (50, 0, 50, 0), (50, 0, 0, 50), (30, 0, 90, 60)],
)
def test_elevation_is_the_angle_to_gravity_whatever_the_trunk_does(
    flexion_deg: float, plane_deg: float, raised_deg: float, elevation_deg: float
) -> None:
    state = compute_readings(
        stand(FLEXION=(0, flexion_deg), PLANE=(0, plane_deg), ELEVATION=(0, raised_deg)), Body()
    )

    assert state.elevation_deg[0] == pytest.approx(elevation_deg, abs=1e-9)
    assert state.acc_g[0, 2] == pytest.approx(np.cos(np.radians(elevation_deg)))  # at rest: gravity alone


# Joint motion: strokes, waves, and that any stretch can be played on its own.


def make_day() -> Motion:
    return plan_day(120.0, np.random.default_rng(2))[1]


def test_a_stroke_is_half_way_and_fastest_at_half_time_and_stays_at_its_end() -> None:
    body = Choreography()
    body.move(2.0, {Channel.ELEVATION: 90.0})

    motion = body.finish()

    value, rate, _ = play(motion, 0, 31, 10.0)[Channel.ELEVATION]
    assert value[10] == pytest.approx(45.0, abs=1e-12)
    assert rate[10] == pytest.approx(15 / 8 * 45.0)
    later = play(motion, 500, 10, 10.0)[Channel.ELEVATION]
    assert np.all(later == np.array([90.0, 0.0, 0.0])[:, None])


def test_strokes_add_up() -> None:
    body = Choreography()
    body.move(1.0, {Channel.PLANE: 30.0})
    body.wait(0.5)
    body.move(1.0, {Channel.PLANE: -10.0})

    value = play(body.finish(), 0, 40, 10.0)[Channel.PLANE, 0]

    assert value[-1] == pytest.approx(-10.0, abs=1e-12)


def test_a_wave_reaches_its_amplitude_between_swelling_and_fading_and_ends() -> None:
    body = Choreography()
    body.sway(Channel.AXIAL, 6.0, 2.0, 5.0)

    value = play(body.finish(), 0, 7000, 1000.0)[Channel.AXIAL, 0]

    assert value[1000:5000].max() == pytest.approx(5.0, abs=1e-4)
    assert np.all(value[6000:] == 0.0)


@pytest.mark.parametrize("order", [1, 2])
def test_each_derivative_is_the_slope_of_the_one_before(order: int) -> None:
    channels = play(make_day(), 0, 60_000, 1000.0)

    slope = np.gradient(channels[:, order - 1], 1e-3, axis=1)[:, 1:-1]

    scale = np.abs(channels[:, order]).max(axis=1, keepdims=True) + 1.0
    assert np.abs((slope - channels[:, order, 1:-1]) / scale).max() < 0.01


@settings(max_examples=20, deadline=None)
@given(first=st.integers(0, 9000), count=st.integers(1, 2000))
def test_a_stretch_played_alone_equals_the_same_stretch_of_the_whole(first: int, count: int) -> None:
    day = make_day()

    alone = play(day, first, count, 100.0)

    assert np.allclose(alone, play(day, 0, 12_000, 100.0)[:, :, first : first + count], rtol=0, atol=1e-9)
