"""Find when the sensor was worn, how the arm hangs in walking, and when the sensor may have moved.

A recording is split at times when the sensor may have been off the arm: five minutes or more on a table
(:func:`acromion.fusion.pose.calibrate.find_tables`), or a gap of that length.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.numerics import compute_angle_deg, compute_rotation, cos_deg
from acromion.fusion.recording import Float64Array
from acromion.fusion.sensor.model import AccelerometerCorrection
from acromion.fusion.sensor.stillness import QuarterSeconds

# Directions of gravity in the sensor, in windows of 2 s, at rest and in walking.

MAX_MOMENTS = 500
"""This many moments at even steps are enough to compare all pairs."""
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
        """Return the moments from ``first_s`` on and before ``end_s``."""
        return self.select((self.time_s >= first_s) & (self.time_s < end_s))

    def thin(self, most: int = MAX_MOMENTS) -> "Moments":
        """Return at most ``most`` moments, at even steps."""
        step = -(-len(self.up) // most) or 1
        return Moments(self.time_s[::step], self.up[::step])


def find_moments(
    blocks: Sequence[QuarterSeconds], accelerometer: AccelerometerCorrection
) -> tuple[Moments, Moments]:
    """Return the calm moments, and the calm moments in which the wearer seems to walk.

    Calm: the mean acceleration of 2 s is within 0.1 g of gravity. Walking: at least five consecutive windows
    of 2 s, each with step-like shaking (standard deviation of the acceleration, the three axes together, 0.15
    to 0.8 g) and within 15 deg of the one before. Some carrying and bench work also fits this, so only the
    most common direction of many is used. In ordinary gait this direction is 14 to 18 deg from the arm axis
    (optical capture of 16 styles; 5 to 42 deg over all styles), and 2.5 to 7 deg from the same person's
    relaxed stance. In the two upper-arm recordings of the project (45 s of walking) it is 6 and 10 deg from
    the arm axis.
    """
    calm, striding = [], []
    for run in blocks:
        count = len(run.acc) // CALM_BLOCKS
        quarters = run.acc[: count * CALM_BLOCKS].reshape(count, CALM_BLOCKS, 6)
        means = sum((quarters[:, k] for k in range(1, CALM_BLOCKS)), quarters[:, 0]) / CALM_BLOCKS
        acc_g: Float64Array = np.asarray(means[:, :3])
        variance = (means[:, 3:] - acc_g**2).sum(axis=1)
        sd_g = np.sqrt(np.maximum(variance, 0.0))  # of the three axes together
        time_s: Float64Array = np.asarray(run.start_s + (np.arange(count) + 0.5) * CALM_BLOCKS * run.block_s)
        up = accelerometer.apply(acc_g, time_s)
        length = np.linalg.norm(up, axis=1)
        moments = Moments(time_s, up / np.maximum(length, 1e-9)[:, None])
        is_calm = np.abs(length - 1.0) < CALM_WITHIN_G
        calm.append(moments.select(is_calm))
        is_shaken = is_calm & (sd_g > STRIDING_SD_G[0]) & (sd_g < STRIDING_SD_G[1])
        is_steady = np.zeros(count, dtype=np.bool_)
        is_near = (moments.up[1:] * moments.up[:-1]).sum(axis=1) > cos_deg(STRIDING_WITHIN_DEG)
        is_steady[1:] = is_shaken[1:] & is_shaken[:-1] & is_near
        # A run of k windows has k - 1 steady steps; number the runs and keep the long ones.
        number = np.cumsum(~is_steady)
        steps = np.bincount(number)[number] if count else number
        striding.append(moments.select(is_shaken & (steps >= STRIDING_WINDOWS)))
    return _join(calm), _join(striding)


def _join(found: Sequence[Moments]) -> Moments:
    times, ups = [one.time_s for one in found], [one.up for one in found]
    return Moments(np.concatenate([np.zeros(0), *times]), np.concatenate([np.zeros((0, 3)), *ups]))


# The stretches of wear.

HOLE_S = 300.0
LEAST_SHARE = 0.15
"""Share of the calm moments of the longest stretch; with fewer, the sensor was in a bag or in a hand."""
Cut = tuple[float, float]
"""Start and end of a stretch in which the sensor may have been off, s."""


@dataclass(frozen=True, slots=True, eq=False)
class Wear:
    """A stretch of wear, from ``worn_from_s`` at the earliest; ``off_s``: how long it was off before.

    ``calm``: directions of gravity.
    ``strides``: the same while the wearer seemed to walk.
    """

    start_s: float
    end_s: float
    worn_from_s: float
    off_s: float
    calm: Moments
    strides: Moments


def divide_by_wear(
    blocks: Sequence[QuarterSeconds], accelerometer: AccelerometerCorrection, tables_s: Sequence[Cut]
) -> tuple[Wear, ...]:
    """Return the substantial stretches of wear, at least one; together they cover the whole recording."""
    ends_s = [(run.start_s, run.start_s + len(run.acc) * run.block_s) for run in blocks]
    holes_s = [(before[1], after[0]) for before, after in pairwise(ends_s) if after[0] - before[1] >= HOLE_S]
    cuts = sorted([*tables_s, *holes_s])
    calm, strides = find_moments(blocks, accelerometer)
    for off_s, on_s in cuts:
        calm = calm.select((calm.time_s <= off_s) | (calm.time_s >= on_s))
    edges_s = [-np.inf, *((off_s + on_s) / 2.0 for off_s, on_s in cuts), np.inf]
    worn = [len(calm.within(*span_s).up) for span_s in pairwise(edges_s)]
    opened_s = blocks[0].start_s if blocks else 0.0
    openings = [(opened_s, opened_s), *cuts]
    kept = [k for k, count in enumerate(worn) if count >= LEAST_SHARE * max(worn)]
    starts_s = [-np.inf, *(edges_s[k] for k in kept[1:]), np.inf]
    return tuple(
        Wear(
            *span_s,
            openings[k][1],
            openings[k][1] - openings[k][0],
            calm.within(*span_s),
            strides.within(*span_s),
        )
        for k, span_s in zip(kept, pairwise(starts_s), strict=True)
    )


def find_wear(wears: Sequence[Wear], time_s: float) -> Wear:
    """Return the stretch of wear that contains a time."""
    return next(wear for wear in reversed(wears) if wear.start_s <= time_s)


# How the arm hangs in walking, and when the sensor may have moved on it. Only a person can confirm that it
# moved.
#
# A slip is visible if the person walked for half a minute before and after it, and the arm hung steadily in
# two different directions. Without walking, a slip looks like other work.

NEAR_DEG = 10.0
"""A direction counts as near within this angle."""
LEAST_STRIDING = 15
"""Half a minute of walking, in windows of 2 s."""
MINUTE_STRIDING = 30
STEADY_SHARE = 0.75
"""In recorded motion 93 to 100 % of walking was within 10 deg of its most common direction, and 55 to 62 % of
fast work that looks like walking.
"""
MOVED_DEG = 12.0
OWN_SHARE, OTHER_SHARE, TOLD_SHARE = 0.6, 0.2, 0.97
PLACES, MOST_STRIDES, LEAST_REST = 60, 150, 60
ALIKE_SHARE, MOVED_SHARE = 0.8, 0.5
"""In recorded motion 0.85 to 1.05 without a slip, at most 0.69 after a slip of 20 deg, 0.38 after 45 deg."""
ANSWER_S = 600.0
"""Accuracy of the time that a person states."""


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """The sensor may have moved between two times.

    ``kind``: "slip" while it was worn, "put_back" after it was off, "poses" between two that disagree.
    ``apart_deg``: by how much, if known.
    ``turn`` (3, 3): rotation from the axis before to the axis after, which applies until ``until_s``; None if
    unknown.
    """

    kind: Literal["slip", "put_back", "poses"]
    first_s: float
    end_s: float
    apart_deg: float = 0.0
    turn: Float64Array | None = None
    until_s: float = np.inf

    def is_answered(self, times_s: Sequence[float]) -> bool:
        """Return whether a person stated a time within it, or near it."""
        return any(self.first_s - ANSWER_S <= time_s <= self.end_s + ANSWER_S for time_s in times_s)


def share_near(up: Float64Array, directions: Float64Array) -> Float64Array:
    """Return the share of the moments near each direction."""
    # Not `@`: for such a small product, its threads take longer to start than to compute.
    cosines = np.einsum("md,nd->nm", up, directions)
    return np.asarray((cosines >= cos_deg(NEAR_DEG)).mean(axis=1))


def find_commonest(up: Float64Array) -> tuple[Float64Array, float]:
    """Return the most common direction, and the share of the moments near it."""
    shares = share_near(up, up)
    best = int(np.argmax(shares))
    mean = up[up @ up[best] >= cos_deg(NEAR_DEG)].mean(axis=0)
    return mean / np.linalg.norm(mean), float(shares[best])


def find_walking(strides: Moments) -> Float64Array | None:
    """Return how the arm hung in at least a minute of walking, mostly in one direction; None otherwise.

    Fast work looks like walking, but not in one direction.
    """
    if len(strides.up) < MINUTE_STRIDING:
        return None
    direction, share = find_commonest(strides.thin().up)
    return direction if share >= STEADY_SHARE else None


def find_slip(strides: Moments, calm: Moments) -> Question | None:
    """Return the slip that walking shows within one stretch of wear; None if there is none.

    The other postures must also have changed. If they have not, the person carries loads.
    """
    few = strides.thin(4 * MOST_STRIDES)
    count = len(few.up)
    if count < 2 * LEAST_STRIDING:
        return None
    edges = np.unique(np.linspace(LEAST_STRIDING, count - LEAST_STRIDING, PLACES).astype(np.intp))
    sides = [
        tuple(find_commonest(up[:: -(-len(up) // MOST_STRIDES)]) for up in (few.up[:edge], few.up[edge:]))
        for edge in edges
    ]
    scores = [edge * one[1] + (count - edge) * two[1] for edge, (one, two) in zip(edges, sides, strict=True)]
    edge, ((before, before_share), (after, after_share)) = (
        edges[np.argmax(scores)],
        sides[int(np.argmax(scores))],
    )
    apart_deg = compute_angle_deg(before, after)
    knows = max(share_near(few.up[:edge], after[None])[0], share_near(few.up[edge:], before[None])[0])
    if apart_deg < MOVED_DEG or min(before_share, after_share) < OWN_SHARE or knows > OTHER_SHARE:
        return None
    likely = edges[np.array(scores) >= TOLD_SHARE * max(scores)]
    first_s, end_s = float(few.time_s[likely[0] - 1]), float(few.time_s[likely[-1]])
    rest = calm.select(~np.isin(calm.time_s, strides.time_s))
    earlier, later = rest.within(-np.inf, first_s).thin().up, rest.within(end_s, np.inf).thin().up
    if min(len(earlier), len(later)) >= LEAST_REST and compare_postures(earlier, later) > ALIKE_SHARE:
        return None
    return Question("slip", first_s, end_s, apart_deg, compute_rotation(before, after))


def compare_postures(earlier: Float64Array, later: Float64Array) -> float:
    """Return the similarity of the postures of two stretches, relative to that within each."""
    own = np.mean([share_near(*np.array_split(side, 2)).mean() for side in (earlier, later)])
    return float(share_near(earlier, later).mean() / max(own, 1e-9))
