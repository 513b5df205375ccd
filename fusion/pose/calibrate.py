"""Where the arm hung still, and what that says about the sensor: arm axis and gyroscope offset."""

from dataclasses import dataclass, field, replace

import numpy as np

from fusion.conventions import Pose
from fusion.errors import UnusableCalibration
from fusion.pose.doubts import (
    DoubtedPart,
    find_doubted_parts,
    find_early_turn,
    flag_doubted_parts,
    flag_evidence,
    flag_short_windows,
    flag_unquiet,
    flag_unseen_lean,
    weigh_asked,
    weigh_proposal,
)
from fusion.pose.wear import AxisPart, Wear, divide_by_wear, find_reattachments, flag_reattachments
from fusion.pose.windows import (
    StillPeriod,
    choose_still_period,
    measure_asked,
    measure_pair,
    reduce_recording,
    scale_to_unit,
    share_between,
)
from fusion.recording import MICROSECONDS, Float64Array, QualityFlag, Recording, Segment
from fusion.sensor.accelerometer import AccelerometerCorrection
from fusion.sensor.gyroscope import GyroScale, leave_gyro_scale
from fusion.sensor.model import GyroBias, view_segment
from fusion.sensor.self_calibration import (
    CalibratedRun,
    SensorCalibration,
    apply_calibration,
    calibrate_sensor,
)
from fusion.sensor.stillness import (
    QuarterSeconds,
    find_still_moments,
)

WHOLE_DAY_S = (-np.inf, np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The pose that tied the sensor to the arm.

    Attributes
    ----------
    pose
        How the arm was held.
    still
        The window in which it was held.
    arm_axis
        Shape (3,): unit vector in the sensor frame along the upper arm towards the shoulder. It points to the
        zenith when the arm hangs, so that elevation is the angle between it and the vertical.
    second
        The other window of the two-point pose, the arm level; else None.
    sigma_deg
        Standard deviation of the axis where less is known of it than of any pose that is held; else 0.
    """

    pose: Pose
    still: StillPeriod
    arm_axis: Float64Array
    second: StillPeriod | None = None
    sigma_deg: float = 0.0

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
    (:mod:`fusion.pose.doubts`). ``runs`` are the segments as the estimators take them, so that no sample is
    reduced twice;
    ``remounts`` the parts in which the sensor sat otherwise, ``doubted`` those in which it may have.
    """

    recording: Recording
    calibration: Calibration
    bias: GyroBias
    accelerometer: AccelerometerCorrection
    flags: tuple[QualityFlag, ...] = ()
    gyro_scale: GyroScale = field(default_factory=leave_gyro_scale)
    runs: tuple[CalibratedRun, ...] = ()
    remounts: tuple[AxisPart, ...] = ()
    doubted: tuple[DoubtedPart, ...] = ()

    @property
    def uncertain_parts(self) -> tuple[AxisPart | DoubtedPart, ...]:
        """All parts with an uncertainty of their own."""
        return (*self.remounts, *self.doubted)

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
    blocks = reduce_recording(recording)
    stills = find_still_moments(blocks)
    views = [view_segment(segment) for segment in recording.segments]
    sensor, runs = calibrate_sensor(views, blocks, stills, recording.acc_range_g, recording.gyr_range_dps)
    correction = sensor.accelerometer
    wear = divide_by_wear(blocks, stills, correction)
    if pose == "two-point":
        hanging, level = measure_pair(recording, windows_s)
        axis = share_between(_correct(hanging, correction), _correct(level, correction))
        calibration = Calibration(pose, hanging, axis, level)
    else:
        still = _choose_still(recording, windows_s, blocks, wear)
        calibration = Calibration(pose, still, scale_to_unit(_correct(still, correction)))
    still, axis = calibration.still, calibration.arm_axis
    if windows_s:
        evidence = weigh_asked(wear, still, axis)
        flags = flag_short_windows(calibration.windows)
    else:
        evidence = weigh_proposal(recording, blocks, wear, still)
        flags = (*flag_unquiet(still), *flag_unseen_lean(pose, still))
    calibration = replace(calibration, sigma_deg=evidence.sigma_deg)
    remounts = (
        *find_early_turn(wear, still.start_s, evidence),
        *find_reattachments(wear, (still.start_s, axis)),
    )
    doubted = find_doubted_parts(wear, axis, remounts)
    duration_s = recording.duration_us / MICROSECONDS
    flags += (
        *flag_evidence(evidence, still),
        *flag_reattachments(remounts, duration_s),
        *flag_doubted_parts(doubted, duration_s),
    )
    return CalibratedSamples(
        recording, calibration, sensor.bias, correction, flags, sensor.gyro_scale, runs, remounts, doubted
    )


def _correct(still: StillPeriod, correction: AccelerometerCorrection) -> Float64Array:
    """Gravity as the accelerometer should have read it in the middle of the still period."""
    return np.asarray(correction.apply(still.gravity_g, still.start_s + still.duration_s / 2.0))


def _choose_still(
    recording: Recording,
    windows_s: tuple[tuple[float, float], ...],
    blocks: list[QuarterSeconds],
    wear: Wear,
) -> StillPeriod:
    """Choose the window that a person gave, or the best proposal."""
    if len(windows_s) > 1:
        raise UnusableCalibration(why="count", start_s=windows_s[0][0], end_s=windows_s[-1][1])
    if windows_s:
        return measure_asked(recording, windows_s[0])
    return choose_still_period(recording, blocks, wear)
