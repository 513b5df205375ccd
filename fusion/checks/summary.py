"""What the samples hold, sixty-four rows at a time: found in one pass, and read by every check of a sensor.

Most checks look for what few rows of a shift show: a leap, a value that is kept, the very extreme. They look
only into the blocks that hold one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.numba_kernels import kernel
from fusion.recording import QualityFlag, Recording, Segment
from fusion.still_limits import MOMENT, POSE

BLOCK_ROWS = 64


@dataclass(frozen=True, slots=True, eq=False)
class SensorSummary:
    """One sensor of a segment, by axis and block of rows; the last block may be shorter.

    ``samples`` (n, 3) are what it was made from. ``low``, ``high``, ``step`` (3, m): the lowest and the
    highest reading, and the largest step from one row to the next, into a block's first row too. ``kept``
    (3, m): the most rows after each other, up to one of the block, that repeat the value of the row before.
    """

    samples: NDArray[np.float32]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    step: NDArray[np.float32]
    kept: NDArray[np.int32]

    def find_extreme(self) -> float:
        """Return the largest size that any axis reads; 0 without rows."""
        return float(max(self.high.max(initial=0.0), -self.low.min(initial=0.0)))

    def keeps(self, axis: int, rows: int) -> bool:
        """Return whether an axis keeps a value for so many rows anywhere."""
        return bool(self.kept[axis].max(initial=0) >= rows - 1)


_SUMMARIES: WeakKeyDictionary[Segment, tuple[SensorSummary, SensorSummary]] = WeakKeyDictionary()


def summarise(segment: Segment) -> tuple[SensorSummary, SensorSummary]:
    """Return the summaries of accelerometer and gyroscope.

    They are made once for each object: whoever changes the samples makes another segment of them.
    """
    if segment not in _SUMMARIES:
        _SUMMARIES[segment] = summarise_sensor(segment.acc_g), summarise_sensor(segment.gyr_dps)
    return _SUMMARIES[segment]


def forget_summaries(recording: Recording) -> None:
    """Free the summaries of a recording once its checks are over: they take a sixteenth of its samples."""
    for segment in recording.segments:
        _SUMMARIES.pop(segment, None)


def summarise_sensor(samples: NDArray[np.float32]) -> SensorSummary:
    """Walk once over samples, shape (n, 3)."""
    blocks = -(-len(samples) // BLOCK_ROWS)
    ends, step = np.empty((6, blocks), np.float32), np.empty((3, blocks), np.float32)
    kept = np.empty((3, blocks), np.int32)
    _walk(samples, ends, step, kept)
    return SensorSummary(samples, ends[:3], ends[3:], step, kept)


@kernel
def _walk(samples: Any, ends: Any, steps: Any, kept: Any) -> None:  # pragma: no cover
    """Fill the blocks; all three axes side by side, three times as fast as one after the other."""
    run_x, run_y, run_z = 0, 0, 0
    for block in range(len(steps[0])):
        first, stop = block * BLOCK_ROWS, min((block + 1) * BLOCK_ROWS, len(samples))
        last = first - 1 if first > 0 else 0
        last_x, last_y, last_z = samples[last, 0], samples[last, 1], samples[last, 2]
        low_x = high_x = samples[first, 0]
        low_y = high_y = samples[first, 1]
        low_z = high_z = samples[first, 2]
        step_x = step_y = step_z = np.float32(0.0)
        kept_x, kept_y, kept_z = 0, 0, 0
        for row in range(max(first, 1), stop):
            x, y, z = samples[row, 0], samples[row, 1], samples[row, 2]
            low_x, high_x = x if x < low_x else low_x, x if x > high_x else high_x
            low_y, high_y = y if y < low_y else low_y, y if y > high_y else high_y
            low_z, high_z = z if z < low_z else low_z, z if z > high_z else high_z
            far_x, far_y, far_z = abs(x - last_x), abs(y - last_y), abs(z - last_z)
            step_x = far_x if far_x > step_x else step_x
            step_y = far_y if far_y > step_y else step_y
            step_z = far_z if far_z > step_z else step_z
            is_x, is_y, is_z = int(x == last_x), int(y == last_y), int(z == last_z)
            run_x, run_y, run_z = (run_x + 1) * is_x, (run_y + 1) * is_y, (run_z + 1) * is_z
            kept_x, kept_y, kept_z = max(kept_x, run_x), max(kept_y, run_y), max(kept_z, run_z)
            last_x, last_y, last_z = x, y, z
        ends[0, block], ends[1, block], ends[2, block] = low_x, low_y, low_z
        ends[3, block], ends[4, block], ends[5, block] = high_x, high_y, high_z
        steps[0, block], steps[1, block], steps[2, block] = step_x, step_y, step_z
        kept[0, block], kept[1, block], kept[2, block] = kept_x, kept_y, kept_z


# Where a sensor is cut off, by its flat tops, whatever range the file states.
#
# A signal that is cut off rests at its very extreme, sample after sample, again and again. A sensor that is
# not reaches its extreme once: the next movement, or the next bit of noise, makes another value.

RANGE_SHARE = 0.999
"""A sample is cut off from this share of a full scale or of the extreme on: the two ends of a signed range
differ by one count.
"""
FLAT_ROWS, FEWEST_TOPS = 3, 5
"""An axis rests at one value for so many rows; so often, where nothing states the range."""
LEAST_ACC_RANGE_G, LEAST_GYR_RANGE_DPS = 1.9, 240.0
"""No sensor has a smaller range (2 g, 245 deg/s): a lower extreme is not the end of one."""
LEAST_ACC_TOP_G, LEAST_GYR_TOP_DPS = 1.5, 50.0
"""Of a sensor with a range narrower than stated. At rest, in coarse counts, one rests at its extreme as well;
under these it may.
"""


def find_flat_range(sensors: Sequence[SensorSummary], least: float = 0.0) -> float | None:
    """Return the size at which samples are cut off, or None where nothing is.

    It holds for all axes: an axis cut off below what another reads is not found.
    """
    extreme = max((sensor.find_extreme() for sensor in sensors), default=0.0)
    if not least <= extreme < np.inf:
        return None
    limit = np.float32(RANGE_SHARE * extreme)
    tops = sum(_count_tops(sensor, limit) for sensor in sensors)
    return extreme if tops >= FEWEST_TOPS else None


def _count_tops(sensor: SensorSummary, limit: np.float32) -> int:
    """Count how often an axis rests at one value past the limit for three rows or more."""
    count = 0
    for axis in range(3):
        for sign, ends in ((1, sensor.high), (-1, -sensor.low)):
            blocks = np.flatnonzero(ends[axis] >= limit)
            rows = (blocks[:, None] * BLOCK_ROWS + np.arange(BLOCK_ROWS)).ravel()
            rows = rows[rows < len(sensor.samples)]
            values = sign * sensor.samples[rows, axis]
            rows, values = rows[values >= limit], values[values >= limit]
            if len(rows) >= FLAT_ROWS:
                is_held = (np.diff(rows) == 1) & (np.diff(values) == 0.0)
                edges = np.flatnonzero(np.diff(np.concatenate([[False], is_held, [False]]).astype(np.int8)))
                count += int(np.count_nonzero(edges[1::2] - edges[::2] >= FLAT_ROWS - 1))
    return count


# Readings so coarse that a held arm looks as if it moved, or a moving one as if a channel stuck.

COARSE_G, COARSE_DPS = 1.5 * POSE.acc_sd_g, 2.0 * MOMENT.gyro_sd_dps
"""Between two values, readings at rest scatter by half a step: with an arm's own sway, or alone, past the
limit of stillness. Parts in use have 0.1 to 2.5 mg and 0.004 to 0.6 deg/s; ten bits of 16 g and 2000 deg/s
are 31 mg and 3.9 deg/s."""
SMALLEST_PART = 0.01
LOOKED_AT_ROWS = 20_000


def flag_resolution(recording: Recording) -> tuple[QualityFlag, ...]:
    """Flag steps from one value to the next that hide stillness (W-RESOLUTION)."""
    acc_g = _measure_step([segment.acc_g for segment in recording.segments])
    gyr_dps = _measure_step([segment.gyr_dps for segment in recording.segments])
    facts: dict[str, str | int | float] = {}
    if acc_g > COARSE_G:
        facts["step_mg"] = round(1000.0 * acc_g, 1)
    if gyr_dps > COARSE_DPS:
        facts["step_dps"] = round(gyr_dps, 2)
    return (QualityFlag(Caveat.RESOLUTION, facts=facts),) if facts else ()


def _measure_step(samples: Sequence[NDArray[np.float32]]) -> float:
    """Return the smallest change from row to row, but for one in a hundred, of the coarsest axis.

    Rows that a program put in between are few; noise that was not rounded changes by far less.
    """
    stride = max(2, sum(map(len, samples)) // LOOKED_AT_ROWS)
    pairs = [(values[1::stride], values[: len(values) - 1 : stride]) for values in samples]
    changes = np.abs(np.concatenate([after - before for after, before in pairs]))
    return max(
        (float(np.quantile(axis[axis > 0.0], SMALLEST_PART)) for axis in changes.T if axis.any()), default=0.0
    )
