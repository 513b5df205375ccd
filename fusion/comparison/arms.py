"""Compare both arms of one shift, and the arm with the trunk.

The two recordings are put on one time axis by their clocks and an offset that the person may correct. Only
time in which both are valid is compared. The angles pass the metric filter first and are read on a 20 Hz
grid.
"""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from acromion.fusion.elevation import Elevation
from acromion.fusion.errors import TooShort
from acromion.fusion.exposure.bins import CELLS, CELLS_PER_DEG, THRESHOLDS_DEG
from acromion.fusion.exposure.metric_filter import MetricAngle, filter_elevation
from acromion.fusion.exposure.resampling import (
    DRAWS,
    Figures,
    draw_blocks,
    draw_errors,
    find_intervals,
    sum_below,
)
from acromion.fusion.exposure.types import LEAST_RANGED_S, Interval
from acromion.fusion.recording import Float64Array, IntArray

BLOCK_S = 300.0
PERCENTS = (10, 50, 90, 99)
RIGHT_SEED = 1
GRID_HZ = 20.0

TrunkLimit = Literal["no trunk sensor", "sagittal plane only"]


def draw_pair(
    time_s: Float64Array, left_deg: Float64Array, right_deg: Float64Array, sigmas_deg: tuple[float, float]
) -> dict[str, Interval]:
    """Return the ranges of the figures of both arms by name, for example ``left_elevation_p50_deg``.

    They are computed like those of a day: 200 draws of the 5-minute blocks of the common time, with the same
    blocks for both arms, because it is one day. Each arm has its own angle error, because each has its own
    sensor and pose.

    ``time_s``, ``left_deg``, ``right_deg``: shape (n,): the points at which both are analysed.
    ``sigmas_deg``: standard deviation of the constant error of the left and of the right angle.
    """
    block_of: IntArray = np.unique(np.floor(time_s / BLOCK_S), return_inverse=True)[1].astype(np.int64)
    lasted = np.bincount(block_of)
    draws = draw_blocks(lasted, sigmas_deg[0])
    # the same quantiles as for the first arm, in an independent random order
    other_errors_deg = np.random.Generator(np.random.PCG64(RIGHT_SEED)).permutation(
        draw_errors(sigmas_deg[1])
    )
    sides = {"left": (left_deg, draws), "right": (right_deg, replace(draws, error_deg=other_errors_deg))}
    drawn: Figures = {}
    for side, (angle_deg, own) in sides.items():
        cell = np.minimum((angle_deg * CELLS_PER_DEG).astype(np.int64), CELLS - 1)
        counts = np.bincount(block_of * CELLS + cell, minlength=len(lasted) * CELLS)
        arm = sum_below(counts.reshape(-1, CELLS), own)
        above = 100.0 * (1.0 - arm.find_shares(THRESHOLDS_DEG))
        angles_deg = arm.find_percentiles(PERCENTS)
        drawn |= {f"{side}_time_above_{c:g}_percent": above[:, k] for k, c in enumerate(THRESHOLDS_DEG)}
        drawn |= {f"{side}_elevation_p{p}_deg": angles_deg[:, k] for k, p in enumerate(PERCENTS)}
    both = np.empty(DRAWS)
    for k, times in enumerate(draws.times):
        first, second = (angle_deg >= 60.0 - own.error_deg[k] for angle_deg, own in sides.values())
        raised = np.bincount(block_of[first & second], minlength=len(lasted))
        both[k] = (times * raised).sum() / (times * lasted).sum()
    drawn["both_above_60_percent"] = 100.0 * both
    for end, name in (("time_above_60", "time_above_60_percent"), ("elevation_p50", "elevation_p50_deg")):
        left, ratios = drawn[f"left_{name}"], np.full(DRAWS, np.nan)
        np.divide(drawn[f"right_{name}"], left, out=ratios, where=left > 0)
        drawn[f"right_to_left_{end}"] = ratios
    return find_intervals(drawn)


@dataclass(frozen=True, slots=True)
class ArmShare:
    """One arm in the time in which both were valid."""

    percentiles_deg: dict[int, float]
    time_above_percent: dict[int, float]


@dataclass(frozen=True, slots=True)
class PairedArms:
    """Both arms over the ``shared_s`` seconds in which both were valid.

    ``both_above_60_percent``: share with both at or above 60 deg at once.
    ``ratio_above_60``: the right arm's time above 60 deg over the left's; None if the left has none.
    ``ratio_p50``: the same for the medians.
    """

    shared_s: float
    left: ArmShare
    right: ArmShare
    both_above_60_percent: float
    ratio_above_60: float | None
    ratio_p50: float | None
    intervals: dict[str, Interval] = field(default_factory=dict)
    """By name (:func:`draw_pair`); empty if the error of an angle is unknown, and under half an hour."""


@dataclass(frozen=True, slots=True)
class TrunkRelative:
    """Elevation of the arm minus the inclination of the trunk, deg.

    ``limit``: key of the text about the limits. The difference of two angles from the vertical is the angle
    between arm and trunk only while both move in the sagittal plane (Schall et al. 2016 found 12.1 deg RMS
    against optical measurement). Without a trunk sensor nothing is computed.
    """

    limit: TrunkLimit
    shared_s: float = 0.0
    percentiles_deg: dict[int, float] | None = None


def pair_arms(
    left: Elevation,
    right: Elevation,
    offset_s: float = 0.0,
    sigmas_deg: tuple[float, float] | None = None,
    drift_ppm: float = 0.0,
) -> PairedArms:
    """Compare two arms.

    ``left``, ``right``: before the metric filter; time excluded by a diary must not be valid.
    ``offset_s``: time of the right recording's first sample, seconds after the left's (negative: before).
    ``sigmas_deg``: standard deviation of the constant error of the left and of the right angle. Without it,
    or with less than half an hour, there are no ranges.
    ``drift_ppm``: how much faster the clock of the right recording runs.

    Raises TooShort: there is no time in which both are valid.
    """
    time_s, a, b = _share_grid(left, right, offset_s, drift_ppm)
    shared_s = len(a) / GRID_HZ
    both = 100.0 * float(np.mean((a >= 60.0) & (b >= 60.0)))
    left_share, right_share = _describe(a), _describe(b)
    return PairedArms(
        shared_s,
        left_share,
        right_share,
        both,
        _divide(right_share.time_above_percent[60], left_share.time_above_percent[60]),
        _divide(right_share.percentiles_deg[50], left_share.percentiles_deg[50]),
        draw_pair(time_s, a, b, sigmas_deg) if sigmas_deg and shared_s >= LEAST_RANGED_S else {},
    )


def relate_to_trunk(
    arm: Elevation, trunk: Elevation | None, offset_s: float = 0.0, drift_ppm: float = 0.0
) -> TrunkRelative:
    """Return the arm's elevation minus the trunk's inclination; without a trunk sensor, only the limit.

    ``trunk`` is also an elevation: 0 upright, as calibrated standing.

    Raises TooShort: there is no time in which both are valid.
    """
    if trunk is None:
        return TrunkRelative("no trunk sensor")
    _, a, b = _share_grid(arm, trunk, offset_s, drift_ppm)
    return TrunkRelative("sagittal plane only", len(a) / GRID_HZ, _find_percentiles(a - b))


def _share_grid(
    first: Elevation, second: Elevation, offset_s: float, drift_ppm: float
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return the points at which both are valid, on the first one's clock, and both angles, shapes (n,)."""
    runs, others = ([filter_elevation(s) for s in arm.segments if len(s)] for arm in (first, second))
    end_s = max((run.start_us / 1e6 + len(run) / run.rate_hz for run in runs), default=0.0)
    time_s = np.arange(int(end_s * GRID_HZ)) / GRID_HZ
    a, b = _read_at(runs, time_s), _read_at(others, (time_s - offset_s) * (1.0 + drift_ppm / 1e6))
    known = np.isfinite(a) & np.isfinite(b)
    if not known.any():
        raise TooShort(s=0.0)
    return time_s[known], a[known], b[known]


def _read_at(runs: list[MetricAngle], time_s: Float64Array) -> Float64Array:
    """Return the angle of the row at each time; NaN if none is valid."""
    angle_deg = np.full(len(time_s), np.nan)
    for run in runs:
        rows = np.floor((time_s - run.start_us / 1e6) * run.rate_hz + 1e-6).astype(np.int64)
        inside = (rows >= 0) & (rows < len(run))
        rows = rows[inside]
        angle_deg[inside] = np.where(run.valid[rows], run.elevation_deg[rows], np.nan)
    return angle_deg


def _describe(angle_deg: Float64Array) -> ArmShare:
    above = {c: 100.0 * float(np.mean(angle_deg >= c)) for c in THRESHOLDS_DEG}
    return ArmShare(_find_percentiles(angle_deg), above)


def _find_percentiles(values: Float64Array) -> dict[int, float]:
    return {p: float(value) for p, value in zip(PERCENTS, np.percentile(values, PERCENTS), strict=True)}


def _divide(right: float, left: float) -> float | None:
    return right / left if left > 0.0 else None
