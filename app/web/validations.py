"""Pages of a comparison with a reference: a form for two files, then the result; they need no script."""

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from starlette.datastructures import FormData

from app.api.middleware.guard import REPORT_POLICY
from app.api.validations import find_validation, open_form, queue_validation
from app.errors import AppError, NoSuchFile, find_outcome_of_code
from app.jobs.job import Job, JobState
from app.report.agreement.tables import list_sentences
from app.report.words.messages import describe_problem
from app.report.words.numbers import format_angle
from app.report.words.wording import Language, fill, find_nearest, load_wording
from app.services import Services, UsedLanguage, UsedServices
from app.storage.day_file import OWN_CURVE, REFERENCE_CURVE
from app.web.recording.curves import CurveView
from app.web.recording.day import Piece, cut_curve, find_day
from app.web.recording.day_views import DayClock
from app.web.rendering import find_base, render_page
from app.web.views import build_row, format_size, now_utc
from fusion.errors import FusionError

TYPED = ("side", "subject", "study", "offset_s", "drift_ppm")
"""Fields of the form that a browser can be given back; files it cannot."""

router = APIRouter(default_response_class=HTMLResponse, include_in_schema=False)


@router.get("/validations")
def ask(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show the form."""
    return render_page(request, "validate.html", language, _describe_form(services, language))


@router.post("/validations")
async def take(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Take the form and go to its comparison; a refused one is shown again with what was typed."""
    async with open_form(request, services) as form:
        try:
            job = await queue_validation(form, services)
        except (FusionError, AppError) as refusal:
            words = describe_problem(refusal.code, refusal.facts, language)
            values = _describe_form(services, language, form) | {"problem": words, "code": refusal.code}
            status = find_outcome_of_code(refusal.code).status
            return render_page(request, "validate.html", language, values, status)
    return RedirectResponse(f"{find_base(request)}/validations/{job.id}", status_code=303)


@router.get("/validations/{validation_id}")
def show(validation_id: str, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show one comparison: its state, or its answer and files."""
    job = find_validation(services, validation_id)
    if job.state is JobState.SUCCEEDED and job.replaced_by is not None:  # it was damaged, and made again
        return RedirectResponse(f"{find_base(request)}/validations/{job.replaced_by}", status_code=303)
    sentences: tuple[str, ...] = ()
    curves: tuple[CurveView, ...] = ()
    if job.state is JobState.SUCCEEDED:
        sentences = list_sentences(json.loads(services.results.read(job, "validation.json")), language)
    with suppress(NoSuchFile):  # only angles that were both measured are drawn
        clock = DayClock.of(find_day(services, job, OWN_CURVE).facts)
        place = f"{find_base(request)}/validations/{job.id}/curve?of="
        name = _load(language)["curves"]
        curves = (CurveView(name, f"{place}own", clock, 0.0, beside=f"{place}reference"),)
    values = {
        "row": build_row(job, language, now_utc()),
        "reference": job.request.reference.file_name if job.request.reference else "",
        "sentences": sentences,
        "asked": _load(language),
        "curves": curves,
        "d": load_wording(language, "day"),
    }
    return render_page(request, "validation.html", language, values)


class AnglePiece(Piece):
    """A stretch of one of the two angles."""

    of: Literal["own", "reference"]


@router.get("/validations/{validation_id}/curve")
def curve(validation_id: str, services: UsedServices, piece: Annotated[AnglePiece, Query()]) -> Response:
    """Give a stretch of one of the two angles, as of a day."""
    name = OWN_CURVE if piece.of == "own" else REFERENCE_CURVE
    return cut_curve(find_day(services, find_validation(services, validation_id), name), piece)


@router.get("/validations/{validation_id}/plot.svg")
def plot(validation_id: str, services: UsedServices, language: UsedLanguage) -> Response:
    """Give Bland and Altman's plot by itself."""
    job = find_validation(services, validation_id)
    body = services.results.read(job, f"plot.{find_nearest(language, job.request.languages)}.svg")
    return Response(body, media_type="image/svg+xml", headers={"Content-Security-Policy": REPORT_POLICY})


@dataclass(frozen=True, slots=True)
class ComparedItem:
    """A comparison among the recordings of a study: how far the two agree, in a line."""

    job: Job
    told: str
    plot: str


def list_compared(services: Services, jobs: Sequence[Job], language: Language) -> tuple[ComparedItem, ...]:
    """List the finished comparisons among the analyses of a study."""
    items = []
    for job in jobs:
        if job.request.reference is None or job.state is not JobState.SUCCEEDED:
            continue
        overall = json.loads(services.results.read(job, "validation.json"))["overall"]
        facts = {
            "rmse": format_angle(overall["rmse_deg"], language, 2),
            "bias": format_angle(overall["bias_deg"], language, 2),
            "low": format_angle(overall["loa_low_deg"], language, 1),
            "high": format_angle(overall["loa_high_deg"], language, 1),
        }
        name = f"plot.{find_nearest(language, job.request.languages)}.svg"
        has_plot = services.store.find_file(job.id, name) is not None
        items.append(ComparedItem(job, fill(_load(language)["item"], facts), "plot.svg" if has_plot else ""))
    return tuple(items)


def _describe_form(services: Services, language: Language, form: FormData | None = None) -> dict[str, Any]:
    """Give the form as it is shown, with what was typed into it before."""
    typed = {name: form.get(name, "") if form else "" for name in TYPED}
    return {
        "max_size": format_size(services.settings.max_upload_bytes, language),
        "asked": _load(language),
        "typed": {name: value if isinstance(value, str) else "" for name, value in typed.items()},
        "problem": None,
    }


def _load(language: Language) -> Any:
    return load_wording(language, "agreement")["page"]
