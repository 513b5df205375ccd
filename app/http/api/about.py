"""Reference data of the server: formats, dictionary, codes, version, and its own documentation."""

import shutil
from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Gauge, ProcessCollector, generate_latest
from pydantic import BaseModel, Field

from app.errors import NotHere, list_refusals
from app.formats import FORMATS, find_added_formats
from app.http.middleware.problems import PROBLEM_RESPONSES, ProblemView, view_flag, view_problem
from app.report.export.tables import describe_dictionary
from app.report.words.messages import find_flag_codes
from app.report.words.wording import is_french
from app.services import GOOD, UsedLanguage, UsedServices
from app.version import installed_readers, software_revision, software_version

router = APIRouter(prefix="/api/v1", responses=PROBLEM_RESPONSES, tags=["about"])


class ReaderView(BaseModel):
    """A reader of another package."""

    name: str
    version: str


class VersionView(BaseModel):
    """Which software answers."""

    name: str
    version: str
    revision: str
    readers: Annotated[list[ReaderView], Field(description="Readers that other packages add.")]


class FormatView(BaseModel):
    """A kind of file that is taken."""

    name: str
    extensions: list[str]
    holds: str


class FormatList(BaseModel):
    """Every kind of file that is taken."""

    items: list[FormatView]


class WordView(BaseModel):
    """What a column of a table or a field of ``results.json`` means."""

    file: str
    column: str
    kind: str | None
    unit: str
    meaning: str


class Dictionary(BaseModel):
    """Every column and field."""

    items: list[WordView]


@router.get("/formats")
def list_formats() -> FormatList:
    """Return which kinds of file are taken, those of the plug-ins that are installed last."""
    return FormatList(items=[FormatView(**asdict(kind)) for kind in (*FORMATS, *find_added_formats())])


@router.get("/dictionary")
def get_dictionary(language: UsedLanguage) -> Dictionary:
    """Say what every column and field means."""
    meaning = "french" if is_french(language) else "english"
    names = ("file", "column", "kind", "unit")
    rows = describe_dictionary()
    return Dictionary(
        items=[WordView(**{name: row[name] for name in names}, meaning=row[meaning]) for row in rows]  # type: ignore[arg-type]
    )


@router.get("/problems/{code}")
def get_problem(code: str, language: UsedLanguage) -> ProblemView:
    """Explain the code of a refusal, or of a warning (status 200: it refuses nothing)."""
    if code in find_flag_codes():
        return view_flag(code, language, f"/api/v1/problems/{code}")
    if code not in {refusal.code for refusal in list_refusals()}:
        raise NotHere
    return view_problem(code, {}, language, f"/api/v1/problems/{code}")


@router.get("/version")
def get_version() -> VersionView:
    """Return which software answers."""
    readers = [ReaderView(name=name, version=version) for name, version in installed_readers()]
    return VersionView(
        name="acromion", version=software_version(), revision=software_revision(), readers=readers
    )


# Health, and ``/metrics`` for Prometheus: counted when asked for, from the rows themselves.

health_router = APIRouter(include_in_schema=False)


@health_router.get("/healthz")
def healthz() -> dict[str, str]:
    """Say that the process answers."""
    return {"status": "ok"}


@health_router.get("/readyz")
async def readyz(services: UsedServices) -> JSONResponse:
    """Return whether uploads are taken: 200, or 503 with the code of each check that fails."""
    checks = await services.readiness.check()
    if set(checks.values()) != {GOOD}:
        body = {"status": "unready", "checks": checks}
        return JSONResponse(body, 503, headers={"Retry-After": "5"})
    counts = await run_in_threadpool(services.store.count_states)
    analyses = {state.value: number for state, number in counts.items()}
    body = {"status": GOOD, "checks": checks, "analyses": analyses}
    return JSONResponse(body | {"quarantine": len(services.quarantined)})


@health_router.get("/metrics")
def metrics(services: UsedServices) -> Response:
    """Return queue, failures by code, uploads under way, disk and process."""
    registry = CollectorRegistry()
    states = Gauge("acromion_analyses", "Analyses by state.", ["state"], registry=registry)
    for state, number in services.store.count_states().items():
        states.labels(state.value).set(number)
    problems = Gauge("acromion_failed_analyses", "Failed analyses by code.", ["code"], registry=registry)
    for code, number in services.store.count_problems().items():
        problems.labels(code).set(number)
    growing = len(services.uploads.find_growing())
    Gauge("acromion_uploads_under_way", "Uploads under way.", registry=registry).set(growing)
    free_bytes = shutil.disk_usage(services.settings.data_dir).free
    Gauge("acromion_free_disk_bytes", "Free space for recordings.", registry=registry).set(free_bytes)
    ProcessCollector(registry=registry)
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)
