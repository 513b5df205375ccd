"""The pages of a comparison: a form for two files, then what came of it. No script is needed."""

import json
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse

from app.api.results import read_result
from app.api.services import Services, UsedLanguage, UsedServices
from app.api.validations import find_validation, take_validation
from app.jobs.job import Job, JobState
from app.report.agreement_answer import list_sentences
from app.report.wording import Language, load_wording
from app.web.rendering import find_base, show_page
from app.web.views import format_size, now_utc, show_row

router = APIRouter(default_response_class=HTMLResponse, include_in_schema=False)


@router.get("/validations")
def ask(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show the form."""
    size = format_size(services.settings.max_upload_bytes, language)
    return show_page(request, "validate.html", language, {"max_size": size, "asked": _load(language)})


@router.post("/validations")
async def take(request: Request, services: UsedServices) -> Response:
    """Take the form and go to its comparison."""
    job = await take_validation(request, services)
    return RedirectResponse(f"{find_base(request)}/validations/{job.id}", status_code=303)


@router.get("/validations/{validation_id}")
def show(validation_id: str, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show one comparison: its state, or its answer and files."""
    job = find_validation(services, validation_id)
    if job.state is JobState.SUCCEEDED and job.replaced_by is not None:  # it was damaged, and made again
        return RedirectResponse(f"{find_base(request)}/validations/{job.replaced_by}", status_code=303)
    values = {
        "row": show_row(job, language, now_utc()),
        "reference": job.request.reference.file_name if job.request.reference else "",
        "sentences": _read_answer(services, job, language),
        "asked": _load(language),
    }
    return show_page(request, "validation.html", language, values)


def _load(language: Language) -> Any:
    return load_wording(language, "agreement")["page"]


def _read_answer(services: Services, job: Job, language: Language) -> tuple[str, ...]:
    if job.state is not JobState.SUCCEEDED:
        return ()
    body = read_result(services, job, "validation.json")
    return list_sentences(json.loads(body), language)
