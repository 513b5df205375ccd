"""The interval of every figure: its range over draws of the day (:mod:`fusion.exposure.resampling`).

The figures of a part of the day (an hour, a period, a task) are drawn from the part's own 5-minute blocks,
those at its edges as long as they are. The interval of a part of one block holds the error of the angle only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from fusion.conventions import CONVENTIONS, MAIN_THRESHOLD_DEG
from fusion.exposure.bins import (
    BIN_EDGES_DEG,
    PERCENTS,
    THRESHOLDS_DEG,
    list_classes,
    sum_groups,
    sum_time,
)
from fusion.exposure.eva import SHAPE
from fusion.exposure.parts import PART_PERCENTS, Group
from fusion.exposure.resampling import (
    DrawnDistribution,
    Figures,
    Resampling,
    can_draw,
    draw_blocks,
    find_intervals,
    sum_below,
)
from fusion.exposure.tally import DayTally, ErrorTally
from fusion.exposure.types import ElevationBin, Exposure, HourVariation, Interval, PartExposure
from fusion.recording import MICROSECONDS, BoolArray, Float64Array, IntArray

LEAST_BIN_DEG = 30.0
"""Bins that begin lower have no range of the pose: the arm in them is hardly raised."""
LEAST_ANALYSED_S = 1800.0
"""Of a clock hour, for it to be compared with the others."""


def add_intervals(exposure: Exposure, day: DayTally, errors: ErrorTally) -> Exposure:
    """Add the intervals of the day and of its parts.

    Where the error of the angle is not known (0) they are of the sampling of the day alone: the extremes of
    a day, which only that error could move, have none, and nothing has one in less than half an hour. Speeds
    have none in so short a time either way.
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
        intervals={name: i for name, i in named.items() if is_told(name, errors.sigma_deg, block_us)},
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
    """Draw what is counted: stays, cycles, windows, rest, changes of direction, speeds."""
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


def is_told(name: str, sigma_deg: float, block_us: IntArray) -> bool:
    """Return whether an interval holds an error of the angle or enough of the day."""
    is_extreme = name.startswith("worst_") or "_longest_" in name  # of the error of the angle alone
    is_of_sampling = "_velocity_" in name or name.startswith("recovery_slow_")  # no error changes it
    return (sigma_deg > 0 or not is_extreme) and (can_draw(block_us, 0.0) or not is_of_sampling)


def _add_part_intervals(exposure: Exposure, day: DayTally, errors: ErrorTally) -> Exposure:
    hour_of, piece_of = day.stretches.hour_of, day.stretches.piece_of
    nothing: tuple[Figures, Figures] = {}, {}

    def draw(part: PartExposure, chosen: BoolArray) -> tuple[Figures, Figures]:
        return _draw_part(day, errors, chosen) if part.analysed_s else nothing

    def add(parts: Sequence[PartExposure], groups: Sequence[Group]) -> tuple[PartExposure, ...]:
        pairs = zip(parts, groups, strict=True)
        return _tell_ranges(parts, [draw(part, np.isin(piece_of, group)) for part, group in pairs])

    by_hour = [draw(hour, hour_of == k) for k, hour in enumerate(exposure.by_hour)]
    varied = draw_variation(exposure.by_hour, [drawn for drawn, _ in by_hour], exposure.hour_variation)
    return replace(
        exposure,
        by_hour=_tell_ranges(exposure.by_hour, by_hour),
        by_period=add(exposure.by_period, day.division.group_by_row()),
        by_task=add(exposure.by_task, day.division.group_by_task()),
        intervals={**exposure.intervals, **find_intervals(varied)},
    )


def _draw_part(day: DayTally, errors: ErrorTally, chosen: BoolArray) -> tuple[Figures, Figures]:
    """Draw the part that the chosen stretches, shape (s,), make up, and with the error of the N-pose.

    Nothing if the error of the angle is not known and the part too short to be drawn again.
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


def _draw_part_figures(part: DrawnDistribution, entries_per_h: Float64Array) -> Figures:
    return {
        **_draw_percentiles(part, PART_PERCENTS),
        **_draw_above(part),
        f"entries_above_{MAIN_THRESHOLD_DEG}_per_h": entries_per_h,
    }


def _tell_ranges(
    parts: Sequence[PartExposure], drawn: Sequence[tuple[Figures, Figures]]
) -> tuple[PartExposure, ...]:
    return tuple(
        replace(part, intervals=find_intervals(*figures)) if figures[0] else part
        for part, figures in zip(parts, drawn, strict=True)
    )


# How the exposure varies from hour to hour.


def describe_hours(hours: Sequence[PartExposure]) -> dict[str, HourVariation]:
    """Compare the clock hours of which half an hour or more was analysed; nothing with fewer than two."""
    kept = [hour for hour in hours if hour.analysed_s >= LEAST_ANALYSED_S]
    if len(kept) < 2:
        return {}
    figures = {
        "elevation_p50_deg": [hour.percentiles_deg[50] for hour in kept],
        "time_above_60_percent": [hour.percent_above[60] for hour in kept],
        "entries_above_60_per_h": [hour.entries_above_60_per_h or 0.0 for hour in kept],
    }
    found = {}
    for name, values in figures.items():
        coefficient, spread, last_less_first = (float(each[0]) for each in _describe(np.array([values])))
        known = None if np.isnan(coefficient) else coefficient
        found[name] = HourVariation(len(values), known, spread, last_less_first)
    return found


def _describe(values: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return coefficient of variation (percent, with the sample's standard deviation; NaN where the mean is
    0), spread, and last less first of rows, shape (d, h).
    """
    mean = values.mean(axis=1)
    mean = np.where(mean > 0, mean, np.nan)
    coefficient = 100.0 * values.std(axis=1, ddof=1) / mean
    return coefficient, values.max(axis=1) - values.min(axis=1), values[:, -1] - values[:, 0]


def draw_variation(
    hours: Sequence[PartExposure], drawn: Sequence[Figures], figures: Mapping[str, HourVariation]
) -> Figures:
    """Draw what differs between the clock hours; ``drawn`` are the figures of each hour.

    Hours drawn again differ by their sampling once more, so that the draws of a spread lie too high: they are
    moved to lie about the figure itself, and not below 0.
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


# Ranges over several readings of one day: no person has said which of them is right.


def widen_over(exposure: Exposure, others: Sequence[Exposure]) -> Exposure:
    """Return the exposure with each range widened to hold the ranges of the same figure in others."""
    widened = _widen(exposure, others)
    assert isinstance(widened, Exposure)
    return widened


def _widen(value: Any, others: Sequence[Any]) -> Any:
    """Return a value whose intervals hold those at the same place in others; places that lack are skipped."""
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
    """Return the interval that holds all of them, also with the error of the N-pose."""
    low, high = min(one.low for one in intervals), max(one.high for one in intervals)
    lows = [one.low_pose for one in intervals if one.low_pose is not None]
    highs = [one.high_pose for one in intervals if one.high_pose is not None]
    return Interval(low, high, min(lows, default=None), max(highs, default=None))
