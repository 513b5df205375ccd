"""What ties the sensor to the arm: a pose that a person confirmed, the first stillness, or an axis."""

from dataclasses import dataclass, field, replace

from fusion.conventions import CalibrationState, Pose
from fusion.numerics import find_angle_deg
from fusion.pose.axes import ALIKE_DEG, AXIS_SIGMA_DEG, AxisPart, Reading, find_spread_deg, point_along
from fusion.pose.poses import (
    FoundPose,
    assume_pose,
    describe_pose,
    do_without_pose,
    find_early_stills,
    survey,
)
from fusion.pose.readings import ask, assume_put_back, list_readings, read_recording
from fusion.pose.wear import Question, Wear, find_walking, find_wear
from fusion.pose.windows import (
    Blocks,
    StillPeriod,
    measure_asked,
    measure_pair,
    reduce_recording,
    share_between,
)
from fusion.recording import Float64Array, Recording, Segment, join_overlapping
from fusion.sensor.accelerometer import AccelerometerCorrection
from fusion.sensor.gyroscope import GyroScale, leave_gyro_scale
from fusion.sensor.model import GyroBias, view_segment
from fusion.sensor.self_calibration import (
    CalibratedRun,
    SensorCalibration,
    apply_calibration,
    calibrate_sensor,
)
from fusion.sensor.stillness import QuietTable, find_still_moments
from fusion.settings import DEFAULT_SETTINGS, AnalysisSettings


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
