"""Rows in the order of their time: a table turned round, and pieces put together in the wrong order.

A logger writes in the order of time; a program that sorts, or a person who pastes, may not keep it. Pieces
are put in order only where the stamps leave no doubt: they do not overlap, but for rows that stand in both,
and at least once one goes on where another ends. All else is a clock that was set (W-CLOCK-BACK).
"""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.readers.grid import LONGEST_BRIDGE_US, steps_between
from fusion.readers.repeated_rows import count_alike
from fusion.readers.samples import SampleColumns
from fusion.readers.stamp_repair import COARSE_ROWS, LONGEST_DELAY_US, count_backward
from fusion.recording import MICROSECONDS, QualityFlag

TURNED_SHARE = 0.9
"""So many of the steps run backwards in a table that was turned round."""
PACE_ROWS = 1024
JOIN_US = MICROSECONDS
"""A piece that begins so soon after the end of another goes on from there."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How the stamps of a table usually advance: from row to row on average, and in one step of the clock."""

    period_us: float
    step_us: float

    @property
    def is_coarse(self) -> bool:
        """Whether many rows share a stamp."""
        return self.step_us >= COARSE_ROWS * self.period_us

    @property
    def longest_us(self) -> float:
        """A longer step forward than this separates two pieces."""
        return max(1.5 * self.step_us, LONGEST_BRIDGE_US)


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Rows between two long steps of the clock, in the order of the file; shape (n,) each."""

    first: NDArray[np.int64]
    stop: NDArray[np.int64]
    low_us: NDArray[np.int64]
    high_us: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.first)


def measure_pace(stamps: NDArray[np.int64]) -> Pace:
    """Measure how the stamps usually advance; zeros where they do not."""
    steps = steps_between(stamps, 1)
    paces = steps_between(stamps, min(PACE_ROWS, max(1, len(stamps) // 8)))
    usual = [float(np.median(found[found > 0])) if np.any(found > 0) else 0.0 for found in (paces, steps)]
    return Pace(*usual)


@njit(cache=True, nogil=True)
def find_edges(stamps: NDArray[np.int64], longest_us: float, back_us: int, edges: NDArray[np.int64]) -> int:
    """Write the rows before which the clock steps far either way; return how many there are in all."""
    found = 0
    for row in range(1, len(stamps)):
        step = stamps[row] - stamps[row - 1]
        if step > longest_us or step < -back_us:
            if found < len(edges):
                edges[found] = row
            found += 1
    return found


def find_pieces(stamps: NDArray[np.int64], pace: Pace) -> Pieces:
    """Cut the rows at long steps of the clock; rows at most a second late stay where they are."""
    limits = (pace.longest_us, LONGEST_DELAY_US)
    edges = np.empty(find_edges(stamps, *limits, np.empty(0, np.int64)), np.int64)
    find_edges(stamps, *limits, edges)
    first = np.concatenate([np.zeros(1, np.int64), edges])
    stop = np.append(edges, len(stamps))
    return Pieces(first, stop, np.minimum.reduceat(stamps, first), np.maximum.reduceat(stamps, first))


@njit(cache=True, nogil=True)
def count_forward(stamps: NDArray[np.int64]) -> int:
    """How many stamps are later than the one before."""
    forward = 0
    for row in range(1, len(stamps)):
        forward += int(stamps[row] > stamps[row - 1])
    return forward


def turn_round(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Put a table that stands with its newest row first into the order of time, in place (W-REVERSED)."""
    stamps = columns.stamps[: columns.rows]
    backward = count_backward(stamps)
    if backward == 0 or backward < TURNED_SHARE * (backward + count_forward(stamps)) or len(stamps) < 3:
        return ()
    for values in (columns.acc, columns.gyr, columns.stamps):
        turn_rows(values.reshape(len(values), -1), columns.rows)
    return (QualityFlag("W-REVERSED"),)


@njit(cache=True, nogil=True)
def turn_rows(values: NDArray[np.float32], rows: int) -> None:
    """Turn the first ``rows`` of an array, shape (n, m), round, in place."""
    for row in range(rows // 2):
        for place in range(values.shape[1]):
            other = values[rows - 1 - row, place]
            values[rows - 1 - row, place] = values[row, place]
            values[row, place] = other


def order_pieces(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Put pieces that stand in the wrong order into that of their stamps (W-PIECES, in pieces that moved).

    Rows that two pieces share at a seam are counted once (W-DUP).
    """
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    pieces = find_pieces(stamps, pace)
    order = np.lexsort((pieces.high_us, pieces.low_us))
    moved = int(np.count_nonzero(order != np.arange(len(order))))
    if moved == 0:
        return ()
    begins = find_begins(columns, pieces, order, pace)
    if begins is None or not goes_on(pieces, order, begins, pace):
        return ()
    repeated = int((begins - pieces.first).sum())
    places = [(int(begins[k]), int(pieces.stop[k])) for k in order]
    gather_rows(columns, places)
    flags = (QualityFlag("W-PIECES", moved),)
    return (*flags, QualityFlag("W-DUP", repeated)) if repeated else flags


def find_begins(
    columns: SampleColumns, pieces: Pieces, order: NDArray[np.int64], pace: Pace
) -> NDArray[np.int64] | None:
    """The row at which each piece begins that no piece before it in time has; None where two contradict."""
    begins = pieces.first.copy()
    stamps = columns.stamps[: columns.rows]
    for before, after in pairwise(order.tolist()):
        high_us = int(pieces.high_us[before])
        if pieces.low_us[after] > high_us - int(pace.is_coarse):
            continue
        first, stop = int(pieces.first[after]), int(pieces.stop[after])
        shared = int(np.count_nonzero(stamps[first:stop] <= high_us))
        twin = int(pieces.first[before]) + int(
            np.searchsorted(stamps[pieces.first[before] : pieces.stop[before]], stamps[first])
        )
        if shared == stop - first or not _is_copy(columns, twin, first, shared):
            return None
        begins[after] = first + shared
    return begins


def _is_copy(columns: SampleColumns, twin: int, first: int, shared: int) -> bool:
    stamps = columns.stamps[: columns.rows]
    return count_alike(columns.acc, columns.gyr, stamps, min(twin, first), max(twin, first)) >= shared


def goes_on(pieces: Pieces, order: NDArray[np.int64], begins: NDArray[np.int64], pace: Pace) -> bool:
    """Whether a piece goes on where another ends that does not stand just before it in the file.

    Where what stands between the two in the file fits into the time between them, that is no proof: then it
    may be rows with a strange stamp.
    """
    before, after = order[:-1], order[1:]
    step_us = pieces.low_us[after] - pieces.high_us[before]
    between_us = (pieces.first[after] - pieces.stop[before]) * pace.period_us
    is_filled = (after > before) & (between_us <= step_us + pace.period_us)
    is_new = (after != before + 1) & ~is_filled
    return bool(np.any(is_new & ((step_us <= JOIN_US) | (begins[after] > pieces.first[after]))))


def gather_rows(columns: SampleColumns, places: list[tuple[int, int]]) -> None:
    """Keep some stretches of rows, in a new order; one column at a time, so that memory holds one twice."""
    columns.acc = np.concatenate([columns.acc[first:stop] for first, stop in places])
    columns.gyr = np.concatenate([columns.gyr[first:stop] for first, stop in places])
    columns.stamps = np.concatenate([columns.stamps[first:stop] for first, stop in places])
    columns.rows = len(columns.acc)
