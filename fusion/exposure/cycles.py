"""Rainflow cycles of elevation (ASTM E1049-85 §5.4.4)."""

from itertools import pairwise

import numpy as np

from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.resampling import Figures, Resampling
from fusion.exposure.types import Cycles
from fusion.numba_kernels import inner, kernel, kernel_making_arrays
from fusion.recording import Float64Array, IntArray
from fusion.runs import find_part_rows, find_parts

HYSTERESIS_DEG = 5.0
RANGE_EDGES_DEG = (10.0, 30.0, 60.0, 90.0, None)
USUAL_POINTS = 65536


class CycleTally:
    """Cycles by error of the angle, 5-minute block and class of range: ``counts``, shape (g, b, 4).

    A half cycle counts 0.5; runs of valid rows are counted apart; ranges under 10 deg are in no class. A
    cycle belongs to the block in which its range ends.
    """

    def __init__(self, errors_deg: Float64Array, edges_us: IntArray) -> None:
        """Start with nothing counted; ``errors_deg``, shape (g,), has 0 in the middle."""
        self.errors_deg, self.edges_us = errors_deg, edges_us
        self.counts = np.zeros((len(errors_deg), len(edges_us) - 1, len(RANGE_EDGES_DEG) - 1))

    def add(self, angle: MetricAngle) -> None:
        """Count a segment: with an error b each angle is b lower, but none is under 0 or over 180 deg.

        Clipped turning points have the ranges of the clipped angle, but for some under the hysteresis, which
        lie inside others and are in no class.
        """
        points_deg, runs, rows = find_turning_points(angle, HYSTERESIS_DEG)
        parts = find_parts(find_part_rows(angle, self.edges_us), rows)
        as_read = np.zeros(self.counts.shape[1:])
        _count_ranges(points_deg, runs, parts, as_read)
        lowest, highest = points_deg.min(initial=180.0), points_deg.max(initial=0.0)
        for error, error_deg in enumerate(self.errors_deg):
            if lowest >= error_deg and highest - error_deg <= 180.0:
                self.counts[error] += as_read  # nothing is clipped, so that no range changes
            else:
                clipped_deg = np.clip(points_deg - error_deg, 0.0, 180.0)
                _count_ranges(clipped_deg, runs, parts, self.counts[error])

    def summarise(self) -> tuple[Cycles, ...]:
        """Return the counts of the angle as it was read."""
        counts = self.counts[len(self.errors_deg) // 2].sum(axis=0)
        return tuple(
            Cycles(float(lower or 0.0), upper, float(count))
            for (lower, upper), count in zip(pairwise(RANGE_EDGES_DEG), counts, strict=True)
        )

    def draw(self, draws: Resampling, block_s: Float64Array) -> Figures:
        """Draw the counts: the sampling of the day, and an error of the angle.

        An error changes a range only where it brings the angle to an end of its scale.
        """
        share = draws.sum(block_s) / block_s.sum()
        drawn = draws.sum_with_error(self.counts, self.errors_deg) / share[:, np.newaxis]
        ends = [f"{edge:g}" if edge is not None else "up" for edge in RANGE_EDGES_DEG]
        return {
            f"cycles_{lower}_{upper}_count": drawn[:, k] for k, (lower, upper) in enumerate(pairwise(ends))
        }


def _count_ranges(points_deg: Float64Array, runs: IntArray, parts: IntArray, counts: Float64Array) -> None:
    ranges_deg, weights, ends = count_rainflow(points_deg, runs)
    # the angle is rounded to 1e-6 deg, so must be the difference of two angles
    classes = np.searchsorted(RANGE_EDGES_DEG[:-1], np.round(ranges_deg, 6), side="right") - 1
    kept = classes >= 0
    np.add.at(counts, (parts[ends[kept]], classes[kept]), weights[kept])


def find_turning_points(angle: MetricAngle, hysteresis_deg: float) -> tuple[Float64Array, IntArray, IntArray]:
    """Return the peaks and valleys left after a hysteresis filter, the valid run of each, and its row.

    A reversal counts once the angle has come back by the hysteresis; the first and the last extreme of a run
    are turning points.
    """
    points_deg, places = np.empty(USUAL_POINTS), np.empty((USUAL_POINTS, 2), np.int64)
    count = _scan_turning_points(angle.elevation_deg, angle.valid, hysteresis_deg, points_deg, places)
    if count > len(points_deg):
        points_deg, places = np.empty(count), np.empty((count, 2), np.int64)
        _scan_turning_points(angle.elevation_deg, angle.valid, hysteresis_deg, points_deg, places)
    return points_deg[:count], places[:count, 0], places[:count, 1]


@kernel
def _scan_turning_points(angle_deg, valid, hysteresis_deg, points_deg, places):  # type: ignore[no-untyped-def]
    """Write as many turning points as there is room for; return how many there are.

    ``direction`` is 0 until the run has moved by the hysteresis, then 1 on the way up, -1 on the way down;
    ``low`` and ``high`` are the extremes since the last turning point, at the rows ``at_low``, ``at_high``.
    """
    count, run, direction, low, high = 0, 0, 0, np.inf, -np.inf
    at_low, at_high = 0, 0
    for i in range(len(angle_deg) + 1):
        if i == len(angle_deg) or not valid[i]:
            if direction != 0:
                point_deg, row = (high, at_high) if direction > 0 else (low, at_low)
                count = _write_point(points_deg, places, count, point_deg, (run, row))
            run, direction, low, high = run + 1, 0, np.inf, -np.inf
            continue
        x = angle_deg[i]
        if x < low:
            low, at_low = x, i
        if x > high:
            high, at_high = x, i
        if direction <= 0 and x - low >= hysteresis_deg:
            count = _write_point(points_deg, places, count, low, (run, at_low))
            direction, high, at_high = 1, x, i
        elif direction >= 0 and high - x >= hysteresis_deg:
            count = _write_point(points_deg, places, count, high, (run, at_high))
            direction, low, at_low = -1, x, i
    return count


@inner
def _write_point(points_deg, places, count, point_deg, place):  # type: ignore[no-untyped-def]
    if count < len(points_deg):
        points_deg[count] = point_deg
        places[count, 0], places[count, 1] = place
    return count + 1


@kernel_making_arrays
def count_rainflow(points, runs):  # type: ignore[no-untyped-def]
    """Return the ranges, their counts (1 or 0.5) and the point that ends each; every run by itself.

    ASTM E1049-85 §5.4.4 with the points still in play on a stack: the last range X closes the one before, Y,
    when X >= Y; a Y that holds the starting point is a half cycle, and so is all that is left at the end.
    """
    ranges, weights = np.empty(len(points)), np.empty(len(points))
    ends, stack = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    count, top = 0, 0
    for k in range(len(points) + 1):
        if k == len(points) or (k > 0 and runs[k] != runs[k - 1]):
            for j in range(1, top):
                ranges[count], weights[count] = abs(points[stack[j]] - points[stack[j - 1]]), 0.5
                ends[count] = stack[j]
                count += 1
            top = 0
        if k == len(points):
            break
        stack[top] = k
        top += 1
        while top >= 3:
            x = abs(points[stack[top - 1]] - points[stack[top - 2]])
            y = abs(points[stack[top - 2]] - points[stack[top - 3]])
            if x < y:
                break
            ranges[count], weights[count], ends[count] = y, 0.5 if top == 3 else 1.0, stack[top - 2]
            count += 1
            if top == 3:
                stack[0], stack[1] = stack[1], stack[2]
                top = 2
            else:
                stack[top - 3] = stack[top - 1]
                top -= 2
    return ranges[:count], weights[:count], ends[:count]
