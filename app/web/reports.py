"""A report as a page: above it the way back, the PDF and the other language; copies of the file hold none."""

from base64 import b64encode
from collections.abc import Mapping
from hashlib import sha256
from html import escape
from urllib.parse import urlencode

from fastapi import APIRouter, Response
from fastapi.responses import HTMLResponse

from app.api.middleware.guard import REPORT_POLICY
from app.report.words.wording import find_nearest
from app.web.rendering import Page, UsedPage
from app.web.views import describe_old

STYLE = (
    ".way{display:flex;flex-wrap:wrap;gap:.4rem 1.4rem;max-width:60rem;margin:0 auto;padding:.6rem 1rem}"
    ".way a{display:inline-block;min-height:24px}"
    ".old{max-width:60rem;margin:0 auto;padding:.7rem 1rem;background:#fdf0d5;color:#6b4500}"
    "@media print{.way,.old a{display:none}}"
)
STYLE_HASH = b64encode(sha256(STYLE.encode()).digest()).decode()
"""A report's own policy lets in styles by their hash alone."""
POLICY = f"{REPORT_POLICY} allow-downloads"
"""Its PDF may be downloaded, all else is as strict as for the file."""


def lay_way_of_query(page: Page, report: str, place: str) -> HTMLResponse:
    """Lay the way back above a report whose page and PDF are asked for by the same query."""
    query = f"?{page.request.url.query}" if page.request.url.query else ""
    return lay_way(page, report, f"{page.base}{place}{query}", f"{page.base}{place}/report.pdf{query}")


def lay_way(
    page: Page, report: str, back: str, pdf: str, old: Mapping[str, str] | None = None
) -> HTMLResponse:
    """Lay the way back above a report, and the banner of an old version; its file is left as it is.

    ``back`` and ``pdf``: where its page and its PDF in this language are. Printing leaves the links out.
    """
    words, labels = page.words(), page.words()["report_way"]
    links = (
        (back, labels["back"], ""),
        (pdf, labels["pdf"], " download"),
        (page.turn_language(), words["other_language"], f' lang="{words["other_language_code"]}"'),
    )
    told = "".join(f'<a href="{escape(place)}"{more}>{escape(name)}</a>' for place, name, more in links)
    bar = f'<nav class="way" aria-label="{escape(labels["label"])}">{told}</nav>'
    if old is not None:
        link = f'<a href="{escape(old["address"])}">{escape(old["link"])}</a>'
        bar += f'<p class="old">{escape(old["told"])} {link}</p>'
    head, end, body = report.partition("</head>")
    head = head.replace("style-src ", f"style-src 'sha256-{STYLE_HASH}' ", 1) + f"<style>{STYLE}</style>"
    whole = head + end + body.replace('<div class="sheet">', f'{bar}<div class="sheet">', 1)
    return HTMLResponse(whole, headers={"Content-Security-Policy": POLICY, "Cache-Control": "no-store"})


router = APIRouter(include_in_schema=False)


@router.get("/analyses/{analysis_id}/report.html")
def show_report(analysis_id: str, page: UsedPage) -> Response:
    """Show the report of a recording, or of a comparison with a reference."""
    services = page.services
    job = services.store.get(analysis_id)
    stem, place = ("report", "analyses") if job.request.reference is None else ("validation", "validations")
    made = find_nearest(page.language, job.request.languages)
    report = services.results.read(job, f"{stem}.{made}.html").decode()
    pdf = f"{page.base}/api/v1/{place}/{job.id}/{stem}.pdf?{urlencode({'lang': made})}"
    reports = services.store.find_reports(job.recording_id) if stem == "report" else ()
    old = describe_old(job, reports, page)
    return lay_way(page, report, f"{page.base}/{place}/{job.id}", pdf, old)
