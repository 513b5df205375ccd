"""What the samples hold, sixty-four rows at a time: found in one pass, and read by every check of a sensor.

Most checks look for what few rows of a shift show: a leap, a value that is kept, the very extreme. They look
only into the blocks that hold one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import kernel
from fusion.recording import Segment

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

    def find_extreme(self, axis: int | slice = slice(None)) -> float:
        """Give the largest size that an axis, or any, reads; 0 without rows."""
        low, high = self.low[axis].min(initial=0.0), self.high[axis].max(initial=0.0)
        return float(max(high, -low))

    def keeps(self, axis: int, rows: int) -> bool:
        """Whether an axis keeps a value for so many rows anywhere."""
        return bool(self.kept[axis].max(initial=0) >= rows - 1)


@dataclass(frozen=True, slots=True, eq=False)
class SegmentSummary:
    """Both sensors of a segment, valid for that very object: a check that changes samples makes another."""

    segment: Segment
    acc: SensorSummary
    gyr: SensorSummary


Summaries = Sequence[SegmentSummary]


def summarise(segments: Sequence[Segment], known: Summaries = ()) -> Summaries:
    """Summarise segments in their order; those that are ``known`` already are not read again."""
    found = {id(one.segment): one for one in known}
    return [found.get(id(segment)) or _summarise_segment(segment) for segment in segments]


def _summarise_segment(segment: Segment) -> SegmentSummary:
    return SegmentSummary(segment, summarise_sensor(segment.acc_g), summarise_sensor(segment.gyr_dps))


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


def list_rows(blocks: NDArray[np.intp], rows: int) -> NDArray[np.intp]:
    """Number the rows of some blocks, of samples with so many rows in all."""
    every = (blocks[:, None] * BLOCK_ROWS + np.arange(BLOCK_ROWS)).ravel()
    return every[every < rows]
