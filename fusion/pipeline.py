"""The analysis pipeline: from a recording to its figures, in order."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from typing import TYPE_CHECKING, BinaryIO, Literal

from acromion.fusion.angle_files import AngleFile, calibrate_alone, resample_file
from acromion.fusion.angle_files.angle_series import read_angle_series
from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import correct_start
from acromion.fusion.conventions import is_npose
from acromion.fusion.elevation import Elevation, apply_reading, estimate_elevation
from acromion.fusion.errors import UnknownAxis
from acromion.fusion.exposure.parts import DayDivision, snap_periods
from acromion.fusion.exposure.periods import (
    Placed,
    divide_day,
    drop_poses,
    find_diary_poses,
    find_left_out,
    place_diary,
)
from acromion.fusion.exposure.plots import draw_day
from acromion.fusion.exposure.summary import remove_short_ranges, summarise_exposure, widen_intervals
from acromion.fusion.exposure.types import Exposure
from acromion.fusion.pose.calibrate import (
    CalibratedSamples,
    Calibration,
    calibrate,
    check_window,
    reduce_recording,
)
from acromion.fusion.pose.rules import AxisPart
from acromion.fusion.quality import Quality, TimeAccount
from acromion.fusion.quality.time_account import (
    account_time,
    check_minimum_duration,
    count_holes_us,
    divide_time,
    find_exclusions,
    leave_out,
    make_disjoint,
    propose_nonwear,
)
from acromion.fusion.quality.verdict import (
    assess_quality,
    flag_accelerometer_drift,
    flag_gyro_drift,
    flag_pose,
    flag_published,
    flag_untrusted,
    flag_untrusted_pose,
    flag_upside_down,
)
from acromion.fusion.readers import RecordingFile, read_recording
from acromion.fusion.readers.time.clock import set_clock
from acromion.fusion.recording import MICROSECONDS, QualityFlag, Recording, Span, flag_spans, join_overlapping
from acromion.fusion.settings import DEFAULT_SETTINGS, AnalysisSettings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Step = Literal["checking", "calibrating", "fusing", "counting"]

SOFT_TISSUE_SIGMA_DEG = 4.0
"""Difference between a sensor on the skin and the humerus: 2 to 5 deg on four people (docs/validation.md)."""
UNKNOWN_SIGMA_DEG = 0.0
"""For precomputed angles, whose error is unknown: their intervals only include the sampling of the day."""


@dataclass(frozen=True, slots=True, eq=False)
class Analysis:
    """The results of every step.

    ``recording``: the recording.
    ``settings``: as given, or the defaults.
    ``calibration``: the pose; None for a precomputed angle series.
    ``elevation``: the angle, at most about 100 rows a second; also valid in breaks.
    ``exclusions``: all time excluded from the analysis, including the breaks of the diary.
    ``time``: how the time of the recording was used.
    ``exposure``: the figures.
    ``quality``: the verdict and all caveats.
    ``axis_parts``: the stretches that need another axis than that of the first pose.
    """

    recording: Recording
    settings: AnalysisSettings
    calibration: Calibration | None
    elevation: Elevation
    exclusions: tuple[Span, ...]
    time: TimeAccount
    exposure: Exposure
    quality: Quality
    axis_parts: tuple[AxisPart, ...] = ()

    def __repr__(self) -> str:
        start = f" from {self.recording.start:%Y-%m-%d %H:%M}" if self.recording.start else ""
        above = {item.threshold_deg: item.percent for item in self.exposure.time_above}
        return (
            f"Analysis({self.recording.device}{start}, {self.exposure.analysed_s / 3600.0:.2f} h analysed, "
            f"{above[60]:.1f} % at 60 deg or above, median {self.exposure.percentiles_deg[50]:.1f} deg, "
            f"quality {self.quality.verdict})"
        )

    def plot(self) -> "Figure":
        """Draw the day.

        Returns
        -------
        matplotlib.figure.Figure
            P10 to P90 and the median of each minute; excluded time is hatched.

        Raises
        ------
        ModuleNotFoundError
            matplotlib is not installed.
        """
        return draw_day(self.exposure.minutes, self.recording.start, self.exclusions)


@dataclass(frozen=True, slots=True, eq=False)
class FusedRecording:
    """The angle of a recording before exposure is computed.

    ``fused`` includes, ``elevation`` excludes the time that the signal itself rules out. ``flags``: the
    caveats of the calibration.
    """

    samples: CalibratedSamples
    fused: Elevation
    elevation: Elevation
    exclusions: tuple[Span, ...]
    flags: tuple[QualityFlag, ...]


def ignore_step(_step: Step) -> None:
    """Ignore the step; this is the default listener."""


def analyse(
    recording: Recording | RecordingFile,
    settings: AnalysisSettings | None = None,
    on_step: Callable[[Step], None] = ignore_step,
) -> Analysis:
    """Compute elevation, exposure and a quality verdict from a recording.

    Parameters
    ----------
    recording
        The result of :func:`acromion.read_recording`, or a path or file to read with it.
    settings
        Method, pose, calibration windows and diary; the defaults if omitted.
    on_step
        Called with the name of each step as it begins.

    Returns
    -------
    Analysis
        The result of every step.

    Raises
    ------
    acromion.fusion.errors.UnreadableFile
        The file is not a readable recording.
    acromion.fusion.errors.UnusableRecording
        No angle can be trusted (too short, no usable calibration), or a stated clock cannot be right.
    acromion.fusion.errors.UnusableDiary
        A row of the diary cannot be placed on the recording.
    OSError
        The path cannot be opened.
    """
    if not isinstance(recording, Recording):
        recording = read_recording(recording)
    settings = settings or AnalysisSettings()
    recording = set_clock(recording, settings.time_zone, settings.clock_offset_s)
    settings = apply_file_settings(recording, settings)
    on_step("checking")
    placed = place_diary(settings.diary, recording.start, recording.duration_us)
    check_minimum_duration(recording)
    found = fuse_recording(recording, settings, on_step)
    samples, elevation = found.samples, found.elevation
    on_step("counting")
    day = _divide(recording, elevation, found.exclusions, placed)
    exposure = remove_short_ranges(_summarise_readings(samples, elevation, day))
    time = replace(_divide_time(recording, day, exposure, found.flags), shift_us=placed.shift_us)
    static_dps = samples.calibration.gyro_bias_dps
    flags = (
        *found.flags,
        *placed.flags,
        *flag_spans(Caveat.NONWEAR, propose_nonwear(recording, day.exclusions)),
        *flag_untrusted(recording, found.fused, day.exclusions),
        *flag_untrusted_pose(samples.calibration, found.fused),
        *(flag_published(samples.bias, static_dps) if settings.method == "published" else ()),
        *flag_gyro_drift(samples.bias),
        *flag_upside_down(exposure),
    )
    quality = assess_quality(recording, samples.calibration, time, day.exclusions, flags)
    return Analysis(
        recording,
        settings,
        samples.calibration,
        elevation,
        day.exclusions,
        time,
        exposure,
        quality,
        samples.axis_parts,
    )


def check_stated_times(
    settings: AnalysisSettings, start: datetime | None, duration_us: int
) -> tuple[QualityFlag, ...]:
    """Return the caveats of the diary, from the start and duration of a recording alone.

    Raises UnusableDiary or UnusableCalibration as the analysis of the recording would.
    """
    poses_s = find_diary_poses(settings.diary, start, duration_us)
    is_known = settings.calibration_windows_s or settings.arm_axis
    for window_s in join_overlapping(settings.calibration_windows_s if is_known else poses_s):
        check_window(window_s, duration_us)
    return place_diary(drop_poses(settings.diary), start, duration_us).flags


def apply_file_settings(recording: Recording, settings: AnalysisSettings) -> AnalysisSettings:
    """Use the poses of the diary, or the pose or axis that the file states, if the person gives neither."""
    poses_s = find_diary_poses(settings.diary, recording.start, recording.duration_us)
    if poses_s:
        diary = drop_poses(settings.diary)
        is_known = settings.calibration_windows_s or settings.arm_axis
        windows_s = settings.calibration_windows_s if is_known else poses_s
        settings = replace(settings, diary=diary, calibration_windows_s=windows_s)
    if settings.calibration_windows_s or settings.arm_axis or settings.pose == "two-point":
        return settings
    if recording.arm_axis is not None:
        return replace(settings, arm_axis=recording.arm_axis)
    held = settings.pose_held or recording.pose_held
    return replace(settings, calibration_windows_s=recording.pose_windows_s, pose_held=held)


def _summarise_readings(samples: CalibratedSamples, elevation: Elevation, day: "_Day") -> Exposure:
    """Return the figures; their intervals include every reading that no person has ruled out."""
    recording, calibration = samples.recording, samples.calibration

    def summarise(counted: Elevation) -> Exposure:
        return summarise_exposure(
            counted,
            recording.start,
            recording,
            calibration.gyro_bias_dps,
            math.hypot(calibration.sigma_deg, elevation.bias_sigma_deg or 0.0, SOFT_TISSUE_SIGMA_DEG),
            division=day.division,
            is_npose=is_npose(calibration.pose, calibration.state),
        )

    others = [summarise(apply_reading(day.counted, reading)) for reading in samples.readings]
    return widen_intervals(summarise(day.counted), others)


def fuse_recording(
    recording: Recording, settings: AnalysisSettings, on_step: Callable[[Step], None] = ignore_step
) -> FusedRecording:
    """Calibrate and fuse a recording of any length.

    Raises UnusableRecording: no usable calibration.
    """
    recording = set_clock(recording, settings.time_zone, settings.clock_offset_s)
    settings = apply_file_settings(recording, settings)
    blocks = reduce_recording(recording)
    exclusions = find_exclusions(recording, blocks)
    on_step("calibrating")
    samples = calibrate(recording, settings, blocks=blocks)
    drift = flag_accelerometer_drift(samples.stills, samples.accelerometer)
    flags = (*flag_pose(samples, settings), *drift)
    del blocks  # frees memory for the angle
    on_step("fusing")
    fused = estimate_elevation(samples, settings.method)
    samples = replace(samples, runs=())  # frees memory for the figures
    return FusedRecording(samples, fused, leave_out(fused, exclusions), exclusions, flags)


@dataclass(frozen=True, slots=True, eq=False)
class _Day:
    """The day as divided by its diary: the counted angle and all excluded time."""

    division: DayDivision
    exclusions: tuple[Span, ...]
    counted: Elevation


def _divide(recording: Recording, elevation: Elevation, exclusions: tuple[Span, ...], placed: Placed) -> _Day:
    """Exclude the diary's breaks from the counted angle; if two reasons overlap, the diary's is reported."""
    if not placed.periods:
        return _Day(DayDivision(marks=placed.marks, postures=placed.postures), exclusions, elevation)
    periods = snap_periods(placed.periods, elevation.segments)
    pieces = divide_day(periods, recording.duration_us)
    left_out = find_left_out(pieces)
    every = make_disjoint((*exclusions, *left_out), recording.duration_us)
    division = DayDivision(periods, pieces, placed.marks, placed.postures)
    return _Day(division, every, leave_out(elevation, left_out))


def _divide_time(
    recording: Recording, day: _Day, exposure: Exposure, flags: tuple[QualityFlag, ...] = ()
) -> TimeAccount:
    time = account_time(recording, day.counted, day.exclusions, flags)
    analysed_us: dict[str, int] = {}
    for part in exposure.by_period:
        part_us = round(part.analysed_s * MICROSECONDS)
        analysed_us[part.kind] = analysed_us.get(part.kind, 0) + part_us
    holes_us = count_holes_us(recording, day.exclusions) if recording.holds_samples else time.missing_us
    return divide_time(time, analysed_us or {"work": time.analysed_us}, day.exclusions, holes_us)


def analyse_angles(
    file: BinaryIO,
    on_step: Callable[[Step], None] = ignore_step,
    settings: AnalysisSettings = DEFAULT_SETTINGS,
) -> Analysis:
    """Return the analysis of an angle series (columns ``time_s,elevation_deg``; empty is missing)."""
    return _count_ready(*read_angle_series(file), on_step, settings)


def analyse_angle_file(
    file: AngleFile,
    on_step: Callable[[Step], None] = ignore_step,
    settings: AnalysisSettings = DEFAULT_SETTINGS,
) -> Analysis:
    """Return the analysis of a motion capture; the windows or the diary state when the arm hung, if needed.

    Raises UnknownAxis: the orientation of a sensor that never hung still.
    """
    start = correct_start(file.start, settings.time_zone, settings.clock_offset_s)
    duration_us = round((file.last_s - file.first_s) * MICROSECONDS)
    windows_s = settings.calibration_windows_s or find_diary_poses(settings.diary, start, duration_us)
    known = calibrate_alone(file, windows_s)
    if known.elevation_deg is None:
        raise UnknownAxis
    settings = replace(settings, diary=drop_poses(settings.diary))
    return _count_ready(*resample_file(known, known.elevation_deg), on_step, settings)


def _count_ready(
    recording: Recording,
    elevation: Elevation,
    on_step: Callable[[Step], None],
    settings: AnalysisSettings,
) -> Analysis:
    recording = set_clock(recording, settings.time_zone, settings.clock_offset_s)
    placed = place_diary(settings.diary, recording.start, recording.duration_us)
    on_step("counting")
    day = _divide(recording, elevation, (), placed)
    exposure = remove_short_ranges(
        summarise_exposure(
            day.counted,
            recording.start,
            bias_sigma_deg=UNKNOWN_SIGMA_DEG,
            division=day.division,
            is_npose=any(flag.code == Caveat.NPOSE for flag in recording.flags),
        )
    )
    time = replace(_divide_time(recording, day, exposure), shift_us=placed.shift_us)
    flags = (*placed.flags, *flag_upside_down(exposure))
    quality = assess_quality(recording, None, time, day.exclusions, flags)
    return Analysis(recording, settings, None, elevation, day.exclusions, time, exposure, quality)
