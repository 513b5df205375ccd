"""Rainflow cycles of elevation (EXPOSURE.md A5; ASTM E1049-85 §5.4.4)."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.rows import IntArray
from fusion.exposure.types import Cycles

HYSTERESIS_DEG = 5.0
RANGE_EDGES_DEG = (10.0, 30.0, 60.0, 90.0, None)
USUAL_POINTS = 65536

FloatVector = NDArray[np.float64]


def count_cycles(angle: MetricAngle) -> FloatVector:
    """Count the cycles of one segment in each range class, shape (4,); a half cycle counts 0.5.

    Runs of valid rows are counted apart. Ranges under 10 deg are in no class.
    """
    points_deg, runs = find_turning_points(angle, HYSTERESIS_DEG)
    ranges_deg, weights = count_rainflow(points_deg, runs)
    edges = [*RANGE_EDGES_DEG[:-1], np.inf]
    # the angle is rounded to 1e-6 deg, so must be the difference of two angles
    counts, _ = np.histogram(np.round(ranges_deg, 6), edges, weights=weights)
    return np.asarray(counts, np.float64)


def find_turning_points(angle: MetricAngle, hysteresis_deg: float) -> tuple[FloatVector, IntArray]:
    """Give the peaks and valleys left after a hysteresis filter, and the valid run each belongs to.

    A reversal counts once the angle has come back by the hysteresis; the first and the last extreme of a run
    are turning points.
    """
    points_deg, runs = np.empty(USUAL_POINTS), np.empty(USUAL_POINTS, np.int64)
    count = _scan_turning_points(angle.elevation_deg, angle.valid, hysteresis_deg, points_deg, runs)
    if count > len(points_deg):
        points_deg, runs = np.empty(count), np.empty(count, np.int64)
        _scan_turning_points(angle.elevation_deg, angle.valid, hysteresis_deg, points_deg, runs)
    return points_deg[:count], runs[:count]


@njit(cache=True, nogil=True)
def _scan_turning_points(angle_deg, valid, hysteresis_deg, points_deg, runs):  # type: ignore[no-untyped-def]
    """Write as many turning points as there is room for; return how many there are.

    ``direction`` is 0 until the run has moved by the hysteresis, then 1 on the way up, -1 on the way down;
    ``low`` and ``high`` are the extremes since the last turning point.
    """
    count, run, direction, low, high = 0, 0, 0, np.inf, -np.inf
    for i in range(len(angle_deg) + 1):
        if i == len(angle_deg) or not valid[i]:
            if direction != 0:
                count = _write_point(points_deg, runs, count, high if direction > 0 else low, run)
            run, direction, low, high = run + 1, 0, np.inf, -np.inf
            continue
        x = angle_deg[i]
        low, high = min(low, x), max(high, x)
        if direction <= 0 and x - low >= hysteresis_deg:
            count = _write_point(points_deg, runs, count, low, run)
            direction, high = 1, x
        elif direction >= 0 and high - x >= hysteresis_deg:
            count = _write_point(points_deg, runs, count, high, run)
            direction, low = -1, x
    return count


@njit(cache=True, nogil=True)
def _write_point(points_deg, runs, count, point_deg, run):  # type: ignore[no-untyped-def]
    if count < len(points_deg):
        points_deg[count] = point_deg
        runs[count] = run
    return count + 1


@njit(cache=True, nogil=True)
def count_rainflow(points, runs):  # type: ignore[no-untyped-def]
    """Give the ranges and their counts (1 or 0.5) of turning points, each run by itself.

    ASTM E1049-85 §5.4.4 with the points still in play on a stack: the last range X closes the one before, Y,
    when X >= Y; a Y that holds the starting point is a half cycle, and so is all that is left at the end.
    """
    ranges, weights = np.empty(len(points)), np.empty(len(points))
    stack = np.empty(len(points))
    count, top = 0, 0
    for k in range(len(points) + 1):
        if k == len(points) or (k > 0 and runs[k] != runs[k - 1]):
            for j in range(top - 1):
                ranges[count], weights[count] = abs(stack[j + 1] - stack[j]), 0.5
                count += 1
            top = 0
        if k == len(points):
            break
        stack[top] = points[k]
        top += 1
        while top >= 3 and abs(stack[top - 1] - stack[top - 2]) >= abs(stack[top - 2] - stack[top - 3]):
            ranges[count] = abs(stack[top - 2] - stack[top - 3])
            weights[count] = 0.5 if top == 3 else 1.0
            count += 1
            if top == 3:
                stack[0], stack[1] = stack[1], stack[2]
                top = 2
            else:
                stack[top - 3] = stack[top - 1]
                top -= 2
    return ranges[:count], weights[:count]


def summarise_cycles(counts: FloatVector) -> tuple[Cycles, ...]:
    """Name the classes; ``counts`` has shape (4,)."""
    return tuple(
        Cycles(float(lower or 0.0), upper, float(count))
        for lower, upper, count in zip(RANGE_EDGES_DEG[:-1], RANGE_EDGES_DEG[1:], counts, strict=True)
    )
