"""The chain from a recording to its figures, top to bottom."""

from dataclasses import dataclass
from typing import Literal

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


def analyse(recording: Recording, settings: AnalysisSettings | None = None) -> Analysis:
    """Turn a recording into elevation, exposure and a verdict.

    Raises
    ------
    fusion.errors.UnusableRecording
        When no angle can be trusted (too short, no usable calibration).
    """
    settings = settings or AnalysisSettings()
    samples = calibrate(recording, settings.pose, settings.calibration_windows_s)
    exclusions = find_exclusions(recording)
    elevation = leave_out(estimate_elevation(samples, settings.method), exclusions)
    time = account_time(recording, elevation, exclusions)
    exposure = summarise_exposure(elevation, recording.start)
    quality = assess_quality(recording, samples.calibration, time, exclusions)
    return Analysis(
        recording, settings, samples.calibration, elevation, exclusions, time, exposure, quality
    )
