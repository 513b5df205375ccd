"""A ready example: the report of a whole simulated shift, shown at once, without an analysis.

``python -m benchmarks.example`` makes its results; they are shipped; a test holds them against the engine.
"""

from functools import cache
from pathlib import Path

from fastapi import APIRouter, Request, Response

from app.report.analysis.report import build_report
from app.report.export.results import decode_results
from app.report.figures import load_results
from app.report.model import Report
from app.report.render.brief import format_brief
from app.report.render.html import find_template_folder, render_html
from app.report.words.wording import Language, load_wording
from app.services import UsedLanguage, UsedServices
from app.web.recording.page_one import PageOne
from app.web.rendering import find_base, render_page
from app.web.reports import find_way, lay_way
from app.web.views import build_answer

router = APIRouter(prefix="/example", include_in_schema=False)


def find_example() -> Path:
    """Find the results of the example."""
    return find_template_folder().parent / "example" / "results.json"


@cache
def _build_report(language: Language) -> Report:
    kept = decode_results(find_example().read_bytes())
    return build_report(kept.findings, kept.subject, language)


@router.get("")
def show_example(request: Request, language: UsedLanguage) -> Response:
    """Show page 1 of the example as a recording's page shows it."""
    report, results = _build_report(language), load_results(find_example().read_bytes())
    values = {
        "e": load_wording(language, "help")["example"],
        "h": load_wording(language, "help"),
        "page_one": PageOne(report, (), ()),
        "answer": build_answer(results, format_brief(report).decode(), language),
    }
    return render_page(request, "example.html", language, values)


@router.get("/report.html")
def show_report(request: Request, language: UsedLanguage) -> Response:
    """Give the report."""
    way = find_way(f"{find_base(request)}/example", request)
    return lay_way(render_html(_build_report(language)).decode(), way, request, language)


@router.get("/report.pdf")
def give_pdf(language: UsedLanguage, services: UsedServices) -> Response:
    """Give the report as a PDF, on the paper of this installation."""
    from app.report.render.pdf import render_pdf  # noqa: PLC0415  heavy, and only this needs it

    attached = {"results.json": find_example().read_bytes()}
    body = render_pdf(_build_report(language), attached, services.settings.paper)
    headers = {"Content-Disposition": 'attachment; filename="acromion-example.pdf"'}
    return Response(body, media_type="application/pdf", headers=headers)
