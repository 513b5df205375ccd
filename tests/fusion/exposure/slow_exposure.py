"""The metrics once more, slow and obvious: plain loops over runs, nothing shared with the fast ones.

Takes elevation that is sampled under 20 Hz, which is not filtered.
"""

import statistics
from itertools import groupby, pairwise

from acromion.fusion.elevation import Elevation

Row = tuple[float, float]  # when it begins in seconds, angle
Run = list[Row]


def list_runs(elevation: Elevation) -> list[tuple[Run, float]]:
    """Return the unbroken runs of valid rows, each with the length of a row."""
    runs: list[tuple[Run, float]] = []
    for segment in elevation.segments:
        period_s = 1 / segment.rate_hz
        rows = [
            (segment.start_us / 1e6 + i * period_s, float(angle), bool(valid))
            for i, (angle, valid) in enumerate(zip(segment.elevation_deg, segment.valid, strict=True))
        ]
        for valid, group in groupby(rows, key=lambda row: row[2]):
            if valid:
                runs.append(([(time_s, angle) for time_s, angle, _ in group], period_s))
    return runs


def _states(run: Run, threshold_deg: float) -> list[bool]:
    states: list[bool] = []
    for _, angle in run:
        before = states[-1] if states else False
        states.append(angle >= threshold_deg - 5 if before else angle > threshold_deg + 5)
    return states


def count_entries(elevation: Elevation, threshold_deg: float) -> int:
    count = 0
    for run, _ in list_runs(elevation):
        states = _states(run, threshold_deg)
        count += sum(now and not before for before, now in pairwise(states))
    return count


def list_episodes(elevation: Elevation, threshold_deg: float) -> list[tuple[float, float, bool]]:
    """Return (start, duration, censored) in time order."""
    episodes = []
    for run, period_s in list_runs(elevation):
        stays: list[list[int]] = []
        row = 0
        for above, group in groupby(_states(run, threshold_deg)):
            length = len(list(group))
            if above:
                stays.append([row, row + length])
            row += length
        merged: list[list[int]] = []
        for first, stop in stays:
            if merged and (first - merged[-1][1]) * period_s < 0.5 - 1e-9:
                merged[-1][1] = stop
            else:
                merged.append([first, stop])
        episodes += [
            (run[first][0], (stop - first) * period_s, stop == len(run))
            for first, stop in merged
            if (stop - first) * period_s >= 0.5 - 1e-9
        ]
    return episodes


def median_episode(elevation: Elevation, threshold_deg: float) -> float | None:
    durations = [duration_s for _, duration_s, _ in list_episodes(elevation, threshold_deg)]
    return statistics.median(durations) if durations else None


def find_worst_window(elevation: Elevation, length_s: int, duration_s: float) -> tuple[int, float] | None:
    """Return (start, percent above 60) of the worst window; of equal ones the earliest."""
    rows = [(*row, period_s) for run, period_s in list_runs(elevation) for row in run]
    best: tuple[int, float] | None = None
    for start_s in range(int(duration_s) - length_s + 1):
        inside = [
            (angle, period_s)
            for time_s, angle, period_s in rows
            if start_s - 1e-6 <= time_s < start_s + length_s - 1e-6
        ]
        analysed_s = sum(period_s for _, period_s in inside)
        if analysed_s < 0.8 * length_s - 1e-9:
            continue
        percent = 100 * sum(period_s for angle, period_s in inside if angle >= 60) / analysed_s
        if best is None or percent > best[1] + 1e-7:
            best = (start_s, percent)
    return best
