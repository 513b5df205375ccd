"""Days overlaid by the clock, as the Ambulatory Glucose Profile overlays days of glucose.

The layout follows the Ambulatory Glucose Profile (J Diabetes Sci Technol 2013;7:562): median, 25 to 75 %
and 10 to 90 % by clock time over all days. Here each day that is analysed for half of a quarter hour counts
once in it, so that a long day weighs no more than a short one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from fusion.elevation import Elevation
from fusion.exposure.bins import CELLS, CELLS_PER_DEG, find_percentiles
from fusion.exposure.metric_filter import filter_elevation
from fusion.recording import MICROSECONDS, Float64Array

QUARTER_S = 900.0
QUARTERS = 96
LEAST_ANALYSED_S = QUARTER_S / 2
"""Of a quarter hour, for a day to count in it."""
LEAST_DAYS = 2
"""In a quarter hour, for it to be shown; and at least half of all days."""
PERCENTS = (10, 25, 50, 75, 90)

_DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class ClockBand:
    """A quarter hour of the clock over all days.

    ``start_s``: from midnight by the devices' clocks.
    ``days``: days that are analysed for at least half of it.
    ``percentiles_deg``: elevation by percent: 10, 25, 50, 75, 90; None where too few days are.
    """

    start_s: float
    days: int
    percentiles_deg: dict[int, float] | None


def lay_on_clock(elevation: Elevation, start: datetime) -> Float64Array:
    """Count the analysed time of a day by quarter hour of the clock and by angle.

    ``elevation``: before the metric filter; what is left out must not be valid.
    ``start``: of the first sample; what the clock showed then counts on, whatever is done to clocks
    meanwhile.

    Returns
    -------
    numpy.ndarray
        Shape (96, 1800): seconds in each 0.1 deg. Time after midnight lies in the first rows.
    """
    begins_s = (start - start.replace(hour=0, minute=0, second=0, microsecond=0)).total_seconds()
    seconds = np.zeros(QUARTERS * CELLS)
    for run in (filter_elevation(segment) for segment in elevation.segments if len(segment)):
        rows = np.flatnonzero(run.valid)
        clock_s = begins_s + run.start_us / MICROSECONDS + rows / run.rate_hz
        quarter = (clock_s // QUARTER_S).astype(np.int64) % QUARTERS
        cell = np.minimum((run.elevation_deg[rows] * CELLS_PER_DEG).astype(np.int64), CELLS - 1)
        seconds += np.bincount(quarter * CELLS + cell, minlength=len(seconds)) / run.rate_hz
    return seconds.reshape(QUARTERS, CELLS)


def overlay_days(days: Sequence[Float64Array]) -> tuple[ClockBand, ...]:
    """Overlay days, each as :func:`lay_on_clock` gives it: one band for each quarter hour with any day.

    They stand in the order of a shift: the first follows the longest time of the clock without a day.
    """
    bands = [_overlay_quarter(quarter, days) for quarter in range(QUARTERS)]
    used = tuple(band for band in bands if band.days)
    first_s = find_first_quarter([used])
    return tuple(sorted(used, key=lambda band: (band.start_s - first_s) % _DAY_S))


def find_first_quarter(overlays: Sequence[Sequence[ClockBand]]) -> float:
    """Find where an axis of the clock begins that holds all overlays: after the longest time without a day.

    Seconds from midnight, the clock taken as a ring; 0 without any day, or with days at all hours.
    """
    used = {round(band.start_s / QUARTER_S) for bands in overlays for band in bands if band.days}
    longest, first, unused = 0, 0, 0
    for place in range(2 * QUARTERS):
        if place % QUARTERS not in used:
            unused += 1
            continue
        if QUARTERS > unused > longest:
            longest, first = unused, place % QUARTERS
        unused = 0
    return first * QUARTER_S


def _overlay_quarter(quarter: int, days: Sequence[Float64Array]) -> ClockBand:
    lasted_s = [float(day[quarter].sum()) for day in days]
    shares = [day[quarter] / s for day, s in zip(days, lasted_s, strict=True) if s >= LEAST_ANALYSED_S - 1e-6]
    if len(shares) < max(LEAST_DAYS, len(days) / 2):
        return ClockBand(quarter * QUARTER_S, len(shares), None)
    angles_deg = find_percentiles(np.sum(shares, axis=0), PERCENTS)
    return ClockBand(quarter * QUARTER_S, len(shares), angles_deg)
