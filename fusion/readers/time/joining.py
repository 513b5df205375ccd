"""A shift in several files: recordings of one device on one clock; the time between them is missing."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta

from acromion.fusion.caveats import Caveat
from acromion.fusion.checks.faults import cut_rows
from acromion.fusion.clocks import measure_us
from acromion.fusion.errors import UnusableJoin
from acromion.fusion.readers.time.clock import flag_days, is_change_of_offset
from acromion.fusion.recording import MICROSECONDS, QualityFlag, Recording, Span, flag_spans

LONGEST_OVERLAP_US = 2 * MICROSECONDS
"""Two files of one logger may share a second at the seam; more is not one shift."""
LONGEST_SPAN_US = 31 * 86_400 * MICROSECONDS


def join_recordings(recordings: Sequence[Recording]) -> Recording:
    """Join recordings of one device, in the order of its clock.

    A file that is listed twice counts once (W-DUP-FILE). If two files overlap by up to 2 s, the overlapping
    rows of the later file are dropped (W-DUP). Time between two files is missing (W-GAP). If the offset from
    UTC changes between two files, all times use the first file's offset (W-DST, or W-OFFSET if no time zone
    made this change at about that time).

    Raises UnusableJoin if there is nothing to join, no clock, several devices, a longer overlap, or a span of
    over a month.
    """
    ordered = _order(recordings)
    starts = [_start_of(recording) for recording in ordered]
    joined = ordered[0]
    for recording, start in zip(ordered[1:], starts[1:], strict=True):
        offset_us = measure_us(starts[0], start)
        joined = _append(joined, recording, offset_us)
        joined = replace(joined, flags=(*joined.flags, *_flag_change(starts[0], start, offset_us)))
    repeated = len(recordings) - len(ordered)
    if repeated:
        joined = replace(joined, flags=(*joined.flags, QualityFlag(Caveat.DUP_FILE, repeated)))
    hashes = "\n".join(recording.sha256 for recording in ordered)
    return flag_days(
        replace(
            joined,
            sha256=hashlib.sha256(hashes.encode()).hexdigest() if len(ordered) > 1 else joined.sha256,
            understood={**joined.understood, "files": str(len(ordered))},
        )
    )


def _order(recordings: Sequence[Recording]) -> list[Recording]:
    single = list({recording.sha256: recording for recording in recordings}.values())
    if not single:
        raise UnusableJoin(why="no-files")
    if len({(recording.device, recording.serial_hash) for recording in single}) > 1:
        raise UnusableJoin(why="devices")
    if len({_start_of(recording).tzinfo is None for recording in single}) > 1:
        raise UnusableJoin(why="clock")
    first = _start_of(single[0])
    return sorted(single, key=lambda recording: measure_us(first, _start_of(recording)))


def _start_of(recording: Recording) -> datetime:
    if recording.start is None:
        raise UnusableJoin(why="clock")
    return recording.start


def _append(joined: Recording, later: Recording, offset_us: int) -> Recording:
    overlap_us = joined.duration_us - offset_us
    if overlap_us > min(LONGEST_OVERLAP_US, later.duration_us):
        raise UnusableJoin(why="overlap")
    if offset_us + later.duration_us > LONGEST_SPAN_US:
        raise UnusableJoin(why="span")
    segments = list(joined.segments)
    for segment in later.segments:
        moved = replace(segment, start_us=segment.start_us + offset_us)
        early_us = joined.duration_us - moved.start_us  # rows that begin in this time are dropped
        rows = -int(-early_us // (MICROSECONDS / moved.rate_hz))
        segments += cut_rows(moved, [(0, min(len(moved), rows))]) if early_us > 0 else [moved]
    excluded = (
        *joined.excluded,
        *(replace(span, start_us=span.start_us + offset_us) for span in later.excluded),
    )
    duration_us = max(joined.duration_us, offset_us + later.duration_us)
    between = [Span(joined.duration_us, -overlap_us)] if overlap_us < -1 else []
    flags = (*joined.flags, *(_move_flag(flag, offset_us) for flag in later.flags))
    flags += flag_spans(Caveat.GAP, between)
    if overlap_us > 0:
        at_s = offset_us / MICROSECONDS
        flags += (
            QualityFlag(Caveat.DUP, 1, overlap_us / MICROSECONDS, at_s, joined.duration_us / MICROSECONDS),
        )
    return replace(joined, segments=tuple(segments), excluded=excluded, duration_us=duration_us, flags=flags)


def _flag_change(first: datetime, start: datetime, offset_us: int) -> tuple[QualityFlag, ...]:
    offsets_s = [round((one.utcoffset() or timedelta()).total_seconds()) for one in (first, start)]
    if offsets_s[0] == offsets_s[1]:
        return ()
    code = Caveat.DST if is_change_of_offset(start, *offsets_s) else Caveat.OFFSET
    at_s = offset_us / MICROSECONDS
    return (QualityFlag(code, 1, 0.0, at_s, at_s, {"step_s": offsets_s[1] - offsets_s[0]}),)


def _move_flag(flag: QualityFlag, offset_us: int) -> QualityFlag:
    later_s = offset_us / MICROSECONDS
    first_s, last_s = (None if at_s is None else at_s + later_s for at_s in (flag.first_s, flag.last_s))
    spans_s = tuple((start_s + later_s, end_s + later_s) for start_s, end_s in flag.spans_s)
    return replace(flag, first_s=first_s, last_s=last_s, spans_s=spans_s)
