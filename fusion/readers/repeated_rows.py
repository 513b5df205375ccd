"""Rows that stand in a table twice: a copy that went on from too early, or a file put after itself."""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.readers.samples import SampleColumns
from fusion.readers.stamp_repair import count_backward, find_backward
from fusion.recording import QualityFlag

LEAST_ROWS = 10
"""So many rows alike in all readings and in their stamps, and not all one, come about by copying only."""
MOST_STEPS = 64
"""Steps back that are looked into: each takes a look through the rows before it."""


def leave_out_repeats(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Take out, in place, rows that come again after a step back of the clock (W-DUP, in rows)."""
    stamps = columns.stamps[: columns.rows]
    count = count_backward(stamps)
    if not 0 < count <= MOST_STEPS:
        return ()
    kept = np.ones(columns.rows, np.bool_)
    for row in find_backward(stamps, count).tolist():
        first = find_alike(columns.acc, columns.gyr, stamps, row)
        rows = count_alike(columns.acc, columns.gyr, stamps, first, row) if first < row else 0
        if rows >= LEAST_ROWS and np.ptp(columns.acc[row : row + rows], axis=0).any():
            kept[row : row + rows] = False
    repeated = columns.rows - int(kept.sum())
    if repeated == 0:
        return ()
    columns.keep(kept)
    return (QualityFlag("W-DUP", repeated),)


@njit(cache=True, nogil=True)
def is_alike(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], stamps: NDArray[np.int64], one: int, other: int
) -> bool:
    """Whether two rows have the same stamp and the same readings."""
    if stamps[one] != stamps[other]:
        return False
    for axis in range(3):
        if acc[one, axis] != acc[other, axis] or gyr[one, axis] != gyr[other, axis]:
            return False
    return True


@njit(cache=True, nogil=True)
def find_alike(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], stamps: NDArray[np.int64], row: int
) -> int:
    """The first row that is as ``row``; itself if none before it is."""
    for k in range(row):
        if is_alike(acc, gyr, stamps, k, row):
            return k
    return row


@njit(cache=True, nogil=True)
def count_alike(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], stamps: NDArray[np.int64], first: int, row: int
) -> int:
    """How many rows from ``row`` on repeat those from ``first`` on."""
    count = 0
    while row + count < len(stamps) and is_alike(acc, gyr, stamps, first + count, row + count):
        count += 1
    return count
