"""The routes under ``/api/v1``. They take and give; what happens in between is the jobs' affair."""

import json
from collections.abc import Callable
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import FileResponse

from app.api.paging import cut_page, read_cursor
from app.api.problems import PROBLEM_RESPONSES
from app.api.results import borrow_file, check_succeeded, read_result, serve_bytes, serve_file
from app.api.schemas import (
    RESULT_NAMES,
    AnalysisList,
    AnalysisQuery,
    AnalysisView,
    view_analysis,
)
from app.api.services import Services, UsedLanguage, UsedServices
from app.api.waiting import LONGEST_WAIT_S, wait_for_end
from app.batch.settings_file import encode_settings
from app.day_file import NAME as DAY_NAME
from app.jobs.job import Job, JobState
from app.jobs.recordings import Place
from app.jobs.store import JobFilter
from app.report.bundle import pack_files
from app.report.summary import PERIOD_COLUMNS, list_periods
from app.report.tables import encode_table
from app.report.wording import Language

EXPORT_NAMES = tuple(name for name in RESULT_NAMES if name.startswith(("summary", "dictionary", "redcap")))

router = APIRouter(prefix="/api/v1", responses=PROBLEM_RESPONSES, tags=["analyses"])
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
    return _serve(request, services, analysis_id, "results.json")


@router.get("/analyses/{analysis_id}/elevation.parquet", response_class=FileResponse)
def get_elevation(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """The angle over time."""
    return _serve(request, services, analysis_id, "elevation.parquet")


@router.get("/analyses/{analysis_id}/fhir.json", response_class=FileResponse)
def get_fhir(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """The report with its PDF, and its figures as observations, as a FHIR R4 bundle."""
    return _serve(request, services, analysis_id, "fhir.json")


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


@router.get("/analyses/{analysis_id}/bundle.zip", response_class=FileResponse)
def get_bundle(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Every file of the analysis in one ZIP; the same analysis gives the same bytes."""
    job = services.store.get(analysis_id)
    check_succeeded(job, "bundle.zip")
    names = [file.name for file in services.store.list_files(job.id) if file.name != DAY_NAME]
    body = pack_files({name: read_result(services, job, name) for name in names})
    return serve_bytes(request, services, job, "bundle.zip", body)


@router.get("/analyses/{analysis_id}/periods.csv", response_class=FileResponse)
def get_periods_table(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """The main figures by clock hour and by period of the diary."""
    job = services.store.get(analysis_id)
    rows = list_periods(json.loads(read_result(services, job, "results.json")))
    return serve_bytes(request, services, job, "periods.csv", encode_table(PERIOD_COLUMNS, rows))


@router.get("/analyses/{analysis_id}/settings.yaml", response_class=Response)
def get_settings_file(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """What was asked, as ``acromion run --config`` takes it."""
    job = services.store.get(analysis_id)
    return serve_bytes(request, services, job, "settings.yaml", encode_settings(job.request))


@router.get("/analyses/{analysis_id}/elevation.csv.gz", response_class=FileResponse)
def get_elevation_table(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """The angle over time as text, in gzip."""
    job = services.store.get(analysis_id)
    with borrow_file(services, job, "elevation.parquet") as parquet:
        body = services.inspector.write_angles(parquet)
    return serve_bytes(request, services, job, "elevation.csv.gz", body)


def _serve_export(name: str) -> Callable[[str, Request, Services], Response]:
    """Make the route of one table: the main figures, written for other programs."""

    def get_export(analysis_id: str, request: Request, services: UsedServices) -> Response:
        """The main figures as a table, or what its columns mean."""
        return _serve(request, services, analysis_id, name)

    return get_export


for export in EXPORT_NAMES:
    router.add_api_route(
        f"/analyses/{{analysis_id}}/{export}",
        _serve_export(export),
        name=f"get_{export.replace('.', '_')}",
        response_class=FileResponse,
    )


def _tell_place(job: Job) -> Place:
    return job.created_at.isoformat(timespec="microseconds"), job.id


def _serve_report(
    request: Request,
    services: Services,
    analysis_id: str,
    kind: Literal["html", "pdf", "txt"],
    lang: Language | None,
) -> Response:
    job = services.store.get(analysis_id)
    stem = "answer" if kind == "txt" else "report"
    return serve_file(request, services, job, f"{stem}.{lang or job.request.languages[0]}.{kind}")


def _serve(request: Request, services: Services, analysis_id: str, name: str) -> Response:
    return serve_file(request, services, services.store.get(analysis_id), name)
