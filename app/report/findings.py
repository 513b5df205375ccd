"""The findings of an analysis: all that a report is made of, in no language and without the samples.

Kept beside the results (``findings.json``), it gives the report again in either language, both arms side by
side or one day beside another, with no new analysis and without the compiler.
"""

from __future__ import annotations

import json
import types
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from datetime import datetime
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin, get_type_hints
from zoneinfo import ZoneInfo

import numpy as np

from app.report.words.subject import ReportSubject
from fusion.conventions import MethodName, Pose
from fusion.diary import DiaryEntry
from fusion.exposure.types import Exposure
from fusion.quality.types import Quality, TimeAccount
from fusion.recording import Span

if TYPE_CHECKING:
    from fusion.pipeline import Analysis
    from fusion.pose.calibrate import Calibration
    from fusion.pose.windows import StillPeriod


# Conversion of frozen values to JSON and back by their types: dataclasses, tuples, mappings, arrays, times.
#
# Numbers keep every digit; NaN and infinity, which an array may hold, are written as ``json`` writes them.
# A clock that follows a zone keeps the zone's name beside its time.


def encode(value: Any) -> Any:
    """Turn a value into what ``json`` can write."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: encode(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): encode(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [encode(inner) for inner in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return _encode_moment(value) if isinstance(value, datetime) else value


def decode(value: Any, kind: Any) -> Any:
    """Turn what ``json`` read into a value of the type ``kind``."""
    origin, inner = get_origin(kind), get_args(kind)
    if value is None or origin is Literal:
        return value
    if origin in {Union, types.UnionType}:
        return _decode_one_of(value, inner)
    if origin is tuple:
        return _decode_tuple(value, inner)
    if origin is np.ndarray:
        return np.array(value, get_args(inner[1])[0])
    if origin in {dict, Mapping}:
        return {inner[0](key): decode(item, inner[1]) for key, item in value.items()}
    return _decode_plain(value, kind)


def _decode_one_of(value: Any, kinds: tuple[Any, ...]) -> Any:
    """Only one of the kinds is not a plain value of JSON, or none of them is."""
    structured = [kind for kind in kinds if kind not in {type(None), str, int, float}]
    return decode(value, structured[0]) if structured else value


def _decode_tuple(values: Any, kinds: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        return tuple(decode(value, kinds[0]) for value in values)
    return tuple(decode(value, kind) for value, kind in zip(values, kinds, strict=True))


def _decode_plain(value: Any, kind: Any) -> Any:
    if is_dataclass(kind):
        hints = _read_hints(kind)  # type: ignore[arg-type]
        return kind(**{name: decode(inner, hints[name]) for name, inner in value.items()})  # type: ignore[operator]
    return _decode_moment(value) if kind is datetime else value


@cache
def _read_hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)


def _encode_moment(moment: datetime) -> list[str]:
    zone = moment.tzinfo.key if isinstance(moment.tzinfo, ZoneInfo) else ""
    return [moment.isoformat(), zone]


def _decode_moment(written: list[str]) -> datetime:
    moment = datetime.fromisoformat(written[0])
    return moment.astimezone(ZoneInfo(written[1])) if written[1] else moment


SCHEMA = "acromion.findings/1"


@dataclass(frozen=True, slots=True)
class RecordingFacts:
    """What the file states; as in :class:`fusion.recording.Recording`."""

    device: str
    sha256: str
    start: datetime | None
    time_zone: str | None
    duration_us: int
    rate_hz: float
    serial_hash: str | None = None


@dataclass(frozen=True, slots=True)
class SettingsFacts:
    """What the person chose; as in :class:`fusion.pipeline.AnalysisSettings`."""

    method: MethodName = "smoothed"
    pose: Pose = "n-pose"
    calibration_windows_s: tuple[tuple[float, float], ...] = ()
    diary: tuple[DiaryEntry, ...] = ()


@dataclass(frozen=True, slots=True)
class StillFacts:
    """A still period, as in :class:`fusion.pose.windows.StillPeriod`."""

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
