"""What ties the sensor to the arm: a pose that a person confirmed, the first stillness, or an axis."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from fusion.conventions import CONFIRMED, SAID_S, CalibrationState, Pose
from fusion.numerics import find_angle_deg, scale_to_unit
from fusion.pose.poses import (
    Blocks,
    EarlyStills,
    FoundPose,
    StillPeriod,
    Window,
    assume_pose,
    describe_pose,
    do_without_pose,
    find_early_stills,
    measure_asked,
    measure_pair,
    reduce_recording,
    share_between,
    survey,
)
from fusion.pose.rules import (
    ALIKE_DEG,
    AXIS_SIGMA_DEG,
    AxisPart,
    Reading,
    choose_apart,
    estimate_repeated_sigma,
    find_spread_deg,
    point_along,
)
from fusion.pose.wear import (
    MOVED_SHARE,
    Question,
    Wear,
    ask_for_slip,
    compare_postures,
    find_walking,
    find_wear,
)
from fusion.recording import Float64Array, Recording, Segment, join_overlapping
from fusion.sensor.gyroscope import GyroScale, leave_gyro_scale
from fusion.sensor.model import AccelerometerCorrection, GyroBias, view_segment
from fusion.sensor.self_calibration import (
    CalibratedRun,
    SensorCalibration,
    apply_calibration,
    calibrate_sensor,
)
from fusion.sensor.stillness import QuietTable, find_still_moments
from fusion.settings import DEFAULT_SETTINGS, AnalysisSettings

# Which axis reads which stretch of a recording, what a person is asked about it, and the other readings.
#
# A pose reads on until one that disagrees, or until the sensor was put on for that one. After a slip that a
# person named nothing reads until a pose is given. Nothing else moves an axis or leaves time out.


@dataclass(frozen=True, slots=True, eq=False)
class Read:
    """The first axis, the stretches that it does not read, in order of time, and poses that disagree."""

    first: FoundPose
    parts: tuple[AxisPart, ...]
    differ: tuple[Question, ...]


def read_recording(wears: Sequence[Wear], poses: Sequence[FoundPose], slip_times_s: Sequence[float]) -> Read:
    """Read each stretch between the slips that a person named by the poses held in it."""
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
        Question("poses", before.end_s, one.time_s, find_angle_deg(before.axis, one.axis))
        for known in own
        for before, one in pairwise(known)
        if find_wear(wears, one.time_s).start_s <= before.end_s
    ]
    return Read(first, tuple(sorted(parts, key=lambda part: part.start_s)), tuple(differ))


def _place(
    section: Window, known: Sequence[FoundPose], wears: Sequence[Wear], first: FoundPose
) -> Iterator[AxisPart]:
    """Yield the stretches of a section that the first axis does not read."""
    start_s, end_s = section
    worn_s = [find_wear(wears, one.time_s).start_s for one in known[1:]]
    pairs = zip(worn_s, pairwise(known), strict=True)
    turns_s = [from_s if from_s > before.end_s else one.time_s for from_s, (before, one) in pairs]
    for one, from_s, to_s in zip(known, [start_s, *turns_s], [*turns_s, end_s], strict=True):
        if one is not first:
            wider_deg = float(np.sqrt(max(0.0, one.sigma_deg**2 - first.sigma_deg**2)))
            yield AxisPart(from_s, to_s, one.axis, wider_deg, is_posed=True)


def _join_agreeing(poses: Sequence[FoundPose]) -> list[FoundPose]:
    """Join poses that follow each other within 10 deg."""
    groups: list[list[FoundPose]] = []
    for pose in poses:
        if groups and find_angle_deg(_average(groups[-1]), pose.axis) <= ALIKE_DEG:
            groups[-1].append(pose)
        else:
            groups.append([pose])
    joined = []
    for group in groups:
        one, axes = group[0], [pose.axis for pose in group]
        if len(group) > 1:
            axis = _average(group)
            sigma_deg = estimate_repeated_sigma([find_angle_deg(axis, each) for each in axes])
            repeat_deg, end_s = find_spread_deg(axes), group[-1].end_s
            one = replace(one, axis=axis, sigma_deg=sigma_deg, repeat_deg=repeat_deg, end_s=end_s)
        joined.append(one)
    return joined


def _average(poses: Sequence[FoundPose]) -> Float64Array:
    return poses[0].axis if len(poses) == 1 else scale_to_unit(np.sum([pose.axis for pose in poses], axis=0))


def ask(wears: Sequence[Wear], poses: Sequence[FoundPose], answers_s: Sequence[float]) -> Iterator[Question]:
    """Yield when the sensor may have moved, as no answer, no pose and no two poses that agree settle."""
    for wear in wears:
        is_posed = any(wear.start_s <= pose.time_s < wear.end_s for pose in poses)
        asked = [ask_for_slip(wear.strides, wear.calm)]
        if wear is not wears[0] and not is_posed and poses[0].state != "axis":
            asked.insert(0, Question("put_back", wear.worn_from_s - wear.off_s, wear.worn_from_s))
        for question in asked:
            if question and not question.is_answered(answers_s) and not _is_refuted(question, poses):
                yield replace(question, until_s=wear.end_s)


def _is_refuted(question: Question, poses: Sequence[FoundPose]) -> bool:
    """Return whether poses that a person gave on both sides agree."""
    before = [pose.axis for pose in poses if pose.time_s < question.first_s]
    after = [pose.axis for pose in poses if pose.time_s > question.end_s]
    is_given = poses[0].state in CONFIRMED
    return is_given and bool(before and after) and find_angle_deg(before[-1], after[0]) <= ALIKE_DEG


def assume_put_back(
    wears: Sequence[Wear],
    early: Sequence[EarlyStills],
    questions: Sequence[Question],
    accelerometer: AccelerometerCorrection,
) -> Iterator[FoundPose]:
    """Yield the first stillness after the sensor was off, if the postures are other ones than before."""
    asked_s = [question.end_s for question in questions if question.kind == "put_back"]
    for (before, wear), one in zip(pairwise(wears), early[1:], strict=True):
        moments = before.calm.thin().up, wear.calm.thin().up
        if one.stills and wear.worn_from_s in asked_s and compare_postures(*moments) < MOVED_SHARE:
            yield describe_pose("assumed", one.stills[0], accelerometer)


def list_readings(
    read: Read,
    candidates: Sequence[Float64Array],
    questions: Sequence[Question],
    stills: Sequence[tuple[Wear, list[Float64Array]]],
) -> Iterator[Reading]:
    """Yield the readings beside the one that is used, as no person has ruled them out.

    ``stills``: each stretch of wear with its early stillnesses. Later parts go before earlier ones.
    """
    axis, parts = read.first.axis, read.parts
    yield from (Reading(candidates[place], parts) for place in choose_apart(candidates)[1:])
    asked_s = [question.end_s for question in questions if question.kind == "put_back"]
    put_back = [(wear, axes) for wear, axes in stills if axes and wear.worn_from_s in asked_s]
    for turn in range(max((len(choose_apart(axes)) for _, axes in put_back), default=0)):
        again = [
            AxisPart(wear.start_s, wear.end_s, axes[place])
            for wear, axes in put_back
            for place in choose_apart(axes)[turn : turn + 1]
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
    """What ties the sensor to the arm.

    ``pose``: how the arm was held.
    ``arm_axis``: shape (3,): unit vector in the sensor frame along the upper arm towards the shoulder. It
    points to the zenith when the arm hangs, so that elevation is the angle between it and the vertical.
    ``sigma_deg``: standard deviation of the axis.
    ``state``: how the axis is known: one of :data:`fusion.conventions.CalibrationState`.
    ``windows``: the pose; the same pose held again; for `two-point` hanging and level. Empty if none was
    held.
    ``gyro_bias_dps``: shape (3,): mean angular rate in the pose; without one, the mean of the followed bias.
    ``walking_deg``: angle between the axis and the mean of gravity in walking; None if less than a minute was
    walked.
    ``repeat_deg``: largest angle between poses held again on the same arm without a slip between; None for
    one pose.
    ``proposals``: if nobody confirmed the pose: the early stillnesses that may be it, the one that is used
    among them.
    ``spread_deg``: largest angle between the proposals; above 10 the pose is needed before the figures mean
    much.
    ``apart_deg``: angle of each pose held again from the first; empty for one, and for `two-point`.
    ``questions``, ``differ``: when the sensor may have moved on the arm, as nobody has confirmed or denied;
    poses that disagree.
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
    """A recording together with its calibration, so that raw samples cannot be fused by mistake.

    The samples are not copied. ``bias`` is the gyroscope's bias through the whole recording, shared by all
    segments, as are ``accelerometer`` and ``gyro_scale``.
    ``runs`` are the segments as the estimators take them, so that no sample is reduced twice; ``axis_parts``
    the stretches with another axis, or none; ``readings`` the other ways to read the recording that no person
    has ruled out; ``stills`` the still moments that calibrated the sensor.
    """

    recording: Recording
    calibration: Calibration
    bias: GyroBias
    accelerometer: AccelerometerCorrection
    stills: QuietTable
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


def calibrate(
    recording: Recording, settings: AnalysisSettings = DEFAULT_SETTINGS, *, blocks: Blocks | None = None
) -> CalibratedSamples:
    """Tie the sensor to the arm by a pose held still; ``blocks``: the recording reduced, if known already.

    The arm axis is the direction of gravity in the still window (`n-pose`, `side-lean`), or for `two-point`
    the direction in the plane of both gravity directions that shares their departure from 90 deg equally
    between them.

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
    assumed = assume_pose(early[0], correction, settings.pose_held)
    poses = found or (assumed or do_without_pose(recording, blocks, wears[0], correction),)
    questions = tuple(ask(wears, poses, (*settings.slip_times_s, *settings.no_slip_times_s)))
    put_back = assume_put_back(wears, early, questions, correction)
    first, read = poses[0], read_recording(wears, (*poses, *put_back), settings.slip_times_s)
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
        None if walking is None else find_angle_deg(walking, read.first.axis),
        read.first.repeat_deg,
        first.candidates,
        find_spread_deg(candidates),
        tuple(find_angle_deg(again.axis, first.axis) for again in poses[1:]),
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
    """Return the poses or the axis that a person stated, in order of time, and the windows."""
    if settings.calibration_windows_s and settings.pose == "two-point":
        hanging, level = measure_pair(recording, settings.calibration_windows_s)
        axis = share_between(hanging.correct(accelerometer), level.correct(accelerometer))
        shorter = min(hanging, level, key=lambda still: still.duration_s)
        pose = replace(describe_pose("given", shorter, accelerometer), time_s=hanging.start_s, axis=axis)
        return (pose,), (hanging, level)
    if settings.calibration_windows_s:
        spans_s = join_overlapping(settings.calibration_windows_s)
        windows = tuple(measure_asked(recording, span_s) for span_s in spans_s)
        spread_deg = find_spread_deg([still.correct(accelerometer) for still in windows])
        state: CalibrationState = "repeated" if len(windows) > 1 and spread_deg <= ALIKE_DEG else "given"
        return tuple(describe_pose(state, still, accelerometer) for still in windows), windows
    if settings.arm_axis is not None:
        along, worn_s = point_along(settings.arm_axis), wear.worn_from_s
        return (FoundPose("axis", worn_s, worn_s, along, AXIS_SIGMA_DEG),), ()
    return (), ()
