"""Where a sensor slipped or turned on the arm while it was worn.

Stretches of a day are held against the rest of it (:mod:`fusion.pose.slips`): those from a time to the
end, for a sensor that slipped and stayed so, and those between two times, for one that was pushed back. The
sensor sat otherwise where both sides know each other's commonest direction less than other work would explain
and where walking, in which the arm hangs whatever the work is, does not contradict; where walking shows the
arm hanging in another direction, less is asked of the postures. What is found is searched again. From such
a time the slip is narrowed down: moments that look like before speak for before, and the like; what speaks
for neither side clearly is the slip itself, which may take minutes.

Where no stretch differs so much, but a minute of walking or more on both sides shows the arm hanging apart, a
turn is in doubt (:class:`Doubt`): too small, or in work too much alike, to be told from a load carried.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.checks.gravity_windows import number_directions
from fusion.pose.postures import (
    LEAST_STRIDING,
    MINUTE_STRIDING,
    NEAR_DEG,
    SURE_STRIDING,
    Moments,
    cos_deg,
)
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
    (:func:`fusion.pose.postures.compare_postures`); ``angle_deg``: between these. ``hangs_deg``: between the
    directions in which the arm hangs in walking, NaN where one is not known; ``strides``: moments of walking
    on the side that has fewer; ``explained``: share of all walking near the direction of its own side;
    ``pure``: that share on the side where it is less; ``crossed``: shares of each near that of the other, as
    in ``known``.
    """

    known: Float64Array
    angle_deg: Float64Array
    hangs_deg: Float64Array
    strides: NDArray[np.int64]
    explained: Float64Array
    pure: Float64Array
    crossed: Float64Array


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
    angle_deg = _find_angles_deg(calm.centre[at], calm.centre[to])
    edges_s = np.append(calm.moments.time_s, np.inf)[edges]
    return Stretches(known.astype(np.float64), angle_deg, *_compare_walking(strides, edges_s, first, stop))


def _compare_walking(
    strides: CountedMoments, edges_s: Float64Array, first: Rows, stop: Rows
) -> tuple[Float64Array, NDArray[np.int64], Float64Array, Float64Array, Float64Array]:
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
    They know each other by less than these bounds (of 2):

    - where walking shows the arm hanging within ``hangs_alike_deg`` on both sides: none, nothing turned;
    - where it shows it hanging apart (``hangs_apart_deg`` for two slips): ``known_apart`` for one slip and
      ``known_between`` for two, more where more was walked on both sides (from ``walked_min`` on);
    - without walking: ``known`` and ``turned_deg`` between the commonest directions (``turned_short_deg``
      where a side is shorter than ``short_s``) for one; the first of ``known_between`` and
      ``turned_between_deg`` for two, as an hour at the wheel between two on foot looks like 45 deg.

    The figures behind the bounds stand in decision 38. Of stretches that are as good, one that reaches to the
    end is taken, unless another is known less by ``clearer``. A slip over minutes leaves most of its
    beginning and end to either side; ``margin_s`` is added to both. A turn is in doubt where
    ``pure`` of the walking on each side is near its commonest direction and hardly any near that of the
    other (``crossed``, more from five minutes on both sides): loads carried among walks look otherwise.
    ``evidence``: how far the sum of logarithms may fall short (moments follow each other in like poses).
    """

    least_moments: int = 60
    least_s: float = 300.0
    short_s: float = 900.0
    between_s: float = 600.0
    hangs_alike_deg: float = 10.0
    hangs_apart_deg: float = 15.0
    known: float = 0.45
    walked_min: tuple[float, float] = (1.0, 2.0)
    known_apart: tuple[float, float, float] = (0.5, 0.5, 0.9)
    known_between: tuple[float, float, float] = (0.1, 0.35, 0.45)
    turned_deg: float = 15.0
    turned_short_deg: float = 45.0
    turned_between_deg: float = 60.0
    clearer: float = 0.1
    most_moments: int = 2000
    cell_deg: float = 7.0
    places: int = 100
    evidence: float = 10.0
    margin_s: float = 300.0
    pure: float = 0.75
    crossed: tuple[float, float] = (0.1, 0.5)


@dataclass(frozen=True, slots=True)
class Slip:
    """The slip lies somewhere in this stretch."""

    first_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class Doubt:
    """Between these times the arm hung ``angle_deg`` from how it hung in the rest of ``of_s``, in walking."""

    first_s: float
    end_s: float
    of_s: tuple[float, float]
    angle_deg: float


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


def find_slips(
    calm: Moments, strides: Moments, rules: SlipRules | None = None
) -> tuple[list[Slip], list[Doubt]]:
    """Find slips within one stretch of wear, in order of time, and doubts; slips that overlap are one."""
    rules = rules or SlipRules()
    few = calm.thin(rules.most_moments)
    if len(few.up) < 2 * rules.least_moments or few.time_s[-1] - few.time_s[0] < 2.0 * rules.least_s:
        return [], []
    day = _Day(count_moments(few, rules.cell_deg), count_moments(strides, rules.cell_deg), rules)
    found = list(_search(day, 0, len(few.up)))
    slips = sorted((one for one in found if isinstance(one, Slip)), key=lambda slip: slip.first_s)
    return list(_join(slips)), [one for one in found if isinstance(one, Doubt)]


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


def _search(day: _Day, first: int, stop: int) -> Iterator[Slip | Doubt]:
    rules, compared = day.rules, _compare(day, first, stop)
    found = None if compared is None else _find_turned(day, *compared)
    if found is None:
        if compared is not None:
            yield from _find_doubt(day, *compared)
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
    seconds = _find_times(day, edges)
    short = np.minimum(seconds[starts] - seconds[0], seconds[ends] - seconds[starts]) < rules.short_s
    bound = np.where(is_one, _bound_one(compared, short, rules), _bound_between(compared, rules))
    known = np.where(compared.known < bound, compared.known, ALIKE)
    best = int(np.argmin(known - rules.clearer * is_one))
    if known[best] == ALIKE:
        return None
    return int(edges[starts[best]]), int(edges[ends[best]])


def _find_doubt(day: _Day, edges: Rows, span: Span, compared: Stretches) -> Iterator[Doubt]:
    """The stretch that parts the walking best, of those in which the arm hung apart."""
    rules = day.rules
    apart = (compared.hangs_deg >= rules.hangs_alike_deg) & (compared.strides >= MINUTE_STRIDING)
    crossed = np.where(compared.strides >= SURE_STRIDING, rules.crossed[1], rules.crossed[0])
    apart &= (compared.pure >= rules.pure) & (compared.crossed < crossed)
    if not apart.any():
        return
    (starts, ends), times_s = span, _find_times(day, edges)
    is_one = ends == len(edges) - 1
    best = int(np.argmax(np.where(apart, compared.explained + rules.clearer * is_one, -np.inf)))
    yield Doubt(
        float(times_s[starts[best]]),
        float(times_s[ends[best]]),
        (float(times_s[0]), float(times_s[-1])),
        float(compared.hangs_deg[best]),
    )


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


def _bound_one(found: Stretches, is_short: NDArray[np.bool_], rules: SlipRules) -> Float64Array:
    """What two sides of one slip may know of each other at most; 0 where nothing turned."""
    turned_deg = np.where(is_short, rules.turned_short_deg, rules.turned_deg)
    unseen = np.where(found.angle_deg >= turned_deg, rules.known, 0.0)
    walked = np.take(rules.known_apart, _grade_walking(found, rules))
    seen = np.where(found.hangs_deg >= rules.hangs_alike_deg, walked, 0.0)
    return np.where(np.isnan(found.hangs_deg), unseen, seen)


def _bound_between(found: Stretches, rules: SlipRules) -> Float64Array:
    """The same for a stretch between two slips."""
    unseen = np.where(found.angle_deg >= rules.turned_between_deg, rules.known_between[0], 0.0)
    walked = np.take(rules.known_between, _grade_walking(found, rules))
    seen = np.where(found.hangs_deg >= rules.hangs_apart_deg, walked, 0.0)
    return np.where(np.isnan(found.hangs_deg), unseen, seen)


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
