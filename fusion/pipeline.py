"""The chain from a recording to its figures, top to bottom."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import BinaryIO, Literal

from fusion.angle_series import read_angle_series
from fusion.calibration import Calibration, Pose, calibrate
from fusion.elevation import Elevation, estimate_elevation
from fusion.exposure import Exposure, summarise_exposure
from fusion.orientation import MethodName
from fusion.quality import (
    Quality,
    TimeAccount,
    account_time,
    assess_quality,
    find_exclusions,
    leave_out,
)
from fusion.recording import Recording, Span

Side = Literal["left", "right"]
Step = Literal["checking", "calibrating", "fusing", "counting"]

POSE_SIGMA_DEG = 3.0
"""How well a held pose ties the sensor to the arm, one standard deviation."""

FUSION_SIGMA_DEG: dict[MethodName, float] = {"smoothed": 0.5, "published": 4.2}
"""Typical error of the angle itself: RMSE on simulated shifts (benchmarks/road.py) and arm tasks."""


@dataclass(frozen=True, slots=True)
class AnalysisSettings:
    """What the person may decide; everything else follows from the recording.

    ``calibration_windows_s``: (start, end) seconds from the first sample; none means "propose one";
    two for the two-point pose (hanging, then level).
    """

    method: MethodName = "smoothed"
    pose: Pose = "n-pose"
    calibration_windows_s: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Analysis:
    """Every step's result. ``calibration`` is None for a ready angle series."""

    recording: Recording
    settings: AnalysisSettings
    calibration: Calibration | None
    elevation: Elevation
    exclusions: tuple[Span, ...]
    time: TimeAccount
    exposure: Exposure
    quality: Quality


def announce_nothing(_step: Step) -> None:
    """Take the place of a listener where nobody listens."""


def analyse(
    recording: Recording,
    settings: AnalysisSettings | None = None,
    on_step: Callable[[Step], None] = announce_nothing,
) -> Analysis:
    """Turn a recording into elevation, exposure and a verdict.

    Raises
    ------
    fusion.errors.UnusableRecording
        When no angle can be trusted (too short, no usable calibration).
    """
    settings = settings or AnalysisSettings()
    on_step("checking")
    exclusions = find_exclusions(recording)
    on_step("calibrating")
    samples = calibrate(recording, settings.pose, settings.calibration_windows_s)
    on_step("fusing")
    elevation = leave_out(estimate_elevation(samples, settings.method), exclusions)
    on_step("counting")
    time = account_time(recording, elevation, exclusions)
    exposure = summarise_exposure(
        elevation,
        recording.start,
        recording,
        samples.calibration.still.gyro_bias_dps,
        math.hypot(POSE_SIGMA_DEG, FUSION_SIGMA_DEG[settings.method]),
    )
    quality = assess_quality(recording, samples.calibration, time, exclusions, samples.flags)
    return Analysis(recording, settings, samples.calibration, elevation, exclusions, time, exposure, quality)


def analyse_angles(file: BinaryIO, on_step: Callable[[Step], None] = announce_nothing) -> Analysis:
    """Give the exposure of a ready angle series (columns ``time_s,elevation_deg``; empty is missing)."""
    recording, elevation = read_angle_series(file)
    on_step("counting")
    time = account_time(recording, elevation, ())
    exposure = summarise_exposure(elevation, recording.start)
    quality = assess_quality(recording, None, time, ())
    return Analysis(recording, AnalysisSettings(), None, elevation, (), time, exposure, quality)
