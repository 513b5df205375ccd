"""Where the arm was held still: windows that could be the calibration pose, and those that a person chose."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.errors import UnusableCalibration
from fusion.pose.postures import (
    MINUTE_STRIDING,
    SURE_STRIDING,
    find_angle_deg,
    find_hanging,
    find_striding_moments,
)
from fusion.pose.rules import CalibrationRules, rules_for, score_still_period, score_still_periods
from fusion.pose.wear import Wear, WearPart, count_readable, divide_by_wear
from fusion.recording import MICROSECONDS, Float64Array, Recording, Segment
from fusion.sensor.accelerometer import calibrate_accelerometer, leave_accelerometer
from fusion.sensor.model import view_segment
from fusion.sensor.stillness import (
    QuarterSeconds,
    QuietTable,
    find_still_moments,
    reduce_run,
    summarise_windows,
)

# Which quiet stretches could be the calibration pose, and how good each is.


def find_quiet_windows(blocks: Sequence[QuarterSeconds], rules: CalibrationRules) -> QuietTable:
    """Windows of the length a pose is held for that are still and near 1 g."""
    table = summarise_windows(blocks, rules.length_s)
    still = (table.acc_sd_g < rules.quiet_acc_sd_g) & (table.gyro_sd_dps < rules.quiet_gyro_sd_dps)
    quiet = table.select(np.flatnonzero(still))
    return quiet.select(np.abs(np.linalg.norm(quiet.gravity_g, axis=1) - 1.0) < rules.one_g_within)


def join_stretches(quiet: QuietTable, rules: CalibrationRules) -> tuple[NDArray[np.intp], Float64Array]:
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

    hangs: Float64Array
    is_sure: bool
    is_fresh: bool


def rank_stretches(
    windows: QuietTable, end_s: Float64Array, rules: CalibrationRules, walking: Witness | None = None
) -> Float64Array:
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


def _hang(gravity_g: Float64Array, walking: Witness, rules: CalibrationRules) -> Float64Array:
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


def _agree(gravity_g: Float64Array, seconds: Float64Array, within_deg: float) -> Float64Array:
    """Seconds of stillness near each direction; counted in cells of 5 deg, so that a long day stays cheap."""
    unit = gravity_g / np.linalg.norm(gravity_g, axis=1, keepdims=True)
    _, rows, cell = np.unique(np.round(unit / 0.09), axis=0, return_index=True, return_inverse=True)
    cell = cell.ravel()
    in_cell = np.bincount(cell, weights=seconds)
    near = unit[rows] @ unit[rows].T >= np.cos(np.radians(within_deg))
    return np.asarray((near @ in_cell)[cell])


# The arm axis from two poses, hanging and level.


def share_between(hanging_g: Float64Array, level_g: Float64Array) -> Float64Array:
    """Arm axis for the two-point pose.

    With ``gamma`` the angle between both gravity directions, the axis lies in their plane, turned from the
    hanging direction towards the level one by ``(gamma - 90 deg) / 2``: hanging then reads ``|gamma - 90| /
    2`` and level ``90 + (gamma - 90) / 2``, the least-squares answer when both poses are trusted alike.
    """
    first, second = scale_to_unit(hanging_g), scale_to_unit(level_g)
    across = scale_to_unit(second - (first @ second) * first)
    turn = np.radians(find_angle_deg(first, second) - 90.0) / 2.0
    return np.asarray(np.cos(turn) * first + np.sin(turn) * across)


def scale_to_unit(vector: Float64Array) -> Float64Array:
    """The same direction at length 1."""
    return np.asarray(vector / np.linalg.norm(vector))


Blocks = Sequence[QuarterSeconds]
WHOLE_DAY_S = (-np.inf, np.inf)
TWICE = 2


@dataclass(frozen=True, slots=True, eq=False)
class StillPeriod:
    """A stretch in which the arm did not move.

    Attributes
    ----------
    start_s, duration_s
        Seconds from the recording's first sample.
    gravity_g
        Shape (3,): mean acceleration, points to the zenith.
    gyro_bias_dps
        Shape (3,): mean angular rate.
    score
        0 to 1: how still, how near 1 g, how long (definition in ``score_still_period``).
    """

    start_s: float
    duration_s: float
    gravity_g: Float64Array
    gyro_bias_dps: Float64Array
    score: float


def propose_still_periods(recording: Recording, most: int = 5) -> tuple[StillPeriod, ...]:
    """Quiet stretches of 5 to 10 s that could be the calibration pose, the likeliest first.

    The order is by the product of three factors. Good enough: the score, where it is under a half. Early:
    halved after ten minutes. Hanging: within 10 deg of the direction in which the arm hangs while walking;
    half at 20 deg, hardly beyond. Where the first stretch does not hang like that, no pose may have been
    held, and nearer is better (half at 10 deg); less than five minutes of walking do not outvote the first
    stretch if the arm was held like that again. Where nobody walked, seen again: how much of the still time
    has the same direction of gravity within 20 deg, where that is under a quarter of the commonest
    direction's; this puts behind a sensor that lay on a desk before it was strapped on. Each stretch of
    stillness counts for at most 10 s.

    Where the sensor slipped or was off, each part has an order of its own, by its own walking: first the
    proposals of the part in which the pose is sought, then the best one of each other part.
    """
    blocks = reduce_recording(recording)
    stills = find_still_moments(blocks)
    wear = divide_by_wear(blocks, stills, calibrate_accelerometer(stills))
    return _propose_by_part(recording, blocks, wear, most)


def choose_still_period(recording: Recording, blocks: Blocks, wear: Wear) -> StillPeriod:
    """The best proposal; where nothing is quiet for 5 s, the best 2 s (W-NO-STILL).

    Raises
    ------
    UnusableCalibration
        ``why`` "none": no 2 s in one piece; "moving": even the best 2 s move too much.
    """
    proposals = _propose_by_part(recording, blocks, wear, 1)
    return proposals[0] if proposals else _find_best_moment(recording, blocks)


def _propose_by_part(recording: Recording, blocks: Blocks, wear: Wear, most: int) -> tuple[StillPeriod, ...]:
    """Proposals of the whole day, or where the sensor slipped or was off, of its parts.

    How the arm hangs is seen in another direction after a slip: by the walking of a whole day a raised arm
    before the slip may pass for a hanging one.
    """
    found = _propose(recording, blocks, most)
    pose_parts = wear.find_parts_for_pose(found[0].start_s) if found else ()
    by_part = {part.start_s: _propose(recording, blocks, most, part) for part in pose_parts}
    pose_part_s = _choose_part(wear, [part for part in pose_parts if by_part[part.start_s]], by_part)
    if pose_part_s is None:
        return found
    others = [part for part in wear.parts if part.start_s != pose_part_s] if most > 1 else []
    best = [_propose(recording, blocks, 1, part) for part in others]
    elsewhere = [proposals[0] for proposals in best if proposals][: most - 1]
    return (*by_part[pose_part_s][: most - len(elsewhere)], *elsewhere)


def _choose_part(
    wear: Wear, pose_parts: Sequence[WearPart], by_part: dict[float, tuple[StillPeriod, ...]]
) -> float | None:
    """When the part begins in which the pose is sought; None where no part has a proposal.

    A pose is held when the sensor has just been strapped on: the first part, unless a later one in which
    walking tells how the arm hung reads twice as much of the day. Minutes before a slip do not cost the rest.
    """
    if not pose_parts:
        return None
    reads = {
        part.start_s: count_readable(wear, (still.start_s, scale_to_unit(still.gravity_g)))
        for part in pose_parts
        for still in by_part[part.start_s][:1]
    }
    first = pose_parts[0].start_s
    later = [part.start_s for part in pose_parts[1:] if len(part.strides.up) >= MINUTE_STRIDING]
    longest = max(later, key=lambda start_s: reads[start_s], default=first)
    return longest if reads[longest] >= TWICE * reads[first] else first


def reduce_recording(recording: Recording) -> list[QuarterSeconds]:
    """Every segment in blocks of a quarter second."""
    return [reduce_run(view_segment(segment)) for segment in recording.segments]


def _propose(
    recording: Recording,
    blocks: Blocks,
    most: int,
    part: WearPart | None = None,
) -> tuple[StillPeriod, ...]:
    """Propose windows of the whole day, or of a part of it."""
    within_s = (part.start_s, part.end_s) if part else WHOLE_DAY_S
    rules = rules_for(recording.device)
    quiet = find_quiet_windows(blocks, rules)
    quiet = quiet.select(
        (quiet.start_s >= within_s[0]) & (quiet.start_s + rules.longest_proposal_s <= within_s[1])
    )
    if len(quiet) == 0:
        return ()
    first, end_s = join_stretches(quiet, rules)
    walking = _find_walking(blocks, within_s, is_fresh=part is None or part.opens)
    order = np.argsort(-rank_stretches(quiet.select(first), end_s, rules, walking), kind="stable")[:most]
    return tuple(_measure(recording, float(quiet.start_s[first[k]]), float(end_s[k]), rules) for k in order)


def _find_walking(blocks: Blocks, within_s: tuple[float, float], *, is_fresh: bool) -> Witness | None:
    strides = find_striding_moments(blocks, leave_accelerometer()).within(*within_s)
    hangs = find_hanging(strides)
    return None if hangs is None else Witness(hangs, len(strides.up) >= SURE_STRIDING, is_fresh)


def measure_pair(
    recording: Recording, windows_s: tuple[tuple[float, float], ...]
) -> tuple[StillPeriod, StillPeriod]:
    """Measure the two windows of the two-point pose, hanging and level.

    Raises
    ------
    UnusableCalibration
    """
    if len(windows_s) != 2:
        raise UnusableCalibration(why="count", start_s=0.0, end_s=0.0)
    hanging, level = (measure_asked(recording, window) for window in windows_s)
    if not 60.0 <= find_angle_deg(hanging.gravity_g, level.gravity_g) <= 120.0:
        raise UnusableCalibration(why="angle", start_s=windows_s[1][0], end_s=windows_s[1][1])
    return hanging, level


def measure_asked(recording: Recording, window_s: tuple[float, float]) -> StillPeriod:
    """Measure a window that a person chose.

    Raises
    ------
    UnusableCalibration
    """
    start_s, end_s = window_s
    rules = rules_for(recording.device)
    why = _object_to(recording, start_s, end_s, rules)
    if why:
        raise UnusableCalibration(why=why, start_s=start_s, end_s=end_s)
    still = _measure(recording, start_s, end_s, rules)
    _refuse_motion(recording, still, rules)
    return still


def _object_to(recording: Recording, start_s: float, end_s: float, rules: CalibrationRules) -> str:
    if start_s < 0.0 or end_s * MICROSECONDS > recording.duration_us + 1 or not np.isfinite(end_s - start_s):
        return "outside"
    if end_s - start_s < rules.shortest_window_s - 1e-9:
        return "short"
    return "" if _segment_around(recording, start_s, end_s) else "hole"


def _refuse_motion(recording: Recording, still: StillPeriod, rules: CalibrationRules) -> None:
    acc, gyr = _cut(recording, still.start_s, still.start_s + still.duration_s)
    why = ""
    if acc.std(axis=0).max() > rules.refuse_acc_sd_g or gyr.std(axis=0).max() > rules.refuse_gyro_sd_dps:
        why = "moving"
    elif abs(float(np.linalg.norm(still.gravity_g)) - 1.0) > rules.refuse_from_one_g:
        why = "gravity"
    if why:
        raise UnusableCalibration(why=why, start_s=still.start_s, end_s=still.start_s + still.duration_s)


def _segment_around(recording: Recording, start_s: float, end_s: float) -> Segment | None:
    for segment in recording.segments:
        slack_s = 1.5 / segment.rate_hz
        if segment.start_s - slack_s <= start_s and end_s <= segment.end_us / MICROSECONDS + slack_s:
            return segment
    return None


def _cut(recording: Recording, start_s: float, end_s: float) -> tuple[Float64Array, Float64Array]:
    segment = _segment_around(recording, start_s, end_s)
    if segment is None:
        raise UnusableCalibration(why="hole", start_s=start_s, end_s=end_s)
    first = max(0, round((start_s - segment.start_s) * segment.rate_hz))
    stop = max(first + 1, round((end_s - segment.start_s) * segment.rate_hz))
    rows = slice(first, stop)
    return segment.acc_g[rows].astype(np.float64), segment.gyr_dps[rows].astype(np.float64)


def _measure(recording: Recording, start_s: float, end_s: float, rules: CalibrationRules) -> StillPeriod:
    acc, gyr = _cut(recording, start_s, end_s)
    gravity = acc.mean(axis=0)
    score = score_still_period(end_s - start_s, float(acc.std(axis=0).max()), gravity, rules)
    return StillPeriod(start_s, end_s - start_s, gravity, gyr.mean(axis=0), score)


def _find_best_moment(recording: Recording, blocks: Blocks) -> StillPeriod:
    rules = rules_for(recording.device)
    table = summarise_windows(blocks, rules.fallback_s)
    if len(table) == 0:
        raise UnusableCalibration(why="none", start_s=0.0, end_s=recording.duration_us / MICROSECONDS)
    off = np.abs(np.linalg.norm(table.gravity_g, axis=1) - 1.0)
    best = int(np.argmin(table.acc_sd_g + 0.01 * table.gyro_sd_dps + off))
    start_s = float(table.start_s[best])
    still = _measure(recording, start_s, start_s + table.duration_s, rules)
    _refuse_motion(recording, still, rules)
    return still
