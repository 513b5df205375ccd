"""The audit log, retention and group figures; forms that release a report or hold a recording."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated
from urllib.parse import urlencode

from fastapi import APIRouter, Query, Response
from fastapi.responses import HTMLResponse

from acromion.app.accounts.subjects import Subject
from acromion.app.errors import BadParameter
from acromion.app.http.api.trust import MAX_LINES, AuditQuery, build_question, get_names
from acromion.app.http.middleware.access import UsedSubject
from acromion.app.http.pages.rendering import Page, UsedForm, UsedPage, first
from acromion.app.http.pages.views import format_stored_time
from acromion.app.library.audit_log import ACTS, find_lines
from acromion.app.library.governance import DAY_S, GRACE_DAYS, KINDS, Kind
from acromion.app.library.recordings import HOLD_REASONS

STUDIES = 200
ASKED = ("subject", "recording", "who", "act", "from", "to")

router = APIRouter(default_response_class=HTMLResponse, include_in_schema=False)


@router.get("/trail")
def show_audit_log(page: UsedPage, query: Annotated[AuditQuery, Query()]) -> Response:
    """Show the audit log entries that match the filters."""
    question = build_question(page.services, query)
    lines = list(find_lines(page.services.store.reader, question, before=query.before, most=MAX_LINES))
    asked = {name: page.request.query_params.get(name, "") for name in ASKED}
    return page.render(
        "trust/audit_log.html",
        lines=lines,
        names=get_names(page.request, (line.who for line in lines), page.language),
        asked=asked,
        acts=sorted(ACTS),
        query=urlencode({name: value for name, value in asked.items() if value}),
        following=lines[-1].seq if len(lines) == MAX_LINES else None,
    )


@router.get("/retention")
def show_terms(page: UsedPage) -> Response:
    """Show how long each kind is kept, with a form to change it."""
    return _render_terms(page, page.services.retention.find_all(), {})


@router.post("/retention")
def change_terms(page: UsedPage, form: UsedForm) -> Response:
    """Change the terms that the form names; an empty one removes the term.

    If a term would delete anything, ask first, with the numbers.
    """
    known, wanted = page.services.retention.find_all(), {}
    for kind, typed in {kind: first(form, kind) for kind in KINDS if kind in form}.items():
        if typed and (not typed.isdecimal() or len(typed) > 6):
            raise BadParameter(name="days", value=typed[:20], allowed="1, 2, 3 …")
        days = int(typed) if typed else None
        if days != known[kind]:
            wanted[kind] = days
    due = {kind: page.services.retention.count_due(kind, days) for kind, days in wanted.items()}
    if any(due.values()) and not first(form, "confirmed"):
        terms = {kind: wanted.get(kind, days) for kind, days in known.items()}
        return _render_terms(page, terms, due)
    for kind, days in wanted.items():
        page.services.retention.put(kind, days)
    return page.go("/retention")


def _render_terms(page: Page, terms: Mapping[Kind, int | None], due: Mapping[Kind, int]) -> HTMLResponse:
    """Render the retention page; ``due``: how many of each kind a new term would delete."""
    trash_days = f"{page.services.settings.trash_term_s / DAY_S:g}"
    return page.render(
        "trust/retention.html", terms=terms, due=due, grace_days=GRACE_DAYS, server_trash_days=trash_days
    )


@router.post("/recordings/{recording_id}/hold")
def hold(recording_id: str, page: UsedPage, form: UsedForm, subject: UsedSubject) -> Response:
    """Put a recording on hold, or end its hold."""
    typed, recordings = first(form, "reason"), page.services.recordings
    reason = next((one for one in HOLD_REASONS if one == typed), None)
    if not typed:
        recordings.release_hold(recording_id)
    elif reason is None:
        raise BadParameter(name="reason", value=typed[:20], allowed=", ".join(HOLD_REASONS))
    else:
        recordings.hold(recording_id, reason, subject.id)
    return page.go(f"/recordings/{recording_id}/purge")


@router.post("/analyses/{analysis_id}/release")
def release(analysis_id: str, page: UsedPage, form: UsedForm, subject: UsedSubject) -> Response:
    """Release a report in your name, or withdraw the release."""
    job, releases = page.services.store.get(analysis_id), page.services.releases
    change = releases.withdraw if first(form, "back") else releases.release
    change(job, subject.id)
    return page.go(f"/analyses/{analysis_id}")


@router.get("/aggregate")
def show_groups(page: UsedPage) -> Response:
    """Show the published group figures of every study, always of at least five people."""
    groups = [
        (group, [(block, format_stored_time(block.published_at, page.language)) for block in group.blocks])
        for group in page.services.aggregates.find_studies(STUDIES)
    ]
    return page.render("trust/aggregate.html", groups=groups)


@dataclass(frozen=True, slots=True)
class ReleaseCard:
    """Who released the report and when ("" if nobody did), and whether the viewer may release it."""

    name: str
    when: str
    may: bool


def build_release(page: Page, subject: Subject, analysis_id: str) -> ReleaseCard:
    """Return the release of a finished analysis."""
    found, who, when = page.services.releases.find(analysis_id), "", ""
    if found is not None:
        who = get_names(page.request, [found.who], page.language)[found.who]
        when = format_stored_time(found.at, page.language)
    return ReleaseCard(who, when, subject.may("release"))
