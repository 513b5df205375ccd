"""The pages. They show what the job rows say; the browser's own script only sends files and asks again."""

from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from app.api.services import LANGUAGE_COOKIE, Services, UsedLanguage, UsedServices, choose_language
from app.errors import AppError, find_outcome
from app.jobs.job import Job, JobState
from app.report.messages import describe_problem
from app.report.wording import Language, fill, load_wording
from app.web.views import (
    Answer,
    count_done,
    format_size,
    now_utc,
    read_results,
    show_answer,
    show_row,
    show_settings,
)
from fusion.errors import FusionError

SHOWN = 200
YEAR_S = 365 * 24 * 3600

_PACKAGED = Path(__file__).resolve().parents[1] / "templates" / "web"
_CHECKOUT = Path(__file__).resolve().parents[2] / "templates" / "web"

router = APIRouter(default_response_class=HTMLResponse, include_in_schema=False)
pages = Environment(
    loader=FileSystemLoader(_PACKAGED if _PACKAGED.is_dir() else _CHECKOUT),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
pages.globals["fill"] = fill


@router.get("/")
def home(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show the place to drop files, and the recordings."""
    limit_bytes = services.settings.max_upload_bytes
    values = _list_rows(services, language)
    values |= {"max_bytes": limit_bytes, "max_size": format_size(limit_bytes, language)}
    return show_page(request, "home.html", language, values)


@router.get("/rows")
def rows(request: Request, services: UsedServices, language: UsedLanguage, only: str = "") -> Response:
    """Give the list alone, for a page that is open already; ``only`` one analysis if named."""
    values = _list_rows(services, language, only)
    return show_page(request, "rows.html", language, values)


@router.get("/analyses/{analysis_id}")
def analysis(analysis_id: str, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show one analysis: its state or its answer, and its files."""
    job = services.store.get(analysis_id)
    if job.request.reference is not None:
        return RedirectResponse(f"/validations/{job.id}", status_code=303)
    values = {
        "row": show_row(job, language, now_utc()),
        "answer": _read_answer(services, job, language),
        "settings": show_settings(job, language),
    }
    return show_page(request, "analysis.html", language, values)


@router.post("/analyses/{analysis_id}/cancel")
def cancel(analysis_id: str, services: UsedServices) -> Response:
    """Stop an analysis (a plain form, so that it needs no script)."""
    services.store.cancel(analysis_id)
    return RedirectResponse("/", status_code=303)


def show_page(
    request: Request, template: str, language: Language, values: dict[str, Any], status: int = 200
) -> HTMLResponse:
    """Render a template with the words of the language, and remember a choice of language."""
    words = load_wording(language, "page")
    body = pages.get_template(template).render(values, words=words, language=language, path=request.url.path)
    response = HTMLResponse(body, status, headers={"Content-Language": language})
    if request.query_params.get("lang") == language:
        response.set_cookie(LANGUAGE_COOKIE, language, max_age=YEAR_S, httponly=True, samesite="lax")
    return response


def answer_with_page(request: Request, error: FusionError | AppError) -> HTMLResponse:
    """Show a refusal as a page of its own."""
    language = choose_language(request)
    words = describe_problem(error.code, error.facts, language)
    status = find_outcome(type(error)).status
    return show_page(request, "error.html", language, {"problem": words, "code": error.code}, status)


def _list_rows(services: Services, language: Language, only: str = "") -> dict[str, Any]:
    jobs = (services.store.get(only),) if only else services.store.list_newest(SHOWN)
    now = now_utc()
    shown = tuple(show_row(job, language, now) for job in jobs)
    return {"rows": shown, "count": count_done(shown, language)}


def _read_answer(services: Services, job: Job, language: Language) -> Answer | None:
    if job.state is not JobState.SUCCEEDED or job.token is None:
        return None
    body = (services.storage.attempt(job.id, job.token) / "results.json").read_bytes()
    return show_answer(read_results(body), language)
