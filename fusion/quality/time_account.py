"""Where the recording's time went (CONTRACT.md §5 "Time")."""

import math
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import TooShort
from fusion.exposure.rows import (
    find_end_us,
    find_touched_rows,
    find_valid_samples,
    list_touched_rows,
)
from fusion.numba_kernels import kernel
from fusion.numerics.runs import find_runs
from fusion.orientation.angle_rows import AngleRows, lay_rows
from fusion.pose.calibrate import Calibration
from fusion.pose.windows import Blocks, reduce_recording
from fusion.quality.pose_flags import flag_window
from fusion.quality.types import TimeAccount, TimePart
from fusion.recording import (
    MICROSECONDS,
    IntArray,
    QualityFlag,
    Recording,
    Segment,
    Span,
    find_missing,
    flag_spans,
)
from fusion.sensor.self_calibration import find_limits
from fusion.still_limits import OFF_THE_ARM

# Where a sensor was driven to the end of its range (RELIABILITY.md 88).


MARGIN_S = 0.1

FloatMatrix = NDArray[np.float32]


def find_clipped(recording: Recording, blocks: Blocks) -> list[Span]:
    """Find the stretches with a clipped sample (:func:`fusion.sensor.self_calibration.find_limits`).

    They are widened by 100 ms (in whole rows) on each side.
    """
    pairs = [pair for pair in zip(recording.segments, blocks, strict=True) if len(pair[0])]
    segments, parts = [segment for segment, _ in pairs], [part for _, part in pairs]
    sizes = find_limits(segments, parts, recording.acc_range_g, recording.gyr_range_dps)
    acc_limits, gyr_limits = ((np.array([[-1.0], [1.0]]) * size).astype(np.float32) for size in sizes)
    spans: list[Span] = []
    for segment, part in pairs:
        acc_rows = _list_outside(segment.acc_g, part.acc_ends, part.rows_per_block, acc_limits)
        gyr_rows = _list_outside(segment.gyr_dps, part.gyr_ends, part.rows_per_block, gyr_limits)
        spans += _widen(segment, np.union1d(acc_rows, gyr_rows))
    return spans


def _list_outside(
    samples: FloatMatrix, ends: NDArray[np.float64], rows_per_block: int, limits: FloatMatrix
) -> NDArray[np.intp]:
    """List the rows with an axis at or past a limit; only the blocks that get there are looked at."""
    blocks = np.flatnonzero(((limits[0] >= ends[:3].T) | (limits[1] <= ends[3:].T)).any(axis=1))
    rows = (blocks[:, None] * rows_per_block + np.arange(rows_per_block)).ravel()
    rows = rows[rows < len(samples)]
    samples = samples[rows]
    is_outside = (samples <= limits[0]) | (samples >= limits[1])
    return np.asarray(rows[is_outside.any(axis=1)])


def _widen(segment: Segment, clipped: NDArray[np.intp]) -> list[Span]:
    if len(clipped) == 0:
        return []
    marked = np.zeros(len(segment), np.bool_)
    marked[clipped] = True
    margin_rows = math.ceil(MARGIN_S * segment.rate_hz)  # whole rows, so that no part of a row is left over
    margin = np.array([-margin_rows, margin_rows])
    rows: IntArray = np.clip(find_runs(marked) + margin, 0, len(segment))
    times_us = segment.start_us + np.rint(rows * (MICROSECONDS / segment.rate_hz)).astype(np.int64)
    return [Span(start_us, end_us - start_us, "clipped") for start_us, end_us in times_us.tolist()]


# What is left out of the analysis, and why (CONTRACT.md §5 "Time").


SHORTEST_SEGMENT_US = MICROSECONDS
SHORTEST_RECORDING_US = 10 * MICROSECONDS
READY_ANGLES = "angles"


def find_exclusions(recording: Recording, blocks: Blocks | None = None) -> tuple[Span, ...]:
    """Find what is left out: docked or asleep, segments under 1 s, clipped samples with 100 ms on each side.

    The spans are disjoint, in time order and inside the recording; where reasons overlap, the first of this
    list is given. They begin and end with rows of the angle, so that no part of a row is left over. A ready
    angle series has no samples, hence only what its file says. ``blocks``: the recording reduced, where the
    caller has it already.
    """
    if not recording.holds_samples:
        return make_disjoint(recording.excluded, recording.duration_us)
    short = [
        Span(segment.start_us, segment.duration_us, "short-segment")
        for segment in recording.segments
        if segment.duration_us < SHORTEST_SEGMENT_US
    ]
    clipped = find_clipped(recording, blocks or reduce_recording(recording))
    spans = [*clipped, *short, *recording.excluded]
    return make_disjoint(_widen_to_rows(spans, recording), recording.duration_us)


def _widen_to_rows(spans: list[Span], recording: Recording) -> list[Span]:
    """Let spans begin and end with a row of the angle where several samples make a row."""
    runs = [rows for rows in map(lay_rows, recording.segments) if rows.per_row > 1]
    return [_widen_span(span, runs) for span in spans] if runs else spans


def _widen_span(span: Span, runs: Sequence[AngleRows]) -> Span:
    start_us, end_us = span.start_us, span.end_us
    for edge_us in (start_us, end_us):
        place = bisect_right(runs, edge_us, key=lambda run: run.start_us) - 1
        if place >= 0 and edge_us < find_end_us(runs[place]):
            run = runs[place]
            touched = find_touched_rows(run, span.start_us, span.end_us)
            bounds = np.rint(run.start_us + np.array([touched.start, touched.stop]) * run.period_us)
            start_us, end_us = min(start_us, int(bounds[0])), max(end_us, int(bounds[1]))
    return replace(span, start_us=start_us, duration_us=end_us - start_us)


def refuse_short(recording: Recording) -> None:
    """Refuse what cannot hold the 10 s that an analysis needs, before anything is looked for in it.

    Raises
    ------
    TooShort
    """
    present_us = sum(segment.duration_us for segment in recording.segments)
    if present_us < SHORTEST_RECORDING_US and recording.device not in (READY_ANGLES, "mvn"):
        raise TooShort(s=round(present_us / MICROSECONDS, 3), **_find_cause(recording.flags))


def make_disjoint(spans: Iterable[Span], duration_us: int) -> tuple[Span, ...]:
    """Cut spans so that none overlap, the later in the list winning, and join equal neighbours."""
    kept = [span for span in spans if span.start_us < duration_us and span.end_us > 0]
    bounds = [(max(span.start_us, 0), min(span.end_us, duration_us)) for span in kept]
    edges = np.unique(np.array(bounds, np.int64))
    owners = np.full(max(len(edges) - 1, 0), -1)
    for k, (start_us, end_us) in enumerate(bounds):
        owners[np.searchsorted(edges, start_us) : np.searchsorted(edges, end_us)] = k
    reasons = [kept[owner].reason if owner >= 0 else None for owner in owners]
    pieces = zip(edges[:-1].tolist(), edges[1:].tolist(), reasons, strict=True)
    return tuple(_join_equal(pieces))


def _join_equal(pieces: Iterable[tuple[int, int, str | None]]) -> Iterable[Span]:
    for reason, group in groupby(pieces, key=lambda piece: piece[2]):
        run = list(group)
        if reason is not None and run[-1][1] > run[0][0]:
            yield Span(run[0][0], run[-1][1] - run[0][0], reason)


def leave_out(elevation: Elevation, exclusions: tuple[Span, ...]) -> Elevation:
    """Mark the rows that the exclusions, apart and in time order, touch as not valid; the angle is shared."""
    if not exclusions:
        return elevation
    segments = tuple(_leave_out(segment, exclusions) for segment in elevation.segments)
    return replace(elevation, segments=segments)


def _leave_out(segment: ElevationSegment, exclusions: tuple[Span, ...]) -> ElevationSegment:
    touched = list_touched_rows(segment, exclusions)
    if not touched:
        return segment
    valid = segment.valid.copy()
    for rows in touched:
        valid[rows] = False
    return replace(segment, valid=valid)


# Where samples were recorded but the fusion did not trust their direction.


def flag_untrusted(
    recording: Recording, elevation: Elevation, exclusions: Sequence[Span]
) -> tuple[QualityFlag, ...]:
    """Flag, with their times, the stretches that count as missing though samples are there.

    ``elevation`` is that of the recording, segment by segment. Rows put in over a hole of up to 50 ms are a
    part of that hole, and what is excluded is not missing. Less than a second in all is not flagged.
    """
    bridged = {segment.start_us: _list_bridged_rows(segment) for segment in recording.segments}
    spans: list[Span] = []
    for segment in elevation.segments:
        doubted = ~segment.valid
        for rows in (*bridged.get(segment.start_us, ()), *list_touched_rows(segment, exclusions)):
            doubted[rows] = False
        times_us = segment.start_us + np.rint(find_runs(doubted) * (MICROSECONDS / segment.rate_hz))
        spans += [Span(int(a), int(b - a), "untrusted") for a, b in times_us]
    if sum(span.duration_us for span in spans) < MICROSECONDS:
        return ()
    return flag_spans(Caveat.UNTRUSTED, spans)


def _list_bridged_rows(segment: Segment) -> list[slice]:
    """Give the rows of the angle with a sample that was put in over a hole."""
    rows = lay_rows(segment)
    return [rows.hold(first, stop) for first, stop in segment.bridged]


def flag_untrusted_pose(calibration: Calibration, elevation: Elevation) -> tuple[QualityFlag, ...]:
    """Flag a calibration window of which at most half is trusted: all angles rest on it (W-POSE-DOUBT)."""
    return tuple(
        flag_window(Caveat.POSE_DOUBT, still)
        for still in calibration.windows
        if 2.0 * _trust(elevation, still.start_s, still.end_s) <= 1.0
    )


def _trust(elevation: Elevation, first_s: float, end_s: float) -> float:
    """Share of the rows between two times that are valid; 1 where there is none."""
    valid = []
    for segment in elevation.segments:
        from_start = (MICROSECONDS * np.array([first_s, end_s]) - segment.start_us) / segment.period_us
        first, stop = np.clip(np.rint(from_start), 0, len(segment)).astype(np.int64)
        valid.append(segment.valid[first:stop])
    rows = np.concatenate(valid)
    return float(rows.mean()) if len(rows) else 1.0


Account = Literal["analysed", "excluded", "missing"]

SHORTEST_ANALYSED_US = 10 * MICROSECONDS
WITHOUT_MINIMUM = (READY_ANGLES, "mvn")
SAID_BY_A_PERSON = frozenset({"break", "not-worn", "outside", "seated", "supported", "task", "work", "shift"})


CAUSES = {Caveat.RESOLUTION: "resolution", Caveat.ACC_DRIFT: "drift"}
"""Of time that is lost in a way that does not show them."""


def account_time(
    recording: Recording,
    elevation: Elevation,
    exclusions: tuple[Span, ...],
    flags: tuple[QualityFlag, ...] = (),
) -> TimeAccount:
    """Account for every microsecond: analysed are the valid rows, missing is what nothing explains.

    A segment's rows last its fitted period, so sums and stamps can differ by a microsecond for each segment
    and each exclusion; such a difference goes to the excluded time, and is not called missing. ``flags``:
    further caveats, which may hold the cause if too little time is left.

    Raises
    ------
    TooShort
        When less than 10 s are analysed (ready angles: when nothing is).
    """
    analysed_us = sum(
        round(_count_analysed(segment) * MICROSECONDS / segment.rate_hz) for segment in elevation.segments
    )
    least_us = 1 if recording.device in WITHOUT_MINIMUM else SHORTEST_ANALYSED_US
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
    """Count the time without samples that no exclusion explains, with what falls with its row."""
    holes = find_missing(recording.segments, recording.duration_us, exclusions)
    return sum(hole.duration_us for hole in holes) + count_beside_us(recording, exclusions)


def count_beside_us(recording: Recording, exclusions: tuple[Span, ...]) -> int:
    """Count the time of samples beside a bridged hole, which fall with the row that they share with it.

    None where each sample is a row, as `inspect` counts before an analysis.
    """
    coarse = (segment for segment in recording.segments if lay_rows(segment).per_row > 1)
    return sum(_count_beside_us(segment, exclusions) for segment in coarse if segment.bridged)


def _count_beside_us(segment: Segment, exclusions: tuple[Span, ...]) -> int:
    rows, bridged = lay_rows(segment), np.zeros(len(segment), np.bool_)
    fallen, counted = np.zeros(len(rows), np.bool_), np.ones(len(rows), np.bool_)
    for left_out in list_touched_rows(rows, exclusions):
        counted[left_out] = False
    for first, stop in segment.bridged:
        bridged[first:stop], fallen[rows.hold(first, stop)] = True, True
    fallen &= counted
    bridged &= find_valid_samples(counted, len(segment))
    bridged_us = np.count_nonzero(bridged) * MICROSECONDS / segment.rate_hz
    return round(np.count_nonzero(fallen) * rows.period_us - bridged_us)


def divide_time(
    time: TimeAccount, analysed_us: Mapping[str, int], exclusions: tuple[Span, ...], holes_us: int
) -> TimeAccount:
    """Divide the time into parts: analysed time by kind of period, excluded time by its reason.

    ``analysed_us`` is the analysed time of each kind and adds up to all of it; what rounding leaves over (a
    microsecond for each segment) goes to the largest part of its account. Of the missing time ``holes_us``
    is without samples; the rest, from a second on, was recorded and is not trusted.
    """
    untrusted_us = time.missing_us - holes_us if time.missing_us >= holes_us + MICROSECONDS else 0
    missing_us = {"missing": time.missing_us - untrusted_us}
    if untrusted_us:
        missing_us["untrusted"] = untrusted_us
    excluded_us: dict[str, int] = {}
    for span in exclusions:
        excluded_us[span.reason] = excluded_us.get(span.reason, 0) + span.duration_us
    parts = (
        *_build_parts("analysed", analysed_us, time.analysed_us),
        *_build_parts("excluded", excluded_us, time.excluded_us),
        *_build_parts("missing", missing_us, time.missing_us),
    )
    return replace(time, parts=parts)


def _build_parts(account: Account, lengths_us: Mapping[str, int], whole_us: int) -> Iterable[TimePart]:
    rest_us = whole_us - sum(lengths_us.values())
    largest = max(lengths_us, key=lambda name: lengths_us[name], default="")
    for name, length_us in lengths_us.items():
        told_us = length_us + (rest_us if name == largest else 0)
        if told_us:
            yield TimePart(account, name, told_us)


def _find_cause(flags: Iterable[QualityFlag]) -> dict[str, str]:
    """The cure for a sensor that loses time: its resolution, or its accelerometer's drift."""
    found = [CAUSES[Caveat(flag.code)] for flag in flags if flag.code in CAUSES]
    return {"cure": found[0]} if found else {}


def _describe_largest(exclusions: tuple[Span, ...], left_out_us: int = 0) -> dict[str, str | float]:
    """Describe the largest exclusion: reason, duration, and the cure if a person can undo it.

    ``left_out_us``: of the samples; what no exclusion explains was not trusted.
    """
    lengths_us: dict[str, int] = {}
    for span in exclusions:
        lengths_us[span.reason] = lengths_us.get(span.reason, 0) + span.duration_us
    untrusted_us = left_out_us - sum(lengths_us.values())
    if untrusted_us >= MICROSECONDS:
        lengths_us["untrusted"] = untrusted_us
    if not lengths_us:
        return {}
    largest = max(lengths_us, key=lambda reason: lengths_us[reason])
    told: dict[str, str | float] = {"left_out": largest, "left_out_s": lengths_us[largest] / MICROSECONDS}
    if largest in SAID_BY_A_PERSON:
        told["cure"] = "left out"
    return told


def _count_analysed(segment: ElevationSegment) -> int:
    return int(np.count_nonzero(segment.valid & np.isfinite(segment.elevation_deg)))


# Where the sensor may have lain on a desk: proposed to the person, never applied (EXPOSURE.md A15).


SHORTEST_S = 600.0


def propose_nonwear(recording: Recording, left_out: tuple[Span, ...] = ()) -> tuple[Span, ...]:
    """Give the stretches in which the sensor may not have been worn.

    ``left_out`` are stretches that are not analysed anyway; a proposal that lies wholly in them is dropped.
    """
    found = (span for segment in recording.segments for span in _find_still(segment))
    return tuple(span for span in found if not _is_covered(span, left_out))


def _is_covered(span: Span, left_out: tuple[Span, ...]) -> bool:
    """Whether less than the shortest proposal is left of a stretch."""
    shared_us = (min(span.end_us, other.end_us) - max(span.start_us, other.start_us) for other in left_out)
    left_us = span.duration_us - sum(max(us, 0) for us in shared_us)
    return left_us < SHORTEST_S * MICROSECONDS


def _find_still(segment: Segment) -> list[Span]:
    rows = round(OFF_THE_ARM.window_s * segment.rate_hz)
    windows = len(segment) // max(rows, 1)
    if windows * OFF_THE_ARM.window_s < SHORTEST_S:
        return []
    still = np.zeros(windows, np.bool_)
    mark_still(segment.acc_g, rows, OFF_THE_ARM.acc_sd_g, still)
    runs = find_runs(still)
    long_enough = runs[(runs[:, 1] - runs[:, 0]) * rows >= SHORTEST_S * segment.rate_hz - 1e-3 * rows]
    times_us = segment.start_us + np.rint(long_enough * (rows * MICROSECONDS / segment.rate_hz))
    return [Span(int(a), int(b - a), "not-worn") for a, b in times_us]


@kernel
def mark_still(acc_g: Any, rows: int, still_g: float, still: Any) -> None:  # pragma: no cover
    """Mark the windows of ``rows`` rows in which every axis' standard deviation is under ``still_g``."""
    for k in range(len(still)):
        still[k] = True
        for axis in range(3):
            first = acc_g[k * rows, axis]
            total, squares = 0.0, 0.0
            for i in range(k * rows, (k + 1) * rows):
                value = acc_g[i, axis] - first  # about a value of the window, so that nothing cancels
                total += value
                squares += value * value
            if squares / rows - (total / rows) ** 2 >= still_g * still_g:
                still[k] = False
                break
