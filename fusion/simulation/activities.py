"""People and their activities in a day: each activity adds movements until its time is up.

Angles and tempos are plausible, not measured. They are chosen so that a day is near published ones
(hairdressers: median 22 deg, 6.8 % of the time above 60 deg; Wahlström 2010).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from acromion.fusion.simulation.body import Channel, Motion

# Differences between people that affect the pose: how they stand, walk and repeat a posture.
#
# The figures are those of recorded motion (docs/validation.md, "Simulated people"): relaxed stance 8 to 15
# deg from plumb; in walking, the mean direction of gravity is mostly 14 to 18 deg from the arm axis (5 to 42
# over all people), and 2.5 to 7 deg from the same person's stance (15 to 23 in people who walk briskly).

STANCE_DEG, STANCE_PLANE_DEG = (8.0, 15.0), (-110.0, -10.0)
APART_DEG, BRISK_APART_DEG = (2.5, 7.0), (15.0, 23.0)
OUTWARD_SD_DEG = 30.0
"""In walking the arm is further from plumb than in standing; standard deviation of that direction."""
BRISK_SHARE = 0.2
REPEAT_DEG, SWAY_DEG = (1.5, 4.0), (0.1, 0.4)


@dataclass(frozen=True, slots=True)
class Person:
    """One worker.

    ``stance_deg``, ``stance_plane_deg``: angle from plumb of the hanging arm in relaxed standing, and its
    plane.
    ``repeat_deg``: standard deviation of each of the two components of that posture, from one time to the
    next.
    ``sway_deg``: size of the sway of an idle arm.
    ``gait_deg``, ``gait_plane_deg``: angle and plane of the mean posture in walking.
    ``step_hz``, ``swing_deg``, ``heave_m``: steps per second, half the swing of the arm, half the vertical
    movement of the trunk.
    """

    stance_deg: float
    stance_plane_deg: float
    repeat_deg: float
    sway_deg: float
    gait_deg: float
    gait_plane_deg: float
    step_hz: float
    swing_deg: float
    heave_m: float


TYPICAL = Person(11.0, -60.0, 2.5, 0.3, 15.0, -50.0, 1.8, 15.0, 0.02)


def draw_person(chance: np.random.Generator, *, is_brisk: bool | None = None) -> Person:
    """Draw a worker; one in five walks so briskly that the steps look different."""
    if is_brisk is None:
        is_brisk = bool(chance.random() < BRISK_SHARE)
    stance_deg, plane_deg = chance.uniform(*STANCE_DEG), chance.uniform(*STANCE_PLANE_DEG)
    apart_deg = chance.uniform(*(BRISK_APART_DEG if is_brisk else APART_DEG))
    gait_deg, turned_deg = shift_posture(
        stance_deg, 0.0, apart_deg, float(np.radians(chance.normal(0.0, OUTWARD_SD_DEG)))
    )
    return Person(
        stance_deg=stance_deg,
        stance_plane_deg=plane_deg,
        repeat_deg=chance.uniform(*REPEAT_DEG),
        sway_deg=chance.uniform(*SWAY_DEG),
        gait_deg=gait_deg,
        gait_plane_deg=plane_deg + turned_deg,
        step_hz=chance.uniform(2.1, 2.4) if is_brisk else chance.uniform(1.7, 1.95),
        swing_deg=chance.uniform(27.0, 40.0) if is_brisk else chance.uniform(10.0, 20.0),
        heave_m=chance.uniform(0.03, 0.04) if is_brisk else chance.uniform(0.015, 0.025),
    )


def shift_posture(deg: float, plane_deg: float, by_deg: float, towards_rad: float) -> tuple[float, float]:
    """Return elevation and plane of a posture at an angle of ``by_deg`` from another, deg.

    ``towards_rad``: 0 further from plumb in the same plane. Small angles are treated as lengths in a plane.
    """
    plane = np.radians(plane_deg)
    outward, across = deg + by_deg * np.cos(towards_rad), by_deg * np.sin(towards_rad)
    turned = plane + np.arctan2(across, outward)
    return float(np.hypot(outward, across)), float(np.degrees(turned))


# Build a motion in time order: start a movement, wait, sway in the meantime.


Pose = Mapping[Channel, float]


class Choreography:
    """The body's current pose, and the strokes and waves that led to it.

    ``time_s``: current time; ``move`` starts a movement there, ``wait`` advances it.
    ``person``: whose body it is.
    """

    def __init__(self, person: Person = TYPICAL) -> None:
        self.person = person
        self.time_s = 0.0
        self._pose = dict.fromkeys(Channel, 0.0)
        self._strokes: list[tuple[float, ...]] = []
        self._waves: list[tuple[float, ...]] = []

    @property
    def facing_deg(self) -> float:
        """The direction that the body faces, or is turning to."""
        return self._pose[Channel.HEADING]

    def move(self, duration_s: float, pose: Pose, *, after_s: float = 0.0) -> None:
        """Start a movement towards ``pose``; other channels stay. Time does not advance."""
        for channel, value in pose.items():
            change = value - self._pose[channel]
            if change != 0.0:
                self._strokes.append((channel, self.time_s + after_s, duration_s, change))
                self._pose[channel] = value

    def wait(self, duration_s: float) -> None:
        """Advance the time."""
        self.time_s += duration_s

    def go(self, duration_s: float, pose: Pose) -> None:
        """Move, and wait until the movement ends."""
        self.move(duration_s, pose)
        self.wait(duration_s)

    def sway(
        self,
        channel: Channel,
        duration_s: float,
        frequency_hz: float,
        amplitude: float,
        phase_rad: float = 0.0,
    ) -> None:
        """Start a wave that grows over a second (or a third of its length) and fades in the same way."""
        ramp_s = min(1.0, duration_s / 3)
        start_s = self.time_s
        self._waves.append(
            (channel, start_s, start_s + duration_s, ramp_s, frequency_hz, amplitude, phase_rad)
        )

    def finish(self) -> Motion:
        """Return the motion, in time order."""
        strokes = np.array(sorted(self._strokes, key=lambda row: row[1:]), dtype=np.float64).reshape(-1, 4)
        waves = np.array(sorted(self._waves, key=lambda row: row[1:]), dtype=np.float64).reshape(-1, 7)
        return Motion(strokes, waves)


Activity = Callable[[Choreography, float, np.random.Generator], None]


def place_arm(flexion_deg: float, plane_deg: float, elevation_deg: float, axial_deg: float) -> Pose:
    """Return the pose of trunk and arm."""
    return {
        Channel.FLEXION: flexion_deg,
        Channel.PLANE: plane_deg,
        Channel.ELEVATION: elevation_deg,
        Channel.AXIAL: axial_deg,
    }


HANGING = place_arm(0.0, 0.0, 0.0, 0.0)


def relax(body: Choreography, chance: np.random.Generator) -> Pose:
    """Return the pose of the relaxed, hanging arm, slightly different each time."""
    person = body.person
    by_deg = person.repeat_deg * float(np.hypot(chance.normal(), chance.normal()))
    deg, plane_deg = shift_posture(
        person.stance_deg, person.stance_plane_deg, by_deg, chance.uniform(0.0, 2.0 * np.pi)
    )
    return place_arm(0.0, plane_deg, deg, 0.0)


def tremble(body: Choreography, duration_s: float, deg: float, chance: np.random.Generator) -> None:
    """Add permanent breathing, sway and tremor; ``deg`` is the size of the slow part."""
    for channel, size, slowest_hz, fastest_hz in (
        (Channel.FLEXION, 0.8, 0.2, 0.35),
        (Channel.ELEVATION, 1.0, 0.4, 0.9),
        (Channel.AXIAL, 0.8, 0.5, 1.1),
        (Channel.PLANE, 0.8, 0.4, 1.0),
        (Channel.ELEVATION, 0.03, 8.0, 11.0),
    ):
        amplitude = deg * size * chance.uniform(0.5, 1.0)
        body.sway(
            channel, duration_s, chance.uniform(slowest_hz, fastest_hz), amplitude, chance.uniform(0.0, 6.28)
        )


def hold_still(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Hang or rest the arm as still as a person can: some tenths of a deg/s."""
    tremble(body, duration_s, 0.08, chance)
    body.wait(duration_s)


def idle(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Stand with the arm hanging and swaying slowly."""
    for channel in (Channel.FLEXION, Channel.ELEVATION, Channel.SWING):
        amplitude = body.person.sway_deg * chance.uniform(0.4, 0.8)
        body.sway(channel, duration_s, chance.uniform(0.15, 0.5), amplitude, chance.uniform(0.0, 6.28))
    hold_still(body, duration_s, chance)


def stand(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Stand with the arm hanging; it moves a little from time to time."""
    end_s = body.time_s + duration_s
    while body.time_s < end_s:
        heading_deg = body.facing_deg + chance.normal(0.0, 20.0)
        body.go(chance.uniform(0.8, 1.5), {**relax(body, chance), Channel.HEADING: heading_deg})
        idle(body, chance.uniform(3.0, 15.0), chance)


def walk(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Walk: two steps per swing of the arm, the trunk moves vertically with each step, with turns."""
    duration_s = max(duration_s, 4.0)
    end_s = body.time_s + duration_s
    gait = {Channel.PLANE: body.person.gait_plane_deg, Channel.ELEVATION: body.person.gait_deg}
    body.move(1.2, {**HANGING, **gait, Channel.SPEED: chance.uniform(1.0, 1.5)})
    _step(body, duration_s, chance)
    while body.time_s < end_s - 4.0:
        body.move(chance.uniform(1.0, 2.0), {Channel.HEADING: body.facing_deg + chance.normal(0.0, 50.0)})
        body.wait(min(chance.uniform(3.0, 12.0), end_s - 1.2 - body.time_s))
    body.wait(max(0.0, end_s - 1.2 - body.time_s))
    body.go(1.2, {Channel.SPEED: 0.0})


def _step(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Add gait: the person's own steps, slightly faster or slower each time; sizes in deg and m."""
    person = body.person
    step_hz = person.step_hz * chance.uniform(0.96, 1.04)
    swing_deg, heave_m = person.swing_deg * chance.uniform(0.9, 1.1), person.heave_m
    stride_hz, phase = step_hz / 2, chance.uniform(0.0, 6.28)
    body.sway(Channel.SWING, duration_s, stride_hz, swing_deg, phase)
    body.sway(Channel.AXIAL, duration_s, stride_hz, chance.uniform(3.0, 8.0), phase + 0.4)
    body.sway(Channel.HEADING, duration_s, stride_hz, chance.uniform(3.0, 6.0), phase)
    body.sway(Channel.FLEXION, duration_s, step_hz, chance.uniform(0.5, 1.5), phase)
    body.sway(Channel.SWAY_LEFT, duration_s, stride_hz, chance.uniform(0.01, 0.02), phase)
    body.sway(Channel.SWAY_FORWARD, duration_s, step_hz, chance.uniform(0.006, 0.012), phase + 1.0)
    body.sway(Channel.SWAY_UP, duration_s, step_hz, heave_m, phase)
    body.sway(Channel.SWAY_UP, duration_s, 2 * step_hz, chance.uniform(0.001, 0.003), phase + 2.0)


def assemble(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Work at a bench: reach, hold, small corrections."""
    end_s = body.time_s + duration_s
    tremble(body, duration_s, 0.4, chance)
    while body.time_s < end_s:
        pose = place_arm(
            chance.normal(6.0, 3.0),
            chance.uniform(-60.0, 20.0),
            float(np.clip(chance.normal(36.0, 11.0), 12.0, 75.0)),
            chance.uniform(-40.0, 30.0),
        )
        duration = chance.uniform(0.4, 1.1)
        body.move(duration, pose)
        body.wait(duration * chance.uniform(0.7, 1.0) + chance.exponential(1.5))


def pause(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Wait for a machine: the arm rests on the bench or a rail, in several places."""
    end_s = body.time_s + duration_s
    while body.time_s < end_s:
        pose = place_arm(
            chance.normal(8.0, 5.0),
            chance.uniform(-90.0, 30.0),
            chance.uniform(8.0, 60.0),
            chance.uniform(-60.0, 60.0),
        )
        body.go(chance.uniform(0.8, 1.4), pose)
        hold_still(body, chance.uniform(3.0, 12.0), chance)


def work_overhead(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Work above the shoulder: raised for some seconds, then down to get a part."""
    end_s = body.time_s + duration_s
    tremble(body, duration_s, 0.6, chance)
    while body.time_s < end_s:
        raised = place_arm(
            chance.normal(-3.0, 3.0),
            chance.uniform(-70.0, 10.0),
            chance.uniform(70.0, 135.0),
            chance.uniform(-30.0, 50.0),
        )
        body.go(chance.uniform(0.6, 1.2), raised)
        body.wait(chance.exponential(4.0))
        body.go(chance.uniform(0.6, 1.2), {Channel.ELEVATION: chance.uniform(15.0, 45.0), Channel.AXIAL: 0.0})
        body.wait(chance.exponential(2.0))


def lift(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Bend with the arm plumb, lift, carry for some steps, put down at chest height."""
    end_s = body.time_s + duration_s
    tremble(body, duration_s + 6.0, 0.4, chance)
    while body.time_s < end_s:
        bent_deg = chance.uniform(35.0, 60.0)
        body.move(1.3, {Channel.FLEXION: bent_deg, Channel.PLANE: 0.0, Channel.ELEVATION: bent_deg + 8.0})
        body.wait(1.3 + chance.exponential(0.6))
        body.go(
            1.2, {Channel.FLEXION: -3.0, Channel.ELEVATION: chance.uniform(15.0, 35.0), Channel.AXIAL: 15.0}
        )
        _carry(body, chance)
        body.go(0.9, {Channel.FLEXION: 10.0, Channel.ELEVATION: chance.uniform(45.0, 85.0)})
        body.wait(chance.exponential(0.5))
        body.go(0.9, relax(body, chance))
        body.wait(chance.exponential(1.0))


def _carry(body: Choreography, chance: np.random.Generator) -> None:
    """Walk some steps with the arm held."""
    carried_s = chance.uniform(3.0, 6.0)
    step_hz = chance.uniform(1.6, 1.8)
    body.sway(Channel.SWAY_UP, carried_s, step_hz, 0.018, 0.0)
    body.sway(Channel.ELEVATION, carried_s, step_hz, 1.5, 1.0)
    body.move(1.0, {Channel.SPEED: 1.0, Channel.HEADING: body.facing_deg + chance.normal(0.0, 45.0)})
    body.move(1.0, {Channel.SPEED: 0.0}, after_s=carried_s - 1.0)
    body.wait(carried_s)


def rest(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Sit with the arm on the table or in the lap; change the posture from time to time."""
    end_s = body.time_s + duration_s
    while body.time_s < end_s:
        pose = place_arm(
            chance.normal(0.0, 8.0),
            chance.uniform(-50.0, 20.0),
            chance.uniform(10.0, 45.0),
            chance.uniform(-30.0, 60.0),
        )
        body.go(chance.uniform(0.9, 1.8), pose)
        hold_still(body, min(chance.uniform(8.0, 45.0), max(3.0, end_s - body.time_s)), chance)


def swing(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Hammer or sweep: fast strokes up and down without a stop between them."""
    end_s = body.time_s + duration_s
    tremble(body, duration_s, 0.4, chance)
    body.go(0.6, {Channel.PLANE: chance.uniform(-60.0, 0.0), Channel.FLEXION: 5.0})
    while body.time_s < end_s:
        half_s, low_deg = chance.uniform(0.22, 0.5), chance.uniform(10.0, 30.0)
        top_deg = low_deg + min(90.0, 150.0 * half_s) * chance.uniform(0.7, 1.0)
        body.move(half_s, {Channel.ELEVATION: top_deg, Channel.AXIAL: 15.0})
        body.wait(0.9 * half_s)
        body.move(half_s, {Channel.ELEVATION: low_deg, Channel.AXIAL: -15.0})
        body.wait(0.9 * half_s)


def throw(body: Choreography, duration_s: float, chance: np.random.Generator) -> None:
    """Throw a part into a bin: wind up, throw, follow through, come to rest."""
    end_s = body.time_s + duration_s
    tremble(body, duration_s, 0.4, chance)
    while body.time_s < end_s:
        fling(body, chance.uniform(0.16, 0.24), chance)
        body.go(0.8, relax(body, chance))
        body.wait(chance.uniform(1.0, 3.0))


def fling(body: Choreography, fast_s: float, chance: np.random.Generator) -> None:
    """Throw once; the arm turns about its own axis by 100 deg in ``fast_s``."""
    body.go(0.5, {Channel.PLANE: -80.0, Channel.ELEVATION: chance.uniform(75.0, 100.0), Channel.AXIAL: -55.0})
    body.move(1.6 * fast_s, {Channel.PLANE: 5.0, Channel.FLEXION: 12.0})
    body.move(fast_s, {Channel.AXIAL: 45.0}, after_s=0.5 * fast_s)
    body.move(1.8 * fast_s, {Channel.ELEVATION: chance.uniform(45.0, 65.0)}, after_s=0.6 * fast_s)
    body.wait(2.4 * fast_s)
    body.move(0.7, {Channel.FLEXION: 0.0})


ACTIVITIES: Mapping[str, Activity] = {
    "standing": stand,
    "walking": walk,
    "assembly": assemble,
    "waiting": pause,
    "overhead": work_overhead,
    "lifting": lift,
    "swinging": swing,
    "throwing": throw,
    "break": rest,
}
