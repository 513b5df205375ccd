"""How fast the arm goes to and fro: mean power frequency and zero-crossings of its speed (EXPOSURE.md A5).

Both of the signed derivative of elevation; that of elevation itself would differ strongly (0.24 against
0.99 Hz for the same two-tone movement), so the name says which.
"""

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.resampling import Resampling, find_interval, name_intervals, scale_interval
from fusion.exposure.rows import IntArray, find_part_rows, find_runs
from fusion.exposure.types import Frequency, Interval
from fusion.recording import MICROSECONDS

GRID_HZ = 20.0
WINDOW_STEPS = 1200  # a minute
HIGHEST_HZ = 5.0
DEAD_BAND_DPS = 10.0

FloatVector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyTally:
    """``sums``, shape (2,): MPF times seconds, and seconds with an MPF; filled in place.

    Of each 5-minute block: ``crossings``, shape (b,), and ``moments``, shape (b, 2), what
    :func:`find_power_moments` gives for the windows whose middle lies in it.
    """

    edges_us: IntArray
    crossings: FloatVector = field(init=False)
    moments: FloatVector = field(init=False)
    sums: FloatVector = field(default_factory=lambda: np.zeros(2))

    def __post_init__(self) -> None:
        blocks = len(self.edges_us) - 1
        object.__setattr__(self, "crossings", np.zeros(blocks))
        object.__setattr__(self, "moments", np.zeros((blocks, 2)))

    def add(self, angle: MetricAngle) -> None:
        """Count a segment."""
        rows = find_part_rows(angle, self.edges_us)
        count_crossings(angle.elevation_deg, angle.valid, angle.rate_hz, rows, self.crossings)
        for first, stop in find_runs(angle.valid):
            moments = find_power_moments(angle.elevation_deg[first:stop], angle.rate_hz)
            frequency_hz = divide_moments(moments)
            if frequency_hz is not None:
                seconds = (stop - first) / angle.rate_hz
                self.sums[:] += (frequency_hz * seconds, seconds)
                np.add.at(self.moments, self._find_blocks(angle, first, len(moments)), moments)

    def _find_blocks(self, angle: MetricAngle, first: int, windows: int) -> IntArray:
        """Give the block of the middle of each window; windows overlap by half."""
        middles_s = first / angle.rate_hz + (np.arange(windows) + 1) * (WINDOW_STEPS / 2 / GRID_HZ)
        middles_us = angle.start_us + middles_s * MICROSECONDS
        blocks = np.searchsorted(self.edges_us, middles_us, side="right") - 1
        return np.asarray(np.clip(blocks, 0, len(self.moments) - 1), np.int64)

    def summarise(self, analysed_s: float) -> Frequency:
        """Give the mean over the unbroken runs of a minute or more, and crossings per hour."""
        weighted, seconds = (float(value) for value in self.sums)
        crossings = float(self.crossings.sum())
        return Frequency(weighted / seconds if seconds else None, crossings * 3600.0 / analysed_s)

    def name_intervals(
        self, frequency: Frequency, draws: Resampling, block_s: FloatVector
    ) -> dict[str, Interval]:
        """Give the intervals: of the sampling of the day, for no constant error changes a speed."""
        drawn_per_h = draws.sum(self.crossings) * 3600.0 / draws.sum(block_s)
        drawn = draws.sum(self.moments)
        power = np.where(drawn[:, 1] > 0, drawn[:, 1], np.nan)
        coarse_hz = divide_moments(self.moments) or 0.0
        return name_intervals(
            {
                "inclination_velocity_mpf_hz": scale_interval(
                    frequency.mean_power_hz, drawn[:, 0] / power, coarse_hz
                ),
                "inclination_velocity_zero_crossings_per_h": find_interval(drawn_per_h),
            }
        )


def find_mean_power_frequency(angle_deg: FloatVector, rate_hz: float) -> float | None:
    """Give sum(f P) / sum(P) of the speed of inclination; None under a minute or without movement."""
    return divide_moments(find_power_moments(angle_deg, rate_hz))


def divide_moments(moments: FloatVector) -> float | None:
    """Give the mean power frequency of all windows, shape (w, 2); None without power."""
    weighted, power = moments.sum(axis=0)
    return float(weighted / power) if power > 0.0 else None


def find_power_moments(angle_deg: FloatVector, rate_hz: float) -> FloatVector:
    """Give sum(f P) and sum(P) of each window of the speed of inclination, 0 to 5 Hz, shape (w, 2).

    Welch: Hann windows of 60 s that overlap by half, each less its mean, of the speed on a 20 Hz grid; what
    the difference between grid points takes off high frequencies is put back. Under a minute: no window.
    """
    steps = int(len(angle_deg) * GRID_HZ / rate_hz)
    if rate_hz < GRID_HZ or steps <= WINDOW_STEPS:
        return np.zeros((0, 2))
    speeds_dps = np.diff(_take_grid(angle_deg, rate_hz / GRID_HZ, steps)) * GRID_HZ
    windows = np.lib.stride_tricks.sliding_window_view(speeds_dps, WINDOW_STEPS)[:: WINDOW_STEPS // 2]
    frequencies_hz = np.fft.rfftfreq(WINDOW_STEPS, 1 / GRID_HZ)
    wanted = (frequencies_hz > 0) & (frequencies_hz <= HIGHEST_HZ)
    put_back = np.where(wanted, 1.0 / np.sinc(frequencies_hz / GRID_HZ) ** 2, 0.0)
    return _sum_spectra(windows, np.stack([frequencies_hz * put_back, put_back], axis=1))


def _sum_spectra(windows: FloatVector, weights: FloatVector) -> FloatVector:
    """Sum each window's power spectrum with weights, (601, 2): shape (w, 2); a few windows at a time."""
    hann = np.hanning(WINDOW_STEPS + 1)[:-1]
    sums = np.empty((len(windows), 2))
    for first in range(0, len(windows), 64):
        part = windows[first : first + 64]
        spectra = np.fft.rfft((part - part.mean(axis=1, keepdims=True)) * hann)
        power = spectra.real**2 + spectra.imag**2
        for column in range(2):  # not by BLAS, whose sums differ between machines
            sums[first : first + 64, column] = (power * weights[:, column]).sum(axis=1)
    return sums


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
def count_crossings(angle_deg, valid, rate_hz, part_rows, counts):  # type: ignore[no-untyped-def]
    """Count, in each part, the changes of direction: from faster than the dead band one way to the other."""
    part, direction = 0, 0
    for i in range(1, len(angle_deg)):
        if not (valid[i] and valid[i - 1]):
            direction = 0
            continue
        speed_dps = (angle_deg[i] - angle_deg[i - 1]) * rate_hz
        way = 1 if speed_dps > DEAD_BAND_DPS else (-1 if speed_dps < -DEAD_BAND_DPS else 0)
        if way != 0:
            if way == -direction:
                while i >= part_rows[part + 1]:
                    part += 1
                counts[part] += 1
            direction = way
