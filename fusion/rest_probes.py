"""Short looks, spread over a recording: how still it is, and what its sensors read then."""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.recording import Segment

PROBED_BLOCKS = 150
BLOCK_S = 8.0
STILL_S = 0.05
OFFSET_S = 0.5
STILL_G, STILL_DPS = 0.015, 3.0
RESTING_PART = 0.02
"""The gyroscope rests where it scatters by less than this part of its liveliest stretch."""


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


def measure_rests_g(segments: Sequence[Segment]) -> NDArray[np.float64]:
    """Mean acceleration of each half second in which neither sensor moves, shape (n, 3).

    A channel that keeps one value measures nothing (a hole filled with zeros, an axis that stuck), unless
    most of the rests look so: then the readings are that coarse.
    """
    rests, flat = [np.zeros((0, 3))], [np.zeros(0, np.bool_)]
    for segment, first, stop in probe_blocks(segments):
        width = max(5, round(OFFSET_S * segment.rate_hz))
        acc_g, acc_sd, acc_flat = _measure_stretches(segment.acc_g[first:stop], width)
        _, gyr_sd, gyr_flat = _measure_stretches(segment.gyr_dps[first:stop], width)
        is_still = (acc_sd < STILL_G) & (gyr_sd < STILL_DPS)
        rests.append(acc_g[is_still])
        flat.append((acc_flat | gyr_flat)[is_still])
    found, is_flat = np.concatenate(rests), np.concatenate(flat)
    return found if 2 * is_flat.sum() > len(found) else found[~is_flat]


def _measure_stretches(
    samples: NDArray[np.float32], width: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Mean (m, 3) of each ``width`` rows, their largest standard deviation, and whether any is 0 (m,)."""
    count = len(samples) // width
    means, scatter = np.zeros((count, 3)), np.zeros((count, 3))
    reduce_stretches(samples, width, means, scatter)
    return means, scatter.max(axis=1, initial=0.0), (scatter == 0.0).any(axis=1)


@njit(cache=True, nogil=True)
def reduce_stretches(samples, width, means, scatter):  # type: ignore[no-untyped-def]
    """Fill in mean and standard deviation of each ``width`` rows."""
    for k in range(len(means)):
        for axis in range(3):
            first = samples[k * width, axis]  # deviations from it are exactly 0 where nothing changes
            for row in range(k * width, (k + 1) * width):
                means[k, axis] += (samples[row, axis] - first) / width
            for row in range(k * width, (k + 1) * width):
                scatter[k, axis] += (samples[row, axis] - first - means[k, axis]) ** 2 / width
            scatter[k, axis] = np.sqrt(scatter[k, axis])
            means[k, axis] += first


def tell_directions(unit: NDArray[np.float64], near_deg: float) -> NDArray[np.intp]:
    """Number the directions: each moment belongs to the first, in order of time, that is near it."""
    number, found = np.full(len(unit), -1, dtype=np.intp), 0
    left = np.arange(len(unit))
    while len(left):
        near = unit[left] @ unit[left[0]] > np.cos(np.radians(near_deg))
        near[0] = True
        number[left[near]] = found
        left, found = left[~near], found + 1
    return number


def find_gyro_offset_dps(segments: Sequence[Segment]) -> NDArray[np.float64]:
    """What the gyroscope reads at rest, shape (3,), in its own unit; zeros where it never rests."""
    means = list[NDArray[np.float64]]()
    scatters, spread = list[float](), list[float]()
    for segment, first, stop in probe_blocks(segments):
        rows = segment.gyr_dps[first:stop]
        mean, scatter, _ = _measure_stretches(rows, max(5, round(OFFSET_S * segment.rate_hz)))
        means.extend(mean)
        scatters.extend(scatter)
        spread.append(_measure_stretches(rows, len(rows))[1].max())
    is_still = np.array(scatters) <= RESTING_PART * max(spread, default=0.0)
    return np.median(np.array(means)[is_still], axis=0) if is_still.any() else np.zeros(3)
