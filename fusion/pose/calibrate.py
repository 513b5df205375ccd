"""Find the arm axis in the sensor: from a confirmed pose, the first still period, or a stated axis."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from acromion.fusion.conventions import CONFIRMED, SAID_S, CalibrationState, Pose, PoseHeld
from acromion.fusion.errors import UnusableCalibration
from acromion.fusion.numerics import compute_angle_deg, scale_to_unit
from acromion.fusion.pose.rules import (
    ALIKE_DEG,
    ASSUMED_SIGMA_DEG,
    AXIS_SIGMA_DEG,
    MOMENT_SIGMA_DEG,
    RULES,
    WALKING_SIGMA_DEG,
    AxisPart,
    Reading,
    compute_spread_deg,
    estimate_held_sigma,
    estimate_repeated_sigma,
    point_along,
    score_still_period,
    select_distinct_axes,
    window_rejection_reason,
)
from acromion.fusion.pose.wear import (
    MOVED_SHARE,
    Question,
    Wear,
    compare_postures,
    divide_by_wear,
    find_slip,
    find_walking,
    find_wear,
)
from acromion.fusion.recording import MICROSECONDS, Float64Array, Recording, Segment, join_overlapping
from acromion.fusion.sensor.gyroscope import GyroScale, build_identity_gyro_scale
from acromion.fusion.sensor.model import AccelerometerCorrection, GyroBias, view_segment
from acromion.fusion.sensor.self_calibration import (
    CalibratedRun,
    SensorCalibration,
    apply_calibration,
    calibrate_accelerometer,
    calibrate_sensor,
)
from acromion.fusion.sensor.stillness import (
    BLOCK_S,
    QuarterSeconds,
    QuietTable,
    find_still_moments,
    reduce_run,
    summarise_windows,
)
from acromion.fusion.settings import DEFAULT_SETTINGS, AnalysisSettings, CarriedPose

# Stretches in which the arm did not move, and measurements of one.

Blocks = Sequence[QuarterSeconds]
Window = tuple[float, float]
"""Start and end, seconds from the recording's first sample."""


OFF_S, TABLE_SWAY_DPS = 300.0, 0.08
"""With less sway than this, a still sensor is on a table.

Measured: 57 still periods on desks have 0.015 to 0.046 deg/s, three of worn upper arms 0.19 to 0.50, a plate
on the skin of a resting arm 0.32 (a foot on the floor 0.04).
"""


@dataclass(frozen=True, slots=True)
class StillPeriod:
    """A stretch in which the arm did not move.

    ``start_s``, ``duration_s``: seconds from the recording's first sample.
    ``gravity_g``: shape (3,): mean acceleration, points to the zenith.
    ``gyro_bias_dps``: shape (3,): mean angular rate.
    ``score``: 0 to 1: how still, how near 1 g, how long
    (:func:`acromion.fusion.pose.rules.score_still_period`).
    ``sway_dps``: typical distance of the angular
    rate, averaged over quarter seconds, from its median; an arm sways, a table does not.
    ``is_moving``: whether it moves more than a pose; only possible for a window that a person entered.
    """

    start_s: float
    duration_s: float
    gravity_g: Float64Array
    gyro_bias_dps: Float64Array
    score: float
    sway_dps: float = np.inf
    is_moving: bool = False

    @property
    def end_s(self) -> float:
        """Seconds from the recording's first sample."""
        return self.start_s + self.duration_s

    def correct(self, accelerometer: AccelerometerCorrection) -> Float64Array:
        """Return the unit vector to the zenith, (3,), after correction of the accelerometer."""
        return scale_to_unit(
            np.asarray(accelerometer.apply(self.gravity_g, self.start_s + self.duration_s / 2.0))
        )


def reduce_recording(recording: Recording) -> list[QuarterSeconds]:
    """Return every segment as blocks of a quarter second."""
    return [reduce_run(view_segment(segment)) for segment in recording.segments]


def find_still_stretches(blocks: Blocks, accelerometer: AccelerometerCorrection) -> list[Window]:
    """Return start and end of every stretch of at least 5 s that is still and near 1 g, in order."""
    stretches_s: list[Window] = []
    for run in blocks:
        table = summarise_windows([run], RULES.length_s)
        is_still = (table.acc_sd_g < RULES.quiet_acc_sd_g) & (table.gyro_sd_dps < RULES.quiet_gyro_sd_dps)
        quiet = table.select(np.flatnonzero(is_still))
        corrected_g = accelerometer.apply(quiet.gravity_g, quiet.middle_s)
        off_g = (np.abs(np.linalg.norm(read_g, axis=1) - 1.0) for read_g in (quiet.gravity_g, corrected_g))
        quiet = quiet.select(np.minimum(*off_g) < RULES.one_g_within)
        breaks = np.flatnonzero(np.diff(quiet.start_s) > quiet.duration_s) + 1
        parts_s = np.split(quiet.start_s, breaks) if len(quiet) else []
        stretches_s += [(float(part_s[0]), float(part_s[-1] + quiet.duration_s)) for part_s in parts_s]
    return stretches_s


def measure_stretch(recording: Recording, stretch_s: Window) -> StillPeriod:
    """Measure at most the first 10 s of a still stretch."""
    return _measure(recording, stretch_s[0], min(stretch_s[1], stretch_s[0] + RULES.measured_s))


def find_tables(recording: Recording, stretches_s: Sequence[Window], least_s: float = OFF_S) -> list[Window]:
    """Return the still periods of five minutes or more without sway: the sensor was off the arm."""
    long_s = [span_s for span_s in stretches_s if span_s[1] - span_s[0] >= least_s]
    return [span_s for span_s in long_s if measure_stretch(recording, span_s).sway_dps < TABLE_SWAY_DPS]


def is_worn_until_end(recording: Recording) -> bool:
    """Return whether the sensor was worn for more than the last 10 s of a recording of a minute or less.

    A recording that begins less than 10 s before its end, or a table in its last 10 s, shows that it was not.
    """
    blocks = reduce_recording(recording)
    stretches_s = find_still_stretches(blocks, calibrate_accelerometer(find_still_moments(blocks)))
    worn_from_s = max((end_s for _, end_s in find_tables(recording, stretches_s, 0.0)), default=0.0)
    return recording.duration_us / MICROSECONDS - worn_from_s > AT_ONCE_S


def measure_window(recording: Recording, window_s: Window) -> StillPeriod:
    """Measure a window that a person chose; raises UnusableCalibration."""
    check_window(window_s, recording.duration_us)
    return _measure(recording, *window_s, refuses_motion=True)


def check_window(window_s: Window, duration_us: int) -> None:
    """Raise UnusableCalibration if a window is outside the recording or too short."""
    start_s, end_s = window_s
    is_outside = start_s < 0.0 or end_s * MICROSECONDS > duration_us + 1
    if is_outside or end_s - start_s < RULES.shortest_window_s - 1e-9:
        raise UnusableCalibration(why="outside" if is_outside else "short", start_s=start_s, end_s=end_s)


def measure_pair(recording: Recording, windows_s: Sequence[Window]) -> tuple[StillPeriod, StillPeriod]:
    """Measure the two windows of the two-point pose, hanging and level; raises UnusableCalibration."""
    if len(windows_s) != 2:
        raise UnusableCalibration(why="count", start_s=0.0, end_s=0.0)
    hanging, level = (measure_window(recording, window) for window in windows_s)
    if not 60.0 <= compute_angle_deg(hanging.gravity_g, level.gravity_g) <= 120.0:
        raise UnusableCalibration(why="angle", start_s=windows_s[1][0], end_s=windows_s[1][1])
    return hanging, level


def measure_stillest(recording: Recording, blocks: Blocks) -> StillPeriod:
    """Measure the stillest 2 s.

    Raises UnusableCalibration: ``why`` "none": no unbroken 2 s; "moving", "gravity": even these are not at
    rest.
    """
    table = summarise_windows(blocks, RULES.moment_s)
    if len(table) == 0:
        raise UnusableCalibration(why="none", start_s=0.0, end_s=recording.duration_us / MICROSECONDS)
    off_g = np.abs(np.linalg.norm(table.gravity_g, axis=1) - 1.0)
    start_s = float(table.start_s[np.argmin(table.acc_sd_g + 0.01 * table.gyro_sd_dps + off_g)])
    return _measure(recording, start_s, start_s + table.duration_s, refuses_motion=True)


def compute_two_point_axis(hanging_g: Float64Array, level_g: Float64Array) -> Float64Array:
    """Return the arm axis for the two-point pose.

    Let ``gamma`` be the angle between both gravity directions. The axis is in their plane, rotated from the
    hanging direction towards the level one by ``(gamma - 90 deg) / 2``. Hanging then reads ``|gamma - 90| /
    2`` and level ``90 + (gamma - 90) / 2``, the least-squares solution if both poses have the same weight.
    """
    first, second = scale_to_unit(hanging_g), scale_to_unit(level_g)
    across = scale_to_unit(second - (first @ second) * first)
    turn = np.radians(compute_angle_deg(first, second) - 90.0) / 2.0
    return np.asarray(np.cos(turn) * first + np.sin(turn) * across)


def _measure(
    recording: Recording, start_s: float, end_s: float, *, refuses_motion: bool = False
) -> StillPeriod:
    for segment in recording.segments:
        slack_s = 1.5 / segment.rate_hz
        if segment.start_s - slack_s <= start_s and end_s <= segment.end_us / MICROSECONDS + slack_s:
            break
    else:
        raise UnusableCalibration(why="hole", start_s=start_s, end_s=end_s)
    first = max(0, round((start_s - segment.start_s) * segment.rate_hz))
    rows = slice(first, max(first + 1, round((end_s - segment.start_s) * segment.rate_hz)))
    acc, gyr = segment.acc_g[rows].astype(np.float64), segment.gyr_dps[rows].astype(np.float64)
    duration_s, gravity_g, acc_sd_g = end_s - start_s, acc.mean(axis=0), float(acc.std(axis=0).max())
    gyro_sd_dps = float(gyr.std(axis=0).max())
    why = window_rejection_reason(duration_s, acc_sd_g, gravity_g, gyro_sd_dps) if refuses_motion else ""
    if why:
        raise UnusableCalibration(why=why, start_s=start_s, end_s=start_s + duration_s)
    is_moving = acc_sd_g > RULES.quiet_acc_sd_g or gyro_sd_dps > RULES.quiet_gyro_sd_dps
    score = score_still_period(duration_s, acc_sd_g, gravity_g)
    per_block = max(1, round(BLOCK_S * len(gyr) / duration_s))
    rates = gyr[: len(gyr) // per_block * per_block].reshape(-1, per_block, 3).mean(axis=1)
    sway_dps = float(np.median(np.linalg.norm(rates - np.median(rates, axis=0), axis=1)))
    return StillPeriod(start_s, duration_s, gravity_g, gyr.mean(axis=0), score, sway_dps, is_moving)


# Still periods that may be the pose.
#
# A person states when the pose was held, or that it was held at the start of wear. Otherwise the first still
# period of at least 5 s within ten minutes of the start of wear is assumed, and all others in that time are
# candidates. In a still period without sway the sensor is on a table; it is worn from the end of that period
# on.

EARLY_S, HELD_S, AT_ONCE_S, LONGEST_POSE_S = 600.0, 60.0, 10.0, 60.0
MOST_REPEATS = 3


@dataclass(frozen=True, slots=True, eq=False)
class FoundPose:
    """A pose, several that agree, or a substitute for a pose.

    ``time_s``, ``end_s``: when it was held.
    ``axis`` (3,): the arm axis in the sensor.
    ``sigma_deg``: its standard deviation.
    ``repeat_deg``: the largest angle between several poses.
    ``candidates``: the still periods that may be the pose, if it is not confirmed.
    """

    state: CalibrationState
    time_s: float
    end_s: float
    axis: Float64Array
    sigma_deg: float
    repeat_deg: float | None = None
    still: StillPeriod | None = None
    candidates: tuple[StillPeriod, ...] = ()


@dataclass(frozen=True, slots=True)
class EarlyStills:
    """The start of wear, and the still periods in the next ten minutes that may be the pose."""

    worn_from_s: float
    stills: tuple[StillPeriod, ...]


def find_early_stills(
    recording: Recording, wears: Sequence[Wear], stretches_s: Sequence[Window]
) -> list[EarlyStills]:
    """Return the still periods with sway in the first ten minutes of each stretch of wear.

    If none in the whole recording sways, it was made without an arm, and those of up to 60 s are returned.
    """
    sways = any(measure_stretch(recording, span_s).sway_dps >= TABLE_SWAY_DPS for span_s in stretches_s)
    return [_find_in_wear(recording, wear, stretches_s, sways=sways) for wear in wears]


def _find_in_wear(
    recording: Recording, wear: Wear, stretches_s: Sequence[Window], *, sways: bool
) -> EarlyStills:
    worn_from_s, found = wear.worn_from_s, list[StillPeriod]()
    for start_s, end_s in stretches_s:
        if not wear.start_s <= start_s < wear.end_s or end_s <= worn_from_s:
            continue
        if start_s > worn_from_s + EARLY_S:
            break
        still = measure_stretch(recording, (start_s, end_s))
        if still.sway_dps >= TABLE_SWAY_DPS if sways else end_s - start_s <= LONGEST_POSE_S:
            found.append(still)
        elif not found:
            worn_from_s = end_s
    return EarlyStills(worn_from_s, tuple(found))


def assume_pose(
    early: EarlyStills, accelerometer: AccelerometerCorrection, pose_held: PoseHeld | None
) -> FoundPose | None:
    """Return the first still period of wear as the pose; None if there is none.

    If the pose is stated as held at the start, it is confirmed when it starts within 10 s of wear. If it
    starts later in the first minute, other still periods of that minute that disagree with it remain
    candidates.
    """
    at_start = tuple(still for still in early.stills if still.start_s <= early.worn_from_s + HELD_S)
    if pose_held == "start" and at_start:
        is_late = at_start[0].start_s > early.worn_from_s + AT_ONCE_S
        differ = (
            is_late and compute_spread_deg([each.correct(accelerometer) for each in at_start]) > ALIKE_DEG
        )
        return describe_pose("held_at_start", at_start[0], accelerometer, at_start if differ else ())
    if not early.stills:
        return None
    pose = describe_pose("assumed", early.stills[0], accelerometer, early.stills)
    return replace(pose, sigma_deg=max(pose.sigma_deg, ASSUMED_SIGMA_DEG))


def describe_pose(
    state: CalibrationState,
    still: StillPeriod,
    accelerometer: AccelerometerCorrection,
    candidates: tuple[StillPeriod, ...] = (),
) -> FoundPose:
    """Return a still period as a pose."""
    sigma_deg = estimate_held_sigma(still.duration_s)
    axis = still.correct(accelerometer)
    return FoundPose(state, still.start_s, still.end_s, axis, sigma_deg, None, still, candidates)


def estimate_axis_without_pose(
    recording: Recording, blocks: Blocks, wear: Wear, accelerometer: AccelerometerCorrection
) -> FoundPose:
    """Return the direction of the arm in a minute of walking, or else in the stillest moment.

    Raises UnusableCalibration: no moment was still.
    """
    still = measure_stillest(recording, blocks)
    walking = find_walking(wear.strides)
    if walking is not None:
        first_s = float(wear.strides.time_s[0])
        return FoundPose("none", first_s, first_s, walking, WALKING_SIGMA_DEG)
    return replace(describe_pose("none", still, accelerometer), sigma_deg=MOMENT_SIGMA_DEG)


@dataclass(frozen=True, slots=True)
class ProposedPose:
    """A stretch that a person may confirm: the "pose", or a "repeat" of it."""

    still: StillPeriod
    kind: Literal["pose", "repeat"]


def survey(
    recording: Recording, blocks: Blocks, accelerometer: AccelerometerCorrection
) -> tuple[list[Window], tuple[Wear, ...]]:
    """Return every still period, and the stretches of wear."""
    stretches_s = find_still_stretches(blocks, accelerometer)
    return stretches_s, divide_by_wear(blocks, accelerometer, find_tables(recording, stretches_s))


def propose_poses(recording: Recording) -> tuple[ProposedPose, ...]:
    """Return the early still periods of each stretch of wear, and those at the end that repeat the pose.

    Repeats: 5 to 60 s long, in the last ten minutes, within 10 deg of the first early still period.
    """
    blocks = reduce_recording(recording)
    accelerometer = calibrate_accelerometer(find_still_moments(blocks))
    stretches_s, wears = survey(recording, blocks, accelerometer)
    early = find_early_stills(recording, wears, stretches_s)
    proposed = [ProposedPose(still, "pose") for one in early for still in one.stills]
    late_s = recording.duration_us / MICROSECONDS - EARLY_S
    if not early[0].stills or late_s < early[0].worn_from_s + EARLY_S:
        return tuple(proposed)
    axis = early[0].stills[0].correct(accelerometer)
    late = [
        measure_stretch(recording, (start_s, end_s))
        for start_s, end_s in stretches_s
        if start_s >= late_s and end_s - start_s <= LONGEST_POSE_S
    ]
    near = [still for still in late if compute_angle_deg(axis, still.correct(accelerometer)) <= ALIKE_DEG]
    return (*proposed, *(ProposedPose(still, "repeat") for still in near[:MOST_REPEATS]))


# The axis of each stretch of a recording, the questions to the person, and the alternative readings.
#
# A pose applies until the next pose that disagrees, or until the sensor was put on for it. After a slip
# that a person stated, no axis is known until a pose is given. Nothing else changes an axis or excludes time.


@dataclass(frozen=True, slots=True, eq=False)
class AxisAssignment:
    """The first axis, the stretches with another axis in time order, and poses that disagree."""

    first: FoundPose
    parts: tuple[AxisPart, ...]
    differ: tuple[Question, ...]


def assign_axes(
    wears: Sequence[Wear], poses: Sequence[FoundPose], slip_times_s: Sequence[float]
) -> AxisAssignment:
    """Assign the poses to the stretches between stated slips, by the time at which they were held."""
    slips = join_overlapping([(time_s - SAID_S, time_s + SAID_S) for time_s in slip_times_s])
    edges_s = [-np.inf, *(edge_s for slip in slips for edge_s in slip), np.inf]
    sections = list(zip(edges_s[::2], edges_s[1::2], strict=True))
    own = [
        _join_agreeing([pose for pose in poses if start_s - 2.0 * SAID_S <= pose.time_s < end_s])
        for start_s, end_s in sections
    ]
    first = next(known[0] for known in own if known)
    parts = [AxisPart(*slip, None) for slip in slips]
    for section, known in zip(sections, own, strict=True):
        parts += _place(section, known, wears, first) if known else [AxisPart(*section, None)]
    differ = [
        Question("poses", before.end_s, one.time_s, compute_angle_deg(before.axis, one.axis))
        for known in own
        for before, one in pairwise(known)
        if find_wear(wears, one.time_s).start_s <= before.end_s
    ]
    return AxisAssignment(first, tuple(sorted(parts, key=lambda part: part.start_s)), tuple(differ))


def _place(
    section: Window, known: Sequence[FoundPose], wears: Sequence[Wear], first: FoundPose
) -> Iterator[AxisPart]:
    """Yield the stretches of a section where the first axis does not apply."""
    start_s, end_s = section
    worn_s = [find_wear(wears, one.time_s).start_s for one in known[1:]]
    pairs = zip(worn_s, pairwise(known), strict=True)
    turns_s = [from_s if from_s > before.end_s else one.time_s for from_s, (before, one) in pairs]
    for one, from_s, to_s in zip(known, [start_s, *turns_s], [*turns_s, end_s], strict=True):
        if one is not first:
            wider_deg = float(np.sqrt(max(0.0, one.sigma_deg**2 - first.sigma_deg**2)))
            yield AxisPart(from_s, to_s, one.axis, wider_deg, is_posed=True)


def _join_agreeing(poses: Sequence[FoundPose]) -> list[FoundPose]:
    """Merge consecutive poses within 10 deg."""
    groups: list[list[FoundPose]] = []
    for pose in poses:
        if groups and compute_angle_deg(_average(groups[-1]), pose.axis) <= ALIKE_DEG:
            groups[-1].append(pose)
        else:
            groups.append([pose])
    joined = []
    for group in groups:
        one, axes = group[0], [pose.axis for pose in group]
        if len(group) > 1:
            axis = _average(group)
            sigma_deg = estimate_repeated_sigma([compute_angle_deg(axis, each) for each in axes])
            repeat_deg, end_s = compute_spread_deg(axes), group[-1].end_s
            one = replace(one, axis=axis, sigma_deg=sigma_deg, repeat_deg=repeat_deg, end_s=end_s)
        joined.append(one)
    return joined


def _average(poses: Sequence[FoundPose]) -> Float64Array:
    return poses[0].axis if len(poses) == 1 else scale_to_unit(np.sum([pose.axis for pose in poses], axis=0))


def find_questions(
    wears: Sequence[Wear], poses: Sequence[FoundPose], answers_s: Sequence[float]
) -> Iterator[Question]:
    """Yield the times at which the sensor may have moved, unless an answer or poses settle the question.

    Poses settle it if a person gave one before and one after that time and the two agree.
    """
    for wear in wears:
        is_posed = any(wear.start_s <= pose.time_s < wear.end_s for pose in poses)
        asked = [find_slip(wear.strides, wear.calm)]
        if wear is not wears[0] and not is_posed and poses[0].state != "axis":
            asked.insert(0, Question("put_back", wear.worn_from_s - wear.off_s, wear.worn_from_s))
        for question in asked:
            if question is None or question.is_answered(answers_s):
                continue
            before = [pose.axis for pose in poses if pose.time_s < question.first_s]
            after = [pose.axis for pose in poses if pose.time_s > question.end_s]
            is_given = poses[0].state in CONFIRMED and bool(before and after)
            if not is_given or compute_angle_deg(before[-1], after[0]) > ALIKE_DEG:
                yield replace(question, until_s=wear.end_s)


def assume_put_back(
    wears: Sequence[Wear],
    early: Sequence[EarlyStills],
    questions: Sequence[Question],
    accelerometer: AccelerometerCorrection,
) -> Iterator[FoundPose]:
    """Yield the first still period after the sensor was off, if the postures differ from those before."""
    asked_s = [question.end_s for question in questions if question.kind == "put_back"]
    for (before, wear), one in zip(pairwise(wears), early[1:], strict=True):
        moments = before.calm.thin().up, wear.calm.thin().up
        if one.stills and wear.worn_from_s in asked_s and compare_postures(*moments) < MOVED_SHARE:
            yield describe_pose("assumed", one.stills[0], accelerometer)


def list_readings(
    read: AxisAssignment,
    candidates: Sequence[Float64Array],
    questions: Sequence[Question],
    stills: Sequence[tuple[Wear, list[Float64Array]]],
) -> Iterator[Reading]:
    """Yield the alternative readings that no person has ruled out.

    ``stills``: each stretch of wear with its early still periods. Later parts take precedence over earlier
    ones.
    """
    axis, parts = read.first.axis, read.parts
    yield from (Reading(candidates[place], parts) for place in select_distinct_axes(candidates)[1:])
    asked_s = [question.end_s for question in questions if question.kind == "put_back"]
    put_back = [(wear, axes) for wear, axes in stills if axes and wear.worn_from_s in asked_s]
    for turn in range(max((len(select_distinct_axes(axes)) for _, axes in put_back), default=0)):
        again = [
            AxisPart(wear.start_s, wear.end_s, axes[place])
            for wear, axes in put_back
            for place in select_distinct_axes(axes)[turn : turn + 1]
        ]
        yield Reading(axis, (*parts, *again))
    for question in questions:
        if question.turn is not None:
            middle_s = (question.first_s + question.end_s) / 2.0
            yield Reading(axis, (*parts, AxisPart(middle_s, question.until_s, question.turn @ axis)))
    for question in read.differ:
        later = next(part for part in parts if part.is_posed and part.end_s > question.end_s)
        yield Reading(axis, (*parts, replace(later, start_s=question.first_s)))


# From the poses to the calibrated samples.


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The mounting of the sensor on the arm.

    ``pose``: how the arm was held.
    ``arm_axis``: shape (3,): unit vector in the sensor frame along the upper arm towards the shoulder. It
    points to the zenith when the arm hangs, so elevation is the angle between it and the vertical.
    ``sigma_deg``: standard deviation of the axis.
    ``state``: how the axis was determined: one of :data:`acromion.fusion.conventions.CalibrationState`.
    ``windows``: the pose and its repetitions; for `two-point` hanging and level. Empty if none was held.
    ``gyro_bias_dps``: shape (3,): mean angular rate in the pose; without a pose, the mean of the tracked
    bias.
    ``walking_deg``: angle between the axis and the mean of gravity in walking; None with less than a minute
    of walking.
    ``repeat_deg``: largest angle between repetitions of the pose without a slip between them; None for one
    pose.
    ``proposals``: if the pose is not confirmed: the early still periods that may be it, including the one in
    use.
    ``spread_deg``: largest angle between the proposals; above 10 the results mean little until a person names
    the pose.
    ``apart_deg``: angle between each repetition and the first pose; empty for one pose, and for `two-point`.
    ``questions``, ``differ``: when the sensor may have moved on the arm, not yet confirmed or denied; poses
    that disagree.
    """

    pose: Pose
    arm_axis: Float64Array
    sigma_deg: float
    state: CalibrationState
    windows: tuple[StillPeriod, ...]
    gyro_bias_dps: Float64Array
    walking_deg: float | None = None
    repeat_deg: float | None = None
    proposals: tuple[StillPeriod, ...] = ()
    spread_deg: float = 0.0
    apart_deg: tuple[float, ...] = ()
    questions: tuple[Question, ...] = ()
    differ: tuple[Question, ...] = ()

    @property
    def needs_pose(self) -> bool:
        """Whether the proposals disagree, so that a person has to name the pose."""
        return self.spread_deg > ALIKE_DEG


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedSamples:
    """A recording with its calibration, so that raw samples cannot be fused by mistake.

    The samples are not copied.

    ``bias``: the gyroscope's bias through the whole recording, for all segments, like ``accelerometer`` and
    ``gyro_scale``.
    ``runs``: the segments as input for the estimators, so that each sample is reduced only once.
    ``axis_parts``: the stretches with another axis, or none.
    ``readings``: the alternative readings of the recording that no person has ruled out.
    ``stills``: the still moments that calibrated the sensor.
    """

    recording: Recording
    calibration: Calibration
    bias: GyroBias
    accelerometer: AccelerometerCorrection
    stills: QuietTable
    gyro_scale: GyroScale = field(default_factory=build_identity_gyro_scale)
    runs: tuple[CalibratedRun, ...] = ()
    axis_parts: tuple[AxisPart, ...] = ()
    readings: tuple[Reading, ...] = ()

    def run_of(self, segment: Segment) -> CalibratedRun:
        """Return a segment as input for the estimators; a new segment is reduced now."""
        for known, run in zip(self.recording.segments, self.runs, strict=False):
            if known is segment and run.source is segment.gyr_dps:
                return run
        sensor = SensorCalibration(self.bias, self.accelerometer, self.gyro_scale)
        ranges = (self.recording.acc_range_g, self.recording.gyr_range_dps)
        return apply_calibration(view_segment(segment), sensor, *ranges)


def calibrate(
    recording: Recording, settings: AnalysisSettings = DEFAULT_SETTINGS, *, blocks: Blocks | None = None
) -> CalibratedSamples:
    """Find the arm axis in the sensor from a held pose; ``blocks``: the reduced recording, if already known.

    The arm axis is the direction of gravity in the still window (`n-pose`, `side-lean`). For `two-point` it
    is a direction in the plane of both gravity directions: if these are not 90 deg apart, each gets half of
    the difference.

    Raises UnusableCalibration: facts ``why`` ("count", "outside", "short", "hole", "moving", "gravity",
    "angle", "none"), ``start_s``, ``end_s``.
    """
    blocks = blocks or reduce_recording(recording)
    stills = find_still_moments(blocks)
    views = [view_segment(segment) for segment in recording.segments]
    sensor, runs = calibrate_sensor(views, blocks, stills, recording.acc_range_g, recording.gyr_range_dps)
    correction = sensor.accelerometer
    stretches_s, wears = survey(recording, blocks, correction)
    early = find_early_stills(recording, wears, stretches_s)
    found, windows = _find_stated(recording, wears[0], correction, settings)
    held = None if recording.worn_before else settings.pose_held
    assumed = assume_pose(early[0], correction, held)
    if settings.carried is not None and (assumed is None or assumed.state not in CONFIRMED):
        assumed = _take_carried(settings.carried, wears[0])
    poses = found or (assumed or estimate_axis_without_pose(recording, blocks, wears[0], correction),)
    questions = tuple(find_questions(wears, poses, (*settings.slip_times_s, *settings.no_slip_times_s)))
    put_back = assume_put_back(wears, early, questions, correction)
    first, read = poses[0], assign_axes(wears, (*poses, *put_back), settings.slip_times_s)
    windows = windows or ((first.still,) if first.still else ())
    axes = [[still.correct(correction) for still in one.stills] for one in early]
    candidates = [still.correct(correction) for still in first.candidates]
    walking = find_walking(find_wear(wears, first.time_s).strides)
    calibration = Calibration(
        settings.pose,
        read.first.axis,
        read.first.sigma_deg,
        first.state,
        windows,
        windows[0].gyro_bias_dps if windows else sensor.bias.bias_dps.mean(axis=0),
        None if walking is None else compute_angle_deg(walking, read.first.axis),
        read.first.repeat_deg,
        first.candidates,
        compute_spread_deg(candidates),
        tuple(compute_angle_deg(again.axis, first.axis) for again in poses[1:]),
        questions,
        read.differ,
    )
    readings = tuple(list_readings(read, candidates, questions, list(zip(wears, axes, strict=True))))
    return CalibratedSamples(
        recording, calibration, sensor.bias, correction, stills, sensor.gyro_scale, runs, read.parts, readings
    )


def _find_stated(
    recording: Recording, wear: Wear, accelerometer: AccelerometerCorrection, settings: AnalysisSettings
) -> tuple[tuple[FoundPose, ...], tuple[StillPeriod, ...]]:
    """Return the poses or the axis that a person stated, in time order, and the windows."""
    if settings.calibration_windows_s and settings.pose == "two-point":
        hanging, level = measure_pair(recording, settings.calibration_windows_s)
        axis = compute_two_point_axis(hanging.correct(accelerometer), level.correct(accelerometer))
        shorter = min(hanging, level, key=lambda still: still.duration_s)
        pose = replace(describe_pose("given", shorter, accelerometer), time_s=hanging.start_s, axis=axis)
        return (pose,), (hanging, level)
    if settings.calibration_windows_s:
        spans_s = join_overlapping(settings.calibration_windows_s)
        windows = tuple(measure_window(recording, span_s) for span_s in spans_s)
        spread_deg = compute_spread_deg([still.correct(accelerometer) for still in windows])
        state: CalibrationState = "repeated" if len(windows) > 1 and spread_deg <= ALIKE_DEG else "given"
        return tuple(describe_pose(state, still, accelerometer) for still in windows), windows
    if settings.arm_axis is not None:
        along, worn_s = point_along(settings.arm_axis), wear.worn_from_s
        return (FoundPose("axis", worn_s, worn_s, along, AXIS_SIGMA_DEG),), ()
    return (), ()


def _take_carried(carried: CarriedPose, wear: Wear) -> FoundPose:
    """Return the pose of the earlier shift as if it was held when wear began."""
    axis = scale_to_unit(np.array(carried.axis))
    return FoundPose("carried", wear.worn_from_s, wear.worn_from_s, axis, carried.sigma_deg)
