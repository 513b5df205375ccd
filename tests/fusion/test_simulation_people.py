"""Simulated people: how they stand and walk, and the courses a day may take."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.numerics.rotations import find_angle_deg
from fusion.simulation import simulate_shift
from fusion.simulation.activities import Activity, Choreography, stand, walk
from fusion.simulation.body import Body, feel, play
from fusion.simulation.people import Person, draw_person, shift_posture
from fusion.simulation.shift import Course, SimulatedShift

RATE_HZ = 50.0
UP = np.array([0.0, 0.0, 1.0])


def draw(seed: int, *, is_brisk: bool = False) -> Person:
    return draw_person(np.random.default_rng(seed), is_brisk=is_brisk)


def find_force(person: Person, activity: Activity) -> NDArray[np.float64]:
    """Specific force on the arm, (n, 3), from 4 s after the beginning of a minute to 4 s before its end."""
    body = Choreography(person)
    activity(body, 60.0, np.random.default_rng(1))
    motion, count = body.finish(), int(body.time_s * RATE_HZ)
    edge = round(4.0 * RATE_HZ)
    return feel(play(motion, 0, count, RATE_HZ), Body()).acc_g[edge:-edge]


def simulate(course: Course, hours: float = 0.5) -> SimulatedShift:
    return simulate_shift("gt9x", hours, 2, RATE_HZ, perfect=True, course=course)


def test_a_posture_further_out_stays_in_its_plane() -> None:
    assert shift_posture(10.0, -60.0, 5.0, 0.0) == pytest.approx((15.0, -60.0))


def test_a_posture_across_lies_at_the_root_of_both_squares() -> None:
    deg, plane_deg = shift_posture(12.0, 0.0, 5.0, np.pi / 2)

    assert (deg, plane_deg) == pytest.approx((13.0, np.degrees(np.arctan2(5.0, 12.0))))


@pytest.mark.parametrize("seed", range(8))
def test_a_person_stands_with_the_arm_8_to_15_deg_from_plumb(seed: int) -> None:
    person = draw(seed)

    stood_deg = find_angle_deg(find_force(person, stand).mean(axis=0), UP)

    assert 8.0 <= person.stance_deg <= 15.0
    assert stood_deg == pytest.approx(person.stance_deg, abs=person.repeat_deg + 1.0)


@pytest.mark.parametrize("seed", range(8))
def test_walking_leads_the_arm_some_degrees_from_where_it_stands(seed: int) -> None:
    person = draw(seed)
    stance = shift_posture(0.0, person.stance_plane_deg, person.stance_deg, 0.0)
    walked = find_force(person, walk).mean(axis=0)

    apart_deg = find_angle_deg(walked, lean(*stance))

    assert 1.5 <= apart_deg <= 8.0


def lean(deg: float, plane_deg: float) -> NDArray[np.float64]:
    """The zenith as an arm sees it that is raised by ``deg`` in a plane and not turned about itself."""
    out, about = np.radians(deg), np.radians(plane_deg)
    return np.array([np.sin(out) * np.cos(about), np.sin(out) * np.sin(about), np.cos(out)])


@pytest.mark.parametrize("seed", range(4))
def test_a_brisk_walker_feels_more_than_one_g_in_the_mean(seed: int) -> None:
    mean_g = [
        np.linalg.norm(find_force(draw(seed, is_brisk=is_brisk), walk).mean(axis=0))
        for is_brisk in (False, True)
    ]

    assert mean_g[0] < 1.06 < mean_g[1]


def test_a_pose_may_be_held_again_at_noon_and_at_the_end() -> None:
    shift = simulate(Course(is_repeated=True))

    assert [round(start_s / shift.plan[-1].end_s, 1) for start_s, _ in shift.poses_s] == [0.0, 0.5, 1.0]


def test_a_pose_may_be_held_8_deg_off() -> None:
    shift = simulate(Course(tilt_deg=8.0), 0.01)

    assert shift.in_arrays().elevation_deg[: round(20.0 * RATE_HZ)] == pytest.approx(8.0, abs=0.5)


def test_a_late_pose_comes_after_two_minutes() -> None:
    assert 120.0 <= simulate(Course("late")).calibration_s[0] <= 180.0


def test_a_day_without_a_pose_names_none() -> None:
    assert simulate(Course("none")).poses_s == ()


def test_without_a_pose_no_five_seconds_of_ten_minutes_are_still() -> None:
    shift = simulate(Course("none"))
    gyr_dps = shift.in_arrays().gyr_dps[: round(600.0 * shift.rate_hz)]

    blocks = gyr_dps[: len(gyr_dps) // 250 * 250].reshape(-1, 250, 3)

    assert blocks.std(axis=1).max(axis=1).min() > 5.0


def test_a_sensor_on_a_table_is_level_and_does_not_move() -> None:
    shift = simulate(Course(table_s=30.0))
    arrays = shift.in_arrays()
    lying = slice(0, round(29.0 * shift.rate_hz))

    assert arrays.elevation_deg[lying] == pytest.approx(90.0)
    assert np.abs(arrays.gyr_dps[lying]).max() < 1e-6
    assert shift.calibration_s[0] > 33.0


def test_on_a_day_without_walking_nobody_takes_a_step() -> None:
    names = {entry.name for entry in simulate(Course(walks=False), 2.0).plan}

    assert not names & {"walking", "lifting"}
