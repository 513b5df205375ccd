"""Which quiet stretches could be the calibration pose, and how good each is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.calibration_rules import CalibrationRules, score_still_periods
from fusion.sensor_errors.stillness import QuarterSeconds, QuietTable, summarise_windows

Vector = NDArray[np.float64]


def find_quiet_windows(blocks: Sequence[QuarterSeconds], rules: CalibrationRules) -> QuietTable:
    """Windows of the length a pose is held for that are still and near 1 g."""
    table = summarise_windows(blocks, rules.length_s)
    still = (table.acc_sd_g < rules.quiet_acc_sd_g) & (table.gyro_sd_dps < rules.quiet_gyro_sd_dps)
    quiet = table.select(np.flatnonzero(still))
    return quiet.select(np.abs(np.linalg.norm(quiet.gravity_g, axis=1) - 1.0) < rules.one_g_within)


def join_stretches(quiet: QuietTable, rules: CalibrationRules) -> tuple[NDArray[np.intp], Vector]:
    """First window and end of each stretch of overlapping quiet windows; a long one ends after 10 s."""
    breaks = np.flatnonzero(np.diff(quiet.start_s) > quiet.duration_s) + 1
    first = np.concatenate([np.zeros(1, dtype=np.intp), breaks])
    last = np.concatenate([breaks - 1, [len(quiet) - 1]])
    end_s = quiet.start_s[last] + quiet.duration_s
    return first, np.minimum(end_s, quiet.start_s[first] + rules.longest_proposal_s)


@dataclass(frozen=True, slots=True, eq=False)
class Witness:
    """What walking says of a stretch of wear.

    ``hangs`` (3,): the direction in which the arm hangs; ``is_sure``: five minutes of it or more;
    ``is_fresh``: the sensor was strapped on at the beginning, and the first stretch held still may be the
    pose.
    """

    hangs: Vector
    is_sure: bool
    is_fresh: bool


def rank_stretches(
    windows: QuietTable, end_s: Vector, rules: CalibrationRules, walking: Witness | None = None
) -> Vector:
    """The product that ``propose_still_periods`` describes, from the first window of each stretch."""
    scores = score_still_periods(windows.duration_s, windows.acc_sd_g, windows.gravity_g, rules)
    good = np.minimum(1.0, scores / rules.good_score)
    early = 1.0 / (1.0 + windows.start_s / rules.early_s)
    agreement = _agree(windows.gravity_g, end_s - windows.start_s, rules.same_direction_deg)
    agreed = np.minimum(1.0, agreement / (rules.good_agreement * agreement.max()))
    if walking is not None:
        hanging = _hang(windows.gravity_g, walking, rules)
        if walking.is_fresh and not walking.is_sure:
            hanging[0] = max(hanging[0], agreed[0])
        agreed = hanging
    return np.asarray(good * early * agreed)


def _hang(gravity_g: Vector, walking: Witness, rules: CalibrationRules) -> Vector:
    """1 where the arm hangs as it does in walking, half where nearly so, little elsewhere.

    Where the first stretch is no pose, none may have been held: the nearer to walking then the better.
    """
    cosine = gravity_g @ walking.hangs / np.linalg.norm(gravity_g, axis=1)
    apart_deg = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    is_held = walking.is_fresh and apart_deg[0] <= rules.hanging_deg
    near = np.interp(
        apart_deg, *((rules.held_deg, rules.held) if is_held else (rules.unheld_deg, rules.unheld))
    )
    return np.where(apart_deg <= rules.same_direction_deg, near, rules.elsewhere)


def _agree(gravity_g: Vector, seconds: Vector, within_deg: float) -> Vector:
    """Seconds of stillness near each direction; counted in cells of 5 deg, so that a long day stays cheap."""
    unit = gravity_g / np.linalg.norm(gravity_g, axis=1, keepdims=True)
    _, rows, cell = np.unique(np.round(unit / 0.09), axis=0, return_index=True, return_inverse=True)
    cell = cell.ravel()
    in_cell = np.bincount(cell, weights=seconds)
    near = unit[rows] @ unit[rows].T >= np.cos(np.radians(within_deg))
    return np.asarray((near @ in_cell)[cell])
