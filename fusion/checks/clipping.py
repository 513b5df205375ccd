"""Where a sensor is cut off, by its flat tops, whatever range the file states.

A signal that is cut off rests at its very extreme, sample after sample, again and again. A sensor that is not
reaches its extreme once: the next movement, or the next bit of noise, makes another value.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fusion.checks.summary import SensorSummary, list_rows, summarise_sensor

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


def find_flat_range(
    pieces: Sequence[NDArray[np.float32]], least: float = 0.0, known: Sequence[SensorSummary] = ()
) -> float | None:
    """Give the size at which samples (n, 3) are cut off, or None where nothing is.

    It holds for all axes: an axis cut off below what another reads is not found.
    """
    seen = known or [summarise_sensor(piece) for piece in pieces]
    extreme = max((sensor.find_extreme() for sensor in seen), default=0.0)
    if not least <= extreme < np.inf:
        return None
    limit = np.float32(RANGE_SHARE * extreme)
    tops = sum(_count_tops(*pair, limit) for pair in zip(pieces, seen, strict=True))
    return extreme if tops >= FEWEST_TOPS else None


def _count_tops(samples: NDArray[np.float32], seen: SensorSummary, limit: np.float32) -> int:
    """How often an axis rests at one value past the limit for three rows or more."""
    count = 0
    for axis in range(3):
        for sign, ends in ((1, seen.high), (-1, -seen.low)):
            rows = list_rows(np.flatnonzero(ends[axis] >= limit), len(samples))
            values = sign * samples[rows, axis]
            count += _count_runs(rows[values >= limit], values[values >= limit])
    return count


def _count_runs(rows: NDArray[np.intp], values: NDArray[np.float32]) -> int:
    if len(rows) < FLAT_ROWS:
        return 0
    is_held = (np.diff(rows) == 1) & (np.diff(values) == 0.0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_held, [False]]).astype(np.int8)))
    return int(np.count_nonzero(edges[1::2] - edges[::2] >= FLAT_ROWS - 1))
