"""Reference data of the server: formats, dictionary, codes, version, health and metrics."""

import shutil
from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Gauge, ProcessCollector, generate_latest
from pydantic import BaseModel, Field

from acromion.app.errors import NotHere, list_refusals
from acromion.app.formats import FORMATS, find_added_formats
from acromion.app.http.middleware.problems import PROBLEM_RESPONSES, ProblemView, view_flag, view_problem
from acromion.app.report.export.tables import describe_dictionary
from acromion.app.report.words.messages import find_flag_codes
from acromion.app.report.words.wording import is_french
from acromion.app.services import GOOD, UsedLanguage, UsedServices
from acromion.app.version import installed_readers, software_version, source_revision

router = APIRouter(prefix="/api/v1", responses=PROBLEM_RESPONSES, tags=["about"])


class ReaderView(BaseModel):
    """A reader from another package."""

    name: str
    version: str


class VersionView(BaseModel):
    """The software version of the server."""

    name: str
    version: str
    revision: str
    readers: Annotated[list[ReaderView], Field(description="Readers from other packages.")]


class FormatView(BaseModel):
    """A supported file format."""

    name: str
    extensions: list[str]
    holds: str


class FormatList(BaseModel):
    """All supported file formats."""

    items: list[FormatView]


class WordView(BaseModel):
    """The meaning of a table column or a field of ``results.json``."""

    file: str
    column: str
    kind: str | None
    unit: str
    meaning: str


class Dictionary(BaseModel):
    """All columns and fields."""

    items: list[WordView]


@router.get("/formats")
def list_formats() -> FormatList:
    """Return the supported file formats; those of plug-ins come last."""
    return FormatList(items=[FormatView(**asdict(kind)) for kind in (*FORMATS, *find_added_formats())])


@router.get("/dictionary")
def get_dictionary(language: UsedLanguage) -> Dictionary:
    """Return the meaning of every column and field."""
    meaning = "french" if is_french(language) else "english"
    names = ("file", "column", "kind", "unit")
    rows = describe_dictionary()
    return Dictionary(
        items=[WordView(**{name: row[name] for name in names}, meaning=row[meaning]) for row in rows]  # type: ignore[arg-type]
    )


@router.get("/problems/{code}")
def get_problem(code: str, language: UsedLanguage) -> ProblemView:
    """Return the explanation of a problem code or of a warning code (status 200)."""
    if code in find_flag_codes():
        return view_flag(code, language, f"/api/v1/problems/{code}")
    if code not in {refusal.code for refusal in list_refusals()}:
        raise NotHere
    return view_problem(code, {}, language, f"/api/v1/problems/{code}")


@router.get("/version")
def get_version() -> VersionView:
    """Return the software version of the server."""
    readers = [ReaderView(name=name, version=version) for name, version in installed_readers()]
    return VersionView(
        name="acromion", version=software_version(), revision=source_revision(), readers=readers
    )


# Health checks, and ``/metrics`` for Prometheus, counted from the database at each request.

health_router = APIRouter(include_in_schema=False)


@health_router.get("/healthz")
def healthz() -> dict[str, str]:
    """Return ok as long as the process answers."""
    return {"status": "ok"}


@health_router.get("/readyz")
async def readyz(services: UsedServices) -> JSONResponse:
    """Return 200 if the server accepts uploads, else 503 with the code of each failed check."""
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
    """Return metrics: queue, failures by code, uploads in progress, disk and process."""
    registry = CollectorRegistry()
    states = Gauge("acromion_analyses", "Analyses by state.", ["state"], registry=registry)
    for state, number in services.store.count_states().items():
        states.labels(state.value).set(number)
    problems = Gauge("acromion_failed_analyses", "Failed analyses by code.", ["code"], registry=registry)
    for code, number in services.store.count_problems().items():
        problems.labels(code).set(number)
    growing = len(services.uploads.find_growing())
    Gauge("acromion_uploads_under_way", "Uploads in progress.", registry=registry).set(growing)
    free_bytes = shutil.disk_usage(services.settings.data_dir).free
    Gauge("acromion_free_disk_bytes", "Free space for recordings.", registry=registry).set(free_bytes)
    ProcessCollector(registry=registry)
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)
