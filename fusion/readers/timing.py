"""What all readers say about time: gaps between segments, clocks that were never set."""

import hashlib
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime

from fusion.recording import MICROSECONDS, QualityFlag, Recording, Segment, Span

FIRST_PLAUSIBLE_YEAR = 2008
LAST_PLAUSIBLE_YEAR = 2060
MOST_TOLD = 100
DAY_US = 86_400 * MICROSECONDS
LARGEST_DRIFT = 0.005
"""A rate further than this from the nominal one is worth a word."""


def is_clock_set(start: datetime) -> bool:
    """Whether a device of this kind can have been worn then."""
    return FIRST_PLAUSIBLE_YEAR <= start.year <= LAST_PLAUSIBLE_YEAR


def trust_clock(start: datetime | None) -> tuple[datetime | None, tuple[QualityFlag, ...]]:
    """Give the clock only where it can have been set, and a caveat where it was not (W-CLOCK-UNSET)."""
    if start is None or is_clock_set(start):
        return start, ()
    return None, (QualityFlag("W-CLOCK-UNSET"),)


def find_gaps(
    segments: Sequence[Segment], duration_us: int, excluded: Iterable[Span] = ()
) -> tuple[Span, ...]:
    """Time between the segments and after the last that no exclusion explains."""
    covered = sorted(
        [(s.start_us, s.end_us) for s in segments] + [(span.start_us, span.end_us) for span in excluded]
    )
    gaps: list[Span] = []
    reached_us = 0
    for start_us, end_us in [*covered, (duration_us, duration_us)]:
        if start_us > reached_us:
            gaps.append(Span(reached_us, start_us - reached_us, "gap"))
        reached_us = max(reached_us, end_us)
    return tuple(gaps)


def bridged_spans(segments: Iterable[Segment]) -> list[Span]:
    """Holes that were bridged for the filters: their time is missing too."""
    return [
        Span(
            segment.start_us + round(first * MICROSECONDS / segment.rate_hz),
            round((stop - first) * MICROSECONDS / segment.rate_hz),
            "gap",
        )
        for segment in segments
        for first, stop in segment.bridged
    ]


def find_missing(
    segments: Sequence[Segment], duration_us: int, excluded: Sequence[Span] = ()
) -> tuple[Span, ...]:
    """All holes in order of time: between the segments, after the last, and those that were bridged.

    What is excluded is not missing; of a bridged hole neither.
    """
    starts_us = sorted(span.start_us for span in excluded)
    ends_us = sorted(span.end_us for span in excluded)
    holes = list(find_gaps(segments, duration_us, excluded))
    for hole in bridged_spans(segments):
        middle_us = hole.start_us + hole.duration_us // 2
        if bisect_right(starts_us, middle_us) == bisect_right(ends_us, middle_us):
            holes.append(hole)
    return tuple(sorted(holes, key=lambda hole: hole.start_us))


def flag_gaps(
    segments: Sequence[Segment], duration_us: int, excluded: Sequence[Span] = ()
) -> tuple[QualityFlag, ...]:
    """Say where time is missing (W-GAP)."""
    return flag_spans("W-GAP", find_missing(segments, duration_us, excluded))


def flag_spans(code: str, spans: Sequence[Span], **facts: str) -> tuple[QualityFlag, ...]:
    """One flag for all spans of a kind: how many, how long together, where (the longest); none for none."""
    if not spans:
        return ()
    total_s = sum(span.duration_us for span in spans) / MICROSECONDS
    first_s, last_s = spans[0].start_us / MICROSECONDS, spans[-1].end_us / MICROSECONDS
    longest = sorted(spans, key=lambda span: -span.duration_us)[:MOST_TOLD]
    told = tuple(sorted((span.start_us / MICROSECONDS, span.end_us / MICROSECONDS) for span in longest))
    return (QualityFlag(code, len(spans), total_s, first_s, last_s, facts, told),)


def datetime_at_us(unix_us: int) -> datetime | None:
    """A naive reading of microseconds since 1970; None where no calendar has it."""
    try:
        return datetime.fromtimestamp(unix_us // MICROSECONDS, UTC).replace(
            microsecond=unix_us % MICROSECONDS, tzinfo=None
        )
    except (ValueError, OverflowError, OSError):
        return None


def hash_serial(serial: str) -> str | None:
    """SHA-256 of a serial, first 12 hexadecimal digits: tells devices apart, names none."""
    return hashlib.sha256(serial.strip().encode()).hexdigest()[:12] if serial.strip() else None


def flag_days(recording: Recording) -> Recording:
    """Say, once, where a recording spans more than a day."""
    flags = tuple(flag for flag in recording.flags if flag.code != "W-MULTIDAY")
    if recording.duration_us > DAY_US:
        flags += (QualityFlag("W-MULTIDAY", -(-recording.duration_us // DAY_US)),)
    return replace(recording, flags=flags)
