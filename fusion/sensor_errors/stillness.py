"""How quiet every quarter second was, and the still moments that follow from it.

The recording is reduced once to blocks of a quarter second (means and variances of the six channels); every
question about stillness is then answered from the blocks, whatever the length of the recording.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.recording import FloatArray
from fusion.sensor_errors.runs import SensorRun

FloatTable = NDArray[np.float64]
BLOCK_S = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class QuietTable:
    """Statistics of windows of one length, one row for each quarter second of window start.

    ``gravity_g`` and ``gyro_dps`` are means, shapes (m, 3); ``acc_sd_g`` and ``gyro_sd_dps`` the largest
    standard deviation of the three axes, shapes (m,).
    """

    start_s: FloatTable
    duration_s: float
    gravity_g: FloatTable
    gyro_dps: FloatTable
    acc_sd_g: FloatTable
    gyro_sd_dps: FloatTable

    def __len__(self) -> int:
        return len(self.start_s)

    @property
    def middle_s(self) -> FloatTable:
        """Middle of each window."""
        return np.asarray(self.start_s + self.duration_s / 2.0)

    def select(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> "QuietTable":
        """The same table with some of the rows."""
        return QuietTable(
            self.start_s[rows],
            self.duration_s,
            self.gravity_g[rows],
            self.gyro_dps[rows],
            self.acc_sd_g[rows],
            self.gyro_sd_dps[rows],
        )


@njit(cache=True, nogil=True, error_model="numpy")
def reduce_to_blocks(samples: Any, per_block: int, moments: Any, extremes: Any) -> None:  # pragma: no cover
    """Mean and mean square (m, 6), lowest and highest (6, m) of each block of rows; the last may be short."""
    for block in range(len(moments)):
        first, stop = block * per_block, min((block + 1) * per_block, len(samples))
        x, y, z = float(samples[first, 0]), float(samples[first, 1]), float(samples[first, 2])
        a, b, c, aa, bb, cc = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        low_x, low_y, low_z, high_x, high_y, high_z = x, y, z, x, y, z
        for row in range(first, stop):
            x, y, z = float(samples[row, 0]), float(samples[row, 1]), float(samples[row, 2])
            a, b, c = a + x, b + y, c + z
            aa, bb, cc = aa + x * x, bb + y * y, cc + z * z
            low_x, low_y, low_z = min(low_x, x), min(low_y, y), min(low_z, z)
            high_x, high_y, high_z = max(high_x, x), max(high_y, y), max(high_z, z)
        share = 1.0 / (stop - first)
        sums = (a, b, c, aa, bb, cc)
        ends = (low_x, low_y, low_z, high_x, high_y, high_z)
        for k in range(6):
            moments[block, k] = sums[k] * share
            extremes[k, block] = ends[k]


@dataclass(frozen=True, slots=True, eq=False)
class QuarterSeconds:
    """One run in blocks of a quarter second.

    ``acc`` and ``gyr``: mean (3) and mean square (3) of each whole block; ``acc_ends`` and ``gyr_ends``:
    lowest (3) and highest (3), shape (6, m), with one block more for rows left over.
    """

    start_s: float
    block_s: float
    rows_per_block: int
    acc: FloatTable
    gyr: FloatTable
    acc_ends: FloatTable
    gyr_ends: FloatTable


def reduce_run(run: SensorRun) -> QuarterSeconds:
    """Walk once over the samples; all questions about stillness are answered from the result."""
    per_block = max(1, round(BLOCK_S * run.rate_hz))
    acc, acc_ends = _reduce_sensor(run.acc_g, per_block)
    gyr, gyr_ends = _reduce_sensor(run.gyr_dps, per_block)
    return QuarterSeconds(run.start_s, per_block / run.rate_hz, per_block, acc, gyr, acc_ends, gyr_ends)


def _reduce_sensor(samples: FloatArray, per_block: int) -> tuple[FloatTable, FloatTable]:
    blocks = -(-len(samples) // per_block)
    moments, extremes = np.empty((blocks, 6)), np.empty((6, blocks))
    reduce_to_blocks(samples, per_block, moments, extremes)
    return moments[: len(samples) // per_block], extremes


def summarise_windows(blocks: Sequence[QuarterSeconds], duration_s: float) -> QuietTable:
    """Slide a window of ``duration_s`` over each run in steps of a quarter second."""
    return _join([_summarise_run(run, duration_s) for run in blocks])


def _summarise_run(blocks: QuarterSeconds, duration_s: float) -> QuietTable:
    length = max(1, round(duration_s / blocks.block_s))
    count = max(0, len(blocks.acc) - length + 1)
    start_s = np.asarray(blocks.start_s + blocks.block_s * np.arange(count), dtype=np.float64)
    means, sds = np.empty((2, count, 3)), np.empty((2, count))
    for moments, mean, sd in ((blocks.acc, means[0], sds[0]), (blocks.gyr, means[1], sds[1])):
        _slide(moments, length, mean, sd)
    return QuietTable(start_s, length * blocks.block_s, means[0], means[1], sds[0], sds[1])


@njit(cache=True, nogil=True)
def _slide(moments: Any, length: int, mean: Any, largest_sd: Any) -> None:  # pragma: no cover
    """Mean and largest standard deviation of each window of ``length`` blocks, by a running sum."""
    sums = np.zeros(6)
    for block in range(len(moments)):
        for k in range(6):
            sums[k] += moments[block, k]
        first = block - length + 1
        if first < 0:
            continue
        variance = 0.0
        for k in range(3):
            mean[first, k] = sums[k] / length
            variance = max(variance, sums[k + 3] / length - mean[first, k] * mean[first, k])
        largest_sd[first] = np.sqrt(variance)
        for k in range(6):
            sums[k] -= moments[first, k]


@dataclass(frozen=True, slots=True)
class StillRules:
    """What counts as a still moment: neither sensor varied. The level of the rate is bounded, no more."""

    still_s: float = 1.5
    acc_sd_g: float = 0.015
    gyro_sd_dps: float = 1.0
    largest_bias_dps: float = 60.0


def find_still_moments(blocks: Sequence[QuarterSeconds], rules: StillRules | None = None) -> QuietTable:
    """Non-overlapping still moments of all runs, in time order."""
    rules = rules or StillRules()
    table = summarise_windows(blocks, rules.still_s)
    quiet = (table.acc_sd_g < rules.acc_sd_g) & (table.gyro_sd_dps < rules.gyro_sd_dps)
    rows = np.flatnonzero(quiet)
    rows = rows[np.linalg.norm(table.gyro_dps[rows], axis=1) < rules.largest_bias_dps]
    return keep_apart(table.select(rows))


def _join(tables: list[QuietTable]) -> QuietTable:
    """Put the tables of several runs one after the other."""
    return QuietTable(
        np.concatenate([table.start_s for table in tables]),
        tables[0].duration_s,
        np.concatenate([table.gravity_g for table in tables]),
        np.concatenate([table.gyro_dps for table in tables]),
        np.concatenate([table.acc_sd_g for table in tables]),
        np.concatenate([table.gyro_sd_dps for table in tables]),
    )


def keep_apart(table: QuietTable) -> QuietTable:
    """Take windows that do not overlap, in time order."""
    return table.select(_choose_apart(table.start_s, table.duration_s))


@njit(cache=True, nogil=True)
def _choose_apart(start_s: Any, duration_s: float) -> Any:  # pragma: no cover
    chosen = np.zeros(len(start_s), dtype=np.bool_)
    free_from_s = -np.inf
    for row in range(len(start_s)):
        if start_s[row] >= free_from_s - 1e-6:
            chosen[row] = True
            free_from_s = start_s[row] + duration_s
    return chosen


def find_quietest_rate(run: SensorRun, duration_s: float = 2.0) -> FloatTable:
    """Mean angular rate, shape (3,), of the moment in which both sensors varied least; nil where there is
    none.

    The gyroscope's variation in deg/s and the accelerometer's in hundredths of a g are added.
    """
    table = summarise_windows([reduce_run(run)], duration_s)
    if len(table) == 0:
        return np.zeros(3)
    return np.asarray(table.gyro_dps[np.argmin(table.gyro_sd_dps + 100.0 * table.acc_sd_g)])
