"""Rest of the upper arm: arm down and nearly still, and for how long it has none (EXPOSURE.md A3).

Neutral and slow: elevation under 20 deg and generalised speed under 5 deg/s for 3 s or more without a gap;
where there is no vertical (a ready angle series) the speed of inclination takes its place. The
figure describes where the arm was, not whether its muscles rested.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.resampling import Resampling, find_interval, name_intervals
from fusion.exposure.rows import add_rows, find_part_rows
from fusion.exposure.types import Interval, Recovery
from fusion.numba_kernels import inner, kernel
from fusion.recording import Float64Array, IntArray

NEUTRAL_DEG = 20.0
SLOW_DPS = 5.0
SHORTEST_S = 3.0
SECONDS, STAYS = range(2)
# the state: whether a run of valid rows is under way, and the first row of the slow stay (-1: none)
INSIDE, SLOW_SINCE, LEVELS_BELOW = range(3)
# of each level: the first row of its rest (-1: none), and since which row it has had none
REST_SINCE, WITHOUT_SINCE = range(2)


class _Limits(NamedTuple):
    """What divides the rows of one segment, for the kernels: the levels under which the arm hangs, rising
    (with an error b, neutral ends b lower), and the first row of each 5-minute block.
    """

    levels_deg: Float64Array
    rate_hz: float
    block_rows: IntArray


class _Counts(NamedTuple):
    """The arrays of :class:`RecoveryTally` in the order of the rising levels, for the kernels."""

    rest: Float64Array
    slow: Float64Array
    longest_s: Float64Array
    state: IntArray
    levels: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class RecoveryTally:
    """What was counted at each error of the angle (shape (g,), 0 in the middle), filled in place.

    ``rest``, shape (g, b, 2), are seconds and number of neutral and slow stays in each 5-minute block,
    ``slow``, shape (b, 2), those of the slow ones; ``longest_s``, shape (g,), the longest time without the
    former. A stay is counted where it begins, its time where it lies.
    """

    errors_deg: Float64Array
    edges_us: IntArray
    rest: Float64Array
    slow: Float64Array
    longest_s: Float64Array
    state: IntArray
    levels: IntArray

    def add(self, angle: MetricAngle, first_row: int, speeds_dps: Float64Array) -> None:
        """Count rows from ``first_row`` on that follow those before; the speed of a row is that of the step
        to it, NaN for none.
        """
        stop = first_row + len(speeds_dps)
        rows = (angle.elevation_deg[first_row:stop], angle.valid[first_row:stop], speeds_dps)
        _scan_rest(rows, first_row, self._find_limits(angle), self._order_counts())

    def end_segment(self, angle: MetricAngle) -> None:
        """Let a hole end all that is under way."""
        _end_run(len(angle), self._find_limits(angle), self._order_counts())

    def _find_limits(self, angle: MetricAngle) -> _Limits:
        levels_deg = np.round(NEUTRAL_DEG - self.errors_deg[::-1], 9)
        return _Limits(levels_deg, angle.rate_hz, find_part_rows(angle, self.edges_us))

    def _order_counts(self) -> _Counts:
        return _Counts(self.rest[::-1], self.slow, self.longest_s[::-1], self.state, self.levels[::-1])

    def summarise(self, analysed_s: float) -> Recovery:
        """Give shares of the analysed time and rates per hour of it."""
        percent, per_hour = 100.0 / analysed_s, 3600.0 / analysed_s
        middle = len(self.errors_deg) // 2
        rest, slow = self.rest[middle].sum(axis=0), self.slow.sum(axis=0)
        return Recovery(
            neutral_slow_percent=float(rest[SECONDS]) * percent,
            neutral_slow_per_hour=float(rest[STAYS]) * per_hour,
            slow_percent=float(slow[SECONDS]) * percent,
            slow_per_hour=float(slow[STAYS]) * per_hour,
            longest_without_s=float(self.longest_s[middle]),
        )

    def name_intervals(self, draws: Resampling, block_s: Float64Array) -> dict[str, Interval]:
        """Give the intervals; slowness knows no error of the angle, and the longest time without rest, as the
        extreme of a day, only that error.
        """
        drawn_s = draws.sum(block_s)[:, np.newaxis]
        per_s = draws.sum_with_error(self.rest, self.errors_deg) / drawn_s
        slow_per_s = draws.sum(self.slow) / drawn_s
        longest_s = draws.look_up(self.longest_s, self.errors_deg)
        figures = {
            "recovery_neutral_slow_percent": 100.0 * per_s[:, SECONDS],
            "recovery_neutral_slow_per_h": 3600.0 * per_s[:, STAYS],
            "recovery_slow_percent": 100.0 * slow_per_s[:, SECONDS],
            "recovery_slow_per_h": 3600.0 * slow_per_s[:, STAYS],
            "recovery_longest_without_s": longest_s,
        }
        return name_intervals({name: find_interval(drawn) for name, drawn in figures.items()})


def start_recovery(errors_deg: Float64Array, edges_us: IntArray) -> RecoveryTally:
    """Start with nothing counted."""
    errors, blocks = len(errors_deg), len(edges_us) - 1
    return RecoveryTally(
        errors_deg,
        edges_us,
        np.zeros((errors, blocks, 2)),
        np.zeros((blocks, 2)),
        np.zeros(errors),
        np.array([0, -1, errors], np.int64),
        np.full((errors, 2), -1, np.int64),
    )


@kernel
def _scan_rest(rows, first, limits, counts):  # type: ignore[no-untyped-def]
    """Follow the stays row by row; a row without a speed (the first of a run) is not slow.

    The arm hangs at the levels above its angle: all but the lowest ``state[LEVELS_BELOW]``.
    """
    angle_deg, valid, speeds_dps = rows
    levels_deg, state = limits.levels_deg, counts.state
    for i in range(len(angle_deg)):
        if not valid[i]:
            _end_run(first + i, limits, counts)
            continue
        if state[INSIDE] == 0:
            _begin_run(first + i, counts)
        below = len(levels_deg)
        if speeds_dps[i] < SLOW_DPS:
            if state[SLOW_SINCE] < 0:
                state[SLOW_SINCE] = first + i
            below = _count_below(angle_deg[i], state[LEVELS_BELOW], levels_deg)
        elif state[SLOW_SINCE] >= 0:
            _end_slow(first + i, limits, counts)
        if below != state[LEVELS_BELOW]:
            _move(first + i, below, limits, counts)


@inner
def _begin_run(row, counts):  # type: ignore[no-untyped-def]
    counts.state[INSIDE] = 1
    for level in range(len(counts.levels)):
        counts.levels[level, WITHOUT_SINCE] = row


@inner
def _count_below(x, below, levels_deg):  # type: ignore[no-untyped-def]
    """Count the levels that ``x`` has reached, starting from how many it was before."""
    while below > 0 and x < levels_deg[below - 1]:
        below -= 1
    while below < len(levels_deg) and x >= levels_deg[below]:
        below += 1
    return below


@inner
def _move(row, below, limits, counts):  # type: ignore[no-untyped-def]
    """Let the rest begin at the levels that the angle has sunk under, and end at those it has reached."""
    state, levels = counts.state, counts.levels
    for level in range(below, state[LEVELS_BELOW]):
        levels[level, REST_SINCE] = row
    for level in range(state[LEVELS_BELOW], below):
        _end_rest(level, row, limits, counts)
    state[LEVELS_BELOW] = below


@inner
def _end_slow(row, limits, counts):  # type: ignore[no-untyped-def]
    slow, state, rate_hz = counts.slow, counts.state, limits.rate_hz
    first = state[SLOW_SINCE]
    if row - first >= SHORTEST_S * rate_hz - 1e-3:
        block = add_rows(first, row, 1.0 / rate_hz, limits.block_rows, slow[:, SECONDS])
        slow[block, STAYS] += 1
    state[SLOW_SINCE] = -1


@inner
def _end_rest(level, row, limits, counts):  # type: ignore[no-untyped-def]
    """End a neutral and slow stay; if it was long enough, the time without rest starts anew after it."""
    rest, longest_s, levels, rate_hz = counts.rest, counts.longest_s, counts.levels, limits.rate_hz
    first = levels[level, REST_SINCE]
    if row - first >= SHORTEST_S * rate_hz - 1e-3:
        block = add_rows(first, row, 1.0 / rate_hz, limits.block_rows, rest[level, :, SECONDS])
        rest[level, block, STAYS] += 1
        longest_s[level] = max(longest_s[level], (first - levels[level, WITHOUT_SINCE]) / rate_hz)
        levels[level, WITHOUT_SINCE] = row
    levels[level, REST_SINCE] = -1


@kernel
def _end_run(row, limits, counts):  # type: ignore[no-untyped-def]
    """End all that is under way before ``row``, where a run of valid rows ends."""
    longest_s, state, levels = counts.longest_s, counts.state, counts.levels
    if state[INSIDE] == 0:
        return
    if state[SLOW_SINCE] >= 0:
        _end_slow(row, limits, counts)
    _move(row, len(limits.levels_deg), limits, counts)
    for level in range(len(levels)):
        longest_s[level] = max(longest_s[level], (row - levels[level, WITHOUT_SINCE]) / limits.rate_hz)
    state[INSIDE] = 0
