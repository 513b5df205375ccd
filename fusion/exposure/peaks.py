"""The most loaded minute, quarter of an hour and hour (EXPOSURE.md A7, CONTRACT.md §5 "Windows")."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.rows import find_end_us, find_first_rows
from fusion.exposure.types import PeakWindow
from fusion.recording import MICROSECONDS

WINDOWS_S = (60, 900, 3600)
THRESHOLD_DEG = 60.0
LEAST_COVER = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class SecondTally:
    """Analysed time and time at or above 60 deg in each second from the first sample.

    Shape (s, 2), seconds, filled in place; the last second may reach past the end of the recording.
    """

    seconds: NDArray[np.float64]

    def add(self, angle: MetricAngle) -> None:
        """Count a segment's valid rows."""
        first = angle.start_us // MICROSECONDS
        stop = -(-find_end_us(angle) // MICROSECONDS)
        rows = find_first_rows(angle, np.arange(first, stop + 1) * MICROSECONDS)
        rows[0], rows[-1] = 0, len(angle)
        counts = np.zeros((stop - first, 2), np.int64)
        count_above(angle.elevation_deg, angle.valid, rows, counts)
        self.seconds[first:stop] += counts / angle.rate_hz


@njit(cache=True, nogil=True)
def count_above(angle_deg, valid, rows, counts):  # type: ignore[no-untyped-def]
    """Count valid rows, and those at or above 60 deg, in each part."""
    for part in range(len(rows) - 1):
        for i in range(rows[part], rows[part + 1]):
            if valid[i]:
                counts[part, 0] += 1
                if angle_deg[i] >= THRESHOLD_DEG:
                    counts[part, 1] += 1


def find_peak_windows(tally: SecondTally, duration_us: int) -> tuple[PeakWindow, ...]:
    """Find the worst windows of 1, 15 and 60 minutes.

    A window starts at a whole second, lies inside the recording, runs across holes, and counts where at least
    80 % of it was analysed; of equal ones the earliest.
    """
    whole_seconds = duration_us // MICROSECONDS
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(tally.seconds[:whole_seconds], axis=0)])
    return tuple(_find_peak_window(sums, length_s) for length_s in WINDOWS_S)


def _find_peak_window(sums: NDArray[np.float64], length_s: int) -> PeakWindow:
    if len(sums) <= length_s:
        return PeakWindow(length_s, None, None)
    analysed_s, above_s = (sums[length_s:] - sums[:-length_s]).T
    enough = analysed_s >= LEAST_COVER * length_s - 1e-6
    if not enough.any():
        return PeakWindow(length_s, None, None)
    percent = np.where(enough, 100.0 * above_s / np.maximum(analysed_s, 1e-9), -1.0)
    best = int(np.argmax(np.round(percent, 7)))  # so that the rounding of sums does not break a tie
    return PeakWindow(length_s, float(best), float(percent[best]))
