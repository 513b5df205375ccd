"""The findings of an analysis: all that a report is made of, in no language and without the samples.

Kept beside the results (``findings.json``), it gives the report again in either language, both arms side by
side or one day beside another, with no new analysis and without the compiler.
"""

from __future__ import annotations

import json
import types
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from datetime import datetime
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin, get_type_hints
from zoneinfo import ZoneInfo

import numpy as np

from app.report.words.subject import ReportSubject
from fusion.conventions import ArmAxis, CalibrationState, MethodName, Pose, PoseHeld
from fusion.diary import DiaryEntry
from fusion.exposure.types import Exposure
from fusion.quality.types import Quality, TimeAccount
from fusion.recording import Span

if TYPE_CHECKING:
    from fusion.pipeline import Analysis
    from fusion.pose.axes import AxisPart
    from fusion.pose.calibrate import Calibration
    from fusion.pose.slips import Question
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
        known = {name: decode(inner, hints[name]) for name, inner in value.items() if name in hints}
        return kind(**known)  # type: ignore[operator]
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
    reader: tuple[str, str] | None = None


@dataclass(frozen=True, slots=True)
class SettingsFacts:
    """What the person chose; as in :class:`fusion.pipeline.AnalysisSettings`."""

    method: MethodName = "smoothed"
    pose: Pose = "n-pose"
    calibration_windows_s: tuple[tuple[float, float], ...] = ()
    diary: tuple[DiaryEntry, ...] = ()
    arm_axis: ArmAxis | None = None
    slip_times_s: tuple[float, ...] = ()
    no_slip_times_s: tuple[float, ...] = ()
    pose_held: PoseHeld | None = None


@dataclass(frozen=True, slots=True)
class StillFacts:
    """A still period, as in :class:`fusion.pose.windows.StillPeriod`."""

    start_s: float
    duration_s: float
    score: float
    gyro_bias_dps: tuple[float, ...]
    apart_deg: float | None = None
    """From the first pose, where it was held again."""


@dataclass(frozen=True, slots=True)
class PartFacts:
    """A stretch that the first pose does not read.

    ``pose_index``: the given pose that does, counted from 0 in order of time; None if another axis does, or
    (not ``is_valid``) none.
    """

    start_s: float
    end_s: float
    is_valid: bool
    pose_index: int | None


@dataclass(frozen=True, slots=True)
class QuestionFacts:
    """When the sensor may have moved on the arm; as in :class:`fusion.pose.slips.Question`."""

    kind: Literal["slip", "put_back", "poses"]
    start_s: float
    end_s: float
    apart_deg: float


@dataclass(frozen=True, slots=True)
class CalibrationFacts:
    """The pose and how it is known; as in :class:`fusion.pose.calibrate.Calibration`.

    ``still`` is the first window; ``second`` the level one of the two-point pose, ``repeats`` those in which
    the same pose was held again. The first findings know no more than these, and no ``state``.
    """

    pose: Pose
    still: StillFacts | None
    second: StillFacts | None = None
    repeats: tuple[StillFacts, ...] = ()
    state: CalibrationState | None = None
    sigma_deg: float | None = None
    gyro_bias_dps: tuple[float, ...] = ()
    walking_deg: float | None = None
    repeat_deg: float | None = None
    proposals: tuple[StillFacts, ...] = ()
    parts: tuple[PartFacts, ...] = ()
    spread_deg: float = 0.0
    needs_pose: bool = False
    questions: tuple[QuestionFacts, ...] = ()

    @property
    def bias_dps(self) -> tuple[float, ...]:
        """Gyroscope offset; earlier versions kept it with the window."""
        return self.gyro_bias_dps or (self.still.gyro_bias_dps if self.still else ())


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
            settings.method,
            settings.pose,
            settings.calibration_windows_s,
            settings.diary,
            settings.arm_axis,
            settings.slip_times_s,
            settings.no_slip_times_s,
            settings.pose_held,
        ),
        calibration=_take_calibration(analysis),
        method=MethodFacts(method.name, method.version, dict(method.parameters)) if method else None,
        exclusions=analysis.exclusions,
        time=analysis.time,
        exposure=analysis.exposure,
        quality=analysis.quality,
    )


_STATES_BEFORE: Mapping[str, CalibrationState] = {
    "given": "given",
    "held": "assumed",
    "early": "assumed",
    "walking": "none",
    "moment": "none",
    "axis": "axis",
}
"""Of earlier findings, which say how the pose was ``found``."""


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
    calibration = values["findings"]["calibration"]
    if calibration and calibration.get("found"):
        calibration["state"] = _STATES_BEFORE[calibration["found"]]
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
        reader=recording.reader,
    )


def _find_rate_hz(analysis: Analysis) -> float:
    """Give the sampling rate; that of the longest angle run where there are no samples."""
    if analysis.recording.segments:
        return analysis.recording.rate_hz
    return max(analysis.elevation.segments, key=len).rate_hz


def _take_calibration(analysis: Analysis) -> CalibrationFacts | None:
    calibration = analysis.calibration
    if calibration is None:
        return None
    windows: tuple[StillFacts | None, ...] = tuple(map(_take_still, calibration.windows)) or (None,)
    first, *others = windows
    is_pair = calibration.pose == "two-point" and len(others) > 0
    return CalibrationFacts(
        calibration.pose,
        first,
        others[0] if is_pair else None,
        () if is_pair else _take_repeats(calibration),
        calibration.state,
        calibration.sigma_deg,
        tuple(calibration.gyro_bias_dps.tolist()),
        calibration.walking_deg,
        calibration.repeat_deg,
        tuple(_take_still(still) for still in calibration.proposals),
        tuple(_take_part(part, calibration) for part in analysis.axis_parts),
        calibration.spread_deg,
        calibration.needs_pose,
        tuple(map(_take_question, calibration.questions)),
    )


def _take_repeats(calibration: Calibration) -> tuple[StillFacts, ...]:
    """Take the poses held again; an assumed one is never repeated."""
    again = zip(calibration.windows[1:], calibration.apart_deg, strict=True)
    return tuple(replace(_take_still(still), apart_deg=apart_deg) for still, apart_deg in again)


def _take_part(part: AxisPart, calibration: Calibration) -> PartFacts:
    inside = (
        index
        for index, still in enumerate(calibration.windows)
        if part.start_s <= still.start_s <= part.end_s
    )
    pose_index = None
    if part.arm_axis is not None:
        is_first = np.array_equal(part.arm_axis, calibration.arm_axis)
        pose_index = 0 if is_first else next(inside, None)
    return PartFacts(part.start_s, part.end_s, part.arm_axis is not None, pose_index)


def _take_question(question: Question) -> QuestionFacts:
    return QuestionFacts(question.kind, question.first_s, question.end_s, question.apart_deg)


def _take_still(still: StillPeriod) -> StillFacts:
    return StillFacts(still.start_s, still.duration_s, still.score, tuple(still.gyro_bias_dps.tolist()))
