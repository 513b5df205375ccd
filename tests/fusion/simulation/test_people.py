"""Simulated people: how they stand and walk."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from acromion.fusion.numerics import compute_angle_deg
from acromion.fusion.simulation.activities import (
    Activity,
    Choreography,
    Person,
    draw_person,
    shift_posture,
    stand,
    walk,
)
from acromion.fusion.simulation.body import Body, compute_readings, play

RATE_HZ = 50.0
UP = np.array([0.0, 0.0, 1.0])


def find_force(person: Person, activity: Activity) -> NDArray[np.float64]:
    """Specific force on the arm, (n, 3), from 4 s after the beginning of a minute to 4 s before its end."""
    body = Choreography(person)
    activity(body, 60.0, np.random.default_rng(1))
    motion, count = body.finish(), int(body.time_s * RATE_HZ)
    edge = round(4.0 * RATE_HZ)
    return compute_readings(play(motion, 0, count, RATE_HZ), Body()).acc_g[edge:-edge]


@pytest.mark.parametrize(
    ("posture", "about", "shifted"),
    [((10.0, -60.0), 0.0, (15.0, -60.0)), ((12.0, 0.0), np.pi / 2, (13.0, np.degrees(np.arctan2(5, 12))))],
    ids=["further out in its plane", "across: the root of both squares"],
)
def test_a_posture_is_shifted_by_5_deg(
    posture: tuple[float, float], about: float, shifted: tuple[float, float]
) -> None:
    assert shift_posture(*posture, 5.0, about) == pytest.approx(shifted)


@pytest.mark.parametrize("seed", range(4))
def test_a_person_stands_with_the_arm_8_to_15_deg_from_plumb(seed: int) -> None:
    person = draw_person(np.random.default_rng(seed), is_brisk=False)

    stood_deg = compute_angle_deg(find_force(person, stand).mean(axis=0), UP)

    assert 8.0 <= person.stance_deg <= 15.0
    assert stood_deg == pytest.approx(person.stance_deg, abs=person.repeat_deg + 1.0)


@pytest.mark.parametrize("seed", range(4))
def test_walking_leads_the_arm_some_degrees_from_where_it_stands(seed: int) -> None:
    person = draw_person(np.random.default_rng(seed), is_brisk=False)
    deg, plane_deg = shift_posture(0.0, person.stance_plane_deg, person.stance_deg, 0.0)
    # the zenith as the arm sees it that is raised by that much in that plane
    stance = Rotation.from_euler("ZY", [plane_deg, deg], degrees=True).apply(UP)

    apart_deg = compute_angle_deg(find_force(person, walk).mean(axis=0), stance)

    assert 1.5 <= apart_deg <= 8.0
