"""Parts of a recording in which the two sensors contradict each other, though in the rest they agree.

So does a sensor that was started again in another range, a program that turned an axis over from some hour
on, or a gyroscope that was knocked. The windows that tell the axes of the whole are judged a few at a time.
"""

import numpy as np
from numpy.typing import NDArray

from fusion.gravity_windows import WINDOW_S, GravityWindows, GyroModel, measure_miss
from fusion.recording import QualityFlag

Table = NDArray[np.float64]
LIVELY_G = 0.1
TOGETHER = 6
ODD_SCORE, ODD_MISS_G = 0.5, 0.2
"""Of good recordings, eight windows have a score of 0.39 at most, or miss by less than 0.17 g together."""


def flag_odd_parts(windows: GravityWindows, model: GyroModel) -> tuple[QualityFlag, ...]:
    """Tell the stretches that contradict what holds for the whole (W-MIXED-PART)."""
    miss_g = measure_miss(windows, model)
    blind = GyroModel(np.zeros((3, 3)), np.zeros(3), np.zeros(3))
    blind_g = measure_miss(windows, blind)
    lively = np.flatnonzero(blind_g > LIVELY_G)
    odd = _mark_odd(np.minimum(miss_g, blind_g)[lively], miss_g[lively], blind_g[lively])
    if not odd.any():
        return ()
    starts_s = windows.start_s[lively[odd]]
    spans_s = _join(starts_s)
    seconds = sum(end_s - start_s for start_s, end_s in spans_s)
    facts = {"turns": int(odd.sum())}
    first_s, last_s = spans_s[0][0], spans_s[-1][1]
    return (QualityFlag("W-MIXED-PART", len(spans_s), seconds, first_s, last_s, facts, spans_s),)


def _mark_odd(left_g: Table, miss_g: Table, blind_g: Table) -> NDArray[np.bool_]:
    """Which lively windows are among any six that follow each other and are together as bad as can be."""
    odd = np.zeros(len(left_g), np.bool_)
    for first in range(len(left_g) - TOGETHER + 1):
        some = slice(first, first + TOGETHER)
        miss = float(np.sqrt(np.mean(np.minimum(miss_g[some], 2.0) ** 2)))
        if left_g[some].sum() > ODD_SCORE * blind_g[some].sum() and miss > ODD_MISS_G:
            odd[some] = left_g[some] > ODD_SCORE * blind_g[some]
    return odd


def _join(starts_s: Table) -> tuple[tuple[float, float], ...]:
    """Windows that follow each other closely, as stretches (start, end)."""
    joined: list[tuple[float, float]] = []
    for start_s in np.round(starts_s, 2).tolist():
        if joined and start_s <= joined[-1][1] + WINDOW_S:
            joined[-1] = (joined[-1][0], start_s + WINDOW_S)
        else:
            joined.append((start_s, start_s + WINDOW_S))
    return tuple(joined)
