"""Pages of the studies: all of them, and each with its recordings. A script's batch is one, too."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request, Response
from fastapi.responses import RedirectResponse

from app.api.library.analyses import check_queue
from app.api.library.batches import retry_failed
from app.batch.folder import Task
from app.batch.inputs import assign_participants
from app.jobs.batches import Batch
from app.jobs.job import Job, JobState
from app.report.words.wording import Language, fill, load_wording
from app.services import Services, UsedLanguage, UsedServices
from app.web.forms import read_body
from app.web.library_views import build_library, read_filter
from app.web.recording.day import say_whose
from app.web.rendering import find_base, render_page
from app.web.validations import list_compared
from app.web.views import format_compared, format_moment

SHOWN = 200

router = APIRouter(include_in_schema=False, prefix="/batches")


@router.get("")
def show_batches(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """List the batches, the newest first."""
    rows = [_describe_batch(batch, language) for batch in services.batches.find_newest(SHOWN)]
    return render_page(request, "batches.html", language, {"rows": rows, "w": _load_words(language)})


@router.get("/{batch_id}")
def show_batch(batch_id: str, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show one batch: counts by state, every analysis, its tables."""
    batch = services.batches.get(batch_id)
    wanted = replace(read_filter(request), batch=batch.id)
    values = build_library(services, request, wanted, language)
    values |= {"batch": batch, "told": _describe_batch(batch, language), "w": _load_words(language)}
    jobs = services.batches.find_jobs(batch_id)
    values |= {
        "squares": _draw_squares(services, batch_id, jobs, language),
        "compared": list_compared(services, jobs, language),
        "has_reports": any(j.state is JobState.SUCCEEDED and j.request.reference is None for j in jobs),
        "failed": batch.counts[JobState.FAILED],
    }
    return render_page(request, "batch.html", language, values)


@router.post("/{batch_id}/retry")
def retry_batch(batch_id: str, request: Request, services: UsedServices) -> Response:
    """Analyse anew what failed (a plain form, so that it needs no script)."""
    retry_failed(batch_id, services)
    return RedirectResponse(f"{find_base(request)}/batches/{batch_id}", status_code=303)


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


@dataclass(frozen=True, slots=True)
class Square:
    """A recording at a glance: its state, or the verdict on its data, and that in words."""

    id: str
    state: str
    title: str


MOST_SQUARES = 2_000


def _draw_squares(
    services: Services, batch_id: str, jobs: Sequence[Job], language: Language
) -> tuple[Square, ...]:
    words = load_wording(language, "page")
    verdicts = services.batches.find_verdicts(batch_id)

    def draw(job: Job) -> Square:
        name, verdict = job.request.subject or job.file_name, verdicts.get(job.id, "")
        name = format_compared(job, words) or name
        if job.state is not JobState.SUCCEEDED or not verdict:
            return Square(job.id, job.state.value, f"{name}: {words['state'][job.state.value]}")
        return Square(job.id, verdict, f"{name}: {words['verdict_short'][verdict]}")

    return tuple(map(draw, jobs[:MOST_SQUARES]))


def _load_words(language: Language) -> dict[str, Any]:
    words: dict[str, Any] = load_wording(language, "page")["batches"]
    return words


def _describe_batch(batch: Batch, language: Language) -> dict[str, str]:
    words = _load_words(language)
    counts = {state.value: str(number) for state, number in batch.counts.items() if number}
    return {
        "id": batch.id,
        "name": batch.name or words["unnamed"],
        "when": format_moment(batch.created_at),
        "counts": fill(words["counts"], {"all": str(sum(batch.counts.values()))} | counts),
    }
