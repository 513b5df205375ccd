"""The windows with the most time above 60 deg."""

import numpy as np

from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.resampling import Figures, Resampling
from fusion.exposure.types import PeakWindow
from fusion.numba_kernels import kernel
from fusion.recording import MICROSECONDS, Float64Array, IntArray
from fusion.runs import find_end_us, find_part_rows

WINDOWS_S = (60, 900, 3600)
THRESHOLD_DEG = 60.0
LEAST_COVER = 0.8
QUARTER_HOURS = 3
QUARTER_HOUR_S = 900


class SecondTally:
    """Analysed time and time at or above 60 deg in each second from the first sample.

    ``seconds``, shape (s, 2); the last second may reach past the end of the recording.
    """

    def __init__(self, duration_s: int) -> None:
        """Start with nothing counted."""
        self.seconds = np.zeros((duration_s, 2))

    def add(self, angle: MetricAngle) -> None:
        """Count a segment's valid rows."""
        seconds, rows = _cut_seconds(angle)
        counts = np.zeros((len(rows) - 1, 2), np.int64)
        _count_above(angle.elevation_deg, angle.valid, rows, counts)
        self.seconds[seconds] += counts / angle.rate_hz


def _cut_seconds(angle: MetricAngle) -> tuple[slice, IntArray]:
    """Return the seconds that a segment touches, and the first row of each."""
    first, stop = angle.start_us // MICROSECONDS, -(-find_end_us(angle) // MICROSECONDS)
    return slice(first, stop), find_part_rows(angle, np.arange(first, stop + 1) * MICROSECONDS)


@kernel
def _count_above(angle_deg, valid, rows, counts):  # type: ignore[no-untyped-def]
    """Count valid rows, and those at or above 60 deg, in each part."""
    for part in range(len(rows) - 1):
        for i in range(rows[part], rows[part + 1]):
            if valid[i]:
                counts[part, 0] += 1
                if angle_deg[i] >= THRESHOLD_DEG:
                    counts[part, 1] += 1


def find_peak_windows(seconds: Float64Array, duration_us: int) -> tuple[PeakWindow, ...]:
    """Find the worst windows of 1, 15 and 60 minutes.

    A window starts at a whole second, lies inside the recording, runs across holes, and counts where at least
    80 % of it was analysed; of equal ones the earliest.
    """
    seconds = seconds[: duration_us // MICROSECONDS]
    return tuple(_find_peak_window(seconds, length_s) for length_s in WINDOWS_S)


def find_quarter_hours(seconds: Float64Array, duration_us: int) -> tuple[PeakWindow, ...]:
    """Find up to three windows of 15 minutes with the most time above 60 deg, none of which overlap.

    Each is sought as the worst window is, in what the ones before it leave; none without such time.
    """
    seconds = seconds[: duration_us // MICROSECONDS]
    free = [(0, len(seconds))]
    found: list[PeakWindow] = []
    while free and len(found) < QUARTER_HOURS:
        told = [(_find_peak_window(seconds[a:b], QUARTER_HOUR_S), a, b) for a, b in free]
        window, first, stop = max(told, key=lambda one: one[0].percent_above_60 or 0.0)
        if window.start_s is None or not window.percent_above_60:
            break
        start = first + int(window.start_s)
        found.append(PeakWindow(QUARTER_HOUR_S, float(start), window.percent_above_60))
        free.remove((first, stop))
        free += [(first, start), (start + QUARTER_HOUR_S, stop)]
    return tuple(found)


def _find_peak_window(seconds: Float64Array, length_s: int) -> PeakWindow:
    best, percent = _find_worst_window(seconds[:, 0], seconds[:, 1], length_s)
    return (
        PeakWindow(length_s, float(best), float(percent)) if best >= 0 else PeakWindow(length_s, None, None)
    )


@kernel
def _find_worst_window(analysed_s, above_s, length_s):  # type: ignore[no-untyped-def]
    """Return the first second of the window with the largest share above, and that share; -1 if none."""
    best, highest = -1, -1.0
    analysed, above = 0.0, 0.0
    for i in range(len(analysed_s)):
        analysed += analysed_s[i]
        above += above_s[i]
        if i >= length_s:
            analysed -= analysed_s[i - length_s]
            above -= above_s[i - length_s]
        if i >= length_s - 1 and analysed >= LEAST_COVER * length_s - 1e-6:
            percent = 100.0 * above / analysed
            if percent > highest + 1e-7:  # so that the rounding of sums does not break a tie
                best, highest = i - length_s + 1, percent
    return best, max(highest, 0.0)


class ShiftedSeconds:
    """Valid rows of each second by how many of the levels (60 deg less each error) they reach.

    ``errors_deg`` has shape (g,), evenly spread; ``seconds``, shape (s, g + 1).
    """

    def __init__(self, errors_deg: Float64Array, duration_s: int) -> None:
        """Start with nothing counted."""
        self.errors_deg = errors_deg
        self.seconds = np.zeros((duration_s, len(errors_deg) + 1), np.float32)

    def add(self, angle: MetricAngle) -> None:
        """Count a segment's valid rows."""
        seconds, rows = _cut_seconds(angle)
        lowest = THRESHOLD_DEG - self.errors_deg[-1]
        step = self.errors_deg[1] - self.errors_deg[0]
        how = (rows, lowest, step, 1.0 / angle.rate_hz)
        _count_levels(angle.elevation_deg, angle.valid, how, self.seconds[seconds])

    def draw(self, windows: tuple[PeakWindow, ...], draws: Resampling) -> Figures:
        """Draw the worst windows: the error of the angle alone.

        For each error the worst window is sought again; windows of other days cannot be drawn from this one.
        """
        analysed_s = self.seconds.sum(axis=1, dtype=np.float64)
        above_s = np.cumsum(self.seconds[:, ::-1], axis=1, dtype=np.float64)[:, :-1]
        columns = [np.ascontiguousarray(column) for column in above_s.T]
        found: Figures = {}
        for window in windows:
            if window.start_s is not None:
                shares = [_find_worst_window(analysed_s, column, window.length_s)[1] for column in columns]
                name = f"worst_{window.length_s // 60}_min_above_60_percent"
                found[name] = draws.look_up(np.array(shares), self.errors_deg)
        return found


@kernel
def _count_levels(angle_deg, valid, how, seconds):  # type: ignore[no-untyped-def]
    """Count valid rows by the number of evenly spread levels that they reach."""
    rows, lowest, step, period_s = how
    levels = seconds.shape[1] - 1
    for second in range(len(rows) - 1):
        for i in range(rows[second], rows[second + 1]):
            if valid[i]:
                reached = int(np.floor((angle_deg[i] - lowest) / step + 1e-9)) + 1
                seconds[second, min(max(reached, 0), levels)] += period_s
