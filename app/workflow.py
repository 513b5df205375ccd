"""The one road from a stored file to a report, taken by page, API and command line alike."""

import hashlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path

from app.day import write_day_of
from app.day_file import NAME as DAY_NAME
from app.decoded import DecodedCache, name_entry
from app.report.content import Report, ReportSubject, Software, build_report
from app.report.elevation_file import write_elevation
from app.report.exports import export_results, tell_in_brief
from app.report.html import render_html
from app.report.pdf import render_pdf
from app.report.results import encode_results
from app.request import OnStage, ReportKind, ReportRequest, Stage
from app.version import software_revision, software_version
from fusion.pipeline import Analysis, AnalysisSettings, analyse, analyse_angles
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


def ignore_stage(_stage: Stage, _fraction: float) -> None:
    """Take the place of a listener where nobody listens."""


def make_report(
    log: Path,
    request: ReportRequest,
    out: Path,
    on_stage: OnStage = ignore_stage,
    *,
    cache: DecodedCache | None = None,
) -> None:
    """Analyse the file and write every product into the existing folder ``out``.

    Writes ``results.json``, ``elevation.parquet``, the tables of :func:`export_results` and, for each
    language, ``report.<language>.<kind>`` and the answer in five lines, ``answer.<language>.txt``. With a
    ``cache``, as the server has one, the decoded samples are kept there, and the day is written for the page.

    Raises
    ------
    fusion.errors.FusionError
        When no number can be given; then nothing has been written.
    """
    analysis = _analyse_file(log, request, lambda stage: on_stage(stage, _BEGINS[stage]), cache)
    on_stage("rendering", _BEGINS["rendering"])
    subject = describe_subject(request)
    results = encode_results(analysis, subject)
    (out / "results.json").write_bytes(results)
    for name, table in export_results(json.loads(results)).items():
        (out / name).write_bytes(table)
    write_elevation(analysis.elevation, out / "elevation.parquet")
    if cache is not None:
        write_day_of(analysis, out / DAY_NAME)
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


def _analyse_file(
    log: Path, request: ReportRequest, begin: Callable[[Stage], None], cache: DecodedCache | None
) -> Analysis:
    begin("reading")
    if request.source == "angles":
        with log.open("rb") as file:
            return analyse_angles(file, begin, request.list_diary())
    settings = AnalysisSettings(
        request.method, request.pose, request.calibration_windows_s, request.list_diary()
    )
    return analyse(_read_logs(log, request, cache), settings, begin)


def _read_logs(log: Path, request: ReportRequest, cache: DecodedCache | None) -> Recording:
    logs = ((log, request.file_name), *((path, path.name) for path in map(Path, request.joined)))
    if cache is None:
        recordings = [_read_log(path, name, request) for path, name in logs]
    else:
        recordings = [_read_once(path, name, request, cache) for path, name in logs]
    return join_recordings(recordings) if request.joined else recordings[0]


def _read_log(log: Path, name: str, request: ReportRequest, sha256: str = "") -> Recording:
    profile = parse_profile(request.profile) if request.profile else None
    with log.open("rb") as file:
        return read_recording(file, file_name=name, rate_hz=request.rate_hz, sha256=sha256, profile=profile)


def _read_once(log: Path, name: str, request: ReportRequest, cache: DecodedCache) -> Recording:
    """Read the file, or what an earlier reading of the same bytes has kept."""
    with log.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    reading = json.dumps([Path(name).suffix, request.rate_hz, request.profile])
    key = name_entry(sha256, reading, software_revision())
    recording = cache.find(key)
    if recording is None:
        recording = _read_log(log, name, request, sha256)
        cache.keep(key, recording)
    return recording


def _render(
    report: Report, kinds: tuple[ReportKind, ...], results: bytes
) -> Iterator[tuple[ReportKind, bytes]]:
    if "html" in kinds:
        yield "html", render_html(report)
    if "pdf" in kinds:
        yield "pdf", render_pdf(report, {"results.json": results})
