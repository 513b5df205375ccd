"""What a finished analysis says on its page, and what a correction has changed."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from app.api.results import read_result
from app.api.services import Services
from app.errors import NoSuchFile, ResultDamaged
from app.jobs.job import Job, JobState
from app.report.wording import Language
from app.request import ReportRequest
from app.web.clock_times import DayClock
from app.web.damage import show_damage
from app.web.day_routes import find_day
from app.web.day_views import DayView, show_day, show_hours
from app.web.others import list_offers
from app.web.versions import History
from app.web.views import Fact, read_results, show_answer, show_figures, show_settings
from fusion.recording import MICROSECONDS

ALWAYS_DIFFER = frozenset({"added", "id", "size", "sha256"})

Row = tuple[str, str, str]


@dataclass(frozen=True, slots=True)
class Changes:
    """Figures and settings before and after a correction; no figures until both are there."""

    id: str
    versions: tuple[int, int]
    reason: str
    figures: tuple[Row, ...]
    settings: tuple[Row, ...]


def read_answer(services: Services, job: Job, wish: ReportRequest, language: Language) -> dict[str, Any]:
    """Give answer, hours and day of a finished analysis, or none; its form shows what is wished of it.

    Where a file is damaged, what is read before it is shown, and the damage is named.
    """
    shown: dict[str, Any] = {"answer": None, "hours": [], "day": None, "offers": (), "damage": None}
    try:
        results = find_results(services, job)
        if results is None:
            return shown
        brief = read_result(services, job, f"answer.{language}.txt").decode()
        shown["answer"] = show_answer(results, brief, language)
        shown["hours"] = show_hours(results, language)
        shown["offers"] = list_offers(
            services, job, results.get("recording", {}).get("start") or "", language
        )
        shown["day"] = _show_day(services, job, wish, language)
    except ResultDamaged as damaged:
        shown["damage"] = show_damage(services, damaged.facts, language)
    return shown


def show_changes(
    services: Services, history: History, job: Job, before_id: str, language: Language
) -> Changes | None:
    """Set an analysis beside the one that it corrects, or else beside the version before it."""
    asked = (other for other in history.jobs if other.id == before_id)
    before = next(asked, history.find_before(job))
    if before is None or job.state is JobState.FAILED:
        return None
    clock = find_clock(services, history)
    try:
        first, second = (find_results(services, each) for each in (before, job))
    except ResultDamaged:  # the page of the damaged one says so
        return None
    figures: tuple[Row, ...] = ()
    if first is not None and second is not None:
        figures = _pair(show_figures(first, language), show_figures(second, language))
    settings = _pair(show_settings(before, clock, language), show_settings(job, clock, language))
    versions = (before.request.version, job.request.version)
    differ = tuple(row for row in settings if row[1] != row[2])
    return Changes(before.id, versions, job.request.reason, figures, differ)


def find_clock(services: Services, history: History) -> DayClock | None:
    """Give the clock of the recording, as its newest report that can be read tells it."""
    for report in history.reports:
        with suppress(ResultDamaged):
            return _read_clock(find_results(services, report))
    return None


def _read_clock(results: Mapping[str, Any] | None) -> DayClock | None:
    if results is None:
        return None
    start = results.get("recording", {}).get("start")
    duration_us = round(results["time"]["recorded_s"] * MICROSECONDS)
    return DayClock(datetime.fromisoformat(start) if start else None, duration_us)


def find_results(services: Services, job: Job) -> Mapping[str, Any] | None:
    """Read ``results.json`` of a finished analysis.

    Raises
    ------
    ResultDamaged
    """
    if job.state is not JobState.SUCCEEDED or job.token is None:
        return None
    return read_results(read_result(services, job, "results.json"))


def _pair(before: tuple[Fact, ...], after: tuple[Fact, ...]) -> tuple[Row, ...]:
    return tuple(
        (new.label, old.value, new.value)
        for old, new in zip(before, after, strict=True)
        if new.key not in ALWAYS_DIFFER
    )


def _show_day(services: Services, job: Job, wish: ReportRequest, language: Language) -> DayView | None:
    """Leave the day out, and nothing else, where an older version has written none."""
    try:
        return show_day(find_day(services, job), wish, language)
    except NoSuchFile:
        return None
