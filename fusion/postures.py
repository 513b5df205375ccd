"""How a sensor sits on the arm, told from the directions in which gravity is seen through the day.

Most of a day the upper arm hangs within some 20 deg of the vertical, so that gravity is seen again and again
in nearly the same direction of the sensor, whatever the work is. Two stretches of a day are alike where each
knows the other's commonest direction. All comparisons are of angles between directions: how the sensor is
strapped on does not matter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.sensor_errors.accelerometer import AccelerometerCorrection
from fusion.sensor_errors.stillness import QuarterSeconds

Table = NDArray[np.float64]
NEAR_DEG = 10.0
"""Directions are counted within this angle of each other."""
MOST = 500
"""So many moments at even steps are enough to compare all with all."""
CALM_BLOCKS = 8
CALM_WITHIN_G = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Directions of gravity ``up`` (m, 3), unit vectors of the sensor, at the times ``time_s`` (m,)."""

    time_s: Table
    up: Table

    def within(self, first_s: float, end_s: float) -> "Moments":
        """Those from ``first_s`` on and before ``end_s``."""
        rows = (self.time_s >= first_s) & (self.time_s < end_s)
        return Moments(self.time_s[rows], self.up[rows])

    def thin(self, most: int = MOST) -> "Moments":
        """At most so many, at even steps."""
        step = -(-len(self.up) // most) or 1
        return Moments(self.time_s[::step], self.up[::step])


def find_calm_moments(blocks: Sequence[QuarterSeconds], accelerometer: AccelerometerCorrection) -> Moments:
    """Mean acceleration of every 2 s, at rest or in motion, where its length is within 0.1 g of gravity.

    The arm's own acceleration averages out over the swing of a walk; so a worker who never rests is seen.
    """
    times, means = zip(*(_average_blocks(run) for run in blocks), strict=True)
    time_s, acc_g = np.concatenate(times), np.concatenate(means)
    up = accelerometer.apply(acc_g, time_s)
    length = np.linalg.norm(up, axis=1)
    calm = np.abs(length - 1.0) < CALM_WITHIN_G
    return Moments(time_s[calm], up[calm] / length[calm, None])


def _average_blocks(run: QuarterSeconds) -> tuple[Table, Table]:
    count = len(run.acc) // CALM_BLOCKS
    means = run.acc[: count * CALM_BLOCKS, :3].reshape(count, CALM_BLOCKS, 3).mean(axis=1)
    time_s = run.start_s + (np.arange(count) + 0.5) * CALM_BLOCKS * run.block_s
    return np.asarray(time_s, dtype=np.float64), np.asarray(means, dtype=np.float64)


def cos_deg(angle_deg: float) -> float:
    """Cosine of an angle in degrees."""
    return float(np.cos(np.radians(angle_deg)))


def find_angle_deg(first: Table, second: Table) -> float:
    """Angle between two unit vectors."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)))


def share_near(up: Table, directions: Table) -> Table:
    """Share of the moments near each direction."""
    return np.asarray((up @ directions.T >= cos_deg(NEAR_DEG)).mean(axis=0))


def find_commonest(up: Table) -> tuple[Table, float]:
    """The commonest direction, and the share of the moments near it."""
    shares = share_near(up, up)
    best = int(np.argmax(shares))
    mean = up[up @ up[best] >= cos_deg(NEAR_DEG)].mean(axis=0)
    return mean / np.linalg.norm(mean), float(shares[best])


def compare_postures(first: Moments, second: Moments) -> tuple[float, float]:
    """Angle between the commonest directions, deg, and how well each stretch knows the other's.

    Known: the count near the other's commonest direction, as a share of the count near its own, both added: 2
    where they are the same, 0 where neither was ever near the other's.
    """
    one, other = first.thin().up, second.thin().up
    (at_one, one_share), (at_other, other_share) = find_commonest(one), find_commonest(other)
    known = share_near(other, at_one[None])[0] / other_share + share_near(one, at_other[None])[0] / one_share
    return find_angle_deg(at_one, at_other), float(known)


def build_frame(up: Table) -> Table:
    """Rows: the commonest direction, and two across it, set by the mean of all."""
    commonest, _ = find_commonest(up)
    across = np.cross(commonest, up.mean(axis=0))
    across /= max(float(np.linalg.norm(across)), 1e-9)
    return np.stack([commonest, across, np.cross(commonest, across)])
