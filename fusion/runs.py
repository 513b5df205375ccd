"""Find unbroken runs of evenly sampled rows, and the rows within a stretch of time."""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from acromion.fusion.numba_kernels import inner, kernel
from acromion.fusion.recording import MICROSECONDS, BoolArray, Float64Array, IntArray, Span

# Runs of marked rows, and of rows above a threshold with hysteresis.

USUAL_RUNS, USUAL_STAYS = 256, 16_384
LEVEL, START, STOP, IS_ENTRY, IS_CUT, RUN = range(6)
"""Columns of the result of :func:`find_stays_above`."""


def find_runs(mask: BoolArray, shortest_rows: int = 1) -> IntArray:
    """Return the runs of true rows, shape (k, 2): first row and the row after the last."""
    runs = _write_all(lambda room: _scan_runs(mask, room), (USUAL_RUNS, 2))
    return runs if shortest_rows == 1 else runs[runs[:, 1] - runs[:, 0] >= shortest_rows]


def find_stays_above(
    values: Float64Array, valid: BoolArray, enter: Float64Array, leave: Float64Array
) -> IntArray:
    """Run a Schmitt trigger at each level: a stay lasts from a value above ``enter`` to one below ``leave``.

    If a run of valid rows starts above a level, it starts with a stay but not with an entry.

    ``values``, ``valid``: shape (n,).
    ``enter``, ``leave``: shape (t,): the thresholds of each level, both rising from level to level.

    Returns
    -------
    numpy.ndarray
        Shape (k, 6): level, first row, row after the last, whether it is an entry, whether an invalid row or
        the end cuts it, number of its run of valid rows. Ordered by level, then time.
    """
    since = np.empty((len(enter), 2), np.int64)
    stays = _write_all(lambda room: _scan_stays(values, valid, enter, leave, since, room), (USUAL_STAYS, 6))
    return stays[np.argsort(stays[:, LEVEL], kind="stable")]


def _write_all(write: Callable[[IntArray], int], usual: tuple[int, int]) -> IntArray:
    """Run ``write`` on a buffer of the usual size, and again on a larger one if it was too small."""
    rows = np.empty(usual, np.int64)
    count = write(rows)
    if count > len(rows):
        rows = np.empty((count, usual[1]), np.int64)
        write(rows)
    return rows[:count]


@kernel
def _scan_runs(mask: Any, runs: Any) -> int:  # pragma: no cover
    count, first = 0, -1
    for i in range(len(mask) + 1):
        here = i < len(mask) and mask[i]
        if here and first < 0:
            first = i
        elif not here and first >= 0:
            if count < len(runs):
                runs[count, 0], runs[count, 1] = first, i
            count, first = count + 1, -1
    return count


@kernel
def _scan_stays(
    values: Any, valid: Any, enter: Any, leave: Any, since: Any, stays: Any
) -> int:  # pragma: no cover
    """``above`` counts the levels that are up; ``since``: when each went up, and whether by an entry."""
    count, run, above, inside, top, bottom = 0, 0, 0, False, enter[0], -np.inf
    for i in range(len(values) + 1):
        if i == len(values) or not valid[i]:
            for level in range(above):
                count = _write_stay(stays, count, level, since, i, 1, run)
            run += inside
            above, inside, top, bottom = 0, False, enter[0], -np.inf
            continue
        x = values[i]
        if x > top or x < bottom:
            while above < len(enter) and x > enter[above]:
                since[above, 0], since[above, 1] = i, inside
                above += 1
            while above > 0 and x < leave[above - 1]:
                above -= 1
                count = _write_stay(stays, count, above, since, i, 0, run)
            top = enter[above] if above < len(enter) else np.inf
            bottom = leave[above - 1] if above > 0 else -np.inf
        inside = True
    return count


@inner
def _write_stay(
    stays: Any, count: int, level: int, since: Any, stop: int, is_cut: int, run: int
) -> int:  # pragma: no cover
    if count < len(stays):
        stays[count, LEVEL], stays[count, START], stays[count, STOP] = level, since[level, 0], stop
        stays[count, IS_ENTRY], stays[count, IS_CUT], stays[count, RUN] = since[level, 1], is_cut, run
    return count + 1


# Rows of an evenly sampled run within a stretch of time.
#
# Row i of a run lasts from ``start + i`` periods to ``start + i + 1`` periods. All times have a resolution of
# one microsecond, so an overlap of up to one microsecond does not count.


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
    """Return the first microsecond after the last row."""
    return run.start_us + round(len(run) * MICROSECONDS / run.rate_hz)


def find_first_rows(run: EvenRun, times_us: IntArray) -> IntArray:
    """Return, for each time, the first row that begins at or after it (``len(run)`` if there is none)."""
    position = (times_us - run.start_us) * (run.rate_hz / MICROSECONDS)
    rows = np.ceil(position - run.rate_hz / MICROSECONDS)
    return np.asarray(np.clip(rows, 0, len(run)), np.int64)


def find_part_rows(run: EvenRun, edges_us: IntArray) -> IntArray:
    """Return the first row of each part between edges; the outer parts extend to the ends of the run."""
    rows = find_first_rows(run, edges_us)
    rows[0], rows[-1] = 0, len(run)
    return rows


@inner
def find_part(edges, value):  # type: ignore[no-untyped-def]
    """Return the last of the ascending edges that is not above the value; -1 if there is none.

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
    """Add the value of a stretch of rows to the parts with these rows; return the first part's number."""
    part = min(find_part(part_rows, first), len(sums) - 1)
    begun, here = part, first
    while here < stop:
        end = min(stop, part_rows[part + 1])
        sums[part] += (end - here) * worth
        here, part = end, part + 1
    return begun


def find_parts(edges: IntArray, values: ArrayLike) -> IntArray:
    """Return, for each value, the number of the part between successive ascending edges."""
    return np.asarray(np.searchsorted(edges, values, side="right") - 1, np.int64)


@kernel
def add_spans(stays, worth, part_rows, sums):  # type: ignore[no-untyped-def]
    """Add the value of each stay's rows (:mod:`acromion.fusion.runs`) to its level, shape (t, p)."""
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
    """Return the rows of each span that overlaps the run; the spans are sorted and do not overlap."""
    first = bisect_right(spans, run.start_us, key=lambda span: span.end_us)
    stop = bisect_left(spans, find_end_us(run), first, key=lambda span: span.start_us)
    touched = (find_touched_rows(run, span.start_us, span.end_us) for span in spans[first:stop])
    return [rows for rows in touched if rows.stop > rows.start]


def find_touched_parts(run: EvenRun, edges_us: IntArray) -> slice:
    """Return the parts between successive edges that contain rows of the run."""
    first = int(np.searchsorted(edges_us, run.start_us, side="right")) - 1
    stop = int(np.searchsorted(edges_us, find_end_us(run), side="left"))
    return slice(max(first, 0), min(max(stop, 0), len(edges_us) - 1))


@kernel
def add_time(counts, rate_hz, cell_us):  # type: ignore[no-untyped-def]
    """Add counts of rows, shape (p, c), as whole microseconds whose sum is exactly the rounded total."""
    rows, told_us = 0, 0
    for part in range(counts.shape[0]):
        for cell in range(counts.shape[1]):
            if counts[part, cell] > 0:
                rows += counts[part, cell]
                reached_us = int(np.rint(rows * (MICROSECONDS / rate_hz)))
                cell_us[part, cell] += reached_us - told_us
                told_us = reached_us


def find_valid_samples(valid: BoolArray, samples: int) -> BoolArray:
    """Return the samples wholly within valid rows, shape (samples,); rows share the samples evenly."""
    rows = len(valid)
    if rows == samples:
        return valid
    wholly = np.ones(samples, np.bool_)
    for first, stop in find_runs(~valid).tolist():
        wholly[first * samples // rows : -(-stop * samples // rows)] = False
    return wholly
