"""The findings of an analysis: all content of a report, without language and samples.

``results.json`` is their only encoding (:mod:`acromion.app.report.export.results`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from acromion.app.request import Conclusion
from acromion.fusion.clocks import in_zone
from acromion.fusion.comparison.levels import ComparedLevel, Extent, compare_with_levels, find_extent
from acromion.fusion.conventions import MAIN_THRESHOLD_DEG, CalibrationState, Pose, Side
from acromion.fusion.exposure.types import Exposure, TimeAbove
from acromion.fusion.quality import Quality, TimeAccount
from acromion.fusion.recording import MICROSECONDS, Span

if TYPE_CHECKING:
    from acromion.fusion.pipeline import Analysis


@dataclass(frozen=True, slots=True)
class Software:
    """Version and revision as printed in every report."""

    version: str
    revision: str


@dataclass(frozen=True, slots=True)
class ReportSubject:
    """The person, arm and version of a report. ``subject`` is a code, never a name; all texts are untrusted.

    ``version`` counts from 1; a later one replaces the previous one: ``changes`` lists the differences (a
    setting, "input" or "engine"), ``reason`` is the person's reason. ``columns`` is the JSON of a table's
    column profile, "" for none; ``shift`` the window that was cut from a longer recording, as an interval of
    ISO 8601, "" for none. ``conclusion`` is the clinician's, and ``report_id`` comes from
    :func:`acromion.app.report.export.results.identify_report`.
    """

    file_name: str
    subject: str
    side: Side | None
    software: Software
    version: int = 1
    reason: str = ""
    changes: tuple[str, ...] = ()
    columns: str = ""
    conclusion: Conclusion | None = None
    report_id: str = ""
    shift: str = ""
    job_title: str = ""
    isco_code: str = ""


@dataclass(frozen=True, slots=True)
class ReleaseStamp:
    """Who released a report, and on which date (ISO 8601). No results contain it: a release changes none."""

    name: str
    date: str


@dataclass(frozen=True, slots=True)
class RecordingFacts:
    """The facts stated by the file; see :class:`acromion.fusion.recording.Recording`."""

    device: str
    sha256: str
    start: datetime | None
    time_zone: str | None
    duration_us: int
    rate_hz: float
    serial_hash: str | None = None
    reader: tuple[str, str] | None = None
    clock_offset_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """Seconds from the first sample to the end."""
        return self.duration_us / MICROSECONDS


@dataclass(frozen=True, slots=True)
class StillFacts:
    """A still period."""

    start_s: float
    duration_s: float


@dataclass(frozen=True, slots=True)
class RepeatFacts:
    """A repetition of the pose, and its angle to the first."""

    start_s: float
    duration_s: float
    apart_deg: float | None


@dataclass(frozen=True, slots=True)
class PartFacts:
    """A stretch that the first pose does not apply to.

    ``pose_index``: the given pose that applies, counted from 0 in order of time; None if another axis
    applies, or none (not ``valid``).
    """

    start_s: float
    end_s: float
    valid: bool
    pose_index: int | None


@dataclass(frozen=True, slots=True)
class QuestionFacts:
    """When the sensor may have moved on the arm; see :class:`acromion.fusion.pose.wear.Question`."""

    kind: Literal["slip", "put_back", "poses"]
    start_s: float
    end_s: float
    apart_deg: float


@dataclass(frozen=True, slots=True)
class CalibrationFacts:
    """The pose and its evidence, in the order of ``results.json``.

    ``pose`` is None if ``axis`` names the sensor's axis that was strapped along the arm ("y", "-y").
    ``start_s``, ``duration_s`` and ``score`` belong to the first window, None without one; ``second`` is the
    level window of the two-point pose.
    """

    pose: Pose | None
    state: CalibrationState
    sigma_deg: float
    start_s: float | None
    duration_s: float | None
    score: float | None
    gyro_bias_dps: tuple[float, ...]
    second: StillFacts | None = None
    repeats: tuple[RepeatFacts, ...] = ()
    repeat_deg: float | None = None
    parts: tuple[PartFacts, ...] = ()
    axis: str | None = None
    slip_times_s: tuple[float, ...] = ()
    no_slip_times_s: tuple[float, ...] = ()
    walking_apart_deg: float | None = None
    proposals: tuple[StillFacts, ...] = ()
    spread_deg: float = 0.0
    needs_pose: bool = False
    questions: tuple[QuestionFacts, ...] = ()

    @property
    def still(self) -> StillFacts | None:
        """The first window."""
        if self.start_s is None or self.duration_s is None:
            return None
        return StillFacts(self.start_s, self.duration_s)


@dataclass(frozen=True, slots=True)
class MethodFacts:
    """The estimator with its version and every parameter."""

    name: str
    version: str
    parameters: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """The findings of an analysis. ``calibration`` and ``method`` are None for a file with angles."""

    __pydantic_config__: ClassVar = {"arbitrary_types_allowed": True}  # arrays
    recording: RecordingFacts
    calibration: CalibrationFacts | None
    method: MethodFacts | None
    exclusions: tuple[Span, ...]
    time: TimeAccount
    exposure: Exposure
    quality: Quality

    @property
    def extent(self) -> Extent:
        """How much of a day was analysed."""
        return find_extent(self.time, self.exclusions)

    def find_above_60(self) -> TimeAbove:
        """Return the main figure."""
        return next(t for t in self.exposure.time_above if t.threshold_deg == MAIN_THRESHOLD_DEG)

    def compare_with_levels(self) -> tuple[ComparedLevel, ...]:
        """Compare the day with each proposed level."""
        state = self.calibration.state if self.calibration else None
        return compare_with_levels(self.exposure, self.quality.verdict, self.extent, state)


@dataclass(frozen=True, slots=True, eq=False)
class FinishedAnalysis:
    """The stored content of a finished analysis: its findings and its subject."""

    findings: Findings
    subject: ReportSubject


def build_findings(analysis: Analysis) -> Findings:
    """Extract the content of a report from an analysis."""
    recording, method = analysis.recording, analysis.elevation.method
    # a file with angles has no recorded segments
    timed = recording if recording.segments else max(analysis.elevation.segments, key=len)
    return Findings(
        recording=RecordingFacts(
            device=recording.device,
            sha256=recording.sha256,
            start=_simplify_zone(recording.start, recording.time_zone),
            time_zone=recording.time_zone,
            duration_us=recording.duration_us,
            rate_hz=timed.rate_hz,
            serial_hash=recording.serial_hash,
            reader=recording.reader,
            clock_offset_s=recording.clock_offset_s,
        ),
        calibration=_build_calibration(analysis),
        method=MethodFacts(method.name, method.version, dict(method.parameters)) if method else None,
        exclusions=analysis.exclusions,
        time=analysis.time,
        exposure=analysis.exposure,
        quality=analysis.quality,
    )


def _simplify_zone(start: datetime | None, time_zone: str | None) -> datetime | None:
    """Return a start with its offset from UTC, or in the zone that the recording names."""
    offset = start.utcoffset() if start else None
    if start and offset is not None:
        start = start.replace(tzinfo=timezone(offset))
    return in_zone(start, time_zone)


def _build_calibration(analysis: Analysis) -> CalibrationFacts | None:
    calibration, settings = analysis.calibration, analysis.settings
    if calibration is None:
        return None
    first, others = next(iter(calibration.windows), None), calibration.windows[1:]
    is_pair = calibration.pose == "two-point" and len(others) > 0
    repeated = () if is_pair else zip(others, calibration.apart_deg, strict=True)
    parts = []
    for part in analysis.axis_parts:
        pose_index = None
        if part.arm_axis is not None:
            inside = (part.start_s <= still.start_s <= part.end_s for still in calibration.windows)
            is_first = np.array_equal(part.arm_axis, calibration.arm_axis)
            pose_index = 0 if is_first else next((i for i, holds in enumerate(inside) if holds), None)
        parts.append(PartFacts(part.start_s, part.end_s, part.arm_axis is not None, pose_index))
    return CalibrationFacts(
        pose=None if settings.arm_axis else calibration.pose,
        state=calibration.state,
        sigma_deg=calibration.sigma_deg,
        start_s=first.start_s if first else None,
        duration_s=first.duration_s if first else None,
        score=first.score if first else None,
        gyro_bias_dps=tuple(calibration.gyro_bias_dps.tolist()),
        second=StillFacts(others[0].start_s, others[0].duration_s) if is_pair else None,
        repeats=tuple(RepeatFacts(still.start_s, still.duration_s, apart) for still, apart in repeated),
        repeat_deg=calibration.repeat_deg,
        parts=tuple(parts),
        axis=settings.arm_axis.removeprefix("+") if settings.arm_axis else None,
        slip_times_s=settings.slip_times_s,
        no_slip_times_s=settings.no_slip_times_s,
        walking_apart_deg=calibration.walking_deg,
        proposals=tuple(StillFacts(still.start_s, still.duration_s) for still in calibration.proposals),
        spread_deg=calibration.spread_deg,
        needs_pose=calibration.needs_pose,
        questions=tuple(
            QuestionFacts(question.kind, question.first_s, question.end_s, question.apart_deg)
            for question in calibration.questions
        ),
    )
