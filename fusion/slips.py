"""Where a sensor slipped or turned on the arm while it was worn.

The moments of a stretch are parted at each of some hundred times, and both sides compared
(:func:`fusion.postures.compare_postures`): the sensor slipped where the sides know each other least, if they
know less of each other than other work would explain. Then each side is searched again. From such a time the
slip is narrowed down: moments that look like before speak for before, and the like; what speaks for neither
side clearly is the slip itself, which may take minutes.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.postures import NEAR_DEG, Moments, Table, compare_hanging, cos_deg
from fusion.rest_probes import tell_directions


@dataclass(frozen=True, slots=True)
class SlipRules:
    """When two sides of a day are told apart.

    Both have ``least_moments`` moments and ``least_s`` seconds; their commonest directions differ by
    ``turned_deg``, or by ``turned_short_deg`` where a side is shorter than ``short_s``; and they know each
    other by less than ``known`` of 2 (below ``doubted`` the slip is not sure).
    Seen on simulated days: 900 stretches of 20 minutes to 4 hours without a turn come down to 0.44, a day of
    eight hours put in order of its activities (hours of one kind of work and then hours of another) to 0.32;
    with a turn of 45 deg it is 0.15 or less, with one of 30 deg 0.1 to 0.8. In minutes a worker can look
    turned by 40 deg.
    A slip over minutes leaves most of its beginning and end to either side; ``margin_s`` is added to both.
    ``evidence``: how far the sum of logarithms may fall short (moments follow each other in like poses).
    """

    least_moments: int = 60
    least_s: float = 300.0
    short_s: float = 900.0
    turned_deg: float = 15.0
    turned_short_deg: float = 45.0
    known: float = 0.3
    doubted: float = 0.45
    most_moments: int = 1000
    cell_deg: float = 7.0
    places: int = 120
    evidence: float = 10.0
    margin_s: float = 300.0


HANGS_ALIKE_DEG = 10.0


@dataclass(frozen=True, slots=True)
class Slip:
    """The slip lies somewhere in this stretch; ``is_doubted`` where the evidence is weak."""

    first_s: float
    end_s: float
    is_doubted: bool = False

    @property
    def middle_s(self) -> float:
        """Where the recording is cut if the slip is doubted."""
        return (self.first_s + self.end_s) / 2.0


@dataclass(frozen=True, slots=True, eq=False)
class _Counted:
    """Moments by cells of direction: ``before`` (n + 1, c) counts those before each; ``near`` (c, c)."""

    time_s: Table
    cell: NDArray[np.intp]
    centre: NDArray[np.float64]
    before: NDArray[np.float32]
    near: NDArray[np.float32]


def find_slips_in_wear(calm: Moments, strides: Moments) -> list[Slip]:
    """Slips by all calm moments, but for those over which the arm hangs alike in walking."""
    found = find_slips(calm)
    edges_s = [-np.inf, *(slip.middle_s for slip in found), np.inf]
    return [
        slip
        for slip, start_s, stop_s in zip(found, edges_s[:-2], edges_s[2:], strict=True)
        if not _hangs_alike(strides.within(start_s, slip.first_s), strides.within(slip.end_s, stop_s))
    ]


def _hangs_alike(before: Moments, after: Moments) -> bool:
    turned_deg = compare_hanging(before, after)
    return turned_deg is not None and turned_deg < HANGS_ALIKE_DEG


def find_slips(moments: Moments, rules: SlipRules | None = None) -> list[Slip]:
    """Find slips within one stretch of wear, in order of time."""
    rules = rules or SlipRules()
    few = moments.thin(rules.most_moments)
    if len(few.up) < 2 * rules.least_moments or few.time_s[-1] - few.time_s[0] < 2.0 * rules.least_s:
        return []
    return sorted(_search(_count(few, rules), 0, len(few.up), rules), key=lambda slip: slip.first_s)


def _count(moments: Moments, rules: SlipRules) -> _Counted:
    cell = tell_directions(moments.up, rules.cell_deg)
    cells = int(cell.max()) + 1
    sums = [np.bincount(cell, moments.up[:, axis], cells) for axis in range(3)]
    centre = np.asarray(np.stack(sums, axis=1), dtype=np.float64)
    centre = centre / np.linalg.norm(centre, axis=1, keepdims=True)
    one_each = np.zeros((len(cell) + 1, cells), dtype=np.float32)
    one_each[np.arange(len(cell)) + 1, cell] = 1.0
    near = (centre @ centre.T >= cos_deg(NEAR_DEG)).astype(np.float32)
    return _Counted(moments.time_s, cell, centre, np.cumsum(one_each, axis=0), near)


def _search(counted: _Counted, first: int, stop: int, rules: SlipRules) -> Iterator[Slip]:
    places = _list_places(counted.time_s, first, stop, rules)
    if len(places) == 0:
        return
    known, angle_deg = _part(counted, first, stop, places)
    time_s = counted.time_s
    side_s = np.minimum(time_s[places] - time_s[first], time_s[stop - 1] - time_s[places])
    least_deg = np.where(side_s < rules.short_s, rules.turned_short_deg, rules.turned_deg)
    known = np.where(angle_deg >= least_deg, known, 2.0)
    best = int(np.argmin(known))
    if known[best] >= rules.doubted:
        return
    start, end = _narrow(counted, (first, int(places[best]), stop), rules)
    margin_s = rules.margin_s
    yield Slip(time_s[start] - margin_s, time_s[end] + margin_s, bool(known[best] >= rules.known))
    if known[best] < rules.known:
        yield from _search(counted, first, start, rules)
        yield from _search(counted, end, stop, rules)


def _list_places(time_s: Table, first: int, stop: int, rules: SlipRules) -> NDArray[np.intp]:
    """Where to part, so that both sides are long enough."""
    places = np.unique(np.linspace(first, stop, rules.places).astype(np.intp))
    enough = (places - first >= rules.least_moments) & (stop - places >= rules.least_moments)
    places = places[enough]
    long = (time_s[places] - time_s[first] >= rules.least_s) & (
        time_s[stop - 1] - time_s[places] >= rules.least_s
    )
    return np.asarray(places[long])


def _part(counted: _Counted, first: int, stop: int, places: NDArray[np.intp]) -> tuple[Table, Table]:
    """How well the sides know each other, and the angle between their commonest directions, at each place."""
    before = (counted.before[places] - counted.before[first]) @ counted.near
    after = (counted.before[stop] - counted.before[places]) @ counted.near
    rows, at, to = np.arange(len(places)), before.argmax(axis=1), after.argmax(axis=1)
    known = after[rows, at] / after[rows, to] + before[rows, to] / before[rows, at]
    cosine = (counted.centre[at] * counted.centre[to]).sum(axis=1)
    return known.astype(np.float64), np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _narrow(counted: _Counted, edges: tuple[int, int, int], rules: SlipRules) -> tuple[int, int]:
    """First and last moment between which the slip lies.

    Twice over: how common each moment is before and after, as a logarithm of both shares; the sum of what
    speaks for before up to a time and for after from there on is largest at the slip, and all times whose sum
    comes near it are left to it.
    """
    first, place, stop = edges
    start = end = place
    for _ in range(2):
        before = (counted.before[start] - counted.before[first]) @ counted.near / max(start - first, 1)
        after = (counted.before[stop] - counted.before[end]) @ counted.near / max(stop - end, 1)
        speaks = np.log((before + 0.02) / (after + 0.02))[counted.cell[first:stop]]
        total = np.concatenate([[0.0], np.cumsum(speaks)])
        likely = np.flatnonzero(total >= total.max() - rules.evidence)
        start = int(np.clip(first + likely[0], first + 1, stop - 1))
        end = int(np.clip(first + likely[-1], start, stop - 1))
    return start, end
