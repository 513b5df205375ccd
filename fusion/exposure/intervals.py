"""How far a day's figures could lie from those read off (EXPOSURE.md A12, CONTRACT.md §5 "Interval").

200 draws, each with an error of the angle that shifts the whole histogram, and with 5-minute blocks of the
day drawn again with replacement. The error takes evenly spaced quantiles of a normal distribution and the
blocks a fixed seed, so that the same recording always gives the same interval.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion.exposure.bins import (
    BIN_EDGES_DEG,
    CELLS_PER_DEG,
    PERCENTS,
    THRESHOLDS_DEG,
    find_percentile_cells,
)
from fusion.exposure.resampling import (
    BLOCK_US,
    LOW_HIGH_PERCENT,
    Resampling,
    draw_blocks,
    name_intervals,
    scale_interval,
)
from fusion.exposure.types import ElevationBin, Interval, TimeAbove, Velocity
from fusion.exposure.velocity import CELL_DPS, COARSE_CELLS, WIDENING, SpeedTally
from fusion.exposure.velocity import PERCENTS as SPEED_PERCENTS
from fusion.recording import MICROSECONDS

BLOCK_MINUTES = BLOCK_US // (60 * MICROSECONDS)

FloatMatrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Draws:
    """Figures of each draw: percent in bins (200, 9), percent above (200, 3), percentiles in deg (200, 9)."""

    bins_percent: FloatMatrix
    above_percent: FloatMatrix
    percentiles_deg: FloatMatrix


def draw_days(minute_us: NDArray[np.int32] | NDArray[np.int64], bias_sigma_deg: float) -> Draws:
    """Draw 200 days from the minutes' 0.1 deg histograms, shape (m, 1800)."""
    blocks = sum_blocks(minute_us)
    return draw_figures(blocks, draw_blocks(blocks.sum(axis=1), bias_sigma_deg))


def draw_figures(blocks: FloatMatrix, draws: Resampling) -> Draws:
    """Give the figures of each draw from the blocks' histograms, shape (b, 1800)."""
    bias_deg = draws.error_deg
    shares = np.array([_share_below(day) for day in draws.sum(blocks)])
    edges_deg = np.array(BIN_EDGES_DEG[1:-1], np.float64)
    below = _look_up(shares, edges_deg - bias_deg[:, np.newaxis])
    above = 1.0 - _look_up(shares, np.array(THRESHOLDS_DEG) - bias_deg[:, np.newaxis])
    places = np.array([_find_places(share) for share in shares])
    percentiles_deg = np.clip(places + bias_deg[:, np.newaxis], 0.0, 180.0)
    return Draws(100.0 * np.diff(below, prepend=0.0, append=1.0), 100.0 * above, percentiles_deg)


def sum_blocks(minute_us: NDArray[np.int32] | NDArray[np.int64]) -> FloatMatrix:
    """Sum five minutes at a time, shape (b, 1800)."""
    starts = np.arange(0, len(minute_us), BLOCK_MINUTES)
    return np.asarray(np.add.reduceat(minute_us, starts, axis=0, dtype=np.float64))


def _share_below(day: FloatMatrix) -> FloatMatrix:
    """Give the share of time below each edge of the cells, shape (1801,)."""
    ends = np.concatenate([[0.0], np.cumsum(day)])
    return np.asarray(ends / ends[-1])


def _look_up(shares: FloatMatrix, angles_deg: FloatMatrix) -> FloatMatrix:
    """Give each draw's share of time below its angles, linear within a cell."""
    cells_deg = np.arange(shares.shape[1]) / CELLS_PER_DEG
    return np.array([np.interp(row, cells_deg, share) for row, share in zip(angles_deg, shares, strict=True)])


def _find_places(share: FloatMatrix) -> FloatMatrix:
    """Give the angles, deg, at which the share of time below reaches each percentile."""
    wanted = np.array(PERCENTS) / 100.0
    upper = np.searchsorted(share, wanted - 1e-12)
    step = share[upper] - share[upper - 1]
    return np.asarray((upper - 1 + (wanted - share[upper - 1]) / step) / CELLS_PER_DEG)


def _to_intervals(figures: FloatMatrix) -> list[Interval]:
    low, high = np.percentile(figures, LOW_HIGH_PERCENT, axis=0)
    return [Interval(float(a), float(b)) for a, b in zip(low, high, strict=True)]


def add_bin_intervals(bins: tuple[ElevationBin, ...], draws: Draws) -> tuple[ElevationBin, ...]:
    """Give each bin the interval of its percentage."""
    intervals = _to_intervals(draws.bins_percent)
    return tuple(replace(part, interval=interval) for part, interval in zip(bins, intervals, strict=True))


def add_above_intervals(above: tuple[TimeAbove, ...], draws: Draws) -> tuple[TimeAbove, ...]:
    """Give each time above a threshold the interval of its percentage."""
    intervals = _to_intervals(draws.above_percent)
    return tuple(replace(part, interval=interval) for part, interval in zip(above, intervals, strict=True))


def name_percentile_intervals(draws: Draws) -> dict[str, Interval]:
    """Give the intervals of the percentiles by the names of their columns: ``elevation_p90_deg``."""
    intervals = _to_intervals(draws.percentiles_deg)
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
    means = draws.sum(tally.way_deg) / drawn_s.sum(axis=1)
    return name_intervals({**found, f"{kind}_velocity_mean_dps": scale_interval(1.0, means, 1.0)})


def _find_speeds(block_s: FloatMatrix) -> FloatMatrix:
    """Give P10, P50, P90 and P99 from cells that widen by 2 %, shape (k, 654): shape (k, 4), deg/s."""
    edges_dps = np.concatenate([[0.0, 0.0], CELL_DPS * WIDENING ** np.arange(1, COARSE_CELLS)])
    places = find_percentile_cells(block_s, np.array(SPEED_PERCENTS, np.float64))
    return np.asarray(np.interp(places, np.arange(len(edges_dps)), edges_dps))
