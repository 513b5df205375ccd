"""The metrics once more, slow and obvious: plain loops over runs, nothing shared with the fast ones.

Takes elevation that is sampled under 20 Hz, which is not filtered.
"""

import statistics
from itertools import groupby, pairwise

from fusion.elevation import Elevation

Row = tuple[float, float]  # when it begins in seconds, angle
Run = list[Row]


def list_runs(elevation: Elevation) -> list[tuple[Run, float]]:
    """Give the unbroken runs of valid rows, each with the length of a row."""
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


def time_between(elevation: Elevation, lower_deg: float, upper_deg: float) -> float:
    return sum(
        period_s
        for run, period_s in list_runs(elevation)
        for _, angle in run
        if lower_deg <= angle < upper_deg or (upper_deg == 180 and angle == 180)
    )


def find_percentile(elevation: Elevation, percent: float) -> float:
    rows = sorted((angle, period_s) for run, period_s in list_runs(elevation) for _, angle in run)
    total_s, reached_s = sum(period_s for _, period_s in rows), 0.0
    for angle, period_s in rows:
        reached_s += period_s
        if reached_s >= total_s * percent / 100 - 1e-9:
            return angle
    raise AssertionError


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
    """Give (start, duration, censored) in time order."""
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
    """Give (start, percent above 60) of the worst window; of equal ones the earliest."""
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


def list_turning_points(run: Run, hysteresis_deg: float) -> list[float]:
    """After a valley comes the highest row before the first that lies the hysteresis below it, and so on."""
    angles = [angle for _, angle in run]
    for i in range(len(angles)):
        high, low = max(angles[: i + 1]), min(angles[: i + 1])
        if high - low >= hysteresis_deg:
            up = angles[i] == high
            break
    else:
        return []
    points, since = [low if up else high], angles[i:]
    while True:
        sign = 1 if up else -1
        extremes = [max(since[: k + 1], key=lambda angle: sign * angle) for k in range(len(since))]
        back = [k for k, angle in enumerate(since) if sign * (extremes[k] - angle) >= hysteresis_deg]
        if not back:
            return [*points, extremes[-1]]
        points.append(extremes[back[0]])
        since, up = since[back[0] :], not up


def count_rainflow(points: list[float]) -> list[tuple[float, float]]:
    """ASTM E1049-85 §5.4.4 in its own words; (range, count)."""
    rest, counted, reading = [], [], list(points)
    while reading:
        rest.append(reading.pop(0))
        while len(rest) >= 3:
            x, y = abs(rest[-1] - rest[-2]), abs(rest[-2] - rest[-3])
            if x < y:
                break
            if len(rest) == 3:
                counted.append((y, 0.5))
                del rest[0]
            else:
                counted.append((y, 1.0))
                del rest[-3:-1]
    return counted + [(abs(b - a), 0.5) for a, b in pairwise(rest)]


def count_cycles(elevation: Elevation, lower_deg: float, upper_deg: float) -> float:
    return sum(
        count
        for run, _ in list_runs(elevation)
        for size, count in count_rainflow(list_turning_points(run, 5))
        if lower_deg <= size < upper_deg
    )


def time_in_eva_cell(
    elevation: Elevation, angles_deg: tuple[float, float], durations_s: tuple[float, float]
) -> float:
    def is_inside(row: Row) -> bool:
        return angles_deg[0] <= row[1] < angles_deg[1] or (angles_deg[1] == 180 and row[1] == 180)

    stays_s = [
        len(list(group)) * period_s
        for run, period_s in list_runs(elevation)
        for inside, group in groupby(run, key=is_inside)
        if inside
    ]
    return sum(stay_s for stay_s in stays_s if durations_s[0] <= stay_s + 1e-9 < durations_s[1])
