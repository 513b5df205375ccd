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


@njit(cache=True, nogil=True)
def reduce_to_blocks(samples: Any, per_block: int) -> Any:  # pragma: no cover
    """Mean (3) and mean square (3) of each whole block of a (n, 3) array."""
    blocks = len(samples) // per_block
    out = np.zeros((blocks, 6))
    for block in range(blocks):
        for axis in range(3):
            total, square = 0.0, 0.0
            for row in range(block * per_block, (block + 1) * per_block):
                value = float(samples[row, axis])
                total += value
                square += value * value
            out[block, axis] = total / per_block
            out[block, axis + 3] = square / per_block
    return out


@dataclass(frozen=True, slots=True, eq=False)
class QuarterSeconds:
    """One run in blocks of a quarter second: columns mean (3) and mean square (3) of each sensor."""

    start_s: float
    block_s: float
    acc: FloatTable
    gyr: FloatTable


def reduce_run(run: SensorRun) -> QuarterSeconds:
    """Walk once over the samples; all questions about stillness are answered from the result."""
    per_block = max(1, round(BLOCK_S * run.rate_hz))
    acc, gyr = reduce_to_blocks(run.acc_g, per_block), reduce_to_blocks(run.gyr_dps, per_block)
    return QuarterSeconds(run.start_s, per_block / run.rate_hz, acc, gyr)


def summarise_windows(blocks: Sequence[QuarterSeconds], duration_s: float) -> QuietTable:
    """Slide a window of ``duration_s`` over each run in steps of a quarter second."""
    return _join([_summarise_run(run, duration_s) for run in blocks])


def _summarise_run(blocks: QuarterSeconds, duration_s: float) -> QuietTable:
    length = max(1, round(duration_s / blocks.block_s))
    acc, gyr = _slide(blocks.acc, length), _slide(blocks.gyr, length)
    start_s = np.asarray(blocks.start_s + blocks.block_s * np.arange(len(acc)), dtype=np.float64)
    return QuietTable(
        start_s, length * blocks.block_s, acc[:, :3], gyr[:, :3], _largest_sd(acc), _largest_sd(gyr)
    )


def _slide(blocks: FloatTable, length: int) -> FloatTable:
    if len(blocks) < length:
        return np.zeros((0, 6))
    sums = np.vstack([np.zeros((1, 6)), np.cumsum(blocks, axis=0)])
    return np.asarray((sums[length:] - sums[:-length]) / length)


def _largest_sd(moments: FloatTable) -> FloatTable:
    variance = np.maximum(moments[:, 3:] - moments[:, :3] ** 2, 0.0)
    return np.asarray(np.sqrt(np.maximum(np.maximum(variance[:, 0], variance[:, 1]), variance[:, 2])))


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
    rows: list[int] = []
    free_from_s = -np.inf
    for row, start_s in enumerate(table.start_s):
        if start_s >= free_from_s - 1e-6:
            rows.append(row)
            free_from_s = start_s + table.duration_s
    return table.select(np.array(rows, dtype=np.intp))


def find_quietest_rate(run: SensorRun, duration_s: float = 2.0) -> FloatTable:
    """Mean angular rate, shape (3,), of the moment in which both sensors varied least; nil where there is
    none.

    The gyroscope's variation in deg/s and the accelerometer's in hundredths of a g are added.
    """
    table = summarise_windows([reduce_run(run)], duration_s)
    if len(table) == 0:
        return np.zeros(3)
    return np.asarray(table.gyro_dps[np.argmin(table.gyro_sd_dps + 100.0 * table.acc_sd_g)])
