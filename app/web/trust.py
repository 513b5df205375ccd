"""Pages of trust: the audit log, terms, group figures; forms that release a report or hold a recording."""

from dataclasses import dataclass
from typing import Annotated, Any
from urllib.parse import urlencode

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from starlette.status import HTTP_303_SEE_OTHER

from app.access.subjects import Subject
from app.api.middleware.access import UsedSubject
from app.api.trust import MOST_LINES, AuditQuery, build_question, find_names
from app.errors import BadParameter
from app.jobs.audit_log import ACTS, find_lines
from app.jobs.governance.retention import KINDS
from app.jobs.recordings import HOLD_REASONS, HoldReason
from app.report.words.wording import load_wording
from app.services import UsedLanguage, UsedServices
from app.web.forms import first, read_form
from app.web.rendering import find_base, render_page
from app.web.views import format_moment

STUDIES = 200
ASKED = ("subject", "recording", "who", "act", "from", "to")

router = APIRouter(default_response_class=HTMLResponse, include_in_schema=False)


@router.get("/trail")
def show_audit_log(
    request: Request, services: UsedServices, language: UsedLanguage, asked: Annotated[AuditQuery, Query()]
) -> Response:
    """Show who did what: the lines that a question lets through."""
    question = build_question(services, asked)
    lines = list(find_lines(services.store.reader, question, before=asked.before, most=MOST_LINES))
    asked_for = {name: request.query_params.get(name, "") for name in ASKED}
    values = {
        "t": load_wording(language, "trail"),
        "lines": lines,
        "names": find_names(request, (line.who for line in lines), language),
        "asked": asked_for,
        "acts": sorted(ACTS),
        "query": urlencode({name: value for name, value in asked_for.items() if value}),
        "following": lines[-1].seq if len(lines) == MOST_LINES else None,
    }
    return render_page(request, "audit_log.html", language, values)


@router.get("/retention")
def show_terms(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show how long each kind is kept, with a form to change it."""
    values = {"t": load_wording(language, "trail"), "terms": services.retention.find_all()}
    return render_page(request, "retention.html", language, values)


@router.post("/retention")
async def change_terms(request: Request, services: UsedServices) -> Response:
    """Change the terms that the form names; an empty one keeps its kind for good."""
    form = await read_form(request)
    known = services.retention.find_all()
    for kind in KINDS:
        if kind in form:
            days = _read_days(first(form, kind))
            if days != known[kind]:
                services.retention.put(kind, days)
    return RedirectResponse(f"{find_base(request)}/retention", HTTP_303_SEE_OTHER)


def _read_days(text: str) -> int | None:
    if not text:
        return None
    if not text.isdecimal() or len(text) > 6:
        raise BadParameter(name="days", value=text[:20], allowed="1, 2, 3 …")
    return int(text)


@router.post("/recordings/{recording_id}/hold")
async def hold(recording_id: str, request: Request, services: UsedServices, subject: UsedSubject) -> Response:
    """Put a recording on hold, or end its hold."""
    reason = first(await read_form(request), "reason")
    if not reason:
        services.recordings.let_go(recording_id)
    else:
        services.recordings.hold(recording_id, _read_reason(reason), subject.id)
    return RedirectResponse(f"{find_base(request)}/recordings/{recording_id}/purge", HTTP_303_SEE_OTHER)


def _read_reason(text: str) -> HoldReason:
    reason = next((one for one in HOLD_REASONS if one == text), None)
    if reason is None:
        raise BadParameter(name="reason", value=text[:20], allowed=", ".join(HOLD_REASONS))
    return reason


@router.post("/analyses/{analysis_id}/release")
async def release(
    analysis_id: str, request: Request, services: UsedServices, subject: UsedSubject
) -> Response:
    """Release a report under one's name, or take that back."""
    form = await read_form(request)
    job = services.store.get(analysis_id)
    if first(form, "back"):
        services.releases.take_back(job, subject.id)
    else:
        services.releases.release(job, subject.id)
    return RedirectResponse(f"{find_base(request)}/analyses/{analysis_id}", HTTP_303_SEE_OTHER)


@router.get("/aggregate")
def show_groups(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show the published group figures of every study: of five people or more, never of one."""
    groups = services.aggregates.find_studies(STUDIES)
    rows: list[Any] = [
        (group, [(block, format_moment(block.published_at)) for block in group.blocks]) for group in groups
    ]
    return render_page(
        request, "aggregate.html", language, {"t": load_wording(language, "trail"), "groups": rows}
    )


@dataclass(frozen=True, slots=True)
class ReleaseCard:
    """Who released the report that is shown, and when; what the form offers. "" where nobody has."""

    name: str
    when: str
    may: bool


def build_release(
    request: Request, services: UsedServices, subject: Subject, analysis_id: str, language: UsedLanguage
) -> ReleaseCard:
    """Give the release of a finished analysis."""
    found = services.releases.find(analysis_id)
    may = subject.may("release")
    if found is None:
        return ReleaseCard("", "", may)
    return ReleaseCard(find_names(request, [found.who], language)[found.who], format_moment(found.at), may)
