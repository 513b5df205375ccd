"""Repetitions and sustained stays above a threshold (EXPOSURE.md A4 and A5, CONTRACT.md §5).

Both come from one Schmitt trigger with 10 deg of hysteresis: above once the angle passes c + 5, below once it
passes c - 5. A run of valid rows that starts above c + 5 starts "above": a stay, but no repetition.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.exposure.bins import THRESHOLDS_DEG, PartHistograms, find_percentile_cells
from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.parts import BLOCK_MINUTES, Stretches, sum_groups
from fusion.exposure.resampling import Resampling, find_interval, name_intervals, scale_interval
from fusion.exposure.rows import add_rows, find_part, find_part_rows
from fusion.exposure.types import Entries, Episodes, Interval
from fusion.numba_kernels import inner, kernel
from fusion.recording import MICROSECONDS, BoolArray, Float64Array, IntArray

HALF_HYSTERESIS_DEG = 5.0
MERGED_GAP_S = 0.5
SHORTEST_S = 0.5
USUAL_STAYS = 16_384
LONG_S = (5.0, 10.0, 30.0, 60.0)
BUSY_PER_MINUTE = 2
LEAST_OF_MINUTE = 0.5
START, STOP, COUNTED, CENSORED, RUN = range(5)


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
    crossings = _find_crossings(angle, threshold_deg)
    entries = crossings[crossings[:, COUNTED] == 1, START]
    start, stop, censored = _merge_and_drop(crossings, angle.rate_hz)
    return Stays(
        angle.start_us + np.rint(entries * (MICROSECONDS / angle.rate_hz)).astype(np.int64),
        angle.start_us / MICROSECONDS + start / angle.rate_hz,
        (stop - start) / angle.rate_hz,
        censored,
    )


def _find_crossings(angle: MetricAngle, threshold_deg: float) -> IntArray:
    enter_deg, leave_deg = threshold_deg + HALF_HYSTERESIS_DEG, threshold_deg - HALF_HYSTERESIS_DEG
    stays = np.empty((USUAL_STAYS, 5), np.int64)
    count = scan_stays(angle.elevation_deg, angle.valid, enter_deg, leave_deg, stays)
    if count > len(stays):
        stays = np.empty((count, 5), np.int64)
        scan_stays(angle.elevation_deg, angle.valid, enter_deg, leave_deg, stays)
    return stays[:count]


@kernel
def scan_stays(angle_deg, valid, enter_deg, leave_deg, stays):  # type: ignore[no-untyped-def]
    """Run the trigger; write as many stays as there is room for; return how many there are.

    A stay is (first row, row after the last, counted as entry, censored, number of its valid run).
    """
    count, run, start, counted, inside = 0, 0, -1, 0, False
    for i in range(len(angle_deg) + 1):
        valid_row = i < len(angle_deg) and valid[i]
        if start >= 0 and (not valid_row or angle_deg[i] < leave_deg):
            if count < len(stays):
                stays[count, START], stays[count, STOP] = start, i
                stays[count, COUNTED], stays[count, CENSORED] = counted, 0 if valid_row else 1
                stays[count, RUN] = run
            count, start = count + 1, -1
        elif start < 0 and valid_row and angle_deg[i] > enter_deg:
            start, counted = i, 1 if inside else 0
        if inside and not valid_row:
            run += 1
        inside = valid_row
    return count


def _merge_and_drop(stays: IntArray, rate_hz: float) -> tuple[IntArray, IntArray, BoolArray]:
    """Merge stays of one valid run over gaps under 0.5 s, then drop those under 0.5 s."""
    gap = stays[1:, START] - stays[:-1, STOP]
    same_run = stays[1:, RUN] == stays[:-1, RUN]
    apart = ~(same_run & _is_under(gap, MERGED_GAP_S, rate_hz))
    first = np.concatenate([[True], apart])[: len(stays)]
    last = np.concatenate([apart, [True]])[: len(stays)]
    start, stop, censored = stays[first, START], stays[last, STOP], stays[last, CENSORED] == 1
    kept = ~_is_under(stop - start, SHORTEST_S, rate_hz)
    return start[kept], stop[kept], censored[kept]


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
    count = sum(len(segment.entry_us) for segment in stays)
    busy_percent = None if minutes is None else _share_busy(stays, minutes)
    return Entries(threshold_deg, count, count * 3600.0 / analysed_s, busy_percent)


def _share_busy(stays: list[Stays], minutes: PartHistograms) -> float | None:
    analysed_min = find_analysed_minutes(minutes)
    kept = analysed_min >= LEAST_OF_MINUTE
    if not kept.any():
        return None
    entry_us = np.concatenate([segment.entry_us for segment in stays])
    counts = np.histogram(entry_us, minutes.edges_us)[0]
    return 100.0 * float(is_busy(counts, analysed_min)[kept].mean())


def find_analysed_minutes(minutes: PartHistograms) -> Float64Array:
    """Give how much of each minute was analysed, shape (m,)."""
    return np.asarray(minutes.cell_us.sum(axis=1, dtype=np.int64) / (60 * MICROSECONDS), np.float64)


def is_busy(counts: IntArray | Float64Array, analysed_min: Float64Array) -> BoolArray:
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


# Entries and episodes once more, with the angle read a little too high or too low (EXPOSURE.md A12).


CELLS_PER_OCTAVE = 4
CELLS = 16 * CELLS_PER_OCTAVE  # from 0.5 s to 9 h
# the sums: episodes, their seconds, and the seconds of those longer than 5, 10, 30 and 60 s
STAYS, STAY_S, LONGER_S = range(3)
SUMS = LONGER_S + len(LONG_S)


class _Limits(NamedTuple):
    """What divides the rows of one segment, for the kernels.

    ``levels_deg``, rising, are the thresholds with each error. Lengths are in rows: gaps under
    ``merged_rows`` are no gaps, stays under ``shortest_rows`` no stays, and ``longer`` are the limits of
    :data:`LONG_S`.
    ``stretch_rows`` and ``block_rows`` are the first rows of each stretch and 5-minute block.
    """

    levels_deg: Float64Array
    merged_rows: float
    shortest_rows: float
    longer: Float64Array
    stretch_rows: IntArray
    block_rows: IntArray
    rate_hz: float


class _Counts(NamedTuple):
    """The arrays of :class:`ShiftedStays`, for the kernels."""

    entries: Float64Array
    sums: Float64Array
    cells: NDArray[np.int32]
    longest_s: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class ShiftedStays:
    """What was counted at each threshold and error in each part of the day, filled in place.

    ``levels_deg``, shape (t,), are the thresholds of :data:`THRESHOLDS_DEG` with each error, sorted.
    ``entries``, shape (t, s), are the entries in each stretch; ``sums``, shape (t, b, 6), the episodes of
    each 5-minute block and their seconds; ``cells``, shape (t, b, 64), the episodes by length in quarters of
    an octave; ``longest_s``, shape (t,). An episode is counted where it begins, its time where it lies.
    """

    errors_deg: Float64Array
    stretches: Stretches
    levels_deg: Float64Array
    entries: Float64Array
    sums: Float64Array
    cells: NDArray[np.int32]
    longest_s: Float64Array

    def add(self, angle: MetricAngle) -> None:
        """Count a segment."""
        limits = _Limits(
            self.levels_deg,
            MERGED_GAP_S * angle.rate_hz - 1e-3,
            SHORTEST_S * angle.rate_hz - 1e-3,
            np.array(LONG_S) * angle.rate_hz + 1e-3,
            find_part_rows(angle, self.stretches.edges_us),
            find_part_rows(angle, self.stretches.block_edges_us),
            angle.rate_hz,
        )
        counts = _Counts(self.entries, self.sums, self.cells, self.longest_s)
        state = np.full((len(self.levels_deg), 2), -1)
        scan_levels(angle.elevation_deg, angle.valid, limits, state, counts)

    def pick(self, array: Float64Array | NDArray[np.int32], threshold_deg: int) -> Float64Array:
        """Give the rows of one threshold in the order of the errors, shape (11, ...)."""
        wanted = np.searchsorted(self.levels_deg, np.round(threshold_deg - self.errors_deg, 9))
        return np.asarray(array[wanted], np.float64)

    def pick_entries(self, threshold_deg: int, group_of: IntArray) -> Float64Array:
        """Give the entries of one threshold in each group of stretches, shape (11, groups)."""
        return sum_groups(self.pick(self.entries, threshold_deg).T, group_of).T


def start_shifted_stays(errors_deg: Float64Array, stretches: Stretches) -> ShiftedStays:
    """Start with nothing counted."""
    levels_deg = np.unique([np.round(c - errors_deg, 9) for c in THRESHOLDS_DEG])
    levels, blocks = len(levels_deg), len(stretches.block_edges_us) - 1
    return ShiftedStays(
        errors_deg,
        stretches,
        levels_deg,
        np.zeros((levels, len(stretches.minute_of))),
        np.zeros((levels, blocks, SUMS)),
        np.zeros((levels, blocks, CELLS), np.int32),
        np.zeros(levels),
    )


@kernel
def scan_levels(angle_deg, valid, limits, state, counts):  # type: ignore[no-untyped-def]
    """Run the triggers of all levels; ``above`` is how many of them, from the lowest, are up.

    ``state``, shape (t, 2), holds the first row and the row after the last of each level's last stay.
    """
    levels = limits.levels_deg
    above, inside, enter, leave = 0, False, levels[0] + HALF_HYSTERESIS_DEG, -np.inf
    for i in range(len(angle_deg) + 1):
        if i == len(angle_deg) or not valid[i]:
            if inside:
                _close_all(above, i, state, limits, counts)
                above, inside = 0, False
                enter, leave = levels[0] + HALF_HYSTERESIS_DEG, -np.inf
            continue
        if angle_deg[i] > enter or angle_deg[i] < leave:
            above = _move(angle_deg[i], i, above if inside else -1, state, limits, counts)
            enter = levels[above] + HALF_HYSTERESIS_DEG if above < len(levels) else np.inf
            leave = levels[above - 1] - HALF_HYSTERESIS_DEG if above > 0 else -np.inf
        inside = True


@inner
def _move(x, row, above, state, limits, counts):  # type: ignore[no-untyped-def]
    """Let levels go up or down to the angle ``x``; at the first row of a run (``above`` -1) uncounted."""
    levels = limits.levels_deg
    counted, above = above >= 0, max(above, 0)
    while above < len(levels) and x > levels[above] + HALF_HYSTERESIS_DEG:
        if counted:
            stretch = find_part(limits.stretch_rows, row)
            counts.entries[above, stretch] += 1
        if state[above, 0] < 0 or row - state[above, 1] >= limits.merged_rows:
            _record(above, state, limits, counts)
            state[above, 0] = row
        above += 1
    while above > 0 and x < levels[above - 1] - HALF_HYSTERESIS_DEG:
        above -= 1
        state[above, 1] = row
    return above


@inner
def _close_all(above, row, state, limits, counts):  # type: ignore[no-untyped-def]
    """End all stays where a run of valid rows ends."""
    for level in range(len(state)):
        if level < above:
            state[level, 1] = row
        _record(level, state, limits, counts)


@inner
def _record(level, state, limits, counts):  # type: ignore[no-untyped-def]
    """Count a finished stay, unless it is too short, and forget it."""
    block_rows, rate_hz = limits.block_rows, limits.rate_hz
    sums, cells, longest_s = counts.sums, counts.cells, counts.longest_s
    first, rows = state[level, 0], state[level, 1] - state[level, 0]
    state[level, 0] = -1
    if first < 0 or rows < limits.shortest_rows:
        return
    seconds = rows / rate_hz
    block = add_rows(first, first + rows, 1.0 / rate_hz, block_rows, sums[level, :, STAY_S])
    sums[level, block, STAYS] += 1
    for k in range(LONGER_S, SUMS):
        if rows > limits.longer[k - LONGER_S]:
            add_rows(first, first + rows, 1.0 / rate_hz, block_rows, sums[level, :, k])
    cell = int(np.log2(max(seconds / SHORTEST_S, 1.0)) * CELLS_PER_OCTAVE)
    cells[level, block, min(cell, CELLS - 1)] += 1
    longest_s[level] = max(longest_s[level], seconds)


def name_stay_intervals(
    shifted: ShiftedStays, episodes: tuple[Episodes, ...], draws: Resampling, block_s: Float64Array
) -> dict[str, Interval]:
    """Give the intervals of repetitions and episodes; ``block_s``, shape (b,), is the analysed time.

    They cover the error of the angle and the sampling of the day; that of the longest episode the error
    alone, for the longest of other days cannot be drawn from this one.
    """
    found: dict[str, Interval | None] = {}
    length_h = float(block_s.sum()) / 3600.0
    drawn_h = draws.sum(block_s) / 3600.0
    for item in episodes:
        c = int(item.threshold_deg)
        entries = shifted.pick_entries(c, shifted.stretches.block_of)
        entries_per_h = draws.sum_with_error(entries, shifted.errors_deg) / drawn_h
        per_h = (
            draws.sum_with_error(shifted.pick(shifted.sums, c), shifted.errors_deg) / drawn_h[:, np.newaxis]
        )
        found[f"entries_above_{c}_per_h"] = find_interval(entries_per_h)
        found[f"entries_above_{c}_count"] = find_interval(entries_per_h * length_h)
        found[f"episodes_above_{c}_per_h"] = find_interval(per_h[:, STAYS])
        found[f"episodes_above_{c}_count"] = find_interval(per_h[:, STAYS] * length_h)
        found[f"episodes_above_{c}_total_s"] = find_interval(per_h[:, STAY_S] * length_h)
        for k, limit_s in enumerate(LONG_S):
            name = f"episodes_above_{c}_longer_than_{limit_s:g}_s_total_s"
            found[name] = find_interval(per_h[:, LONGER_S + k] * length_h)
        longest_s = draws.look_up(shifted.pick(shifted.longest_s, c), shifted.errors_deg)
        found[f"episodes_above_{c}_longest_s"] = find_interval(longest_s) if item.longest_s else None
        found |= _name_lengths(shifted, item, draws)
    return name_intervals(found)


def name_busy_intervals(
    shifted: ShiftedStays, minutes: PartHistograms, draws: Resampling
) -> dict[str, Interval]:
    """Give the intervals of the share of minutes with two entries or more."""
    analysed_min = find_analysed_minutes(minutes)
    kept = analysed_min >= LEAST_OF_MINUTE
    block_of = np.arange(len(kept)) // BLOCK_MINUTES
    found: dict[str, Interval | None] = {}
    drawn_minutes = draws.sum(sum_groups(kept.astype(np.float64), block_of))
    for c in THRESHOLDS_DEG:
        busy = is_busy(shifted.pick_entries(c, shifted.stretches.minute_of), analysed_min) & kept
        by_block = sum_groups(busy.T.astype(np.float64), block_of).T
        drawn = draws.sum_with_error(by_block, shifted.errors_deg)
        with np.errstate(invalid="ignore"):  # a draw without a minute that counts
            found[f"entries_above_{c}_busy_minutes_percent"] = find_interval(100.0 * drawn / drawn_minutes)
    return name_intervals(found)


def _name_lengths(shifted: ShiftedStays, item: Episodes, draws: Resampling) -> dict[str, Interval | None]:
    c = int(item.threshold_deg)
    cells = shifted.pick(shifted.cells, c)
    drawn_s = _find_lengths(draws.sum_with_error(cells, shifted.errors_deg))
    coarse_s = _find_lengths(cells[len(cells) // 2].sum(axis=0)[np.newaxis])[0]
    return {
        f"episodes_above_{c}_median_s": scale_interval(item.median_s, drawn_s[:, 0], coarse_s[0]),
        f"episodes_above_{c}_p90_s": scale_interval(item.p90_s, drawn_s[:, 1], coarse_s[1]),
    }


def _find_lengths(cells: Float64Array) -> Float64Array:
    """Give median and P90 of lengths from their cells, shape (k, 64): shape (k, 2), NaN without any."""
    places = find_percentile_cells(cells, np.array([50.0, 90.0]))
    return np.asarray(SHORTEST_S * 2.0 ** (places / CELLS_PER_OCTAVE))
