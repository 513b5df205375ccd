"""The one road from a stored file to a report, taken by page, API and command line alike."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

from app.report.content import Report, ReportSubject, Software, build_report
from app.report.elevation_file import write_elevation
from app.report.exports import export_results, tell_in_brief
from app.report.html import render_html
from app.report.pdf import render_pdf
from app.report.results import encode_results
from app.request import OnStage, ReportKind, ReportRequest, Stage
from app.version import software_revision, software_version
from fusion.angle_files import AngleFile, AngleFileOptions, holds_samples, read_angle_file, tell_layout
from fusion.pipeline import Analysis, AnalysisSettings, analyse, analyse_angle_file, analyse_angles
from fusion.readers import join_recordings, parse_profile, read_recording
from fusion.recording import Recording

# How far along each stage begins, from the share of time each takes on a long shift.
_BEGINS: dict[Stage, float] = {
    "reading": 0.0,
    "checking": 0.45,
    "calibrating": 0.5,
    "fusing": 0.55,
    "counting": 0.7,
    "rendering": 0.9,
}


CAPTURES = ("mvnx", "dot")
"""Layouts whose angle needs no fusion of ours."""


def ignore_stage(_stage: Stage, _fraction: float) -> None:
    """Take the place of a listener where nobody listens."""


def make_report(log: Path, request: ReportRequest, out: Path, on_stage: OnStage = ignore_stage) -> None:
    """Analyse the file and write every product into the existing folder ``out``.

    Writes ``results.json``, ``elevation.parquet``, the tables of :func:`export_results` and, for each
    language, ``report.<language>.<kind>`` and the answer in five lines, ``answer.<language>.txt``.

    Raises
    ------
    fusion.errors.FusionError
        When no number can be given; then nothing has been written.
    """
    analysis = _analyse_file(log, request, lambda stage: on_stage(stage, _BEGINS[stage]))
    on_stage("rendering", _BEGINS["rendering"])
    subject = describe_subject(request)
    results = encode_results(analysis, subject)
    (out / "results.json").write_bytes(results)
    for name, table in export_results(json.loads(results)).items():
        (out / name).write_bytes(table)
    write_elevation(analysis.elevation, out / "elevation.parquet")
    reports = [build_report(analysis, subject, language) for language in request.languages]
    for report in reports:
        (out / f"answer.{report.language}.txt").write_bytes(tell_in_brief(report))
        for kind, body in _render(report, request.kinds, results):
            (out / f"report.{report.language}.{kind}").write_bytes(body)


def describe_subject(request: ReportRequest) -> ReportSubject:
    """Say whose arm it is and which software answers."""
    software = Software(software_version(), software_revision())
    return ReportSubject(
        file_name=request.file_name, subject=request.subject, side=request.side, software=software
    )


def _analyse_file(log: Path, request: ReportRequest, begin: Callable[[Stage], None]) -> Analysis:
    begin("reading")
    if request.source == "angles":
        with log.open("rb") as file:
            return analyse_angles(file, begin, request.list_diary())
    captured = _read_capture(log, request)
    if captured is not None:
        return analyse_angle_file(captured, begin, request.list_diary(), request.calibration_windows_s)
    settings = AnalysisSettings(
        request.method, request.pose, request.calibration_windows_s, request.list_diary()
    )
    return analyse(_read_logs(log, request), settings, begin)


def _read_capture(log: Path, request: ReportRequest) -> AngleFile | None:
    """Read a motion capture; None for a file with samples of an inertial sensor."""
    with log.open("rb") as file:
        layout = tell_layout(file, request.file_name)
        if layout not in CAPTURES or request.joined or (layout == "dot" and holds_samples(file)):
            return None
        return read_angle_file(file, request.file_name, AngleFileOptions(request.side, request.rate_hz))


def _read_logs(log: Path, request: ReportRequest) -> Recording:
    profile = parse_profile(request.profile) if request.profile else None
    recordings = []
    for path in (log, *map(Path, request.joined)):
        name = request.file_name if path is log else path.name
        with path.open("rb") as file:
            recordings.append(read_recording(file, file_name=name, rate_hz=request.rate_hz, profile=profile))
    return join_recordings(recordings) if request.joined else recordings[0]


def _render(
    report: Report, kinds: tuple[ReportKind, ...], results: bytes
) -> Iterator[tuple[ReportKind, bytes]]:
    if "html" in kinds:
        yield "html", render_html(report)
    if "pdf" in kinds:
        yield "pdf", render_pdf(report, {"results.json": results})
