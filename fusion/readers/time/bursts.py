"""Rows that share a stamp: samples that a phone received together, or a clock of whole seconds.

The sensor measured them evenly, so the count of rows is the better clock: the stamps show the rate, and where
rows are missing.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.errors import UnusableTime
from acromion.fusion.numba_kernels import njit
from acromion.fusion.recording import QualityFlag

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SHARED_PART = 0.05
"""If so many rows share the stamp of the row before, the rows came in bursts."""
NEAR_PERIODS = 0.1
"""So do rows that were stamped so shortly after each other, when a program read all that had arrived."""
PACE_ROWS, PACE_PLACES = 1024, 20_000
LONG_RUN_ROWS = 32
"""So do they if so many rows once share a stamp."""
FEWEST_BURSTS = 3
FINE_CLOCK_US = 1000
"""Rows that share a stamp of a clock as fine as this did not come in bursts."""
ALIKE_STEP = 0.5
BLOCK_BURSTS = 32
REACH_BURSTS = 64
"""After a delay, the rows that waited have arrived within so many bursts."""
LEAST_PERIODS, LEAST_STEPS = 1.5, 0.1
"""Less missing time than so many rows, and than this part of a burst, does not show."""
ROUNDS = 3
END_STEPS = 2.0
EVEN_BURSTS, SAME_COUNT, LARGEST_CHANGE = 10, 0.02, 0.03
"""So many seconds one after the other with as many rows each, give or take one or 2 %, are a rate."""
RARE = 1e-3
MOST_FALLS = 0.2
"""If after so many bursts all come earlier, the count of rows cannot be a clock."""


@dataclass(frozen=True, slots=True, eq=False)
class Bursts:
    """Runs of rows with one stamp, or nearly one.

    ``edges``: the first row of each, and the number of rows; ``stamp_us``: their stamps.
    ``is_floor``: the stamp is a coarse clock's count, shown until the next: the first row is the one measured
    at the stamp. Otherwise the stamp is the time of arrival, and the last row is.
    """

    edges: Ints
    stamp_us: Ints
    is_floor: bool
    step_us: float

    @property
    def counts(self) -> Ints:
        """How many rows each has."""
        return np.diff(self.edges)

    @property
    def anchors(self) -> Ints:
        """The row of each that was measured at the stamp."""
        return self.edges[:-1] if self.is_floor else self.edges[1:] - 1


def find_bursts(stamps: Ints) -> Bursts | None:
    """Find runs of rows with one stamp; None if the rows did not come in bursts."""
    if len(stamps) < FEWEST_BURSTS:
        return None
    near_us = NEAR_PERIODS * measure_pace_us(stamps)
    runs, longest_rows = count_runs(stamps, near_us, np.empty(0, np.int64))
    is_shared = len(stamps) - runs >= SHARED_PART * len(stamps)
    if runs < FEWEST_BURSTS or not (is_shared or longest_rows >= LONG_RUN_ROWS):
        return None
    edges = np.full(runs + 1, len(stamps), np.int64)
    count_runs(stamps, near_us, edges)
    stamp_us = stamps[edges[:-1]]
    steps_us = np.diff(stamp_us)
    forward_us = steps_us[steps_us > 0]
    step_us = float(np.median(forward_us)) if len(forward_us) else 0.0
    if step_us <= FINE_CLOCK_US:
        return None
    is_floor = int(np.gcd.reduce(forward_us)) == step_us
    return Bursts(edges, stamp_us, is_floor, step_us)


@njit(cache=True, nogil=True)
def count_runs(stamps: Ints, near_us: float, firsts: Ints) -> tuple[int, int]:
    """Return the number of runs of rows with about one stamp, and the longest; fill in their first rows."""
    runs = longest_rows = first = 0
    for row in range(len(stamps)):
        if row == 0 or stamps[row] < stamps[row - 1] or stamps[row] - stamps[row - 1] > near_us:
            if runs < len(firsts):
                firsts[runs] = row
            runs += 1
            first = row
        longest_rows = max(longest_rows, row + 1 - first)
    return runs, longest_rows


def measure_pace_us(stamps: Ints) -> float:
    """Return the usual mean step of the stamps over many rows; 0 if they do not advance."""
    rows = min(PACE_ROWS, max(1, len(stamps) // 8))
    starts = np.arange(0, len(stamps) - rows, max(1, len(stamps) // PACE_PLACES))
    return max(0.0, float(np.median(stamps[starts + rows] - stamps[starts])) / rows)


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """Bursts as an even sampling with missing rows.

    ``pace_us``: the sample period before each burst but the first; ``elapsed_us``: by the count of rows;
    ``late_us``: by how much each burst came later; ``first``: the bursts that begin a piece;
    ``falls``: share of bursts after which all come earlier than any before.
    """

    pace_us: Floats
    elapsed_us: Floats
    late_us: Floats
    first: Ints
    falls: float


def spread_bursts(stamps: Ints, *, may_be_coarse: bool = True) -> tuple[QualityFlag, ...]:
    """Assign the times of an even sampling to rows that share a stamp, in place (W-JITTER).

    ``may_be_coarse``: False if the stamps are known not to come from a coarse clock.

    A burst that only came late does not make a hole. Missing rows stay missing: time that the
    rows after it do not make up for.

    Raises UnusableTime if no sample period explains the bursts, because rows are missing all over.
    """
    bursts = find_bursts(stamps)
    if bursts is None:
        return ()
    bursts = replace(bursts, is_floor=bursts.is_floor and may_be_coarse)
    readings = [read_bursts(bursts, period_us) for period_us in propose_periods_us(bursts)]
    possible = [reading for reading in readings if reading.falls <= MOST_FALLS]
    if not possible:
        raise UnusableTime(why="irregular")
    place_rows(stamps, bursts, min(possible, key=measure_cost))
    return (QualityFlag(Caveat.JITTER),)


def spread_shared(stamps: Ints) -> None:
    """Spread the few rows that share a stamp among rows that do not, in place.

    They fill the step before them, if it is as long as they take, else the step after them; otherwise
    they stay.
    """
    edges = np.concatenate([[0], np.flatnonzero(np.diff(stamps)) + 1, [len(stamps)]])
    counts = np.diff(edges)
    steps_us = np.diff(stamps[edges[:-1]])
    usual_us = float(np.median(steps_us)) if len(steps_us) else 0.0
    for run in np.flatnonzero(counts > 1).tolist():
        first, stop = int(edges[run]), int(edges[run + 1])
        rows, least_us = np.arange(counts[run]), (counts[run] - ALIKE_STEP) * usual_us
        if run > 0 and steps_us[run - 1] >= least_us:
            stamps[first:stop] -= (rows[::-1] * steps_us[run - 1]) // counts[run]
        elif run < len(steps_us) and steps_us[run] >= least_us:
            stamps[first:stop] += (rows * steps_us[run]) // counts[run]


def propose_periods_us(bursts: Bursts) -> tuple[float, ...]:
    """Return possible sample periods: of blocks of bursts, right if few rows are missing, and of single."""
    steps_us, rows = np.diff(bursts.stamp_us).astype(np.float64), np.diff(bursts.anchors)
    steps_us, rows = steps_us[steps_us > 0], rows[steps_us > 0]
    single_us = steps_us / rows
    usual_us = float(np.median(single_us))
    alike = np.abs(single_us - usual_us) <= ALIKE_STEP * usual_us
    size = min(BLOCK_BURSTS, len(rows))
    blocks = [np.convolve(values, np.ones(size), "valid") for values in (steps_us, rows)]
    by_blocks_us = float(np.median(blocks[0] / blocks[1]))
    return by_blocks_us, usual_us, float(steps_us[alike].sum() / rows[alike].sum())


def read_bursts(bursts: Bursts, period_us: float) -> Reading:
    """Find the missing rows and the sample period, from about this period on."""
    pace_us = np.full(len(bursts.stamp_us) - 1, period_us)
    if bursts.is_floor:
        usual_us = bursts.step_us / find_usual_counts(bursts.counts)[:-1]
        is_other = np.abs(usual_us - period_us) > LARGEST_CHANGE * period_us
        pace_us[is_other] = usual_us[is_other]
    tilt = 0.0
    for _ in range(ROUNDS):
        pace_us = pace_us * (1.0 + tilt)
        elapsed_us = np.concatenate([[0.0], np.cumsum(pace_us * np.diff(bursts.anchors))])
        late_us = measure_late_us(bursts, elapsed_us)
        first, falls = find_losses(late_us, bursts, float(np.median(pace_us)))
        tilt = measure_tilt(late_us, elapsed_us, first)
    return Reading(pace_us, elapsed_us, late_us, first, falls)


def measure_cost(reading: Reading) -> float:
    """Return how badly a reading explains the bursts (Schwarz, Ann Stat 1978;6:461); each piece costs."""
    pieces, bursts = len(reading.first), len(reading.late_us)
    sizes = np.diff(np.append(reading.first, bursts))
    levels_us = [np.median(part) for part in np.split(reading.late_us, reading.first[1:])]
    scatter_us = float(np.median(np.abs(reading.late_us - np.repeat(levels_us, sizes))))
    return bursts * math.log(max(scatter_us, FINE_CLOCK_US)) + pieces * math.log(bursts)


def measure_late_us(bursts: Bursts, elapsed_us: Floats) -> Floats:
    """Return by how much each burst comes later than the count of rows foresees.

    The burst at the end, where the clock began to count or the last rows were sent, may hold fewer rows.
    """
    late_us = bursts.stamp_us - elapsed_us
    end, inner = (0, 1) if bursts.is_floor else (-1, -2)
    if abs(late_us[end] - late_us[inner]) < END_STEPS * bursts.step_us:
        late_us[end] = late_us[inner]
    return late_us


def find_usual_counts(counts: Ints) -> Floats:
    """Return, for each stamp, the number of rows that share it if none is lost.

    Within a stretch of even counts it is the median of the stretch; between stretches, that of the stretch
    before (at the start, of the first). If no stretch is even, it is the median of all counts.
    """
    usual = np.full(len(counts), float(np.median(counts)))
    differs = np.abs(np.diff(counts)) > np.maximum(1.0, SAME_COUNT * counts[1:])
    edges = np.concatenate([[0], np.flatnonzero(differs) + 1, [len(counts)]])
    long = np.diff(edges) >= EVEN_BURSTS
    firsts, stops = edges[:-1][long], edges[1:][long]
    starts = [0, *firsts[1:].tolist(), len(counts)]
    for k, (first, stop) in enumerate(zip(firsts.tolist(), stops.tolist(), strict=True)):
        usual[starts[k] : starts[k + 1]] = float(np.median(counts[first:stop]))
    return usual


def find_losses(late_us: Floats, bursts: Bursts, period_us: float) -> tuple[Ints, float]:
    """Return the first burst and those before which rows are missing; and the share of falls.

    A burst that comes late is made up for when the next bursts come too early; missing rows are not: no later
    burst is as early as those before. A clock that was set back starts over.
    """
    losses, falls = [0], 0
    back = np.flatnonzero(np.diff(bursts.stamp_us) < 0) + 1
    edges = [0, *back.tolist(), len(late_us)]
    least_us = max(LEAST_PERIODS * period_us, LEAST_STEPS * bursts.step_us)
    for start, stop in pairwise(edges):
        part_us = late_us[start:stop]
        coming_us, past_us = find_coming_least(part_us), find_coming_least(part_us[::-1])[::-1]
        falls += int(np.count_nonzero(past_us[:-1] - coming_us[1:] > bursts.step_us))
        above_us = np.sort(part_us - coming_us)
        shares = 1.0 - RARE ** (1.0 / np.minimum(REACH_BURSTS, len(part_us) - np.arange(len(part_us))))
        usual = (np.maximum(0.5, shares) * (len(above_us) - 1)).astype(np.int64)
        rises = find_rises(part_us, coming_us, np.maximum(least_us, above_us[usual]))
        losses += [start] if start else []
        losses += (start + rises).tolist()
    return np.array(losses, np.int64), falls / len(late_us)


@njit(cache=True, nogil=True)
def find_rises(late_us: Floats, coming_us: Floats, limit_us: Floats) -> Ints:
    """Return the bursts from which on all come later than the earliest of those since the last such burst."""
    rises = np.empty(len(late_us), np.int64)
    found = first = 0
    for k in range(1, len(late_us)):
        earliest = late_us[k - 1]
        for j in range(max(first, k - REACH_BURSTS), k - 1):
            earliest = min(earliest, late_us[j])
        if coming_us[k] - earliest > limit_us[k]:
            rises[found] = first = k
            found += 1
    return rises[:found].copy()


def find_coming_least(values: Floats) -> Floats:
    """Return, for each value, the least of it and the ``REACH_BURSTS`` - 1 after it."""
    least, reach = values.copy(), 1
    while reach < REACH_BURSTS:
        least[:-reach] = np.minimum(least[:-reach], least[reach:])
        reach *= 2
    return least


def measure_tilt(late_us: Floats, elapsed_us: Floats, first: Ints) -> float:
    """Return by which share the clock is slower than the rows: the median slope over half a piece."""
    slopes, weights = [], []
    for start, stop in zip(first, [*first[1:], len(late_us)], strict=True):
        half = (stop - start) // 2
        if half:
            run_us = elapsed_us[start + half : stop] - elapsed_us[start : stop - half]
            slopes.append((late_us[start + half : stop] - late_us[start : stop - half]) / run_us)
            weights.append(run_us)
    if not slopes:
        return 0.0
    slope, weight = np.concatenate(slopes), np.concatenate(weights)
    order = np.argsort(slope)
    reached = np.cumsum(weight[order])
    return float(slope[order[np.searchsorted(reached, 0.5 * reached[-1])]])


PLACED_BURSTS = 4096
"""Bursts whose rows are placed together, so that little memory is needed."""


def place_rows(stamps: Ints, bursts: Bursts, reading: Reading) -> None:
    """Write the time of each row: by its place in its piece, and the piece by the median of its stamps."""
    edge = reading.pace_us[-1:] if bursts.is_floor else reading.pace_us[:1]
    own_us = np.concatenate([reading.pace_us, edge] if bursts.is_floor else [edge, reading.pace_us])
    anchors, counts = bursts.anchors, bursts.counts
    for start, stop in pairwise([*reading.first.tolist(), len(counts)]):
        first = bursts.edges[start]
        level_us = float(np.median(reading.late_us[start:stop]))
        if start and bursts.stamp_us[start] > bursts.stamp_us[start - 1]:
            begin_us = reading.elapsed_us[start] + own_us[start] * (first - anchors[start])
            level_us = max(level_us, stamps[first - 1] + own_us[start] - begin_us)
        for low in range(start, stop, PLACED_BURSTS):
            part = slice(low, min(low + PLACED_BURSTS, stop))
            rows = np.arange(bursts.edges[low], bursts.edges[part.stop])
            from_anchor = rows - np.repeat(anchors[part], counts[part])
            even_us = np.repeat(reading.elapsed_us[part] + level_us, counts[part])
            stamps[rows[0] : rows[-1] + 1] = np.rint(
                even_us + np.repeat(own_us[part], counts[part]) * from_anchor
            )
