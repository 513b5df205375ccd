"""How people differ in what the pose depends on: the way they stand, walk and repeat a posture.

The figures are those of recorded motion (docs/validation.md, "Simulated people"): relaxed stance 8 to 15 deg
from plumb; in walking, gravity's mean mostly 14 to 18 deg off the arm's axis, 5 to 42 over all, 2.5 to 7 from
the same person's stance, 15 to 23 in those who walk briskly.
"""

from dataclasses import dataclass

import numpy as np

STANCE_DEG, STANCE_PLANE_DEG = (8.0, 15.0), (-110.0, -10.0)
APART_DEG, BRISK_APART_DEG = (2.5, 7.0), (15.0, 23.0)
OUTWARD_SD_DEG = 30.0
"""Walking leads the arm further from plumb than standing does; so much to either side of that."""
BRISK_SHARE = 0.2
REPEAT_DEG, SWAY_DEG = (1.5, 4.0), (0.1, 0.4)


@dataclass(frozen=True, slots=True)
class Person:
    """One worker.

    Attributes
    ----------
    stance_deg, stance_plane_deg
        How far from plumb the arm hangs in relaxed standing, and in which plane.
    repeat_deg
        Standard deviation of each of the two components of that posture, from one time to the next.
    sway_deg
        Size of the sway of an idle arm.
    gait_deg, gait_plane_deg
        The same of the mean posture in walking.
    step_hz, swing_deg, heave_m
        Steps a second, half the swing of the arm, half the rise and fall of the trunk.
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
    """Draw a worker; one in five walks so briskly that steps do not look like those of others."""
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
    """Give elevation and plane of a posture that lies ``by_deg`` from another, deg.

    ``towards_rad``: 0 further from plumb in the same plane. Small angles are taken for lengths in a plane.
    """
    plane = np.radians(plane_deg)
    outward, across = deg + by_deg * np.cos(towards_rad), by_deg * np.sin(towards_rad)
    turned = plane + np.arctan2(across, outward)
    return float(np.hypot(outward, across)), float(np.degrees(turned))
