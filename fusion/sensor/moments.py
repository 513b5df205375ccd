"""The directions in which the sensor saw gravity, in windows of 2 s, at rest and in walking."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.numerics import cos_deg
from fusion.recording import Float64Array
from fusion.sensor.accelerometer import AccelerometerCorrection
from fusion.sensor.stillness import QuarterSeconds

MOST = 500
"""So many moments at even steps are enough to compare all with all."""
CALM_BLOCKS = 8
CALM_WITHIN_G = 0.1
STRIDING_SD_G = (0.15, 0.8)
STRIDING_WINDOWS = 5
STRIDING_WITHIN_DEG = 15.0


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Directions of gravity ``up`` (m, 3), unit vectors of the sensor, at the times ``time_s`` (m,)."""

    time_s: Float64Array
    up: Float64Array

    def select(self, rows: NDArray[np.bool_]) -> "Moments":
        """Return some of the moments."""
        return Moments(self.time_s[rows], self.up[rows])

    def within(self, first_s: float, end_s: float) -> "Moments":
        """Return those from ``first_s`` on and before ``end_s``."""
        return self.select((self.time_s >= first_s) & (self.time_s < end_s))

    def thin(self, most: int = MOST) -> "Moments":
        """Return at most so many, at even steps."""
        step = -(-len(self.up) // most) or 1
        return Moments(self.time_s[::step], self.up[::step])


def find_moments(
    blocks: Sequence[QuarterSeconds], accelerometer: AccelerometerCorrection
) -> tuple[Moments, Moments]:
    """Return the calm moments, and those of them at which the wearer seems to walk.

    Calm: the mean acceleration of 2 s is within 0.1 g of gravity.
    Walking: five windows of 2 s in a row or more, each shaken as by steps (standard deviation of the
    acceleration, the three axes together, 0.15 to 0.8 g) and within 15 deg of the one before. Some carrying
    and work at a bench passes for it, so that only the commonest direction of many tells. In ordinary gait it
    lies 14 to 18 deg from the arm's axis (optical capture of 16 styles, 5 to 42 over all), and 2.5 to 7 from
    the same person's relaxed stance; on the two worn upper arms among the project's recordings (45 s of
    walking) 6 and 10.
    """
    calm, striding = [], []
    for run in blocks:
        time_s, acc_g, sd_g = _average_blocks(run)
        up = accelerometer.apply(acc_g, time_s)
        length = np.linalg.norm(up, axis=1)
        moments = Moments(time_s, up / np.maximum(length, 1e-9)[:, None])
        is_calm = np.abs(length - 1.0) < CALM_WITHIN_G
        calm.append(moments.select(is_calm))
        is_shaken = is_calm & (sd_g > STRIDING_SD_G[0]) & (sd_g < STRIDING_SD_G[1])
        striding.append(moments.select(_find_walks(moments.up, is_shaken)))
    return _join(calm), _join(striding)


def _find_walks(up: Float64Array, is_shaken: NDArray[np.bool_]) -> NDArray[np.bool_]:
    is_steady = np.zeros(len(up), dtype=np.bool_)
    is_near = (up[1:] * up[:-1]).sum(axis=1) > cos_deg(STRIDING_WITHIN_DEG)
    is_steady[1:] = is_shaken[1:] & is_shaken[:-1] & is_near
    # A run of k windows has k - 1 steady steps; number the runs and keep the long ones.
    number = np.cumsum(~is_steady)
    length = np.bincount(number)[number] if len(number) else number
    return np.asarray(is_shaken & (length >= STRIDING_WINDOWS))


def _join(found: Sequence[Moments]) -> Moments:
    times, ups = [one.time_s for one in found], [one.up for one in found]
    return Moments(np.concatenate([np.zeros(0), *times]), np.concatenate([np.zeros((0, 3)), *ups]))


def _average_blocks(run: QuarterSeconds) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return middle, mean acceleration and standard deviation (three axes together) of every 2 s."""
    count = len(run.acc) // CALM_BLOCKS
    blocks = run.acc[: count * CALM_BLOCKS].reshape(count, CALM_BLOCKS, 6)
    means = sum((blocks[:, k] for k in range(1, CALM_BLOCKS)), blocks[:, 0]) / CALM_BLOCKS
    variance = (means[:, 3:] - means[:, :3] ** 2).sum(axis=1)
    time_s = run.start_s + (np.arange(count) + 0.5) * CALM_BLOCKS * run.block_s
    return np.asarray(time_s), np.asarray(means[:, :3]), np.asarray(np.sqrt(np.maximum(variance, 0.0)))
