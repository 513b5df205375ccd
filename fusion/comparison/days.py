"""Several days of a person, and of a group: overlaid by clock time, with the variation between them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from math import inf, sqrt
from typing import Literal

import numpy as np
from scipy.special import chdtri, stdtrit

from fusion.clocks import list_zone_changes
from fusion.comparison.change import find_detectable_change
from fusion.elevation import Elevation
from fusion.exposure.bins import CELLS, CELLS_PER_DEG, find_percentiles
from fusion.exposure.metric_filter import filter_elevation
from fusion.exposure.types import Interval
from fusion.recording import MICROSECONDS, Float64Array

# Days overlaid by clock time, as the Ambulatory Glucose Profile overlays days of glucose.
#
# The layout follows the Ambulatory Glucose Profile (J Diabetes Sci Technol 2013;7:562): median, 25 to 75 %
# and 10 to 90 % by clock time over all days. Each day that is analysed for at least half of a quarter hour
# counts once in it, so that a long day has no more weight than a short one.

QUARTER_S = 900.0
QUARTERS = 96
LEAST_ANALYSED_S = QUARTER_S / 2
"""A day counts in a quarter hour if at least this much of it was analysed."""
LEAST_DAYS = 2
"""A quarter hour is shown if at least this many days count in it, and at least half of all days."""
PERCENTS = (10, 25, 50, 75, 90)

_DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class ClockBand:
    """A quarter hour of the clock over all days.

    ``start_s``: from midnight by the devices' clocks.
    ``days``: days that are analysed for at least half of it.
    ``percentiles_deg``: elevation by percent: 10, 25, 50, 75, 90; None with too few days.
    """

    start_s: float
    days: int
    percentiles_deg: dict[int, float] | None


def lay_on_clock(elevation: Elevation, start: datetime) -> Float64Array:
    """Count the analysed time of a day by quarter hour of the clock and by angle.

    ``elevation``: before the metric filter; excluded time must not be valid. ``start``: of the first sample;
    the clock runs on from there, and follows the changes of a known zone.

    Returns
    -------
    numpy.ndarray
        Shape (96, 1800): seconds in each 0.1 deg. Time after midnight is in the first rows.
    """
    begins_s = (start - start.replace(hour=0, minute=0, second=0, microsecond=0)).total_seconds()
    ends_us = [run.start_us + round(len(run) / run.rate_hz * MICROSECONDS) for run in elevation.segments]
    changes = list_zone_changes(start, max(ends_us, default=0))
    seconds = np.zeros(QUARTERS * CELLS)
    for run in (filter_elevation(segment) for segment in elevation.segments if len(segment)):
        rows = np.flatnonzero(run.valid)
        elapsed_s = run.start_us / MICROSECONDS + rows / run.rate_hz
        clock_s = begins_s + elapsed_s
        for at_s, step_s in changes:
            clock_s[elapsed_s >= at_s] += step_s
        quarter = (clock_s // QUARTER_S).astype(np.int64) % QUARTERS
        cell = np.minimum((run.elevation_deg[rows] * CELLS_PER_DEG).astype(np.int64), CELLS - 1)
        seconds += np.bincount(quarter * CELLS + cell, minlength=len(seconds)) / run.rate_hz
    return seconds.reshape(QUARTERS, CELLS)


def overlay_days(days: Sequence[Float64Array]) -> tuple[ClockBand, ...]:
    """Overlay days, each from :func:`lay_on_clock`: one band for each quarter hour with any day.

    They are in the order of a shift: the first follows the longest period of the clock without a day.
    """
    used = []
    for quarter in range(QUARTERS):
        lasted_s = [float(day[quarter].sum()) for day in days]
        enough = zip(days, lasted_s, strict=True)
        shares = [day[quarter] / s for day, s in enough if s >= LEAST_ANALYSED_S - 1e-6]
        is_shown = len(shares) >= max(LEAST_DAYS, len(days) / 2)
        angles_deg = find_percentiles(np.sum(shares, axis=0), PERCENTS) if is_shown else None
        if shares:
            used.append(ClockBand(quarter * QUARTER_S, len(shares), angles_deg))
    first_s = find_first_quarter([used])
    return tuple(sorted(used, key=lambda band: (band.start_s - first_s) % _DAY_S))


def find_first_quarter(overlays: Sequence[Sequence[ClockBand]]) -> float:
    """Return the start of a clock axis that contains all overlays: after the longest period without a day.

    In seconds from midnight; the clock is treated as a ring. Returns 0 if there is no day, or if there are
    days at all hours.
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


# Variation of a figure between the days of a person and between the people of a group.
#
# Statistics of daily values only. Days of one person are treated as independent. A deviation from few days is
# uncertain itself, so it always has its own range. Between and within people: one-way random effects analysis
# of variance (Searle, Casella and McCulloch 1992, Variance Components, section 3.6), which allows different
# numbers of days per person.

LEAST_OWN_DAYS = 5
"""From this many days, a person's own deviation replaces the published one: the 95 % range of a deviation is
0.60 to 2.87 times itself with 5 days, 0.57 to 3.73 with 4, 0.52 to 6.28 with 3.
"""
DAYS = (1, 2, 3, 5)
WORTHWHILE_SHARE = 0.5
"""The change that the requested days should detect, as a share of the mean (docs/profile.md)."""
_TAIL = 0.025


@dataclass(frozen=True, slots=True)
class DayMean:
    """A figure over days, in its own unit.

    ``days``: days that count.
    ``mean``: their mean, each day once.
    ``sd``: standard deviation between days (n - 1); None for one day.
    ``mean_range``: 95 % range of the mean, t with n - 1 degrees of freedom; None for one day.
    ``sd_range``: 95 % range of the deviation, by chi square; None for one day, or if the days are equal.
    """

    days: int
    mean: float
    sd: float | None = None
    mean_range: Interval | None = None
    sd_range: Interval | None = None


@dataclass(frozen=True, slots=True)
class Telling:
    """The change that a number of days on each side can detect.

    ``sd``, ``sd_from``: deviation between days, and its source.
    ``days``: the fewest of 1, 2, 3, 5 that can detect a change of half the mean; 5 if none can.
    ``more_days``: still to be measured for one side.
    ``detectable``: the smallest change that ``days`` on each side can detect, or the existing days if there
    are more.
    ``detectable_range``: the same for both ends of the range of the person's own deviation; None with the
    published one.
    """

    sd: float
    sd_from: Literal["person", "published"]
    days: int
    more_days: int
    detectable: float
    detectable_range: Interval | None = None


@dataclass(frozen=True, slots=True)
class GroupSpread:
    """A figure over the days of several people.

    ``people``, ``days``: number of each.
    ``mean``: of the people's means, each person once.
    ``mean_range``: its 95 % range, t with people - 1 degrees of freedom.
    ``within_sd``: between the days of one person; None if nobody has two days.
    ``between_sd``: between people, without the variation of days; 0 if people differ no more than their days;
    None if ``within_sd`` is None.
    """

    people: int
    days: int
    mean: float
    mean_range: Interval | None
    within_sd: float | None
    between_sd: float | None


@dataclass(frozen=True, slots=True)
class GroupChange:
    """After minus before, of the people with days on both sides, each person once.

    ``change_range``: 95 % range of the mean change, t with people - 1 degrees of freedom; None for one
    person.
    """

    people: int
    before: float
    after: float
    change: float
    change_range: Interval | None


def describe_days(values: Sequence[float], most: float = inf) -> DayMean:
    """Describe the days of one person; no range exceeds ``most``, the largest possible value.

    Raises ValueError: there is no day.
    """
    if not values:
        raise ValueError("no days")
    n, mean = len(values), float(np.mean(values))
    if n < 2:
        return DayMean(n, mean)
    sd = float(np.std(values, ddof=1))
    sd_range = None
    if sd > 0.0:
        sd_range = Interval(
            *(sd * sqrt((n - 1) / float(chdtri(n - 1, tail))) for tail in (_TAIL, 1.0 - _TAIL))
        )
    return DayMean(n, mean, sd, _find_mean_range(values, most), sd_range)


def _find_mean_range(values: Sequence[float], most: float, least: float = 0.0) -> Interval | None:
    """Return the range of a mean; a figure that cannot be negative has no negative end."""
    n = len(values)
    if n < 2:
        return None
    mean = float(np.mean(values))
    half = float(stdtrit(n - 1, 1.0 - _TAIL)) * float(np.std(values, ddof=1)) / sqrt(n)
    low = mean - half
    return Interval(max(low, least) if min(values) >= 0.0 else low, min(mean + half, most))


def find_telling(days: DayMean, published_sd: float) -> Telling:
    """Return how many days can detect a change of half the mean, by the person's own deviation if known."""
    own = days.sd if days.days >= LEAST_OWN_DAYS else None
    sd = published_sd if own is None else own
    enough = (k for k in DAYS if find_detectable_change(sd, k) <= WORTHWHILE_SHARE * days.mean)
    needed = next(enough, DAYS[-1])
    most = max(needed, days.days)
    span = days.sd_range if own is not None else None
    return Telling(
        sd,
        "published" if own is None else "person",
        needed,
        max(needed - days.days, 0),
        find_detectable_change(sd, most),
        Interval(*(find_detectable_change(end, most) for end in (span.low, span.high))) if span else None,
    )


def find_detectable_between(sd: float, before_days: int, after_days: int) -> float:
    """Return MDC95 between the means of two numbers of days: 1.96 SD sqrt(1/k1 + 1/k2)."""
    return 1.96 * sd * sqrt(1.0 / before_days + 1.0 / after_days)


@dataclass(frozen=True, slots=True)
class Trend:
    """One person's days in time order, each compared with the first (docs/profile.md).

    ``first``, ``last``, ``change``: the figure on the first and the last day, and the last minus the first.
    ``detectable``: MDC95 between two single days; ``sd_from``: the source of its deviation.
    ``outside``: how many of the later days differ from the first by more.
    """

    first: float
    last: float
    change: float
    detectable: float
    sd_from: Literal["person", "published"]
    outside: int

    @property
    def is_larger(self) -> bool:
        """Whether the last day differs from the first by more than the variation of single days."""
        return abs(self.change) > self.detectable


def find_trend(values: Sequence[float], published_sd: float) -> Trend | None:
    """Compare every day with the first; None for fewer than two.

    The person's own deviation, used from :data:`LEAST_OWN_DAYS` days on, includes the trend itself. It may
    therefore hide a change, but does not create one.
    """
    if len(values) < 2:
        return None
    days = describe_days(values)
    own = days.sd if days.days >= LEAST_OWN_DAYS else None
    detectable = find_detectable_between(published_sd if own is None else own, 1, 1)
    outside = sum(abs(value - values[0]) > detectable for value in values[1:])
    whose: Literal["person", "published"] = "published" if own is None else "person"
    return Trend(values[0], values[-1], values[-1] - values[0], detectable, whose, outside)


def pool_deviation(sides: Sequence[Sequence[float]]) -> tuple[float, int] | None:
    """Return the pooled deviation within several series and its degrees of freedom; None without any."""
    freedom = sum(len(values) - 1 for values in sides if values)
    if freedom < 1:
        return None
    squares = sum(float(np.var(values)) * len(values) for values in sides if values)
    return sqrt(squares / freedom), freedom


def describe_group(people: Mapping[str, Sequence[float]], most: float = inf) -> GroupSpread:
    """Split the variation of a group, given each person's days, into between and within people.

    The mean is the mean of the people's means: each person counts once, however many days they have. No range
    exceeds ``most``, the largest possible value.

    Raises ValueError: there is no day.
    """
    series = [values for values in people.values() if values]
    if not series:
        raise ValueError("no days")
    means = [float(np.mean(values)) for values in series]
    days = sum(map(len, series))
    pooled = pool_deviation(series)
    within_sd = pooled[0] if pooled else None
    between_sd = _find_between(series, within_sd) if within_sd is not None else None
    return GroupSpread(
        len(series), days, float(np.mean(means)), _find_mean_range(means, most), within_sd, between_sd
    )


def _find_between(series: Sequence[Sequence[float]], within_sd: float) -> float | None:
    """Return sqrt((MSB - MSW) / n0), n0 = (N - sum of n squared / N) / (a - 1); 0 if negative."""
    people, days = len(series), sum(map(len, series))
    if people < 2:
        return None
    grand = sum(sum(values) for values in series) / days
    squares = sum(len(values) * (float(np.mean(values)) - grand) ** 2 for values in series)
    typical = (days - sum(len(values) ** 2 for values in series) / days) / (people - 1)
    return sqrt(max((squares / (people - 1) - within_sd**2) / typical, 0.0))


def compare_people(
    before: Mapping[str, Sequence[float]], after: Mapping[str, Sequence[float]]
) -> GroupChange | None:
    """Compare two sides of a group, each person with themselves; None if nobody has days on both."""
    both = [name for name, values in before.items() if values and after.get(name)]
    if not both:
        return None
    first, second = ([float(np.mean(side[name])) for name in both] for side in (before, after))
    changes = [b - a for a, b in zip(first, second, strict=True)]
    span = _find_mean_range(changes, inf, -inf)
    return GroupChange(
        len(both), float(np.mean(first)), float(np.mean(second)), float(np.mean(changes)), span
    )
