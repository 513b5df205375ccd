"""The day cut at every minute, clock hour and edge of the diary: all parts are sums of these stretches."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.exposure.bins import CELLS, PartHistograms
from fusion.numba_kernels import njit
from fusion.recording import Float64Array, IntArray

BLOCK_MINUTES = 5

AnyArray = Float64Array | IntArray | NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """Stretches of a minute or less that follow one another.

    ``edges_us`` has shape (s + 1,), ``block_edges_us`` those of the 5-minute blocks; ``minute_of``,
    ``hour_of`` and ``piece_of``, shape (s,), are the minute, clock hour and piece of the diary that each
    belongs to (piece 0 without a diary).
    """

    edges_us: IntArray
    minute_edges_us: IntArray
    block_edges_us: IntArray
    minute_of: IntArray
    hour_of: IntArray
    piece_of: IntArray

    @property
    def block_of(self) -> IntArray:
        """The 5-minute block that each stretch belongs to, shape (s,)."""
        return self.minute_of // BLOCK_MINUTES

    def start_histograms(self) -> PartHistograms:
        """Give an empty histogram for each stretch; the time of a minute fits 32 bits."""
        return PartHistograms(self.edges_us, np.zeros((len(self.minute_of), CELLS), np.int32))

    def sum_minutes(self, histograms: PartHistograms) -> PartHistograms:
        """Give the histogram of each minute."""
        return PartHistograms(self.minute_edges_us, sum_time(histograms.cell_us, self.minute_of))


def cut_day(minute_edges_us: IntArray, hour_edges_us: IntArray, piece_edges_us: IntArray) -> Stretches:
    """Cut at all edges; those of the pieces may be missing altogether."""
    edges_us = np.unique(np.concatenate([minute_edges_us, hour_edges_us, piece_edges_us]))
    begins_us = edges_us[:-1]
    return Stretches(
        edges_us,
        minute_edges_us,
        np.append(minute_edges_us[:-1:BLOCK_MINUTES], minute_edges_us[-1]),
        _find_parts(begins_us, minute_edges_us),
        _find_parts(begins_us, hour_edges_us),
        _find_parts(begins_us, piece_edges_us),
    )


def _find_parts(times_us: IntArray, edges_us: IntArray) -> IntArray:
    """Find the part in which each time lies; what follows the last edge belongs to the last part."""
    parts = np.searchsorted(edges_us, times_us, side="right") - 1
    return np.asarray(np.clip(parts, 0, max(len(edges_us) - 2, 0)), np.int64)


def sum_groups(rows: Float64Array, group_of: IntArray) -> Float64Array:
    """Sum the rows, shape (s, ...), of each group; the groups follow one another."""
    return np.asarray(np.add.reduceat(rows, _find_first(group_of), axis=0), np.float64)


def sum_time(cell_us: IntArray | NDArray[np.int32], group_of: IntArray) -> IntArray:
    """Sum the histograms, shape (s, 1800), of each group; the groups follow one another."""
    first = np.append(_find_first(group_of), len(group_of))
    summed_us = np.zeros((len(first) - 1, cell_us.shape[1]), np.int64)
    _sum_rows(cell_us, first, summed_us)
    return summed_us


@njit(cache=True, nogil=True)
def _sum_rows(cell_us, first, summed_us):  # type: ignore[no-untyped-def]
    for group in range(len(first) - 1):
        for row in range(first[group], first[group + 1]):
            for cell in range(cell_us.shape[1]):
                summed_us[group, cell] += cell_us[row, cell]


def _find_first(group_of: IntArray) -> IntArray:
    return np.flatnonzero(np.diff(group_of, prepend=-1))
