"""Several days of a person, and of a group: overlaid by clock time, with the variation between them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from math import inf, isfinite, sqrt
from typing import Literal

import numpy as np
from scipy.special import chdtri, fdtri, stdtrit

from acromion.fusion.clocks import list_zone_changes
from acromion.fusion.comparison.change import find_detectable_change
from acromion.fusion.elevation import Elevation
from acromion.fusion.exposure.bins import CELLS, CELLS_PER_DEG, find_percentiles
from acromion.fusion.exposure.metric_filter import filter_elevation
from acromion.fusion.exposure.types import Interval
from acromion.fusion.recording import MICROSECONDS, Float64Array

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
    ``within_range``, ``between_range``: the 95 % ranges of both deviations; None if unknown.
    """

    people: int
    days: int
    mean: float
    mean_range: Interval | None
    within_sd: float | None
    between_sd: float | None
    within_range: Interval | None = None
    between_range: Interval | None = None


@dataclass(frozen=True, slots=True)
class GroupChange:
    """After minus before, of the people with days on both sides, each person once.

    ``people``: their number.
    ``before``, ``after``: means of the people's means.
    ``change``: mean of the people's changes.
    ``change_range``: its 95 % range, t with people - 1 degrees of freedom; None for one person.
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
    return DayMean(n, mean, sd, _find_mean_range(values, most), _find_deviation_range(sd, n - 1))


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

    The mean is the mean of the people's means: each person counts once, however many days they have. With a
    people, N days, n days of a person, and the mean squares MSB and MSW between and within people, the
    variances are MSW and (MSB - MSW) / n0, n0 = (N - sum of n squared / N) / (a - 1) (Searle, Casella and
    McCulloch 1992, doi:10.1002/9780470316856). The range of the first is SSW / chi square. The ends of the
    second are (a - 1) (S2 - F MSW) / (h chi square), with the harmonic mean h of n and S2 = h times the
    variance of the people's means (Williams 1962, Biometrika 49:278; for unequal n approximate: Thomas and
    Hultquist 1978, doi:10.1214/aos/1176344202). Days of one person are treated as independent, and the figure
    as normal.

    Parameters
    ----------
    people
        The values of each person's days, by the code of the person (:func:`acromion.list_days`).
    most
        The largest possible value, such as 100 for a share; no range exceeds it.

    Returns
    -------
    GroupSpread
        The mean and the deviations, each with its range.

    Raises
    ------
    ValueError
        There is no day, or a value is missing or infinite.
    """
    _check_finite(people)
    series = [values for values in people.values() if values]
    if not series:
        raise ValueError("no days")
    means = [float(np.mean(values)) for values in series]
    days = sum(map(len, series))
    pooled = pool_deviation(series)
    mean, mean_range = float(np.mean(means)), _find_mean_range(means, most)
    if pooled is None:
        return GroupSpread(len(series), days, mean, mean_range, None, None)
    within_sd, freedom = pooled
    return GroupSpread(
        len(series),
        days,
        mean,
        mean_range,
        within_sd,
        _find_between(series, within_sd),
        _find_deviation_range(within_sd, freedom),
        _find_between_range(series, within_sd, freedom),
    )


def _check_finite(people: Mapping[str, Sequence[float]], name: str = "people") -> None:
    """Raise ValueError that names the person with a value that is missing or infinite."""
    for person, values in people.items():
        wrong = [value for value in values if not isfinite(value)]
        if wrong:
            raise ValueError(
                f"{name}: {person} has a day with the value {wrong[0]}; omit days without a figure"
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


def _find_deviation_range(sd: float, freedom: int) -> Interval | None:
    """Return the range of a deviation by chi square; None if it is 0."""
    if sd <= 0.0:
        return None
    low, high = (sd * sqrt(freedom / float(chdtri(freedom, tail))) for tail in (_TAIL, 1.0 - _TAIL))
    return Interval(low, high)


def _find_between_range(series: Sequence[Sequence[float]], within_sd: float, freedom: int) -> Interval | None:
    """Return the range of the deviation between people by the formula of :func:`describe_group`.

    None if the means differ so little that both ends are 0: the model does not fit.
    """
    others = len(series) - 1
    if others < 1:
        return None
    typical = len(series) / sum(1.0 / len(values) for values in series)
    mean_square = typical * float(np.var([float(np.mean(values)) for values in series], ddof=1))
    low, high = (
        sqrt(
            max(mean_square - float(fdtri(others, freedom, 1.0 - tail)) * within_sd**2, 0.0)
            * others
            / (typical * float(chdtri(others, tail)))
        )
        for tail in (_TAIL, 1.0 - _TAIL)
    )
    return Interval(low, high) if high > 0.0 else None


@dataclass(frozen=True, slots=True)
class Design:
    """A plan of measurements.

    ``people``: number of people.
    ``days``: days of each person.
    ``margin``: expected half width of the 95 % range of the mean, in the figure's own unit.
    """

    people: int
    days: int
    margin: float


def find_designs(
    within_sd: float,
    between_sd: float,
    margin: float,
    days: Sequence[int] = DAYS,
    of: Literal["mean", "change"] = "mean",
) -> tuple[Design, ...]:
    """Return the fewest people for each number of days whose mean is within a margin.

    The half width is t(people - 1) sqrt(V / people). V, the variance of one person's value, is
    between_sd**2 + within_sd**2 / days for a mean (Mathiassen, Möller and Forsman 2003,
    doi:10.1080/0014013031000090125), and 2 within_sd**2 / days for the change of people who are measured on
    ``days`` days before it and after it, because a person's own level cancels.

    Parameters
    ----------
    within_sd, between_sd
        Deviations between the days of one person, and between people, of a pilot study
        (:func:`acromion.describe_group`). ``between_sd`` is not used for a change.
    margin
        Wanted half width of the 95 % range, in the unit of the deviations.
    days
        Days of each person to compare.
    of
        "mean" of a group, or "change" of the same people.

    Returns
    -------
    tuple of Design
        One for each number of days. A pilot's deviations are uncertain: also try the ends of their ranges.

    Raises
    ------
    ValueError
        A deviation is negative, the margin is not positive, one of them is missing or infinite, there is no
        number of days, or one is less than 1.
    """
    for name, sd in (("within_sd", within_sd), ("between_sd", between_sd)):
        if not (isfinite(sd) and sd >= 0.0):
            raise ValueError(f"{name}: {sd}; allowed: a number of 0 or more")
    if not (isfinite(margin) and margin > 0.0):
        raise ValueError(f"margin: {margin}; allowed: a number above 0")
    if of not in ("mean", "change"):
        raise ValueError(f"of: {of}; allowed: mean, change")
    if not days or any(not isfinite(number) or number < 1 or number % 1 for number in days):
        raise ValueError(f"days: {days}; allowed: whole numbers of 1 or more")
    designs = []
    for number in days:
        variance = 2 * within_sd**2 / number if of == "change" else between_sd**2 + within_sd**2 / number
        people = max(int(1.96**2 * variance / margin**2), 2)
        while (half := float(stdtrit(people - 1, 1.0 - _TAIL)) * sqrt(variance / people)) > margin:
            people += 1
        designs.append(Design(people, number, half))
    return tuple(designs)


def compare_people(
    before: Mapping[str, Sequence[float]], after: Mapping[str, Sequence[float]]
) -> GroupChange | None:
    """Compare two sides of a group, each person with themselves: the person is the unit, not the recording.

    A paired t test of the people's means (Student 1908, doi:10.1093/biomet/6.1.1).

    Parameters
    ----------
    before, after
        The values of each person's days, by the code of the person (:func:`acromion.list_days`).

    Returns
    -------
    GroupChange or None
        The mean change of the people with days on both sides; None if nobody has.

    Raises
    ------
    ValueError
        A value is missing or infinite.
    """
    _check_finite(before, "before")
    _check_finite(after, "after")
    both = [name for name, values in before.items() if values and after.get(name)]
    if not both:
        return None
    first, second = ([float(np.mean(side[name])) for name in both] for side in (before, after))
    changes = [b - a for a, b in zip(first, second, strict=True)]
    span = _find_mean_range(changes, inf, -inf)
    return GroupChange(
        len(both), float(np.mean(first)), float(np.mean(second)), float(np.mean(changes)), span
    )
