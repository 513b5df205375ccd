"""What ties the sensor to the arm: a pose that a person confirmed, the first stillness, or an axis."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from fusion.caveats import Caveat
from fusion.conventions import CONFIRMED, ArmAxis, CalibrationState, Pose, PoseHeld
from fusion.pose.axes import (
    ALIKE_DEG,
    AXIS_SIGMA_DEG,
    AxisPart,
    Reading,
    choose_apart,
    estimate_held_sigma,
    estimate_repeated_sigma,
    find_spread_deg,
    point_along,
)
from fusion.pose.poses import TABLE_SWAY_DPS, FoundPose, find_early_stills, find_pose
from fusion.pose.postures import find_angle_deg, find_walking
from fusion.pose.rules import RULES
from fusion.pose.slips import Question, ask_for_slip
from fusion.pose.wear import Wear, divide_by_wear
from fusion.pose.windows import (
    Blocks,
    StillPeriod,
    Window,
    find_still_stretches,
    flag_window,
    measure_asked,
    measure_pair,
    reduce_recording,
    scale_to_unit,
    share_between,
)
from fusion.recording import MICROSECONDS, Float64Array, QualityFlag, Recording, Segment, flag_stretches
from fusion.sensor.accelerometer import AccelerometerCorrection
from fusion.sensor.gyroscope import GyroScale, leave_gyro_scale
from fusion.sensor.model import GyroBias, view_segment
from fusion.sensor.self_calibration import (
    CalibratedRun,
    SensorCalibration,
    apply_calibration,
    calibrate_sensor,
)
from fusion.sensor.stillness import find_still_moments

SAID_S = 60.0
"""How exactly a person knows when the sensor slipped: so much on both sides is left out."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What ties the sensor to the arm.

    Attributes
    ----------
    pose
        How the arm was held.
    arm_axis
        Shape (3,): unit vector in the sensor frame along the upper arm towards the shoulder. It points to the
        zenith when the arm hangs, so that elevation is the angle between it and the vertical.
    sigma_deg
        Standard deviation of the axis.
    state
        How the axis is known: one of :data:`fusion.conventions.CalibrationState`.
    windows
        The pose; the same pose held again; for `two-point` hanging and level. Empty if none was held.
    gyro_bias_dps
        Shape (3,): mean angular rate in the pose; without one, the mean of the followed bias.
    walking_deg
        Angle between the axis and the mean of gravity in walking; None if less than a minute was walked.
    repeat_deg
        Largest angle between poses held again on the same arm without a slip between; None for one pose.
    proposals
        If nobody confirmed the pose: the early stillnesses that may be it, the one that is used among them.
    spread_deg
        Largest angle between the proposals; above 10 the pose is needed before the figures mean much.
    apart_deg
        Angle of each pose held again from the first; empty for one, and for `two-point`.
    questions
        When the sensor may have moved on the arm, as nobody has confirmed or denied.
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

    @property
    def needs_pose(self) -> bool:
        """Whether the proposals disagree, so that a person has to name the pose."""
        return self.spread_deg > ALIKE_DEG


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedSamples:
    """A recording together with its calibration: a type of its own, so that raw samples cannot be fused by
    mistake.

    The samples are not copied. ``bias`` is the gyroscope's bias through the whole recording, shared by all
    segments, as are ``accelerometer`` and ``gyro_scale``; ``flags`` holds the caveats of calibrating.
    ``runs`` are the segments as the estimators take them, so that no sample is reduced twice; ``axis_parts``
    the stretches with another axis, or none; ``readings`` the other ways to read the recording that no person
    has ruled out.
    """

    recording: Recording
    calibration: Calibration
    bias: GyroBias
    accelerometer: AccelerometerCorrection
    flags: tuple[QualityFlag, ...] = ()
    gyro_scale: GyroScale = field(default_factory=leave_gyro_scale)
    runs: tuple[CalibratedRun, ...] = ()
    axis_parts: tuple[AxisPart, ...] = ()
    readings: tuple[Reading, ...] = ()

    def run_of(self, segment: Segment) -> CalibratedRun:
        """Return a segment as the estimators take it; one that was not there before is reduced now."""
        for known, run in zip(self.recording.segments, self.runs, strict=False):
            if known is segment and run.source is segment.gyr_dps:
                return run
        sensor = SensorCalibration(self.bias, self.accelerometer, self.gyro_scale)
        ranges = (self.recording.acc_range_g, self.recording.gyr_range_dps)
        return apply_calibration(view_segment(segment), sensor, *ranges)


@dataclass(frozen=True, slots=True)
class Statements:
    """What a person states about the pose and the sensor's place on the arm.

    Attributes
    ----------
    windows_s
        (start, end) in seconds from the recording's first sample: when the pose was held, once or again; for
        `two-point` two, hanging then level.
    arm_axis
        The sensor's axis that was strapped along the arm, towards the shoulder, if no pose was held.
    pose_held
        "start": the pose was held at the start of wear.
    slip_times_s, no_slip_times_s
        When the sensor slipped, or was put back in another place; when it did not, though it may seem so.
    """

    windows_s: tuple[Window, ...] = ()
    arm_axis: ArmAxis | None = None
    pose_held: PoseHeld | None = None
    slip_times_s: tuple[float, ...] = ()
    no_slip_times_s: tuple[float, ...] = ()


NOTHING_STATED = Statements()


def calibrate(
    recording: Recording,
    pose: Pose,
    windows_s: tuple[Window, ...] = (),
    *,
    stated: Statements = NOTHING_STATED,
    blocks: Blocks | None = None,
) -> CalibratedSamples:
    """Tie the sensor to the arm by a pose held still.

    Parameters
    ----------
    windows_s
        Short for ``stated.windows_s``.
    stated
        What a person states.
    blocks
        The recording reduced, if the caller has it already.

    The arm axis is the direction of gravity in the still window (`n-pose`, `side-lean`), or for `two-point`
    the direction in the plane of both gravity directions that shares their departure from 90 deg equally
    between them.

    Raises
    ------
    UnusableCalibration
        Facts ``why`` ("count", "outside", "short", "hole", "moving", "gravity", "angle", "none"),
        ``start_s``, ``end_s``.
    """
    stated = replace(stated, windows_s=windows_s) if windows_s else stated
    blocks = blocks or reduce_recording(recording)
    stills = find_still_moments(blocks)
    views = [view_segment(segment) for segment in recording.segments]
    sensor, runs = calibrate_sensor(views, blocks, stills, recording.acc_range_g, recording.gyr_range_dps)
    correction = sensor.accelerometer
    wears = divide_by_wear(blocks, correction)
    poses, windows = _find_poses(recording, blocks, wears[0], pose, correction, stated)
    point, parts, differ = _read_sections(_divide_by_slips(stated.slip_times_s), wears, poses)
    questions = tuple(_ask(wears, poses, stated))
    first = poses[0]
    candidates = [still.correct(correction) for still in first.candidates]
    walking = find_walking(_find_wear(wears, first.time_s).strides)
    calibration = Calibration(
        pose,
        point.axis,
        point.sigma_deg,
        first.state,
        windows,
        windows[0].gyro_bias_dps if windows else sensor.bias.bias_dps.mean(axis=0),
        None if walking is None else find_angle_deg(walking, point.axis),
        point.repeat_deg,
        first.candidates,
        find_spread_deg(candidates),
        tuple(find_angle_deg(again.axis, first.axis) for again in poses[1:]) if stated.windows_s else (),
        questions,
    )
    put_back = _find_put_back(recording, blocks, wears, correction, questions)
    readings = tuple(_list_readings(point.axis, parts, candidates, questions, put_back))
    duration_s = recording.duration_us / MICROSECONDS
    flags = (*_flag_pose(calibration, stated), *_flag_moves(calibration, parts, differ, duration_s))
    return CalibratedSamples(
        recording, calibration, sensor.bias, correction, flags, sensor.gyro_scale, runs, parts, readings
    )


# The poses that a person gave, or else the one that is assumed.


def _find_poses(  # noqa: PLR0913, PLR0917
    recording: Recording,
    blocks: Blocks,
    wear: Wear,
    pose: Pose,
    accelerometer: AccelerometerCorrection,
    stated: Statements,
) -> tuple[tuple[FoundPose, ...], tuple[StillPeriod, ...]]:
    """Return the poses in order of time, and the windows in which they were held."""
    if stated.windows_s and pose == "two-point":
        hanging, level = measure_pair(recording, stated.windows_s)
        axis = share_between(hanging.correct(accelerometer), level.correct(accelerometer))
        sigma_deg = estimate_held_sigma(min(hanging.duration_s, level.duration_s))
        return (FoundPose("given", hanging.start_s, axis, sigma_deg, hanging),), (hanging, level)
    if stated.windows_s:
        windows = tuple(measure_asked(recording, window) for window in _join_overlapping(stated.windows_s))
        axes = [still.correct(accelerometer) for still in windows]
        agree = len(axes) > 1 and find_spread_deg(axes) <= ALIKE_DEG
        state: CalibrationState = "repeated" if agree else "given"
        held = zip(windows, axes, strict=True)
        return tuple(
            FoundPose(state, still.start_s, axis, estimate_held_sigma(still.duration_s), still)
            for still, axis in held
        ), windows
    if stated.arm_axis is not None:
        along = point_along(stated.arm_axis)
        return (FoundPose("axis", wear.worn_from_s, along, AXIS_SIGMA_DEG),), ()
    found = find_pose(recording, blocks, wear, accelerometer, stated.pose_held)
    return (found,), (found.still,) if found.still else ()


def _join_overlapping(windows_s: Sequence[Window]) -> list[Window]:
    """Return the windows in order of time; those that meet are one pose, not two that agree."""
    joined: list[Window] = []
    for start_s, end_s in sorted(windows_s):
        if joined and start_s <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], end_s))
        else:
            joined.append((start_s, end_s))
    return joined


def _find_wear(wears: Sequence[Wear], time_s: float) -> Wear:
    return next(wear for wear in reversed(wears) if wear.start_s <= time_s or wear is wears[0])


# Which axis reads which stretch.


@dataclass(frozen=True, slots=True, eq=False)
class KnownAxis:
    """Poses that agree, from the first's start to the last's end, and their mean."""

    start_s: float
    end_s: float
    axis: Float64Array
    sigma_deg: float
    repeat_deg: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """Two poses that disagree, without a slip that a person named between them."""

    first_s: float
    end_s: float
    apart_deg: float


def _divide_by_slips(slip_times_s: Sequence[float]) -> list[Window]:
    """Return the stretches between the slips that a person named, from -inf to inf."""
    slips = _join_overlapping([(time_s - SAID_S, time_s + SAID_S) for time_s in slip_times_s])
    edges_s = [-np.inf, *(edge_s for slip in slips for edge_s in slip), np.inf]
    return list(zip(edges_s[::2], edges_s[1::2], strict=True))


def _read_sections(
    sections: Sequence[Window], wears: Sequence[Wear], poses: Sequence[FoundPose]
) -> tuple[KnownAxis, tuple[AxisPart, ...], tuple[Difference, ...]]:
    """Return the first pose's axis, the stretches that it does not read, and the poses that disagree.

    A pose reads on until one that disagrees, or until the sensor was put on for it. After a slip that a
    person named nothing reads until a pose is given.
    """
    own = [
        _join_agreeing([pose for pose in poses if start_s - 2.0 * SAID_S <= pose.time_s < end_s])
        for start_s, end_s in sections
    ]
    first = next(known[0] for known in own if known)
    parts: list[AxisPart] = []
    differ: list[Difference] = []
    for (start_s, end_s), known in zip(sections, own, strict=True):
        if not known:
            parts.append(AxisPart(start_s, end_s, None))
        starts_s = [
            start_s,
            *(
                max(_find_wear(wears, one.start_s).start_s, before.end_s, start_s)
                for before, one in pairwise(known)
            ),
        ]
        for one, from_s, to_s in zip(known, starts_s, [*starts_s[1:], end_s], strict=False):
            if one.axis is not first.axis:
                wider_deg = float(np.sqrt(max(0.0, one.sigma_deg**2 - first.sigma_deg**2)))
                parts.append(AxisPart(from_s, to_s, one.axis, wider_deg, is_posed=True))
        for before, one in pairwise(known):
            differ.append(Difference(before.end_s, one.start_s, find_angle_deg(before.axis, one.axis)))
    parts += [AxisPart(end_s, start_s, None) for (_, end_s), (start_s, _) in pairwise(sections)]
    return first, tuple(sorted(parts, key=lambda part: part.start_s)), tuple(differ)


def _join_agreeing(poses: Sequence[FoundPose]) -> list[KnownAxis]:
    """Join poses that follow each other within 10 deg."""
    groups: list[list[FoundPose]] = []
    for pose in poses:
        if groups and find_angle_deg(_average(groups[-1]), pose.axis) <= ALIKE_DEG:
            groups[-1].append(pose)
        else:
            groups.append([pose])
    return [_join(group) for group in groups]


def _join(poses: list[FoundPose]) -> KnownAxis:
    first, last, axis = poses[0], poses[-1], _average(poses)
    end_s = last.still.end_s if last.still else last.time_s
    if len(poses) == 1:
        return KnownAxis(first.time_s, end_s, axis, first.sigma_deg)
    sigma_deg = estimate_repeated_sigma([find_angle_deg(axis, pose.axis) for pose in poses])
    return KnownAxis(first.time_s, end_s, axis, sigma_deg, find_spread_deg([pose.axis for pose in poses]))


def _average(poses: Sequence[FoundPose]) -> Float64Array:
    if len(poses) == 1:
        return poses[0].axis
    return scale_to_unit(np.sum([pose.axis for pose in poses], axis=0))


# What a person is asked, and the other ways to read the recording until the answer.


def _ask(wears: Sequence[Wear], poses: Sequence[FoundPose], stated: Statements) -> Iterator[Question]:
    """Yield the questions that nothing stated answers, in order of time."""
    answers_s = (*stated.slip_times_s, *stated.no_slip_times_s)
    for wear in wears:
        is_posed = any(wear.start_s <= pose.time_s < wear.end_s for pose in poses)
        asked: list[Question | None] = []
        if wear is not wears[0] and not is_posed and poses[0].state != "axis":
            asked.append(Question("put_back", wear.worn_from_s - wear.off_s, wear.worn_from_s))
        asked.append(ask_for_slip(wear.strides, wear.calm))
        for question in asked:
            if question and not question.is_answered(answers_s) and not _is_refuted(question, poses):
                yield replace(question, until_s=wear.end_s)


def _is_refuted(question: Question, poses: Sequence[FoundPose]) -> bool:
    """Return whether poses that a person gave on both sides agree."""
    before = [pose.axis for pose in poses if pose.time_s < question.first_s]
    after = [pose.axis for pose in poses if pose.time_s > question.end_s]
    given = poses[0].state in CONFIRMED
    return given and bool(before and after) and find_angle_deg(before[-1], after[0]) <= ALIKE_DEG


def _find_put_back(
    recording: Recording,
    blocks: Blocks,
    wears: Sequence[Wear],
    accelerometer: AccelerometerCorrection,
    questions: Sequence[Question],
) -> list[tuple[Wear, list[Float64Array]]]:
    """Return the stretches of wear that are asked about, with the axes that may read them."""
    asked_s = [question.end_s for question in questions if question.kind == "put_back"]
    chosen = [wear for wear in wears if wear.worn_from_s in asked_s]
    stretches_s = find_still_stretches(blocks, accelerometer) if chosen else []
    early = [find_early_stills(recording, wear, stretches_s).stills for wear in chosen]
    axes = [[still.correct(accelerometer) for still in stills] for stills in early]
    return [(wear, found) for wear, found in zip(chosen, axes, strict=True) if found]


def _list_readings(
    axis: Float64Array,
    parts: tuple[AxisPart, ...],
    candidates: Sequence[Float64Array],
    questions: Sequence[Question],
    put_back: Sequence[tuple[Wear, list[Float64Array]]],
) -> Iterator[Reading]:
    """Yield the readings beside the one that is used, as no person has ruled them out.

    Later parts go before earlier ones.
    """
    yield from (Reading(candidates[place], parts) for place in choose_apart(candidates)[1:])
    for turn in range(max((len(axes) for _, axes in put_back), default=0)):
        again = (AxisPart(wear.start_s, wear.end_s, axes[turn % len(axes)]) for wear, axes in put_back)
        yield Reading(axis, (*parts, *again))
    for question in questions:
        if question.turn is not None:
            middle_s = (question.first_s + question.end_s) / 2.0
            yield Reading(axis, (*parts, AxisPart(middle_s, question.until_s, question.turn @ axis)))


# Caveats


def _flag_pose(calibration: Calibration, stated: Statements) -> Iterator[QualityFlag]:
    """Flag what is not known of the pose."""
    state, facts = calibration.state, {"deg": round(calibration.sigma_deg, 1)}
    if state == "axis":
        yield QualityFlag(Caveat.AXIS, facts=facts)
    if state == "none":
        yield QualityFlag(Caveat.NO_STILL, facts=facts)
    if state == "assumed":
        spans_s = [(still.start_s, still.end_s) for still in calibration.proposals]
        told = {"apart_deg": round(calibration.spread_deg)} if calibration.needs_pose else {}
        code = Caveat.WHICH_POSE if calibration.needs_pose else Caveat.POSE_ASSUMED
        yield flag_stretches(code, spans_s, told)
        if calibration.pose == "side-lean":  # no sensor on the arm knows whether the trunk was leaning
            yield flag_window(Caveat.LEAN, calibration.windows[0])
    if state in {"assumed", "none"} and stated.pose_held:
        yield QualityFlag(Caveat.NOT_HELD)
    for still in calibration.windows:
        if stated.windows_s and still.duration_s < RULES.length_s - 1e-6:
            yield flag_window(Caveat.POSE_SHORT, still)
        if state != "none" and still.is_moving:
            yield flag_window(Caveat.POSE_UNSTEADY, still, {"what": "moving"})
        if state != "none" and still.sway_dps < TABLE_SWAY_DPS:
            yield flag_window(Caveat.POSE_UNSTEADY, still, {"what": "table"})


def _flag_moves(
    calibration: Calibration, parts: Sequence[AxisPart], differ: Sequence[Difference], duration_s: float
) -> Iterator[QualityFlag]:
    """Flag when the sensor may have moved, slips that a person named, and poses that disagree."""
    slips = [question for question in calibration.questions if question.kind == "slip"]
    put_back = [question for question in calibration.questions if question.kind == "put_back"]
    left_out = [
        (max(part.start_s, 0.0), min(part.end_s, duration_s)) for part in parts if part.arm_axis is None
    ]
    if slips:
        facts = {"apart_deg": round(max(question.apart_deg for question in slips))}
        yield flag_stretches(Caveat.SLIP, [(one.first_s, one.end_s) for one in slips], facts)
    if put_back:
        yield flag_stretches(Caveat.PUT_BACK, [(one.first_s, one.end_s) for one in put_back])
    if left_out:
        yield flag_stretches(Caveat.REMOUNT, left_out)
    if differ:
        facts = {"apart_deg": round(max(one.apart_deg for one in differ))}
        yield flag_stretches(Caveat.POSES_DIFFER, [(one.first_s, one.end_s) for one in differ], facts)
