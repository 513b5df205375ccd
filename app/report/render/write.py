"""Write findings as report files: HTML, PDF and the answer in five lines, in each requested language.

It does not need ``fusion``: a finished analysis can be rendered again, in another language, from its folder.
"""

from collections.abc import Collection
from pathlib import Path

from acromion.app.report.export.results import decode_results
from acromion.app.report.findings import Findings, FinishedAnalysis, ReleaseStamp, ReportSubject
from acromion.app.report.model import Report, format_brief
from acromion.app.report.render.html import render_html
from acromion.app.report.render.pdf import render_pdf
from acromion.app.report.single.report import build_report
from acromion.app.request import Paper, ReportKind, ReportRequest

RESULTS = "results.json"


def write_reports(
    findings: Findings,
    subject: ReportSubject,
    request: ReportRequest,
    out: Path,
    release: ReleaseStamp | None = None,
    left_out: Collection[str] = (),
) -> None:
    """Write ``report.<language>.<kind>`` and ``answer.<language>.txt`` beside the results in ``out``.

    ``release`` is stamped on page 1; it changes neither results nor answer. The reports in ``left_out`` are
    not written.
    """
    results = (out / RESULTS).read_bytes()
    for language in request.languages:
        report = build_report(findings, subject, language, release)
        attached = {RESULTS: results}
        kinds = tuple(kind for kind in request.kinds if f"report.{language}.{kind}" not in left_out)
        write_report(report, kinds, request.paper, attached, out, has_appendix=request.appendix)


def write_report(
    report: Report,
    kinds: tuple[ReportKind, ...],
    paper: Paper,
    attachments: dict[str, bytes],
    out: Path,
    *,
    has_appendix: bool = False,
) -> None:
    """Write one report in its language, and its answer in a few lines."""
    (out / f"answer.{report.language}.txt").write_bytes(format_brief(report))
    if "html" in kinds:
        (out / f"report.{report.language}.html").write_bytes(render_html(report))
    if "pdf" in kinds:
        document = render_pdf(report, attachments, paper, has_appendix=has_appendix)
        (out / f"report.{report.language}.pdf").write_bytes(document)


def read_finished(finished: Path) -> FinishedAnalysis:
    """Read the findings of the analysis in a folder.

    Raises OSError or ValueError if the folder has no results, or results of another version.
    """
    return decode_results((finished / RESULTS).read_bytes())
