"""How far a day's figures could lie from those read off (EXPOSURE.md A12, CONTRACT.md §5 "Interval").

200 draws, each with an error of the angle that shifts the whole histogram, and with 5-minute blocks of the
day drawn again with replacement. The error takes evenly spaced quantiles of a normal distribution and the
blocks a fixed seed, so that the same recording always gives the same interval.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion.conventions import CONVENTIONS
from fusion.exposure.below import sum_below
from fusion.exposure.bins import BIN_EDGES_DEG, PERCENTS, THRESHOLDS_DEG, find_percentile_cells, list_classes
from fusion.exposure.resampling import Resampling, find_ranges, name_intervals, scale_interval
from fusion.exposure.stretches import AnyArray
from fusion.exposure.types import ElevationBin, Interval, TimeAbove, Velocity
from fusion.exposure.velocity import CELL_DPS, COARSE_CELLS, WIDENING, SpeedTally
from fusion.exposure.velocity import PERCENTS as SPEED_PERCENTS

FloatMatrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Draws:
    """Figures of each draw: percent in bins (200, 9), percent above (200, 3), percentiles in deg (200, 9)."""

    bins_percent: FloatMatrix
    above_percent: FloatMatrix
    percentiles_deg: FloatMatrix


def draw_figures(blocks: AnyArray, draws: Resampling) -> Draws:
    """Give the figures of each draw from the blocks' histograms, shape (b, 1800)."""
    day = sum_below(blocks, draws)
    edges_deg = np.array(BIN_EDGES_DEG[1:-1], np.float64)
    below = day.find_shares(edges_deg)
    above = 1.0 - day.find_shares(np.array(THRESHOLDS_DEG, np.float64))
    bins_percent = 100.0 * np.diff(below, prepend=0.0, append=1.0)
    return Draws(bins_percent, 100.0 * above, day.find_percentiles(PERCENTS))


def add_bin_intervals(bins: tuple[ElevationBin, ...], draws: Draws) -> tuple[ElevationBin, ...]:
    """Give each bin the interval of its percentage."""
    intervals = find_ranges(draws.bins_percent)
    return tuple(replace(part, interval=interval) for part, interval in zip(bins, intervals, strict=True))


def add_class_intervals(
    conventions: dict[str, tuple[ElevationBin, ...]], draws: Draws
) -> dict[str, tuple[ElevationBin, ...]]:
    """Give each class of the conventions the interval of its percentage."""
    return {
        convention.key: tuple(
            replace(part, interval=find_ranges(draws.bins_percent[:, inside].sum(axis=1, keepdims=True))[0])
            for part, (_, inside) in zip(conventions[convention.key], list_classes(convention), strict=True)
        )
        for convention in CONVENTIONS
    }


def add_above_intervals(above: tuple[TimeAbove, ...], draws: Draws) -> tuple[TimeAbove, ...]:
    """Give each time above a threshold the interval of its percentage."""
    intervals = find_ranges(draws.above_percent)
    return tuple(replace(part, interval=interval) for part, interval in zip(above, intervals, strict=True))


def name_percentile_intervals(draws: Draws) -> dict[str, Interval]:
    """Give the intervals of the percentiles by the names of their columns: ``elevation_p90_deg``."""
    intervals = find_ranges(draws.percentiles_deg)
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


def _find_speeds(block_s: FloatMatrix) -> FloatMatrix:
    """Give P10, P50, P90 and P99 from cells that widen by 2 %, shape (k, 654): shape (k, 4), deg/s."""
    edges_dps = np.concatenate([[0.0, 0.0], CELL_DPS * WIDENING ** np.arange(1, COARSE_CELLS)])
    places = find_percentile_cells(block_s, np.array(SPEED_PERCENTS, np.float64))
    return np.asarray(np.interp(places, np.arange(len(edges_dps)), edges_dps))
