"""Repetitions and sustained stays above a threshold (EXPOSURE.md A4 and A5, CONTRACT.md §5).

Both come from one Schmitt trigger with 10 deg of hysteresis: above once the angle passes c + 5, below once it
passes c - 5. A run of valid rows that starts above c + 5 starts "above": a stay, but no repetition.
"""

from dataclasses import dataclass

import numpy as np

from fusion.exposure.bins import PartHistograms
from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.types import Entries, Episodes
from fusion.numba_kernels import njit
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


@njit(cache=True, nogil=True)
def scan_stays(angle_deg, valid, enter_deg, leave_deg, stays):  # type: ignore[no-untyped-def]
    """Run the trigger; write as many stays as there is room for; return how many there are.

    A stay is (first row, row after the last, counted as entry, censored, number of its valid run).
    """
    count, run, start, counted, inside = 0, 0, -1, 0, False
    for i in range(len(angle_deg) + 1):
        valid_row = i < len(angle_deg) and valid[i]
        if start >= 0 and (not valid_row or angle_deg[i] < leave_deg):
            if count < len(stays):
                stays[count] = (start, i, counted, 0 if valid_row else 1, run)
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
    """Find the minutes with two entries or more per minute of analysed time; the last axis is minutes."""
    return np.asarray(counts >= BUSY_PER_MINUTE * analysed_min - 1e-9)


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
