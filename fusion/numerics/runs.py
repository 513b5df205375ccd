"""Unbroken runs of rows: those that are marked, and those above a threshold with hysteresis."""

from collections.abc import Callable
from typing import Any

import numpy as np

from fusion.numba_kernels import inner, kernel
from fusion.recording import BoolArray, Float64Array, IntArray

USUAL_RUNS, USUAL_STAYS = 256, 16_384
LEVEL, START, STOP, IS_ENTRY, IS_CUT, RUN = range(6)
"""Columns of :func:`find_stays_above`."""


def find_runs(mask: BoolArray, shortest_rows: int = 1) -> IntArray:
    """Return the runs of true rows, shape (k, 2): first row and the row after the last."""
    runs = _write_all(lambda room: _scan_runs(mask, room), (USUAL_RUNS, 2))
    return runs if shortest_rows == 1 else runs[runs[:, 1] - runs[:, 0] >= shortest_rows]


def find_stays_above(
    values: Float64Array, valid: BoolArray, enter: Float64Array, leave: Float64Array
) -> IntArray:
    """Run a Schmitt trigger at each level: above from a value over ``enter`` to one under ``leave``.

    A run of valid rows that starts above a level starts with a stay, but not with an entry.

    ``values``, ``valid``: shape (n,).
    ``enter``, ``leave``: shape (t,): the thresholds of each level, both rising from level to level.

    Returns
    -------
    numpy.ndarray
        Shape (k, 6): level, first row, row after the last, whether it is an entry, whether a row that is not
        valid or the end cuts it, number of its run of valid rows. Level by level, in order of time.
    """
    since = np.empty((len(enter), 2), np.int64)
    stays = _write_all(lambda room: _scan_stays(values, valid, enter, leave, since, room), (USUAL_STAYS, 6))
    return stays[np.argsort(stays[:, LEVEL], kind="stable")]


def _write_all(write: Callable[[IntArray], int], usual: tuple[int, int]) -> IntArray:
    """Let ``write`` fill as many rows as there is room for, once more if there are more than usual."""
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
    """``above`` counts the levels that are up; ``since`` holds when each went up, and whether by an entry."""
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
