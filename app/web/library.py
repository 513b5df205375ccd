"""The library's tables to take away, and the trash: thrown away, taken back, gone for good."""

from collections.abc import Iterator
from typing import Any, Literal

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from app.api.recordings import purge_recording
from app.errors import ResultDamaged
from app.jobs.job import Job, JobState
from app.jobs.library import Library
from app.jobs.recordings import RecordingFilter, StoredRow
from app.jobs.store import JobFilter
from app.report.export.columns import encode_summary, summarise_failure, summarise_results
from app.report.export.csv import FRENCH_EXCEL, INTERNATIONAL, Origin, Row, encode_table
from app.report.words.messages import describe_problem
from app.report.words.wording import Language, fill, load_wording
from app.services import Services, UsedLanguage, UsedServices
from app.web.analysis import find_results
from app.web.library_views import read_filter
from app.web.rendering import find_base, show_page
from app.web.views import format_size, tell_moment

MOST_ROWS = 10_000
SHOWN = 500
DAY_S = 86400
PROBLEM_COLUMNS = ("file", "subject", "code", "title", "detail", "fix")

router = APIRouter(include_in_schema=False)


TableName = Literal["summary", "summary_fr", "problems"]


@router.get("/library/{name}.csv")
def take_table(name: TableName, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Give the main figures, or the problems, of every recording that the list shows."""
    entries = Library(services.store.reader).find_page(read_filter(request), MOST_ROWS)
    dialect = FRENCH_EXCEL if name == "summary_fr" else INTERNATIONAL
    if name == "problems":
        newest = (entry.attempt or entry.job for entry in entries)
        rows = [_tell_problem(job, language) for job in newest if job.state is JobState.FAILED]
        body = encode_table(PROBLEM_COLUMNS, rows, dialect)
    else:
        body = encode_summary(list(_summarise(services, [entry.job for entry in entries])), dialect)
    headers = {"Content-Disposition": f'attachment; filename="{name}.csv"'}
    return Response(body, media_type="text/csv; charset=utf-8", headers=headers)


@router.get("/recordings/{recording_id}/delete")
def ask_to_delete(
    recording_id: str, request: Request, services: UsedServices, language: UsedLanguage
) -> Response:
    """Say what goes before anything goes."""
    row = services.recordings.get(recording_id, trashed=True)
    values = _describe(services, row, language) | {"for_good": row.state == "trashed"}
    return show_page(request, "delete.html", language, values)


@router.get("/recordings/{recording_id}/purge")
def ask_to_purge(
    recording_id: str, request: Request, services: UsedServices, language: UsedLanguage
) -> Response:
    """Ask once more before a recording is deleted for good."""
    row = services.recordings.get(recording_id, trashed=True)
    values = _describe(services, row, language) | {"for_good": True}
    return show_page(request, "delete.html", language, values)


@router.post("/recordings/{recording_id}/delete")
def throw_away(recording_id: str, request: Request, services: UsedServices) -> Response:
    """Put a recording and all that was made of it into the trash; one that is there stays as it is."""
    services.recordings.trash(recording_id)
    return RedirectResponse(f"{find_base(request)}/trash", status_code=303)


@router.post("/recordings/{recording_id}/purge")
def delete_for_good(recording_id: str, request: Request, services: UsedServices) -> Response:
    """Delete a recording, its analyses and every file of them."""
    services.recordings.trash(recording_id)
    purge_recording(services, recording_id)
    return RedirectResponse(f"{find_base(request)}/trash", status_code=303)


@router.post("/recordings/{recording_id}/restore")
def take_back(recording_id: str, request: Request, services: UsedServices) -> Response:
    """Take a recording out of the trash."""
    services.recordings.restore(recording_id)
    return RedirectResponse(f"{find_base(request)}/", status_code=303)


@router.get("/trash")
def show_trash(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """List what is in the trash."""
    rows = services.recordings.find_page(RecordingFilter(trashed=True), SHOWN)
    values = {
        "rows": [(row, format_size(row.size_bytes, language)) for row in rows],
        "term": _tell_term(services, language),
        "t": load_wording(language, "page")["trash"],
    }
    return show_page(request, "trash.html", language, values)


def _describe(services: Services, row: StoredRow, language: Language) -> dict[str, Any]:
    made = services.store.find_page(JobFilter(recording_id=row.id), SHOWN)
    return {
        "recording": row,
        "size": format_size(row.size_bytes, language),
        "added": tell_moment(row.created_at),
        "analyses": len(made),
        "term": _tell_term(services, language),
        "t": load_wording(language, "page")["trash"],
    }


def _tell_term(services: Services, language: Language) -> str:
    days = services.settings.trash_term_s / DAY_S
    return fill(load_wording(language, "page")["trash"]["term"], {"days": f"{days:.0f}"})


def _tell_problem(job: Job, language: Language) -> Row:
    code = job.problem_code or ""
    words = describe_problem(code, job.problem_facts, language)
    return {
        "file": job.file_name,
        "subject": job.request.subject,
        "code": code,
        "title": words.title,
        "detail": words.detail,
        "fix": words.fix,
    }


def _summarise(services: Services, jobs: list[Job]) -> Iterator[Row]:
    for job in jobs:
        try:
            results = find_results(services, job)
        except ResultDamaged as damaged:
            origin = Origin(job.file_name, job.request.subject, job.request.side)
            yield summarise_failure(origin, damaged.code)
            continue
        if results is not None:
            yield summarise_results(results)
