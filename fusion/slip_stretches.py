"""Every stretch of a day held against the rest of it: whether both show the arm hanging alike.

A stretch begins and ends at any of some hundred times. One that reaches to neither end of the day is a sensor
that turned and was pushed back. Moments are counted by cells of direction up to each time once; a stretch is
then the difference of two counts, so that thousands of them are compared at little cost.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.postures import LEAST_STRIDING, NEAR_DEG, Moments, Table, cos_deg
from fusion.rest_probes import tell_directions

Rows = NDArray[np.intp]
Counts = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class CountedMoments:
    """Calm and walking moments by c cells of direction.

    ``calm_cell`` (n,) and ``stride_cell`` (m,) say which; ``centre`` (c, 3) are unit vectors; ``near`` (c, c)
    is 1 where two cells lie near each other.
    """

    calm: Moments
    strides: Moments
    calm_cell: Rows
    stride_cell: Rows
    centre: Table
    near: Counts


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """Stretches from one calm moment to another, each beside the rest; all shapes (k,).

    ``known``: how well both know each other's commonest direction, 2 if they are alike, 0 if not at all
    (:func:`fusion.postures.compare_postures`); ``angle_deg``: between these. ``hangs_deg``: between the
    directions in which the arm hangs in walking, NaN where one is not known; ``strides``: moments of walking
    on the side that has fewer.
    """

    known: Table
    angle_deg: Table
    hangs_deg: Table
    strides: NDArray[np.int64]


def count_moments(calm: Moments, strides: Moments, cell_deg: float) -> CountedMoments:
    """Sort moments into cells; walking is put into those of the calm moments."""
    cell = tell_directions(calm.up, cell_deg)
    sums = [np.bincount(cell, calm.up[:, axis]) for axis in range(3)]
    centre = _scale(np.stack(sums, axis=1).astype(np.float64))
    near = (centre @ centre.T >= cos_deg(NEAR_DEG)).astype(np.float32)
    return CountedMoments(calm, strides, cell, np.argmax(strides.up @ centre.T, axis=1), centre, near)


def compare_stretches(counted: CountedMoments, edges: Rows, first: Rows, stop: Rows) -> Stretches:
    """Hold stretches against the rest of what lies between the outermost edges.

    ``edges`` (e,): calm moments, in order, where a stretch may begin or end; ``first``, ``stop`` (k,): places
    in ``edges``.
    """
    interval = np.searchsorted(edges, np.arange(len(counted.calm_cell)), "right")
    sums = _add_up(counted.calm_cell, interval, len(edges), counted.near)
    inside, beside = _part(sums[0], first, stop)
    at, to, row = inside.argmax(axis=1), beside.argmax(axis=1), np.arange(len(first))
    known = beside[row, at] / beside[row, to] + inside[row, to] / inside[row, at]
    angle_deg = _find_angles_deg(counted.centre[at], counted.centre[to])
    return Stretches(known.astype(np.float64), angle_deg, *_compare_walking(counted, edges, first, stop))


def _compare_walking(
    counted: CountedMoments, edges: Rows, first: Rows, stop: Rows
) -> tuple[Table, NDArray[np.int64]]:
    """Angle between the directions of walking, NaN where it is not known, and the lesser count."""
    calm_s = np.append(counted.calm.time_s, np.inf)
    interval = np.searchsorted(calm_s[edges], counted.strides.time_s, "right")
    sums = _add_up(counted.stride_cell, interval, len(edges), counted.near, *counted.strides.up.T)
    inside, beside = _part(sums[0], first, stop)
    at, to = inside.argmax(axis=1), beside.argmax(axis=1)
    here = sums[1:, stop, at] - sums[1:, first, at]
    there = sums[1:, -1, to] - (sums[1:, stop, to] - sums[1:, first, to])
    walked = np.concatenate([[0], np.cumsum(np.bincount(interval, minlength=len(edges) + 1)[1:-1])])
    within = walked[stop] - walked[first]
    fewer = np.minimum(within, walked[-1] - within)
    angle_deg = _find_angles_deg(*(_scale(sums.T.astype(np.float64)) for sums in (here, there)))
    return np.where(fewer >= LEAST_STRIDING, angle_deg, np.nan), fewer


def _add_up(cell: Rows, interval: Rows, edges: int, near: Counts, *weights: Table) -> Counts:
    """Count, and sum weights, near each cell from the first edge to each: (1 + weights, edges, c)."""
    cells = len(near)
    place, bins = interval * cells + cell, (edges + 1) * cells
    tables = np.stack([np.bincount(place, weight, bins) for weight in (None, *weights)])
    tables = tables.reshape(-1, edges + 1, cells)[:, :edges].astype(np.float32)
    tables[:, 0] = 0.0
    return np.asarray(np.cumsum(tables, axis=1) @ near)


def _part(sums: Counts, first: Rows, stop: Rows) -> tuple[Counts, Counts]:
    """What lies in each stretch, and what beside it."""
    inside = sums[stop] - sums[first]
    return inside, sums[-1] - inside


def _scale(vectors: Table) -> Table:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9))


def _find_angles_deg(first: Table, second: Table) -> Table:
    return np.asarray(np.degrees(np.arccos(np.clip((first * second).sum(axis=1), -1.0, 1.0))))
