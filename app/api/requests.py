"""Analyses asked for: with a recording sent along, or of recordings that are stored."""

import json
from dataclasses import replace
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field

from app.api.parameters import AnalysisSettings, AnalyzeParameters
from app.api.periods import check_periods, read_periods
from app.api.problems import PROBLEM_RESPONSES
from app.api.schemas import AnalysisView, StartedAnalyses, view_analysis
from app.api.services import Services, UsedLanguage, UsedServices, UsedWayIn
from app.api.upload import receive_recording
from app.api.waiting import read_preference, wait_for_end
from app.errors import Busy
from app.jobs.job import Job
from app.jobs.queueing import WayIn
from app.jobs.recordings import StoredRow
from app.jobs.renewing import find_same, retry
from app.report.wording import Language
from app.request import Paper, ReportRequest
from app.storage import StoredRecording

router = APIRouter(prefix="/api/v1", responses=PROBLEM_RESPONSES, tags=["analyses"])
DONE: dict[int | str, dict[str, Any]] = {200: {"model": AnalysisView, "description": "It is over already."}}
RAW_BODY = {"requestBody": {"content": {"application/octet-stream": {}}, "required": True}}


class AnalysisWish(BaseModel):
    """Which recordings are to be analysed, each on its own, and how."""

    model_config = ConfigDict(extra="forbid")

    recording_ids: Annotated[list[str], Field(min_length=1, max_length=1000)]
    settings: AnalysisSettings = AnalysisSettings()
    again: Annotated[bool, Field(description="Analyse anew what has been analysed alike.")] = False


@router.post(
    "/analyze",
    status_code=202,
    response_model=AnalysisView,
    response_model_exclude_unset=True,
    responses=DONE,
    openapi_extra=RAW_BODY,
)
async def analyze(
    request: Request,
    services: UsedServices,
    language: UsedLanguage,
    way_in: UsedWayIn,
    parameters: Annotated[AnalyzeParameters, Query()],
) -> Response:
    """Analyse a recording sent as the raw body: 202, or 200 when ``Prefer: wait=N`` saw it end.

    The same bytes with the same settings are not analysed twice: the analysis that there is comes back.
    """
    check_queue(services)
    wish = parameters.to_request(language, services.settings.paper)

    def commit(stored: StoredRecording) -> tuple[Job, bool]:
        own = (stored.id, stored.sha256)
        same = None if parameters.again else find_same(services.store, services.storage, own, wish, way_in)
        if same is not None:
            services.storage.drop_recording(stored.id)
            return same, True
        return services.store.add(stored, wish, way_in, parameters.external_id), False

    job, existed = await receive_recording(request, services, commit)
    wait_s = read_preference(request.headers.get("prefer", ""))
    job = await wait_for_end(request, services, job.id, wait_s)
    view = _view(job, language, existed=existed)
    return _accept(view.model_dump(exclude_unset=True), job)


# What ``curl -T`` sends.
router.put(
    "/analyze",
    name="put_and_analyze",
    status_code=202,
    response_model=AnalysisView,
    response_model_exclude_unset=True,
    responses=DONE,
    openapi_extra=RAW_BODY,
)(analyze)


@router.post(
    "/analyses",
    status_code=202,
    response_model_exclude_unset=True,
    responses={200: {"model": StartedAnalyses, "description": "The first is over already."}},
)
def create_analyses(
    wish: AnalysisWish, services: UsedServices, language: UsedLanguage, way_in: UsedWayIn
) -> StartedAnalyses:
    """Analyse stored recordings; what has been analysed alike comes back as it is (``duplicate_of``)."""
    check_queue(services, len(wish.recording_ids))
    rows = [services.recordings.get(recording_id) for recording_id in wish.recording_ids]
    paper, flow = services.settings.paper, way_in if len(rows) == 1 else "api"
    asked = [(row, build_request(row, wish.settings, language, paper)) for row in rows]
    pairs = [_start(services, row, request, flow, again=wish.again) for row, request in asked]
    views = [_view(job, language, existed=existed) for job, existed in pairs]
    items = [view.model_dump(exclude_unset=True) for view in views]
    return _accept(items[0] | {"items": items}, pairs[0][0])  # type: ignore[return-value]


@router.post("/analyses/{analysis_id}/cancel", response_model_exclude_unset=True)
def cancel_analysis(analysis_id: str, services: UsedServices, language: UsedLanguage) -> AnalysisView:
    """Stop an analysis; one that is over stays as it is."""
    return view_analysis(services.store.cancel(analysis_id), language)


@router.post(
    "/analyses/{analysis_id}/retry", status_code=202, response_model_exclude_unset=True, responses=DONE
)
def retry_analysis(
    analysis_id: str, services: UsedServices, language: UsedLanguage, way_in: UsedWayIn
) -> AnalysisView:
    """Analyse anew what failed, was cancelled, or has a file that is damaged or missing.

    What is under way, or done and whole, comes back as it is.
    """
    job = retry(services.store, services.storage, analysis_id, way_in)
    return _accept(view_analysis(job, language).model_dump(exclude_unset=True), job)  # type: ignore[return-value]


def check_queue(services: Services, more: int = 1) -> None:
    """Refuse more work than may wait.

    Raises
    ------
    Busy
    """
    if services.store.count_waiting() + more > services.settings.max_queued:
        raise Busy


def build_request(
    row: StoredRow, settings: AnalysisSettings, language: Language, paper: Paper
) -> ReportRequest:
    """Ask by the settings; what they leave out is as the recording says, or as the server has it.

    Raises
    ------
    fusion.errors.UnusableDiary
    """
    told = {"subject": row.about.subject, "side": row.about.side} | settings.model_dump(exclude_unset=True)
    whole = AnalysisSettings.model_validate(told)
    request = whole.ask(row.about.file_name, language, paper)
    diary = row.diary
    if settings.periods is not None:
        diary = read_periods(settings.periods)
        check_periods(diary, row.inspection)
    profile = json.dumps(settings.profile, sort_keys=True) if settings.profile else ""
    return replace(request, diary=diary, source=settings.source, profile=profile, reason=settings.reason)


def _start(
    services: Services, row: StoredRow, request: ReportRequest, way_in: WayIn, *, again: bool
) -> tuple[Job, bool]:
    """Give the analysis, and whether it was there before."""
    own = (row.id, row.sha256)
    same = None if again else find_same(services.store, services.storage, own, request, way_in)
    return same or services.store.add_analysis(own, request, way_in), same is not None


def _view(job: Job, language: Language, *, existed: bool) -> AnalysisView:
    view = view_analysis(job, language)
    if existed:
        view.duplicate_of = job.id
    return view


def _accept(body: dict[str, Any], job: Job) -> JSONResponse:
    """Answer 202, or 200 where nothing is left to wait for."""
    headers = {"Location": f"/api/v1/analyses/{job.id}"}
    if job.is_over:
        return JSONResponse(body, 200, headers)
    return JSONResponse(body, 202, headers | {"Retry-After": "2"})
