"""Give every figure of the day its interval (EXPOSURE.md A12, CONTRACT.md §5 "Interval")."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fusion.conventions import CONVENTIONS, MAIN_THRESHOLD_DEG, Convention
from fusion.exposure.bins import (
    BIN_EDGES_DEG,
    CELLS_PER_DEG,
    PERCENTS,
    THRESHOLDS_DEG,
    find_percentile_cells,
    list_classes,
)
from fusion.exposure.episodes import name_busy_intervals, name_stay_intervals
from fusion.exposure.eva import draw_eva
from fusion.exposure.parts import (
    PART_PERCENTS,
    AnyArray,
    Group,
    Stretches,
    sum_groups,
    sum_last_groups,
    sum_time,
)
from fusion.exposure.pose_error import (
    LEAST_BIN_DEG,
    LoweredEntries,
    lower_thresholds,
    raise_angles,
    widen,
)
from fusion.exposure.resampling import (
    Resampling,
    can_draw,
    draw_blocks,
    find_interval,
    find_ranges,
    name_intervals,
    scale_interval,
)
from fusion.exposure.speeds import CELL_DPS, COARSE_CELLS, WIDENING, SpeedTally
from fusion.exposure.speeds import PERCENTS as SPEED_PERCENTS
from fusion.exposure.tally import DayTally, ErrorTally
from fusion.exposure.types import (
    ElevationBin,
    Exposure,
    HourVariation,
    Interval,
    PartExposure,
    TimeAbove,
    Velocity,
)
from fusion.numba_kernels import inner, kernel
from fusion.recording import MICROSECONDS, BoolArray, Float64Array, IntArray

# Shares of time below an angle, and percentiles, of each draw.
#
# The blocks' histograms are cumulated once; the time below an angle in a draw is then a sum over blocks at
# that angle alone. Times are whole microseconds, whose sums are exact in any order.


@dataclass(frozen=True, slots=True, eq=False)
class DrawnDistribution:
    """The time below each edge of the 0.1 deg cells in each block, shape (1801, b), and the draws."""

    below: Float64Array
    draws: Resampling

    def find_shares(self, angles_deg: Float64Array) -> Float64Array:
        """Give the share of each draw's time below angles, shape (k,), read with its errors: (200, k)."""
        error_deg, share = self.draws.error_deg[:, np.newaxis], self.draws.share[:, np.newaxis]
        cells = lower_thresholds(angles_deg - error_deg, share) * CELLS_PER_DEG
        shares = np.empty(cells.shape)
        _read_shares(self.below, self.draws.times, np.clip(cells, 0.0, len(self.below) - 1.0), shares)
        return shares

    def find_percentiles(self, percents: Sequence[int]) -> Float64Array:
        """Give percentiles of each draw, read with its errors and kept inside the scale, shape (200, p)."""
        places = np.empty((len(self.draws.times), len(percents)))
        _find_places(self.below, self.draws.times, np.array(percents) / 100.0, places)
        error_deg, share = self.draws.error_deg[:, np.newaxis], self.draws.share[:, np.newaxis]
        angles_deg = raise_angles(places / CELLS_PER_DEG, share) + error_deg
        return np.clip(angles_deg, 0.0, 180.0)

    def raise_read(self) -> "DrawnDistribution":
        """Give the same with the error of the N-pose in the draws."""
        return replace(self, draws=self.draws.raise_read())


def sum_below(blocks: AnyArray, draws: Resampling) -> DrawnDistribution:
    """Cumulate the histograms of blocks, shape (b, 1800)."""
    kept = blocks[draws.kept]
    below = np.zeros((blocks.shape[1] + 1, len(kept)))
    np.cumsum(kept.T, axis=0, dtype=np.float64, out=below[1:])
    return DrawnDistribution(below, draws)


@inner
def _add_up(below, times):  # type: ignore[no-untyped-def]
    total = 0.0
    for block in range(len(times)):
        total += times[block] * below[block]
    return total


@kernel
def _read_shares(below, times, cells, shares):  # type: ignore[no-untyped-def]
    """Read each draw's share below its places, linear within a cell."""
    for draw in range(len(times)):
        whole = _add_up(below[-1], times[draw])
        for k in range(cells.shape[1]):
            left = min(int(cells[draw, k]), len(below) - 2)
            lower, upper = _add_up(below[left], times[draw]), _add_up(below[left + 1], times[draw])
            shares[draw, k] = (lower + (cells[draw, k] - left) * (upper - lower)) / whole


@kernel
def _find_places(below, times, wanted, places):  # type: ignore[no-untyped-def]
    """Find by halving the cell in which each draw's time below reaches each share, linear within it."""
    for draw in range(len(times)):
        whole = _add_up(below[-1], times[draw])
        for k in range(len(wanted)):
            left, right = 0, len(below) - 1
            lower, upper = 0.0, whole
            while right - left > 1:
                middle = (left + right) // 2
                reached = _add_up(below[middle], times[draw])
                # a trillionth of the whole keeps a sum that should be equal from being a hair too small
                if reached >= whole * (wanted[k] - 1e-12):
                    right, upper = middle, reached
                else:
                    left, lower = middle, reached
            places[draw, k] = left + (whole * wanted[k] - lower) / (upper - lower)


# The figures of a day in each draw (:mod:`fusion.exposure.resampling`): an error of the angle shifts the
# whole histogram, and 5-minute blocks of the day are drawn with replacement.


@dataclass(frozen=True, slots=True, eq=False)
class Draws:
    """Figures of each draw: percent in bins (200, 9), percent above (200, 3), percentiles in deg (200, 9)."""

    bins_percent: Float64Array
    above_percent: Float64Array
    percentiles_deg: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class DrawnDay:
    """The figures of the draws, and with the error of the N-pose, where that was the pose."""

    draws: Draws
    raised: Draws | None = None

    def find_ranges(self, pick: Callable[[Draws], Float64Array]) -> list[Interval]:
        """Give the interval of each column of figures, shape (200, k)."""
        intervals = find_ranges(pick(self.draws))
        if self.raised is None:
            return intervals
        pairs = zip(intervals, find_ranges(pick(self.raised)), strict=True)
        return [widen(interval, raised) for interval, raised in pairs]


def draw_day(blocks: AnyArray, draws: Resampling, *, is_npose: bool) -> DrawnDay:
    """Draw a day from the blocks' histograms, shape (b, 1800)."""
    day = sum_below(blocks, draws)
    return DrawnDay(draw_figures(day), draw_figures(day.raise_read()) if is_npose else None)


def draw_figures(day: DrawnDistribution) -> Draws:
    """Give the figures of each draw."""
    edges_deg = np.array(BIN_EDGES_DEG[1:-1], np.float64)
    below = day.find_shares(edges_deg)
    above = 1.0 - day.find_shares(np.array(THRESHOLDS_DEG, np.float64))
    bins_percent = 100.0 * np.diff(below, prepend=0.0, append=1.0)
    return Draws(bins_percent, 100.0 * above, day.find_percentiles(PERCENTS))


def add_bin_intervals(bins: tuple[ElevationBin, ...], day: DrawnDay) -> tuple[ElevationBin, ...]:
    """Give each bin the interval of its percentage."""
    intervals = day.find_ranges(lambda draws: draws.bins_percent)
    return tuple(_add_range(part, interval) for part, interval in zip(bins, intervals, strict=True))


def _add_range(part: ElevationBin, interval: Interval) -> ElevationBin:
    if part.lower_deg < LEAST_BIN_DEG:
        interval = Interval(interval.low, interval.high)
    return replace(part, interval=interval)


def add_class_intervals(
    conventions: dict[str, tuple[ElevationBin, ...]], day: DrawnDay
) -> dict[str, tuple[ElevationBin, ...]]:
    """Give each class of the conventions the interval of its percentage."""
    return {
        convention.key: tuple(
            _add_range(part, interval)
            for part, interval in zip(
                conventions[convention.key], _find_class_ranges(convention, day), strict=True
            )
        )
        for convention in CONVENTIONS
    }


def _find_class_ranges(convention: Convention, day: DrawnDay) -> list[Interval]:
    classes = [inside for _, inside in list_classes(convention)]
    return day.find_ranges(
        lambda draws: np.stack([draws.bins_percent[:, inside].sum(axis=1) for inside in classes], axis=1)
    )


def add_above_intervals(above: tuple[TimeAbove, ...], day: DrawnDay) -> tuple[TimeAbove, ...]:
    """Give each time above a threshold the interval of its percentage."""
    intervals = day.find_ranges(lambda draws: draws.above_percent)
    return tuple(replace(part, interval=interval) for part, interval in zip(above, intervals, strict=True))


def name_percentile_intervals(day: DrawnDay) -> dict[str, Interval]:
    """Give the intervals of the percentiles by the names of their columns: ``elevation_p90_deg``."""
    intervals = day.find_ranges(lambda draws: draws.percentiles_deg)
    return {f"elevation_p{p}_deg": interval for p, interval in zip(PERCENTS, intervals, strict=True)}


def name_speed_intervals(
    kind: str, velocity: Velocity | None, tally: SpeedTally, draws: Resampling
) -> dict[str, Interval]:
    """Give the intervals of one kind of speed by the names of their columns.

    They cover the sampling of the day; a constant error of the angle does not change its speed.
    """
    if velocity is None:
        return {}
    drawn_s = draws.sum(tally.block_s)
    drawn = _find_speeds(drawn_s)
    coarse = _find_speeds(tally.block_s.sum(axis=0)[np.newaxis])[0]
    values = {10: velocity.p10_dps, 50: velocity.p50_dps, 90: velocity.p90_dps, 99: velocity.p99_dps}
    found = {
        f"{kind}_velocity_p{p}_dps": scale_interval(value, drawn[:, k], coarse[k])
        for k, (p, value) in enumerate(values.items())
    }
    total_s = drawn_s.sum(axis=1)
    lacking = np.full(len(total_s), np.nan)  # a draw of nothing but short pieces has no speed
    means = np.divide(draws.sum(tally.way_deg), total_s, out=lacking, where=total_s > 0.0)
    return name_intervals({**found, f"{kind}_velocity_mean_dps": scale_interval(1.0, means, 1.0)})


def _find_speeds(block_s: Float64Array) -> Float64Array:
    """Give P10, P50, P90 and P99 from cells that widen by 2 %, shape (k, 654): shape (k, 4), deg/s."""
    edges_dps = np.concatenate([[0.0, 0.0], CELL_DPS * WIDENING ** np.arange(1, COARSE_CELLS)])
    places = find_percentile_cells(block_s, np.array(SPEED_PERCENTS, np.float64))
    return np.asarray(np.interp(places, np.arange(len(edges_dps)), edges_dps))


# How the exposure varies from hour to hour (EXPOSURE.md A8).


LEAST_ANALYSED_S = 1800.0


def is_compared(hour: PartExposure) -> bool:
    """Whether half an hour or more of a clock hour was analysed."""
    return hour.analysed_s >= LEAST_ANALYSED_S


def describe_hours(hours: Sequence[PartExposure]) -> dict[str, HourVariation]:
    """Compare the clock hours of which half an hour or more was analysed; nothing with fewer than two."""
    kept = [hour for hour in hours if is_compared(hour)]
    if len(kept) < 2:
        return {}
    return {
        "elevation_p50_deg": _describe([hour.percentiles_deg[50] for hour in kept]),
        "time_above_60_percent": _describe([hour.percent_above[60] for hour in kept]),
        "entries_above_60_per_h": _describe([hour.entries_above_60_per_h or 0.0 for hour in kept]),
    }


def _describe(values: list[float]) -> HourVariation:
    """Coefficient of variation with the sample's standard deviation; None where the mean is 0."""
    coefficient, spread, last_less_first = (
        float(figure[0]) for figure in describe_values(np.array([values]))
    )
    return HourVariation(
        hours=len(values),
        coefficient_percent=None if np.isnan(coefficient) else coefficient,
        spread=spread,
        last_less_first=last_less_first,
    )


def describe_values(values: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Give coefficient (percent; NaN where the mean is 0), spread, and last less first of rows, (d, h)."""
    mean = values.mean(axis=1)
    mean = np.where(mean > 0, mean, np.nan)
    coefficient = 100.0 * values.std(axis=1, ddof=1) / mean
    return coefficient, values.max(axis=1) - values.min(axis=1), values[:, -1] - values[:, 0]


# The figures of a part of the day in each draw: an hour, a period, a task.
#
# As for the day, but from the part's own 5-minute blocks, those at its edges as long as they are. The
# interval of a part of one block is of the error of the angle alone.


DrawnFigures = dict[str, Float64Array]
"""Each figure of a part in every draw, shape (200,), by its name."""


@dataclass(frozen=True, slots=True)
class DrawnPart:
    """The figures of a part, and with the error of the N-pose; empty where there are none."""

    figures: DrawnFigures = field(default_factory=dict)
    raised: DrawnFigures = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class PartDrawer:
    """What parts are drawn from: the cells of the stretches, shape (s, 1800), and their entries above 60 deg
    at each error of the angle, shapes (g, s) and (g,); of the N-pose also the entries at lowered triggers.
    """

    stretches: Stretches
    cell_us: NDArray[np.int32] | IntArray
    entries: Float64Array
    errors_deg: Float64Array
    sigma_deg: float
    lowered: LoweredEntries | None = None

    def draw(self, chosen: BoolArray) -> DrawnPart:
        """Draw the part that the chosen stretches make up; ``chosen`` has shape (s,). Empty where the error
        of the angle is not known and the part too short to be drawn again.
        """
        block_of = self.stretches.block_of[chosen]
        blocks = sum_time(self.cell_us[chosen], block_of)
        block_us = blocks.sum(axis=1)
        if not can_draw(block_us, self.sigma_deg):
            return DrawnPart()
        part = sum_below(blocks, draw_blocks(block_us, self.sigma_deg))
        hours = part.draws.sum(block_us) / (3600.0 * MICROSECONDS)
        entries = sum_groups(self.entries[:, chosen].T, block_of).T
        figures = _name_drawn(part, part.draws.sum_with_error(entries, self.errors_deg) / hours)
        if self.lowered is None:
            return DrawnPart(figures)
        raised = part.raise_read()
        entries = sum_last_groups(self.lowered.entries[..., chosen], block_of)
        drawn = self.lowered.draw(MAIN_THRESHOLD_DEG, entries, raised.draws)
        return DrawnPart(figures, _name_drawn(raised, drawn / hours))


def _name_drawn(part: DrawnDistribution, entries_per_h: Float64Array) -> DrawnFigures:
    percentiles_deg = part.find_percentiles(PART_PERCENTS)
    above = 100.0 * (1.0 - part.find_shares(np.array(THRESHOLDS_DEG, np.float64)))
    return {
        **{f"elevation_p{p}_deg": percentiles_deg[:, k] for k, p in enumerate(PART_PERCENTS)},
        **{f"time_above_{c}_percent": above[:, k] for k, c in enumerate(THRESHOLDS_DEG)},
        "entries_above_60_per_h": entries_per_h,
    }


def find_part_intervals(drawn: DrawnPart) -> dict[str, Interval]:
    """Give the interval of each figure of a part."""
    intervals = _name_ranges(drawn.figures)
    raised = _name_ranges(drawn.raised)
    return {name: widen(interval, raised.get(name)) for name, interval in intervals.items()}


def _name_ranges(drawn: DrawnFigures) -> dict[str, Interval]:
    if not drawn:
        return {}
    return dict(zip(drawn, find_ranges(np.stack(list(drawn.values()), axis=1)), strict=True))


def name_variation_intervals(
    hours: Sequence[PartExposure],
    drawn: Sequence[DrawnFigures],
    figures: Mapping[str, HourVariation],
) -> dict[str, Interval]:
    """Give the intervals of what differs between the clock hours; ``drawn`` are the figures of each hour.

    Hours drawn again differ by their sampling once more, so that the draws of a spread lie too high: they are
    moved to lie about the figure itself, and not below 0.
    """
    kept = [figure for hour, figure in zip(hours, drawn, strict=True) if is_compared(hour)]
    found: dict[str, Interval] = {}
    for name, figure in figures.items():
        values = np.stack([part[name] for part in kept], axis=1)
        coefficient, spread, last_less_first = describe_values(values)
        intervals = {
            "coefficient_percent": _centre(coefficient, figure.coefficient_percent),
            "spread": _centre(spread, figure.spread),
            "last_less_first": find_interval(last_less_first),
        }
        found |= {f"by_hour_{name}_{key}": interval for key, interval in intervals.items() if interval}
    return found


def _centre(drawn: Float64Array, value: float | None) -> Interval | None:
    if value is None:
        return None
    return find_interval(np.maximum(drawn - np.nanmedian(drawn) + value, 0.0))


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
    figures = draw_day(blocks, draws, is_npose=errors.lowered is not None)
    eva = draw_eva(day.eva, draws)
    named = {
        **name_percentile_intervals(figures),
        **_name_counts(exposure, day, errors, draws, block_us / MICROSECONDS),
        **eva.name_summaries(),
    }
    of_day = replace(
        exposure,
        bins=add_bin_intervals(exposure.bins, figures),
        time_above=add_above_intervals(exposure.time_above, figures),
        conventions=add_class_intervals(exposure.conventions, figures),
        eva=replace(exposure.eva, intervals=eva.find_cells()),
        intervals=_leave_out_empty(named, errors.sigma_deg, block_us),
    )
    return _add_part_intervals(of_day, day, errors)


def _leave_out_empty(named: dict[str, Interval], sigma_deg: float, block_us: IntArray) -> dict[str, Interval]:
    """Leave out intervals that would hold neither an error of the angle nor enough of the day."""
    kept = named if sigma_deg > 0 else {name: i for name, i in named.items() if not is_extreme(name)}
    if can_draw(block_us, 0.0):
        return kept
    return {name: interval for name, interval in kept.items() if not is_of_sampling(name)}


def is_extreme(name: str) -> bool:
    """Whether a figure is the extreme of a day, whose interval holds the error of the angle alone."""
    return name.startswith("worst_") or "_longest_" in name


def is_of_sampling(name: str) -> bool:
    """Whether the error of the angle does not change a figure: its interval is of the sampling alone."""
    return "_velocity_" in name or name.startswith("recovery_slow_")


def _name_counts(
    exposure: Exposure, day: DayTally, errors: ErrorTally, draws: Resampling, block_s: Float64Array
) -> dict[str, Interval]:
    """Name the intervals of what is counted: stays, cycles, windows, rest, changes of direction, speeds."""
    minutes = day.stretches.sum_minutes(day.by_stretch)
    stays = name_stay_intervals(errors.stays, exposure.episodes, draws, block_s)
    if errors.lowered is not None:
        stays |= _widen_entries(stays, errors.lowered, day.stretches, draws, block_s)
    named = {
        **stays,
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


def _widen_entries(
    stays: dict[str, Interval],
    lowered: LoweredEntries,
    stretches: Stretches,
    draws: Resampling,
    block_s: Float64Array,
) -> dict[str, Interval]:
    """Add the error of the N-pose to the intervals of the entries; ``block_s``, shape (b,)."""
    raised = draws.raise_read()
    hours, drawn_h = float(block_s.sum()) / 3600.0, draws.sum(block_s) / 3600.0
    entries = sum_last_groups(lowered.entries, stretches.block_of)
    found: dict[str, Interval] = {}
    for c in THRESHOLDS_DEG:
        per_h = lowered.draw(c, entries, raised) / drawn_h
        for name, drawn in ((f"entries_above_{c}_per_h", per_h), (f"entries_above_{c}_count", per_h * hours)):
            if name in stays:
                found[name] = widen(stays[name], find_interval(drawn))
    return found


def _add_part_intervals(exposure: Exposure, day: DayTally, errors: ErrorTally) -> Exposure:
    drawer = PartDrawer(
        day.stretches,
        day.by_stretch.cell_us,
        errors.stays.pick(errors.stays.entries, MAIN_THRESHOLD_DEG),
        errors.stays.errors_deg,
        errors.sigma_deg,
        errors.lowered,
    )
    hour_of, piece_of = day.stretches.hour_of, day.stretches.piece_of
    by_hour = [
        drawer.draw(hour_of == k) if hour.analysed_s else DrawnPart()
        for k, hour in enumerate(exposure.by_hour)
    ]

    def add(parts: Sequence[PartExposure], groups: Sequence[Group]) -> tuple[PartExposure, ...]:
        drawn = (
            drawer.draw(np.isin(piece_of, group)) if part.analysed_s else DrawnPart()
            for part, group in zip(parts, groups, strict=True)
        )
        return _tell_ranges(parts, list(drawn))

    figures = [hour.figures for hour in by_hour]
    varied = name_variation_intervals(exposure.by_hour, figures, exposure.hour_variation)
    return replace(
        exposure,
        by_hour=_tell_ranges(exposure.by_hour, by_hour),
        by_period=add(exposure.by_period, day.division.group_by_row()),
        by_task=add(exposure.by_task, day.division.group_by_task()),
        intervals={**exposure.intervals, **varied},
    )


def _tell_ranges(parts: Sequence[PartExposure], drawn: Sequence[DrawnPart]) -> tuple[PartExposure, ...]:
    return tuple(
        replace(part, intervals=find_part_intervals(one)) if one.figures else part
        for part, one in zip(parts, drawn, strict=True)
    )
