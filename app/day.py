"""What the page needs of an analysis to let a person look at the day and correct it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from app.day_file import DaySegment, write_day
from fusion.elevation import ElevationSegment
from fusion.pipeline import Analysis
from fusion.pose_windows import propose_still_periods
from fusion.quality import propose_nonwear
from fusion.recording import MICROSECONDS, Segment, Span
from fusion.sensor_errors.runs import view_segment
from fusion.sensor_errors.stillness import reduce_run


def write_day_of(analysis: Analysis, path: Path) -> None:
    """Write the day of an analysis as :mod:`app.day_file` keeps it."""
    write_day(path, list(_list_segments(analysis)), _tell_facts(analysis))


def _list_segments(analysis: Analysis) -> Iterator[DaySegment]:
    """Pair each run of angles with the samples it came from; ready angles have none."""
    by_start = {segment.start_us: segment for segment in analysis.recording.segments}
    for run in analysis.elevation.segments:
        angle_deg = np.where(run.valid, run.elevation_deg, np.nan).astype(np.float32)
        block_s, quiet = _reduce(by_start.get(run.start_us), run)
        yield DaySegment(run.start_us / MICROSECONDS, run.rate_hz, angle_deg, block_s, quiet)


def _reduce(segment: Segment | None, run: ElevationSegment) -> tuple[float, np.ndarray[Any, Any]]:
    if segment is None or not len(segment) or not run.rate_hz:
        return 1.0, np.empty((0, 6), np.float32)
    blocks = reduce_run(view_segment(segment))
    return blocks.block_s, blocks.acc.astype(np.float32)


def _tell_facts(analysis: Analysis) -> dict[str, Any]:
    recording = analysis.recording
    has_samples = analysis.calibration is not None
    still = propose_still_periods(recording) if has_samples else ()
    not_worn = propose_nonwear(recording, analysis.exclusions) if has_samples else ()
    return {
        "device": recording.device,
        "start": recording.start.isoformat() if recording.start else None,
        "duration_us": recording.duration_us,
        "still": [[p.start_s, p.start_s + p.duration_s, p.score] for p in still],
        "not_worn": [_bound(span) for span in not_worn],
        "left_out": [[*_bound(span), span.reason] for span in analysis.exclusions],
        "calibration": [list(window) for window in _list_windows(analysis)],
    }


def _bound(span: Span) -> list[float]:
    return [span.start_us / MICROSECONDS, span.end_us / MICROSECONDS]


def _list_windows(analysis: Analysis) -> Iterator[tuple[float, float, float]]:
    """Give start, end and score of the windows that were used."""
    calibration = analysis.calibration
    for still in (calibration.still, calibration.second) if calibration else ():
        if still is not None:
            yield still.start_s, still.start_s + still.duration_s, still.score
