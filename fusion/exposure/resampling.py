"""Resampled days: 5-minute blocks drawn again, with an error of the angle (CONTRACT §5).

200 draws. Draw k takes the error at quantile (k + 0.5)/200 of a normal distribution, and as many blocks as
the day has analysed ones, with replacement, by PCG64(0): the same recording always gives the same interval.
For the N-pose the same draws once more, with a share of its one-sided error that runs through [0, 1].
"""

from dataclasses import dataclass, field, replace
from statistics import NormalDist

import numpy as np

from fusion.exposure.parts import AnyArray
from fusion.exposure.types import Interval
from fusion.numba_kernels import kernel
from fusion.recording import BoolArray, Float64Array

DRAWS = 200
SEED = 0
LOW_HIGH_PERCENT = (2.5, 97.5)
ERRORS = 11
"""Errors of the angle at which counts are made again; between them they are taken as linear."""

STRIDE = 147
"""Of the strides prime to 200 the one that spreads shares and errors of the angle most evenly over both."""

LEAST_BLOCKS = 6
"""Fewer blocks than these, drawn again, are no range by themselves: an error of the angle must be known."""


@dataclass(frozen=True, slots=True, eq=False)
class Resampling:
    """The draws. ``kept``, shape (b,), are the blocks with analysed time; ``times``, shape (200, kept),
    how often each is in a draw; ``error_deg``, shape (200,), the error of the angle; ``share``, shape (200,),
    how much of the N-pose's error the read angles are raised by (:mod:`fusion.exposure.pose_error`).
    """

    kept: BoolArray
    times: Float64Array
    error_deg: Float64Array
    share: Float64Array = field(default_factory=lambda: np.zeros(DRAWS))

    def raise_read(self) -> "Resampling":
        """Give the same draws with the error of the N-pose: every 200th of [0, 1] is one draw's share."""
        return replace(self, share=(np.arange(DRAWS) * STRIDE % DRAWS + 0.5) / DRAWS)

    def sum(self, blocks: AnyArray) -> Float64Array:
        """Sum blocks, shape (b, ...), over each draw: shape (200, ...)."""
        kept = np.ascontiguousarray(blocks[self.kept], np.float64)
        sums = np.zeros((DRAWS, kept[0].size))
        _sum_draws(self.times, kept.reshape(len(kept), -1), sums)
        return sums.reshape(DRAWS, *kept.shape[1:])

    def sum_with_error(self, blocks: Float64Array, grid_deg: Float64Array) -> Float64Array:
        """Sum what was counted at each error of a grid, shape (g, b, ...), at each draw's error."""
        place = np.interp(self.error_deg, grid_deg, np.arange(len(grid_deg)))
        left = np.minimum(place.astype(np.int64), len(grid_deg) - 2)
        share = (place - left).reshape(-1, *([1] * (blocks.ndim - 2)))
        sums = self.sum(np.swapaxes(blocks, 0, 1))  # shape (200, g, ...)
        draw = np.arange(DRAWS)
        return np.asarray((1 - share) * sums[draw, left] + share * sums[draw, left + 1])

    def look_up(self, figure: Float64Array, grid_deg: Float64Array) -> Float64Array:
        """Give a figure known at each error of a grid, shape (g,), at each draw's error: shape (200,)."""
        return np.asarray(np.interp(self.error_deg, grid_deg, figure))


@kernel
def _sum_draws(times, blocks, sums):  # type: ignore[no-untyped-def]
    """Matrix product in a fixed order: the same on every machine, and on one core."""
    for draw in range(len(times)):
        for block in range(len(blocks)):
            count = times[draw, block]
            if count > 0:
                for k in range(blocks.shape[1]):
                    sums[draw, k] += count * blocks[block, k]


def spread_errors(sigma_deg: float) -> Float64Array:
    """Give the errors, shape (11,), between those of the first and the last draw."""
    furthest = max(sigma_deg * NormalDist().inv_cdf(1 - 0.5 / DRAWS), 1e-6)  # an exact angle too has a grid
    return np.linspace(-furthest, furthest, ERRORS)


def draw_blocks(analysed: AnyArray, sigma_deg: float) -> Resampling:
    """Draw from the blocks that hold analysed time; ``analysed`` has shape (b,)."""
    kept = analysed > 0
    count = int(kept.sum())
    chosen = np.random.Generator(np.random.PCG64(SEED)).integers(0, count, (DRAWS, count))
    times = np.array([np.bincount(row, minlength=count) for row in chosen], np.float64)
    return Resampling(kept, times, draw_errors(sigma_deg))


def draw_errors(sigma_deg: float) -> Float64Array:
    """Give the error of each draw in order: the quantiles of a normal distribution, shape (200,)."""
    errors = NormalDist()
    return np.array([sigma_deg * errors.inv_cdf((k + 0.5) / DRAWS) for k in range(DRAWS)])


def can_draw(analysed: AnyArray, sigma_deg: float) -> bool:
    """Whether blocks, shape (b,), are enough for a range: half an hour of them where no error is known."""
    return sigma_deg > 0 or int((analysed > 0).sum()) >= LEAST_BLOCKS


def find_interval(figures: Float64Array) -> Interval | None:
    """Give the 2.5th and 97.5th percentiles of the draws; None where over 5 % of them lack the figure."""
    known = figures[~np.isnan(figures)]
    if len(known) < 0.95 * len(figures):
        return None
    low, high = np.percentile(known, LOW_HIGH_PERCENT)
    return Interval(float(low), float(high))


def find_ranges(figures: Float64Array) -> list[Interval]:
    """Give the interval of each column of figures that every draw has, shape (200, k)."""
    low, high = np.percentile(figures, LOW_HIGH_PERCENT, axis=0)
    return [Interval(float(a), float(b)) for a, b in zip(low, high, strict=True)]


def scale_interval(value: float | None, drawn: Float64Array, coarse: float) -> Interval | None:
    """Give the interval of a figure whose draws were taken from coarser classes than the figure itself."""
    if value is None or not coarse > 0:
        return None if value is None else find_interval(drawn)
    return find_interval(value / coarse * drawn)


def name_intervals(found: dict[str, Interval | None]) -> dict[str, Interval]:
    """Leave out the figures without an interval."""
    return {name: interval for name, interval in found.items() if interval is not None}
