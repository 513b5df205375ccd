"""Give every figure of the day its interval (EXPOSURE.md A12, CONTRACT.md §5 "Interval")."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fusion.exposure.by_period import Group
from fusion.exposure.eva import draw_eva
from fusion.exposure.intervals import (
    add_above_intervals,
    add_bin_intervals,
    add_class_intervals,
    draw_figures,
    name_percentile_intervals,
    name_speed_intervals,
)
from fusion.exposure.part_draws import (
    DrawnFigures,
    PartDrawer,
    find_part_intervals,
    name_variation_intervals,
)
from fusion.exposure.resampling import Resampling, can_draw, draw_blocks
from fusion.exposure.shifted_stays import name_busy_intervals, name_stay_intervals
from fusion.exposure.stretches import sum_time
from fusion.exposure.tally import DayTally, ErrorTally
from fusion.exposure.types import Exposure, Interval, PartExposure
from fusion.recording import MICROSECONDS

MAIN_THRESHOLD_DEG = 60


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
    draws = draw_blocks(block_us, errors.sigma_deg)
    figures = draw_figures(blocks, draws)
    eva = draw_eva(day.eva, draws)
    named = {
        **name_percentile_intervals(figures),
        **_name_counts(exposure, day, errors, draws, block_us / MICROSECONDS),
        **eva.name_summaries(),
    }
    told = replace(
        exposure,
        bins=add_bin_intervals(exposure.bins, figures),
        time_above=add_above_intervals(exposure.time_above, figures),
        conventions=add_class_intervals(exposure.conventions, figures),
        eva=replace(exposure.eva, intervals=eva.find_cells()),
        intervals=_leave_out_empty(named, errors.sigma_deg, block_us),
    )
    return _add_part_intervals(told, day, errors)


def _leave_out_empty(
    named: dict[str, Interval], sigma_deg: float, block_us: NDArray[np.int64]
) -> dict[str, Interval]:
    """Leave out intervals that would hold neither an error of the angle nor enough of the day."""
    kept = named if sigma_deg > 0 else {name: i for name, i in named.items() if not is_extreme(name)}
    if can_draw(block_us, 0.0):
        return kept
    return {name: interval for name, interval in kept.items() if not is_of_sampling(name)}


def is_extreme(name: str) -> bool:
    """Tell whether a figure is the extreme of a day, whose interval holds the error of the angle alone."""
    return name.startswith("worst_") or "_longest_" in name


def is_of_sampling(name: str) -> bool:
    """Tell whether a figure knows no error of the angle: its interval holds the sampling of the day alone."""
    return "_velocity_" in name or name.startswith("recovery_slow_")


def _name_counts(
    exposure: Exposure, day: DayTally, errors: ErrorTally, draws: Resampling, block_s: NDArray[np.float64]
) -> dict[str, Interval]:
    """Name the intervals of what is counted: stays, cycles, windows, rest, changes of direction, speeds."""
    minutes = day.stretches.sum_minutes(day.by_stretch)
    named = {
        **name_stay_intervals(errors.stays, exposure.episodes, draws, block_s),
        **name_busy_intervals(errors.stays, minutes, draws),
        **day.cycles.name_intervals(draws, block_s),
        **errors.seconds.name_intervals(exposure.peak_windows, draws),
        **day.speeds.recovery.name_intervals(draws, block_s),
    }
    if exposure.frequency is not None:
        named |= day.frequency.name_intervals(exposure.frequency, draws, block_s)
    for kind, tally in day.speeds.list_kinds().items():
        named |= name_speed_intervals(kind, exposure.velocity_dps[kind], tally, draws)
    return named


def _add_part_intervals(exposure: Exposure, day: DayTally, errors: ErrorTally) -> Exposure:
    drawer = PartDrawer(
        day.stretches,
        day.by_stretch.cell_us,
        errors.stays.pick(errors.stays.entries, MAIN_THRESHOLD_DEG),
        errors.stays.errors_deg,
        errors.sigma_deg,
    )
    hour_of, piece_of = day.stretches.hour_of, day.stretches.piece_of
    by_hour = [
        drawer.draw(hour_of == k) if hour.analysed_s else {} for k, hour in enumerate(exposure.by_hour)
    ]

    def add(parts: Sequence[PartExposure], groups: Sequence[Group]) -> tuple[PartExposure, ...]:
        drawn = (
            drawer.draw(np.isin(piece_of, group)) if part.analysed_s else {}
            for part, group in zip(parts, groups, strict=True)
        )
        return _tell_ranges(parts, list(drawn))

    varied = name_variation_intervals(exposure.by_hour, by_hour, exposure.hour_variation)
    return replace(
        exposure,
        by_hour=_tell_ranges(exposure.by_hour, by_hour),
        by_period=add(exposure.by_period, day.division.group_by_row()),
        by_task=add(exposure.by_task, day.division.group_by_task()),
        intervals={**exposure.intervals, **varied},
    )


def _tell_ranges(parts: Sequence[PartExposure], drawn: Sequence[DrawnFigures]) -> tuple[PartExposure, ...]:
    return tuple(
        replace(part, intervals=find_part_intervals(figures)) if figures else part
        for part, figures in zip(parts, drawn, strict=True)
    )
