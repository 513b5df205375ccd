"""Pages of batches that scripts have asked for: which there are, and what became of each analysis of one."""

from dataclasses import replace
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from app.api.batches import retry_failed
from app.jobs.batches import Batch
from app.jobs.job import JobState
from app.report.words.wording import Language, fill, load_wording
from app.services import UsedLanguage, UsedServices
from app.web.library_views import read_filter, show_library
from app.web.rendering import find_base, show_page
from app.web.views import tell_moment

SHOWN = 200

router = APIRouter(include_in_schema=False, prefix="/batches")


@router.get("")
def list_batches(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """List the batches, the newest first."""
    rows = [_tell_batch(batch, language) for batch in services.batches.find_newest(SHOWN)]
    return show_page(request, "batches.html", language, {"rows": rows, "w": _load_words(language)})


@router.get("/{batch_id}")
def show_batch(batch_id: str, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show one batch: counts by state, every analysis, its tables."""
    batch = services.batches.get(batch_id)
    wanted = replace(read_filter(request), batch=batch.id)
    values = show_library(services, request, wanted, language)
    values |= {"batch": batch, "told": _tell_batch(batch, language), "w": _load_words(language)}
    return show_page(request, "batch.html", language, values | {"failed": batch.counts[JobState.FAILED]})


@router.post("/{batch_id}/retry")
def retry_batch(batch_id: str, request: Request, services: UsedServices) -> Response:
    """Analyse anew what failed (a plain form, so that it needs no script)."""
    retry_failed(batch_id, services)
    return RedirectResponse(f"{find_base(request)}/batches/{batch_id}", status_code=303)


def _load_words(language: Language) -> dict[str, Any]:
    words: dict[str, Any] = load_wording(language, "page")["batches"]
    return words


def _tell_batch(batch: Batch, language: Language) -> dict[str, str]:
    words = _load_words(language)
    counts = {state.value: str(number) for state, number in batch.counts.items() if number}
    return {
        "id": batch.id,
        "name": batch.name or words["unnamed"],
        "when": tell_moment(batch.created_at),
        "counts": fill(words["counts"], {"all": str(batch.item_count)} | counts),
    }
