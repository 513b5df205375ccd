"""The routes under ``/api/v1``. They take and give; what happens in between is the jobs' affair."""

import re
import time
from collections.abc import Mapping
from typing import Annotated, Literal

import anyio
from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, JSONResponse
from starlette.background import BackgroundTask

from app.api.guard import REPORT_POLICY
from app.api.parameters import AnalyzeParameters
from app.api.problems import PROBLEM_RESPONSES, ProblemView, view_problem
from app.api.schemas import (
    RESULT_NAMES,
    AnalysisList,
    AnalysisView,
    VersionView,
    view_analysis,
)
from app.api.services import Services, UsedLanguage, UsedServices
from app.api.upload import take_recording
from app.errors import NoSuchFile, NotFinished, NotHere, list_refusals
from app.jobs.job import Job, JobState
from app.report.bundle import pack_files
from app.report.wording import Language
from app.storage import Storage
from app.version import software_revision, software_version

POLL_S = 0.2
LONGEST_WAIT_S = 60.0
MEDIA_TYPES: Mapping[str, str] = {
    "json": "application/json",
    "html": "text/html; charset=utf-8",
    "pdf": "application/pdf",
    "parquet": "application/vnd.apache.parquet",
    "csv": "text/csv; charset=utf-8",
    "txt": "text/plain; charset=utf-8",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
}
EXPORT_NAMES = frozenset(RESULT_NAMES) - {"results.json", "report.html", "report.pdf", "answer.txt"}

router = APIRouter(prefix="/api/v1", responses=PROBLEM_RESPONSES)
ReportLanguage = Annotated[Language | None, Query(description="en or fr; else the one asked for first")]


@router.post("/analyze", status_code=202, response_model=AnalysisView, response_model_exclude_unset=True)
async def analyze(
    request: Request,
    services: UsedServices,
    language: UsedLanguage,
    parameters: Annotated[AnalyzeParameters, Query()],
) -> Response:
    """Analyse a recording sent as the raw body: 202, or 200 when ``Prefer: wait=N`` saw it end."""
    job = await take_recording(request, services, parameters.to_request(language))
    job = await wait_for_end(request, services, job.id, _read_preference(request.headers.get("prefer", "")))
    body = view_analysis(job, language).model_dump(exclude_unset=True)
    headers = {"Location": f"/api/v1/analyses/{job.id}"}
    if job.is_over:
        return JSONResponse(body, 200, headers)
    return JSONResponse(body, 202, headers | {"Retry-After": "2"})


router.put("/analyze", include_in_schema=False)(analyze)  # what ``curl -T`` sends


@router.get("/analyses", response_model_exclude_unset=True)
def list_analyses(
    services: UsedServices, language: UsedLanguage, limit: Annotated[int, Query(ge=1, le=500)] = 100
) -> AnalysisList:
    """Give the newest analyses."""
    jobs = services.store.list_newest(limit)
    return AnalysisList(items=[view_analysis(job, language) for job in jobs])


@router.get("/analyses/{analysis_id}", response_model_exclude_unset=True)
async def get_analysis(
    analysis_id: str,
    request: Request,
    services: UsedServices,
    language: UsedLanguage,
    wait: Annotated[float, Query(ge=0, le=LONGEST_WAIT_S, description="Seconds to wait for its end.")] = 0,
) -> AnalysisView:
    """Give one analysis; with ``wait``, as soon as it ends."""
    return view_analysis(await wait_for_end(request, services, analysis_id, wait), language)


@router.post("/analyses/{analysis_id}/cancel", response_model_exclude_unset=True)
def cancel_analysis(analysis_id: str, services: UsedServices, language: UsedLanguage) -> AnalysisView:
    """Stop an analysis; one that is over stays as it is."""
    return view_analysis(services.store.cancel(analysis_id), language)


@router.get("/analyses/{analysis_id}/results.json", response_class=FileResponse)
def get_results(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Every figure, byte for byte as the command line writes it."""
    return _serve_file(request, services, analysis_id, "results.json")


@router.get("/analyses/{analysis_id}/elevation.parquet", response_class=FileResponse)
def get_elevation(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """The angle over time."""
    return _serve_file(request, services, analysis_id, "elevation.parquet")


@router.get("/analyses/{analysis_id}/report.html", response_class=FileResponse)
def get_report_html(
    analysis_id: str, request: Request, services: UsedServices, lang: ReportLanguage = None
) -> Response:
    """The report, one file that opens anywhere."""
    return _serve_report(request, services, analysis_id, "html", lang)


@router.get("/analyses/{analysis_id}/report.pdf", response_class=FileResponse)
def get_report_pdf(
    analysis_id: str, request: Request, services: UsedServices, lang: ReportLanguage = None
) -> Response:
    """The report, to print and to file."""
    return _serve_report(request, services, analysis_id, "pdf", lang)


@router.get("/analyses/{analysis_id}/answer.txt", response_class=FileResponse)
def get_answer(
    analysis_id: str, request: Request, services: UsedServices, lang: ReportLanguage = None
) -> Response:
    """The answer in five lines, to paste into a record."""
    return _serve_report(request, services, analysis_id, "txt", lang)


@router.get("/analyses/{analysis_id}/bundle.zip")
def get_bundle(analysis_id: str, services: UsedServices) -> Response:
    """Every file of the analysis in one ZIP; the same analysis gives the same bytes."""
    job = services.store.get(analysis_id)
    _check_succeeded(job, "bundle.zip")
    if job.token is None:
        raise NoSuchFile(name="bundle.zip")
    body = pack_files(
        {name: read_result(services.storage, job, name) for name in services.store.list_files(job.id)}
    )
    disposition = f'attachment; filename="{name_ascii(name_download(job, "bundle.zip"))}"'
    return Response(body, media_type="application/zip", headers={"Content-Disposition": disposition})


@router.get("/analyses/{analysis_id}/{name}", response_class=FileResponse)
def get_export(analysis_id: str, name: str, request: Request, services: UsedServices) -> Response:
    """The main figures as a table: summary (csv, _fr.csv, xlsx, parquet), dictionary.csv, redcap_*.csv."""
    if name not in EXPORT_NAMES:
        raise NotHere
    return _serve_file(request, services, analysis_id, name)


@router.get("/problems/{code}")
def get_problem(code: str, language: UsedLanguage) -> ProblemView:
    """Explain the code of a refusal."""
    if code not in {refusal.code for refusal in list_refusals()}:
        raise NotHere
    return view_problem(code, {}, language, f"/api/v1/problems/{code}")


@router.get("/version")
def get_version() -> VersionView:
    """Say which software answers."""
    return VersionView(name="acromion", version=software_version(), revision=software_revision())


async def wait_for_end(request: Request, services: Services, analysis_id: str, wait_s: float) -> Job:
    """Look until the job is over, the time is up or nobody listens any more; blocks nobody else."""
    end_s = time.monotonic() + wait_s
    job = await run_in_threadpool(services.store.get, analysis_id)
    while not job.is_over and time.monotonic() < end_s and not await request.is_disconnected():
        await anyio.sleep(min(POLL_S, max(0.0, end_s - time.monotonic())))
        job = await run_in_threadpool(services.store.get, analysis_id)
    return job


def _read_preference(header: str) -> float:
    """Read ``Prefer: wait=N`` (RFC 7240); anything else is left aside, as the RFC asks."""
    match = re.search(r"(?:^|[,;\s])wait=(\d{1,4})(?:$|[,;\s])", header)
    return min(float(match[1]), LONGEST_WAIT_S) if match else 0.0


def _serve_report(
    request: Request,
    services: Services,
    analysis_id: str,
    kind: Literal["html", "pdf", "txt"],
    lang: Language | None,
) -> Response:
    languages = services.store.get(analysis_id).request.languages
    stem = "answer" if kind == "txt" else "report"
    return _serve_file(request, services, analysis_id, f"{stem}.{lang or languages[0]}.{kind}")


def _serve_file(request: Request, services: Services, analysis_id: str, name: str) -> Response:
    """Give the stored bytes of a published file, and nothing of an attempt that does not count."""
    job = services.store.get(analysis_id)
    _check_succeeded(job, name)
    file = services.store.find_file(job.id, name)
    if file is None or job.token is None:
        raise NoSuchFile(name=name)
    etag = f'"{file.sha256}"'
    if etag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers={"ETag": etag})
    kind = name.rpartition(".")[2]
    headers = {"ETag": etag} | ({"Content-Security-Policy": REPORT_POLICY} if kind == "html" else {})
    path = services.storage.fetch_result(job.id, job.token, name)
    return FileResponse(
        path,
        background=BackgroundTask(services.storage.give_back, path),
        headers=headers,
        media_type=MEDIA_TYPES[kind],
        filename=name_download(job, name),
        content_disposition_type="inline" if kind == "html" else "attachment",
    )


def _check_succeeded(job: Job, name: str) -> None:
    if not job.is_over:
        raise NotFinished(state=job.state.value)
    if job.state is not JobState.SUCCEEDED:
        raise NoSuchFile(name=name)


def read_result(storage: Storage, job: Job, name: str) -> bytes:
    """Give a small result whole."""
    path = storage.fetch_result(job.id, job.token or "", name)
    try:
        return path.read_bytes()
    finally:
        storage.give_back(path)


def name_ascii(name: str) -> str:
    """Write a name with the signs that an HTTP header takes."""
    return name.encode("ascii", "replace").decode("ascii").replace("?", "_")


def name_download(job: Job, name: str) -> str:
    """Name a download after the recording, with signs that every file system takes."""
    stem = job.file_name.partition(".")[0]
    safe = re.sub(r"[^\w .-]|^[.\s]+|[.\s]+$", "_", stem)[:80] or "recording"
    return f"{safe}_{name}"
