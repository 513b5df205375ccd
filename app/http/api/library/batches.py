"""Batches: many recordings, one set of settings, one table."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field

from acromion.app.batch.stated import format_stated
from acromion.app.errors import CANCELLED, BadParameter, NotFinished, ResultDamaged
from acromion.app.http.api.library.analyses import (
    build_request,
    check_queue,
    complete_description,
    needs_cut,
)
from acromion.app.http.api.library.files import MEDIA_TYPES, respond_with_file
from acromion.app.http.api.library.models import AnalysisSettings, cut_page, read_cursor
from acromion.app.http.middleware.problems import PROBLEM_RESPONSES, validate_model
from acromion.app.library.batches import Batch
from acromion.app.library.recordings import StoredRow
from acromion.app.library.results import can_regenerate
from acromion.app.library.rows import Job, JobState
from acromion.app.report.export.tables import (
    Origin,
    Row,
    add_origin,
    build_problem_row,
    encode_rows,
    summarise_failure,
    summarise_results,
)
from acromion.app.report.figures import load_results
from acromion.app.services import Services, UsedLanguage, UsedServices
from acromion.app.store.folder import is_result_whole
from acromion.fusion.clocks import INTERVAL_HINT

RESULTS = "results.json"
CSV: dict[int | str, dict[str, Any]] = {200: {"content": {"text/csv": {"schema": {"type": "string"}}}}}

router = APIRouter(prefix="/api/v1/batches", responses=PROBLEM_RESPONSES, tags=["batches"])


class BatchItem(BaseModel):
    """A recording and its own settings."""

    model_config = ConfigDict(extra="forbid")

    recording_id: str
    settings: dict[str, Any] | None = None


class BatchWish(BaseModel):
    """The recordings to analyse and their common settings; an item's own settings take precedence."""

    model_config = ConfigDict(extra="forbid")

    name: Annotated[str, Field(max_length=200)] = ""
    settings: AnalysisSettings = AnalysisSettings()
    items: Annotated[list[BatchItem], Field(min_length=1, max_length=10_000)]
    again: Annotated[bool, Field(description="Analyse again even if the same analysis exists.")] = False


class BatchCounts(BaseModel):
    """How many analyses are in each state."""

    queued: int
    running: int
    succeeded: int
    failed: int
    cancelled: int


class BatchView(BaseModel):
    """A batch: its progress and the links of its tables."""

    id: str
    name: str
    item_count: Annotated[int, Field(description="Analyses in it; duplicates count once.")]
    duplicate_count: Annotated[
        int,
        Field(description="Items without a new analysis: duplicates and existing analyses."),
    ]
    counts: BatchCounts
    is_over: bool
    created_at: str
    links: dict[str, str]


class BatchQuery(BaseModel):
    """The page of the list."""

    model_config = ConfigDict(extra="forbid")

    limit: Annotated[int, Field(ge=1, le=100)] = 100
    cursor: str = ""


class BatchList(BaseModel):
    """A page of batches, newest first; ``next_cursor`` requests the next page, null on the last one."""

    items: list[BatchView]
    next_cursor: str | None


@router.get("")
def list_batches(
    request: Request, answer: Response, services: UsedServices, asked: Annotated[BatchQuery, Query()]
) -> BatchList:
    """Return the newest batches with their progress; studies are batches with a name."""
    found = services.batches.find_page(asked.limit + 1, read_cursor(asked.cursor))
    shown, following = cut_page(
        found, asked.limit, lambda batch: (batch.created_at, batch.id), request, answer
    )
    return BatchList(items=[view_batch(batch) for batch in shown], next_cursor=following)


@router.post("", status_code=202)
def create_batch(body: BatchWish, services: UsedServices, language: UsedLanguage) -> BatchView:
    """Analyse many stored recordings; the same bytes with the same settings are not analysed twice."""
    check_queue(services, len(body.items))
    items, stated = [], dict[str, tuple[StoredRow, AnalysisSettings]]()
    for item in body.items:
        row = services.recordings.get(item.recording_id)
        merged = body.settings.model_dump(exclude_unset=True) | (item.settings or {})
        settings = validate_model(AnalysisSettings, merged)
        if needs_cut(settings.shift):
            raise BadParameter(name="shift", value=settings.shift, allowed=INTERVAL_HINT)
        items.append((row, build_request(row, settings, language, services.settings)))
        stated.setdefault(row.id, (row, settings))
    batch = services.batches.add(body.name, items, again=body.again)
    for row, settings in stated.values():
        complete_description(services, row, settings)
    headers = {"Location": f"/api/v1/batches/{batch.id}", "Retry-After": "5"}
    return JSONResponse(view_batch(batch).model_dump(), 202, headers)  # type: ignore[return-value]


@router.get("/{batch_id}")
def get_batch(batch_id: str, services: UsedServices) -> BatchView:
    """Return the progress of a batch."""
    return view_batch(services.batches.get(batch_id))


@router.get("/{batch_id}/summary.csv", responses=CSV, response_class=Response)
def get_batch_summary(batch_id: str, services: UsedServices) -> Response:
    """Return one row per recording, including failed ones, once the batch is over."""
    rows: list[Row] = []
    for job in _find_ended(services, batch_id):
        if job.request.reference is not None:
            continue
        origin = _build_origin(job)
        if job.state is not JobState.SUCCEEDED:
            rows.append(summarise_failure(origin, job.problem_code or CANCELLED))
            continue
        try:
            results = load_results(services.results.read(job, RESULTS))
            rows.append(summarise_results(add_origin(results, origin)))
        except ResultDamaged as damaged:
            rows.append(summarise_failure(origin, damaged.code))
    return respond_with_file(encode_rows("summary", rows), MEDIA_TYPES["csv"], "summary.csv")


@router.get("/{batch_id}/problems.csv", responses=CSV, response_class=Response)
def get_batch_problems(batch_id: str, services: UsedServices, language: UsedLanguage) -> Response:
    """Return the recordings without a result or with a damaged one, and what to do about each."""
    rows: list[Row] = []
    for job in _find_ended(services, batch_id):
        if job.state is not JobState.SUCCEEDED:
            code, facts = job.problem_code or CANCELLED, job.problem_facts
            rows.append(build_problem_row(_build_origin(job), code, facts, language))
        elif _is_damaged(services, job):
            rows.append(
                build_problem_row(_build_origin(job), ResultDamaged.code, {"name": RESULTS}, language)
            )
    return respond_with_file(encode_rows("problems", rows), MEDIA_TYPES["csv"], "problems.csv")


@router.post("/{batch_id}/retry-failed", status_code=202)
def retry_failed(batch_id: str, services: UsedServices) -> BatchView:
    """Repeat the analyses of a batch that failed, or whose result is missing or damaged."""
    batch = services.batches.get(batch_id)
    damaged = [job for job in services.batches.find_jobs(batch_id) if _is_damaged(services, job)]
    check_queue(services, batch.counts[JobState.FAILED] + len(damaged))
    for job in damaged:
        if can_regenerate(services.store, services.storage, job):
            services.store.repeat(job, "api")
    services.batches.retry_failed(batch_id)
    return view_batch(services.batches.get(batch_id))


SAME = ("id", "name", "item_count", "duplicate_count", "is_over", "created_at")


def view_batch(batch: Batch) -> BatchView:
    """Build the view of a batch."""
    own = f"/api/v1/batches/{batch.id}"
    parts = {"summary_csv": "summary.csv", "problems_csv": "problems.csv", "retry_failed": "retry-failed"}
    return BatchView(
        **{name: getattr(batch, name) for name in SAME},
        counts=BatchCounts(**{state.value: number for state, number in batch.counts.items()}),
        links={"self": own, "analyses": f"/api/v1/analyses?batch_id={batch.id}"}
        | {name: f"{own}/{part}" for name, part in parts.items()},
    )


def _find_ended(services: Services, batch_id: str) -> tuple[Job, ...]:
    """Return the analyses of a finished batch; a partial table could be mistaken for a complete one."""
    batch = services.batches.get(batch_id)
    if not batch.is_over:
        done = batch.item_count - batch.counts[JobState.QUEUED] - batch.counts[JobState.RUNNING]
        raise NotFinished(state=f"{done}/{batch.item_count}")
    return services.batches.find_jobs(batch_id)


def _is_damaged(services: Services, job: Job) -> bool:
    """Return whether results.json of an analysis is damaged; checking all files here would take too long."""
    file = services.store.find_file(job.id, RESULTS) if job.state is JobState.SUCCEEDED else None
    return file is not None and not is_result_whole(services.storage, job.id, str(job.token), file)


def _build_origin(job: Job) -> Origin:
    """Return the origin of a row; the paths distinguish recordings with the same name."""
    return Origin(
        job.file_name,
        job.request.subject,
        job.request.side,
        path=f"/api/v1/recordings/{job.recording_id}",
        folder=f"/api/v1/analyses/{job.id}",
        settings=format_stated(job.request),
    )
