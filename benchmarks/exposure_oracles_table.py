"""A row of the oracle table, and helpers that several rows use."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.exposure.bins import CELLS, PartHistograms
from acromion.fusion.exposure.metric_filter import MetricAngle

FloatVector = NDArray[np.float64]
ALL_DAY = np.array([0, 10**12], np.int64)


@dataclass(frozen=True, slots=True)
class Oracle:
    """A row of the table; ``tolerance`` is absolute."""

    number: str
    name: str
    expected: float
    got: float
    tolerance: float

    @property
    def is_met(self) -> bool:
        """Return whether the figure is within the tolerance."""
        return abs(self.got - self.expected) <= self.tolerance


def sample(
    curve: Callable[[FloatVector], FloatVector], seconds: float, rate_hz: float = 997.0
) -> MetricAngle:
    time_s = np.asarray((np.arange(round(seconds * rate_hz)) + 0.5) / rate_hz, np.float64)
    angle = np.rint(curve(time_s) * 1e6) / 1e6
    return MetricAngle(0, rate_hz, angle, np.ones(len(angle), np.bool_))


def tally(angle: MetricAngle) -> NDArray[np.int64]:
    day = PartHistograms(ALL_DAY, np.zeros((1, CELLS), np.int64))
    day.add(angle)
    return np.asarray(day.cell_us[0])


def share_above(angle: MetricAngle, threshold_deg: int) -> float:
    cells = tally(angle)
    return float(cells[10 * threshold_deg :].sum() / cells.sum())
