"""The files of a finished analysis that depend on its label: results, tables, reports, FHIR.

This module does not load the analysis itself: a report with another label is set again from its results.
"""

from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from acromion.app.report.export.all import export_results
from acromion.app.report.export.fhir import encode_fhir
from acromion.app.report.export.results import decode_results, identify_report, relabel_results
from acromion.app.report.figures import load_results
from acromion.app.report.findings import Findings, ReleaseStamp, ReportSubject, Software
from acromion.app.report.render.write import RESULTS, write_reports
from acromion.app.request import ReportRequest
from acromion.app.store.day_file import DAY_NAME
from acromion.app.version import software_version, source_revision
from acromion.fusion.settings import AnalysisSettings

FHIR, ELEVATION = "fhir.json", "elevation.parquet"
MEASURED = (ELEVATION, DAY_NAME)
"""Files of a finished analysis that depend on its figures only."""


def set_report_again(
    results: Path,
    request: ReportRequest,
    out: Path,
    release: ReleaseStamp | None = None,
    left_out: Collection[str] = (),
) -> None:
    """Write a report with another label from the ``results.json`` of a finished analysis.

    ``release`` is stamped on page 1. Files named in ``left_out`` are not written.

    The request has the figures of that analysis (:meth:`ReportRequest.describe_figures`). The files have the
    bytes that a full analysis would write. The files in :data:`MEASURED` do not change and are not written.
    Raises OSError or ValueError if ``results`` is another file, or has another version.
    """
    content = results.read_bytes()
    kept = decode_results(content)
    subject = describe_subject(request, kept.findings, kept.subject.software)
    content = relabel_results(content, subject)
    write_products(content, kept.findings, subject, request, out, release, left_out)


def write_products(
    content: bytes,
    findings: Findings,
    subject: ReportSubject,
    request: ReportRequest,
    out: Path,
    release: ReleaseStamp | None = None,
    left_out: Collection[str] = (),
) -> None:
    """Write ``results.json``, which is ``content``, and every file derived from it but those ``left_out``."""
    (out / RESULTS).write_bytes(content)
    results = load_results(content)

    def write_tables() -> None:
        for name, table in export_results(results).items():
            (out / name).write_bytes(table)

    with ThreadPoolExecutor(1) as writer:  # rendering releases the interpreter lock
        written = writer.submit(write_tables)
        write_reports(findings, subject, request, out, release, left_out)
        written.result()
    if "pdf" in request.kinds and FHIR not in left_out:  # with the PDFs and the first conclusion
        pdfs = {language: (out / f"report.{language}.pdf").read_bytes() for language in request.languages}
        conclusion = (out / f"answer.{request.languages[0]}.txt").read_text("utf-8")
        (out / FHIR).write_bytes(encode_fhir(results, pdfs, conclusion, request.version))


def describe_subject(
    request: ReportRequest, findings: Findings, software: Software | None = None
) -> ReportSubject:
    """Build the subject of a report: the person's arm, and the software of the analysis, by default ours."""
    subject = ReportSubject(
        file_name=request.file_name,
        subject=request.subject,
        side=request.side,
        software=software or Software(software_version(), source_revision()),
        version=request.version,
        changes=request.changes,
        reason=request.reason,
        columns=request.profile,
        conclusion=request.conclusion,
        shift=request.shift,
        job_title=request.job_title,
        isco_code=request.isco_code,
    )
    return replace(subject, report_id=identify_report(build_settings(request), findings, subject))


def build_settings(request: ReportRequest) -> AnalysisSettings:
    """Return the settings that a person gave; the file may state others."""
    return AnalysisSettings(
        request.method,
        request.pose,
        request.calibration_windows_s,
        request.select_diary(),
        request.arm_axis,
        request.slip_times_s,
        request.no_slip_times_s,
        request.pose_held,
        time_zone=request.time_zone,
        clock_offset_s=request.clock_offset_s,
    )
