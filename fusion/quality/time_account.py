"""Where the recording's time went (CONTRACT.md §5 "Time")."""

import numpy as np

from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import TooShort
from fusion.quality.exclusions import READY_ANGLES
from fusion.quality.types import TimeAccount
from fusion.recording import MICROSECONDS, Recording, Span

SHORTEST_ANALYSED_US = 10 * MICROSECONDS
WITHOUT_MINIMUM = (READY_ANGLES, "mvn")


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
        raise TooShort(s=analysed_us / MICROSECONDS)
    recorded_us = max(recording.duration_us, analysed_us)
    excluded_us = min(sum(span.duration_us for span in exclusions), recorded_us - analysed_us)
    missing_us = recorded_us - analysed_us - excluded_us
    if exclusions and missing_us <= len(exclusions) + len(elevation.segments):
        missing_us, excluded_us = 0, excluded_us + missing_us
    return TimeAccount(recorded_us, analysed_us, missing_us, excluded_us)


def _count_analysed(segment: ElevationSegment) -> int:
    return int(np.count_nonzero(segment.valid & np.isfinite(segment.elevation_deg)))
