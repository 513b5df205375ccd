"""How far the figures of two arms could lie from those read off: ranges as those of a day (CONTRACT.md §5).

200 draws of the 5-minute blocks of the time both arms share, the same blocks for both, for it is one day;
each arm with an error of its own angle, for each has a sensor and a pose of its own.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from fusion.exposure.below import DrawnDistribution, sum_below
from fusion.exposure.bins import CELLS_PER_DEG, THRESHOLDS_DEG
from fusion.exposure.resampling import DRAWS, Resampling, draw_blocks, find_interval, name_intervals
from fusion.exposure.types import Interval

BLOCK_S = 300.0
PERCENTS = (10, 50, 90, 99)
RIGHT_SEED = 1
TOP_DEG = 180

FloatVector = NDArray[np.float64]
IntVector = NDArray[np.int64]


def draw_pair(
    time_s: FloatVector, left_deg: FloatVector, right_deg: FloatVector, sigmas_deg: tuple[float, float]
) -> dict[str, Interval]:
    """Give the ranges of the figures of both arms by name: ``left_elevation_p50_deg``, for example.

    Parameters
    ----------
    time_s, left_deg, right_deg
        Shape (n,): the points at which both are analysed.
    sigmas_deg
        Standard deviation of the constant error of the left and of the right angle.
    """
    block_of: IntVector = np.unique(np.floor(time_s / BLOCK_S), return_inverse=True)[1].astype(np.int64)
    draws = draw_blocks(np.bincount(block_of), sigmas_deg[0])
    other = replace(draws, error_deg=_draw_other_errors(sigmas_deg[1]))
    left, right = _distribute(left_deg, block_of, draws), _distribute(right_deg, block_of, other)
    figures = {**_name_arm("left", left), **_name_arm("right", right)}
    ratios = {
        f"right_to_left_{end}": _divide(figures[f"right_{name}"], figures[f"left_{name}"])
        for end, name in (("time_above_60", "time_above_60_percent"), ("elevation_p50", "elevation_p50_deg"))
    }
    both = 100.0 * _draw_both(block_of, (left_deg, right_deg), (draws, other))
    drawn = {**figures, "both_above_60_percent": both, **ratios}
    return name_intervals({name: find_interval(values) for name, values in drawn.items()})


def _draw_other_errors(sigma_deg: float) -> FloatVector:
    """Give the same quantiles as those of the first arm, in an order that knows nothing of them."""
    quantiles: FloatVector = sigma_deg * ndtri((np.arange(DRAWS) + 0.5) / DRAWS)
    return np.random.Generator(np.random.PCG64(RIGHT_SEED)).permutation(quantiles)


def _distribute(angle_deg: FloatVector, block_of: IntVector, draws: Resampling) -> DrawnDistribution:
    cells = TOP_DEG * CELLS_PER_DEG
    cell = np.minimum((angle_deg * CELLS_PER_DEG).astype(np.int64), cells - 1)
    counts = np.bincount(block_of * cells + cell, minlength=(int(block_of[-1]) + 1) * cells)
    return sum_below(counts.reshape(-1, cells), draws)


def _name_arm(side: str, arm: DrawnDistribution) -> dict[str, FloatVector]:
    above = 100.0 * (1.0 - arm.find_shares(np.array(THRESHOLDS_DEG, np.float64)))
    angles_deg = arm.find_percentiles(PERCENTS)
    return {
        **{f"{side}_time_above_{c:g}_percent": above[:, k] for k, c in enumerate(THRESHOLDS_DEG)},
        **{f"{side}_elevation_p{p}_deg": angles_deg[:, k] for k, p in enumerate(PERCENTS)},
    }


def _draw_both(
    block_of: IntVector, angles_deg: tuple[FloatVector, FloatVector], draws: tuple[Resampling, Resampling]
) -> FloatVector:
    """Give the share of each draw in which both are at or above 60 deg at once, each read with its error."""
    lasted = np.bincount(block_of)
    shares = np.empty(DRAWS)
    for k, times in enumerate(draws[0].times):
        first, second = (
            angle >= 60.0 - drawn.error_deg[k] for angle, drawn in zip(angles_deg, draws, strict=True)
        )
        raised = np.bincount(block_of[first & second], minlength=len(lasted))
        shares[k] = (times * raised).sum() / (times * lasted).sum()
    return shares


def _divide(right: FloatVector, left: FloatVector) -> FloatVector:
    """Give NaN where the left arm has none."""
    ratios = np.full(len(left), np.nan)
    np.divide(right, left, out=ratios, where=left > 0)
    return ratios
