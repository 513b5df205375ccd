"""Cut a recording to a window of clock time, such as one shift of a week.

The recording of a window has its samples and nothing else, so that every later step sees an ordinary
recording.
"""

from collections.abc import Iterator
from dataclasses import replace

from acromion.fusion.caveats import Caveat
from acromion.fusion.checks.faults import cut_rows
from acromion.fusion.clocks import ShiftWindow, read_clock
from acromion.fusion.errors import UnusableShift
from acromion.fusion.readers.time.clock import flag_days
from acromion.fusion.recording import (
    MICROSECONDS,
    QualityFlag,
    Recording,
    Segment,
    Span,
    cut_windows,
    flag_gaps,
)


def cut_recording(recording: Recording, window: ShiftWindow) -> Recording:
    """Return the recording of a shift, from its first sample in the window.

    Samples, excluded time and caveats outside the window are dropped. Its digest stays that of the file.

    Raises UnusableShift: the recording has no clock, or no sample in the window.
    """
    if recording.start is None:
        raise UnusableShift(why="no clock", window=str(window))
    first_us, stop_us = window.place(recording.start)
    if first_us <= 0 and stop_us >= recording.duration_us:
        return recording
    kept = [piece for segment in recording.segments for piece in _cut_segment(segment, first_us, stop_us)]
    if not kept:
        raise UnusableShift(why="no samples", window=str(window))
    first_us = kept[0].start_us
    segments = tuple(replace(segment, start_us=segment.start_us - first_us) for segment in kept)
    inside = [
        (max(span.start_us, first_us), min(span.end_us, stop_us), span.reason) for span in recording.excluded
    ]
    inside = [span for span in inside if span[0] < span[1]]
    stop_us = max(kept[-1].end_us, *(span[1] for span in inside), 0)
    excluded = tuple(Span(a - first_us, b - a, reason) for a, b, reason in inside)
    duration_us = stop_us - first_us
    located = (_cut_flag(flag, first_us, stop_us) for flag in recording.flags if flag.code != Caveat.GAP)
    windows_s = cut_windows(recording.pose_windows_s, first_us, stop_us)
    return flag_days(
        replace(
            recording,
            start=read_clock(recording.start, first_us),
            duration_us=duration_us,
            segments=segments,
            excluded=excluded,
            flags=(*(flag for flag in located if flag), *flag_gaps(segments, duration_us, excluded)),
            pose_windows_s=windows_s,
            pose_held=recording.pose_held if first_us == 0 else None,
        )
    )


def _cut_segment(segment: Segment, first_us: int, stop_us: int) -> Iterator[Segment]:
    """Yield the rows of a segment that begin in the window, if there are any."""
    period_us = MICROSECONDS / segment.rate_hz
    first = max(0, -int(-(first_us - segment.start_us) // period_us))
    stop = min(len(segment), -int(-(stop_us - segment.start_us) // period_us))
    if first >= stop:
        return
    if (first, stop) == (0, len(segment)):
        yield segment
    else:
        yield from cut_rows(segment, [(0, first), (stop, len(segment))])


def _cut_flag(flag: QualityFlag, first_us: int, stop_us: int) -> QualityFlag | None:
    """Return a caveat for the stretch; None if its place is outside. One without a place stays."""
    if flag.first_s is None or flag.last_s is None:
        return flag
    first_s, stop_s = first_us / MICROSECONDS, stop_us / MICROSECONDS
    if flag.first_s > stop_s or flag.last_s < first_s:
        return None
    spans_s = tuple(
        (max(a, first_s) - first_s, min(b, stop_s) - first_s)
        for a, b in flag.spans_s
        if a < stop_s and b > first_s
    )
    if flag.spans_s and not spans_s:
        return None
    places = (max(flag.first_s, first_s) - first_s, min(flag.last_s, stop_s) - first_s)
    seconds = sum(b - a for a, b in spans_s) if spans_s else flag.seconds
    return replace(
        flag,
        first_s=places[0],
        last_s=places[1],
        spans_s=spans_s,
        seconds=seconds,
        count=len(spans_s) or flag.count,
    )
