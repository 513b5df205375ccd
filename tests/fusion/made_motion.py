"""Motion to order for the estimators: any smooth tumbling with its exact vertical."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What a perfect sensor reads, and the true unit vector to the zenith in its frame, all (n, 3)."""

    acc_g: Array
    gyr_dps: Array
    up: Array
    rate_hz: float


def tumble(seconds: float = 20.0, rate_hz: float = 100.0, seed: int = 0, still_s: float = 4.0) -> Motion:
    """Rest, then turn in all directions at up to about 200 deg/s without accelerating, then rest.

    The angles are sines under a smooth window, so the rates are their exact derivatives.
    """
    rng = np.random.default_rng(seed)
    time_s = np.arange(round(seconds * rate_hz)) / rate_hz
    inside = np.clip((time_s - still_s) / (seconds - 2.0 * still_s), 0.0, 1.0)
    window = np.sin(np.pi * inside) ** 2
    slope = np.where((inside > 0.0) & (inside < 1.0), np.pi * np.sin(2.0 * np.pi * inside), 0.0)
    slope = slope / (seconds - 2.0 * still_s)
    angle, speed = np.zeros((3, len(time_s))), np.zeros((3, len(time_s)))
    for axis in range(3):
        size, frequency, phase = (
            rng.uniform(0.5, 1.2),
            2.0 * np.pi * rng.uniform(0.2, 0.5),
            rng.uniform(0.0, 6.0),
        )
        angle[axis] = size * window * np.sin(frequency * time_s + phase)
        speed[axis] = size * (
            slope * np.sin(frequency * time_s + phase)
            + window * frequency * np.cos(frequency * time_s + phase)
        )
    return _sense(angle, speed, rate_hz)


def _sense(angle: Array, speed: Array, rate_hz: float) -> Motion:
    """Heading, pitch, roll (rad) and their derivatives to what the sensor reads (Euler angles)."""
    yaw, pitch, roll = angle
    body = np.stack(
        [
            speed[2] - speed[0] * np.sin(pitch),
            speed[1] * np.cos(roll) + speed[0] * np.sin(roll) * np.cos(pitch),
            -speed[1] * np.sin(roll) + speed[0] * np.cos(roll) * np.cos(pitch),
        ],
        axis=1,
    )
    to_world = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1))
    up = to_world.inv().apply(np.array([0.0, 0.0, 1.0]))
    return Motion(up.copy(), np.degrees(body), up, rate_hz)


def angle_between_deg(first: Array, second: Array) -> Array:
    """Angle between the rows of two (n, 3) arrays."""
    across = np.linalg.norm(np.cross(first, second), axis=1)
    return np.asarray(np.degrees(np.arctan2(across, np.sum(first * second, axis=1))))


def rest_and_turn(turns: int, seed: int = 0, rate_hz: float = 100.0) -> Motion:
    """Rest for 2 s, turn by 40 to 120 deg about any axis in 1 s, rest again, and so on.

    The share of each turn that is done at time t is ``t - sin(2 pi t) / (2 pi)``, so that rates are exact.
    """
    rng = np.random.default_rng(seed)
    time_s = np.arange(round(rate_hz)) / rate_hz
    done, speed = time_s - np.sin(2.0 * np.pi * time_s) / (2.0 * np.pi), 1.0 - np.cos(2.0 * np.pi * time_s)
    now, rest = Rotation.identity(), round(2.0 * rate_hz)
    ups, rates = [], []
    for _ in range(turns):
        axis = rng.normal(size=3)
        whole = axis / np.linalg.norm(axis) * np.radians(rng.uniform(40.0, 120.0))
        ups += [np.tile(_see_up(now), (rest, 1)), _see_up(now * Rotation.from_rotvec(done[:, None] * whole))]
        rates += [np.zeros((rest, 3)), speed[:, None] * whole]
        now = now * Rotation.from_rotvec(whole)
    up = np.concatenate(ups)
    return Motion(up.copy(), np.degrees(np.concatenate(rates)), up, rate_hz)


def _see_up(to_world: Rotation) -> Array:
    return np.asarray(to_world.inv().apply(np.array([0.0, 0.0, 1.0])))
