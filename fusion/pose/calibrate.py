"""Where the arm hung still, and what that says about the sensor: arm axis and gyroscope offset."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from fusion.caveats import Caveat
from fusion.conventions import ArmAxis, Found, Pose
from fusion.pose.poses import (
    ALIKE_DEG,
    AXIS_SIGMA_DEG,
    FoundPose,
    estimate_held_sigma,
    estimate_repeated_sigma,
    find_poses,
    find_spread_deg,
    find_walking,
    point_along,
)
from fusion.pose.postures import find_angle_deg
from fusion.pose.rules import RULES
from fusion.pose.wear import (
    REATTACHED_SIGMA_DEG,
    AxisPart,
    Wear,
    WearPart,
    divide_by_wear,
    flag_axis_parts,
    judge_part,
)
from fusion.pose.windows import (
    Blocks,
    StillPeriod,
    Window,
    flag_window,
    measure_asked,
    measure_pair,
    reduce_recording,
    scale_to_unit,
    share_between,
)
from fusion.recording import (
    MICROSECONDS,
    Float64Array,
    QualityFlag,
    Recording,
    Segment,
    flag_stretches,
)
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
    found
        How the axis was found.
    windows
        The pose; the same pose held again; for `two-point` hanging and level. Empty where none was held.
    gyro_bias_dps
        Shape (3,): mean angular rate in the pose; without one, the mean of the followed bias.
    walking_deg
        Angle between the axis and gravity's mean in walking; None where less than a minute was walked.
    repeat_deg
        Largest angle between poses held again on the same arm without a slip between; None for one pose.
    proposals
        The early still stretches, where they differ and nobody named one: which was the pose?
    apart_deg
        Angle of each pose held again from the first; empty for one, and for `two-point`.
    """

    pose: Pose
    arm_axis: Float64Array
    sigma_deg: float
    found: Found
    windows: tuple[StillPeriod, ...]
    gyro_bias_dps: Float64Array
    walking_deg: float | None = None
    repeat_deg: float | None = None
    proposals: tuple[StillPeriod, ...] = ()
    apart_deg: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedSamples:
    """A recording together with its calibration: a type of its own, so that raw samples cannot be fused by
    mistake.

    The samples are not copied. ``bias`` is the gyroscope's bias through the whole recording, shared by all
    segments, as are ``accelerometer`` and ``gyro_scale``; ``flags`` holds the caveats of calibrating.
    ``runs`` are the segments as the estimators take them, so that no sample is reduced twice; ``axis_parts``
    the stretches with an axis of their own, or none.
    """

    recording: Recording
    calibration: Calibration
    bias: GyroBias
    accelerometer: AccelerometerCorrection
    flags: tuple[QualityFlag, ...] = ()
    gyro_scale: GyroScale = field(default_factory=leave_gyro_scale)
    runs: tuple[CalibratedRun, ...] = ()
    axis_parts: tuple[AxisPart, ...] = ()

    def run_of(self, segment: Segment) -> CalibratedRun:
        """A segment as the estimators take it; one that was not there when calibrating is reduced now."""
        for known, run in zip(self.recording.segments, self.runs, strict=False):
            if known is segment and run.source is segment.gyr_dps:
                return run
        sensor = SensorCalibration(self.bias, self.accelerometer, self.gyro_scale)
        ranges = (self.recording.acc_range_g, self.recording.gyr_range_dps)
        return apply_calibration(view_segment(segment), sensor, *ranges)


def calibrate(  # noqa: PLR0913 (what a person may say, and what is known already)
    recording: Recording,
    pose: Pose,
    windows_s: tuple[Window, ...] = (),
    *,
    arm_axis: ArmAxis | None = None,
    slip_times_s: tuple[float, ...] = (),
    blocks: Blocks | None = None,
) -> CalibratedSamples:
    """Tie the sensor to the arm by a pose held still.

    Parameters
    ----------
    windows_s
        (start, end) in seconds from the recording's first sample: when the pose was held, once or again; none
        to take the first still stretch; for `two-point` two, hanging then level.
    arm_axis
        The sensor's axis that was strapped along the arm, towards the shoulder, where no pose was held.
    slip_times_s
        When the sensor slipped, as the person says.
    blocks
        The recording reduced, where the caller has it already.

    The arm axis is the direction of gravity in the still window (`n-pose`, `side-lean`), or for `two-point`
    the direction in the plane of both gravity directions that shares their departure from 90 deg equally
    between them.

    Raises
    ------
    UnusableCalibration
        Facts ``why`` ("count", "outside", "short", "hole", "moving", "gravity", "angle", "none"),
        ``start_s``, ``end_s``.
    """
    blocks = blocks or reduce_recording(recording)
    stills = find_still_moments(blocks)
    views = [view_segment(segment) for segment in recording.segments]
    sensor, runs = calibrate_sensor(views, blocks, stills, recording.acc_range_g, recording.gyr_range_dps)
    correction = sensor.accelerometer
    wear = divide_by_wear(blocks, stills, correction, slip_times_s)
    if windows_s:
        poses, windows = _measure_given(recording, pose, windows_s, correction)
    elif arm_axis is not None:
        poses, windows = _strap_along(wear, arm_axis), ()
    else:
        poses = find_poses(recording, blocks, wear, correction)
        windows = () if poses[0].still is None else (poses[0].still,)
    first, axis_parts = read_parts(wear, poses)
    walking = find_walking(wear.find_part(poses[0].time_s))
    calibration = Calibration(
        pose,
        first.axis,
        first.sigma_deg,
        poses[0].found,
        windows,
        windows[0].gyro_bias_dps if windows else sensor.bias.bias_dps.mean(axis=0),
        None if walking is None else find_angle_deg(walking, first.axis),
        first.repeat_deg,
        poses[0].proposals,
        tuple(find_angle_deg(poses[0].axis, pose.axis) for pose in poses[1:]) if windows_s else (),
    )
    flags = (
        *_flag_pose(calibration, poses[0]),
        *flag_axis_parts(axis_parts, recording.duration_us / MICROSECONDS),
    )
    return CalibratedSamples(
        recording, calibration, sensor.bias, correction, flags, sensor.gyro_scale, runs, axis_parts
    )


def _measure_given(
    recording: Recording, pose: Pose, windows_s: Sequence[Window], accelerometer: AccelerometerCorrection
) -> tuple[tuple[FoundPose, ...], tuple[StillPeriod, ...]]:
    """The poses that a person gave, in order of time, and their windows."""
    if pose == "two-point":
        hanging, level = measure_pair(recording, windows_s)
        axis = share_between(hanging.correct(accelerometer), level.correct(accelerometer))
        sigma_deg = estimate_held_sigma(min(hanging.duration_s, level.duration_s))
        return (FoundPose("given", hanging.start_s, axis, sigma_deg, hanging),), (hanging, level)
    windows = tuple(measure_asked(recording, window_s) for window_s in _join_overlapping(windows_s))
    poses = tuple(
        FoundPose(
            "given",
            still.start_s,
            still.correct(accelerometer),
            estimate_held_sigma(still.duration_s),
            still,
        )
        for still in windows
    )
    return poses, windows


def _join_overlapping(windows_s: Sequence[Window]) -> list[Window]:
    """In order of time; windows that meet are one pose, not two that agree."""
    joined: list[Window] = []
    for start_s, end_s in sorted(windows_s):
        if joined and start_s <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], end_s))
        else:
            joined.append((start_s, end_s))
    return joined


def _strap_along(wear: Wear, arm_axis: ArmAxis) -> tuple[FoundPose, ...]:
    """The same axis for every time that the sensor was strapped on."""
    along = point_along(arm_axis)
    openings = (part for part in wear.parts if part.opens)
    return tuple(FoundPose("axis", part.worn_from_s, along, AXIS_SIGMA_DEG) for part in openings)


@dataclass(frozen=True, slots=True, eq=False)
class KnownAxis:
    """Poses that agree, from the first's start to the last's end, and their mean."""

    start_s: float
    end_s: float
    axis: Float64Array
    sigma_deg: float
    repeat_deg: float | None = None


def join_agreeing(poses: Sequence[FoundPose]) -> list[KnownAxis]:
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


def read_parts(wear: Wear, poses: Sequence[FoundPose]) -> tuple[KnownAxis, tuple[AxisPart, ...]]:
    """The first pose's axis, and the stretches that it does not read, in order of time.

    A part in which a person held the pose is read by it; seconds between two poses that disagree are left
    out. A pose that we found ourselves, within a minute of being put back, stands only for a part that the
    first does not read and in which somebody walked: work in another posture looks like a sensor that turned.
    """
    own: dict[float, list[FoundPose]] = {part.start_s: [] for part in wear.parts}
    for pose in poses:
        own[wear.find_part(pose.time_s).start_s].append(pose)
    posed = wear.find_part(poses[0].time_s)
    first = join_agreeing(own[posed.start_s])[0]
    parts = [AxisPart(slip.first_s, slip.end_s, None) for slip in wear.slips]
    for part in wear.parts:
        held = own[part.start_s]
        if part is posed or (held and held[0].found in {"given", "axis"}):
            parts += _read_own(part, join_agreeing(held), first)
            continue
        judged = judge_part(posed, part, first.axis)
        if judged is None:
            continue
        is_held = bool(held) and held[0].found == "held"
        if judged.arm_axis is None and is_held and find_walking(part) is not None:
            judged = AxisPart(part.start_s, part.end_s, held[0].axis, REATTACHED_SIGMA_DEG)
        parts.append(judged)
    return first, tuple(sorted(parts, key=lambda part: part.start_s))


def _read_own(part: WearPart, known: list[KnownAxis], first: KnownAxis) -> Iterator[AxisPart]:
    """Each stretch of a part by its own poses."""
    starts_s = [part.start_s, *(one.start_s for one in known[1:])]
    ends_s = [*(one.end_s for one in known[:-1]), part.end_s]
    for one, start_s, end_s in zip(known, starts_s, ends_s, strict=True):
        if not np.array_equal(one.axis, first.axis):
            wider_deg = float(np.sqrt(max(0.0, one.sigma_deg**2 - first.sigma_deg**2)))
            yield AxisPart(start_s, end_s, one.axis, wider_deg, is_posed=True)
    for one, following in pairwise(known):
        apart_deg = find_angle_deg(one.axis, following.axis)
        yield AxisPart(one.end_s, following.start_s, None, apart_deg=apart_deg)


def _flag_pose(calibration: Calibration, pose: FoundPose) -> Iterator[QualityFlag]:
    """Flag what is not known of the pose."""
    found, facts = calibration.found, {"deg": round(calibration.sigma_deg, 1)}
    if found == "given":
        short = (one for one in calibration.windows if one.duration_s < RULES.length_s - 1e-6)
        yield from (flag_window(Caveat.POSE_SHORT, still) for still in short)
    elif found == "axis":
        yield QualityFlag(Caveat.AXIS, facts=facts)
    elif found in {"walking", "moment"}:
        yield QualityFlag(Caveat.NO_STILL, facts=facts)
    elif calibration.pose == "side-lean" and pose.still:
        # No sensor on the arm knows whether the trunk was leaning.
        yield flag_window(Caveat.LEAN, pose.still)
    if pose.vetoed_deg and pose.still:
        yield flag_window(Caveat.POSE_DOUBT, pose.still, {"apart_deg": round(pose.vetoed_deg)})
    if calibration.proposals:
        spans_s = [(still.start_s, still.end_s) for still in calibration.proposals]
        yield flag_stretches(Caveat.WHICH_POSE, spans_s, facts)
