"""Compute all figures of a recording from its elevation: one segment at a time, then the day."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, is_dataclass, replace
from datetime import datetime
from functools import partial
from typing import Any, TypeVar

import numpy as np

from acromion.fusion.conventions import CONVENTIONS, MAIN_THRESHOLD_DEG
from acromion.fusion.diary import POSTURES
from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.errors import TooShort
from acromion.fusion.exposure.bins import (
    BIN_EDGES_DEG,
    CELLS,
    PERCENTS,
    THRESHOLDS_DEG,
    PartHistograms,
    Stretches,
    cut_day,
    divide_by_convention,
    find_percentiles,
    list_classes,
    sum_groups,
    sum_time,
    summarise_bins,
    summarise_time_above,
)
from acromion.fusion.exposure.metric_filter import CORNER_HZ, MetricAngle, filter_elevation, is_filtered
from acromion.fusion.exposure.parts import (
    PART_PERCENTS,
    DayDivision,
    Group,
    SecondTally,
    ShiftedSeconds,
    find_peak_windows,
    find_quarter_hours,
    profile_minutes,
    split_hours,
    split_minutes,
    summarise_group,
    summarise_part,
    summarise_parts,
)
from acromion.fusion.exposure.resampling import (
    DrawnDistribution,
    Figures,
    Resampling,
    can_draw,
    draw_blocks,
    find_intervals,
    spread_errors,
    sum_below,
)
from acromion.fusion.exposure.speeds import (
    CycleTally,
    FrequencyTally,
    SpeedTally,
    measure_generalised,
    measure_inclination,
)
from acromion.fusion.exposure.stays import (
    SHAPE,
    SLOW_DPS,
    EvaTally,
    LoweredEntries,
    RecoveryTally,
    ShiftedStays,
    Stays,
    find_longest,
    find_stays,
    summarise_entries,
    summarise_episodes,
    summarise_eva_matrix,
)
from acromion.fusion.exposure.types import (
    LEAST_RANGED_S,
    ElevationBin,
    Entries,
    Episodes,
    Exposure,
    HourVariation,
    Interval,
    PartExposure,
    TimeAbove,
)
from acromion.fusion.recording import MICROSECONDS, BoolArray, Float64Array, IntArray, Recording, Segment
from acromion.fusion.runs import find_end_us, find_valid_samples

# Everything that is counted segment by segment: sums that are filled in place, and stays in time order.

Count = Callable[[], None]

EXACT = np.zeros(1)
"""The errors of the angle if none is known: the angle as measured."""


class SpeedTallies:
    """The four speeds of the day, by their names in results.json, and the rest that the fused speed shows."""

    def __init__(self, errors_deg: Float64Array, stretches: Stretches) -> None:
        """Start with nothing counted."""
        names = ("inclination", "generalised", "generalised_accelerometer", "gyroscope")
        self.kinds = {name: SpeedTally(stretches.block_edges_us) for name in names}
        self.recovery = RecoveryTally(errors_deg, stretches.block_edges_us, stretches.edges_us)

    def add_vertical(self, segment: ElevationSegment, angle: MetricAngle) -> None:
        """Count the speed of the fused vertical, and the rest that it shows."""
        if segment.vertical is None or not is_filtered(segment.rate_hz):
            slow = measure_inclination(angle.elevation_deg, angle.valid, angle.rate_hz) < SLOW_DPS
        else:
            slow = np.zeros(len(angle), np.bool_)
            for first, speeds_dps in measure_generalised(segment, angle.valid):
                self.kinds["generalised"].add(segment, first, speeds_dps, segment.rate_hz)
                slow[first : first + len(speeds_dps)] = speeds_dps < SLOW_DPS
        self.recovery.add(angle, slow)

    def add_samples(self, segment: Segment, gyro_bias_dps: Float64Array | None, valid: BoolArray) -> None:
        """Count the speeds that are computed from the sensor's samples."""
        if is_filtered(segment.rate_hz):
            self.kinds["generalised_accelerometer"].add_accelerometer(segment, valid)
            if gyro_bias_dps is not None:
                self.kinds["gyroscope"].add_gyroscope(segment, gyro_bias_dps, valid)


class ErrorTally:
    """Counts that are repeated with an angle that is slightly too high or too low."""

    def __init__(self, sigma_deg: float, duration_s: int, stretches: Stretches, *, is_npose: bool) -> None:
        """Start with nothing counted."""
        errors_deg = spread_errors(sigma_deg)
        self.sigma_deg = sigma_deg
        self.stays = ShiftedStays(errors_deg, stretches)
        self.seconds = ShiftedSeconds(errors_deg, duration_s)
        self.lowered = LoweredEntries(errors_deg, stretches.edges_us) if is_npose else None

    def add(self, angle: MetricAngle) -> None:
        """Count one segment's angle."""
        self.stays.add(angle)
        self.seconds.add(angle)
        if self.lowered is not None:
            self.lowered.add(angle)


class DayTally:
    """All counts of the day; without a known error of the angle, no figure gets an interval."""

    def __init__(
        self,
        duration_us: int,
        start: datetime | None,
        division: DayDivision,
        bias_sigma_deg: float | None,
        *,
        is_npose: bool,
    ) -> None:
        """Start with nothing counted."""
        self.duration_us, self.division = duration_us, division
        self.hours = split_hours(start, duration_us)
        self.stretches = cut_day(
            split_minutes(duration_us),
            self.hours.edges_us,
            division.list_edges(),
            np.concatenate([division.list_windows().ravel(), division.list_posture_edges()]),
        )
        hours, stretches = len(self.hours.labels), len(self.stretches.minute_of)
        self.by_hour = PartHistograms(self.hours.edges_us, np.zeros((hours, CELLS), np.int64))
        self.by_stretch = PartHistograms(self.stretches.edges_us, np.zeros((stretches, CELLS), np.int32))
        seconds, block_edges_us = -(-duration_us // MICROSECONDS), self.stretches.block_edges_us
        errors_deg, self.errors = EXACT, None
        if bias_sigma_deg is not None:
            errors_deg = spread_errors(bias_sigma_deg)
            self.errors = ErrorTally(bias_sigma_deg, seconds, self.stretches, is_npose=is_npose)
        self.by_second = SecondTally(seconds)
        self.speeds = SpeedTallies(errors_deg, self.stretches)
        self.frequency = FrequencyTally(block_edges_us)
        self.eva = EvaTally(errors_deg, block_edges_us)
        self.cycles = CycleTally(errors_deg, block_edges_us)
        self.stays: dict[int, list[Stays]] = {c: [] for c in THRESHOLDS_DEG}

    def list_counts(self, angle: MetricAngle) -> list[Count]:
        """Return the counts to run on one segment's angle; they fill separate sums, so any order will do."""
        tallies = (self.eva, self.cycles, self.by_hour, self.by_stretch, self.by_second, self.frequency)
        counts: list[Count] = [partial(self._add_stays, angle)]
        if self.errors is not None:
            counts.append(partial(self.errors.add, angle))
        counts += [partial(tally.add, angle) for tally in tallies]
        return [*counts, partial(self.speeds.kinds["inclination"].add_inclination, angle)]

    def _add_stays(self, angle: MetricAngle) -> None:
        for threshold_deg, stays in self.stays.items():
            stays.append(find_stays(angle, threshold_deg))

    def list_entries(self, threshold_deg: int) -> IntArray:
        """Return the times of the entries above a threshold."""
        return np.concatenate([stays.entry_us for stays in self.stays[threshold_deg]])


# The interval of every figure: its range over draws of the day (:mod:`acromion.fusion.exposure.resampling`).
#
# The figures of a part of the day (an hour, a period, a task) are drawn from the part's own 5-minute blocks,
# with shortened blocks at its edges. The interval of a part of one block only includes the error of the
# angle.

LEAST_BIN_DEG = 30.0
"""Bins that start lower have no range of the pose, because the arm is hardly raised in them."""
LESS_REST = f"time_above_{MAIN_THRESHOLD_DEG}_less_rest_percent"
LEAST_ANALYSED_S = 1800.0
"""Least analysed time of a clock hour to compare it with others."""


def add_intervals(exposure: Exposure, day: DayTally, errors: ErrorTally) -> Exposure:
    """Add the intervals of the day and of its parts.

    If the error of the angle is not known (0), they only include the sampling of the day. The extremes of a
    day then have no interval, because only that error could change them. With less than half an hour, no
    figure has an interval. Speeds have none in so short a time even if the error is known.
    """
    blocks = sum_time(day.by_stretch.cell_us, day.stretches.block_of)
    block_us = blocks.sum(axis=1)
    if not can_draw(block_us, errors.sigma_deg):
        return exposure
    block_s, draws = block_us / MICROSECONDS, draw_blocks(block_us, errors.sigma_deg)
    distribution = sum_below(blocks, draws)
    eva_cells, eva_summaries = day.eva.draw(draws)
    shares = draw_shares(distribution)
    drawn = {
        **_draw_percentiles(distribution, PERCENTS),
        **_draw_counts(exposure, day, errors, draws, block_s),
        **eva_summaries,
    }
    raised_shares: Figures = {}
    raised: Figures = {}
    if errors.lowered is not None:
        with_pose = distribution.with_npose_error()
        raised_shares = draw_shares(with_pose)
        raised = _draw_percentiles(with_pose, PERCENTS)
        hours, drawn_h = float(block_s.sum()) / 3600.0, draws.sum(block_s) / 3600.0
        entries = sum_groups(errors.lowered.entries, day.stretches.block_of)
        for c in THRESHOLDS_DEG:
            per_h = errors.lowered.draw(c, entries, with_pose.draws) / drawn_h
            raised |= {f"entries_above_{c}_per_h": per_h, f"entries_above_{c}_count": per_h * hours}
    named = find_intervals(drawn, raised)
    ranges = find_intervals(shares, raised_shares)
    cells, columns = tuple(find_intervals(eva_cells).values()), SHAPE[1]
    of_day = replace(
        exposure,
        bins=_add_ranges("bin", exposure.bins, ranges),
        time_above=tuple(
            replace(above, interval=ranges[f"time_above_{above.threshold_deg}_percent"])
            for above in exposure.time_above
        ),
        conventions={key: _add_ranges(key, bins, ranges) for key, bins in exposure.conventions.items()},
        eva=replace(
            exposure.eva, intervals=tuple(cells[k : k + columns] for k in range(0, len(cells), columns))
        ),
        intervals={
            name: i for name, i in named.items() if has_enough_evidence(name, errors.sigma_deg, block_us)
        },
    )
    return _add_part_intervals(of_day, day, errors)


def draw_shares(distribution: DrawnDistribution) -> Figures:
    """Draw the percent in each bin and class, and above each threshold."""
    below = distribution.find_shares(BIN_EDGES_DEG[1:-1])
    bins = 100.0 * np.diff(below, prepend=0.0, append=1.0)
    return {
        **{f"bin_{k}": bins[:, k] for k in range(bins.shape[1])},
        **{
            f"{convention.key}_{k}": bins[:, inside].sum(axis=1)
            for convention in CONVENTIONS
            for k, (_, inside) in enumerate(list_classes(convention))
        },
        **_draw_above(distribution),
    }


def _draw_above(distribution: DrawnDistribution) -> Figures:
    above = 100.0 * (1.0 - distribution.find_shares(THRESHOLDS_DEG))
    return {f"time_above_{c}_percent": above[:, k] for k, c in enumerate(THRESHOLDS_DEG)}


def _draw_percentiles(distribution: DrawnDistribution, percents: Sequence[int]) -> Figures:
    angles_deg = distribution.find_percentiles(percents)
    return {f"elevation_p{p}_deg": angles_deg[:, k] for k, p in enumerate(percents)}


def _draw_counts(
    exposure: Exposure, day: DayTally, errors: ErrorTally, draws: Resampling, block_s: Float64Array
) -> Figures:
    """Draw all counts: stays, cycles, windows, rest, reversals, speeds."""
    drawn = {
        **errors.stays.draw(exposure.episodes, draws, block_s),
        **errors.stays.draw_busy(day.stretches.sum_minutes(day.by_stretch), draws),
        **day.cycles.draw(draws, block_s),
        **errors.seconds.draw(exposure.peak_windows, draws),
        **day.speeds.recovery.draw(draws, block_s),
    }
    if exposure.frequency is not None:
        drawn |= day.frequency.draw(exposure.frequency, draws, block_s)
    for kind, tally in day.speeds.kinds.items():
        velocity = exposure.velocity_dps[kind]
        if velocity is not None:
            drawn |= tally.draw(kind, velocity, draws)
    return drawn


def _add_ranges(
    name: str, bins: tuple[ElevationBin, ...], ranges: Mapping[str, Interval]
) -> tuple[ElevationBin, ...]:
    found = (ranges[f"{name}_{k}"] for k in range(len(bins)))
    return tuple(
        replace(
            part,
            interval=interval if part.lower_deg >= LEAST_BIN_DEG else Interval(interval.low, interval.high),
        )
        for part, interval in zip(bins, found, strict=True)
    )


def has_enough_evidence(name: str, sigma_deg: float, block_us: IntArray) -> bool:
    """Return whether an interval includes an error of the angle or enough of the day."""
    is_extreme = name.startswith("worst_") or "_longest_" in name  # depends on the error of the angle only
    # does not depend on that error
    is_of_sampling = "_velocity_" in name or name.startswith("recovery_slow_")
    return (sigma_deg > 0 or not is_extreme) and (can_draw(block_us, 0.0) or not is_of_sampling)


def _add_part_intervals(exposure: Exposure, day: DayTally, errors: ErrorTally) -> Exposure:
    hour_of, piece_of = day.stretches.hour_of, day.stretches.piece_of
    nothing: tuple[Figures, Figures] = {}, {}

    def draw(part: PartExposure, chosen: BoolArray) -> tuple[Figures, Figures]:
        return _draw_part(day, errors, chosen) if part.analysed_s else nothing

    def draw_group(part: PartExposure, group: Group) -> tuple[Figures, Figures]:
        chosen = np.isin(piece_of, group)
        figures, raised = draw(part, chosen)
        if not figures:
            return nothing
        figures |= _draw_longest_and_rest(part, day, errors, chosen, group)
        if part.time_above_60_less_rest_percent is not None:
            less, less_raised = _draw_less_rest(figures, raised, day, errors, chosen)
            figures, raised = figures | less, raised | less_raised
        return figures, raised

    def add(parts: Sequence[PartExposure], groups: Sequence[Group]) -> tuple[PartExposure, ...]:
        drawn = [draw_group(part, group) for part, group in zip(parts, groups, strict=True)]
        return _add_ranges_to_parts(parts, drawn)

    posture_of = day.division.find_postures(day.stretches.edges_us[:-1])
    by_posture = [draw(part, posture_of == k) for k, part in zip(PLACES, exposure.by_posture, strict=False)]
    by_hour = [draw(hour, hour_of == k) for k, hour in enumerate(exposure.by_hour)]
    varied = draw_variation(exposure.by_hour, [drawn for drawn, _ in by_hour], exposure.hour_variation)
    return replace(
        exposure,
        by_hour=_add_ranges_to_parts(exposure.by_hour, by_hour),
        by_period=add(exposure.by_period, day.division.group_by_row()),
        by_task=add(exposure.by_task, day.division.group_by_task()),
        by_posture=_add_ranges_to_parts(exposure.by_posture, by_posture),
        intervals={**exposure.intervals, **find_intervals(varied)},
    )


def _draw_part(day: DayTally, errors: ErrorTally, chosen: BoolArray) -> tuple[Figures, Figures]:
    """Draw the part made of the chosen stretches, shape (s,), without and with the error of the N-pose.

    Empty if the error of the angle is not known and the part is too short for resampling.
    """
    block_of, stays = day.stretches.block_of[chosen], errors.stays
    blocks = sum_time(day.by_stretch.cell_us[chosen], block_of)
    block_us = blocks.sum(axis=1)
    if not can_draw(block_us, errors.sigma_deg):
        return {}, {}
    part = sum_below(blocks, draw_blocks(block_us, errors.sigma_deg))
    hours = part.draws.sum(block_us) / (3600.0 * MICROSECONDS)
    entries = sum_groups(stays.pick(stays.entries, MAIN_THRESHOLD_DEG)[:, chosen], block_of)
    drawn = _draw_part_figures(part, part.draws.sum_with_error(entries, stays.errors_deg) / hours)
    if errors.lowered is None:
        return drawn, {}
    raised = part.with_npose_error()
    entries = sum_groups(errors.lowered.entries[..., chosen], block_of)
    entries_per_h = errors.lowered.draw(MAIN_THRESHOLD_DEG, entries, raised.draws) / hours
    return drawn, _draw_part_figures(raised, entries_per_h)


def _draw_longest_and_rest(
    part: PartExposure, day: DayTally, errors: ErrorTally, chosen: BoolArray, group: Group
) -> Figures:
    """Draw the longest episode, with the error of the angle only, and the rest of diary pieces."""
    blocks_of, stays, rest = day.stretches.block_of[chosen], errors.stays, day.speeds.recovery
    block_us = sum_time(day.by_stretch.cell_us[chosen], blocks_of).sum(axis=1)
    draws = draw_blocks(block_us, errors.sigma_deg)
    rest_s = draws.sum_with_error(sum_groups(rest.rest_s[:, chosen], blocks_of), rest.errors_deg)
    analysed_s = draws.sum(block_us) / MICROSECONDS
    drawn = {"recovery_neutral_slow_percent": 100.0 * rest_s / analysed_s}
    if errors.sigma_deg > 0 and part.episodes_above_60_longest_s is not None:
        longest_s = stays.pick(stays.piece_longest_s[:, list(group)].max(axis=1), MAIN_THRESHOLD_DEG)
        drawn[f"episodes_above_{MAIN_THRESHOLD_DEG}_longest_s"] = draws.look_up(longest_s, stays.errors_deg)
    return drawn


def _draw_less_rest(
    task: Figures, raised: Figures, day: DayTally, errors: ErrorTally, chosen: BoolArray
) -> tuple[Figures, Figures]:
    """Draw the difference of a task's time above 60 deg to all other time; each draw has one angle error."""
    name = f"time_above_{MAIN_THRESHOLD_DEG}_percent"
    blocks = sum_time(day.by_stretch.cell_us[~chosen], day.stretches.block_of[~chosen])
    block_us = blocks.sum(axis=1)
    if not can_draw(block_us, errors.sigma_deg):
        return {}, {}
    others = sum_below(blocks, draw_blocks(block_us, errors.sigma_deg))
    less = {LESS_REST: task[name] - _draw_above(others)[name]}
    if not raised:
        return less, {}
    return less, {LESS_REST: raised[name] - _draw_above(others.with_npose_error())[name]}


def _draw_part_figures(part: DrawnDistribution, entries_per_h: Float64Array) -> Figures:
    return {
        **_draw_percentiles(part, PART_PERCENTS),
        **_draw_above(part),
        f"entries_above_{MAIN_THRESHOLD_DEG}_per_h": entries_per_h,
    }


def _add_ranges_to_parts(
    parts: Sequence[PartExposure], drawn: Sequence[tuple[Figures, Figures]]
) -> tuple[PartExposure, ...]:
    return tuple(
        replace(part, intervals=find_intervals(*figures)) if figures[0] else part
        for part, figures in zip(parts, drawn, strict=True)
    )


# Variation of the exposure from hour to hour.


def describe_hours(hours: Sequence[PartExposure]) -> dict[str, HourVariation]:
    """Compare the clock hours with at least half an hour analysed; empty with fewer than two."""
    kept = [hour for hour in hours if hour.analysed_s >= LEAST_ANALYSED_S]
    if len(kept) < 2:
        return {}
    figures = {
        "elevation_p50_deg": [hour.percentiles_deg[50] for hour in kept],
        "time_above_60_percent": [hour.time_above_percent[60] for hour in kept],
        "entries_above_60_per_h": [hour.entries_above_60_per_h or 0.0 for hour in kept],
    }
    found = {}
    for name, values in figures.items():
        coefficient, spread, last_less_first = (float(each[0]) for each in _describe(np.array([values])))
        known = None if np.isnan(coefficient) else coefficient
        found[name] = HourVariation(len(values), known, spread, last_less_first)
    return found


def _describe(values: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return coefficient of variation, spread, and last minus first of rows, shape (d, h).

    The coefficient is in percent, with the sample's standard deviation; NaN if the mean is 0.
    """
    mean = values.mean(axis=1)
    mean = np.where(mean > 0, mean, np.nan)
    coefficient = 100.0 * values.std(axis=1, ddof=1) / mean
    return coefficient, values.max(axis=1) - values.min(axis=1), values[:, -1] - values[:, 0]


def draw_variation(
    hours: Sequence[PartExposure], drawn: Sequence[Figures], figures: Mapping[str, HourVariation]
) -> Figures:
    """Draw the variation between the clock hours; ``drawn``: the figures of each hour.

    Drawn hours also differ by chance, so the drawn spreads are too large. They are lowered until their median
    equals the figure itself, but not below 0.
    """
    kept = [one for hour, one in zip(hours, drawn, strict=True) if hour.analysed_s >= LEAST_ANALYSED_S]
    found: Figures = {}
    for name, figure in figures.items():
        coefficient, spread, last_less_first = _describe(np.stack([part[name] for part in kept], axis=1))
        centred = {
            "coefficient_percent": (coefficient, figure.coefficient_percent),
            "spread": (spread, figure.spread),
        }
        for key, (values, value) in centred.items():
            if value is not None:
                moved = np.maximum(values - np.nanmedian(values) + value, 0.0)
                found[f"by_hour_{name}_{key}"] = moved
        found[f"by_hour_{name}_last_less_first"] = last_less_first
    return found


# Ranges over several readings of one day, if no person has stated which one is right.


def widen_intervals(exposure: Exposure, others: Sequence[Exposure]) -> Exposure:
    """Return the exposure; each range is widened to include the ranges of that figure in ``others``."""
    widened = _widen(exposure, others)
    assert isinstance(widened, Exposure)
    return widened


def _widen(value: Any, others: Sequence[Any]) -> Any:
    """Return a value; its intervals are widened to include those at the same place in ``others``."""
    alike = [other for other in others if type(other) is type(value)]
    if isinstance(value, Interval):
        return join_intervals([value, *alike])
    if isinstance(value, dict):
        return {
            key: _widen(each, [other[key] for other in alike if key in other]) for key, each in value.items()
        }
    if isinstance(value, tuple):
        same = [other for other in alike if len(other) == len(value)]
        return tuple(_widen(each, [other[k] for other in same]) for k, each in enumerate(value))
    if is_dataclass(value) and not isinstance(value, type):
        found = {
            field.name: _widen(getattr(value, field.name), [getattr(other, field.name) for other in alike])
            for field in fields(value)
        }
        changed = {name: each for name, each in found.items() if each is not getattr(value, name)}
        return replace(value, **changed) if changed else value
    return value


def join_intervals(intervals: Sequence[Interval]) -> Interval:
    """Return the interval that includes all of them, also with the error of the N-pose."""
    low, high = min(one.low for one in intervals), max(one.high for one in intervals)
    lows = [one.low_pose for one in intervals if one.low_pose is not None]
    highs = [one.high_pose for one in intervals if one.high_pose is not None]
    return Interval(low, high, min(lows, default=None), max(highs, default=None))


# The figures of the whole day.

Value = TypeVar("Value", ElevationBin, TimeAbove, Entries, Episodes, PartExposure)
UNDIVIDED = DayDivision()
ROWS_FOR_TWO = 100_000
"""Fewer rows are counted before a thread has started."""


def summarise_exposure(
    elevation: Elevation,
    start: datetime | None = None,
    samples: Recording | None = None,
    gyro_bias_dps: Float64Array | None = None,
    bias_sigma_deg: float | None = None,
    *,
    division: DayDivision = UNDIVIDED,
    is_npose: bool = False,
) -> Exposure:
    """Compute how much the arm was raised; only valid rows count.

    Parameters
    ----------
    elevation
        Before the metric filter, which is applied here to each segment at the rate of its rows.
    start
        The clock at the first sample, for the figures by clock hour.
    samples
        The recording of the elevation, for its length and for the two speeds that need samples.
    gyro_bias_dps
        Shape (3,), sensor frame: offset for the gyroscope's speed; without it that speed is None.
    bias_sigma_deg
        Standard deviation of a constant error of the angle (fusion and pose). If 0 (not known), the
        intervals only include the sampling of the day. If None, there are no intervals.
    division
        The periods of the diary, for the figures by period; time that they exclude must not be valid.
    is_npose
        Whether the arm axis is that of the N-pose. Its one-sided error then widens the intervals of time
        above, bins from 30 deg, percentiles and entries (:mod:`acromion.fusion.exposure.resampling`).

    Raises
    ------
    TooShort
        There is no valid row at all.
    """
    ends_us = [find_end_us(segment) for segment in elevation.segments]
    duration_us = max([*ends_us, samples.duration_us if samples else 0, 1])
    day = DayTally(duration_us, start, division, bias_sigma_deg, is_npose=is_npose)
    segments = {segment.start_us: segment for segment in samples.segments} if samples else {}
    for segment in elevation.segments:
        if len(segment) > 0:
            _add_segment(day, segment, segments.get(segment.start_us), gyro_bias_dps)
    filtered = any(is_filtered(segment.rate_hz) for segment in elevation.segments)
    exposure = _summarise_day(day, CORNER_HZ if filtered else None)
    if day.errors is None:
        return exposure
    return replace(add_intervals(exposure, day, day.errors), angle_sigma_deg=bias_sigma_deg)


def _add_segment(
    day: DayTally,
    segment: ElevationSegment,
    sampled: Segment | None,
    gyro_bias_dps: Float64Array | None,
) -> None:
    """Count a segment; its filtered angle, the largest object here, is freed before the next."""
    angle = filter_elevation(segment)
    counts: list[Count] = [partial(day.speeds.add_vertical, segment, angle), *day.list_counts(angle)]
    if sampled is not None and abs(find_end_us(sampled) - find_end_us(segment)) <= 1:
        valid = find_valid_samples(angle.valid, len(sampled))
        counts.insert(1, partial(day.speeds.add_samples, sampled, gyro_bias_dps, valid))
    if len(segment) < ROWS_FOR_TWO:
        for count in counts:
            count()
        return
    with ThreadPoolExecutor(2) as pool:  # two at a time: the kernels release the interpreter lock
        for counted in [pool.submit(count) for count in counts]:
            counted.result()


def _summarise_day(day: DayTally, metric_filter_hz: float | None) -> Exposure:
    cell_us: IntArray = day.by_hour.cell_us.sum(axis=0, dtype=np.int64)
    analysed_s = int(cell_us.sum()) / MICROSECONDS
    if analysed_s == 0.0:
        raise TooShort(s=0.0)
    percentiles_deg = find_percentiles(cell_us)
    minutes = day.stretches.sum_minutes(day.by_stretch)
    by_hour = summarise_parts(day.hours, day.by_hour, day.list_entries(MAIN_THRESHOLD_DEG))
    eva = day.eva.summarise()
    bins = summarise_bins(cell_us)
    exposure = Exposure(
        analysed_s=analysed_s,
        bins=bins,
        time_above=summarise_time_above(cell_us),
        percentiles_deg=percentiles_deg,
        entries=tuple(summarise_entries(c, stays, analysed_s, minutes) for c, stays in day.stays.items()),
        cycles=day.cycles.summarise(),
        episodes=tuple(summarise_episodes(c, stays, analysed_s) for c, stays in day.stays.items()),
        velocity_dps={kind: tally.summarise() for kind, tally in day.speeds.kinds.items()},
        elevation_p99_deg=percentiles_deg[99],
        peak_windows=find_peak_windows(day.by_second.seconds, day.duration_us),
        quarter_hours=find_quarter_hours(day.by_second.seconds, day.duration_us),
        eva=eva,
        by_hour=by_hour,
        by_period=(),
        minutes=profile_minutes(minutes),
        histogram_s=cell_us / MICROSECONDS,
        metric_filter_hz=metric_filter_hz,
        recovery=day.speeds.recovery.summarise(analysed_s),
        frequency=day.frequency.summarise(analysed_s),
        hour_variation=describe_hours(by_hour),
        eva_summary=summarise_eva_matrix(eva),
        conventions={item.key: divide_by_convention(bins, item) for item in CONVENTIONS},
    )
    if day.division.marks:
        exposure = replace(exposure, by_mark=_look_before_marks(day, cell_us))
    if day.division.postures:
        exposure = replace(exposure, by_posture=_divide_by_posture(day))
    return _divide_day(exposure, day) if day.division.pieces else exposure


PLACES = (*range(len(POSTURES)), -1)
"""Places of the postures in the order of ``by_posture``; the last is the time without a posture."""


def _divide_by_posture(day: DayTally) -> tuple[PartExposure, ...]:
    """Return the figures of the time in each posture, then of the time whose posture is not stated."""
    begins_us, entry_us = day.stretches.edges_us[:-1], np.sort(day.list_entries(MAIN_THRESHOLD_DEG))
    posture_of, entered = day.division.find_postures(begins_us), day.division.find_postures(entry_us)
    whole_us, parts = np.array([0, day.duration_us], np.int64), []
    for place in PLACES:
        inside_us: IntArray = day.by_stretch.cell_us[posture_of == place].sum(axis=0, dtype=np.int64)
        part = summarise_part("", whole_us, inside_us, int((entered == place).sum()))
        parts.append(replace(part, kind=POSTURES[place] if place >= 0 else "unstated"))
    return tuple(parts)


def _look_before_marks(day: DayTally, cell_us: IntArray) -> tuple[PartExposure, ...]:
    """Return the figures of the 15 minutes before each mark, then of all other analysed time."""
    begins_us, entry_us = day.stretches.edges_us[:-1], day.list_entries(MAIN_THRESHOLD_DEG)
    is_before = np.zeros(len(begins_us), np.bool_)
    is_early = np.zeros(len(entry_us), np.bool_)
    parts: list[PartExposure] = []
    for mark, edges_us in zip(day.division.marks, day.division.list_windows(), strict=True):
        chosen = (edges_us[0] <= begins_us) & (begins_us < edges_us[1])
        entered = (edges_us[0] <= entry_us) & (entry_us < edges_us[1])
        inside_us: IntArray = day.by_stretch.cell_us[chosen].sum(axis=0, dtype=np.int64)
        parts.append(
            replace(summarise_part(mark.label, edges_us, inside_us, int(entered.sum())), kind="mark")
        )
        is_before |= chosen
        is_early |= entered
    rest_us = cell_us - day.by_stretch.cell_us[is_before].sum(axis=0, dtype=np.int64)
    whole_us = np.array([0, day.duration_us], np.int64)
    rest = summarise_part("", whole_us, rest_us, int((~is_early).sum()))
    return (*parts, replace(rest, kind="rest"))


def _divide_day(exposure: Exposure, day: DayTally) -> Exposure:
    """Add the figures by period and by task of the diary."""
    edges_us, recovery = day.division.list_edges(), day.speeds.recovery
    cell_us = sum_time(day.by_stretch.cell_us, day.stretches.piece_of)
    entries = np.histogram(day.list_entries(MAIN_THRESHOLD_DEG), edges_us)[0]
    stays = day.stays[MAIN_THRESHOLD_DEG]
    start_s, duration_s = (
        np.concatenate([getattr(each, name) for each in stays]) for name in ("start_s", "duration_s")
    )
    longest_s = find_longest(start_s, start_s + duration_s, edges_us)
    measured_s = recovery.rest_s[len(recovery.errors_deg) // 2]
    rest_s = sum_groups(measured_s, day.stretches.piece_of)

    def summarise(groups: tuple[Group, ...]) -> tuple[PartExposure, ...]:
        return tuple(
            summarise_group(day.division, group, cell_us, entries, longest_s, rest_s) for group in groups
        )

    return replace(
        exposure,
        by_period=summarise(day.division.group_by_row()),
        by_task=compare_with_rest(summarise(day.division.group_by_task())),
    )


def compare_with_rest(tasks: Sequence[PartExposure]) -> tuple[PartExposure, ...]:
    """Add each task's share of time above 60 deg minus that of all other analysed time."""

    def find_above_s(part: PartExposure) -> float:
        return part.time_above_percent.get(MAIN_THRESHOLD_DEG, 0.0) / 100.0 * part.analysed_s

    whole_s, above_s = sum(task.analysed_s for task in tasks), sum(map(find_above_s, tasks))
    compared = []
    for task in tasks:
        others_s, less = whole_s - task.analysed_s, None
        if task.analysed_s > 0 and others_s > 1e-6:
            others_percent = 100.0 * (above_s - find_above_s(task)) / others_s
            less = task.time_above_percent[MAIN_THRESHOLD_DEG] - others_percent
        compared.append(replace(task, time_above_60_less_rest_percent=less))
    return tuple(compared)


def remove_short_ranges(exposure: Exposure) -> Exposure:
    """Remove ranges and rates per hour from figures of less than half an hour, including those of parts.

    So little time shows neither how often something happens per hour nor how much hours differ.
    """
    if exposure.analysed_s >= LEAST_RANGED_S:
        return exposure
    recovery, frequency = exposure.recovery, exposure.frequency
    no_rates: dict[str, Any] = {"intervals": {}, "entries_above_60_per_h": None}
    return replace(
        exposure,
        bins=_replace_each(exposure.bins, interval=None),
        time_above=_replace_each(exposure.time_above, interval=None),
        entries=_replace_each(exposure.entries, per_hour=None),
        episodes=_replace_each(exposure.episodes, per_hour=None),
        eva=replace(exposure.eva, intervals=()),
        by_hour=_replace_each(exposure.by_hour, **no_rates),
        by_period=_replace_each(exposure.by_period, **no_rates),
        by_task=_replace_each(exposure.by_task, **no_rates),
        by_mark=_replace_each(exposure.by_mark, **no_rates),
        by_posture=_replace_each(exposure.by_posture, **no_rates),
        intervals={},
        recovery=recovery and replace(recovery, neutral_slow_per_h=None, slow_per_h=None),
        frequency=frequency and replace(frequency, inclination_velocity_zero_crossings_per_h=None),
        conventions={
            key: _replace_each(classes, interval=None) for key, classes in exposure.conventions.items()
        },
    )


def _replace_each(values: tuple[Value, ...], **changes: Any) -> tuple[Value, ...]:
    return tuple(replace(value, **changes) for value in values)
