"""The one-sided error of the N-pose in the draws: a raised arm reads low (CONTRACT §5 "Interval").

With the arm along the body as the reference, elevations read up to 15 deg low at a raised arm (Bioengineering
2025;12:50). That the error grows in proportion to the angle, from 0 at a hanging arm to 15 deg at 90 deg, is
our assumption. Each draw raises every read angle by a share of it (:mod:`fusion.exposure.resampling`).

Angles keep their order, so that time above a threshold is time that was read above a lower one. For entries
both thresholds of the trigger are lowered, which brings them a little nearer to each other.
"""

from dataclasses import dataclass, replace

import numpy as np

from fusion.conventions import NPOSE_ERROR_DEG
from fusion.exposure.bins import THRESHOLDS_DEG
from fusion.exposure.episodes import HALF_HYSTERESIS_DEG
from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.resampling import Resampling
from fusion.exposure.rows import find_part_rows
from fusion.exposure.types import Interval
from fusion.numba_kernels import kernel
from fusion.recording import Float64Array, IntArray

FULL_AT_DEG = 90.0
GROWTH = NPOSE_ERROR_DEG / FULL_AT_DEG
LEAST_BIN_DEG = 30.0
"""Bins that begin lower have no range of the pose: the arm in them is hardly raised."""
HALF_WIDTHS_DEG = (HALF_HYSTERESIS_DEG / (1.0 + GROWTH), HALF_HYSTERESIS_DEG)
"""Of the trigger, with the whole of the error and without it."""
STEP_DEG = 2.5
"""Between the middles at which rises are counted; between them their number is taken as linear."""


def raise_angles(read_deg: Float64Array, share: Float64Array) -> Float64Array:
    """Raise read angles by a share of the error, from 0 to 1."""
    return np.asarray(read_deg + share * NPOSE_ERROR_DEG * np.minimum(1.0, read_deg / FULL_AT_DEG))


def lower_thresholds(raised_deg: Float64Array, share: Float64Array) -> Float64Array:
    """Give the read angles that are raised to these: the inverse of :func:`raise_angles`."""
    return np.maximum(raised_deg / (1.0 + GROWTH * share), raised_deg - share * NPOSE_ERROR_DEG)


def widen(interval: Interval, raised: Interval | None) -> Interval:
    """Add the ends of the range that holds the draws with and without the error of the pose."""
    if raised is None:
        return interval
    ends = min(interval.low, raised.low), max(interval.high, raised.high)
    return replace(interval, low_pose=ends[0], high_pose=ends[1])


@dataclass(frozen=True, slots=True, eq=False)
class LoweredEntries:
    """Entries at lowered triggers, filled in place.

    ``levels_deg``, shape (t,), are the middles of the triggers, evenly spread; ``entries``, shape (2, t, s),
    the entries in each stretch of the day with each of :data:`HALF_WIDTHS_DEG`.
    """

    levels_deg: Float64Array
    edges_us: IntArray
    entries: Float64Array

    def add(self, angle: MetricAngle) -> None:
        """Count a segment."""
        stretch_rows = find_part_rows(angle, self.edges_us)
        for half_deg, entries in zip(HALF_WIDTHS_DEG, self.entries, strict=True):
            enter_deg, leave_deg = self.levels_deg + half_deg, self.levels_deg - half_deg
            scan_entries(angle.elevation_deg, angle.valid, enter_deg, leave_deg, stretch_rows, entries)

    def draw(self, threshold_deg: float, blocks: Float64Array, draws: Resampling) -> Float64Array:
        """Give the entries above a threshold in each draw, shape (200,); blocks as summed from ``entries``,
        shape (2, t, b).
        """
        enter_deg, leave_deg = (
            lower_thresholds(threshold_deg + half_deg - draws.error_deg, draws.share)
            for half_deg in (HALF_HYSTERESIS_DEG, -HALF_HYSTERESIS_DEG)
        )
        sums = draws.sum(np.moveaxis(blocks, -1, 0))  # shape (200, 2, t)
        middle = np.interp((enter_deg + leave_deg) / 2, self.levels_deg, np.arange(len(self.levels_deg)))
        width = np.interp((enter_deg - leave_deg) / 2, HALF_WIDTHS_DEG, (0.0, 1.0))
        left = np.minimum(middle.astype(np.int64), len(self.levels_deg) - 2)
        part, draw = middle - left, np.arange(len(sums))
        narrow, wide = ((1 - part) * sums[draw, k, left] + part * sums[draw, k, left + 1] for k in (0, 1))
        return np.asarray((1 - width) * narrow + width * wide)


def start_lowered_entries(errors_deg: Float64Array, edges_us: IntArray) -> LoweredEntries:
    """Start with nothing counted, with all triggers that a draw may ask for."""
    lowest = lower_thresholds(THRESHOLDS_DEG[0] - errors_deg[-1:], np.ones(1))[0] - STEP_DEG
    highest = THRESHOLDS_DEG[-1] - errors_deg[0]
    levels_deg = lowest + STEP_DEG * np.arange(np.ceil((highest - lowest) / STEP_DEG) + 1)
    shape = (len(HALF_WIDTHS_DEG), len(levels_deg), len(edges_us) - 1)
    return LoweredEntries(levels_deg, edges_us, np.zeros(shape))


@kernel
def scan_entries(angle_deg, valid, enter_deg, leave_deg, stretch_rows, entries):  # type: ignore[no-untyped-def]
    """Run the triggers of all levels; ``above`` is how many of them, from the lowest, are up.

    A run of valid rows that starts above a level starts there uncounted.
    """
    above, inside, stretch, enter, leave = 0, False, 0, enter_deg[0], -np.inf
    for i in range(len(angle_deg)):
        if not valid[i]:
            above, inside, enter, leave = 0, False, enter_deg[0], -np.inf
            continue
        x = angle_deg[i]
        if x > enter or x < leave:
            while stretch_rows[stretch + 1] <= i:
                stretch += 1
            while above < len(enter_deg) and x > enter_deg[above]:
                if inside:
                    entries[above, stretch] += 1
                above += 1
            while above > 0 and x < leave_deg[above - 1]:
                above -= 1
            enter = enter_deg[above] if above < len(enter_deg) else np.inf
            leave = leave_deg[above - 1] if above > 0 else -np.inf
        inside = True
