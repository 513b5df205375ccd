"""The one road from a stored file to a report, taken by page, API and command line alike."""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Literal

from app.report.content import Report, ReportSubject, Software, build_report
from app.report.elevation_file import write_elevation
from app.report.html import render_html
from app.report.pdf import render_pdf
from app.report.results import encode_results
from app.report.summary import encode_summary, summarise_results
from app.version import software_revision, software_version
from fusion.calibration import Pose
from fusion.orientation import MethodName
from fusion.pipeline import Analysis, AnalysisSettings, Side, analyse, analyse_angles
from fusion.readers import read_recording

Stage = Literal["reading", "checking", "calibrating", "fusing", "counting", "rendering"]
Language = Literal["en", "fr"]
ReportKind = Literal["html", "pdf"]
OnStage = Callable[[Stage, float], None]

# How far along each stage begins, from the share of time each takes on a long shift.
_BEGINS: dict[Stage, float] = {
    "reading": 0.0,
    "checking": 0.45,
    "calibrating": 0.5,
    "fusing": 0.55,
    "counting": 0.7,
    "rendering": 0.9,
}


@dataclass(frozen=True, slots=True)
class ReportRequest:
    """Everything the person asked. ``source`` says whether the file holds samples or ready angles."""

    file_name: str
    subject: str = ""
    side: Side | None = None
    method: MethodName = "smoothed"
    pose: Pose = "n-pose"
    calibration_windows_s: tuple[tuple[float, float], ...] = ()
    rate_hz: float | None = None
    languages: tuple[Language, ...] = ("en", "fr")
    kinds: tuple[ReportKind, ...] = ("html", "pdf")
    source: Literal["samples", "angles"] = "samples"

    def to_json(self) -> str:
        """Give the request as text for a job row or a settings hash."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> "ReportRequest":
        """Read what :meth:`to_json` wrote; names it does not know are left aside."""
        known = {field.name for field in fields(cls)}
        values = {name: value for name, value in json.loads(text).items() if name in known}
        windows = tuple((float(a), float(b)) for a, b in values.pop("calibration_windows_s", ()))
        for name in ("languages", "kinds"):
            if name in values:
                values[name] = tuple(values[name])
        return cls(calibration_windows_s=windows, **values)


def ignore_stage(_stage: Stage, _fraction: float) -> None:
    """Take the place of a listener where nobody listens."""


def make_report(
    log: Path, request: ReportRequest, out: Path, on_stage: OnStage = ignore_stage
) -> tuple[str, ...]:
    """Analyse the file and write every product into the existing folder ``out``.

    Writes ``results.json``, ``elevation.parquet``, ``summary.csv`` and, for each language and kind asked
    for, ``report.<language>.<kind>``. Gives the plain sentences of the answer in the first language.

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
    (out / "summary.csv").write_bytes(encode_summary([summarise_results(json.loads(results))]))
    write_elevation(analysis.elevation, out / "elevation.parquet")
    reports = [build_report(analysis, subject, language) for language in request.languages]
    for report in reports:
        for kind, body in _render(report, request.kinds, results):
            (out / f"report.{report.language}.{kind}").write_bytes(body)
    return reports[0].sentences


def describe_subject(request: ReportRequest) -> ReportSubject:
    """Say whose arm it is and which software answers."""
    software = Software(software_version(), software_revision())
    return ReportSubject(
        file_name=request.file_name, subject=request.subject, side=request.side, software=software
    )


def _analyse_file(log: Path, request: ReportRequest, begin: Callable[[Stage], None]) -> Analysis:
    begin("reading")
    with log.open("rb") as file:
        if request.source == "angles":
            return analyse_angles(file, begin)
        recording = read_recording(file, file_name=request.file_name, rate_hz=request.rate_hz)
    settings = AnalysisSettings(request.method, request.pose, request.calibration_windows_s)
    return analyse(recording, settings, begin)


def _render(
    report: Report, kinds: tuple[ReportKind, ...], results: bytes
) -> Iterator[tuple[ReportKind, bytes]]:
    if "html" in kinds:
        yield "html", render_html(report)
    if "pdf" in kinds:
        yield "pdf", render_pdf(report, {"results.json": results})
