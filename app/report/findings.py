"""All that a report is made of, in no language: what an analysis found, without its samples.

Kept beside the results (``findings.json``), it gives the report again in either language, both arms side by
side or one day beside another, with no new analysis and without the compiler.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING

from app.report.codec import decode, encode
from app.report.subject import ReportSubject
from fusion.choices import MethodName, Pose
from fusion.diary import DiaryEntry
from fusion.exposure.types import Exposure
from fusion.quality.types import Quality, TimeAccount
from fusion.recording import Span

if TYPE_CHECKING:
    from fusion.calibration import Calibration
    from fusion.pipeline import Analysis
    from fusion.pose_windows import StillPeriod

SCHEMA = "acromion.findings/1"


@dataclass(frozen=True, slots=True)
class RecordingFacts:
    """What the file says of itself; as in :class:`fusion.recording.Recording`."""

    device: str
    sha256: str
    start: datetime | None
    time_zone: str | None
    duration_us: int
    rate_hz: float
    serial_hash: str | None = None


@dataclass(frozen=True, slots=True)
class SettingsFacts:
    """What the person decided; as in :class:`fusion.pipeline.AnalysisSettings`."""

    method: MethodName = "smoothed"
    pose: Pose = "n-pose"
    calibration_windows_s: tuple[tuple[float, float], ...] = ()
    diary: tuple[DiaryEntry, ...] = ()


@dataclass(frozen=True, slots=True)
class StillFacts:
    """A still period, as in :class:`fusion.pose_windows.StillPeriod`."""

    start_s: float
    duration_s: float
    score: float
    gyro_bias_dps: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class CalibrationFacts:
    """The pose and where it was found."""

    pose: Pose
    still: StillFacts
    second: StillFacts | None = None


@dataclass(frozen=True, slots=True)
class MethodFacts:
    """The estimator with its version and every parameter."""

    name: str
    version: str
    parameters: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What an analysis found. ``calibration`` and ``method`` are None for a ready angle series."""

    recording: RecordingFacts
    settings: SettingsFacts
    calibration: CalibrationFacts | None
    method: MethodFacts | None
    exclusions: tuple[Span, ...]
    time: TimeAccount
    exposure: Exposure
    quality: Quality


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """What a finished analysis keeps: what was found, and whose it is."""

    findings: Findings
    subject: ReportSubject


def take_findings(analysis: Analysis) -> Findings:
    """Take from an analysis what its report is made of."""
    settings, method = analysis.settings, analysis.elevation.method
    return Findings(
        recording=_take_recording(analysis),
        settings=SettingsFacts(
            settings.method, settings.pose, settings.calibration_windows_s, settings.diary
        ),
        calibration=_take_calibration(analysis.calibration),
        method=MethodFacts(method.name, method.version, dict(method.parameters)) if method else None,
        exclusions=analysis.exclusions,
        time=analysis.time,
        exposure=analysis.exposure,
        quality=analysis.quality,
    )


def encode_findings(findings: Findings, subject: ReportSubject) -> bytes:
    """Write the findings and whose they are as JSON: the same findings give the same bytes."""
    values = {"schema": SCHEMA, "subject": encode(subject), "findings": encode(findings)}
    return json.dumps(values, ensure_ascii=False, separators=(",", ":")).encode("utf-8") + b"\n"


def decode_findings(text: bytes) -> Kept:
    """Read what :func:`encode_findings` wrote.

    Raises
    ------
    ValueError
        When it was written by a later program, in another form.
    """
    values = json.loads(text)
    if values["schema"] != SCHEMA:
        raise ValueError(values["schema"])
    return Kept(decode(values["findings"], Findings), decode(values["subject"], ReportSubject))


def _take_recording(analysis: Analysis) -> RecordingFacts:
    recording = analysis.recording
    return RecordingFacts(
        device=recording.device,
        sha256=recording.sha256,
        start=recording.start,
        time_zone=recording.time_zone,
        duration_us=recording.duration_us,
        rate_hz=_find_rate_hz(analysis),
        serial_hash=recording.serial_hash,
    )


def _find_rate_hz(analysis: Analysis) -> float:
    """Give the sampling rate; that of the longest angle run where there are no samples."""
    if analysis.recording.segments:
        return analysis.recording.rate_hz
    return max(analysis.elevation.segments, key=len).rate_hz


def _take_calibration(calibration: Calibration | None) -> CalibrationFacts | None:
    if calibration is None:
        return None
    second = _take_still(calibration.second) if calibration.second else None
    return CalibrationFacts(calibration.pose, _take_still(calibration.still), second)


def _take_still(still: StillPeriod) -> StillFacts:
    return StillFacts(still.start_s, still.duration_s, still.score, tuple(still.gyro_bias_dps.tolist()))
