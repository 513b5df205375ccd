"""Ranges of rows: found where all channels rest, joined, and taken out of a segment."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.checks.summary import SensorSummary
from fusion.numba_kernels import inner, kernel
from fusion.recording import MICROSECONDS, Segment, Span

LEAST_PART, MOST_TIMES = 0.1, 3.0
"""An axis reads 0.58 of gravity where all read alike."""
Rows = NDArray[np.int64]
Values = NDArray[np.float32]
Ranges = Sequence[tuple[int, int]]
"""First row and first row after, in order."""


def find_held_runs(
    acc: SensorSummary, gyr: SensorSummary, shortest_rows: int, axes: tuple[int, int] = (0, 3)
) -> Rows:
    """Runs in which some axes (first, first after) of both sensors keep their values, shape (m, 2)."""
    if not all(sensor.keeps(axis, shortest_rows) for sensor in (acc, gyr) for axis in range(*axes)):
        return np.empty((0, 2), np.int64)
    runs = np.empty((len(acc.samples) // max(shortest_rows - 1, 1) + 1, 2), np.int64)
    return runs[: _find_held(acc.samples, gyr.samples, shortest_rows, axes, runs)]


@kernel
def _find_held(acc: Any, gyr: Any, shortest_rows: int, axes: Any, runs: Any) -> int:  # pragma: no cover
    """Such a run holds one of any ``shortest - 1`` repeats that follow each other: look around these only."""
    stride = max(shortest_rows - 1, 1)
    found, k = 0, stride
    while k < len(acc):
        first, stop = k, k
        while first > 0 and k - first < shortest_rows and _is_repeat(acc, gyr, first, axes):
            first -= 1
        while first < k and stop < len(acc) and _is_repeat(acc, gyr, stop, axes):
            stop += 1
        if stop - first >= shortest_rows:
            runs[found, 0], runs[found, 1] = first, stop
            found += 1
        k = max(k, stop - 1) + stride
    return found


@inner
def _is_repeat(acc: Any, gyr: Any, row: int, axes: Any) -> bool:  # pragma: no cover
    """Whether a row equals the one before on some axes of both sensors."""
    for axis in range(axes[0], axes[1]):
        if acc[row, axis] != acc[row - 1, axis] or gyr[row, axis] != gyr[row - 1, axis]:
            return False
    return True


def mark_fillers(acc: Values, gyr: Values, usual_g: float) -> NDArray[np.bool_]:
    """Which rows show one size on all axes of each sensor, and the first one that gravity cannot have, (n,).

    ``usual_g``: length of the acceleration as a rule. So reads a sensor that does not answer: 0, or -1 count.
    """
    marked = mark_equal(acc, LEAST_PART * usual_g, MOST_TIMES * usual_g)
    if marked.any():  # few files have such
        marked &= mark_equal(gyr, np.inf, np.inf)
    return marked


def mark_equal(values: Values, low: float, high: float) -> NDArray[np.bool_]:
    """Which rows show one size on all axes, under ``low`` or over ``high``, shape (n,)."""
    marked = np.empty(len(values), np.bool_)
    _mark_equal(values, low, high, marked)
    return marked


@kernel
def _mark_equal(values: Any, low: float, high: float, marked: Any) -> None:  # pragma: no cover
    for row in range(len(values)):
        size = abs(values[row, 0])
        is_equal = size == abs(values[row, 1]) and size == abs(values[row, 2])
        marked[row] = is_equal and (size < low or size > high)


def find_runs(marked: NDArray[np.bool_], shortest_rows: int = 1) -> Rows:
    """Runs of marked rows, so long at least, shape (m, 2): first row and first row after."""
    rows = np.flatnonzero(marked)
    is_first = np.diff(rows, prepend=-2) > 1
    runs = np.stack([rows[is_first], rows[np.roll(is_first, -1)] + 1], axis=1)
    return runs[runs[:, 1] - runs[:, 0] >= shortest_rows]


def place_rows(segment: Segment, first_row: int, stop_row: int, reason: str = "") -> Span:
    """Rows as a stretch of the recording."""
    start_us, end_us = (
        segment.start_us + round(row * MICROSECONDS / segment.rate_hz) for row in (first_row, stop_row)
    )
    return Span(start_us, end_us - start_us, reason)


def cut_rows(segment: Segment, ranges: Ranges) -> list[Segment]:
    """What is left of a segment without some of its rows."""
    if not ranges:
        return [segment]
    edges = [0, *(row for pair in ranges for row in pair), len(segment)]
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [_take_rows(segment, first, stop) for first, stop in pairs if stop > first]


def _take_rows(segment: Segment, first_row: int, stop_row: int) -> Segment:
    """Rounded to the microsecond, yet never beyond the end of the whole."""
    bridged = [(max(a, first_row) - first_row, min(b, stop_row) - first_row) for a, b in segment.bridged]
    piece = replace(
        segment,
        start_us=place_rows(segment, 0, first_row).end_us,
        acc_g=segment.acc_g[first_row:stop_row],
        gyr_dps=segment.gyr_dps[first_row:stop_row],
        bridged=tuple((a, b) for a, b in bridged if b > a),
    )
    return replace(piece, start_us=piece.start_us - max(0, piece.end_us - segment.end_us))
