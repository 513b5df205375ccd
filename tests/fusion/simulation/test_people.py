"""Simulated people: how they stand and walk."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.numerics.rotations import find_angle_deg
from fusion.simulation.activities import (
    Activity,
    Choreography,
    Person,
    draw_person,
    shift_posture,
    stand,
    walk,
)
from fusion.simulation.body import Body, feel, play

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
