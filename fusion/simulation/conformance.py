"""Angle series whose page 1 figures are known in closed form, to test other software.

The definitions are those of docs/profile.md. An expected value is computed from the curve, not by our code.
The tolerance allows for the low-pass filter (or none) and for a sample at the edge of a hold.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import asin, pi

import numpy as np

from acromion.fusion.recording import Float64Array

RATE_HZ = 20.0
"""Rate of every series. Samples are shifted by half a period, so no sample is exactly at a threshold."""
SWING_S = 4.0123
"""Not a multiple of the sample period, so that the samples are evenly distributed over the arc."""
SHARE_POINTS = 0.3
ANGLE_DEG = 0.5
EDGE_S = 0.3


@dataclass(frozen=True, slots=True)
class Expected:
    """A figure of page 1 by its name in the results: its value and tolerance."""

    figure: str
    unit: str
    value: float
    tolerance: float


@dataclass(frozen=True, slots=True)
class TestSignal:
    """A curve of elevation (deg over s, NaN if missing), its duration, and its figures."""

    name: str
    duration_s: float
    curve: Callable[[Float64Array], Float64Array]
    expected: tuple[Expected, ...]

    def sample(self) -> tuple[Float64Array, Float64Array]:
        """Return times (s) and elevations (deg), both of shape (n,)."""
        count = round(self.duration_s * RATE_HZ)
        time_s = np.asarray((np.arange(count) + 0.5) / RATE_HZ, np.float64)
        return time_s, np.asarray(self.curve(time_s), np.float64)


def _above_sine(threshold_deg: float) -> float:
    """Return the share of the time, percent, that 45 + 40 sin is at or above a threshold."""
    return 100 * (0.5 - asin((threshold_deg - 45) / 40) / pi)


def _shares(above_30: float, above_60: float, above_90: float) -> tuple[Expected, ...]:
    return tuple(
        Expected(f"time_above_{threshold}_percent", "%", value, SHARE_POINTS)
        for threshold, value in ((30, above_30), (60, above_60), (90, above_90))
    )


SIGNALS = (
    TestSignal(
        "swing",  # 45 deg plus and minus 40 deg, about every 4 s
        3600.0,
        lambda time_s: 45 + 40 * np.sin(2 * pi * time_s / SWING_S),
        (
            *_shares(_above_sine(30), _above_sine(60), 0.0),
            Expected("entries_above_60_per_h", "per h", 3600 / SWING_S, 1.0),
            Expected("elevation_p50_deg", "deg", 45.0, ANGLE_DEG),
        ),
    ),
    TestSignal(
        "hold",  # 10 deg for 60 s, then 70 deg for 30 s, repeated
        3600.0,
        lambda time_s: np.where(time_s % 90 < 60, 10.0, 70.0),
        (
            *_shares(100 / 3, 100 / 3, 0.0),
            Expected("entries_above_60_per_h", "per h", 40.0, 0.5),
            Expected("episodes_above_60_longest_s", "s", 30.0, EDGE_S),
        ),
    ),
    TestSignal(
        "day",  # 20 deg for five hours, except ten minutes at 100 deg after two
        5 * 3600.0,
        lambda time_s: np.where((time_s >= 7200) & (time_s < 7800), 100.0, 20.0),
        (
            *_shares(100 / 30, 100 / 30, 100 / 30),
            Expected("entries_above_60_per_h", "per h", 0.2, 0.01),
            Expected("episodes_above_60_longest_s", "s", 600.0, EDGE_S),
            Expected("worst_15_min_above_60_percent", "%", 200 / 3, SHARE_POINTS),
            Expected("worst_15_min_start_s", "s", 6900.0, 1.0),
        ),
    ),
    TestSignal(
        "ripple",  # 60 deg plus and minus 3 deg, every 2 s: the changes stay within the hysteresis
        3600.0,
        lambda time_s: 60 + 3 * np.sin(2 * pi * time_s / 2),
        (*_shares(100.0, 50.0, 0.0), Expected("entries_above_60_per_h", "per h", 0.0, 0.0)),
    ),
    TestSignal(
        "hole",  # 35 deg for 20 min, nothing for 20 min, 75 deg for 20 min: missing time counts as neither
        3600.0,
        lambda time_s: np.where(time_s < 1200, 35.0, np.where(time_s < 2400, np.nan, 75.0)),
        (
            *_shares(100.0, 50.0, 0.0),
            Expected("analysed_s", "s", 2400.0, EDGE_S),
            Expected("entries_above_60_per_h", "per h", 0.0, 0.0),
            Expected("episodes_above_60_longest_s", "s", 1200.0, EDGE_S),
        ),
    ),
)
"""The start of the worst 15 minutes of ``day`` is the earliest that includes all ten minutes: 7800 - 900
s.
"""
