"""What is left out of the analysis, and why (CONTRACT.md §5 "Time")."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import groupby

import numpy as np

from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import TooShort
from fusion.exposure.rows import list_touched_rows
from fusion.quality.clipping import find_clipped
from fusion.recording import MICROSECONDS, Recording, Span

SHORTEST_SEGMENT_US = MICROSECONDS
SHORTEST_RECORDING_US = 10 * MICROSECONDS
READY_ANGLES = "angles"


def find_exclusions(recording: Recording) -> tuple[Span, ...]:
    """Find what is left out: docked or asleep, segments under 1 s, clipped samples with 100 ms on each side.

    The spans are disjoint, in time order and inside the recording; where reasons overlap, the first of this
    list is given. A ready angle series has no samples, hence only what its file says.
    """
    if not recording.holds_samples:
        return make_disjoint(recording.excluded, recording.duration_us)
    short = [
        Span(segment.start_us, segment.duration_us, "short-segment")
        for segment in recording.segments
        if segment.duration_us < SHORTEST_SEGMENT_US
    ]
    return make_disjoint([*find_clipped(recording), *short, *recording.excluded], recording.duration_us)


def refuse_short(recording: Recording) -> None:
    """Refuse what cannot hold the 10 s that an analysis needs, before anything is looked for in it.

    Raises
    ------
    TooShort
    """
    present_us = sum(segment.duration_us for segment in recording.segments)
    if present_us < SHORTEST_RECORDING_US and recording.device not in (READY_ANGLES, "mvn"):
        raise TooShort(s=round(present_us / MICROSECONDS, 3))


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
