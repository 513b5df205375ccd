"""Still moments and the rotation between them: the evidence for unit, frame and axes of a gyroscope.

In the sensor frame gravity turns by da/dt = a x w. From moments at which the arm was still, gravity is
carried along the gyroscope to the next still moment and compared with what the accelerometer reads there.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.recording import Segment

PROBED_BLOCKS = 150
BLOCK_S = 8.0
STILL_S = 0.05
LONGEST_PAIR_S = 2.0
OFFSET_S = 0.5
RESTING_PART = 0.02
"""The gyroscope rests where it scatters by less than this part of its liveliest stretch."""
MIN_TILT_DEG = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class StillPair:
    """Two still moments and the angular rates from one to the other, deg/s, shape (n, 3)."""

    before_g: NDArray[np.float64]
    after_g: NDArray[np.float64]
    gyr_dps: NDArray[np.float64]
    period_s: float


@njit(cache=True, nogil=True)
def carry_gravity(
    gravity: NDArray[np.float64], gyr_dps: NDArray[np.float64], factor: float, period_s: float
) -> NDArray[np.float64]:
    """Turn a vector fixed in space as the sensor sees it turn (Rodrigues' formula, step by step)."""
    x, y, z = gravity[0], gravity[1], gravity[2]
    step = -factor * period_s * np.pi / 180.0
    for k in range(len(gyr_dps)):
        wx, wy, wz = gyr_dps[k, 0] * step, gyr_dps[k, 1] * step, gyr_dps[k, 2] * step
        angle = np.sqrt(wx * wx + wy * wy + wz * wz)
        if angle < 1e-12:
            continue
        ux, uy, uz = wx / angle, wy / angle, wz / angle
        c, s = np.cos(angle), np.sin(angle)
        along = (ux * x + uy * y + uz * z) * (1.0 - c)
        x, y, z = (
            x * c + (uy * z - uz * y) * s + ux * along,
            y * c + (uz * x - ux * z) * s + uy * along,
            z * c + (ux * y - uy * x) * s + uz * along,
        )
    return np.array([x, y, z])


def probe_blocks(segments: Sequence[Segment]) -> list[tuple[Segment, int, int]]:
    """Blocks of 8 s spread over the recording: all of a short one, 150 of a long one."""
    blocks = []
    for segment in segments:
        n = max(8, round(BLOCK_S * segment.rate_hz))
        blocks += [(segment, first, min(first + n, len(segment))) for first in range(0, len(segment), n)]
    stride = max(1, -(-len(blocks) // PROBED_BLOCKS))
    return blocks[::stride]


def moving_mean(segment: Segment, first: int, stop: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean acceleration over 50 ms (3 rows at least) from each row on, shape (m, 3), and its scatter (m,)."""
    width = max(3, round(STILL_S * segment.rate_hz))
    if stop - first <= width:
        return np.empty((0, 3)), np.empty(0)
    return slide_mean(segment.acc_g[first:stop], width)


@njit(cache=True, nogil=True)
def slide_mean(acc_g: NDArray[np.float32], width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean over ``width`` rows from each row on, and the largest of its three standard deviations."""
    n = len(acc_g) - width + 1
    means, scatter = np.empty((n, 3)), np.zeros(n)
    for axis in range(3):
        total = squares = 0.0
        for k in range(len(acc_g)):
            total += acc_g[k, axis]
            squares += np.float64(acc_g[k, axis]) ** 2
            first = k - width + 1
            if first < 0:
                continue
            means[first, axis] = total / width
            variance = squares / width - means[first, axis] ** 2
            scatter[first] = max(scatter[first], variance)
            total -= acc_g[first, axis]
            squares -= np.float64(acc_g[first, axis]) ** 2
    return means, np.sqrt(scatter)


def find_still_pairs(segments: Sequence[Segment]) -> list[StillPair]:
    """Still moments at most 2 s apart between which the tilt changed by 4 deg or more.

    The gyroscope's offset, as it reads in the stillest moments, is taken off: a part of 10 deg/s would turn
    gravity by 20 deg in 2 s.
    """
    offset_dps = find_gyro_offset_dps(segments)
    return [
        replace(pair, gyr_dps=pair.gyr_dps - offset_dps)
        for segment, first, stop in probe_blocks(segments)
        for pair in _pairs_in(segment, first, stop)
    ]


def find_gyro_offset_dps(segments: Sequence[Segment]) -> NDArray[np.float64]:
    """What the gyroscope reads at rest, shape (3,), in its own unit; zeros where it never rests."""
    means, scatters, spread = [], [], []
    for segment, first, stop in probe_blocks(segments):
        width = max(5, round(OFFSET_S * segment.rate_hz))
        rows = segment.gyr_dps[first:stop].astype(np.float64)
        windows = rows[: len(rows) // width * width].reshape(-1, width, 3)
        means.extend(windows.mean(axis=1))
        scatters.extend(windows.std(axis=1).max(axis=1))
        spread.append(rows.std(axis=0).max())
    is_still = np.array(scatters) <= RESTING_PART * max(spread, default=0.0)
    return np.median(np.array(means)[is_still], axis=0) if is_still.any() else np.zeros(3)


def _pairs_in(segment: Segment, first: int, stop: int) -> list[StillPair]:
    means, scatter = moving_mean(segment, first, stop)
    is_still = (np.abs(np.linalg.norm(means, axis=1) - 1.0) < 0.05) & (scatter < 0.05)
    places = np.flatnonzero(is_still)
    half = max(3, round(STILL_S * segment.rate_hz)) // 2
    longest = round(LONGEST_PAIR_S * segment.rate_hz)
    pairs: list[StillPair] = []
    at = 0
    while at < len(places):
        reach = np.searchsorted(places, places[at] + longest, side="right") - 1
        i, j = int(places[at]), int(places[reach])
        if _angle_deg(means[i], means[j]) >= MIN_TILT_DEG:
            rates = segment.gyr_dps[first + i + half : first + j + half].astype(np.float64)
            pairs.append(StillPair(means[i], means[j], rates, 1.0 / segment.rate_hz))
        at = max(at + 1, int(reach))
    return pairs


def _angle_deg(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    (ax, ay, az), (bx, by, bz) = first.tolist(), second.tolist()
    lengths = max(math.hypot(ax, ay, az) * math.hypot(bx, by, bz), 1e-12)
    return math.degrees(math.acos(max(-1.0, min(1.0, (ax * bx + ay * by + az * bz) / lengths))))


def score_factor(pairs: Sequence[StillPair], factor: float) -> float:
    """How badly a gyroscope times ``factor`` explains the tilts: 0 wholly, 1 no better than none at all.

    Squared angles in relation to the squared tilts.
    """
    wrong = [
        _angle_deg(carry_gravity(pair.before_g, pair.gyr_dps, factor, pair.period_s), pair.after_g) ** 2
        for pair in pairs
    ]
    tilts = [_angle_deg(pair.before_g, pair.after_g) ** 2 for pair in pairs]
    return float(np.sum(wrong) / max(np.sum(tilts), 1e-12))
