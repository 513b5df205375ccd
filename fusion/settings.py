"""Options of an analysis."""

import math
from dataclasses import dataclass
from numbers import Real
from typing import get_args

from acromion.fusion.clocks import parse_time_zone
from acromion.fusion.conventions import ARM_AXES, ArmAxis, MethodName, Pose, PoseHeld, check_choice
from acromion.fusion.diary import DiaryEntry


@dataclass(frozen=True, slots=True)
class CarriedPose:
    """The arm axis of an earlier shift: unit vector in the sensor, and its standard deviation."""

    axis: tuple[float, float, float]
    sigma_deg: float


@dataclass(frozen=True, slots=True)
class AnalysisSettings:
    """Options of an analysis; everything else follows from the recording.

    ``method``: "smoothed", "published" or "live".
    ``pose``: how the arm was held for the calibration: one of :data:`acromion.fusion.conventions.Pose`.
    ``calibration_windows_s``: (start, end) from the first sample of each time the pose was held. If empty,
    the first still period is assumed. The two-point pose takes two windows: hanging, then level.
    ``diary``: the periods of the day; breaks, time not worn and time outside the shift are not analysed.
    ``arm_axis``: if no pose was held, the sensor axis that was strapped along the arm, towards the shoulder,
    with its sign: "+x", "-x", "+y", "-y", "+z" or "-z" (:func:`acromion.fusion.conventions.parse_arm_axis`
    also reads
    "y").
    ``slip_times_s``: times from the first sample at which a person states that the sensor slipped or was
    moved.
    ``no_slip_times_s``: times at which a person states that it did not, although the recording suggests it.
    ``pose_held``: "start": a person states that the pose was held at the start of wear; a window or an axis
    takes precedence. "no": not stated; statements of the file or its column profile are ignored.
    ``carried``: the pose of an earlier shift; a person states that the sensor was not removed since. A
    confirmed pose of this recording, or an axis, takes precedence.
    ``time_zone``: the zone of clock times, such as "Europe/Paris" or "UTC-05:00"; "" for that of the file.
    ``clock_offset_s``: seconds to add to the device's clock, if it was set to the wrong time.
    """

    method: MethodName = "smoothed"
    pose: Pose = "n-pose"
    calibration_windows_s: tuple[tuple[float, float], ...] = ()
    diary: tuple[DiaryEntry, ...] = ()
    arm_axis: ArmAxis | None = None
    slip_times_s: tuple[float, ...] = ()
    no_slip_times_s: tuple[float, ...] = ()
    pose_held: PoseHeld | None = None
    carried: CarriedPose | None = None
    time_zone: str = ""
    clock_offset_s: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError with the allowed values if a value cannot be used."""
        check_choice("method", self.method, get_args(MethodName))
        check_choice("pose", self.pose, get_args(Pose))
        check_choice("arm_axis", self.arm_axis, (None, *ARM_AXES))
        check_choice("pose_held", self.pose_held, (None, *get_args(PoseHeld)))
        windows, times_s = self.calibration_windows_s, (self.slip_times_s, self.no_slip_times_s)
        if not _is_row(windows) or not all(
            _is_row(one) and len(one) == 2 and all(map(_is_moment, one)) and one[0] < one[1]
            for one in windows
        ):
            raise ValueError(
                f"calibration_windows_s: {windows!r}; allowed: (start, end), s, 0 <= start < end"
            )
        for row in times_s:
            if not _is_row(row) or not all(map(_is_moment, row)):
                raise ValueError(f"slip times: {row!r}; allowed: seconds from the first sample, >= 0")
        if not _is_row(self.diary) or not all(isinstance(entry, DiaryEntry) for entry in self.diary):
            raise ValueError(f"diary: {self.diary!r}; allowed: DiaryEntry, ...")
        if not isinstance(self.carried, CarriedPose | None):
            raise ValueError(f"carried: {self.carried!r}; allowed: None, CarriedPose")
        try:
            parse_time_zone(self.time_zone)
        except ValueError as error:
            raise ValueError(f"time_zone: {self.time_zone!r}; allowed: {error}") from None
        offset_s = self.clock_offset_s
        if not isinstance(offset_s, Real) or isinstance(offset_s, bool) or not math.isfinite(offset_s):
            raise ValueError(f"clock_offset_s: {self.clock_offset_s!r}; allowed: seconds")


def _is_row(value: object) -> bool:
    return isinstance(value, tuple | list)


def _is_moment(value: object) -> bool:
    """Return whether a value is a time in seconds from the first sample: a number, including numpy's."""
    return isinstance(value, Real) and not isinstance(value, bool) and 0.0 <= float(value) < math.inf


DEFAULT_SETTINGS = AnalysisSettings()
