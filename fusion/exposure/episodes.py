"""Repetitions and sustained stays above a threshold.

Both come from one Schmitt trigger with 10 deg of hysteresis: above once the angle passes c + 5, below once it
passes c - 5. A run of valid rows that starts above c + 5 starts "above": a stay, but no repetition.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.exposure.bins import (
    BLOCK_MINUTES,
    THRESHOLDS_DEG,
    PartHistograms,
    Stretches,
    find_percentile_cells,
    sum_groups,
)
from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.resampling import GROWTH, Figures, Resampling, lower_thresholds, scale_draws
from fusion.exposure.types import Entries, Episodes
from fusion.numba_kernels import kernel
from fusion.recording import MICROSECONDS, BoolArray, Float64Array, IntArray
from fusion.runs import (
    IS_CUT,
    IS_ENTRY,
    LEVEL,
    RUN,
    START,
    STOP,
    add_spans,
    find_part_rows,
    find_parts,
    find_stays_above,
)

HALF_HYSTERESIS_DEG = 5.0
MERGED_GAP_S = 0.5
SHORTEST_S = 0.5
LONG_S = (5.0, 10.0, 30.0, 60.0)
BUSY_PER_MINUTE = 2
LEAST_OF_MINUTE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Stays:
    """Repetitions and episodes of one segment above one threshold.

    ``entry_us``, shape (k,), are the times of the repetitions; ``start_s``, ``duration_s`` and ``censored``,
    shape (e,), are the episodes after merging and dropping.
    """

    entry_us: IntArray
    start_s: Float64Array
    duration_s: Float64Array
    censored: BoolArray


def find_stays(angle: MetricAngle, threshold_deg: float) -> Stays:
    """Find the repetitions and episodes of one segment above one threshold."""
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
    """Merge stays of one level and valid run over gaps under 0.5 s, then drop those under 0.5 s."""
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
    """Find the lengths under a limit; a thousandth of a row absorbs the fit of the rate."""
    return rows < limit_s * rate_hz - 1e-3


def summarise_entries(
    threshold_deg: float, stays: list[Stays], analysed_s: float, minutes: PartHistograms | None = None
) -> Entries:
    """Count the repetitions of all segments, per hour of analysed time.

    With the day's minutes also the share of them (those with 30 s or more of analysed time) that hold two
    entries or more per minute of it: the frequency at which EN 1005-4 asks for more than the zone.
    """
    entry_us = np.concatenate([segment.entry_us for segment in stays])
    busy_percent = None
    if minutes is not None:
        analysed_min, kept = find_analysed_minutes(minutes)
        is_busy = find_busy(np.histogram(entry_us, minutes.edges_us)[0], analysed_min)
        busy_percent = 100.0 * float(is_busy[kept].mean()) if kept.any() else None
    return Entries(threshold_deg, len(entry_us), len(entry_us) * 3600.0 / analysed_s, busy_percent)


def find_analysed_minutes(minutes: PartHistograms) -> tuple[Float64Array, BoolArray]:
    """Return how much of each minute was analysed, shape (m,), and whether it counts."""
    analysed_min = np.asarray(minutes.cell_us.sum(axis=1, dtype=np.int64) / (60 * MICROSECONDS), np.float64)
    return analysed_min, analysed_min >= LEAST_OF_MINUTE


def find_busy(counts: IntArray | Float64Array, analysed_min: Float64Array) -> BoolArray:
    """Find the minutes with two entries or more per minute of analysed time; the last axis is minutes.

    Rows do not begin with minutes: one may hold a row more than 60 s, and asks for no third entry.
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


# Entries and episodes once more, with the angle read a little too high or too low.


CELLS_PER_OCTAVE = 4
CELLS = 16 * CELLS_PER_OCTAVE  # from 0.5 s to 9 h
# the sums: episodes, their seconds, and the seconds of those longer than 5, 10, 30 and 60 s
STAYS, STAY_S, LONGER_S = range(3)
SUMS = LONGER_S + len(LONG_S)


class ShiftedStays:
    """What is counted at each threshold and error of the angle in each part of the day.

    ``levels_deg``, shape (t,), are the thresholds of :data:`THRESHOLDS_DEG` with each error, sorted.
    ``entries``, shape (t, s), are the entries in each stretch; ``sums``, shape (t, b, 6), the episodes of
    each 5-minute block and their seconds; ``cells``, shape (t, b, 64), the episodes by length in quarters of
    an octave; ``longest_s``, shape (t,). An episode is counted where it begins, its time where it lies.
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

    def pick(self, array: Float64Array | NDArray[np.int32], threshold_deg: int) -> Float64Array:
        """Return the rows of one threshold in the order of the errors, shape (11, ...)."""
        wanted = np.searchsorted(self.levels_deg, np.round(threshold_deg - self.errors_deg, 9))
        return np.asarray(array[wanted], np.float64)

    def pick_entries(self, threshold_deg: int, group_of: IntArray) -> Float64Array:
        """Return the entries of one threshold in each group of stretches, shape (11, groups)."""
        return sum_groups(self.pick(self.entries, threshold_deg), group_of)

    def draw(self, episodes: tuple[Episodes, ...], draws: Resampling, block_s: Float64Array) -> Figures:
        """Draw repetitions and episodes; ``block_s``, shape (b,), is the analysed time.

        The draws cover the error of the angle and the sampling of the day; those of the longest episode the
        error alone, for the longest of other days cannot be drawn from this one.
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
            with np.errstate(invalid="ignore"):  # a draw without a minute that counts
                found[f"entries_above_{c}_busy_minutes_percent"] = 100.0 * drawn / drawn_minutes
        return found


def _count_entries(stays: IntArray, part_rows: IntArray, entries: Float64Array) -> None:
    entered = stays[stays[:, IS_ENTRY] == 1]
    np.add.at(entries, (entered[:, LEVEL], find_parts(part_rows, entered[:, START])), 1.0)


@kernel
def _count_lengths(level, block, seconds, cells, longest_s):  # type: ignore[no-untyped-def]
    """Count each episode in the cell of its length, in the block in which it begins."""
    for k in range(len(level)):
        cell = int(np.log2(max(seconds[k] / SHORTEST_S, 1.0)) * CELLS_PER_OCTAVE)
        cells[level[k], block[k], min(cell, CELLS - 1)] += 1
        longest_s[level[k]] = max(longest_s[level[k]], seconds[k])


def _find_lengths(cells: Float64Array) -> Float64Array:
    """Return median and P90 of lengths from their cells, shape (k, 64): shape (k, 2), NaN without any."""
    places = find_percentile_cells(cells, np.array([50.0, 90.0]))
    return np.asarray(SHORTEST_S * 2.0 ** (places / CELLS_PER_OCTAVE))


# Entries with the one-sided error of the N-pose (:mod:`fusion.exposure.resampling`): both thresholds of the
# trigger are lowered, which brings them a little nearer to each other.


HALF_WIDTHS_DEG = (HALF_HYSTERESIS_DEG / (1.0 + GROWTH), HALF_HYSTERESIS_DEG)
"""Of the trigger, with the whole of the error and without it."""
STEP_DEG = 2.5
"""Between the middles at which rises are counted; between them their number is taken as linear."""


class LoweredEntries:
    """Entries at lowered triggers.

    ``levels_deg``, shape (t,), are the middles of the triggers, evenly spread; ``entries``, shape (2, t, s),
    the entries in each stretch of the day with each of :data:`HALF_WIDTHS_DEG`.
    """

    def __init__(self, errors_deg: Float64Array, edges_us: IntArray) -> None:
        """Start with nothing counted, with all triggers that a draw may ask for."""
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
        """Return the entries above a threshold in each draw, shape (200,); blocks as summed from ``entries``,
        shape (2, t, b).
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
