"""Analyses under ``/api/v1``: start, follow and download them."""

import asyncio
import re
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, ParamSpec, TypeVar

import anyio
from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, JSONResponse, StreamingResponse
from pydantic import BaseModel, ConfigDict, Field

from acromion.app.batch.settings_file import encode_settings
from acromion.app.batch.shifts import cut_as_asked
from acromion.app.errors import BadParameter, Busy
from acromion.app.http.api.library.files import build_download_name, serve_bytes
from acromion.app.http.api.library.models import (
    RESULT_NAMES,
    AnalysisList,
    AnalysisQuery,
    AnalysisSettings,
    AnalysisView,
    AnalyzeParameters,
    StartedAnalyses,
    StudyName,
    check_periods,
    cut_page,
    read_cursor,
    read_periods,
    view_analysis,
)
from acromion.app.http.api.library.released import list_reports, read_report, serve_report
from acromion.app.http.api.library.uploads import receive_recording
from acromion.app.http.middleware.problems import PROBLEM_RESPONSES
from acromion.app.library.jobs import JobFilter
from acromion.app.library.recordings import DESCRIBED, StoredRow
from acromion.app.library.results import check_succeeded, find_or_add, retry
from acromion.app.library.rows import Job, JobState
from acromion.app.report.export.crate import CRATE, Made, encode_crate
from acromion.app.report.export.naming import pack_files
from acromion.app.report.export.tables import describe_tables, encode_rows
from acromion.app.report.figures import load_results
from acromion.app.report.words.wording import Language, find_nearest
from acromion.app.request import BY_DIARY, Conclusion, ReportRequest, clean_file_name, write_profile
from acromion.app.services import Services, UsedLanguage, UsedServices, UsedWayIn
from acromion.app.settings import Settings
from acromion.app.store.day_file import DAY_NAME
from acromion.app.store.folder import StoredRecording, borrow_recording
from acromion.fusion.clocks import INTERVAL_HINT
from acromion.fusion.errors import UnusableShift

# Waiting: for the end of an analysis, and for a thread whose request was cancelled.


P = ParamSpec("P")
T = TypeVar("T")

POLL_S = 0.2
MAX_WAIT_S = 60.0


async def wait_for_end(request: Request, services: Services, analysis_id: str, wait_s: float) -> Job:
    """Poll until the job is over, the time is up or the client has disconnected."""
    end_s = time.monotonic() + wait_s
    job = await run_in_threadpool(services.store.get, analysis_id)
    while not job.is_over and time.monotonic() < end_s and not await request.is_disconnected():
        await anyio.sleep(min(POLL_S, max(0.0, end_s - time.monotonic())))
        job = await run_in_threadpool(services.store.get, analysis_id)
    return job


async def run_to_end(function: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T:
    """Run in a thread and wait for its end even if cancelled, so that its database connection is returned."""
    work = asyncio.ensure_future(run_in_threadpool(function, *arguments, **named))
    try:
        return await asyncio.shield(work)
    except asyncio.CancelledError:
        with suppress(Exception):
            await work
        raise


# Start analyses: of a recording in the request body, or of stored recordings.

router = APIRouter(prefix="/api/v1", responses=PROBLEM_RESPONSES, tags=["analyses"])
DONE: dict[int | str, dict[str, Any]] = {200: {"model": AnalysisView, "description": "It is already over."}}
ANALYZE: dict[str, Any] = {
    "status_code": 202,
    "response_model": AnalysisView,
    "response_model_exclude_unset": True,
    "responses": DONE,
    "openapi_extra": {"requestBody": {"content": {"application/octet-stream": {}}, "required": True}},
}


class AnalysisWish(BaseModel):
    """The recordings to analyse, each separately, and their settings."""

    model_config = ConfigDict(extra="forbid")

    recording_ids: Annotated[list[str], Field(min_length=1, max_length=1000)]
    settings: AnalysisSettings = AnalysisSettings()
    again: Annotated[bool, Field(description="Analyse again even if the same analysis exists.")] = False
    not_removed: Annotated[
        bool,
        Field(
            description="The sensor stayed on between the shifts: the first one's confirmed pose applies to "
            "later ones without one."
        ),
    ] = False
    study: StudyName = ""


@router.post("/analyze", **ANALYZE)
async def analyze(
    request: Request,
    services: UsedServices,
    language: UsedLanguage,
    way_in: UsedWayIn,
    parameters: Annotated[AnalyzeParameters, Query()],
) -> Response:
    """Analyse a recording sent as the raw body: 202, or 200 if it ended within ``Prefer: wait=N``.

    The same bytes with the same settings are not analysed twice: the existing analysis is returned.
    """
    check_queue(services)
    store, file_name = services.store, clean_file_name(parameters.file_name)
    asked = parameters.build_request(file_name, language, services.settings)

    def commit(stored: StoredRecording) -> tuple[Job, bool]:
        add = partial(store.add, stored, asked, way_in, parameters.external_id)
        own, again = (stored.id, stored.sha256), parameters.again
        job, existed = find_or_add(store, services.storage, own, asked, way_in, add, again=again)
        if existed:
            services.storage.drop_recording(stored.id)
        if parameters.study:
            store.join_study(parameters.study, job.id)
        return job, existed

    job, existed = await receive_recording(request, services, commit)
    # ``Prefer: wait=N`` (RFC 7240); other preferences are ignored, as the RFC requires
    asked_s = re.search(r"(?:^|[,;\s])wait=(\d{1,4})(?:$|[,;\s])", request.headers.get("prefer", ""))
    wait_s = min(float(asked_s[1]), MAX_WAIT_S) if asked_s else 0.0
    job = await wait_for_end(request, services, job.id, wait_s)
    view = _view(job, language, existed=existed)
    return _accept(view.model_dump(mode="json", exclude_unset=True), job)


# ``curl -T`` sends PUT.
router.put("/analyze", name="put_and_analyze", **ANALYZE)(analyze)


@router.post(
    "/analyses",
    status_code=202,
    response_model_exclude_unset=True,
    responses={200: {"model": StartedAnalyses, "description": "The first is already over."}},
)
def create_analyses(
    body: AnalysisWish, services: UsedServices, language: UsedLanguage, way_in: UsedWayIn
) -> StartedAnalyses:
    """Analyse stored recordings; an identical existing analysis is returned (``duplicate_of``)."""
    check_queue(services, len(body.recording_ids))
    rows = [services.recordings.get(recording_id) for recording_id in body.recording_ids]
    flow = way_in if len(rows) == 1 else "api"
    asked = [(row, build_request(row, body.settings, language, services.settings)) for row in rows]
    if needs_cut(body.settings.shift):
        asked = _cut_shifts(services, asked, not_removed=body.not_removed)
        check_queue(services, len(asked))
    store, storage, pairs = services.store, services.storage, []
    for row, request in asked:
        own = (row.id, row.sha256)
        add = partial(store.add_analysis, own, request, flow, is_fresh=body.again)
        pairs.append(find_or_add(store, storage, own, request, flow, add, again=body.again))
    for row in rows:
        complete_description(services, row, body.settings)
    for job, _ in pairs if body.study else ():
        store.join_study(body.study, job.id)
    views = [_view(job, language, existed=existed) for job, existed in pairs]
    items = [view.model_dump(mode="json", exclude_unset=True) for view in views]
    return _accept(items[0] | {"items": items}, pairs[0][0])  # type: ignore[return-value]


@router.post("/analyses/{analysis_id}/cancel", response_model_exclude_unset=True)
def cancel_analysis(analysis_id: str, services: UsedServices, language: UsedLanguage) -> AnalysisView:
    """Stop an analysis; nothing changes if it is over."""
    return view_analysis(services.store.cancel(analysis_id), language)


@router.delete("/analyses/{analysis_id}/conclusion-draft", status_code=204)
def dismiss_draft(analysis_id: str, services: UsedServices) -> Response:
    """Dismiss the draft of a conclusion, also for later versions; without a draft nothing happens."""
    services.store.dismiss_draft(analysis_id)
    return Response(status_code=204)


@router.post(
    "/analyses/{analysis_id}/retry", status_code=202, response_model_exclude_unset=True, responses=DONE
)
def retry_analysis(
    analysis_id: str, services: UsedServices, language: UsedLanguage, way_in: UsedWayIn
) -> AnalysisView:
    """Repeat an analysis that failed, was cancelled, or has a damaged or missing file.

    An analysis that is running, or complete and undamaged, is returned unchanged.
    """
    job = retry(services.store, services.storage, analysis_id, way_in)
    return _accept(view_analysis(job, language).model_dump(mode="json", exclude_unset=True), job)  # type: ignore[return-value]


def check_queue(services: Services, more: int = 1) -> None:
    """Refuse more analyses than the queue allows. Raises Busy."""
    if services.store.count_waiting() + more > services.settings.max_queued:
        raise Busy


def complete_description(services: Services, row: StoredRow, settings: AnalysisSettings) -> None:
    """Store the person, arm and job of an analysis on a recording that does not have them yet."""
    about = row.about
    stated = replace(about, **{name: getattr(about, name) or getattr(settings, name) for name in DESCRIBED})
    if stated != about:
        services.recordings.describe(row, stated)


def needs_cut(shift: str) -> bool:
    """Return whether a shift is stated as hours of each day or "diary", so that there may be several."""
    return bool(shift) and "/" not in shift


def _cut_shifts(
    services: Services, asked: Sequence[tuple[StoredRow, ReportRequest]], *, not_removed: bool
) -> list[tuple[StoredRow, ReportRequest]]:
    """Return a request for each shift of the only recording.

    Raises BadParameter for several recordings, UnusableShift if there is no shift, RecordedProblem or
    UnusableDiary.
    """
    if len(asked) > 1:
        allowed = f"1; {INTERVAL_HINT}"
        raise BadParameter(name="recording_ids", value=str(len(asked)), allowed=allowed)
    row, request = asked[0]
    with borrow_recording(services.storage, row.id, row.sha256) as path:
        extent = services.inspector.measure(path, replace(request, shift=""))
    requests, refusals = cut_as_asked(request, extent, not_removed=not_removed)
    if not refusals:
        why = "no days" if request.shift == BY_DIARY else "no samples"
        raise UnusableShift(why=why if extent["start"] else "no clock", window=request.shift)
    return [(row, one) for one in requests]


def build_request(
    row: StoredRow, settings: AnalysisSettings, language: Language, defaults: Settings
) -> ReportRequest:
    """Build the request from the settings; defaults come from the recording, then from the server.

    Raises acromion.fusion.errors.UnusableDiary.
    """
    request = settings.complete(row.about).build_request(row.about.file_name, language, defaults)
    diary = row.diary
    if settings.periods is not None:
        diary = read_periods(settings.periods)
        check_periods(diary, row.inspection, request.time_zone, request.clock_offset_s)
    columns = (settings.profile or {}) | settings.columns
    profile = write_profile(columns) if columns else ""
    conclusion = settings.conclusion
    return replace(
        request,
        diary=diary,
        source=settings.source,
        profile=profile,
        reason=settings.reason,
        conclusion=Conclusion(**conclusion.model_dump(mode="json")) if conclusion else None,
    )


def _view(job: Job, language: Language, *, existed: bool) -> AnalysisView:
    view = view_analysis(job, language)
    if existed:
        view.duplicate_of = job.id
    return view


def _accept(body: dict[str, Any], job: Job) -> JSONResponse:
    """Return 202, or 200 if the analysis is over."""
    headers = {"Location": f"/api/v1/analyses/{job.id}"}
    if job.is_over:
        return JSONResponse(body, 200, headers)
    return JSONResponse(body, 202, headers | {"Retry-After": "2"})


# Progress as server-sent events, for the pages; for scripts, polling is the stable interface.

CHECK_PERIOD_S = 0.25
QUIET_S = 15.0


@router.get(
    "/analyses/{analysis_id}/events",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {}}}},
)
async def follow_analysis(
    analysis_id: str, request: Request, services: UsedServices, language: UsedLanguage
) -> StreamingResponse:
    """Send every change of an analysis as an event ``analysis`` until it ends."""
    await run_in_threadpool(services.store.get, analysis_id)
    events = _stream_changes(request, services, analysis_id, language)
    return StreamingResponse(events, media_type="text/event-stream")


async def _stream_changes(
    request: Request, services: Services, analysis_id: str, language: Language
) -> AsyncIterator[str]:
    last, sent_s = "", time.monotonic()
    while not await request.is_disconnected():
        job = await run_in_threadpool(services.store.get, analysis_id)
        view = view_analysis(job, language)
        event = f"event: analysis\ndata: {view.model_dump_json(exclude_unset=True)}\n\n"
        if event != last:
            last, sent_s = event, time.monotonic()
            yield event
        elif time.monotonic() - sent_s > QUIET_S:
            sent_s = time.monotonic()
            yield ": still here\n\n"
        if job.is_over:
            return
        await anyio.sleep(CHECK_PERIOD_S)


ReportLanguage = Annotated[
    Language | None,
    Query(
        description="en, fr or fr-CA, or the nearest available; default: the first language of the analysis"
    ),
]


@router.get("/analyses", response_model_exclude_unset=True)
def list_analyses(
    request: Request,
    answer: Response,
    services: UsedServices,
    language: UsedLanguage,
    wanted: Annotated[AnalysisQuery, Query()],
) -> AnalysisList:
    """Return the newest analyses, page by page."""
    asked = JobFilter(JobState(wanted.state) if wanted.state else "", wanted.batch_id, wanted.recording_id)
    found = services.store.find_page(asked, wanted.limit + 1, read_cursor(wanted.cursor))
    jobs, following = cut_page(
        found,
        wanted.limit,
        lambda job: (job.created_at.isoformat(timespec="microseconds"), job.id),
        request,
        answer,
    )
    return AnalysisList(items=[view_analysis(job, language) for job in jobs], next_cursor=following)


@router.get("/analyses/{analysis_id}", response_model_exclude_unset=True)
async def get_analysis(
    analysis_id: str,
    request: Request,
    services: UsedServices,
    language: UsedLanguage,
    wait: Annotated[float, Query(ge=0, le=MAX_WAIT_S, description="Seconds to wait for its end.")] = 0,
) -> AnalysisView:
    """Return one analysis; with ``wait``, when it ends or the time is up."""
    return view_analysis(await wait_for_end(request, services, analysis_id, wait), language)


def _add_file_route(name: str, about: str, route: str) -> None:
    """Add the route of one stored file."""

    def get_file(analysis_id: str, request: Request, services: UsedServices) -> Response:
        return serve_report(request, services, services.store.get(analysis_id), name)

    path = f"/analyses/{{analysis_id}}/{name}"
    router.add_api_route(path, get_file, name=route, description=about, response_class=FileResponse)


_add_file_route("results.json", "Every figure, byte for byte as the command line writes it.", "get_results")
_add_file_route("elevation.parquet", "The angle over time.", "get_elevation")
_add_file_route(
    "fhir.json", "The report with its PDF, and its figures as observations, as a FHIR R4 bundle.", "get_fhir"
)


def _add_report_route(name: str, about: str, route: str) -> None:
    """Add the route of a file that exists in each language."""

    def get_file(
        analysis_id: str, request: Request, services: UsedServices, lang: ReportLanguage = None
    ) -> Response:
        job, (stem, _, kind) = services.store.get(analysis_id), name.partition(".")
        made = job.request.languages
        language = find_nearest(lang, made) if lang else made[0]
        return serve_report(request, services, job, f"{stem}.{language}.{kind}")

    path = f"/analyses/{{analysis_id}}/{name}"
    router.add_api_route(path, get_file, name=route, description=about, response_class=FileResponse)


_add_report_route("report.html", "The report as one self-contained file.", "get_report_html")
_add_report_route("report.pdf", "The report as a PDF, for printing and filing.", "get_report_pdf")
_add_report_route("answer.txt", "The answer in five lines, to paste into a record.", "get_answer")


@router.get("/analyses/{analysis_id}/bundle.zip", response_class=FileResponse)
def get_bundle(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Return every file of the analysis in one ZIP; the same analysis gives the same bytes."""
    job = services.store.get(analysis_id)
    check_succeeded(job, "bundle.zip")
    names = [name for name in list_reports(services, job) if name != DAY_NAME]
    files = {name: read_report(request, services, job, name) for name in names}
    sizes = {name: len(content) for name, content in files.items()}
    made = Made(sizes, load_results(files.get("results.json", b"null")))
    body = pack_files({**files, CRATE: encode_crate([made], {})})
    return serve_bytes(request, body, build_download_name(services, job, "bundle.zip"))


def _add_table_route(table: str, about: str) -> None:
    """Add the route of a table of the parts of a recording."""

    def get_table(analysis_id: str, request: Request, services: UsedServices) -> Response:
        job = services.store.get(analysis_id)
        rows = describe_tables([load_results(services.results.read(job, "results.json"))])[table]
        return serve_bytes(
            request, encode_rows(table, rows), build_download_name(services, job, f"{table}.csv")
        )

    path = f"/analyses/{{analysis_id}}/{table}.csv"
    router.add_api_route(
        path, get_table, name=f"get_{table}_table", description=about, response_class=FileResponse
    )


_add_table_route("hours", "The main figures by clock hour.")
_add_table_route("periods", "The main figures of each period of the diary, breaks included.")
_add_table_route("tasks", "The main figures of each task of the diary, its periods pooled.")
_add_table_route("postures", "The main figures of the time in each posture.")
_add_table_route("marks", "The 15 minutes before each mark, beside the rest of the shift.")


@router.get("/analyses/{analysis_id}/settings.yaml", response_class=Response)
def get_settings_file(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Return the settings of the analysis in the format of ``acromion run --config``."""
    job = services.store.get(analysis_id)
    return serve_bytes(
        request, encode_settings(job.request), build_download_name(services, job, "settings.yaml")
    )


@router.get("/analyses/{analysis_id}/elevation.csv.gz", response_class=FileResponse)
def get_elevation_table(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Return the angle over time as text, in gzip."""
    job = services.store.get(analysis_id)
    with services.results.borrow(job, "elevation.parquet") as parquet:
        body = services.inspector.write_angles(parquet)
    return serve_bytes(request, body, build_download_name(services, job, "elevation.csv.gz"))


for export in RESULT_NAMES:
    if export.startswith(("summary", "dictionary", "redcap", "datapackage")):
        about = "The main figures as a table, or what its columns mean."
        _add_file_route(export, about, f"get_{export.replace('.', '_')}")
