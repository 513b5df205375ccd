"""A gyroscope that is written earlier or later than the accelerometer, by a part of a second.

Two sensors that are read through buffers of their own may stand in one row with different times. Every turn
is then seen too early or too late, and the angles are wrong in all movement: 50 ms cost up to 20 deg. The
same windows that tell the axes tell the lag: gravity stands still at one shift of the rates alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.gravity_windows import GravityWindows, GyroModel, measure_miss

Table = NDArray[np.float64]
MOST_LAG_S, LEAST_PERIODS, PROBED_PERIODS = 0.24, 1.5, 2
FEWEST_WINDOWS = 12
LIKELY_NATS, LIKELY_LAG_S = 4.0, 0.025
CERTAIN_NATS, CERTAIN_LAG_S = 12.0, 0.06
"""Good recordings in hand fit best as they are; late by 100 ms they give 13 to 29 nats, by 50 ms 4 to 13.
The lag itself is known to about 20 ms: too little to put it right, which would leave 5 deg in fast movement.
"""
LEAST_MISS_G = 0.02


@dataclass(frozen=True, slots=True)
class SensorLag:
    """By how much the gyroscope is later than the accelerometer, and how much likelier that is than not."""

    lag_s: float
    nats: float

    @property
    def is_likely(self) -> bool:
        """Enough for a warning."""
        return self.nats > LIKELY_NATS and abs(self.lag_s) > LIKELY_LAG_S

    @property
    def is_certain(self) -> bool:
        """Enough to refuse the recording."""
        return self.nats > CERTAIN_NATS and abs(self.lag_s) > CERTAIN_LAG_S


def measure_lag(windows: GravityWindows, model: GyroModel) -> SensorLag:
    """Find the shift of the rates at which gravity stands stillest; none, where few windows tell."""
    if len(windows) < FEWEST_WINDOWS:
        return SensorLag(0.0, 0.0)
    period_s = float(np.median(windows.period_s))
    most = min(int(MOST_LAG_S / period_s), int(np.diff(windows.first).min()) // 4)
    if _is_least(windows, model, min(PROBED_PERIODS, most)):
        return SensorLag(0.0, 0.0)
    shifts = range(-most, most + 1)
    against = _weigh_shifts(windows, model, shifts)
    best = int(against.argmin())
    if abs(shifts[best]) < LEAST_PERIODS:
        return SensorLag(0.0, 0.0)
    return SensorLag(shifts[best] * period_s, float(against[most] - against[best]))


def _is_least(windows: GravityWindows, model: GyroModel, rows: int) -> bool:
    """Whether no shift fits better than one to either side: with a lag, all go down towards it."""
    earlier, as_read, later = _weigh_shifts(windows, model, (-rows, 0, rows))
    return bool(as_read <= min(earlier, later))


def _weigh_shifts(windows: GravityWindows, model: GyroModel, shifts: Sequence[int]) -> Table:
    return _weigh(np.array([measure_miss(_shift(windows, rows), model) for rows in shifts]))


def _weigh(miss_g: Table) -> Table:
    """Nats against each shift, (m,) of misses (m, n): Cauchy, as arrangements are weighed."""
    spread_g = max(float(np.median(miss_g, axis=1).min()) / 0.8, LEAST_MISS_G)
    return np.asarray(np.log1p((miss_g / spread_g) ** 2).sum(axis=1) / 2.0)


def _shift(windows: GravityWindows, rows: int) -> GravityWindows:
    """Each acceleration beside the rates so many rows later; what has no partner falls away."""
    starts, stops = windows.first[:-1], windows.first[1:]
    kept = [np.arange(a + max(0, -rows), b - max(0, rows)) for a, b in zip(starts, stops, strict=True)]
    numbers = np.concatenate(kept)
    first = np.concatenate([[0], np.cumsum([len(one) for one in kept])]).astype(np.int64)
    return GravityWindows(
        windows.acc_g[numbers], windows.turn[numbers + rows], first, windows.period_s, windows.start_s
    )
