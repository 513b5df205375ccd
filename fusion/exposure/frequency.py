"""How fast the arm goes to and fro: mean power frequency and zero-crossings of its speed (EXPOSURE.md A5).

Both of the signed derivative of elevation; that of elevation itself would differ strongly (0.24 against
0.99 Hz for the same two-tone movement), so the name says which.
"""

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.rows import find_runs
from fusion.exposure.types import Frequency

GRID_HZ = 20.0
WINDOW_STEPS = 1200  # a minute
HIGHEST_HZ = 5.0
DEAD_BAND_DPS = 10.0

FloatVector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyTally:
    """``sums``, shape (3,): MPF times seconds, seconds with an MPF, crossings; filled in place."""

    sums: FloatVector = field(default_factory=lambda: np.zeros(3))

    def add(self, angle: MetricAngle) -> None:
        """Count a segment."""
        self.sums[2] += count_crossings(angle.elevation_deg, angle.valid, angle.rate_hz, DEAD_BAND_DPS)
        for first, stop in find_runs(angle.valid):
            frequency_hz = find_mean_power_frequency(angle.elevation_deg[first:stop], angle.rate_hz)
            if frequency_hz is not None:
                seconds = (stop - first) / angle.rate_hz
                self.sums[:2] += (frequency_hz * seconds, seconds)

    def summarise(self, analysed_s: float) -> Frequency:
        """Give the time-weighted mean over the unbroken runs of a minute or more, and crossings per hour."""
        weighted, seconds, crossings = (float(value) for value in self.sums)
        return Frequency(weighted / seconds if seconds else None, crossings * 3600.0 / analysed_s)


def find_mean_power_frequency(angle_deg: FloatVector, rate_hz: float) -> float | None:
    """Give sum(f P) / sum(P) of the speed of inclination, 0 to 5 Hz; None under a minute or without movement.

    Welch: Hann windows of 60 s that overlap by half, each less its mean, of the speed on a 20 Hz grid; what
    the difference between grid points takes off high frequencies is put back.
    """
    steps = int(len(angle_deg) * GRID_HZ / rate_hz)
    if rate_hz < GRID_HZ or steps <= WINDOW_STEPS:
        return None
    speeds_dps = np.diff(_take_grid(angle_deg, rate_hz / GRID_HZ, steps)) * GRID_HZ
    windows = np.lib.stride_tricks.sliding_window_view(speeds_dps, WINDOW_STEPS)[:: WINDOW_STEPS // 2]
    frequencies_hz = np.fft.rfftfreq(WINDOW_STEPS, 1 / GRID_HZ)
    wanted = (frequencies_hz > 0) & (frequencies_hz <= HIGHEST_HZ)
    power = sum_power(windows)[wanted] / np.sinc(frequencies_hz[wanted] / GRID_HZ) ** 2
    if power.sum() <= 0.0:
        return None
    return float(frequencies_hz[wanted] @ power / power.sum())


def sum_power(windows: FloatVector) -> FloatVector:
    """Sum the power spectra of windows, shape (w, 1200), a few at a time to keep memory flat."""
    hann = np.hanning(WINDOW_STEPS + 1)[:-1]
    power = np.zeros(WINDOW_STEPS // 2 + 1)
    for first in range(0, len(windows), 64):
        part = windows[first : first + 64]
        spectra = np.fft.rfft((part - part.mean(axis=1, keepdims=True)) * hann)
        power += (spectra.real**2 + spectra.imag**2).sum(axis=0)
    return power


@njit(cache=True, nogil=True)
def _take_grid(angle_deg, rows_per_step, steps):  # type: ignore[no-untyped-def]
    """Take every so many rows, linearly between them."""
    grid = np.empty(steps)
    for k in range(steps):
        row = min(int(k * rows_per_step), max(len(angle_deg) - 2, 0))
        following = min(row + 1, len(angle_deg) - 1)
        share = k * rows_per_step - row
        grid[k] = angle_deg[row] + share * (angle_deg[following] - angle_deg[row])
    return grid


@njit(cache=True, nogil=True)
def count_crossings(angle_deg, valid, rate_hz, dead_band_dps):  # type: ignore[no-untyped-def]
    """Count the changes of direction: from faster than the dead band one way to faster the other way."""
    count, direction = 0, 0
    for i in range(1, len(angle_deg)):
        if not (valid[i] and valid[i - 1]):
            direction = 0
            continue
        speed_dps = (angle_deg[i] - angle_deg[i - 1]) * rate_hz
        way = 1 if speed_dps > dead_band_dps else (-1 if speed_dps < -dead_band_dps else 0)
        if way != 0:
            if way == -direction:
                count += 1
            direction = way
    return count
