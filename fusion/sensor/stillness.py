"""Measure the stillness of every quarter second, and find the still moments.

The recording is reduced once to blocks of a quarter second (means and variances of the six channels). All
later steps use the blocks, for any length of recording.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.numba_kernels import kernel
from acromion.fusion.recording import Float64Array, FloatArray
from acromion.fusion.sensor.model import SensorRun
from acromion.fusion.still_limits import MOMENT

BLOCK_S = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class QuietTable:
    """Statistics of windows of one length, one row for each quarter second of window start.

    ``gravity_g``, ``gyro_dps``: means, shapes (m, 3).
    ``acc_sd_g``, ``gyro_sd_dps``: the largest standard deviation of the three axes, shapes (m,), or that of
    all three together.
    """

    start_s: Float64Array
    duration_s: float
    gravity_g: Float64Array
    gyro_dps: Float64Array
    acc_sd_g: Float64Array
    gyro_sd_dps: Float64Array

    def __len__(self) -> int:
        return len(self.start_s)

    @property
    def middle_s(self) -> Float64Array:
        """Middle of each window."""
        return np.asarray(self.start_s + self.duration_s / 2.0)

    def select(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> "QuietTable":
        """Return the table with some of the rows."""
        return QuietTable(
            self.start_s[rows],
            self.duration_s,
            self.gravity_g[rows],
            self.gyro_dps[rows],
            self.acc_sd_g[rows],
            self.gyro_sd_dps[rows],
        )


@kernel
def reduce_to_blocks(
    samples: Any, rows_per_block: int, moments: Any, extremes: Any
) -> None:  # pragma: no cover
    """Compute mean and mean square (m, 6), minimum and maximum (6, m) of each block of rows."""
    for block in range(len(moments)):
        first, stop = block * rows_per_block, (block + 1) * rows_per_block
        stop = stop if stop < len(samples) else len(samples)
        for axis in range(3):
            total, squares = 0.0, 0.0
            low = high = float(samples[first, axis])
            for row in range(first, stop):
                value = float(samples[row, axis])
                total += value
                squares += value * value
                low = value if value < low else low
                high = value if value > high else high
            moments[block, axis], moments[block, axis + 3] = total / (stop - first), squares / (stop - first)
            extremes[axis, block], extremes[axis + 3, block] = low, high


@dataclass(frozen=True, slots=True, eq=False)
class QuarterSeconds:
    """One run in blocks of a quarter second.

    ``acc``, ``gyr``: mean (3) and mean square (3) of each whole block.
    ``acc_ends``, ``gyr_ends``: minimum (3) and maximum (3), shape (6, m), with one more block for remaining
    rows.
    """

    start_s: float
    block_s: float
    rows_per_block: int
    acc: Float64Array
    gyr: Float64Array
    acc_ends: Float64Array
    gyr_ends: Float64Array


def reduce_run(run: SensorRun) -> QuarterSeconds:
    """Reduce the samples in one pass."""
    per_block = max(1, round(BLOCK_S * run.rate_hz))
    acc, acc_ends = _reduce_sensor(run.acc_g, per_block)
    gyr, gyr_ends = _reduce_sensor(run.gyr_dps, per_block)
    return QuarterSeconds(run.start_s, per_block / run.rate_hz, per_block, acc, gyr, acc_ends, gyr_ends)


def _reduce_sensor(samples: FloatArray, rows_per_block: int) -> tuple[Float64Array, Float64Array]:
    blocks = -(-len(samples) // rows_per_block)
    moments, extremes = np.empty((blocks, 6)), np.empty((6, blocks))
    reduce_to_blocks(samples, rows_per_block, moments, extremes)
    return moments[: len(samples) // rows_per_block], extremes


def summarise_windows(
    blocks: Sequence[QuarterSeconds], duration_s: float, *, together: bool = False
) -> QuietTable:
    """Slide a window of ``duration_s`` over each run in steps of a quarter second.

    ``together``: use the standard deviation of all three axes together, which does not depend on the
    mounting; otherwise that of the axis that varies most, as in published rules.
    """
    tables = [_summarise_run(run, duration_s, together=together) for run in blocks]
    if len(tables) == 1:
        return tables[0]
    return QuietTable(
        np.concatenate([table.start_s for table in tables]),
        tables[0].duration_s,
        np.concatenate([table.gravity_g for table in tables]),
        np.concatenate([table.gyro_dps for table in tables]),
        np.concatenate([table.acc_sd_g for table in tables]),
        np.concatenate([table.gyro_sd_dps for table in tables]),
    )


def _summarise_run(blocks: QuarterSeconds, duration_s: float, *, together: bool) -> QuietTable:
    length = max(1, round(duration_s / blocks.block_s))
    count = max(0, len(blocks.acc) - length + 1)
    start_s = np.asarray(blocks.start_s + blocks.block_s * np.arange(count), dtype=np.float64)
    means, sds = np.empty((2, count, 3)), np.empty((2, count))
    for moments, mean, sd in ((blocks.acc, means[0], sds[0]), (blocks.gyr, means[1], sds[1])):
        _slide(moments, (length, together), np.zeros(6), mean, sd)
    return QuietTable(start_s, length * blocks.block_s, means[0], means[1], sds[0], sds[1])


@kernel
def _slide(moments: Any, how: Any, sums: Any, mean: Any, sd: Any) -> None:  # pragma: no cover
    """Compute mean and standard deviation of each window of ``length`` blocks, by a running sum."""
    length, together = how
    for block in range(len(moments)):
        for k in range(6):
            sums[k] += moments[block, k]
        first = block - length + 1
        if first < 0:
            continue
        largest, total = 0.0, 0.0
        for k in range(3):
            mean[first, k] = sums[k] / length
            variance = sums[k + 3] / length - mean[first, k] * mean[first, k]
            largest = variance if variance > largest else largest
            total += variance if variance > 0.0 else 0.0
        sd[first] = sqrt(total if together else largest)
        for k in range(6):
            sums[k] -= moments[first, k]


@dataclass(frozen=True, slots=True)
class StillRules:
    """Limits of a still moment: small variation of both sensors, all axes together.

    The level of the rate only has an upper bound.
    """

    still_s: float = MOMENT.window_s
    acc_sd_g: float = MOMENT.acc_sd_g
    gyro_sd_dps: float = MOMENT.gyro_sd_dps
    largest_bias_dps: float = 60.0


RULES = StillRules()


def find_still_moments(blocks: Sequence[QuarterSeconds]) -> QuietTable:
    """Return non-overlapping still moments of all runs, in time order."""
    every = summarise_windows(blocks, RULES.still_s, together=True)
    rows = np.flatnonzero((every.acc_sd_g < RULES.acc_sd_g) & (every.gyro_sd_dps < RULES.gyro_sd_dps))
    rows = rows[np.linalg.norm(every.gyro_dps[rows], axis=1) < RULES.largest_bias_dps]
    table = every.select(rows)
    following = np.searchsorted(table.start_s, table.start_s + table.duration_s - 1e-6).tolist()
    chosen, row = [], 0
    while row < len(following):
        chosen.append(row)
        row = following[row]
    return table.select(np.array(chosen, dtype=np.intp))


QUIETEST_S = 2.0


def find_quietest_rate(run: SensorRun) -> Float64Array:
    """Return the mean angular rate, (3,), of the moment with the least variation; zero if there is none.

    The variation is the gyroscope's in deg/s plus the accelerometer's in hundredths of a g.
    """
    table = summarise_windows([reduce_run(run)], QUIETEST_S, together=True)
    if len(table) == 0:
        return np.zeros(3)
    return np.asarray(table.gyro_dps[np.argmin(table.gyro_sd_dps + 100.0 * table.acc_sd_g)])
