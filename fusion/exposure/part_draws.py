"""How far the figures of a part of the day could lie from those read off: an hour, a period, a task.

As for the day (``intervals``): 200 draws with an error of the angle, and with the part's own 5-minute blocks
drawn again, those at its edges as long as they are. A part of one block has the error of the angle alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.exposure.below import sum_below
from fusion.exposure.bins import THRESHOLDS_DEG
from fusion.exposure.parts import PERCENTS
from fusion.exposure.resampling import Resampling, can_draw, draw_blocks, find_interval, find_ranges
from fusion.exposure.stretches import Stretches, sum_groups, sum_time
from fusion.exposure.types import HourVariation, Interval, PartExposure
from fusion.exposure.variation import describe_values, is_compared
from fusion.recording import MICROSECONDS

FloatArray = NDArray[np.float64]
DrawnFigures = dict[str, FloatArray]
"""Each figure of a part in every draw, shape (200,), by its name."""


@dataclass(frozen=True, slots=True, eq=False)
class PartDrawer:
    """What parts are drawn from: the cells of the stretches, shape (s, 1800), and their entries above 60 deg
    at each error of the angle, shapes (g, s) and (g,).
    """

    stretches: Stretches
    cell_us: NDArray[np.int32] | NDArray[np.int64]
    entries: FloatArray
    errors_deg: FloatArray
    sigma_deg: float

    def draw(self, chosen: NDArray[np.bool_]) -> DrawnFigures:
        """Draw the part that the chosen stretches make up; ``chosen`` has shape (s,). Empty where the error
        of the angle is not known and the part too short to be drawn again.
        """
        block_of = self.stretches.block_of[chosen]
        blocks = sum_time(self.cell_us[chosen], block_of)
        if not can_draw(blocks.sum(axis=1), self.sigma_deg):
            return {}
        draws = draw_blocks(blocks.sum(axis=1), self.sigma_deg)
        below = sum_below(blocks, draws)
        percentiles_deg = below.find_percentiles(PERCENTS)
        above = 100.0 * (1.0 - below.find_shares(np.array(THRESHOLDS_DEG, np.float64)))
        return {
            **{f"elevation_p{p}_deg": percentiles_deg[:, k] for k, p in enumerate(PERCENTS)},
            **{f"time_above_{c}_percent": above[:, k] for k, c in enumerate(THRESHOLDS_DEG)},
            "entries_above_60_per_h": self._draw_entries(chosen, block_of, blocks, draws),
        }

    def _draw_entries(
        self,
        chosen: NDArray[np.bool_],
        block_of: NDArray[np.int64],
        blocks: NDArray[np.int64],
        draws: Resampling,
    ) -> FloatArray:
        entries = sum_groups(self.entries[:, chosen].T, block_of).T
        hours = draws.sum(blocks.sum(axis=1)) / (3600.0 * MICROSECONDS)
        return draws.sum_with_error(entries, self.errors_deg) / hours


def find_part_intervals(drawn: DrawnFigures) -> dict[str, Interval]:
    """Give the interval of each figure of a part."""
    return dict(zip(drawn, find_ranges(np.stack(list(drawn.values()), axis=1)), strict=True))


def name_variation_intervals(
    hours: Sequence[PartExposure],
    drawn: Sequence[DrawnFigures],
    figures: Mapping[str, HourVariation],
) -> dict[str, Interval]:
    """Give the intervals of what differs between the clock hours; ``drawn`` are the figures of each hour.

    Hours drawn again differ by their sampling once more, so that the draws of a spread lie too high: they are
    moved to lie about the figure itself, and not under nought.
    """
    kept = [figure for hour, figure in zip(hours, drawn, strict=True) if is_compared(hour)]
    found: dict[str, Interval] = {}
    for name, figure in figures.items():
        values = np.stack([part[name] for part in kept], axis=1)
        coefficient, spread, last_less_first = describe_values(values)
        told = {
            "coefficient_percent": _centre(coefficient, figure.coefficient_percent),
            "spread": _centre(spread, figure.spread),
            "last_less_first": find_interval(last_less_first),
        }
        found |= {f"by_hour_{name}_{key}": interval for key, interval in told.items() if interval}
    return found


def _centre(drawn: FloatArray, value: float | None) -> Interval | None:
    if value is None:
        return None
    return find_interval(np.maximum(drawn - np.nanmedian(drawn) + value, 0.0))
