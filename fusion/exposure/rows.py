"""Which rows of an evenly sampled run fall into a stretch of time.

Row i of a run lasts from ``start + i`` periods to ``start + i + 1`` periods. One microsecond is the
resolution of all times, so an overlap of up to one microsecond is no overlap.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fusion.numba_kernels import inner, kernel
from fusion.numerics.runs import LEVEL, START, STOP, find_runs
from fusion.recording import MICROSECONDS, BoolArray, IntArray, Span


class EvenRun(Protocol):
    """An unbroken, evenly sampled run of rows."""

    @property
    def start_us(self) -> int:
        """Time of the first row."""

    @property
    def rate_hz(self) -> float:
        """Rows per second."""

    def __len__(self) -> int: ...


def find_end_us(run: EvenRun) -> int:
    """Return the first microsecond after the last row's period."""
    return run.start_us + round(len(run) * MICROSECONDS / run.rate_hz)


def find_first_rows(run: EvenRun, times_us: IntArray) -> IntArray:
    """Return, for each time, the first row that begins then or later (``len(run)`` if there is none)."""
    position = (times_us - run.start_us) * (run.rate_hz / MICROSECONDS)
    rows = np.ceil(position - run.rate_hz / MICROSECONDS)
    return np.asarray(np.clip(rows, 0, len(run)), np.int64)


def find_part_rows(run: EvenRun, edges_us: IntArray) -> IntArray:
    """Return the first row of each part between successive edges; the outer parts take all the rest."""
    rows = find_first_rows(run, edges_us)
    rows[0], rows[-1] = 0, len(run)
    return rows


@inner
def find_part(edges, value):  # type: ignore[no-untyped-def]
    """Return the last of the ascending edges that is not above the value; -1 where there is none.

    numpy's own search would load half of the compiler into every process: 0.2 s.
    """
    first, stop = 0, len(edges)
    while first < stop:
        middle = (first + stop) // 2
        if edges[middle] <= value:
            first = middle + 1
        else:
            stop = middle
    return first - 1


@inner
def add_rows(first, stop, worth, part_rows, sums):  # type: ignore[no-untyped-def]
    """Add what a stretch of rows is worth to the parts that they lie in; return the first one's number."""
    part = min(find_part(part_rows, first), len(sums) - 1)
    begun, here = part, first
    while here < stop:
        end = min(stop, part_rows[part + 1])
        sums[part] += (end - here) * worth
        here, part = end, part + 1
    return begun


def find_parts(edges: IntArray, values: ArrayLike) -> IntArray:
    """Return the part between successive ascending edges in which each value lies."""
    return np.asarray(np.searchsorted(edges, values, side="right") - 1, np.int64)


@kernel
def add_spans(stays, worth, part_rows, sums):  # type: ignore[no-untyped-def]
    """Add what the rows of each stay (:mod:`fusion.numerics.runs`) are worth to its level, shape (t, p)."""
    for k in range(len(stays)):
        add_rows(stays[k, START], stays[k, STOP], worth, part_rows, sums[stays[k, LEVEL]])


def find_touched_rows(run: EvenRun, start_us: int, end_us: int) -> slice:
    """Return the rows whose period overlaps [start, end)."""
    tolerance = run.rate_hz / MICROSECONDS
    first = np.floor((start_us - run.start_us) * (run.rate_hz / MICROSECONDS) + tolerance)
    stop = np.ceil((end_us - run.start_us) * (run.rate_hz / MICROSECONDS) - tolerance)
    first, stop = np.clip([first, stop], 0, len(run))
    return slice(int(first), max(int(first), int(stop)))


def list_touched_rows(run: EvenRun, spans: Sequence[Span]) -> list[slice]:
    """Return the rows of each span, of some in time order and apart, that overlaps the run."""
    first = bisect_right(spans, run.start_us, key=lambda span: span.end_us)
    stop = bisect_left(spans, find_end_us(run), first, key=lambda span: span.start_us)
    touched = (find_touched_rows(run, span.start_us, span.end_us) for span in spans[first:stop])
    return [rows for rows in touched if rows.stop > rows.start]


def find_touched_parts(run: EvenRun, edges_us: IntArray) -> slice:
    """Return the parts between successive edges that hold rows of the run."""
    first = int(np.searchsorted(edges_us, run.start_us, side="right")) - 1
    stop = int(np.searchsorted(edges_us, find_end_us(run), side="left"))
    return slice(max(first, 0), min(max(stop, 0), len(edges_us) - 1))


@kernel
def add_time(counts, rate_hz, cell_us):  # type: ignore[no-untyped-def]
    """Add counts of rows, shape (p, c), as whole microseconds that add up to the rounded whole, exactly."""
    rows, told_us = 0, 0
    for part in range(counts.shape[0]):
        for cell in range(counts.shape[1]):
            if counts[part, cell] > 0:
                rows += counts[part, cell]
                reached_us = int(np.rint(rows * (MICROSECONDS / rate_hz)))
                cell_us[part, cell] += reached_us - told_us
                told_us = reached_us


def find_valid_samples(valid: BoolArray, samples: int) -> BoolArray:
    """Return the samples that lie wholly in valid rows, shape (samples,); rows share the samples evenly."""
    rows = len(valid)
    if rows == samples:
        return valid
    wholly = np.ones(samples, np.bool_)
    for first, stop in find_runs(~valid).tolist():
        wholly[first * samples // rows : -(-stop * samples // rows)] = False
    return wholly
