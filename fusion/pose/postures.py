"""How a sensor sits on the arm, told from the directions in which gravity is seen through the day.

Most of a day the upper arm hangs within some 20 deg of the vertical, so that gravity is seen again and again
in nearly the same direction of the sensor. Two stretches of a day are alike where each knows the other's
commonest direction. Where they are not, the sensor may have turned, or the work was another: who drives all
afternoon holds the arm at 45 deg as often as it hung before. What parts the two is walking, in which the arm
hangs whatever the work is (:func:`find_striding_moments`). All comparisons are of angles between directions:
how the sensor is strapped on does not matter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.recording import Float64Array
from fusion.sensor.accelerometer import AccelerometerCorrection
from fusion.sensor.stillness import QuarterSeconds

NEAR_DEG = 10.0
"""Directions are counted within this angle of each other."""
MOST = 500
"""So many moments at even steps are enough to compare all with all."""
CALM_BLOCKS = 8
CALM_WITHIN_G = 0.1
STRIDING_SD_G = (0.15, 0.8)
STRIDING_WINDOWS = 5
STRIDING_WITHIN_DEG = 15.0
LEAST_STRIDING = 15
"""Half a minute of walking, in windows of 2 s."""
MINUTE_STRIDING = 30
"""One minute of it: less may be steps with a load, the arm raised (23 to 27 deg off was seen)."""


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Directions of gravity ``up`` (m, 3), unit vectors of the sensor, at the times ``time_s`` (m,)."""

    time_s: Float64Array
    up: Float64Array

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
    times, means, _ = zip(*(_average_blocks(run) for run in blocks), strict=True)
    time_s, up, calm = _take_calm(np.concatenate(times), np.concatenate(means), accelerometer)
    return Moments(time_s[calm], up[calm])


def find_striding_moments(
    blocks: Sequence[QuarterSeconds], accelerometer: AccelerometerCorrection
) -> Moments:
    """Those calm moments at which the wearer seems to walk: the arm hangs then, whatever the work is.

    Five windows of 2 s in a row or more, each shaken as by steps (standard deviation of the acceleration, the
    three axes together, 0.15 to 0.8 g) and within 15 deg of the one before. Some carrying and work at a bench
    passes for it, so that only the commonest direction of many tells. In ordinary gait it lies 14 to 18 deg
    from the arm's axis (optical capture of 16 styles, 5 to 42 over all), and 2.5 to 7 from the same person's
    relaxed stance; on the two worn upper arms among the project's recordings (45 s of walking) 6 and 10.
    """
    found = [_find_striding(run, accelerometer) for run in blocks]
    return Moments(np.concatenate([one.time_s for one in found]), np.concatenate([one.up for one in found]))


def _find_striding(run: QuarterSeconds, accelerometer: AccelerometerCorrection) -> Moments:
    time_s, acc_g, sd_g = _average_blocks(run)
    time_s, up, calm = _take_calm(time_s, acc_g, accelerometer)
    calm &= (sd_g > STRIDING_SD_G[0]) & (sd_g < STRIDING_SD_G[1])
    steady = np.zeros(len(up), dtype=np.bool_)
    steady[1:] = calm[1:] & calm[:-1] & ((up[1:] * up[:-1]).sum(axis=1) > cos_deg(STRIDING_WITHIN_DEG))
    # A run of k windows has k - 1 steady steps; number the runs and keep the long ones.
    number = np.cumsum(~steady)
    length = np.bincount(number)[number] if len(number) else number
    walks = calm & (length >= STRIDING_WINDOWS)
    return Moments(time_s[walks], up[walks])


def _take_calm(
    time_s: Float64Array, acc_g: Float64Array, accelerometer: AccelerometerCorrection
) -> tuple[Float64Array, Float64Array, NDArray[np.bool_]]:
    """Times, unit directions, and which of them are calm."""
    up = accelerometer.apply(acc_g, time_s)
    length = np.linalg.norm(up, axis=1)
    calm = np.abs(length - 1.0) < CALM_WITHIN_G
    return time_s, up / np.maximum(length, 1e-9)[:, None], np.asarray(calm)


def _average_blocks(run: QuarterSeconds) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Middle, mean acceleration and standard deviation (three axes together) of every 2 s."""
    count = len(run.acc) // CALM_BLOCKS
    blocks = run.acc[: count * CALM_BLOCKS].reshape(count, CALM_BLOCKS, 6)
    means = sum((blocks[:, k] for k in range(1, CALM_BLOCKS)), blocks[:, 0]) / CALM_BLOCKS
    variance = (means[:, 3:] - means[:, :3] ** 2).sum(axis=1)
    time_s = run.start_s + (np.arange(count) + 0.5) * CALM_BLOCKS * run.block_s
    sd_g = np.sqrt(np.maximum(variance, 0.0))
    return np.asarray(time_s), np.asarray(means[:, :3]), np.asarray(sd_g)


def cos_deg(angle_deg: float) -> float:
    """Cosine of an angle in degrees."""
    return float(np.cos(np.radians(angle_deg)))


def find_angle_deg(first: Float64Array, second: Float64Array) -> float:
    """Angle between two vectors, whatever their lengths."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)))


def share_near(up: Float64Array, directions: Float64Array) -> Float64Array:
    """Share of the moments near each direction."""
    # Not `@`: the threads it starts for so little wait longer, at work, than the product takes.
    cosines = np.einsum("md,nd->nm", up, directions)
    return np.asarray((cosines >= cos_deg(NEAR_DEG)).mean(axis=1))


def find_commonest(up: Float64Array) -> tuple[Float64Array, float]:
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


def find_hanging(strides: Moments) -> Float64Array | None:
    """The direction in which the arm hangs while walking; None where too little was walked."""
    return find_commonest(strides.thin().up)[0] if len(strides.up) >= LEAST_STRIDING else None


def compare_hanging(first: Moments, second: Moments) -> float | None:
    """Angle between the directions in which the arm hangs while walking, deg; None where one is not known."""
    one, other = find_hanging(first), find_hanging(second)
    return None if one is None or other is None else find_angle_deg(one, other)
