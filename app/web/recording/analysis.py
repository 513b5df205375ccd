"""Pages of the recordings and of one analysis, built from the job rows."""

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from pydantic import BaseModel

from app.api.middleware.access import find_subject, may
from app.api.middleware.callers import find_origin
from app.api.middleware.problems import Refusal
from app.api.names import find_names, find_person_name
from app.errors import NoSuchFile, NotHere, ResultDamaged, StoreDamaged, find_outcome_of_code
from app.jobs.job import Job, JobState
from app.jobs.library.listing import Entry
from app.jobs.recordings import StoredRow
from app.jobs.results import can_regenerate
from app.jobs.results import retry as retry_job
from app.jobs.store import JobFilter
from app.report.figures import load_results
from app.report.words.messages import Fact as ProblemFact
from app.report.words.messages import Problem, describe_problem
from app.report.words.numbers import format_percent
from app.report.words.wording import Language, fill, find_nearest, load_device_names, load_wording
from app.request import ReportRequest
from app.services import Services, UsedLanguage, UsedServices, choose_language, find_services
from app.storage.store import StoredRecording, seems_whole
from app.web.library_views import build_entry, build_library, find_neighbours, find_took, read_filter
from app.web.pairs import find_offers
from app.web.profile import find_days_address
from app.web.recording.columns import find_offer
from app.web.recording.conclusion import build_conclusion
from app.web.recording.day import find_day
from app.web.recording.day_views import DayClock, build_day, build_hours, list_axes
from app.web.recording.page_one import read_page_one
from app.web.rendering import find_base, render_page
from app.web.trust import build_release
from app.web.views import (
    Fact,
    build_answer,
    build_figures,
    build_row,
    build_settings,
    describe_old,
    format_size,
    format_time,
    format_times,
    format_windows,
    now_utc,
)
from fusion.errors import SeveralSensors
from fusion.pose.rules import WINDOW_FAULTS
from fusion.recording import MICROSECONDS

# The versions of a recording's report, the changes in each, and a later attempt that failed.


SHOWN = 200


@dataclass(frozen=True, slots=True)
class VersionRow:
    """One version; ``changed`` says what is different from the one before, ``reason`` is the person's own."""

    id: str
    name: str
    when: str
    changed: str
    reason: str
    is_this: bool
    who: str = ""


@dataclass(frozen=True, slots=True)
class History:
    """Every analysis of one recording, the newest first."""

    jobs: tuple[Job, ...]

    @classmethod
    def of(cls, services: Services, job: Job) -> "History":
        """Read it, without comparisons with a reference, which are no reports."""
        found = services.store.find_page(JobFilter(recording_id=job.recording_id), SHOWN)
        return cls(tuple(other for other in found if other.request.reference is None))

    @property
    def reports(self) -> tuple[Job, ...]:
        """Those that have a report, but for damaged ones that were analysed again."""
        return tuple(job for job in self.jobs if job.state is JobState.SUCCEEDED and job.replaced_by is None)

    def find_failed(self, shown: Job) -> Job | None:
        """Find the newest analysis that counts, if it failed after the one shown: the person wanted it."""
        newest = next((job for job in self.jobs if job.replaced_by is None), None)
        is_later = newest is not None and newest.created_at > shown.created_at
        return newest if newest is not None and is_later and newest.state is JobState.FAILED else None

    def find_report(self) -> Job | None:
        """Find the newest report."""
        return self.reports[0] if self.reports else None


def build_versions(
    history: History, shown: Job, names: Mapping[str, str], clock: DayClock | None, language: Language
) -> tuple[VersionRow, ...]:
    """Build the rows of the versions, the newest first; none where only ``shown`` exists.

    A version that was computed more than once is there once: the one that is shown, or else the newest.
    """
    name = load_wording(language, "page")["row"]["version"]
    first = (shown, *history.reports) if shown.state is JobState.SUCCEEDED else history.reports
    found: dict[int, Job] = {}
    for job in first:
        found.setdefault(job.request.version, job)
    rows = tuple(
        VersionRow(
            job.id,
            fill(name, {"n": str(job.request.version)}),
            format_time(job.created_at),
            format_changes(job, clock, language),
            job.request.reason,
            job.id == shown.id,
            names.get(job.asked_by, ""),
        )
        for _, job in sorted(found.items(), reverse=True)
    )
    return () if all(row.is_this for row in rows) else rows


def format_changes(job: Job, clock: DayClock | None, language: Language) -> str:
    """Write what differs from the version before, with the times that a person gave."""
    names, request = load_wording(language)["changed"], job.request
    times = {
        "calibration_windows_s": format_windows(request.calibration_windows_s, clock, language),
        "slip_times_s": format_times(request.slip_times_s, clock, language),
        "no_slip_times_s": format_times(request.no_slip_times_s, clock, language),
    }
    told = ((str(names.get(name, name)), times.get(name, "")) for name in request.changes)
    return ", ".join(f"{name} ({time})" if time else name for name, time in told)


# Damaged or missing files: the problem, and what a person can do about it.


@dataclass(frozen=True, slots=True)
class Damage:
    """A damaged analysis: ``again`` is the one that replaces it, "" where there is none.

    ``source``: the recording is damaged, too, so that analysing again cannot help.
    """

    id: str
    name: str
    words: Problem
    code: str
    again: str
    source: Problem | None


def build_damage(services: Services, facts: Mapping[str, ProblemFact], language: Language) -> Damage | None:
    """Show the facts of a ResultDamaged; None where the analysis is gone by now."""
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


# The answer of a finished analysis, and what a correction has changed.


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


def read_answer(services: Services, job: Job, asked: ReportRequest, language: Language) -> dict[str, Any]:
    """Give answer, hours and day of a finished analysis, or none; the form shows ``asked``.

    Where a file is damaged, what is read before it is shown, and the damage is named.
    """
    shown: dict[str, Any] = dict.fromkeys(("answer", "day", "page_one", "damage"))
    shown |= {"hours": [], "offers": (), "days": ""}
    try:
        results = find_results(services, job)
        if results is None:
            return shown
        name = f"answer.{find_nearest(language, job.request.languages)}.txt"
        shown["answer"] = build_answer(results, services.results.read(job, name).decode(), language)
        shown["hours"] = build_hours(results, language)
        start = results.get("recording", {}).get("start") or ""
        shown["offers"] = find_offers(services, job, start, language)
        shown["days"] = find_days_address(services, job)
        day = None
        with suppress(NoSuchFile):
            day = find_day(services, job)
        shown["day"] = build_day(day, asked, language) if day else None
        shown["page_one"] = read_page_one(services, job, day, language)
    except ResultDamaged as damaged:
        shown["damage"] = build_damage(services, damaged.facts, language)
    return shown


def build_changes(
    services: Services, history: History, job: Job, before_id: str, language: Language
) -> Changes | None:
    """Compare an analysis with the one that it corrects, or else with the version before it."""
    earlier = (other for other in history.reports if other.request.version < job.request.version)
    version_before = max(earlier, key=lambda it: (it.request.version, it.created_at), default=None)
    before = next((other for other in history.jobs if other.id == before_id), version_before)
    if before is None or job.state is JobState.FAILED or job.request.changes == ("conclusion",):
        return None
    clock = find_clock(services, history)
    try:
        first, second = (find_results(services, each) for each in (before, job))
    except ResultDamaged:  # the page of the damaged one says so
        return None
    figures: tuple[Row, ...] = ()
    if first is not None and second is not None:
        figures = _pair(build_figures(first, language), build_figures(second, language))
        figures += tuple(pair_tasks(first, second, language))
    settings = _pair(build_settings(before, clock, language), build_settings(job, clock, language))
    versions = (before.request.version, job.request.version)
    differ = tuple(row for row in settings if row[1] != row[2])
    return Changes(before.id, versions, job.request.reason, figures, differ)


def find_clock(services: Services, history: History) -> DayClock | None:
    """Give the clock of the recording by its newest report that can be read."""
    for report in history.reports:
        with suppress(ResultDamaged):
            results = find_results(services, report)
            if results is None:
                return None
            start = results.get("recording", {}).get("start")
            duration_us = round(results["time"]["recorded_s"] * MICROSECONDS)
            return DayClock(datetime.fromisoformat(start) if start else None, duration_us)
    return None


def find_results(services: Services, job: Job) -> Mapping[str, Any] | None:
    """Read ``results.json`` of a finished analysis. Raises ResultDamaged."""
    if job.state is not JobState.SUCCEEDED or job.token is None:
        return None
    return load_results(services.results.read(job, "results.json"))


def _pair(before: tuple[Fact, ...], after: tuple[Fact, ...]) -> tuple[Row, ...]:
    return tuple(
        (new.label, old.value, new.value)
        for old, new in zip(before, after, strict=True)
        if new.key not in ALWAYS_DIFFER
    )


def pair_tasks(before: Mapping[str, Any], after: Mapping[str, Any], language: Language) -> Iterator[Row]:
    """Set the time above 60 deg of each task that either report has side by side; "–" where it is not one."""
    words = load_wording(language, "page")["figure_of_task"]
    earlier, later = (
        {
            part["label"]: format_percent(part.get("time_above_60_percent"), language)
            for part in results["exposure"].get("by_task", ())
            if part["kind"] == "task" and part["label"]
        }
        for results in (before, after)
    )
    for label in dict.fromkeys((*later, *earlier)):
        yield fill(words, {"task": label}), earlier.get(label, "–"), later.get(label, "–")


class Seen(BaseModel):
    """Where a person came from: the analysis that was corrected, or the attempt whose settings are shown."""

    before: str = ""
    attempt: str = ""


router = APIRouter(default_response_class=HTMLResponse, include_in_schema=False)


@router.get("/")
def home(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show the place to drop files, and the recordings."""
    limit_bytes = services.settings.max_upload_bytes
    values = build_library(services, request, read_filter(request), language)
    values |= {"max_bytes": limit_bytes, "max_size": format_size(limit_bytes, language)}
    values |= {
        "devices": load_device_names(language),
        "has_columns": bool(services.mappings.find_all()),
        "has_batches": bool(services.batches.find_newest(1)),
        "address": find_origin(request) + find_base(request),
        "quarantined": str(len(services.quarantine.names) or ""),
    }
    return render_page(request, "home.html", language, values)


@router.get("/rows")
def rows(request: Request, services: UsedServices, language: UsedLanguage, only: str = "") -> Response:
    """Give the list alone, for a page that is open already; ``only`` one analysis if named."""
    if only:
        entry = Entry(services.store.get(only), None)
        entries = [build_entry(entry, language, find_took(services, [entry]))]
        values = {"entries": entries, "is_empty": False, "count": "", "query": ""}
    else:
        values = build_library(services, request, read_filter(request), language)
    return render_page(request, "rows.html", language, values)


@router.get("/analyses/{analysis_id}")
def analysis(
    analysis_id: str,
    request: Request,
    services: UsedServices,
    language: UsedLanguage,
    seen: Annotated[Seen, Query()],
) -> Response:
    """Show one analysis: its state or its answer, files, day, versions; or the way out of the trash."""
    trashed = services.store.find_trashed(analysis_id)
    if trashed is not None:
        return _show_trashed(services.recordings.get(trashed, trashed=True), request, language)
    job = services.store.get(analysis_id)
    if job.request.reference is not None:
        return RedirectResponse(f"{find_base(request)}/validations/{job.id}", status_code=303)
    if job.state is JobState.SUCCEEDED and job.replaced_by is not None:  # it was damaged, and analysed again
        return RedirectResponse(f"{find_base(request)}/analyses/{job.replaced_by}", status_code=303)
    history = History.of(services, job)
    attempt = next((other for other in history.jobs if other.id == seen.attempt != job.id), None)
    clock = find_clock(services, history)
    asked = attempt.request if attempt else job.request
    report, failed = history.find_report(), history.find_failed(job)
    took = find_took(services, [Entry(job, None)])
    subject = find_subject(request)
    own_name = find_person_name(request, subject.id)
    names = find_names(request, (other.asked_by for other in history.jobs), language)
    is_current = report is not None and report.id == job.id
    values = {
        "row": build_row(job, language, now_utc(), took),
        "settings": build_settings(job, clock, language),
        "job_request": asked,
        "reason": asked.reason if attempt else "",
        "attempt_id": attempt.id if attempt else "",
        "entry": build_entry(Entry(job, None), language, took),
        "d": load_wording(language, "day"),
        "why_unusable": {why: load_wording(language)["fact"]["why"][why] for why in WINDOW_FAULTS},
        "b": load_wording(language, "pair_pages"),
        "days_link": load_wording(language, "days")["page"]["link"],
        "c": load_wording(language, "columns"),
        "axes": list_axes(),
        "is_of_sensors": job.problem_code == SeveralSensors.code,
        "offer": find_offer(services, job, str(job.problem_facts.get("header", "")), language),
        "changes": build_changes(services, history, job, seen.before, language),
        "conclusion": build_conclusion(services, job, language, own_name, is_current=is_current),
        "release": build_release(request, services, subject, job.id, language),
        "versions": build_versions(history, job, names, clock, language),
        "tr": load_wording(language, "trail"),
        "recording_id": job.recording_id,
        "source": describe_source(services, job, language),
        "failed": build_row(failed, language, now_utc()) if failed else None,
        "report": None if is_current else report,
        "old": describe_old(job, history.reports, language, find_base(request)),
        **find_neighbours(services, request, job),
        **read_answer(services, job, asked, language),
    }
    return render_page(request, "analysis.html", language, values)


def _show_trashed(row: StoredRow, request: Request, language: Language) -> HTMLResponse:
    values = {"recording": row, "t": load_wording(language, "page")["trash"]}
    return render_page(request, "in_trash.html", language, values, NotHere.outcome.status)


@router.post("/analyses/{analysis_id}/cancel")
def cancel(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Stop an analysis (a plain form, so that it needs no script)."""
    services.store.cancel(analysis_id)
    return RedirectResponse(f"{find_base(request)}/", status_code=303)


@router.post("/analyses/{analysis_id}/retry")
def retry(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Start the same analysis once more."""
    again = retry_job(services.store, services.storage, analysis_id, "web")
    if again.state is JobState.SUCCEEDED:  # a report is there, but not all that this version makes
        again = services.store.add_correction(again, again.request)
    return RedirectResponse(f"{find_base(request)}/analyses/{again.id}", status_code=303)


@router.post("/analyses/{analysis_id}/withdraw")
def withdraw(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Keep the report as it is: the later attempt that failed no longer counts."""
    report = services.store.withdraw(analysis_id)
    return RedirectResponse(f"{find_base(request)}/analyses/{report.id}", status_code=303)


def respond_with_page(request: Request, error: Refusal) -> HTMLResponse:
    """Show a refusal as a page of its own; that of a damaged report offers to analyse again."""
    language = choose_language(request)
    may_read = may(request, "read")
    if may_read and error.code == NotHere.code:  # what an address names may be in the trash
        services = find_services(request)
        for analysis_id in re.findall(r"\ban_[0-9a-f]{16}\b", str(request.url)):
            recording_id = services.store.find_trashed(analysis_id)
            if recording_id is not None:
                return _show_trashed(services.recordings.get(recording_id, trashed=True), request, language)
    values: dict[str, Any] = {"problem": describe_problem(error.code, error.facts, language)}
    values |= {"code": error.code, "damage": None}
    if may_read and error.code == ResultDamaged.code:
        values["damage"] = build_damage(find_services(request), error.facts, language)
    return render_page(request, "error.html", language, values, find_outcome_of_code(error.code).status)
