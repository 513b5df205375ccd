"""Time in elevation bins, time above thresholds, and percentiles, all from one 0.1 deg histogram.

The day is split at every minute, clock hour and edge of the diary; all its parts are sums of these stretches.
The bin edges include every class edge of ISO 11226, EN 1005-4, RULA, REBA, Acti4 and OCRA, so the classes of
each convention are exact sums of bins. Times are integer microseconds, so parts add up exactly.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.conventions import Convention
from acromion.fusion.exposure.metric_filter import MetricAngle
from acromion.fusion.exposure.types import ElevationBin, TimeAbove
from acromion.fusion.numba_kernels import kernel, kernel_making_arrays
from acromion.fusion.recording import MICROSECONDS, Float64Array, IntArray
from acromion.fusion.runs import add_time, find_first_rows, find_parts, find_touched_parts

BIN_EDGES_DEG = (0, 20, 30, 45, 60, 80, 90, 120, 150, 180)
THRESHOLDS_DEG = (30, 60, 90)
PERCENTS = (1, 5, 10, 25, 50, 75, 90, 95, 99)
CELLS_PER_DEG = 10
CELLS = 180 * CELLS_PER_DEG
BLOCK_MINUTES = 5

AnyArray = Float64Array | IntArray | NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class PartHistograms:
    """Analysed time in each 0.1 deg cell, for parts of the day between successive edges.

    ``edges_us``: shape (p + 1,).
    ``cell_us``: shape (p, 1800), microseconds, filled in place.
    """

    edges_us: IntArray
    cell_us: IntArray | NDArray[np.int32]

    def add(self, angle: MetricAngle) -> None:
        """Count a segment's valid rows."""
        parts = find_touched_parts(angle, self.edges_us)
        rows = find_first_rows(angle, self.edges_us[parts.start : parts.stop + 1])
        rows[0], rows[-1] = 0, len(angle)
        counts = np.zeros((len(rows) - 1, CELLS), np.int32)
        count_cells(angle.elevation_deg, angle.valid, rows, counts)
        add_time(counts, angle.rate_hz, self.cell_us[parts])


@kernel
def count_cells(angle_deg, valid, rows, counts):  # type: ignore[no-untyped-def]
    """Count the valid rows of each part in each cell; 180 deg belongs to the last cell.

    Angles are rounded to 1e-6 deg. Ten times an angle is therefore exact at the cell edges, and no tolerance
    is needed.
    """
    for part in range(len(rows) - 1):
        for i in range(rows[part], rows[part + 1]):
            if valid[i]:
                counts[part, min(int(angle_deg[i] * CELLS_PER_DEG), CELLS - 1)] += 1


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """Consecutive stretches of at most a minute.

    ``edges_us``: shape (s + 1,).
    ``block_edges_us``: edges of the 5-minute blocks.
    ``minute_of``, ``hour_of``, ``piece_of``: shape (s,): the minute, clock hour and diary piece of each
    stretch (piece 0 without a diary).
    """

    edges_us: IntArray
    minute_edges_us: IntArray
    block_edges_us: IntArray
    minute_of: IntArray
    hour_of: IntArray
    piece_of: IntArray

    @property
    def block_of(self) -> IntArray:
        """The 5-minute block of each stretch, shape (s,)."""
        return self.minute_of // BLOCK_MINUTES

    @property
    def piece_edges_us(self) -> IntArray:
        """The edges of the diary's pieces, shape (p + 1,)."""
        first = np.unique(self.piece_of, return_index=True)[1]
        return np.append(self.edges_us[first], self.edges_us[-1])

    def sum_minutes(self, histograms: PartHistograms) -> PartHistograms:
        """Return the histogram of each minute."""
        return PartHistograms(self.minute_edges_us, sum_time(histograms.cell_us, self.minute_of))


def cut_day(
    minute_edges_us: IntArray, hour_edges_us: IntArray, piece_edges_us: IntArray, mark_edges_us: IntArray
) -> Stretches:
    """Split the day at all edges; those of pieces and of marks may be empty."""
    edges_us = np.unique(np.concatenate([minute_edges_us, hour_edges_us, piece_edges_us, mark_edges_us]))
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
    """Return the part of each time; times after the last edge belong to the last part."""
    return np.asarray(np.clip(find_parts(edges_us, times_us), 0, max(len(edges_us) - 2, 0)), np.int64)


def sum_groups(counts: Float64Array, group_of: IntArray) -> Float64Array:
    """Sum the columns, shape (..., s), of each group; groups are consecutive."""
    return np.asarray(np.add.reduceat(counts, _find_first(group_of), axis=-1), np.float64)


def sum_time(cell_us: IntArray | NDArray[np.int32], group_of: IntArray) -> IntArray:
    """Sum the histograms, shape (s, 1800), of each group; groups are consecutive."""
    first = np.append(_find_first(group_of), len(group_of))
    summed_us = np.zeros((len(first) - 1, cell_us.shape[1]), np.int64)
    _sum_rows(cell_us, first, summed_us)
    return summed_us


@kernel
def _sum_rows(cell_us, first, summed_us):  # type: ignore[no-untyped-def]
    for group in range(len(first) - 1):
        for row in range(first[group], first[group + 1]):
            for cell in range(cell_us.shape[1]):
                summed_us[group, cell] += cell_us[row, cell]


def _find_first(group_of: IntArray) -> IntArray:
    return np.flatnonzero(np.diff(group_of, prepend=-1))


def summarise_bins(cell_us: IntArray) -> tuple[ElevationBin, ...]:
    """Return the time in each bin [a, b), the last one closed; cells of shape (1800,)."""
    ends_us = _sum_below(cell_us)[np.array(BIN_EDGES_DEG) * CELLS_PER_DEG]
    return tuple(
        ElevationBin(lower, upper, *_share(within_us, ends_us[-1]))
        for (lower, upper), within_us in zip(pairwise(BIN_EDGES_DEG), np.diff(ends_us), strict=True)
    )


def divide_by_convention(bins: tuple[ElevationBin, ...], convention: Convention) -> tuple[ElevationBin, ...]:
    """Sum the bins to the classes of a standard or method, exactly."""
    return tuple(
        ElevationBin(
            lower_deg,
            upper_deg,
            sum(bins[k].duration_s for k in inside),
            sum(bins[k].percent for k in inside),
        )
        for (lower_deg, upper_deg), inside in list_classes(convention)
    )


def list_classes(convention: Convention) -> list[tuple[tuple[int, int], list[int]]]:
    """Return the edges of each class, and the indices of its bins."""
    return [
        ((low, high), [k for k, (a, b) in enumerate(pairwise(BIN_EDGES_DEG)) if low <= a and b <= high])
        for low, high in pairwise(convention.edges_deg)
    ]


def summarise_time_above(cell_us: IntArray) -> tuple[TimeAbove, ...]:
    """Return the time at or above 30, 60 and 90 deg; cells of shape (1800,)."""
    ends_us = _sum_below(cell_us)
    return tuple(
        TimeAbove(threshold, *_share(ends_us[-1] - ends_us[threshold * CELLS_PER_DEG], ends_us[-1]))
        for threshold in THRESHOLDS_DEG
    )


def _sum_below(cell_us: IntArray) -> IntArray:
    return np.concatenate([[0], np.cumsum(cell_us, dtype=np.int64)])


def _share(part_us: np.int64, total_us: np.int64) -> tuple[float, float]:
    """Return seconds and percent."""
    return int(part_us) / MICROSECONDS, 100.0 * int(part_us) / int(total_us)


def find_percentiles(cell_us: AnyArray, percents: tuple[int, ...] = PERCENTS) -> dict[int, float]:
    """Return percentiles of elevation, deg: the smallest x with F(x) >= p, linear within a 0.1 deg cell.

    APDF of Jonsson 1982; percentiles of a day are computed from its pooled cells, not by averaging
    percentiles.
    """
    places = find_percentile_cells(cell_us[np.newaxis], np.array(percents, np.float64))[0]
    return {p: float(place) / CELLS_PER_DEG for p, place in zip(percents, places, strict=True)}


@kernel_making_arrays
def find_percentile_cells(weights, percents):  # type: ignore[no-untyped-def]
    """Return each row's percentiles in cells, shape (rows, percents): 3.5 is the middle of the fourth cell.

    ``percents`` increase; a row without weight gives NaN.
    """
    places = np.full((len(weights), len(percents)), np.nan)
    for row in range(len(weights)):
        total = 0.0
        for weight in weights[row]:
            total += weight
        below, cell = 0.0, 0
        for k in range(len(percents) if total > 0 else 0):
            # a relative tolerance of 1e-12 against the rounding of sums
            wanted = total * (percents[k] / 100.0 - 1e-12)
            while below + weights[row, cell] < wanted:
                below += weights[row, cell]
                cell += 1
            places[row, k] = cell + max(wanted - below, 0.0) / max(weights[row, cell], 1e-300)
    return places
