"""What a finished analysis says on its page, and what a correction has changed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from app.api.services import Services
from app.errors import NoSuchFile, NotHere
from app.jobs.job import Job, JobState
from app.report.wording import Language
from app.storage import borrow_result
from app.web.day_routes import find_day
from app.web.day_views import DayView, show_day, show_hours
from app.web.others import list_offers
from app.web.views import Fact, read_results, show_answer, show_figures, show_settings

ALWAYS_DIFFER = frozenset({"added", "id", "size", "sha256"})

Row = tuple[str, str, str]


@dataclass(frozen=True, slots=True)
class Changes:
    """Figures and settings before and after a correction; no figures until both are there."""

    id: str
    figures: tuple[Row, ...]
    settings: tuple[Row, ...]


def read_answer(services: Services, job: Job, language: Language) -> dict[str, Any]:
    """Give answer, hours and day of a finished analysis, or none of them."""
    results = find_results(services, job)
    if results is None:
        return {"answer": None, "hours": [], "day": None, "offers": ()}
    brief = _read_file(services, job, f"answer.{language}.txt").decode()
    return {
        "answer": show_answer(results, brief, language),
        "hours": show_hours(results, language),
        "day": _show_day(services, job, language),
        "offers": list_offers(services, job, results.get("recording", {}).get("start") or "", language),
    }


def show_changes(services: Services, job: Job, before_id: str, language: Language) -> Changes | None:
    """Set an analysis beside the one that it corrects."""
    try:
        before = services.store.get(before_id) if before_id else None
    except NotHere:
        before = None
    if before is None or before.recording_id != job.recording_id:
        return None
    first, second = (find_results(services, each) for each in (before, job))
    figures: tuple[Row, ...] = ()
    if first is not None and second is not None:
        figures = _pair(show_figures(first, language), show_figures(second, language))
    settings = _pair(show_settings(before, language), show_settings(job, language))
    return Changes(before.id, figures, tuple(row for row in settings if row[1] != row[2]))


def find_results(services: Services, job: Job) -> Mapping[str, Any] | None:
    """Read ``results.json`` of a finished analysis."""
    if job.state is not JobState.SUCCEEDED or job.token is None:
        return None
    return read_results(_read_file(services, job, "results.json"))


def _pair(before: tuple[Fact, ...], after: tuple[Fact, ...]) -> tuple[Row, ...]:
    return tuple(
        (new.label, old.value, new.value)
        for old, new in zip(before, after, strict=True)
        if new.key not in ALWAYS_DIFFER
    )


def _show_day(services: Services, job: Job, language: Language) -> DayView | None:
    """Leave the day out, and nothing else, where an older version has written none."""
    try:
        return show_day(find_day(services, job), job, language)
    except NoSuchFile:
        return None


def _read_file(services: Services, job: Job, name: str) -> bytes:
    with borrow_result(services.storage, job.id, str(job.token), name) as path:
        return path.read_bytes()
