"""Account for the time of a recording."""

import math
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.elevation import AngleRows, Elevation, group_rows
from acromion.fusion.errors import TooShort
from acromion.fusion.numba_kernels import kernel
from acromion.fusion.pose.calibrate import Blocks, reduce_recording
from acromion.fusion.quality import TimeAccount, TimePart
from acromion.fusion.recording import (
    MICROSECONDS,
    IntArray,
    QualityFlag,
    Recording,
    Segment,
    Span,
    find_missing,
)
from acromion.fusion.runs import (
    find_end_us,
    find_runs,
    find_touched_rows,
    find_valid_samples,
    list_touched_rows,
)
from acromion.fusion.sensor.self_calibration import find_limits
from acromion.fusion.still_limits import OFF_THE_ARM

# Where a sensor reached the end of its range.


MARGIN_S = 0.1

FloatMatrix = NDArray[np.float32]


def _find_clipped(recording: Recording, blocks: Blocks) -> list[Span]:
    """Return the stretches with a clipped sample, widened by 100 ms (in whole rows) on each side.

    Limits: :func:`acromion.fusion.sensor.self_calibration.find_limits`.
    """
    pairs = [pair for pair in zip(recording.segments, blocks, strict=True) if len(pair[0])]
    segments, parts = [segment for segment, _ in pairs], [part for _, part in pairs]
    sizes = find_limits(segments, parts, recording.acc_range_g, recording.gyr_range_dps)
    acc_limits, gyr_limits = ((np.array([[-1.0], [1.0]]) * size).astype(np.float32) for size in sizes)
    spans: list[Span] = []
    for segment, part in pairs:
        acc_rows = _list_outside(segment.acc_g, part.acc_ends, part.rows_per_block, acc_limits)
        gyr_rows = _list_outside(segment.gyr_dps, part.gyr_ends, part.rows_per_block, gyr_limits)
        if len(acc_rows) + len(gyr_rows) == 0:
            continue
        marked = np.zeros(len(segment), np.bool_)
        marked[acc_rows] = marked[gyr_rows] = True
        margin_rows = math.ceil(MARGIN_S * segment.rate_hz)  # whole rows, so that no partial row remains
        margin = np.array([-margin_rows, margin_rows])
        rows: IntArray = np.clip(find_runs(marked) + margin, 0, len(segment))
        times_us = segment.start_us + np.rint(rows * (MICROSECONDS / segment.rate_hz)).astype(np.int64)
        spans += [Span(start_us, end_us - start_us, "clipped") for start_us, end_us in times_us.tolist()]
    return spans


def _list_outside(
    samples: FloatMatrix, ends: NDArray[np.float64], rows_per_block: int, limits: FloatMatrix
) -> NDArray[np.intp]:
    """Return the rows with an axis at or past a limit; only examine the blocks that reach it."""
    blocks = np.flatnonzero(((limits[0] >= ends[:3].T) | (limits[1] <= ends[3:].T)).any(axis=1))
    rows = (blocks[:, None] * rows_per_block + np.arange(rows_per_block)).ravel()
    rows = rows[rows < len(samples)]
    samples = samples[rows]
    is_outside = (samples <= limits[0]) | (samples >= limits[1])
    return np.asarray(rows[is_outside.any(axis=1)])


# Time excluded from the analysis, and the reasons.


SHORTEST_SEGMENT_US = MICROSECONDS
SHORTEST_RECORDING_US = 10 * MICROSECONDS
WITHOUT_MINIMUM = ("angles", "mvn")
"""Devices of precomputed angles, which can be analysed at any length."""


def find_exclusions(recording: Recording, blocks: Blocks | None = None) -> tuple[Span, ...]:
    """Return the excluded time: docked or asleep, segments under 1 s, clipped samples with 100 ms margins.

    The spans are disjoint, in time order and within the recording; if reasons overlap, the first of this list
    is used. They start and end with rows of the angle, so that no partial row remains. An angle series
    has no samples, so only the exclusions of its file apply. ``blocks``: the reduced recording, if the caller
    has it already.
    """
    if not recording.holds_samples:
        return make_disjoint(recording.excluded, recording.duration_us)
    short = [
        Span(segment.start_us, segment.duration_us, "short-segment")
        for segment in recording.segments
        if segment.duration_us < SHORTEST_SEGMENT_US
    ]
    clipped = _find_clipped(recording, blocks or reduce_recording(recording))
    spans = [*clipped, *short, *recording.excluded]
    coarse = [rows for rows in map(group_rows, recording.segments) if rows.per_row > 1]
    if coarse:
        spans = [_widen_to_rows(span, coarse) for span in spans]
    return make_disjoint(spans, recording.duration_us)


def _widen_to_rows(span: Span, runs: Sequence[AngleRows]) -> Span:
    """Widen a span to whole rows of the angle, if a row has several samples."""
    start_us, end_us = span.start_us, span.end_us
    for edge_us in (start_us, end_us):
        place = bisect_right(runs, edge_us, key=lambda run: run.start_us) - 1
        if place >= 0 and edge_us < find_end_us(runs[place]):
            run = runs[place]
            touched = find_touched_rows(run, span.start_us, span.end_us)
            bounds = np.rint(run.start_us + np.array([touched.start, touched.stop]) * run.period_us)
            start_us, end_us = min(start_us, int(bounds[0])), max(end_us, int(bounds[1]))
    return replace(span, start_us=start_us, duration_us=end_us - start_us)


def check_minimum_duration(recording: Recording) -> None:
    """Check that the recording can contain the 10 s that an analysis needs, before anything else.

    Raises TooShort.
    """
    present_us = sum(segment.duration_us for segment in recording.segments)
    if present_us < SHORTEST_RECORDING_US and recording.device not in WITHOUT_MINIMUM:
        raise TooShort(s=round(present_us / MICROSECONDS, 3), **_find_cause(recording.flags))


def make_disjoint(spans: Iterable[Span], duration_us: int) -> tuple[Span, ...]:
    """Cut spans until none overlap, and join equal neighbours; later spans take precedence."""
    kept = [span for span in spans if span.start_us < duration_us and span.end_us > 0]
    bounds = [(max(span.start_us, 0), min(span.end_us, duration_us)) for span in kept]
    edges = np.unique(np.array(bounds, np.int64))
    owners = np.full(max(len(edges) - 1, 0), -1)
    for k, (start_us, end_us) in enumerate(bounds):
        owners[np.searchsorted(edges, start_us) : np.searchsorted(edges, end_us)] = k
    reasons = [kept[owner].reason if owner >= 0 else None for owner in owners]
    joined = []
    for reason, group in groupby(range(len(reasons)), key=lambda k: reasons[k]):
        pieces = list(group)
        start_us, end_us = int(edges[pieces[0]]), int(edges[pieces[-1] + 1])
        if reason is not None and end_us > start_us:
            joined.append(Span(start_us, end_us - start_us, reason))
    return tuple(joined)


def leave_out(elevation: Elevation, exclusions: tuple[Span, ...]) -> Elevation:
    """Mark the rows that the exclusions overlap as not valid; the angle array is shared.

    The exclusions are sorted and do not overlap.
    """
    if not exclusions:
        return elevation
    segments = []
    for segment in elevation.segments:
        touched = list_touched_rows(segment, exclusions)
        valid = segment.valid.copy() if touched else segment.valid
        for rows in touched:
            valid[rows] = False
        segments.append(replace(segment, valid=valid))
    return replace(elevation, segments=tuple(segments))


Account = Literal["analysed", "excluded", "missing"]

STATED_REASONS = frozenset(
    {"break", "not-worn", "outside", "seated", "upright", "supported", "task", "work", "shift"}
)


CAUSES = {Caveat.RESOLUTION: "resolution", Caveat.ACC_DRIFT: "drift"}
"""Remedies for time that is lost without a visible reason."""


def account_time(
    recording: Recording,
    elevation: Elevation,
    exclusions: tuple[Span, ...],
    flags: tuple[QualityFlag, ...] = (),
) -> TimeAccount:
    """Account for every microsecond: analysed time is the valid rows, missing time is unexplained.

    A segment's rows last its fitted period, so sums and timestamps can differ by a microsecond for each
    segment and each exclusion. Such a difference counts as excluded, not missing. ``flags``: more caveats,
    which may explain why too little time is left.

    Raises TooShort: less than 10 s are analysed (precomputed angles: nothing is).
    """
    analysed_us = sum(
        round(
            int(np.count_nonzero(segment.valid & np.isfinite(segment.elevation_deg)))
            * MICROSECONDS
            / segment.rate_hz
        )
        for segment in elevation.segments
    )
    least_us = 1 if recording.device in WITHOUT_MINIMUM else SHORTEST_RECORDING_US
    if analysed_us < least_us:
        present_us = sum(segment.duration_us for segment in recording.segments)
        largest = _describe_largest(exclusions, present_us - analysed_us)
        cause = _find_cause((*recording.flags, *flags)) if "cure" not in largest else {}
        raise TooShort(s=analysed_us / MICROSECONDS, **largest, **cause)
    recorded_us = max(recording.duration_us, analysed_us)
    excluded_us = min(sum(span.duration_us for span in exclusions), recorded_us - analysed_us)
    missing_us = recorded_us - analysed_us - excluded_us
    if exclusions and missing_us <= len(exclusions) + len(elevation.segments):
        missing_us, excluded_us = 0, excluded_us + missing_us
    return TimeAccount(recorded_us, analysed_us, missing_us, excluded_us)


def count_holes_us(recording: Recording, exclusions: tuple[Span, ...]) -> int:
    """Return the time without samples that no exclusion explains, plus samples that share a row with it."""
    holes = find_missing(recording.segments, recording.duration_us, exclusions)
    return sum(hole.duration_us for hole in holes) + count_partial_rows_us(recording, exclusions)


def count_partial_rows_us(recording: Recording, exclusions: tuple[Span, ...]) -> int:
    """Return the time of the samples in rows that a bridged gap touches; such rows are not valid.

    Zero if each sample is a row, as when `inspect` counts before an analysis.
    """
    beside_us = 0
    for segment in recording.segments:
        rows = group_rows(segment)
        if rows.per_row == 1 or not segment.bridged:
            continue
        bridged, fallen = np.zeros(len(segment), np.bool_), np.zeros(len(rows), np.bool_)
        counted = np.ones(len(rows), np.bool_)
        for left_out in list_touched_rows(rows, exclusions):
            counted[left_out] = False
        for first, stop in segment.bridged:
            bridged[first:stop], fallen[rows.hold(first, stop)] = True, True
        fallen &= counted
        bridged &= find_valid_samples(counted, len(segment))
        bridged_us = np.count_nonzero(bridged) * MICROSECONDS / segment.rate_hz
        beside_us += round(np.count_nonzero(fallen) * rows.period_us - bridged_us)
    return beside_us


def divide_time(
    time: TimeAccount, analysed_us: Mapping[str, int], exclusions: tuple[Span, ...], holes_us: int
) -> TimeAccount:
    """Divide the time into parts: analysed time by kind of period, excluded time by its reason.

    ``analysed_us``: the analysed time of each kind; it adds up to the total. Rounding differences (a
    microsecond per segment) go to the largest part of their sum. ``holes_us`` of the missing time have no
    samples; the rest, if at least a second, was recorded but is not trusted.
    """
    untrusted_us = time.missing_us - holes_us if time.missing_us >= holes_us + MICROSECONDS else 0
    missing_us = {"missing": time.missing_us - untrusted_us}
    if untrusted_us:
        missing_us["untrusted"] = untrusted_us
    parts = (
        *_build_parts("analysed", analysed_us, time.analysed_us),
        *_build_parts("excluded", _sum_by_reason(exclusions), time.excluded_us),
        *_build_parts("missing", missing_us, time.missing_us),
    )
    return replace(time, parts=parts)


def _sum_by_reason(exclusions: Iterable[Span]) -> dict[str, int]:
    lengths_us: dict[str, int] = {}
    for span in exclusions:
        lengths_us[span.reason] = lengths_us.get(span.reason, 0) + span.duration_us
    return lengths_us


def _build_parts(account: Account, lengths_us: Mapping[str, int], whole_us: int) -> Iterable[TimePart]:
    rest_us = whole_us - sum(lengths_us.values())
    largest = max(lengths_us, key=lambda name: lengths_us[name], default="")
    for name, length_us in lengths_us.items():
        told_us = length_us + (rest_us if name == largest else 0)
        if told_us:
            yield TimePart(account, name, told_us)


def _find_cause(flags: Iterable[QualityFlag]) -> dict[str, str]:
    """Return the remedy for a sensor that loses time: its resolution, or its accelerometer's drift."""
    found = [CAUSES[Caveat(flag.code)] for flag in flags if flag.code in CAUSES]
    return {"cure": found[0]} if found else {}


def _describe_largest(exclusions: tuple[Span, ...], left_out_us: int = 0) -> dict[str, str | float]:
    """Describe the largest exclusion: reason, duration, and the remedy if a person can undo it.

    ``left_out_us``: excluded time of the samples; any further lost time was not trusted.
    """
    lengths_us = _sum_by_reason(exclusions)
    untrusted_us = left_out_us - sum(lengths_us.values())
    if untrusted_us >= MICROSECONDS:
        lengths_us["untrusted"] = untrusted_us
    if not lengths_us:
        return {}
    largest = max(lengths_us, key=lambda reason: lengths_us[reason])
    facts: dict[str, str | float] = {"left_out": largest, "left_out_s": lengths_us[largest] / MICROSECONDS}
    if largest in STATED_REASONS:
        facts["cure"] = "left out"
    return facts


# Time when the sensor may have been on a desk: proposed to the person, never applied.


SHORTEST_S = 600.0


def propose_nonwear(recording: Recording, left_out: tuple[Span, ...] = ()) -> tuple[Span, ...]:
    """Return the stretches in which the sensor may not have been worn.

    ``left_out``: stretches that are excluded anyway; a proposal is dropped if too little of it is outside
    them.
    """
    kept = []
    for span in (span for segment in recording.segments for span in _find_still(segment)):
        shared_us = (min(span.end_us, out.end_us) - max(span.start_us, out.start_us) for out in left_out)
        if span.duration_us - sum(max(us, 0) for us in shared_us) >= SHORTEST_S * MICROSECONDS:
            kept.append(span)
    return tuple(kept)


def _find_still(segment: Segment) -> list[Span]:
    rows = round(OFF_THE_ARM.window_s * segment.rate_hz)
    windows = len(segment) // max(rows, 1)
    if windows * OFF_THE_ARM.window_s < SHORTEST_S:
        return []
    still = np.zeros(windows, np.bool_)
    _mark_still(segment.acc_g, rows, OFF_THE_ARM.acc_sd_g, still)
    runs = find_runs(still)
    long_enough = runs[(runs[:, 1] - runs[:, 0]) * rows >= SHORTEST_S * segment.rate_hz - 1e-3 * rows]
    times_us = segment.start_us + np.rint(long_enough * (rows * MICROSECONDS / segment.rate_hz))
    return [Span(int(a), int(b - a), "not-worn") for a, b in times_us]


@kernel
def _mark_still(acc_g: Any, rows: int, still_g: float, still: Any) -> None:  # pragma: no cover
    """Mark the windows of ``rows`` rows in which every axis has a standard deviation under ``still_g``."""
    for k in range(len(still)):
        still[k] = True
        for axis in range(3):
            first = acc_g[k * rows, axis]
            total, squares = 0.0, 0.0
            for i in range(k * rows, (k + 1) * rows):
                value = acc_g[i, axis] - first  # relative to a value of the window, to avoid cancellation
                total += value
                squares += value * value
            if squares / rows - (total / rows) ** 2 >= still_g * still_g:
                still[k] = False
                break
