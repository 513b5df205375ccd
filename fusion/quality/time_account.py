"""Where the recording's time went (CONTRACT.md §5 "Time")."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import TooShort
from fusion.quality.exclusions import READY_ANGLES
from fusion.quality.types import TimeAccount, TimePart
from fusion.readers.timing import find_missing
from fusion.recording import MICROSECONDS, Recording, Span

Account = Literal["analysed", "excluded", "missing"]

SHORTEST_ANALYSED_US = 10 * MICROSECONDS
WITHOUT_MINIMUM = (READY_ANGLES, "mvn")
SAID_BY_A_PERSON = frozenset({"break", "not-worn", "outside", "seated", "supported", "task", "work", "shift"})


def account_time(recording: Recording, elevation: Elevation, exclusions: tuple[Span, ...]) -> TimeAccount:
    """Account for every microsecond: analysed are the valid rows, missing is what nothing explains.

    A segment's rows last its fitted period, so sums and stamps can differ by a microsecond for each segment
    and each exclusion; such a difference goes to the excluded time, and is not called missing.

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
        raise TooShort(s=analysed_us / MICROSECONDS, **_name_largest(exclusions))
    recorded_us = max(recording.duration_us, analysed_us)
    excluded_us = min(sum(span.duration_us for span in exclusions), recorded_us - analysed_us)
    missing_us = recorded_us - analysed_us - excluded_us
    if exclusions and missing_us <= len(exclusions) + len(elevation.segments):
        missing_us, excluded_us = 0, excluded_us + missing_us
    return TimeAccount(recorded_us, analysed_us, missing_us, excluded_us)


def count_holes_us(recording: Recording, exclusions: tuple[Span, ...]) -> int:
    """Count the time without samples that no exclusion explains, as `inspect` does before an analysis."""
    holes = find_missing(recording.segments, recording.duration_us, exclusions)
    return sum(hole.duration_us for hole in holes)


def name_parts(
    time: TimeAccount, analysed_us: Mapping[str, int], exclusions: tuple[Span, ...], holes_us: int
) -> TimeAccount:
    """Say what the time consists of: analysed time by kind of period, excluded time by its reason.

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
        *_list_parts("analysed", analysed_us, time.analysed_us),
        *_list_parts("excluded", excluded_us, time.excluded_us),
        *_list_parts("missing", missing_us, time.missing_us),
    )
    return replace(time, parts=parts)


def _list_parts(account: Account, lengths_us: Mapping[str, int], whole_us: int) -> Iterable[TimePart]:
    rest_us = whole_us - sum(lengths_us.values())
    largest = max(lengths_us, key=lambda name: lengths_us[name], default="")
    for name, length_us in lengths_us.items():
        told_us = length_us + (rest_us if name == largest else 0)
        if told_us:
            yield TimePart(account, name, told_us)


def _name_largest(exclusions: tuple[Span, ...]) -> dict[str, str | float]:
    """Say what left out most, for how long, and what to do where a person can undo it."""
    lengths_us: dict[str, int] = {}
    for span in exclusions:
        lengths_us[span.reason] = lengths_us.get(span.reason, 0) + span.duration_us
    if not lengths_us:
        return {}
    largest = max(lengths_us, key=lambda reason: lengths_us[reason])
    told: dict[str, str | float] = {"left_out": largest, "left_out_s": lengths_us[largest] / MICROSECONDS}
    if largest in SAID_BY_A_PERSON:
        told["cure"] = "left out"
    return told


def _count_analysed(segment: ElevationSegment) -> int:
    return int(np.count_nonzero(segment.valid & np.isfinite(segment.elevation_deg)))
