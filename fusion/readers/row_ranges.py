"""Ranges of rows: found where all channels rest, joined, and taken out of a segment."""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.recording import MICROSECONDS, Segment, Span

LEAST_PART, MOST_TIMES = 0.1, 3.0
"""An axis reads 0.58 of gravity where all read alike."""
Rows = NDArray[np.int64]
Ranges = Sequence[tuple[int, int]]
"""First row and first row after, in order."""


@njit(cache=True, nogil=True)
def is_repeat(acc: NDArray[np.float32], gyr: NDArray[np.float32], row: int) -> bool:
    """Whether a row equals the one before on all channels."""
    for axis in range(3):
        if acc[row, axis] != acc[row - 1, axis] or gyr[row, axis] != gyr[row - 1, axis]:
            return False
    return True


@njit(cache=True, nogil=True)
def find_held_runs(acc: NDArray[np.float32], gyr: NDArray[np.float32], shortest: int) -> Rows:
    """Runs in which all six channels keep their values, shape (m, 2).

    Such a run holds one of any ``shortest - 1`` repeats that follow each other: only there is looked around.
    """
    stride = max(shortest - 1, 1)
    runs = np.empty((len(acc) // stride + 1, 2), np.int64)
    found, k = 0, stride
    while k < len(acc):
        first, stop = k, k
        while first > 0 and k - first < shortest and is_repeat(acc, gyr, first):
            first -= 1
        while first < k and stop < len(acc) and is_repeat(acc, gyr, stop):
            stop += 1
        if stop - first >= shortest:
            runs[found, 0], runs[found, 1] = first, stop
            found += 1
        k = max(k, stop - 1) + stride
    return runs[:found]


@njit(cache=True, nogil=True)
def is_filler(acc: NDArray[np.float32], gyr: NDArray[np.float32], row: int, usual: float) -> bool:
    """Whether each sensor shows one size on all axes, and the first one that gravity cannot have.

    ``usual``: length of the acceleration as a rule. So reads a sensor that does not answer: 0, or -1 count.
    """
    size = abs(acc[row, 0])
    if (
        abs(acc[row, 1]) != size
        or abs(acc[row, 2]) != size
        or LEAST_PART * usual <= size <= MOST_TIMES * usual
    ):
        return False
    return abs(gyr[row, 0]) == abs(gyr[row, 1]) and abs(gyr[row, 1]) == abs(gyr[row, 2])


@njit(cache=True, nogil=True)
def count_filler_runs(acc: NDArray[np.float32], gyr: NDArray[np.float32], usual: float) -> int:
    """How many runs of such rows there are."""
    count, was_one = 0, False
    for row in range(len(acc)):
        is_one = is_filler(acc, gyr, row, usual)
        count += int(is_one and not was_one)
        was_one = is_one
    return count


@njit(cache=True, nogil=True)
def find_filler_runs(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], usual: float, shortest: int, most: int
) -> Rows:
    """Runs of such rows, ``shortest`` rows long or more and ``most`` at most, shape (m, 2).

    Such a run covers one of any ``shortest`` rows that follow each other: only from these is looked around.
    """
    runs = np.empty((most, 2), np.int64)
    found, k = 0, shortest - 1
    while k < len(acc):
        first, stop = k, k
        while stop < len(acc) and is_filler(acc, gyr, stop, usual):
            stop += 1
        while stop > k and first > 0 and k - first < shortest and is_filler(acc, gyr, first - 1, usual):
            first -= 1
        if stop - first >= shortest:
            runs[found, 0], runs[found, 1] = first, stop
            found += 1
        k = max(k, stop - 1) + shortest
    return runs[:found]


@njit(cache=True, nogil=True)
def has_equal_sizes(values: NDArray[np.float32], low: float, high: float) -> bool:
    """Whether any row shows one size on all axes, under ``low`` or over ``high``; few files have such."""
    found = 0
    for row in range(len(values)):
        size = abs(values[row, 0])
        is_equal = int(size == abs(values[row, 1])) & int(size == abs(values[row, 2]))
        found += is_equal & (int(size < low) | int(size > high))
    return found > 0


@njit(cache=True, nogil=True)
def mark_fillers(acc: NDArray[np.float32], gyr: NDArray[np.float32], usual: float) -> NDArray[np.bool_]:
    """Which rows are such, shape (n,)."""
    marked = np.empty(len(acc), np.bool_)
    for row in range(len(acc)):
        marked[row] = is_filler(acc, gyr, row, usual)
    return marked


def place_rows(segment: Segment, first: int, stop: int, reason: str = "") -> Span:
    """Rows as a stretch of the recording."""
    start_us, end_us = (
        segment.start_us + round(row * MICROSECONDS / segment.rate_hz) for row in (first, stop)
    )
    return Span(start_us, end_us - start_us, reason)


def join_ranges(ranges: Ranges) -> list[tuple[int, int]]:
    """Make one of ranges, ordered by their first rows, that overlap or touch."""
    joined: list[tuple[int, int]] = []
    for first, stop in ranges:
        if joined and first <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(stop, joined[-1][1]))
        else:
            joined.append((first, stop))
    return joined


def cut_rows(segment: Segment, ranges: Ranges) -> list[Segment]:
    """What is left of a segment without some of its rows."""
    if not ranges:
        return [segment]
    edges = [0, *(row for pair in ranges for row in pair), len(segment)]
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [_take_rows(segment, first, stop) for first, stop in pairs if stop > first]


def _take_rows(segment: Segment, first: int, stop: int) -> Segment:
    """Rounded to the microsecond, yet never beyond the end of the whole."""
    bridged = [(max(a, first) - first, min(b, stop) - first) for a, b in segment.bridged]
    piece = replace(
        segment,
        start_us=place_rows(segment, 0, first).end_us,
        acc_g=segment.acc_g[first:stop],
        gyr_dps=segment.gyr_dps[first:stop],
        bridged=tuple((a, b) for a, b in bridged if b > a),
    )
    return replace(piece, start_us=piece.start_us - max(0, piece.end_us - segment.end_us))
