"""Finished analyses of several days, made by hand: that of the factory, with one figure changed."""

from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from acromion.app.report.export.angles import write_elevation
from acromion.app.report.export.results import encode_results
from acromion.app.report.findings import Findings, FinishedAnalysis, ReportSubject
from acromion.app.report.several.people import MeasuredDay, Stage
from acromion.app.request import OnStage, ReportRequest
from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.exposure.types import TimeAbove
from tests.app import stand_ins
from tests.app.analysis_factory import ANALYSED_S, make_analysis, make_exposure, make_quality, make_subject

MONDAY = datetime.fromisoformat("2026-03-02T08:00:00")


def make_day(
    day: int,
    above_60_percent: float = 7.6,
    *,
    subject: str = "S012",
    side: str | None = "right",
    stage: Stage = "all",
    place: str = "",
) -> MeasuredDay:
    """A whole shift, ``day`` days after Monday."""
    exposure = make_exposure()
    above = tuple(
        TimeAbove(60, ANALYSED_S * above_60_percent / 100, above_60_percent) if t.threshold_deg == 60 else t
        for t in exposure.time_above
    )
    findings = make_analysis(exposure=replace(exposure, time_above=above), quality=make_quality("good"))
    start = MONDAY + timedelta(days=day)
    sha256 = f"{subject}{side}{day}".encode().hex().ljust(64, "0")
    findings = replace(findings, recording=replace(findings.recording, start=start, sha256=sha256))
    return MeasuredDay(FinishedAnalysis(findings, make_subject(subject, side=side)), stage, place)


def write_day(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Take ``make_report``'s place: the recording holds a day and its percentage, ``b"0 4.0"``."""
    stand_ins.write_report(log, request, out, on_stage)
    day, percent = log.read_text().split()
    made = make_day(int(day), float(percent), subject=request.subject, side=request.side).kept
    finish_day(out, made.findings, replace(made.subject, file_name=request.file_name))


def finish_day(folder: Path, findings: Findings, subject: ReportSubject) -> None:
    """Leave what a report of several days is made from; the angle is 20 deg for an hour."""
    (folder / "results.json").write_bytes(encode_results(findings, subject))
    segment = ElevationSegment(0, 1.0, np.full(3600, 20.0, np.float32), np.full(3600, True))
    write_elevation(Elevation((segment,), None), folder / "elevation.parquet")


def change_findings(day: MeasuredDay, **changes: object) -> MeasuredDay:
    """The same day, with other findings."""
    findings = replace(day.kept.findings, **changes)  # type: ignore[arg-type]
    return replace(day, kept=replace(day.kept, findings=findings))


def change_recording(day: MeasuredDay, **changes: object) -> MeasuredDay:
    """The same day, from another recording."""
    recording = replace(day.kept.findings.recording, **changes)  # type: ignore[arg-type]
    return change_findings(day, recording=recording)
