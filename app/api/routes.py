"""The routes under ``/api/v1``. They take and give; what happens in between is the jobs' affair."""

import re
from collections.abc import Mapping
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import FileResponse

from app.api.guard import REPORT_POLICY
from app.api.paging import cut_page, read_cursor
from app.api.problems import PROBLEM_RESPONSES, ProblemView, view_problem
from app.api.schemas import (
    RESULT_NAMES,
    AnalysisList,
    AnalysisQuery,
    AnalysisView,
    VersionView,
    view_analysis,
)
from app.api.services import Services, UsedLanguage, UsedServices
from app.api.waiting import LONGEST_WAIT_S, wait_for_end
from app.day_file import NAME as DAY_NAME
from app.errors import NoSuchFile, NotFinished, NotHere, list_refusals
from app.jobs.job import Job, JobState
from app.jobs.recordings import Place
from app.jobs.store import JobFilter
from app.report.bundle import pack_files
from app.report.wording import Language
from app.version import software_revision, software_version

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


@router.get("/analyses", response_model_exclude_unset=True)
def list_analyses(
    request: Request,
    answer: Response,
    services: UsedServices,
    language: UsedLanguage,
    wanted: Annotated[AnalysisQuery, Query()],
) -> AnalysisList:
    """Give the newest analyses, page by page."""
    asked = JobFilter(JobState(wanted.state) if wanted.state else "", wanted.batch_id, wanted.recording_id)
    found = services.store.list_page(asked, wanted.limit + 1, read_cursor(wanted.cursor))
    jobs, following = cut_page(found, wanted.limit, _tell_place, request, answer)
    return AnalysisList(items=[view_analysis(job, language) for job in jobs], next_cursor=following)


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
    folder = services.storage.attempt(job.id, job.token)
    body = pack_files({path.name: path.read_bytes() for path in folder.iterdir() if path.name != DAY_NAME})
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


def _tell_place(job: Job) -> Place:
    return job.created_at.isoformat(timespec="microseconds"), job.id


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
    return FileResponse(
        services.storage.attempt(job.id, job.token) / name,
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


def name_ascii(name: str) -> str:
    """Write a name with the signs that an HTTP header takes."""
    return name.encode("ascii", "replace").decode("ascii").replace("?", "_")


def name_download(job: Job, name: str) -> str:
    """Name a download after the recording, with signs that every file system takes."""
    stem = job.file_name.partition(".")[0]
    safe = re.sub(r"[^\w .-]|^[.\s]+|[.\s]+$", "_", stem)[:80] or "recording"
    return f"{safe}_{name}"
