"""Movements of which every figure is known in closed form (EXPOSURE.md part D)."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fusion.exposure.bins import CELLS, PartHistograms
from fusion.exposure.metric_filter import MetricAngle

Curve = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def swing(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """S1: 45 deg plus and minus 40 deg, a swing every 4 s."""
    return np.asarray(45 + 40 * np.sin(2 * np.pi * 0.25 * time_s), np.float64)


def triangle(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """45 deg plus and minus 40 deg at an even 40 deg/s, up and down every 4 s."""
    return np.asarray(5 + 80 * (1 - np.abs(2 * ((time_s / 4 + 0.25) % 1) - 1)), np.float64)


def square(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """10 deg for 60 s, then 70 deg for 30 s, and again."""
    return np.where(time_s % 90 < 60, 10.0, 70.0)


def block(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """10 deg with ten minutes at 70 deg, two hours into the day."""
    return np.where((time_s >= 7200) & (time_s < 7800), 70.0, 10.0)


def constant(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.full_like(time_s, 50.0)


def sample(curve: Curve, seconds: float, rate_hz: float = 100.0, offset_s: float = 0.0) -> MetricAngle:
    """Sample a curve, half a row in so that no sample sits on a threshold, without the metric filter."""
    count = round(seconds * rate_hz)
    time_s = np.asarray((np.arange(count) + 0.5) / rate_hz + offset_s, np.float64)
    angle = np.asarray(np.rint(curve(time_s) * 1e6) / 1e6, np.float64)
    return MetricAngle(0, rate_hz, angle, np.ones(count, np.bool_))


def tally_cells(angle: MetricAngle) -> NDArray[np.int64]:
    """Give the microseconds in each 0.1 deg cell."""
    day = PartHistograms(np.array([0, 10**12]), np.zeros((1, CELLS), np.int64))
    day.add(angle)
    return np.asarray(day.cell_us[0], np.int64)
