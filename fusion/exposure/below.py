"""Shares of time below an angle, and percentiles, in days drawn again: read off without adding the days up.

The blocks' histograms are cumulated once; what lies below an angle in a draw is then a sum over blocks at
that angle alone. Times are whole microseconds, whose sums are exact, so the order of adding does not matter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.exposure.bins import CELLS_PER_DEG
from fusion.exposure.resampling import Resampling
from fusion.exposure.stretches import AnyArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DrawnDistribution:
    """The time below each edge of the 0.1 deg cells in each block, shape (1801, b), and the draws."""

    below: FloatArray
    draws: Resampling

    def find_shares(self, angles_deg: FloatArray) -> FloatArray:
        """Give the share of each draw's time below angles, shape (k,), read with its error: (200, k)."""
        cells = (angles_deg - self.draws.error_deg[:, np.newaxis]) * CELLS_PER_DEG
        shares = np.empty(cells.shape)
        _read_shares(self.below, self.draws.times, np.clip(cells, 0.0, len(self.below) - 1.0), shares)
        return shares

    def find_percentiles(self, percents: Sequence[int]) -> FloatArray:
        """Give percentiles of each draw, read with its error and kept inside the scale, shape (200, p)."""
        places = np.empty((len(self.draws.times), len(percents)))
        _find_places(self.below, self.draws.times, np.array(percents) / 100.0, places)
        angles_deg = places / CELLS_PER_DEG + self.draws.error_deg[:, np.newaxis]
        return np.clip(angles_deg, 0.0, 180.0)


def sum_below(blocks: AnyArray, draws: Resampling) -> DrawnDistribution:
    """Cumulate the histograms of blocks, shape (b, 1800)."""
    kept = blocks[draws.kept]
    below = np.zeros((blocks.shape[1] + 1, len(kept)))
    np.cumsum(kept.T, axis=0, dtype=np.float64, out=below[1:])
    return DrawnDistribution(below, draws)


@njit(cache=True, nogil=True)
def _add_up(below, times):  # type: ignore[no-untyped-def]
    total = 0.0
    for block in range(len(times)):
        total += times[block] * below[block]
    return total


@njit(cache=True, nogil=True)
def _read_shares(below, times, cells, shares):  # type: ignore[no-untyped-def]
    """Read each draw's share below its places, linear within a cell."""
    for draw in range(len(times)):
        whole = _add_up(below[-1], times[draw])
        for k in range(cells.shape[1]):
            left = min(int(cells[draw, k]), len(below) - 2)
            lower, upper = _add_up(below[left], times[draw]), _add_up(below[left + 1], times[draw])
            shares[draw, k] = (lower + (cells[draw, k] - left) * (upper - lower)) / whole


@njit(cache=True, nogil=True)
def _find_places(below, times, wanted, places):  # type: ignore[no-untyped-def]
    """Find by halving the cell in which each draw's time below reaches each share, linear within it."""
    for draw in range(len(times)):
        whole = _add_up(below[-1], times[draw])
        for k in range(len(wanted)):
            left, right = 0, len(below) - 1
            lower, upper = 0.0, whole
            while right - left > 1:
                middle = (left + right) // 2
                reached = _add_up(below[middle], times[draw])
                # a trillionth of the whole keeps a sum that should be equal from being a hair too small
                if reached >= whole * (wanted[k] - 1e-12):
                    right, upper = middle, reached
                else:
                    left, lower = middle, reached
            places[draw, k] = left + (whole * wanted[k] - lower) / (upper - lower)
