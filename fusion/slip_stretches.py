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
    """Moments by c cells of direction.

    ``cell`` (n,) says which; ``centre`` (c, 3) are unit vectors; ``near`` (c, c) is 1 where two cells lie
    near each other.
    """

    moments: Moments
    cell: Rows
    centre: Table
    near: Counts


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """Stretches from one calm moment to another, each beside the rest; all shapes (k,).

    ``known``: how well both know each other's commonest direction, 2 if they are alike, 0 if not at all
    (:func:`fusion.postures.compare_postures`); ``angle_deg``: between these. ``hangs_deg``: between the
    directions in which the arm hangs in walking, NaN where one is not known; ``strides``: moments of walking
    on the side that has fewer; ``explained``: share of all walking near the direction of its own side;
    ``pure``: that share on the side where it is less; ``crossed``: shares of each near that of the other, as
    in ``known``.
    """

    known: Table
    angle_deg: Table
    hangs_deg: Table
    strides: NDArray[np.int64]
    explained: Table
    pure: Table
    crossed: Table


def count_moments(moments: Moments, cell_deg: float) -> CountedMoments:
    """Sort moments into cells."""
    cell = tell_directions(moments.up, cell_deg)
    sums = [np.bincount(cell, moments.up[:, axis]) for axis in range(3)]
    centre = _scale(np.stack(sums, axis=1).astype(np.float64))
    near = (centre @ centre.T >= cos_deg(NEAR_DEG)).astype(np.float32)
    return CountedMoments(moments, cell, centre, near)


def compare_stretches(
    calm: CountedMoments, strides: CountedMoments, edges: Rows, first: Rows, stop: Rows
) -> Stretches:
    """Hold stretches against the rest of what lies between the outermost edges.

    ``edges`` (e,): calm moments, in order, where a stretch may begin or end; ``first``, ``stop`` (k,): places
    in ``edges``.
    """
    interval = np.searchsorted(edges, np.arange(len(calm.cell)), "right")
    inside, beside = _part(_add_up(calm, interval, len(edges))[0], first, stop)
    at, to, row = inside.argmax(axis=1), beside.argmax(axis=1), np.arange(len(first))
    known = beside[row, at] / beside[row, to] + inside[row, to] / inside[row, at]
    angle_deg = _find_angles_deg(calm.centre[at], calm.centre[to])
    edges_s = np.append(calm.moments.time_s, np.inf)[edges]
    return Stretches(known.astype(np.float64), angle_deg, *_compare_walking(strides, edges_s, first, stop))


def _compare_walking(
    strides: CountedMoments, edges_s: Table, first: Rows, stop: Rows
) -> tuple[Table, NDArray[np.int64], Table, Table, Table]:
    """Angle between the directions of walking (NaN: not known), the lesser count, shares explained."""
    interval = np.searchsorted(edges_s, strides.moments.time_s, "right")
    walked = np.concatenate([[0], np.cumsum(np.bincount(interval, minlength=len(edges_s) + 1)[1:-1])])
    within = walked[stop] - walked[first]
    fewer = np.minimum(within, walked[-1] - within)
    if fewer.max(initial=0) < LEAST_STRIDING:
        nothing = np.zeros(len(first))
        return np.full(len(first), np.nan), fewer, nothing, nothing, nothing
    sums = _add_up(strides, interval, len(edges_s), *strides.moments.up.T)
    inside, beside = _part(sums[0], first, stop)
    at, to = inside.argmax(axis=1), beside.argmax(axis=1)
    here = sums[1:, stop, at] - sums[1:, first, at]
    there = sums[1:, -1, to] - (sums[1:, stop, to] - sums[1:, first, to])
    angle_deg = _find_angles_deg(*(_scale(sums.T.astype(np.float64)) for sums in (here, there)))
    row = np.arange(len(first))
    near, far = inside[row, at].astype(np.float64), beside[row, to].astype(np.float64)
    pure = np.minimum(near / np.maximum(within, 1), far / np.maximum(walked[-1] - within, 1))
    crossed = inside[row, to] / np.maximum(near, 1.0) + beside[row, at] / np.maximum(far, 1.0)
    hangs_deg = np.where(fewer >= LEAST_STRIDING, angle_deg, np.nan)
    return hangs_deg, fewer, (near + far) / walked[-1], pure, crossed


def _add_up(counted: CountedMoments, interval: Rows, edges: int, *weights: Table) -> Counts:
    """Count, and sum weights, near each cell from the first edge to each: (1 + weights, edges, c)."""
    cells = len(counted.near)
    place, bins = interval * cells + counted.cell, (edges + 1) * cells
    tables = np.stack([np.bincount(place, weight, bins) for weight in (None, *weights)])
    tables = tables.reshape(-1, edges + 1, cells)[:, :edges].astype(np.float32)
    tables[:, 0] = 0.0
    return np.asarray(np.cumsum(tables, axis=1) @ counted.near)


def _part(sums: Counts, first: Rows, stop: Rows) -> tuple[Counts, Counts]:
    """What lies in each stretch, and what beside it."""
    inside = sums[stop] - sums[first]
    return inside, sums[-1] - inside


def _scale(vectors: Table) -> Table:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9))


def _find_angles_deg(first: Table, second: Table) -> Table:
    return np.asarray(np.degrees(np.arccos(np.clip((first * second).sum(axis=1), -1.0, 1.0))))
