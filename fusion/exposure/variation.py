"""How the exposure varies from hour to hour (EXPOSURE.md A8)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fusion.exposure.types import HourVariation, PartExposure

LEAST_ANALYSED_S = 1800.0

FloatArray = NDArray[np.float64]


def is_compared(hour: PartExposure) -> bool:
    """Say whether half an hour or more of a clock hour was analysed."""
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
    """Coefficient of variation with the sample's standard deviation; None about a mean of nought."""
    coefficient, spread, last_less_first = (
        float(figure[0]) for figure in describe_values(np.array([values]))
    )
    return HourVariation(
        hours=len(values),
        coefficient_percent=None if np.isnan(coefficient) else coefficient,
        spread=spread,
        last_less_first=last_less_first,
    )


def describe_values(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Give coefficient (percent; NaN about a mean of nought), spread, and last less first of rows, (d, h)."""
    mean = values.mean(axis=1)
    mean = np.where(mean > 0, mean, np.nan)
    coefficient = 100.0 * values.std(axis=1, ddof=1) / mean
    return coefficient, values.max(axis=1) - values.min(axis=1), values[:, -1] - values[:, 0]
