"""Where the arm hung still, and what that says about the sensor: arm axis and gyroscope offset."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fusion.calibration_rules import OTHER_RULES, CalibrationRules, rules_for, score_still_period
from fusion.choices import Pose
from fusion.errors import UnusableCalibration
from fusion.postures import find_angle_deg, find_hanging, find_striding_moments
from fusion.recording import MICROSECONDS, QualityFlag, Recording, Segment
from fusion.remount import AxisPart, find_remounts, flag_pose_unlike_walking, flag_remounts
from fusion.sensor_errors.accelerometer import AccelerometerCorrection, leave_accelerometer
from fusion.sensor_errors.bias_track import GyroBias
from fusion.sensor_errors.gyro_scale import GyroScale, leave_gyro_scale
from fusion.sensor_errors.runs import view_segment
from fusion.sensor_errors.self_calibration import (
    CalibratedRun,
    SensorCalibration,
    apply_calibration,
    calibrate_sensor,
)
from fusion.sensor_errors.stillness import (
    QuarterSeconds,
    find_still_moments,
    reduce_run,
    summarise_windows,
)
from fusion.still_proposals import find_quiet_windows, join_stretches, rank_stretches
from fusion.two_point import scale_to_unit, share_between
from fusion.worn_parts import WornParts, part_recording

Vector = NDArray[np.float64]
WHOLE_DAY_S = (-np.inf, np.inf)


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
    gravity_g: Vector
    gyro_bias_dps: Vector
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The pose that tied the sensor to the arm.

    ``arm_axis`` is a unit vector, shape (3,), in the sensor frame along the upper arm towards the shoulder
    (it points to the zenith when the arm hangs), so that elevation is the angle between it and the vertical.
    """

    pose: Pose
    still: StillPeriod
    arm_axis: Vector
    second: StillPeriod | None = None

    @property
    def windows(self) -> tuple[StillPeriod, ...]:
        """The one window, or for `two-point` both."""
        return (self.still,) if self.second is None else (self.still, self.second)


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedSamples:
    """A recording together with its calibration: a type of its own, so that raw samples cannot be fused by
    mistake.

    The samples are not copied. ``bias`` is the gyroscope's bias through the whole recording, shared by all
    segments, as are ``accelerometer`` and ``gyro_scale``; ``flags`` holds the caveats of calibrating
    (W-NO-STILL, W-POSE-SHORT). ``runs`` are the segments as the estimators take them, so that no sample is
    reduced twice;
    ``remounts`` the parts in which the sensor sat otherwise.
    """

    recording: Recording
    calibration: Calibration
    bias: GyroBias
    accelerometer: AccelerometerCorrection
    flags: tuple[QualityFlag, ...] = ()
    gyro_scale: GyroScale = field(default_factory=leave_gyro_scale)
    runs: tuple[CalibratedRun, ...] = ()
    remounts: tuple[AxisPart, ...] = ()

    def run_of(self, segment: Segment) -> CalibratedRun:
        """A segment as the estimators take it; one that was not there when calibrating is reduced now."""
        for known, run in zip(self.recording.segments, self.runs, strict=False):
            if known is segment and run.source is segment.gyr_dps:
                return run
        sensor = SensorCalibration(self.bias, self.accelerometer, self.gyro_scale)
        ranges = (self.recording.acc_range_g, self.recording.gyr_range_dps)
        return apply_calibration(view_segment(segment), sensor, *ranges)


def calibrate(
    recording: Recording, pose: Pose, windows_s: tuple[tuple[float, float], ...] = ()
) -> CalibratedSamples:
    """Tie the sensor to the arm by a pose held still.

    Parameters
    ----------
    windows_s
        (start, end) in seconds from the recording's first sample: one, or none to take the best proposal; for
        `two-point` two, hanging then level.

    The arm axis is the direction of gravity in the still window (`n-pose`, `side-lean`), or for `two-point`
    the direction in the plane of both gravity directions that shares their departure from 90 deg equally
    between them.

    Raises
    ------
    UnusableCalibration
        Facts ``why`` ("count", "outside", "short", "hole", "moving", "gravity", "angle", "none"),
        ``start_s``, ``end_s``.
    """
    flags: tuple[QualityFlag, ...] = ()
    blocks = _reduce(recording)
    stills = find_still_moments(blocks)
    views = [view_segment(segment) for segment in recording.segments]
    sensor, runs = calibrate_sensor(views, blocks, stills, recording.acc_range_g, recording.gyr_range_dps)
    correction = sensor.accelerometer
    worn = part_recording(blocks, stills, correction)
    if pose == "two-point":
        hanging, level = _measure_pair(recording, windows_s)
        axis = share_between(_correct(hanging, correction), _correct(level, correction))
        calibration = Calibration(pose, hanging, axis, level)
    else:
        still = _choose_still(recording, windows_s, blocks, worn)
        flags = () if windows_s else (*flag_unquiet(still), *_flag_unseen_lean(pose, still))
        calibration = Calibration(pose, still, scale_to_unit(_correct(still, correction)))
    flags += flag_short_windows(calibration) if windows_s else ()
    remounts = find_remounts(worn, (calibration.still.start_s, calibration.arm_axis))
    flags += flag_remounts(remounts, recording.duration_us / MICROSECONDS)
    still, axis = calibration.still, calibration.arm_axis
    flags += flag_pose_unlike_walking(worn, (still.start_s, still.duration_s), axis)
    return CalibratedSamples(
        recording, calibration, sensor.bias, correction, flags, sensor.gyro_scale, runs, remounts
    )


def _correct(still: StillPeriod, correction: AccelerometerCorrection) -> Vector:
    """Gravity as the accelerometer should have read it in the middle of the still period."""
    return np.asarray(correction.apply(still.gravity_g, still.start_s + still.duration_s / 2.0))


def _flag_unseen_lean(pose: Pose, still: StillPeriod) -> tuple[QualityFlag, ...]:
    """W-LEAN: no sensor on the arm can tell whether the trunk was leaning in the window that we proposed."""
    if pose != "side-lean":
        return ()
    end_s = still.start_s + still.duration_s
    return (QualityFlag("W-LEAN", 1, still.duration_s, still.start_s, end_s),)


def find_still_period(recording: Recording) -> StillPeriod:
    """The best proposal; where nothing is quiet for 5 s, the best 2 s (see ``flag_unquiet``).

    Raises
    ------
    UnusableCalibration
        ``why`` "none": no 2 s in one piece; "moving": even the best 2 s move too much.
    """
    return _find_still(recording, _reduce(recording))


def propose_still_periods(recording: Recording, most: int = 5) -> tuple[StillPeriod, ...]:
    """Quiet stretches of 5 to 10 s that could be the calibration pose, the likeliest first.

    The order is by the product of three factors. Good enough: the score, where it is under a half. Early:
    halved after ten minutes. Hanging: within 20 deg of the direction in which the arm hangs while walking.
    Where nobody walked, seen again: how much of the still time has the same direction of gravity within 20
    deg, where that is under a quarter of the commonest direction's; this puts behind a sensor that lay on a
    desk before it was strapped on. Each stretch of stillness counts for at most 10 s.
    """
    return _propose(recording, _reduce(recording), most)


def flag_unquiet(still: StillPeriod) -> tuple[QualityFlag, ...]:
    """W-NO-STILL where a proposal had to make do with less than 5 s."""
    if still.duration_s >= OTHER_RULES.length_s - 0.5:
        return ()
    end_s = still.start_s + still.duration_s
    return (QualityFlag("W-NO-STILL", 1, still.duration_s, still.start_s, end_s, {"score": still.score}),)


def flag_short_windows(calibration: Calibration) -> tuple[QualityFlag, ...]:
    """W-POSE-SHORT for each window that a person asked for and that is shorter than 5 s."""
    return tuple(
        QualityFlag("W-POSE-SHORT", 1, still.duration_s, still.start_s, still.start_s + still.duration_s)
        for still in calibration.windows
        if still.duration_s < OTHER_RULES.length_s - 1e-6
    )


def _reduce(recording: Recording) -> list[QuarterSeconds]:
    return [reduce_run(view_segment(segment)) for segment in recording.segments]


def _choose_still(
    recording: Recording,
    windows_s: tuple[tuple[float, float], ...],
    blocks: list[QuarterSeconds],
    worn: WornParts,
) -> StillPeriod:
    """Take the window asked for, or the best proposal; where the sensor slipped or was off, one before that.

    A pose is held when the sensor has just been strapped on. How the arm hangs is seen in another direction
    after a slip: by the walking of a whole day a raised arm before the slip may pass for a hanging one.
    """
    if len(windows_s) > 1:
        raise UnusableCalibration(why="count", start_s=windows_s[0][0], end_s=windows_s[-1][1])
    if windows_s:
        return _measure_asked(recording, windows_s[0])
    found = _find_still(recording, blocks)
    parts = worn.list_for_pose(found.start_s)
    best = (_propose(recording, blocks, 1, (part.start_s, part.end_s)) for part in parts)
    return next((proposals[0] for proposals in best if proposals), found)


def _find_still(recording: Recording, blocks: list[QuarterSeconds]) -> StillPeriod:
    proposals = _propose(recording, blocks, most=1)
    return proposals[0] if proposals else _find_best_moment(recording, blocks)


def _propose(
    recording: Recording,
    blocks: list[QuarterSeconds],
    most: int,
    within_s: tuple[float, float] = WHOLE_DAY_S,
) -> tuple[StillPeriod, ...]:
    rules = rules_for(recording.device)
    quiet = find_quiet_windows(blocks, rules)
    quiet = quiet.select(
        (quiet.start_s >= within_s[0]) & (quiet.start_s + rules.longest_proposal_s <= within_s[1])
    )
    if len(quiet) == 0:
        return ()
    first, end_s = join_stretches(quiet, rules)
    hangs = find_hanging(find_striding_moments(blocks, leave_accelerometer()).within(*within_s))
    order = np.argsort(-rank_stretches(quiet.select(first), end_s, rules, hangs), kind="stable")[:most]
    return tuple(_measure(recording, float(quiet.start_s[first[k]]), float(end_s[k]), rules) for k in order)


def _measure_pair(
    recording: Recording, windows_s: tuple[tuple[float, float], ...]
) -> tuple[StillPeriod, StillPeriod]:
    if len(windows_s) != 2:
        raise UnusableCalibration(why="count", start_s=0.0, end_s=0.0)
    hanging, level = (_measure_asked(recording, window) for window in windows_s)
    if not 60.0 <= find_angle_deg(hanging.gravity_g, level.gravity_g) <= 120.0:
        raise UnusableCalibration(why="angle", start_s=windows_s[1][0], end_s=windows_s[1][1])
    return hanging, level


def _measure_asked(recording: Recording, window_s: tuple[float, float]) -> StillPeriod:
    """Measure a window that a person asked for, or say why not."""
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


def _cut(recording: Recording, start_s: float, end_s: float) -> tuple[Vector, Vector]:
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


def _find_best_moment(recording: Recording, blocks: list[QuarterSeconds]) -> StillPeriod:
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
