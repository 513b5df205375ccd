"""Where a sensor slipped or turned on the arm while it was worn.

Stretches of a day are held against the rest of it: those from a time to the end, for a sensor that slipped
and stayed so, and those between two times, for one that was pushed back. The sensor sat otherwise where
somebody walked on both sides, half a minute or more, the arm hung in another direction, and both sides know
each other's commonest direction little. Nothing is concluded without walking: other work looks the same. What
is found is searched again. From such a time the slip is narrowed down: moments that look like before speak
for before, and the like; what speaks for neither side clearly is the slip itself, which may take minutes.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.checks.gravity_windows import number_directions
from fusion.pose.postures import LEAST_STRIDING, NEAR_DEG, Moments, cos_deg
from fusion.recording import Float64Array

# Every stretch of a day held against the rest of it: whether both show the arm hanging alike.
#
# A stretch begins and ends at any of some hundred times. One that reaches to neither end of the day is a
# sensor that turned and was pushed back. Moments are counted by cells of direction up to each time once; a
# stretch is then the difference of two counts, so that thousands of them are compared at little cost.


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
    centre: Float64Array
    near: Counts


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """Stretches from one calm moment to another, each beside the rest; all shapes (k,).

    ``known``: how well both know each other's commonest direction, 2 if they are alike, 0 if not at all
    (:func:`fusion.pose.postures.compare_postures`). ``hangs_deg``: between the directions in which the arm
    hangs in walking, 0 where one is not known; ``strides``: moments of walking on the side that has fewer.
    """

    known: Float64Array
    hangs_deg: Float64Array
    strides: NDArray[np.int64]


def count_moments(moments: Moments, cell_deg: float) -> CountedMoments:
    """Sort moments into cells."""
    cell = number_directions(moments.up, cell_deg)
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
    edges_s = np.append(calm.moments.time_s, np.inf)[edges]
    return Stretches(known.astype(np.float64), *_compare_walking(strides, edges_s, first, stop))


def _compare_walking(
    strides: CountedMoments, edges_s: Float64Array, first: Rows, stop: Rows
) -> tuple[Float64Array, NDArray[np.int64]]:
    """Angle between the directions of walking, 0 where one is not known, and the lesser count."""
    interval = np.searchsorted(edges_s, strides.moments.time_s, "right")
    walked = np.concatenate([[0], np.cumsum(np.bincount(interval, minlength=len(edges_s) + 1)[1:-1])])
    within = walked[stop] - walked[first]
    fewer = np.minimum(within, walked[-1] - within)
    if fewer.max(initial=0) < LEAST_STRIDING:
        return np.zeros(len(first)), fewer
    sums = _add_up(strides, interval, len(edges_s), *strides.moments.up.T)
    inside, beside = _part(sums[0], first, stop)
    at, to = inside.argmax(axis=1), beside.argmax(axis=1)
    here = sums[1:, stop, at] - sums[1:, first, at]
    there = sums[1:, -1, to] - (sums[1:, stop, to] - sums[1:, first, to])
    angle_deg = _find_angles_deg(*(_scale(sums.T.astype(np.float64)) for sums in (here, there)))
    return np.where(fewer >= LEAST_STRIDING, angle_deg, 0.0), fewer


def _add_up(counted: CountedMoments, interval: Rows, edges: int, *weights: Float64Array) -> Counts:
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


def _scale(vectors: Float64Array) -> Float64Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9))


def _find_angles_deg(first: Float64Array, second: Float64Array) -> Float64Array:
    return np.asarray(np.degrees(np.arccos(np.clip((first * second).sum(axis=1), -1.0, 1.0))))


Span = tuple[Rows, Rows]
ALIKE = 2.0
STRIDE_MIN = 2.0 / 60.0
"""A moment of walking is a window of 2 s."""


@dataclass(frozen=True, slots=True)
class SlipRules:
    """When two sides of a day differ.

    Both have ``least_moments`` moments and ``least_s`` seconds, a stretch between two slips ``between_s``.
    Walking shows the arm hanging apart by ``hangs_apart_deg``, of one slip and of two. They know each other
    by less than ``known_apart`` for one slip and ``known_between`` for two (of 2), more where more was walked
    on both sides (from ``walked_min`` on). The figures behind the bounds stand in decision 38. Of stretches
    that are as good, one that reaches to the end is taken, unless another is known less by ``clearer``. A
    slip over minutes leaves most of its beginning and end to either side; ``margin_s`` is added to both.
    ``evidence``: how far the sum of logarithms may fall short (moments follow each other in like poses).
    """

    least_moments: int = 60
    least_s: float = 300.0
    between_s: float = 600.0
    hangs_apart_deg: tuple[float, float] = (10.0, 15.0)
    walked_min: tuple[float, float] = (1.0, 2.0)
    known_apart: tuple[float, float, float] = (0.5, 0.5, 0.9)
    known_between: tuple[float, float, float] = (0.1, 0.35, 0.45)
    clearer: float = 0.1
    most_moments: int = 2000
    cell_deg: float = 7.0
    places: int = 100
    evidence: float = 10.0
    margin_s: float = 300.0


@dataclass(frozen=True, slots=True)
class Slip:
    """The slip lies somewhere in this stretch."""

    first_s: float
    end_s: float


@dataclass(frozen=True, slots=True, eq=False)
class _Day:
    """Calm and walking moments of one stretch of wear, and the rules."""

    calm: CountedMoments
    strides: CountedMoments
    rules: SlipRules

    @property
    def time_s(self) -> Float64Array:
        """Times of the calm moments."""
        return self.calm.moments.time_s


def find_slips(calm: Moments, strides: Moments, rules: SlipRules | None = None) -> list[Slip]:
    """Find slips within one stretch of wear, in order of time; slips that overlap are one."""
    rules = rules or SlipRules()
    few = calm.thin(rules.most_moments)
    if len(few.up) < 2 * rules.least_moments or few.time_s[-1] - few.time_s[0] < 2.0 * rules.least_s:
        return []
    day = _Day(count_moments(few, rules.cell_deg), count_moments(strides, rules.cell_deg), rules)
    return list(_join(sorted(_search(day, 0, len(few.up)), key=lambda slip: slip.first_s)))


def _join(slips: list[Slip]) -> Iterator[Slip]:
    for number, slip in enumerate(slips):
        if number == 0:
            joined = slip
        elif slip.first_s <= joined.end_s:
            joined = Slip(joined.first_s, max(joined.end_s, slip.end_s))
        else:
            yield joined
            joined = slip
    if slips:
        yield joined


def _search(day: _Day, first: int, stop: int) -> Iterator[Slip]:
    rules, compared = day.rules, _compare(day, first, stop)
    found = None if compared is None else _find_turned(day, *compared)
    if found is None:
        return
    cuts = [place for place in found if first < place < stop]
    start = first
    for cut, end in zip(cuts, [*cuts[1:], stop], strict=True):
        before, after = _narrow(day, (start, cut, end))
        yield Slip(day.time_s[before] - rules.margin_s, day.time_s[after] + rules.margin_s)
        yield from _search(day, start, before)
        start = after
    yield from _search(day, start, stop)


def _compare(day: _Day, first: int, stop: int) -> tuple[Rows, Span, Stretches] | None:
    """Edges, and all stretches between two of them that can be compared with the rest."""
    edges = np.unique(np.linspace(first, stop, day.rules.places + 1).astype(np.intp))
    starts, ends = np.triu_indices(len(edges), 1)
    usable = _find_usable(day, edges, (starts, ends))
    starts, ends = starts[usable], ends[usable]
    if len(starts) == 0:
        return None
    return edges, (starts, ends), compare_stretches(day.calm, day.strides, edges, starts, ends)


def _find_turned(day: _Day, edges: Rows, span: Span, compared: Stretches) -> tuple[int, int] | None:
    """The stretch that differs most; one between two slips only where it does so by more than one slip."""
    (starts, ends), rules = span, day.rules
    is_one = ends == len(edges) - 1
    apart_deg, bounds = np.where(is_one, *rules.hangs_apart_deg), (rules.known_apart, rules.known_between)
    one, between = (np.take(known, _grade_walking(compared, rules)) for known in bounds)
    bound = np.where(compared.hangs_deg >= apart_deg, np.where(is_one, one, between), 0.0)
    known = np.where(compared.known < bound, compared.known, ALIKE)
    best = int(np.argmin(known - rules.clearer * is_one))
    if known[best] == ALIKE:
        return None
    return int(edges[starts[best]]), int(edges[ends[best]])


def _find_usable(day: _Day, edges: Rows, span: Span) -> NDArray[np.bool_]:
    """Stretches, from a time to the end or to a later time, with enough in them, before and after."""
    (first, stop), last, rules = span, len(edges) - 1, day.rules
    seconds = _find_times(day, edges)
    inside_s, moments = seconds[stop] - seconds[first], edges[stop] - edges[first]
    before = (seconds[first] - seconds[0] >= rules.least_s) & (edges[first] - edges[0] >= rules.least_moments)
    after = (seconds[last] - seconds[stop] >= rules.least_s) & (
        edges[last] - edges[stop] >= rules.least_moments
    )
    least_s = np.where(stop == last, rules.least_s, rules.between_s)
    enough = (inside_s >= least_s) & (moments >= rules.least_moments)
    return np.asarray(before & (after | (stop == last)) & enough)


def _find_times(day: _Day, moments: Rows) -> Float64Array:
    return day.time_s[np.minimum(moments, len(day.time_s) - 1)]


def _grade_walking(found: Stretches, rules: SlipRules) -> Rows:
    """How many of the limits of walking are reached, 0 to 2."""
    return np.asarray(np.digitize(found.strides * STRIDE_MIN, rules.walked_min))


def _narrow(day: _Day, edges: tuple[int, int, int]) -> tuple[int, int]:
    """First and last moment between which the slip lies.

    Twice over: how common each moment is before and after, as a logarithm of both shares; the sum of what
    speaks for before up to a time and for after from there on is largest at the slip, and all times whose sum
    comes near it are left to it.
    """
    first, place, stop = edges
    start = end = place
    for _ in range(2):
        before = _share(day, first, start)
        after = _share(day, end, stop)
        speaks = np.log((before + 0.02) / (after + 0.02))[day.calm.cell[first:stop]]
        total = np.concatenate([[0.0], np.cumsum(speaks)])
        likely = np.flatnonzero(total >= total.max() - day.rules.evidence)
        start = int(np.clip(first + likely[0], first + 1, stop - 1))
        end = int(np.clip(first + likely[-1], start, stop - 1))
    return start, end


def _share(day: _Day, first: int, stop: int) -> Float64Array:
    """Share of the moments near each cell, (c,)."""
    count = np.bincount(day.calm.cell[first:stop], minlength=len(day.calm.near))
    return np.asarray(count @ day.calm.near / max(stop - first, 1), dtype=np.float64)
