"""Pages of the studies: all of them, and each with its recordings. A script's batch is one, too."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Response

from app.api.library.analyses import check_queue
from app.api.library.batches import retry_failed
from app.batch.folder import Task
from app.batch.inputs import assign_participants
from app.jobs.batches import Batch
from app.jobs.job import Job, JobState
from app.report.words.wording import fill
from app.services import UsedServices
from app.web.forms import read_body
from app.web.recording.day import say_whose
from app.web.rendering import Page, UsedPage
from app.web.validations import list_compared
from app.web.views import build_library, format_compared, format_moment, read_filter

SHOWN = 200
MOST_SQUARES = 2_000

router = APIRouter(include_in_schema=False, prefix="/batches")


@dataclass(frozen=True, slots=True)
class Square:
    """A recording at a glance: its state, or the verdict on its data, and that in words."""

    id: str
    state: str
    title: str


@router.get("")
def show_batches(page: UsedPage) -> Response:
    """List the batches, the newest first."""
    rows = [_describe_batch(page, batch) for batch in page.services.batches.find_newest(SHOWN)]
    return page.render("batches.html", rows=rows)


@router.get("/{batch_id}")
def show_batch(batch_id: str, page: UsedPage) -> Response:
    """Show one batch: counts by state, every analysis, its tables."""
    batch = page.services.batches.get(batch_id)
    jobs = page.services.batches.find_jobs(batch_id)
    return page.render(
        "batch.html",
        **build_library(page, replace(read_filter(page.request), batch=batch.id)),
        batch=batch,
        told=_describe_batch(page, batch),
        squares=_draw_squares(page, batch_id, jobs),
        compared=list_compared(page, jobs),
        has_reports=any(j.state is JobState.SUCCEEDED and j.request.reference is None for j in jobs),
        failed=batch.counts[JobState.FAILED],
    )


@router.post("/{batch_id}/retry")
def retry_batch(batch_id: str, page: UsedPage) -> Response:
    """Analyse anew what failed (a plain form, so that it needs no script)."""
    retry_failed(batch_id, page.services)
    return page.go(f"/batches/{batch_id}")


@router.post("/{batch_id}/participants")
def take_participants(
    batch_id: str, services: UsedServices, content: Annotated[bytes, Depends(read_body)]
) -> dict[str, Any]:
    """Read a list of participants, and analyse again every recording of which it says something else.

    Gives how many are analysed again (``changed``) and the files of the list that the study does not have.
    """
    every = services.batches.find_jobs(services.batches.get(batch_id).id)
    jobs = [job for job in every if job.request.reference is None]
    tasks = [Task(Path(job.recording_id, job.file_name), job.request, Path()) for job in jobs]
    assigned, unknown = assign_participants(tasks, content, None)
    changed = [
        (job, task.request) for job, task in zip(jobs, assigned, strict=True) if task.request != job.request
    ]
    check_queue(services, len(changed))
    for job, asked in changed:
        say_whose(services, job, asked, ("subject", "side"))
    return {"changed": services.store.repeat_all(changed), "unknown": [row.file for row in unknown]}


def _draw_squares(page: Page, batch_id: str, jobs: Sequence[Job]) -> list[Square]:
    words, verdicts = page.words(), page.services.batches.find_verdicts(batch_id)
    squares = []
    for job in jobs[:MOST_SQUARES]:
        name = format_compared(job, words) or job.request.subject or job.file_name
        state, told = job.state.value, words["state"][job.state.value]
        if job.state is JobState.SUCCEEDED and (verdict := verdicts.get(job.id, "")):
            state, told = verdict, words["verdict_short"][verdict]
        squares.append(Square(job.id, state, f"{name}: {told}"))
    return squares


def _describe_batch(page: Page, batch: Batch) -> dict[str, str]:
    """Return the id of a study, its name, when it was made, and how many analyses are in each state."""
    words = page.words()["batches"]
    counts = {state.value: str(number) for state, number in batch.counts.items() if number}
    told = fill(words["counts"], {"all": str(sum(batch.counts.values()))} | counts)
    name, when = batch.name or words["unnamed"], format_moment(batch.created_at)
    return {"id": batch.id, "name": name, "when": when, "counts": told}
