"""Rows that a program filled in by holding the last value: they were not measured."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.readers.samples import SampleColumns

HELD_ROWS = 50
"""Half a second of identical readings on six channels: no sensor of this kind is that quiet."""


@njit(cache=True, nogil=True)
def is_repeat(acc: NDArray[np.float32], gyr: NDArray[np.float32], row: int) -> bool:
    """Whether a row equals the one before on all channels."""
    for axis in range(3):
        if acc[row, axis] != acc[row - 1, axis] or gyr[row, axis] != gyr[row - 1, axis]:
            return False
    return True


@njit(cache=True, nogil=True)
def move_row(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], stamps: NDArray[np.int64], source: int, to: int
) -> None:
    """Copy one row."""
    acc[to] = acc[source]
    gyr[to] = gyr[source]
    stamps[to] = stamps[source]


@njit(cache=True, nogil=True)
def close_up(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], stamps: NDArray[np.int64], shortest: int
) -> int:
    """Take out the repeats of runs of at least ``shortest`` equal rows, in place; return the rows left."""
    kept = 0
    row = 0
    while row < len(acc):
        stop = row + 1
        while stop < len(acc) and is_repeat(acc, gyr, stop):
            stop += 1
        copied = 1 if stop - row >= shortest else stop - row
        if kept != row:
            for k in range(copied):
                move_row(acc, gyr, stamps, row + k, kept + k)
        kept += copied
        row = stop
    return kept


def drop_held_rows(columns: SampleColumns) -> int:
    """Take out rows that only repeat the last measured one; return how many."""
    before = columns.rows
    columns.rows = close_up(columns.acc, columns.gyr, columns.stamps, HELD_ROWS)
    columns.trim()
    return before - columns.rows
