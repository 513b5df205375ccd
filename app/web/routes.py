"""The pages. They show what the job rows say; the browser's own script only sends files and asks again."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from pydantic import BaseModel

from app.api.problems import Refusal
from app.api.services import UsedLanguage, UsedServices, choose_language, find_services
from app.errors import ResultDamaged
from app.jobs.job import JobState
from app.jobs.library import Entry
from app.jobs.renewing import retry as retry_job
from app.outcomes import find_outcome_of_code
from app.report.messages import describe_problem
from app.report.wording import load_wording
from app.web.answers import find_clock, read_answer, show_changes
from app.web.damage import describe_source, show_damage
from app.web.library_views import find_neighbours, read_filter, show_entry, show_library
from app.web.rendering import find_base, show_page
from app.web.versions import History, list_versions, show_failed
from app.web.views import format_size, now_utc, show_row, show_settings

ASK_COLUMNS = frozenset(
    {"E-MIXED", "E-SWAPPED", "E-COLS", "E-RATE", "E-SCALE", "E-TIME", "E-TYPE", "E-PROFILE"}
)
"""Refusals that a person may cure by saying what the columns are."""


class Seen(BaseModel):
    """Where a person came from: the analysis that was corrected, or the attempt whose settings are shown."""

    before: str = ""
    attempt: str = ""


router = APIRouter(default_response_class=HTMLResponse, include_in_schema=False)


@router.get("/")
def home(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show the place to drop files, and the recordings."""
    limit_bytes = services.settings.max_upload_bytes
    values = show_library(services, request, read_filter(request), language)
    values |= {"max_bytes": limit_bytes, "max_size": format_size(limit_bytes, language)}
    values |= {
        "devices": dict(load_wording(language)["device"]),
        "has_batches": bool(services.batches.list_newest(1)),
        "address": str(request.base_url).rstrip("/"),
        "quarantined": str(len(services.quarantine.names) or ""),
    }
    return show_page(request, "home.html", language, values)


@router.get("/rows")
def rows(request: Request, services: UsedServices, language: UsedLanguage, only: str = "") -> Response:
    """Give the list alone, for a page that is open already; ``only`` one analysis if named."""
    if only:
        entries = [show_entry(Entry(services.store.get(only), None), language)]
        values = {"entries": entries, "is_empty": False, "count": "", "query": ""}
    else:
        values = show_library(services, request, read_filter(request), language)
    return show_page(request, "rows.html", language, values)


@router.get("/analyses/{analysis_id}")
def analysis(
    analysis_id: str,
    request: Request,
    services: UsedServices,
    language: UsedLanguage,
    seen: Annotated[Seen, Query()],
) -> Response:
    """Show one analysis: its state or its answer, its files, its day, its versions."""
    job = services.store.get(analysis_id)
    if job.request.reference is not None:
        return RedirectResponse(f"{find_base(request)}/validations/{job.id}", status_code=303)
    if job.state is JobState.SUCCEEDED and job.replaced_by is not None:  # it was damaged, and analysed again
        return RedirectResponse(f"{find_base(request)}/analyses/{job.replaced_by}", status_code=303)
    history = History.of(services, job)
    attempt = next((other for other in history.jobs if other.id == seen.attempt != job.id), None)
    wish = attempt.request if attempt else job.request
    report = history.find_report()
    values = {
        "row": show_row(job, language, now_utc()),
        "settings": show_settings(job, find_clock(services, history), language),
        "job_request": wish,
        "reason": wish.reason if attempt else "",
        "is_attempt": attempt is not None,
        "entry": show_entry(Entry(job, None), language),
        "d": load_wording(language, "day"),
        "b": load_wording(language, "beside_page"),
        "c": load_wording(language, "columns"),
        "asks_columns": job.problem_code in ASK_COLUMNS,
        "changes": show_changes(services, history, job, seen.before, language),
        "recording_id": job.recording_id,
        "source": describe_source(services, job, language),
        "versions": list_versions(history, job, language),
        "failed": show_failed(history, job, language),
        "report": report if report is not None and report.id != job.id else None,
        **find_neighbours(services, request, job),
        **read_answer(services, job, wish, language),
    }
    return show_page(request, "analysis.html", language, values)


@router.post("/analyses/{analysis_id}/cancel")
def cancel(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Stop an analysis (a plain form, so that it needs no script)."""
    services.store.cancel(analysis_id)
    return RedirectResponse(f"{find_base(request)}/", status_code=303)


@router.post("/analyses/{analysis_id}/retry")
def retry(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Ask for the same analysis once more; the recording is kept, whatever became of the last one."""
    again = retry_job(services.store, services.storage, analysis_id, "web")
    if again.state is JobState.SUCCEEDED:  # a report is there, but not all that this version makes
        again = services.store.add_analysis((again.recording_id, again.sha256), again.request, "web")
    return RedirectResponse(f"{find_base(request)}/analyses/{again.id}", status_code=303)


@router.post("/analyses/{analysis_id}/withdraw")
def withdraw(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Leave the report as it is: the attempt after it that failed counts no more."""
    report = services.store.withdraw(analysis_id)
    return RedirectResponse(f"{find_base(request)}/analyses/{report.id}", status_code=303)


def answer_with_page(request: Request, error: Refusal) -> HTMLResponse:
    """Show a refusal as a page of its own; that of a damaged report offers to analyse again."""
    language = choose_language(request)
    values: dict[str, Any] = {"problem": describe_problem(error.code, error.facts, language)}
    values |= {"code": error.code, "damage": None}
    if error.code == ResultDamaged.code:
        values["damage"] = show_damage(find_services(request), error.facts, language)
    return show_page(request, "error.html", language, values, find_outcome_of_code(error.code).status)
