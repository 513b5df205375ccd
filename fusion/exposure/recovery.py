"""Rest of the upper arm: arm down and nearly still, and for how long it has none.

Neutral and slow: elevation under 20 deg and generalised speed under 5 deg/s for 3 s or more without a gap;
where there is no vertical (a ready angle series) the speed of inclination takes its place. The
figure describes where the arm was, not whether its muscles rested.
"""

import numpy as np

from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.resampling import Figures, Resampling
from fusion.exposure.types import Recovery
from fusion.recording import BoolArray, Float64Array, IntArray
from fusion.runs import LEVEL, START, STOP, add_spans, find_part_rows, find_parts, find_runs, find_stays_above

NEUTRAL_DEG = 20.0
SLOW_DPS = 5.0
SHORTEST_S = 3.0
SECONDS, STAYS = range(2)


class RecoveryTally:
    """What is counted at each error of the angle.

    ``rest``, shape (g, b, 2), are seconds and number of neutral and slow stays in each 5-minute block,
    ``slow``, shape (b, 2), those of the slow ones; ``longest_s``, shape (g,), the longest time without the
    former. A stay is counted where it begins, its time where it lies.
    """

    def __init__(self, errors_deg: Float64Array, edges_us: IntArray) -> None:
        """Start with nothing counted; ``errors_deg``, shape (g,), has 0 in the middle."""
        self.errors_deg, self.edges_us = errors_deg, edges_us
        self.rest = np.zeros((len(errors_deg), len(edges_us) - 1, 2))
        self.slow = np.zeros((len(edges_us) - 1, 2))
        self.longest_s = np.zeros(len(errors_deg))

    def add(self, angle: MetricAngle, slow: BoolArray) -> None:
        """Count a segment; ``slow``, shape (n,), marks the rows whose step to them is slower than 5 deg/s."""
        part_rows, least_rows = find_part_rows(angle, self.edges_us), SHORTEST_S * angle.rate_hz - 1e-3
        slow_runs = find_runs(slow & angle.valid)
        slow_runs = slow_runs[slow_runs[:, 1] - slow_runs[:, 0] >= least_rows]
        still, is_slow = np.zeros((len(slow_runs), 3), np.int64), np.zeros(len(angle), np.bool_)
        still[:, START : STOP + 1] = slow_runs
        _count_stays(still, part_rows, angle.rate_hz, self.slow[np.newaxis])
        for first, stop in slow_runs.tolist():
            is_slow[first:stop] = True

        # under a level: the turned angle over the turned level, without hysteresis
        turned_deg = -np.round(NEUTRAL_DEG - self.errors_deg, 9)
        rests = find_stays_above(-angle.elevation_deg, is_slow, turned_deg, np.nextafter(turned_deg, np.inf))
        rests = rests[rests[:, STOP] - rests[:, START] >= least_rows]
        _count_stays(rests, part_rows, angle.rate_hz, self.rest)
        runs = find_runs(angle.valid)
        for level in range(len(self.errors_deg)):
            own = rests[rests[:, LEVEL] == level]
            begin, end = np.append(runs[:, 0], own[:, STOP]), np.append(runs[:, 1], own[:, START])
            without = (np.sort(end) - np.sort(begin)).max(initial=0)
            self.longest_s[level] = max(self.longest_s[level], without / angle.rate_hz)

    def summarise(self, analysed_s: float) -> Recovery:
        """Return shares of the analysed time and rates per hour of it."""
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

    def draw(self, draws: Resampling, block_s: Float64Array) -> Figures:
        """Draw the figures; slowness knows no error of the angle, and the longest time without rest, as the
        extreme of a day, only that error.
        """
        drawn_s = draws.sum(block_s)[:, np.newaxis]
        per_s = draws.sum_with_error(self.rest, self.errors_deg) / drawn_s
        slow_per_s = draws.sum(self.slow) / drawn_s
        return {
            "recovery_neutral_slow_percent": 100.0 * per_s[:, SECONDS],
            "recovery_neutral_slow_per_h": 3600.0 * per_s[:, STAYS],
            "recovery_slow_percent": 100.0 * slow_per_s[:, SECONDS],
            "recovery_slow_per_h": 3600.0 * slow_per_s[:, STAYS],
            "recovery_longest_without_s": draws.look_up(self.longest_s, self.errors_deg),
        }


def _count_stays(stays: IntArray, part_rows: IntArray, rate_hz: float, sums: Float64Array) -> None:
    """Add seconds and number of stays to ``sums``, shape (g, b, 2)."""
    add_spans(stays, 1.0 / rate_hz, part_rows, sums[:, :, SECONDS])
    np.add.at(sums[:, :, STAYS], (stays[:, LEVEL], find_parts(part_rows, stays[:, START])), 1.0)
