"""The day in minutes and in clock hours (EXPOSURE.md A8)."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

from fusion.exposure.bins import PartHistograms, find_percentile_cells, find_percentiles, summarise_time_above
from fusion.exposure.rows import IntArray
from fusion.exposure.types import MinuteProfile, PartExposure
from fusion.recording import MICROSECONDS

PERCENTS = (10, 50, 90)
MINUTE_US = 60 * MICROSECONDS
HOUR_US = 60 * MINUTE_US


@dataclass(frozen=True, slots=True, eq=False)
class DayParts:
    """Parts that follow one another through the recording: edges of shape (p + 1,), and a name for each."""

    edges_us: IntArray
    labels: tuple[str, ...]


def split_minutes(duration_us: int) -> IntArray:
    """Give the edges of the minutes from the first sample, the last one as long as need be."""
    return np.arange(-(-duration_us // MINUTE_US) + 1, dtype=np.int64) * MINUTE_US


def split_hours(start: datetime | None, duration_us: int) -> DayParts:
    """Split the recording at the full hours of its clock, or every hour where it has none.

    A start with a time zone follows its zone over the change of clocks (an hour may come twice or not
    at all); a device clock without one runs on. Labels are "2027-03-14T22:00", or "+01:00" from the
    first sample.
    """
    first_us = HOUR_US - _measure_into_hour(start)
    inner = np.arange(first_us, duration_us, HOUR_US, dtype=np.int64)
    edges_us = np.concatenate([[0], inner, [duration_us]])
    return DayParts(edges_us, tuple(_name_hour(start, int(edge)) for edge in edges_us[:-1]))


def _measure_into_hour(start: datetime | None) -> int:
    if start is None:
        return 0
    return (start.minute * 60 + start.second) * MICROSECONDS + start.microsecond


def _name_hour(start: datetime | None, elapsed_us: int) -> str:
    if start is None:
        return f"+{elapsed_us // HOUR_US:02d}:00"
    return read_clock(start, elapsed_us).strftime("%Y-%m-%dT%H:00")


def read_clock(start: datetime, elapsed_us: int) -> datetime:
    """Say what the clock of ``start`` shows after a true elapsed time."""
    elapsed = timedelta(microseconds=elapsed_us)
    if start.tzinfo is None:
        return start + elapsed
    return (start.astimezone(UTC) + elapsed).astimezone(start.tzinfo)


def profile_minutes(minutes: PartHistograms) -> MinuteProfile:
    """Give each minute's P10, P50 and P90 and its analysed time."""
    places = find_percentile_cells(minutes.cell_us, np.array(PERCENTS, np.float64)) / 10.0
    analysed_us = minutes.cell_us.sum(axis=1, dtype=np.int64)
    start_s, analysed_s = minutes.edges_us[:-1] / MICROSECONDS, analysed_us / MICROSECONDS
    return MinuteProfile(start_s, places[:, 0], places[:, 1], places[:, 2], analysed_s)


def summarise_parts(
    parts: DayParts, histograms: PartHistograms, entry_us: IntArray
) -> tuple[PartExposure, ...]:
    """Give the main figures of each part; ``entry_us`` are the times of the entries above 60 deg."""
    entries = np.histogram(entry_us, parts.edges_us)[0]
    return tuple(
        summarise_part(label, parts.edges_us[k : k + 2], histograms.cell_us[k], int(entries[k]))
        for k, label in enumerate(parts.labels)
    )


def summarise_part(label: str, edges_us: IntArray, cell_us: IntArray, entries: int) -> PartExposure:
    """Give the main figures of one part from its cells, shape (1800,), and its entries above 60 deg."""
    start_s, end_s = (float(edge) / MICROSECONDS for edge in edges_us)
    analysed_s = int(cell_us.sum()) / MICROSECONDS
    if analysed_s == 0.0:
        return PartExposure(label, start_s, end_s, 0.0, {}, {}, None)
    return PartExposure(
        label,
        start_s,
        end_s,
        analysed_s,
        find_percentiles(cell_us, PERCENTS),
        {int(above.threshold_deg): above.percent for above in summarise_time_above(cell_us)},
        entries * 3600.0 / analysed_s,
    )
