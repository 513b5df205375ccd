"""Where samples were recorded but the fusion did not trust their direction."""

from collections.abc import Sequence

import numpy as np

from fusion.calibration import Calibration
from fusion.elevation import Elevation
from fusion.exposure.rows import find_runs, list_touched_rows
from fusion.quality.spans import flag_spans
from fusion.recording import MICROSECONDS, QualityFlag, Recording, Span


def flag_untrusted(
    recording: Recording, elevation: Elevation, exclusions: Sequence[Span]
) -> tuple[QualityFlag, ...]:
    """Flag, with their times, the stretches that count as missing though samples are there.

    ``elevation`` is that of the recording, segment by segment. Rows put in over a hole of up to 50 ms are a
    part of that hole, and what is excluded is not missing. Less than a second in all is not told.
    """
    bridged = {segment.start_us: segment.bridged for segment in recording.segments}
    spans: list[Span] = []
    for segment in elevation.segments:
        doubted = ~segment.valid
        for first, stop in bridged.get(segment.start_us, ()):
            doubted[first:stop] = False
        for rows in list_touched_rows(segment, exclusions):
            doubted[rows] = False
        times_us = segment.start_us + np.rint(find_runs(doubted) * (MICROSECONDS / segment.rate_hz))
        spans += [Span(int(a), int(b - a), "untrusted") for a, b in times_us]
    if sum(span.duration_us for span in spans) < MICROSECONDS:
        return ()
    return flag_spans("W-UNTRUSTED", spans)


def flag_untrusted_pose(calibration: Calibration, elevation: Elevation) -> tuple[QualityFlag, ...]:
    """W-POSE-DOUBT where half or more of a calibration window is not trusted: all angles rest on it."""
    return tuple(
        QualityFlag("W-POSE-DOUBT", 1, still.duration_s, still.start_s, still.start_s + still.duration_s)
        for still in calibration.windows
        if 2.0 * _trust(elevation, still.start_s, still.start_s + still.duration_s) <= 1.0
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
