"""Match the clocks of two sensors on one person by the movement that their bodies share.

Walking, turning, getting up and bending move both arms and the trunk at once. The magnitude of the
acceleration shows this without knowledge of the mounting. Over seven half-hours of motion capture it
correlates by 0.7 to 0.9 between the two upper arms; the speed of the elevation correlates by 0.1 to 0.5.

1. Signal: magnitude of the acceleration, less its mean over 2 s, on a grid of 10 Hz; 0 in gaps.
2. Windows of a minute are searched in the whole of the other recording. Without shared movement, the best
   place of a window is random.
3. The line through most of these places, searched up to a drift of 200 ppm, is the match. The best line
   elsewhere is its rival: chance puts one or two windows on a line, a clock that was set in between more.
4. Every window is placed again near the line, to a fraction of a sample; the final line is fitted to these
   places (Theil and Sen), and their scatter gives the margin. Its drift is not limited: the oscillator of a
   microcontroller may be worse than 200 ppm, and places on one line are the evidence.

Two people who move in step share movement too. A match is searched only between recordings that a person
states to be of one subject.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import uniform_filter1d
from scipy.stats import theilslopes

from acromion.fusion.angle_files.elevation_parquet import ACCELERATION, STEPS_PER_G, UNREADABLE
from acromion.fusion.comparison.alignment import SHORTEST_ROWS, Run, Runs, interpolate
from acromion.fusion.errors import NotAligned, NothingInCommon, UnreadableFile
from acromion.fusion.recording import MICROSECONDS, BoolArray, Float64Array

GRID_HZ = 10.0
MEAN_S = 2.0
MOST_G = 1.0
"""A stronger acceleration counts as this; otherwise a single shock would dominate."""

WINDOW_S = 60.0
MOST_SEARCHED = 60
"""A longer recording is cut into this many equal parts; the window of each with most movement is searched."""

LEAST_MOVEMENT_G = 0.02
"""A window with a smaller root mean square contains nothing to search for."""

MOST_PPM = 200.0
NEAR_S, REACH_S, CORE_S = 0.3, 1.0, 0.15
PLACED_R = 0.4
STEP_WITHIN_S = 0.1
"""After a step of the clock, the places are this close to one another."""
LEAST_WINDOWS = 5
MOST_RIVAL = 0.5
MOST_MARGIN_S = 0.05
TIMING_S = 0.02
"""Part of the margin that more windows do not reduce: the time between samples, and how the body moves."""


@dataclass(frozen=True, slots=True)
class ClockMatch:
    """The relation of two clocks: ``other = (own - offset_s) * pace``, each from its own first sample.

    ``offset_s``: start of the other recording, in seconds after this one, on the clock of this one.
    ``drift_ppm``: how much faster the other clock runs.
    ``margin_s``: 95 % limit of the error anywhere in the common time.
    ``windows``, ``searched``: windows of a minute that agree, and those with movement that were searched.
    """

    offset_s: float
    drift_ppm: float
    margin_s: float
    windows: int
    searched: int


@dataclass(frozen=True, slots=True)
class _Place:
    """The match of a window: its middle on this recording's clock, and the other clock minus this one, s."""

    start: int
    time_s: float
    lag_s: float


def match_clocks(own: Runs, other: Runs) -> ClockMatch:
    """Return the relation of the clocks of two sensors on one body; both in g, from their first samples.

    Raises
    ------
    NothingInCommon
        A side without acceleration.
    NotAligned
        Fewer than five windows agree (``motion_s``), five or half as many agree on another shift (``rival``),
        or the relation is not known to 50 ms (``margin_s``).
    """
    if not own or not other:
        raise NothingInCommon(s=0.0)
    signal, target = _sample(own), _sample(other)
    found = list(_search(signal, target))
    times_s, lags_s = (np.array([getattr(place, name) for place in found]) for name in ("time_s", "lag_s"))
    slope, lag_s, agrees = _find_line(times_s, lags_s)
    windows = int(agrees.sum())
    if windows < LEAST_WINDOWS:
        raise NotAligned(motion_s=windows * WINDOW_S, least_s=LEAST_WINDOWS * WINDOW_S)
    elsewhere = np.abs(lags_s - lag_s - slope * times_s) > REACH_S
    rival = int(_find_line(times_s[elsewhere], lags_s[elsewhere])[2].sum())
    if rival >= LEAST_WINDOWS or rival > MOST_RIVAL * windows:
        raise NotAligned(best=float(windows), rival=float(rival))
    placed = list(_place_again(signal, target, slope, lag_s))
    if len(placed) < LEAST_WINDOWS:
        raise NotAligned(motion_s=len(placed) * WINDOW_S, least_s=LEAST_WINDOWS * WINDOW_S)
    slope, lag_s, margin_s = _fit(placed, own, other)
    if margin_s > MOST_MARGIN_S:
        raise NotAligned(margin_s=round(margin_s, 3), most_s=MOST_MARGIN_S)
    # the grids begin at the first acceleration, half a block after the first sample
    own_s, other_s, pace = own[0].start_s, other[0].start_s, 1.0 + slope
    at_zero_s = other_s + lag_s - own_s * pace
    return ClockMatch(-at_zero_s / pace, slope * 1e6, margin_s, windows, len(found))


def _sample(runs: Runs) -> Float64Array:
    """Return the signal on the grid from the first row of the runs; 0 in gaps."""
    start_s = runs[0].start_s
    signal = np.zeros(int((runs[-1].end_s - start_s) * GRID_HZ) + 1)
    for run in runs:
        first = max(0, int(np.ceil((run.start_s - start_s) * GRID_HZ - 1e-6)))
        stop = min(len(signal), int(np.floor((run.end_s - start_s) * GRID_HZ + 1e-6)) + 1)
        if stop - first >= SHORTEST_ROWS and len(run) >= SHORTEST_ROWS:
            values = interpolate(run, start_s + np.arange(first, stop) / GRID_HZ)
            signal[first:stop] = values - uniform_filter1d(values, int(MEAN_S * GRID_HZ), mode="nearest")
    return np.clip(signal, -MOST_G, MOST_G)


def _list_windows(signal: Float64Array) -> Iterator[int]:
    """Yield the first row of each whole window with movement."""
    rows = int(WINDOW_S * GRID_HZ)
    for start in range(0, len(signal) - rows + 1, rows):
        if _measure_energy(signal[start : start + rows]) >= rows * LEAST_MOVEMENT_G**2:
            yield start


def _measure_energy(values: Float64Array) -> float:
    return float(values @ values)


def _search(signal: Float64Array, target: Float64Array) -> Iterator[_Place]:
    """Yield where each searched window fits best in the whole target."""
    rows = int(WINDOW_S * GRID_HZ)
    starts = np.array(list(_list_windows(signal)), np.int64)
    parts = np.array_split(starts, MOST_SEARCHED) if len(starts) > MOST_SEARCHED else starts[:, None]
    size = next_fast_len(len(target) + rows, real=True)
    spectrum = rfft(target, size)
    sums = np.concatenate([np.zeros(rows), np.cumsum(target**2), np.full(rows - 1, _measure_energy(target))])
    energies = sums[rows:] - sums[:-rows]  # of the target under a window that begins at 1 - rows and later
    for part in parts:
        start = max(part.tolist(), key=lambda row: _measure_energy(signal[row : row + rows]))
        window = signal[start : start + rows]
        product = irfft(spectrum * np.conj(rfft(window, size)), size)
        product = np.concatenate([product[size - rows + 1 :], product[: len(target)]])
        own = _measure_energy(window)
        best = int(np.argmax(product / np.sqrt(own * np.maximum(energies, own / 4.0))))
        lag_s = (best - rows + 1 - start) / GRID_HZ
        yield _Place(start, start / GRID_HZ + WINDOW_S / 2.0, lag_s)


def _find_line(times_s: Float64Array, lags_s: Float64Array) -> tuple[float, float, BoolArray]:
    """Return the slope and height of the line near most lags, and which lags are near it."""
    best: tuple[float, float, BoolArray] = (0.0, 0.0, np.zeros(len(times_s), np.bool_))
    steepest = MOST_PPM / 1e6
    for time_s, lag_s in zip(times_s.tolist(), lags_s.tolist(), strict=True):
        after_s, above_s = times_s - time_s, lags_s - lag_s
        reachable = np.flatnonzero(np.abs(above_s) <= NEAR_S + steepest * np.abs(after_s))
        if len(reachable) <= best[2].sum():
            continue
        for k in reachable.tolist():
            slope = float(above_s[k] / after_s[k]) if after_s[k] else 0.0
            slope = min(max(slope, -steepest), steepest)
            near = np.abs(above_s - slope * after_s) <= NEAR_S
            if near.sum() > best[2].sum():
                best = (slope, lag_s - slope * time_s, near)
    return best


def _place_again(signal: Float64Array, target: Float64Array, slope: float, lag_s: float) -> Iterator[_Place]:
    """Yield the place of every window within a second of the line, to a fraction of a row."""
    rows, reach = int(WINDOW_S * GRID_HZ), int(REACH_S * GRID_HZ)
    for start in _list_windows(signal):
        time_s = start / GRID_HZ + WINDOW_S / 2.0
        first = start + round((lag_s + slope * time_s) * GRID_HZ) - reach
        if first < 0 or first + rows + 2 * reach > len(target):
            continue
        window, part = signal[start : start + rows], target[first : first + rows + 2 * reach]
        own, sums = _measure_energy(window), np.concatenate([[0.0], np.cumsum(part**2)])
        energies = np.maximum(sums[rows:] - sums[:-rows], own / 4.0)
        score = np.correlate(part, window, "valid") / np.sqrt(own * energies)
        best = int(np.argmax(score))
        if not 0 < best < len(score) - 1 or score[best] < PLACED_R:
            continue
        before, peak, after = score[best - 1 : best + 2].tolist()
        bend = before - 2.0 * peak + after
        shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
        yield _Place(start, time_s, (first + best + shift - start) / GRID_HZ)


def _fit(placed: Sequence[_Place], own: Runs, other: Runs) -> tuple[float, float, float]:
    """Return slope, height and margin of the line through most places.

    The margin is that at the worst end of the line, or the distance of five consecutive places from it.

    Raises NotAligned: from some time on the places agree on another offset, because a clock was set.
    """
    every_s, places_s = (np.array([getattr(place, name) for place in placed]) for name in ("time_s", "lag_s"))
    times_s, lags_s = every_s, places_s
    for _ in range(2):  # then once more without the windows that are off the line
        slope = float(theilslopes(lags_s, times_s).slope)
        lag_s = float(np.median(lags_s - slope * times_s))
        near = np.abs(lags_s - lag_s - slope * times_s) <= CORE_S
        times_s, lags_s = times_s[near], lags_s[near]
    _refuse_step(times_s, every_s, places_s - lag_s - slope * every_s)
    residuals_s = lags_s - lag_s - slope * times_s
    spread_s = 1.4826 * float(np.median(np.abs(residuals_s)))
    ends_s = np.array(
        [max(0.0, -lag_s), min(own[-1].end_s - own[0].start_s, other[-1].end_s - other[0].start_s - lag_s)]
    )
    middle_s = times_s.mean()
    leverage = (ends_s - middle_s) ** 2 / max(float(np.sum((times_s - middle_s) ** 2)), 1e-9)
    worst_s = float(np.max(spread_s * np.sqrt(1.0 / len(lags_s) + leverage)))
    groups = np.array_split(residuals_s, max(1, len(residuals_s) // LEAST_WINDOWS))
    bend_s = max(abs(float(np.median(group))) for group in groups)
    return slope, lag_s, TIMING_S + max(1.96 * 1.25 * worst_s, bend_s)  # 1.25: a median scatters more


def _refuse_step(near_s: Float64Array, every_s: Float64Array, residuals_s: Float64Array) -> None:
    """Raise NotAligned if, from some time on or until then, the places agree on another offset than the line.

    ``near_s``: times of the places near the line. ``every_s``, ``residuals_s``: of all places. Movement that
    one sensor shows later than the other also agrees on another offset, but only for some minutes.
    """
    is_off = np.abs(residuals_s) > CORE_S
    off_s, by_s = every_s[is_off], np.sort(residuals_s[is_off])
    counts = np.searchsorted(by_s, by_s + STEP_WITHIN_S) - np.arange(len(by_s))
    rival = int(counts.max(initial=0))
    if rival < LEAST_WINDOWS:
        return
    beyond_s = residuals_s[is_off] - by_s[int(np.argmax(counts))]
    agree_s = off_s[(beyond_s >= 0.0) & (beyond_s < STEP_WITHIN_S)]
    if near_s.max() < agree_s.min() or near_s.min() > agree_s.max():
        raise NotAligned(best=float(len(near_s)), rival=float(rival))


def read_movement(path: Path) -> Runs:
    """Return the acceleration of an ``elevation.parquet``, g, from the first sample; empty if none is stored.

    Raises
    ------
    UnreadableFile
    OSError
        The file cannot be opened.
    """
    try:
        if ACCELERATION not in pq.read_schema(path).names:
            return ()
        is_known = pc.field(ACCELERATION).is_valid()
        table = pq.read_table(path, columns=["time_us", ACCELERATION], filters=is_known)
    except UNREADABLE as error:
        raise UnreadableFile from error
    time_us, acceleration_cg = (column.to_numpy() for column in table.columns)
    if len(time_us) < SHORTEST_ROWS:
        return ()
    steps_us = np.diff(time_us)
    step_us = float(np.median(steps_us))
    cuts = [0, *(np.flatnonzero(np.abs(steps_us - step_us) > step_us / 2.0) + 1).tolist(), len(time_us)]
    acceleration_g = (acceleration_cg / STEPS_PER_G).astype(np.float32)
    runs = []
    for a, b in pairwise(cuts):
        if b - a >= SHORTEST_ROWS:
            first_us, last_us = float(time_us[a]), float(time_us[b - 1])
            start_s = (first_us + step_us / 2.0) / MICROSECONDS  # a mean belongs to the middle of its rows
            runs.append(Run(start_s, (b - a - 1) * MICROSECONDS / (last_us - first_us), acceleration_g[a:b]))
    return tuple(runs)
