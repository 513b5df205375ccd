"""Pages of a comparison with a reference: a form for two files, and the result; no scripts needed."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response
from fastapi.responses import HTMLResponse
from starlette.datastructures import FormData

from acromion.app.errors import AppError, NoSuchFile, find_outcome_of_code
from acromion.app.http.api.validations import get_validation_job, open_form, queue_validation
from acromion.app.http.middleware.guard import REPORT_POLICY
from acromion.app.http.pages.recording.day import DayClock, Piece, cut_curve, load_day
from acromion.app.http.pages.recording.page_one import CurveView
from acromion.app.http.pages.rendering import Page, UsedPage
from acromion.app.http.pages.views import build_row, format_size
from acromion.app.library.rows import Job, JobState
from acromion.app.report.agreement import list_sentences
from acromion.app.report.words.messages import describe_problem
from acromion.app.report.words.numbers import format_angle
from acromion.app.report.words.wording import fill, find_nearest
from acromion.app.services import UsedServices
from acromion.app.store.day_file import OWN_CURVE, REFERENCE_CURVE
from acromion.fusion.errors import FusionError

TYPED = ("side", "subject", "study", "offset_s", "drift_ppm")
"""Fields that keep their typed value if the form is refused; browsers do not allow this for files."""

router = APIRouter(default_response_class=HTMLResponse, include_in_schema=False)


@router.get("/validations")
def ask(page: UsedPage) -> Response:
    """Show the form."""
    return _render_form(page, {})


@router.post("/validations")
async def take(page: UsedPage) -> Response:
    """Queue the comparison and redirect to it; show a refused form again with the typed values."""
    async with open_form(page.request, page.services) as form:
        try:
            job = await queue_validation(form, page.services)
        except (FusionError, AppError) as refusal:
            return _render_form(page, form, refusal)
    return page.go(f"/validations/{job.id}")


def _render_form(
    page: Page, form: FormData | Mapping[str, str], refusal: FusionError | AppError | None = None
) -> Response:
    """Render the form with the values typed before."""
    typed = {name: form.get(name, "") for name in TYPED}
    return page.render(
        "pairs/validate.html",
        status=find_outcome_of_code(refusal.code).status if refusal else 200,
        problem=describe_problem(refusal.code, refusal.facts, page.language) if refusal else None,
        code=refusal.code if refusal else "",
        max_size=format_size(page.services.settings.max_upload_bytes, page.language),
        typed={name: value if isinstance(value, str) else "" for name, value in typed.items()},
    )


@router.get("/validations/{validation_id}")
def show(validation_id: str, page: UsedPage) -> Response:
    """Show one comparison: its state, or its answer and files."""
    services, language = page.services, page.language
    job = get_validation_job(services, validation_id)
    sentences: Sequence[str] = ()
    curves: Sequence[CurveView] = ()
    if job.state is JobState.SUCCEEDED:
        if job.replaced_by is not None:  # it was damaged and has been repeated
            return page.go(f"/validations/{job.replaced_by}")
        sentences = list_sentences(json.loads(services.results.read(job, "validation.json")), language)
    with suppress(NoSuchFile):  # curves exist only if both angles were measured
        clock = DayClock.of(load_day(services, job, OWN_CURVE).facts)
        place, name = f"{page.base}/validations/{job.id}/curve?of=", page.words("agreement")["page"]["curves"]
        curves = (CurveView(name, f"{place}own", clock, 0.0, beside=f"{place}reference"),)
    reference = job.request.reference.file_name if job.request.reference else ""
    return page.render(
        "pairs/validation.html",
        row=build_row(job, language),
        reference=reference,
        sentences=sentences,
        curves=curves,
    )


class AnglePiece(Piece):
    """A time range of one of the two angles."""

    of: Literal["own", "reference"]


@router.get("/validations/{validation_id}/curve")
def curve(validation_id: str, services: UsedServices, piece: Annotated[AnglePiece, Query()]) -> Response:
    """Return a time range of one of the two angles, in the format of a day's curve."""
    name = OWN_CURVE if piece.of == "own" else REFERENCE_CURVE
    return cut_curve(load_day(services, get_validation_job(services, validation_id), name), piece)


@router.get("/validations/{validation_id}/plot.svg")
def plot(validation_id: str, page: UsedPage) -> Response:
    """Return the Bland–Altman plot as a separate image."""
    job = get_validation_job(page.services, validation_id)
    body = page.services.results.read(job, f"plot.{find_nearest(page.language, job.request.languages)}.svg")
    return Response(body, media_type="image/svg+xml", headers={"Content-Security-Policy": REPORT_POLICY})


@dataclass(frozen=True, slots=True)
class ComparedItem:
    """A comparison among the recordings of a study, with the agreement in one line."""

    job: Job
    told: str
    plot: str


def list_compared(page: Page, jobs: Sequence[Job]) -> tuple[ComparedItem, ...]:
    """List the finished comparisons among the analyses of a study."""
    words, language, items = page.words("agreement")["page"]["item"], page.language, []
    for job in jobs:
        if job.request.reference is None or job.state is not JobState.SUCCEEDED:
            continue
        overall = json.loads(page.services.results.read(job, "validation.json"))["overall"]
        facts = {
            "rmse": format_angle(overall["rmse_deg"], language, 2),
            "bias": format_angle(overall["bias_deg"], language, 2),
            "low": format_angle(overall["loa_low_deg"], language, 1),
            "high": format_angle(overall["loa_high_deg"], language, 1),
        }
        name = f"plot.{find_nearest(language, job.request.languages)}.svg"
        has_plot = page.services.store.find_file(job.id, name) is not None
        items.append(ComparedItem(job, fill(words, facts), "plot.svg" if has_plot else ""))
    return tuple(items)
