"""The pages. They show what the job rows say; the browser's own script only sends files and asks again."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from pydantic import BaseModel

from app.api.files import read_result
from app.api.problems import Refusal
from app.errors import NoSuchFile, NotHere, ResultDamaged, StoreDamaged, find_outcome_of_code
from app.jobs.job import Job, JobState
from app.jobs.library import Entry
from app.jobs.regeneration import can_regenerate
from app.jobs.regeneration import retry as retry_job
from app.jobs.store import JobFilter
from app.report.words.messages import Fact as ProblemFact
from app.report.words.messages import Problem, describe_problem
from app.report.words.wording import Language, fill, load_wording
from app.request import ReportRequest
from app.services import Services, UsedLanguage, UsedServices, choose_language, find_services
from app.storage.store import StoredRecording, seems_whole
from app.web.day import find_day
from app.web.day_views import DayClock, DayView, show_day, show_hours
from app.web.library_views import find_neighbours, read_filter, show_entry, show_library
from app.web.pairs import list_offers
from app.web.rendering import find_base, show_page
from app.web.views import (
    Fact,
    JobRow,
    format_size,
    now_utc,
    read_results,
    show_answer,
    show_figures,
    show_row,
    show_settings,
    tell_time,
)
from fusion.errors import (
    ExchangedSensors,
    MixedColumns,
    UnknownColumns,
    UnknownFormat,
    UnknownRate,
    UnusableProfile,
    UnusableTime,
    WrongScale,
)
from fusion.recording import MICROSECONDS

# The versions of a recording's report, what each changed, and the attempt after them that failed.


SHOWN = 200


@dataclass(frozen=True, slots=True)
class VersionRow:
    """One version; ``changed`` says what is different from the one before, ``reason`` what a person said."""

    id: str
    name: str
    when: str
    changed: str
    reason: str
    is_this: bool


@dataclass(frozen=True, slots=True)
class History:
    """Every analysis of one recording, the newest first."""

    jobs: tuple[Job, ...]

    @classmethod
    def of(cls, services: Services, job: Job) -> "History":
        """Read it; comparisons with a reference are no reports."""
        found = services.store.find_page(JobFilter(recording_id=job.recording_id), SHOWN)
        return cls(tuple(other for other in found if other.request.reference is None))

    @property
    def reports(self) -> tuple[Job, ...]:
        """Those that have a report, but for damaged ones that were analysed again."""
        return tuple(job for job in self.jobs if job.state is JobState.SUCCEEDED and job.replaced_by is None)

    def find_before(self, job: Job) -> Job | None:
        """Give the version before the one that an analysis is or would be."""
        earlier = [other for other in self.reports if other.request.version < job.request.version]
        return max(earlier, key=lambda other: (other.request.version, other.created_at), default=None)

    def find_failed(self) -> Job | None:
        """Give the newest analysis that counts if it failed, and with it what the person wanted."""
        newest = next((job for job in self.jobs if job.replaced_by is None), None)
        return newest if newest is not None and newest.state is JobState.FAILED else None

    def find_report(self) -> Job | None:
        """Give the newest report."""
        return self.reports[0] if self.reports else None


def list_versions(history: History, shown: Job, language: Language) -> tuple[VersionRow, ...]:
    """List what can be opened, the newest first; nothing where there is but the one that is shown.

    A version that was computed more than once is there once: the one that is shown, or else the newest.
    """
    first = (shown, *history.reports) if shown.state is JobState.SUCCEEDED else history.reports
    found: dict[int, Job] = {}
    for job in first:
        found.setdefault(job.request.version, job)
    rows = tuple(_show_version(found[number], shown, language) for number in sorted(found, reverse=True))
    return () if all(row.is_this for row in rows) else rows


def show_failed(history: History, shown: Job, language: Language) -> JobRow | None:
    """Show the attempt that failed after an analysis that has a report."""
    failed = history.find_failed()
    if failed is None or failed.created_at <= shown.created_at:
        return None
    return show_row(failed, language, now_utc())


def tell_version(number: int, language: Language) -> str:
    """Write "version 2"."""
    return fill(load_wording(language, "page")["row"]["version"], {"n": str(number)})


def tell_changes(job: Job, language: Language) -> str:
    """Name what is different from the version before, as the report's first page does."""
    names = load_wording(language)["changed"]
    return ", ".join(str(names.get(name, name)) for name in job.request.changes)


def _show_version(job: Job, shown: Job, language: Language) -> VersionRow:
    name, changed = tell_version(job.request.version, language), tell_changes(job, language)
    return VersionRow(
        job.id, name, tell_time(job.created_at), changed, job.request.reason, job.id == shown.id
    )


# What a page says where a stored file is damaged or missing, and what a person can do about it there.


@dataclass(frozen=True, slots=True)
class Damage:
    """A damaged analysis: ``again`` is the one that replaces it, "" where there is none.

    ``source`` says that the recording is damaged, too: then analysing again cannot help.
    """

    id: str
    name: str
    words: Problem
    code: str
    again: str
    source: Problem | None


def show_damage(services: Services, facts: Mapping[str, ProblemFact], language: Language) -> Damage | None:
    """Show what ResultDamaged tells; None where the analysis is gone by now."""
    try:
        job = services.store.get(str(facts.get("analysis", "")))
    except NotHere:
        return None
    code = ResultDamaged.code
    words = describe_problem(code, {"name": facts["name"]}, language)
    is_source_whole = job.replaced_by is not None or can_regenerate(services.store, services.storage, job)
    source = None if is_source_whole else describe_problem(StoreDamaged.code, {}, language)
    return Damage(job.id, job.file_name, words, code, job.replaced_by or "", source)


def describe_source(services: Services, job: Job, language: Language) -> Problem | None:
    """Say that the recording of an analysis is damaged or missing; None where it seems whole."""
    if seems_whole(services.storage, StoredRecording(job.recording_id, job.sha256, job.size_bytes)):
        return None
    return describe_problem(StoreDamaged.code, {}, language)


# What a finished analysis says on its page, and what a correction has changed.


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


ASK_COLUMNS = frozenset(
    refusal.code
    for refusal in (
        MixedColumns,
        ExchangedSensors,
        UnknownColumns,
        UnknownRate,
        WrongScale,
        UnusableTime,
        UnknownFormat,
        UnusableProfile,
    )
)
"""Refusals that a person may cure by saying what the columns are."""


class Seen(BaseModel):
    """Where a person came from: the analysis that was corrected, or the attempt whose settings are shown."""

    before: str = ""
    attempt: str = ""


router = APIRouter(default_response_class=HTMLResponse, include_in_schema=False)


@router.get("/")
def home(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show the place to drop files, and the recordings."""
    limit_bytes = services.settings.max_upload_bytes
    values = show_library(services, request, read_filter(request), language)
    values |= {"max_bytes": limit_bytes, "max_size": format_size(limit_bytes, language)}
    values |= {
        "devices": dict(load_wording(language)["device"]),
        "has_batches": bool(services.batches.find_newest(1)),
        "address": str(request.base_url).rstrip("/"),
        "quarantined": str(len(services.quarantine.names) or ""),
    }
    return show_page(request, "home.html", language, values)


@router.get("/rows")
def rows(request: Request, services: UsedServices, language: UsedLanguage, only: str = "") -> Response:
    """Give the list alone, for a page that is open already; ``only`` one analysis if named."""
    if only:
        entries = [show_entry(Entry(services.store.get(only), None), language)]
        values = {"entries": entries, "is_empty": False, "count": "", "query": ""}
    else:
        values = show_library(services, request, read_filter(request), language)
    return show_page(request, "rows.html", language, values)


@router.get("/analyses/{analysis_id}")
def analysis(
    analysis_id: str,
    request: Request,
    services: UsedServices,
    language: UsedLanguage,
    seen: Annotated[Seen, Query()],
) -> Response:
    """Show one analysis: its state or its answer, its files, its day, its versions."""
    job = services.store.get(analysis_id)
    if job.request.reference is not None:
        return RedirectResponse(f"{find_base(request)}/validations/{job.id}", status_code=303)
    if job.state is JobState.SUCCEEDED and job.replaced_by is not None:  # it was damaged, and analysed again
        return RedirectResponse(f"{find_base(request)}/analyses/{job.replaced_by}", status_code=303)
    history = History.of(services, job)
    attempt = next((other for other in history.jobs if other.id == seen.attempt != job.id), None)
    wish = attempt.request if attempt else job.request
    report = history.find_report()
    values = {
        "row": show_row(job, language, now_utc()),
        "settings": show_settings(job, find_clock(services, history), language),
        "job_request": wish,
        "reason": wish.reason if attempt else "",
        "is_attempt": attempt is not None,
        "entry": show_entry(Entry(job, None), language),
        "d": load_wording(language, "day"),
        "b": load_wording(language, "pair_pages"),
        "c": load_wording(language, "columns"),
        "asks_columns": job.problem_code in ASK_COLUMNS,
        "changes": show_changes(services, history, job, seen.before, language),
        "recording_id": job.recording_id,
        "source": describe_source(services, job, language),
        "versions": list_versions(history, job, language),
        "failed": show_failed(history, job, language),
        "report": report if report is not None and report.id != job.id else None,
        **find_neighbours(services, request, job),
        **read_answer(services, job, wish, language),
    }
    return show_page(request, "analysis.html", language, values)


@router.post("/analyses/{analysis_id}/cancel")
def cancel(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Stop an analysis (a plain form, so that it needs no script)."""
    services.store.cancel(analysis_id)
    return RedirectResponse(f"{find_base(request)}/", status_code=303)


@router.post("/analyses/{analysis_id}/retry")
def retry(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Ask for the same analysis once more; the recording is kept, whatever became of the last one."""
    again = retry_job(services.store, services.storage, analysis_id, "web")
    if again.state is JobState.SUCCEEDED:  # a report is there, but not all that this version makes
        again = services.store.add_analysis((again.recording_id, again.sha256), again.request, "web")
    return RedirectResponse(f"{find_base(request)}/analyses/{again.id}", status_code=303)


@router.post("/analyses/{analysis_id}/withdraw")
def withdraw(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Leave the report as it is: the attempt after it that failed counts no more."""
    report = services.store.withdraw(analysis_id)
    return RedirectResponse(f"{find_base(request)}/analyses/{report.id}", status_code=303)


def answer_with_page(request: Request, error: Refusal) -> HTMLResponse:
    """Show a refusal as a page of its own; that of a damaged report offers to analyse again."""
    language = choose_language(request)
    values: dict[str, Any] = {"problem": describe_problem(error.code, error.facts, language)}
    values |= {"code": error.code, "damage": None}
    if error.code == ResultDamaged.code:
        values["damage"] = show_damage(find_services(request), error.facts, language)
    return show_page(request, "error.html", language, values, find_outcome_of_code(error.code).status)
