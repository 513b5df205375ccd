"""Intervals by resampling: 5-minute blocks drawn with replacement, with errors of angle and pose.

200 draws. Draw k uses the error at quantile (k + 0.5)/200 of a normal distribution, and as many blocks as the
day has analysed ones, with replacement, by PCG64(0). The same recording always gives the same interval.

For the N-pose the same draws are repeated with a share, in [0, 1], of its one-sided error. With the arm along
the body as the reference, elevations of a raised arm read up to 15 deg low (abduction; Bioengineering
2025;12:50). We assume that the error is proportional to the angle, from 0 for a hanging arm to 15 deg at 90
deg. This does not change the order of the angles, so the corrected time above a threshold is the measured
time above a lower threshold.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist

import numpy as np

from acromion.fusion.conventions import NPOSE_ERROR_DEG
from acromion.fusion.exposure.bins import CELLS_PER_DEG, AnyArray
from acromion.fusion.exposure.types import Interval
from acromion.fusion.numba_kernels import inner, kernel
from acromion.fusion.recording import BoolArray, Float64Array

DRAWS = 200
SEED = 0
LOW_HIGH_PERCENT = (2.5, 97.5)
ERRORS = 11
"""Number of angle errors for which the counts are repeated; between them, counts are interpolated."""

STRIDE = 147
"""Stride, coprime to 200, that spreads the shares most evenly over the errors of the angle."""

LEAST_BLOCKS = 6
"""With fewer blocks a range is only computed if an error of the angle is known."""

FULL_AT_DEG = 90.0
GROWTH = NPOSE_ERROR_DEG / FULL_AT_DEG

Figures = dict[str, Float64Array]
"""Figures in every draw, shape (200,), by name; NaN if a draw lacks the figure."""


@dataclass(frozen=True, slots=True, eq=False)
class Resampling:
    """The draws.

    ``kept``: shape (b,): the blocks with analysed time.
    ``times``: shape (200, kept): how often each block is in a draw.
    ``error_deg``: shape (200,): the error of the angle.
    ``share``: shape (200,): the share of the N-pose's error that is added to the angles.
    """

    kept: BoolArray
    times: Float64Array
    error_deg: Float64Array
    share: Float64Array = field(default_factory=lambda: np.zeros(DRAWS))

    def with_npose_error(self) -> "Resampling":
        """Return the draws with the error of the N-pose: each draw gets one of 200 evenly spaced shares."""
        return replace(self, share=(np.arange(DRAWS) * STRIDE % DRAWS + 0.5) / DRAWS)

    def sum(self, blocks: AnyArray) -> Float64Array:
        """Sum blocks, shape (b, ...), over each draw: shape (200, ...)."""
        kept = np.ascontiguousarray(blocks[self.kept], np.float64)
        sums = np.zeros((DRAWS, kept[0].size))
        _sum_draws(self.times, kept.reshape(len(kept), -1), sums)
        return sums.reshape(DRAWS, *kept.shape[1:])

    def sum_with_error(self, blocks: Float64Array, grid_deg: Float64Array) -> Float64Array:
        """Sum counts at each error of a grid, shape (g, b, ...), interpolated to each draw's error."""
        place = np.interp(self.error_deg, grid_deg, np.arange(len(grid_deg)))
        left = np.minimum(place.astype(np.int64), len(grid_deg) - 2)
        share = (place - left).reshape(-1, *([1] * (blocks.ndim - 2)))
        sums = self.sum(np.swapaxes(blocks, 0, 1))  # shape (200, g, ...)
        draw = np.arange(DRAWS)
        return np.asarray((1 - share) * sums[draw, left] + share * sums[draw, left + 1])

    def look_up(self, figure: Float64Array, grid_deg: Float64Array) -> Float64Array:
        """Return a figure known at each error of a grid, shape (g,), at each draw's error: shape (200,)."""
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
    """Return errors, shape (11,), evenly spaced between those of the first and the last draw."""
    # an exact angle also needs a grid
    furthest = max(sigma_deg * NormalDist().inv_cdf(1 - 0.5 / DRAWS), 1e-6)
    return np.linspace(-furthest, furthest, ERRORS)


def draw_blocks(analysed: AnyArray, sigma_deg: float) -> Resampling:
    """Draw from the blocks with analysed time; ``analysed`` has shape (b,)."""
    kept = analysed > 0
    count = int(kept.sum())
    chosen = np.random.Generator(np.random.PCG64(SEED)).integers(0, count, (DRAWS, count))
    times = np.array([np.bincount(row, minlength=count) for row in chosen], np.float64)
    return Resampling(kept, times, draw_errors(sigma_deg))


def draw_errors(sigma_deg: float) -> Float64Array:
    """Return the error of each draw in order: the quantiles of a normal distribution, shape (200,)."""
    errors = NormalDist()
    return np.array([sigma_deg * errors.inv_cdf((k + 0.5) / DRAWS) for k in range(DRAWS)])


def can_draw(analysed: AnyArray, sigma_deg: float) -> bool:
    """Return whether blocks, shape (b,), are enough: half an hour if no error of the angle is known."""
    return sigma_deg > 0 or int((analysed > 0).sum()) >= LEAST_BLOCKS


def raise_angles(read_deg: Float64Array, share: Float64Array) -> Float64Array:
    """Add a share of the N-pose's error, from 0 to 1, to angles."""
    return np.asarray(read_deg + share * NPOSE_ERROR_DEG * np.minimum(1.0, read_deg / FULL_AT_DEG))


def lower_thresholds(raised_deg: Float64Array, share: Float64Array) -> Float64Array:
    """Return the angles that become these: the inverse of :func:`raise_angles`."""
    return np.maximum(raised_deg / (1.0 + GROWTH * share), raised_deg - share * NPOSE_ERROR_DEG)


@dataclass(frozen=True, slots=True, eq=False)
class DrawnDistribution:
    """The time below each edge of the 0.1 deg cells in each block, shape (1801, b), and the draws.

    The time below an angle in a draw is a sum over blocks at that angle only. Times are whole microseconds,
    whose sums are exact in any order.
    """

    below: Float64Array
    draws: Resampling

    def find_shares(self, angles_deg: Sequence[float]) -> Float64Array:
        """Return the share of each draw's time below each of k angles, with its errors: shape (200, k)."""
        error_deg, share = self.draws.error_deg[:, np.newaxis], self.draws.share[:, np.newaxis]
        cells = lower_thresholds(np.array(angles_deg, np.float64) - error_deg, share) * CELLS_PER_DEG
        shares = np.empty(cells.shape)
        _read_shares(self.below, self.draws.times, np.clip(cells, 0.0, len(self.below) - 1.0), shares)
        return shares

    def find_percentiles(self, percents: Sequence[int]) -> Float64Array:
        """Return percentiles of each draw, with its errors and clipped to the scale, shape (200, p)."""
        places = np.empty((len(self.draws.times), len(percents)))
        _find_places(self.below, self.draws.times, np.array(percents) / 100.0, places)
        error_deg, share = self.draws.error_deg[:, np.newaxis], self.draws.share[:, np.newaxis]
        return np.clip(raise_angles(places / CELLS_PER_DEG, share) + error_deg, 0.0, 180.0)

    def with_npose_error(self) -> "DrawnDistribution":
        """Return the same with the error of the N-pose in the draws."""
        return replace(self, draws=self.draws.with_npose_error())


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
    """Compute each draw's share below its places, linear within a cell."""
    for draw in range(len(times)):
        whole = _add_up(below[-1], times[draw])
        for k in range(cells.shape[1]):
            left = min(int(cells[draw, k]), len(below) - 2)
            lower, upper = _add_up(below[left], times[draw]), _add_up(below[left + 1], times[draw])
            shares[draw, k] = (lower + (cells[draw, k] - left) * (upper - lower)) / whole


@kernel
def _find_places(below, times, wanted, places):  # type: ignore[no-untyped-def]
    """Find by bisection the cell in which each draw's time below reaches each share, linear within it."""
    for draw in range(len(times)):
        whole = _add_up(below[-1], times[draw])
        for k in range(len(wanted)):
            left, right = 0, len(below) - 1
            lower, upper = 0.0, whole
            while right - left > 1:
                middle = (left + right) // 2
                reached = _add_up(below[middle], times[draw])
                # a relative tolerance of 1e-12 against the rounding of sums
                if reached >= whole * (wanted[k] - 1e-12):
                    right, upper = middle, reached
                else:
                    left, lower = middle, reached
            places[draw, k] = left + (whole * wanted[k] - lower) / (upper - lower)


def scale_draws(value: float, drawn: Float64Array, coarse: float) -> Float64Array:
    """Scale draws that were computed from coarser classes, so that they agree with the figure itself."""
    return value / coarse * drawn if coarse > 0 else drawn


def find_intervals(drawn: Figures, raised: Mapping[str, Float64Array] | None = None) -> dict[str, Interval]:
    """Return the 2.5th and 97.5th percentiles of each figure; none if over 5 % of the draws lack it.

    ``raised``: the same figures with the error of the N-pose, for the second pair of limits.
    """
    if not drawn:
        return {}
    found: dict[str, Interval] = {}
    ends = np.percentile(np.stack(list(drawn.values()), axis=1), LOW_HIGH_PERCENT, axis=0)
    for name, (low, high) in zip(drawn, ends.T.tolist(), strict=True):
        known = drawn[name][~np.isnan(drawn[name])]
        if len(known) == DRAWS:
            found[name] = Interval(low, high)
        elif len(known) >= 0.95 * DRAWS:
            found[name] = Interval(*np.percentile(known, LOW_HIGH_PERCENT).tolist())
    for name, interval in find_intervals(dict(raised)).items() if raised else ():
        if name in found:
            ends_deg = min(found[name].low, interval.low), max(found[name].high, interval.high)
            found[name] = replace(found[name], low_pose=ends_deg[0], high_pose=ends_deg[1])
    return found
