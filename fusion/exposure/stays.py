"""How long the arm stays at a level: repetitions, sustained stays above a level, rest, and variation."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.conventions import MAIN_THRESHOLD_DEG
from acromion.fusion.exposure.bins import (
    BLOCK_MINUTES,
    THRESHOLDS_DEG,
    PartHistograms,
    Stretches,
    find_percentile_cells,
    sum_groups,
)
from acromion.fusion.exposure.metric_filter import MetricAngle
from acromion.fusion.exposure.resampling import GROWTH, Figures, Resampling, lower_thresholds, scale_draws
from acromion.fusion.exposure.types import Entries, Episodes, Eva, EvaSummary, Recovery
from acromion.fusion.numba_kernels import inner, kernel
from acromion.fusion.recording import MICROSECONDS, BoolArray, Float64Array, IntArray
from acromion.fusion.runs import (
    IS_CUT,
    IS_ENTRY,
    LEVEL,
    RUN,
    START,
    STOP,
    add_rows,
    add_spans,
    find_part_rows,
    find_parts,
    find_runs,
    find_stays_above,
)

# Repetitions and sustained stays above a threshold.
#
# Both use one Schmitt trigger with 10 deg of hysteresis: above once the angle exceeds c + 5, below once it is
# less than c - 5. A run of valid rows that starts above c + 5 starts "above": a stay, but not a repetition.

HALF_HYSTERESIS_DEG = 5.0
MERGED_GAP_S = 0.5
SHORTEST_S = 0.5
LONG_S = (5.0, 10.0, 30.0, 60.0)
BUSY_PER_MINUTE = 2
LEAST_OF_MINUTE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Stays:
    """Repetitions and episodes of one segment above one threshold.

    ``entry_us``: shape (k,): the times of the repetitions.
    ``start_s``, ``duration_s``, ``censored``: shape (e,): the episodes after short gaps are merged and short
    episodes dropped.
    """

    entry_us: IntArray
    start_s: Float64Array
    duration_s: Float64Array
    censored: BoolArray


def find_stays(angle: MetricAngle, threshold_deg: float) -> Stays:
    """Return the repetitions and episodes of one segment above one threshold."""
    crossings = _run_triggers(angle, np.array([float(threshold_deg)]), HALF_HYSTERESIS_DEG)
    entries = crossings[crossings[:, IS_ENTRY] == 1, START]
    episodes = _merge_and_drop(crossings, angle.rate_hz)
    return Stays(
        angle.start_us + np.rint(entries * (MICROSECONDS / angle.rate_hz)).astype(np.int64),
        angle.start_us / MICROSECONDS + episodes[:, START] / angle.rate_hz,
        (episodes[:, STOP] - episodes[:, START]) / angle.rate_hz,
        episodes[:, IS_CUT] == 1,
    )


def _run_triggers(angle: MetricAngle, levels_deg: Float64Array, half_deg: float) -> IntArray:
    return find_stays_above(angle.elevation_deg, angle.valid, levels_deg + half_deg, levels_deg - half_deg)


def _merge_and_drop(stays: IntArray, rate_hz: float) -> IntArray:
    """Merge stays of one level and valid run over gaps under 0.5 s, then drop stays under 0.5 s."""
    gap = stays[1:, START] - stays[:-1, STOP]
    same = (stays[1:, RUN] == stays[:-1, RUN]) & (stays[1:, LEVEL] == stays[:-1, LEVEL])
    apart = ~(same & _is_under(gap, MERGED_GAP_S, rate_hz))
    first = np.concatenate([[True], apart])[: len(stays)]
    last = np.concatenate([apart, [True]])[: len(stays)]
    merged = stays[last]
    merged[:, START] = stays[first, START]
    kept: IntArray = merged[~_is_under(merged[:, STOP] - merged[:, START], SHORTEST_S, rate_hz)]
    return kept


def _is_under(rows: IntArray, limit_s: float, rate_hz: float) -> BoolArray:
    """Return which lengths are under a limit; the fitted rate is only exact to a thousandth of a row."""
    return rows < limit_s * rate_hz - 1e-3


def summarise_entries(
    threshold_deg: float, stays: list[Stays], analysed_s: float, minutes: PartHistograms | None = None
) -> Entries:
    """Count the repetitions of all segments, per hour of analysed time.

    With the day's minutes, also the share of minutes (with at least 30 s of analysed time) with two or more
    entries per analysed minute: above this frequency EN 1005-4 requires more than the zone.
    """
    entry_us = np.concatenate([segment.entry_us for segment in stays])
    busy_percent = None
    if minutes is not None:
        analysed_min, kept = find_analysed_minutes(minutes)
        is_busy = find_busy(np.histogram(entry_us, minutes.edges_us)[0], analysed_min)
        busy_percent = 100.0 * float(is_busy[kept].mean()) if kept.any() else None
    return Entries(threshold_deg, len(entry_us), len(entry_us) * 3600.0 / analysed_s, busy_percent)


def find_analysed_minutes(minutes: PartHistograms) -> tuple[Float64Array, BoolArray]:
    """Return the analysed part of each minute, shape (m,), and whether the minute counts."""
    analysed_min = np.asarray(minutes.cell_us.sum(axis=1, dtype=np.int64) / (60 * MICROSECONDS), np.float64)
    return analysed_min, analysed_min >= LEAST_OF_MINUTE


def find_busy(counts: IntArray | Float64Array, analysed_min: Float64Array) -> BoolArray:
    """Return the minutes with two or more entries per minute of analysed time; the last axis is minutes.

    Rows do not start exactly with a minute, so a minute may contain one row more than 60 s. That row does not
    make a third entry necessary.
    """
    return np.asarray(counts >= BUSY_PER_MINUTE * np.minimum(analysed_min, 1.0) - 1e-9)


def summarise_episodes(threshold_deg: float, stays: list[Stays], analysed_s: float | None = None) -> Episodes:
    """Describe the episodes of all segments; of equally long ones the earliest is the longest."""
    durations_s = np.concatenate([segment.duration_s for segment in stays])
    longer_s = tuple((limit_s, float(durations_s[durations_s > limit_s].sum())) for limit_s in LONG_S)
    per_hour = len(durations_s) * 3600.0 / analysed_s if analysed_s else None
    if len(durations_s) == 0:
        return Episodes(threshold_deg, 0, None, None, None, 0, per_hour, longer_s=longer_s)
    starts_s = np.concatenate([segment.start_s for segment in stays])
    longest = int(np.argmax(np.round(durations_s, 6)))
    return Episodes(
        threshold_deg,
        len(durations_s),
        float(durations_s[longest]),
        float(np.median(durations_s)),
        float(starts_s[longest]),
        sum(int(segment.censored.sum()) for segment in stays),
        per_hour,
        float(durations_s.sum()),
        float(np.percentile(durations_s, 90)),
        longer_s,
    )


def find_longest(start_s: Float64Array, end_s: Float64Array, edges_us: IntArray) -> Float64Array:
    """Return the longest part of an episode within each piece of the day, shape (p,); 0 without one."""
    edges_s = edges_us / MICROSECONDS
    inside_s = (
        np.minimum(end_s, stop_s) - np.maximum(start_s, first_s) for first_s, stop_s in pairwise(edges_s)
    )
    return np.array([each_s.max(initial=0.0) for each_s in inside_s])


# Entries and episodes again, with an angle that is slightly too high or too low.


CELLS_PER_OCTAVE = 4
CELLS = 16 * CELLS_PER_OCTAVE  # from 0.5 s to 9 h
# places in the sums: number of episodes, their seconds, seconds of episodes longer than 5, 10, 30 and 60 s
STAYS, STAY_S, LONGER_S = range(3)
SUMS = LONGER_S + len(LONG_S)


class ShiftedStays:
    """Counts for each threshold and error of the angle in each part of the day.

    ``levels_deg``: shape (t,): the thresholds of :data:`THRESHOLDS_DEG` with each error, sorted.
    ``entries``: shape (t, s): the entries in each stretch.
    ``sums``: shape (t, b, 6): the episodes of each 5-minute block and their seconds.
    ``cells``: shape (t, b, 64): the episodes by length in quarters of an octave.
    ``longest_s``: shape (t,); ``piece_longest_s``: shape (t, p): in each piece of the diary, of the levels
    around 60 deg only. An episode is counted in the block where it starts, its time in each block it
    spans.
    """

    def __init__(self, errors_deg: Float64Array, stretches: Stretches) -> None:
        """Start with nothing counted; ``errors_deg``, shape (g,), has 0 in the middle."""
        self.errors_deg, self.stretches = errors_deg, stretches
        self.levels_deg = np.unique([np.round(c - errors_deg, 9) for c in THRESHOLDS_DEG])
        levels, blocks = len(self.levels_deg), len(stretches.block_edges_us) - 1
        self.entries = np.zeros((levels, len(stretches.minute_of)))
        self.sums = np.zeros((levels, blocks, SUMS))
        self.cells = np.zeros((levels, blocks, CELLS), np.int32)
        self.longest_s = np.zeros(levels)
        self.piece_longest_s = np.zeros((levels, len(stretches.piece_edges_us) - 1))

    def add(self, angle: MetricAngle) -> None:
        """Count a segment."""
        stays = _run_triggers(angle, self.levels_deg, HALF_HYSTERESIS_DEG)
        _count_entries(stays, find_part_rows(angle, self.stretches.edges_us), self.entries)
        block_rows = find_part_rows(angle, self.stretches.block_edges_us)
        episodes = _merge_and_drop(stays, angle.rate_hz)
        level, rows = episodes[:, LEVEL], episodes[:, STOP] - episodes[:, START]
        block = find_parts(block_rows, episodes[:, START])
        np.add.at(self.sums[:, :, STAYS], (level, block), 1.0)
        add_spans(episodes, 1.0 / angle.rate_hz, block_rows, self.sums[:, :, STAY_S])
        for k, limit_s in enumerate(LONG_S):
            longer = episodes[rows > limit_s * angle.rate_hz + 1e-3]
            add_spans(longer, 1.0 / angle.rate_hz, block_rows, self.sums[:, :, LONGER_S + k])
        _count_lengths(level, block, rows / angle.rate_hz, self.cells, self.longest_s)
        begin_s = angle.start_us / MICROSECONDS + episodes[:, START] / angle.rate_hz
        for k in self.find_levels(MAIN_THRESHOLD_DEG) if self.piece_longest_s.shape[1] > 1 else ():
            start_s, length_s = begin_s[level == k], rows[level == k] / angle.rate_hz
            longest_s = find_longest(start_s, start_s + length_s, self.stretches.piece_edges_us)
            self.piece_longest_s[k] = np.maximum(self.piece_longest_s[k], longest_s)

    def find_levels(self, threshold_deg: int) -> IntArray:
        """Return the places of one threshold in the order of the errors, shape (11,)."""
        return np.searchsorted(self.levels_deg, np.round(threshold_deg - self.errors_deg, 9))

    def pick(self, array: Float64Array | NDArray[np.int32], threshold_deg: int) -> Float64Array:
        """Return the rows of one threshold in the order of the errors, shape (11, ...)."""
        return np.asarray(array[self.find_levels(threshold_deg)], np.float64)

    def pick_entries(self, threshold_deg: int, group_of: IntArray) -> Float64Array:
        """Return the entries of one threshold in each group of stretches, shape (11, groups)."""
        return sum_groups(self.pick(self.entries, threshold_deg), group_of)

    def draw(self, episodes: tuple[Episodes, ...], draws: Resampling, block_s: Float64Array) -> Figures:
        """Draw repetitions and episodes; ``block_s``, shape (b,), is the analysed time.

        The draws include the error of the angle and the sampling of the day. Those of the longest episode
        only include the error, because one day does not show how long the longest episode of other days is.
        """
        found: Figures = {}
        length_h, drawn_h = float(block_s.sum()) / 3600.0, draws.sum(block_s) / 3600.0
        for item in episodes:
            c = int(item.threshold_deg)
            entries = draws.sum_with_error(self.pick_entries(c, self.stretches.block_of), self.errors_deg)
            sums = draws.sum_with_error(self.pick(self.sums, c), self.errors_deg) / drawn_h[:, np.newaxis]
            found[f"entries_above_{c}_per_h"] = entries / drawn_h
            found[f"entries_above_{c}_count"] = entries / drawn_h * length_h
            found[f"episodes_above_{c}_per_h"] = sums[:, STAYS]
            found[f"episodes_above_{c}_count"] = sums[:, STAYS] * length_h
            found[f"episodes_above_{c}_total_s"] = sums[:, STAY_S] * length_h
            for k, limit_s in enumerate(LONG_S):
                name = f"episodes_above_{c}_longer_than_{limit_s:g}_s_total_s"
                found[name] = sums[:, LONGER_S + k] * length_h
            if item.longest_s and item.median_s is not None and item.p90_s is not None:
                longest_s = draws.look_up(self.pick(self.longest_s, c), self.errors_deg)
                found[f"episodes_above_{c}_longest_s"] = longest_s
                cells = self.pick(self.cells, c)
                drawn_s = _find_lengths(draws.sum_with_error(cells, self.errors_deg))
                coarse_s = _find_lengths(cells[len(cells) // 2].sum(axis=0)[np.newaxis])[0]
                for k, (name, value) in enumerate((("median", item.median_s), ("p90", item.p90_s))):
                    found[f"episodes_above_{c}_{name}_s"] = scale_draws(value, drawn_s[:, k], coarse_s[k])
        return found

    def draw_busy(self, minutes: PartHistograms, draws: Resampling) -> Figures:
        """Draw the share of minutes with two entries or more."""
        analysed_min, kept = find_analysed_minutes(minutes)
        block_of = np.arange(len(kept)) // BLOCK_MINUTES
        drawn_minutes = draws.sum(sum_groups(kept.astype(np.float64), block_of))
        found: Figures = {}
        for c in THRESHOLDS_DEG:
            is_busy = find_busy(self.pick_entries(c, self.stretches.minute_of), analysed_min) & kept
            drawn = draws.sum_with_error(sum_groups(is_busy.astype(np.float64), block_of), self.errors_deg)
            with np.errstate(invalid="ignore"):  # a draw may have no minute that counts
                found[f"entries_above_{c}_busy_minutes_percent"] = 100.0 * drawn / drawn_minutes
        return found


def _count_entries(stays: IntArray, part_rows: IntArray, entries: Float64Array) -> None:
    entered = stays[stays[:, IS_ENTRY] == 1]
    np.add.at(entries, (entered[:, LEVEL], find_parts(part_rows, entered[:, START])), 1.0)


@kernel
def _count_lengths(level, block, seconds, cells, longest_s):  # type: ignore[no-untyped-def]
    """Count each episode in the cell of its length, in the block where it starts."""
    for k in range(len(level)):
        cell = int(np.log2(max(seconds[k] / SHORTEST_S, 1.0)) * CELLS_PER_OCTAVE)
        cells[level[k], block[k], min(cell, CELLS - 1)] += 1
        longest_s[level[k]] = max(longest_s[level[k]], seconds[k])


def _find_lengths(cells: Float64Array) -> Float64Array:
    """Return median and P90 of lengths from their cells, shape (k, 64): shape (k, 2), NaN without any."""
    places = find_percentile_cells(cells, np.array([50.0, 90.0]))
    return np.asarray(SHORTEST_S * 2.0 ** (places / CELLS_PER_OCTAVE))


# Entries with the one-sided error of the N-pose (:mod:`acromion.fusion.exposure.resampling`): both thresholds
# of the trigger are lowered and move slightly closer to each other.


HALF_WIDTHS_DEG = (HALF_HYSTERESIS_DEG / (1.0 + GROWTH), HALF_HYSTERESIS_DEG)
"""Half widths of the trigger, with the full error and without it."""
STEP_DEG = 2.5
"""Spacing of the trigger middles for which entries are counted; linear between them."""


class LoweredEntries:
    """Entries at lowered triggers.

    ``levels_deg``: shape (t,): the middles of the triggers, evenly spaced.
    ``entries``: shape (2, t, s): the entries in each stretch of the day with each of :data:`HALF_WIDTHS_DEG`.
    """

    def __init__(self, errors_deg: Float64Array, edges_us: IntArray) -> None:
        """Start with nothing counted, with all triggers that a draw may need."""
        lowest = lower_thresholds(THRESHOLDS_DEG[0] - errors_deg[-1:], np.ones(1))[0] - STEP_DEG
        highest = THRESHOLDS_DEG[-1] - errors_deg[0]
        self.levels_deg = lowest + STEP_DEG * np.arange(np.ceil((highest - lowest) / STEP_DEG) + 1)
        self.edges_us = edges_us
        self.entries = np.zeros((len(HALF_WIDTHS_DEG), len(self.levels_deg), len(edges_us) - 1))

    def add(self, angle: MetricAngle) -> None:
        """Count a segment."""
        part_rows = find_part_rows(angle, self.edges_us)
        for half_deg, entries in zip(HALF_WIDTHS_DEG, self.entries, strict=True):
            _count_entries(_run_triggers(angle, self.levels_deg, half_deg), part_rows, entries)

    def draw(self, threshold_deg: float, blocks: Float64Array, draws: Resampling) -> Float64Array:
        """Return the entries above a threshold in each draw, shape (200,).

        ``blocks``: sums of ``entries``, shape (2, t, b).
        """
        enter_deg, leave_deg = (
            lower_thresholds(threshold_deg + half_deg - draws.error_deg, draws.share)
            for half_deg in (HALF_HYSTERESIS_DEG, -HALF_HYSTERESIS_DEG)
        )
        sums = draws.sum(np.moveaxis(blocks, -1, 0))  # shape (200, 2, t)
        middle = np.interp((enter_deg + leave_deg) / 2, self.levels_deg, np.arange(len(self.levels_deg)))
        width = np.interp((enter_deg - leave_deg) / 2, HALF_WIDTHS_DEG, (0.0, 1.0))
        left = np.minimum(middle.astype(np.int64), len(self.levels_deg) - 2)
        part, draw = middle - left, np.arange(len(sums))
        narrow, wide = ((1 - part) * sums[draw, k, left] + part * sums[draw, k, left + 1] for k in (0, 1))
        return np.asarray((1 - width) * narrow + width * wide)


# Rest of the upper arm: arm down and nearly still, and the longest time without it.
#
# Neutral and slow: elevation under 20 deg and generalised speed under 5 deg/s for at least 3 s without a gap.
# Without a vertical (a precomputed angle series) the speed of inclination is used. The figure describes the
# position of the arm, not whether its muscles rested.

NEUTRAL_DEG = 20.0
SLOW_DPS = 5.0
SHORTEST_REST_S = 3.0
REST_S, RESTS = range(2)


class RecoveryTally:
    """Counts at each error of the angle.

    ``rest``: shape (g, b, 2): seconds and number of neutral and slow stays in each 5-minute block.
    ``rest_s``: shape (g, s): the seconds in each stretch, for the parts of the day.
    ``slow``: shape (b, 2): the same as ``rest`` for slow stays.
    ``longest_s``: shape (g,): the longest time without a neutral and slow stay. A stay is counted in the
    block where it starts, its time in each block it spans.
    """

    def __init__(
        self, errors_deg: Float64Array, edges_us: IntArray, stretch_edges_us: IntArray | None = None
    ) -> None:
        """Start with nothing counted; ``errors_deg``, shape (g,), has 0 in the middle."""
        self.errors_deg, self.edges_us = errors_deg, edges_us
        self.stretch_edges_us = edges_us if stretch_edges_us is None else stretch_edges_us
        self.rest_s = np.zeros((len(errors_deg), len(self.stretch_edges_us) - 1))
        self.rest = np.zeros((len(errors_deg), len(edges_us) - 1, 2))
        self.slow = np.zeros((len(edges_us) - 1, 2))
        self.longest_s = np.zeros(len(errors_deg))

    def add(self, angle: MetricAngle, slow: BoolArray) -> None:
        """Count a segment; ``slow``, shape (n,), marks the rows reached at less than 5 deg/s."""
        part_rows, least_rows = find_part_rows(angle, self.edges_us), SHORTEST_REST_S * angle.rate_hz - 1e-3
        slow_runs = find_runs(slow & angle.valid)
        slow_runs = slow_runs[slow_runs[:, 1] - slow_runs[:, 0] >= least_rows]
        still, is_slow = np.zeros((len(slow_runs), 3), np.int64), np.zeros(len(angle), np.bool_)
        still[:, START : STOP + 1] = slow_runs
        _count_stays(still, part_rows, angle.rate_hz, self.slow[np.newaxis])
        for first, stop in slow_runs.tolist():
            is_slow[first:stop] = True

        # below a level: the negative angle above the negative level, without hysteresis
        turned_deg = -np.round(NEUTRAL_DEG - self.errors_deg, 9)
        rests = find_stays_above(-angle.elevation_deg, is_slow, turned_deg, np.nextafter(turned_deg, np.inf))
        rests = rests[rests[:, STOP] - rests[:, START] >= least_rows]
        _count_stays(rests, part_rows, angle.rate_hz, self.rest)
        stretch_rows = find_part_rows(angle, self.stretch_edges_us)
        add_spans(rests, 1.0 / angle.rate_hz, stretch_rows, self.rest_s)
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
            neutral_slow_percent=float(rest[REST_S]) * percent,
            neutral_slow_per_h=float(rest[RESTS]) * per_hour,
            slow_percent=float(slow[REST_S]) * percent,
            slow_per_h=float(slow[RESTS]) * per_hour,
            longest_without_s=float(self.longest_s[middle]),
        )

    def draw(self, draws: Resampling, block_s: Float64Array) -> Figures:
        """Draw the figures.

        Slowness does not depend on the error of the angle. The longest time without rest, an extreme of the
        day, only depends on that error.
        """
        drawn_s = draws.sum(block_s)[:, np.newaxis]
        per_s = draws.sum_with_error(self.rest, self.errors_deg) / drawn_s
        slow_per_s = draws.sum(self.slow) / drawn_s
        return {
            "recovery_neutral_slow_percent": 100.0 * per_s[:, REST_S],
            "recovery_neutral_slow_per_h": 3600.0 * per_s[:, RESTS],
            "recovery_slow_percent": 100.0 * slow_per_s[:, REST_S],
            "recovery_slow_per_h": 3600.0 * slow_per_s[:, RESTS],
            "recovery_longest_without_s": draws.look_up(self.longest_s, self.errors_deg),
        }


def _count_stays(stays: IntArray, part_rows: IntArray, rate_hz: float, sums: Float64Array) -> None:
    """Add seconds and number of stays to ``sums``, shape (g, b, 2)."""
    add_spans(stays, 1.0 / rate_hz, part_rows, sums[:, :, REST_S])
    np.add.at(sums[:, :, RESTS], (stays[:, LEVEL], find_parts(part_rows, stays[:, START])), 1.0)


# Exposure variation analysis (Mathiassen and Winkel 1991): how long each level is kept.

ANGLE_EDGES_DEG = (0.0, 20.0, 30.0, 60.0, 90.0, 180.0)
DURATION_EDGES_S = (0.0, 1.0, 3.0, 7.0, 15.0, 31.0, 63.0, 127.0, 255.0, None)
SHAPE = (len(ANGLE_EDGES_DEG) - 1, len(DURATION_EDGES_S) - 1)
MIDDLES_DEG = np.array([(low + high) / 2.0 for low, high in pairwise(ANGLE_EDGES_DEG)])
MIDDLES_S = np.array(
    [
        (low or 0.0) * 1.5 if high is None else ((low or 0.0) + high) / 2.0
        for low, high in pairwise(DURATION_EDGES_S)
    ]
)
"""The last class has no end; its middle is one and a half times its start."""


class EvaTally:
    """Seconds by error of the angle, 5-minute block, angle class and duration of the uninterrupted stay.

    ``seconds``: shape (g, b, 5, 9). A stay counts in every block by its time there, in the class of its full
    length.
    """

    def __init__(self, errors_deg: Float64Array, edges_us: IntArray) -> None:
        """Start with nothing counted; ``errors_deg``, shape (g,), has 0 in the middle."""
        self.errors_deg, self.edges_us = errors_deg, edges_us
        self.seconds = np.zeros((len(errors_deg), len(edges_us) - 1, *SHAPE))

    def add(self, angle: MetricAngle) -> None:
        """Count a segment: with an error b, a class starts b lower."""
        levels = np.array(ANGLE_EDGES_DEG[1:-1]) - self.errors_deg[:, np.newaxis]
        order = np.argsort(levels, axis=None, kind="stable")
        longest_s = np.array(DURATION_EDGES_S[1:-1], np.float64)
        # a stay as long as an edge belongs to the class above it
        upper_rows = np.ceil(longest_s * angle.rate_hz - 1e-3)
        block_rows = find_part_rows(angle, self.edges_us)
        lengths = (upper_rows, block_rows, 1.0 / angle.rate_hz)
        state = np.full((len(self.seconds), 2), -1)
        levels_deg, error_of = np.round(levels.ravel()[order], 9), order // levels.shape[1]
        _scan_classes(angle.elevation_deg, angle.valid, levels_deg, error_of, lengths, state, self.seconds)

    def summarise(self) -> Eva:
        """Return the matrix of the angle as measured, in percent of the analysed time."""
        seconds = self.seconds[len(self.errors_deg) // 2].sum(axis=0)
        return Eva(ANGLE_EDGES_DEG, DURATION_EDGES_S, 100.0 * seconds / seconds.sum())

    def draw(self, draws: Resampling) -> tuple[Figures, Figures]:
        """Draw the cells, row by row, and the marginals, the spread and the centroid."""
        seconds = draws.sum_with_error(self.seconds, self.errors_deg)
        percent = 100.0 * seconds / seconds.sum(axis=(1, 2), keepdims=True)
        by_angle, by_duration = percent.sum(axis=2), percent.sum(axis=1)
        summaries = {
            **{f"eva_{name}_deg_percent": by_angle[:, k] for k, name in enumerate(name_classes())},
            **{f"eva_{name}_s_percent": by_duration[:, k] for k, name in enumerate(name_durations())},
            "eva_cell_sd_percent": percent.std(axis=(1, 2)),
            "eva_centroid_deg": by_angle @ MIDDLES_DEG / 100.0,
            "eva_centroid_s": by_duration @ MIDDLES_S / 100.0,
        }
        return {str(k): cell for k, cell in enumerate(percent.reshape(len(percent), -1).T)}, summaries


@kernel
def _scan_classes(angle_deg, valid, levels, error_of, lengths, state, seconds):  # type: ignore[no-untyped-def]
    """Track the class at every error at once: it only changes when the angle passes a level.

    ``levels``: increasing: the edges of the angle classes at every error; ``error_of``: the error of each.
    ``lengths``: the edges of the duration classes, the first row of each block, and the seconds per row.
    ``reached``: the number of levels the angle has reached. ``state``: shape (g, 2): the first row and the
    class of the current stay at each error.
    """
    block, reached, low, high = 0, -1, np.inf, -np.inf
    for i in range(len(angle_deg) + 1):
        if i == len(angle_deg) or not valid[i]:
            if reached >= 0:
                for error in range(len(state)):
                    block = _end_stay(error, i, state[error, 1], block, state, lengths, seconds)
            reached, low, high = -1, np.inf, -np.inf
            continue
        x = angle_deg[i]
        if low <= x < high:
            continue
        if reached < 0:
            reached = 0
            for error in range(len(state)):
                state[error, 0], state[error, 1] = i, 0
        while reached < len(levels) and x >= levels[reached]:
            error = error_of[reached]
            block = _end_stay(error, i, state[error, 1] + 1, block, state, lengths, seconds)
            reached += 1
        while reached > 0 and x < levels[reached - 1]:
            reached -= 1
            error = error_of[reached]
            block = _end_stay(error, i, state[error, 1] - 1, block, state, lengths, seconds)
        low = levels[reached - 1] if reached > 0 else -np.inf
        high = levels[reached] if reached < len(levels) else np.inf


@inner
def _end_stay(error, row, new_level, block, state, lengths, seconds):  # type: ignore[no-untyped-def]
    """Count the stay that ends before ``row``, and switch to the class ``new_level``.

    ``block``: a block that begins before ``row``; returns the block of the previous row. Most stays are short
    and within one block, so both searches start there and from the shortest class.
    """
    upper_rows, block_rows, period_s = lengths
    first, level = state[error, 0], state[error, 1]
    if row > first:
        while block < seconds.shape[1] - 1 and block_rows[block + 1] < row:
            block += 1
        length = 0
        while length < len(upper_rows) and row - first >= upper_rows[length]:
            length += 1
        if first >= block_rows[block]:
            seconds[error, block, level, length] += (row - first) * period_s
        else:
            add_rows(first, row, period_s, block_rows, seconds[error, :, level, length])
    state[error, 0], state[error, 1] = row, new_level
    return block


def summarise_eva_matrix(eva: Eva) -> EvaSummary:
    """Return the marginals, the standard deviation of the cells and the centroid of the matrix.

    The centroid is in degrees (middles of the angle classes) and seconds (middles of the duration classes).
    """
    by_angle, by_duration = eva.percent.sum(axis=1), eva.percent.sum(axis=0)
    return EvaSummary(
        by_angle_percent=tuple(by_angle.tolist()),
        by_duration_percent=tuple(by_duration.tolist()),
        cell_sd_percent=float(eva.percent.std()),
        centroid_deg=float(by_angle @ MIDDLES_DEG / 100.0),
        centroid_s=float(by_duration @ MIDDLES_S / 100.0),
    )


def name_classes() -> list[str]:
    """Return the names of the angle classes as in columns: ``20_30``."""
    return [f"{a:g}_{b:g}" for a, b in pairwise(ANGLE_EDGES_DEG)]


def name_durations() -> list[str]:
    """Return the names of the duration classes as in columns: ``1_3``, the last ``255_up``."""
    ends = [*(f"{edge:g}" for edge in DURATION_EDGES_S if edge is not None), "up"]
    return [f"{a}_{b}" for a, b in pairwise(ends)]
