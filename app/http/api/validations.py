"""Comparisons with a reference: two files in one form become a job like any other."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Annotated, Any, BinaryIO, Literal, TypeVar, get_args

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, JSONResponse
from pydantic import BaseModel
from starlette.datastructures import FormData, UploadFile

from acromion.app.errors import BadParameter, NotHere
from acromion.app.http.api.library.files import serve_file
from acromion.app.http.middleware.problems import PROBLEM_RESPONSES, ProblemView, view_problem
from acromion.app.intake import store_file
from acromion.app.library.rows import Job, JobState
from acromion.app.report.words.wording import Language, find_nearest
from acromion.app.request import (
    SUBJECT_HINT,
    WINDOW_HINT,
    Reference,
    ReportRequest,
    check_subject,
    clean_file_name,
    parse_window,
)
from acromion.app.services import Services, UsedLanguage, UsedServices, choose_language
from acromion.app.store.folder import too_large
from acromion.fusion.conventions import PoseHeld
from acromion.fusion.diary import TaskWindow, read_tasks

T = TypeVar("T")

NAMES = ("validation.json", "validation.csv", "validation.html", "validation.pdf")
CHOICES: dict[str, tuple[str, ...]] = {
    "side": ("", "left", "right"),
    "method": ("smoothed", "published", "live"),
    "pose": ("n-pose", "side-lean"),
    "pose_held": ("", *get_args(PoseHeld)),
    "paper": ("", "a4", "letter"),
}
MAX_TASK_BYTES = 1 << 20
FIELDS = (
    "recording",
    "reference",
    "tasks",
    "subject",
    "study",
    "offset_s",
    "drift_ppm",
    "rate_hz",
    "reference_rate_hz",
)
KNOWN = {*FIELDS, *CHOICES, "calibration", "lang"}

router = APIRouter(prefix="/api/v1", responses=PROBLEM_RESPONSES)


class ValidationView(BaseModel):
    """A comparison: its state, the reason if it failed, and the links of its files."""

    id: str
    state: Literal["queued", "running", "succeeded", "failed", "cancelled"]
    stage: str | None
    progress: float
    file_name: str
    reference_name: str
    links: dict[str, str]
    problem: ProblemView | None = None


FORM = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["recording", "reference"],
                    "properties": {
                        **{name: {"type": "string"} for name in (*FIELDS, "calibration", "lang")},
                        **{name: {"type": "string", "format": "binary"} for name in FIELDS[:3]},
                        **{name: {"type": "string", "enum": list(among)} for name, among in CHOICES.items()},
                    },
                }
            }
        },
    }
}


@router.post("/validations", status_code=202, response_model=ValidationView, openapi_extra=FORM)
async def add_validation(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Compare two files sent as one form: ``recording`` and ``reference``; ``tasks`` is optional."""
    async with open_form(request, services) as form:
        job = await queue_validation(form, services)
    body = view_validation(job, language).model_dump()
    headers = {"Location": f"/api/v1/validations/{job.id}", "Retry-After": "2"}
    return JSONResponse(body, 202, headers)


@router.get("/validations/{validation_id}")
def get_validation(validation_id: str, services: UsedServices, language: UsedLanguage) -> ValidationView:
    """Return one comparison."""
    return view_validation(get_validation_job(services, validation_id), language)


@router.get("/validations/{validation_id}/{name}", response_class=FileResponse)
def get_validation_file(
    validation_id: str,
    name: Literal["validation.json", "validation.csv", "validation.html", "validation.pdf"],
    request: Request,
    services: UsedServices,
    lang: Annotated[
        Language | None,
        Query(description="en, fr or fr-CA, or the nearest available; default: the language of the request"),
    ] = None,
) -> Response:
    """Return every figure (JSON, CSV) or the sheet (HTML, PDF) of a comparison."""
    job = get_validation_job(services, validation_id)
    stem, _, kind = name.partition(".")
    language = find_nearest(lang or choose_language(request), job.request.languages)
    stored = f"{stem}.{language}.{kind}" if kind in {"html", "pdf"} else name
    return serve_file(request, services, job, stored, name)


def get_validation_job(services: Services, validation_id: str) -> Job:
    """Return a job that is a comparison. Raises NotHere."""
    job = services.store.get(validation_id)
    if job.request.reference is None:
        raise NotHere
    return job


def view_validation(job: Job, language: Language) -> ValidationView:
    """Build the view of a comparison."""
    own = f"/api/v1/validations/{job.id}"
    links = {"self": own, "page": f"/validations/{job.id}"}
    if job.state is JobState.SUCCEEDED:
        links |= {name.replace(".", "_"): f"{own}/{name}" for name in NAMES}
    problem = None
    if job.problem_code is not None:
        problem = view_problem(job.problem_code, job.problem_facts, language, own)
    return ValidationView(
        id=job.id,
        state=job.state.value,
        stage=job.stage,
        progress=round(job.progress, 3),
        file_name=job.file_name,
        reference_name=job.request.reference.file_name if job.request.reference else "",
        links=links,
        problem=problem,
    )


@asynccontextmanager
async def open_form(request: Request, services: Services) -> AsyncIterator[FormData]:
    """Read the form and write its files to disk; if possible, refuse it before reading.

    Raises FileTooLarge, DiskFull or BadParameter.
    """
    announced = request.headers.get("content-length", "")
    if not announced.isdecimal():
        raise BadParameter(name="Content-Length", value=announced[:20], allowed="a number of bytes")
    limit_bytes = 2 * services.settings.max_upload_bytes
    if int(announced) > limit_bytes:
        raise too_large(int(announced), limit_bytes)
    services.storage.check_space(2 * int(announced), services.settings.min_free_bytes)
    async with request.form(max_files=3, max_fields=len(KNOWN)) as form:
        yield form


async def queue_validation(form: FormData, services: Services) -> Job:
    """Queue the comparison that a form describes.

    Raises FileTooLarge, DiskFull, EmptyFile, BadParameter or UnusableTasks.
    """
    recording, reference = _require_file(form, "recording"), _require_file(form, "reference")
    for name in form:
        if name not in KNOWN:
            raise BadParameter(name=name[:60], value="", allowed=", ".join(sorted(KNOWN)))
    chosen: dict[str, Any] = {}
    for name, among in CHOICES.items():
        value = _text(form, name) or among[0]
        if value not in among:
            raise BadParameter(name=name, value=value[:60], allowed=", ".join(filter(None, among)))
        chosen[name] = value or None
    chosen["paper"] = chosen["paper"] or services.settings.paper
    window = _read(form, "calibration", parse_window, WINDOW_HINT)
    asked = ReportRequest(
        clean_file_name(recording.filename or ""),
        subject=_read(form, "subject", check_subject, SUBJECT_HINT) or "",
        calibration_windows_s=(window,) if window is not None else (),
        rate_hz=_read(form, "rate_hz", _read_rate, "1 to 10000"),
        **chosen,
    )
    file = form.get("tasks")
    tasks: tuple[TaskWindow, ...] = ()
    if isinstance(file, UploadFile) and file.filename:
        tasks = read_tasks(await file.read(MAX_TASK_BYTES))
    given = Reference(
        "",
        clean_file_name(reference.filename or ""),
        _read(form, "offset_s", _read_number, "a number of seconds"),
        _read(form, "drift_ppm", _read_number, "a number"),
        _read(form, "reference_rate_hz", _read_rate, "1 to 10000"),
        tasks,
    )
    study = _read(form, "study", check_subject, SUBJECT_HINT) or ""
    files = recording.file, reference.file
    return await run_in_threadpool(_store, services, files, asked, given, study)


def _require_file(form: FormData, name: str) -> UploadFile:
    file = form.get(name)
    if not isinstance(file, UploadFile) or not file.filename:
        raise BadParameter(name=name, value="", allowed="a file")
    return file


def _text(form: FormData, name: str) -> str:
    value = form.get(name, "")
    return value.strip() if isinstance(value, str) else ""


def _read(form: FormData, name: str, read: Callable[[str], T], allowed: str) -> T | None:
    text = _text(form, name)
    if not text:
        return None
    try:
        return read(text)
    except ValueError:
        raise BadParameter(name=name, value=text[:60], allowed=allowed) from None


def _read_number(text: str) -> float:
    value = float(text.replace(",", "."))
    if not abs(value) < 1e12:
        raise ValueError(text)
    return value


def _read_rate(text: str) -> float:
    value = _read_number(text)
    if not 1 <= value <= 10_000:
        raise ValueError(text)
    return value


def _store(
    services: Services,
    files: tuple[BinaryIO, BinaryIO],
    asked: ReportRequest,
    given: Reference,
    study: str,
) -> Job:
    """Store both files, then their rows; the reference's row is first, so that the job always finds it."""
    recording, reference = files
    limit_bytes = services.settings.max_upload_bytes
    other, own = store_file(services.storage, reference, limit_bytes), None
    try:
        own = store_file(services.storage, recording, limit_bytes)
        services.recordings.add_reference(other, given.file_name)
        compared = replace(asked, reference=replace(given, path=other.id))
        return services.store.add(own, compared, study=study)
    except BaseException:
        for kept in filter(None, (other, own)):
            if not services.store.may_have_row(
                kept.id
            ):  # the row may be committed although the reply was lost
                services.storage.drop_recording(kept.id)
        raise
