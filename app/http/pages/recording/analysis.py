"""Pages of the library and of one analysis: state or answer, versions, changes and damage."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from typing import Annotated, Any
from urllib.parse import urlencode

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import HTMLResponse
from pydantic import BaseModel

from acromion.app.errors import (
    BadParameter,
    NoSuchFile,
    NotHere,
    ResultDamaged,
    StaleVersion,
    StoreDamaged,
    find_outcome_of_code,
)
from acromion.app.http.api.library.released import read_report
from acromion.app.http.api.trust import get_names, get_person_name
from acromion.app.http.middleware.access import UsedSubject, get_subject, may
from acromion.app.http.middleware.guard import get_host_url
from acromion.app.http.middleware.problems import Refusal
from acromion.app.http.pages.pairs import build_offers
from acromion.app.http.pages.recording.columns import find_offer
from acromion.app.http.pages.recording.day import (
    DayClock,
    build_day,
    build_hours,
    list_axes,
    load_day,
    read_start,
)
from acromion.app.http.pages.recording.figures import FigureTable, build_figures
from acromion.app.http.pages.recording.page_one import read_page_one
from acromion.app.http.pages.rendering import Form, Page, UsedForm, UsedPage, add_navigation, first
from acromion.app.http.pages.trust import build_release
from acromion.app.http.pages.views import (
    build_answer,
    build_entry,
    build_library,
    build_row,
    build_settings,
    describe_old,
    find_durations,
    find_neighbours,
    format_size,
    format_time,
    format_times,
    format_windows,
    read_filter,
)
from acromion.app.library.jobs import JobFilter
from acromion.app.library.listing import Entry
from acromion.app.library.results import can_regenerate
from acromion.app.library.results import retry as retry_job
from acromion.app.library.rows import Job, JobState
from acromion.app.report.figures import load_results
from acromion.app.report.words.messages import Problem, describe_problem
from acromion.app.report.words.numbers import format_date, format_iso_moment
from acromion.app.report.words.wording import (
    Language,
    clean_paragraphs,
    clean_text,
    fill,
    find_nearest,
    load_device_names,
    load_wording,
)
from acromion.app.request import (
    LONGEST_CONCLUSION,
    LONGEST_SUBJECT,
    Conclusion,
    ConclusionDraft,
    ReportRequest,
)
from acromion.app.services import Services, choose_language, find_services
from acromion.app.store.folder import StoredRecording, seems_intact
from acromion.fusion.clocks import format_clock_offset, parse_interval
from acromion.fusion.errors import Fact, SeveralSensors
from acromion.fusion.pose.rules import WINDOW_FAULTS
from acromion.fusion.recording import MICROSECONDS

# The versions of a recording's report, their changes, and a later attempt that failed.


SHOWN = 200


@dataclass(frozen=True, slots=True)
class History:
    """Every analysis of one recording, or of one shift of it, newest first."""

    jobs: tuple[Job, ...]

    @classmethod
    def of(cls, services: Services, job: Job) -> "History":
        """Load the analyses, without comparisons with a reference."""
        same = JobFilter(recording_id=job.recording_id, shift=job.request.shift)
        found = services.store.find_page(same, SHOWN)
        return cls(tuple(other for other in found if other.request.reference is None))

    @property
    def reports(self) -> tuple[Job, ...]:
        """Analyses with a report, except damaged reports that were replaced."""
        return tuple(job for job in self.jobs if job.state is JobState.SUCCEEDED and job.replaced_by is None)

    def find_failed(self, shown: Job) -> Job | None:
        """Return the newest analysis if it failed after the shown one, with another problem than that.

        Replaced analyses are ignored.
        """
        newest = next((job for job in self.jobs if job.replaced_by is None), shown)
        if newest.state is not JobState.FAILED or newest.created_at <= shown.created_at:
            return None
        problems = [(job.problem_code, job.problem_facts) for job in (newest, shown)]
        return newest if problems[0] != problems[1] else None


@dataclass(frozen=True, slots=True)
class VersionRow:
    """One version; ``changed``: its differences from the previous one; ``reason``: as typed by the person."""

    id: str
    name: str
    when: str
    changed: str
    reason: str
    is_this: bool
    who: str


def build_versions(
    page: Page, history: History, shown: Job, clock: DayClock | None
) -> tuple[VersionRow, ...]:
    """Build the rows of the versions, newest first; none if only ``shown`` exists.

    A version that was computed more than once has one row: the shown analysis, or else the newest. Changes
    include the times that a person set.
    """
    language, number = page.language, page.words()["row"]["version"]
    changed = page.words("report")["changed"]
    names = get_names(page.request, (job.asked_by for job in history.jobs), language)
    found: dict[int, Job] = {}
    for job in (shown, *history.reports) if shown.state is JobState.SUCCEEDED else history.reports:
        found.setdefault(job.request.version, job)
    rows = []
    for version, job in sorted(found.items(), reverse=True):
        request = job.request
        times = {
            "calibration_windows_s": format_windows(request.calibration_windows_s, clock, language),
            "slip_times_s": format_times(request.slip_times_s, clock, language),
            "no_slip_times_s": format_times(request.no_slip_times_s, clock, language),
            "time_zone": request.time_zone,
            "clock_offset_s": format_clock_offset(request.clock_offset_s),
        }
        changes = ((str(changed.get(name, name)), times.get(name, "")) for name in request.changes)
        rows.append(
            VersionRow(
                job.id,
                fill(number, {"n": str(version)}),
                format_time(job.created_at, language),
                ", ".join(f"{name} ({time})" if time else name for name, time in changes),
                request.reason,
                job.id == shown.id,
                names.get(job.asked_by, ""),
            )
        )
    return () if all(row.is_this for row in rows) else tuple(rows)


# Damaged or missing files: the problem, and how to fix it.


@dataclass(frozen=True, slots=True)
class Damage:
    """A damaged analysis; ``again``: the analysis that replaces it, "" if there is none.

    ``source``: the problem of the recording if it is also damaged, so that analysing again cannot help.
    """

    id: str
    name: str
    words: Problem
    code: str
    again: str
    source: Problem | None


def build_damage(page: Page, facts: Mapping[str, Fact]) -> Damage | None:
    """Build the view of a ResultDamaged; None if the analysis no longer exists."""
    store, code = page.services.store, ResultDamaged.code
    try:
        job = store.get(str(facts.get("analysis", "")))
    except NotHere:
        return None
    words = describe_problem(code, {"name": facts["name"]}, page.language)
    is_source_whole = job.replaced_by is not None or can_regenerate(store, page.services.storage, job)
    source = None if is_source_whole else describe_problem(StoreDamaged.code, {}, page.language)
    return Damage(job.id, job.file_name, words, code, job.replaced_by or "", source)


def describe_source(page: Page, job: Job) -> Problem | None:
    """Return the problem of a damaged or missing recording; None if it seems undamaged."""
    stored = StoredRecording(job.recording_id, job.sha256, job.size_bytes)
    is_whole = seems_intact(page.services.storage, stored)
    return None if is_whole else describe_problem(StoreDamaged.code, {}, page.language)


# The shifts of one recording.


@dataclass(frozen=True, slots=True)
class ShiftLink:
    """The newest analysis of a shift: its id, and its start for reading."""

    id: str
    when: str
    is_this: bool


def build_shifts(page: Page, shown: Job) -> dict[str, Any] | None:
    """Return the shifts of a recording in their order, with a heading; None for a whole recording.

    ``change``: the analysis of the whole recording, on whose card they are stated; "" if there is none.
    """
    if not shown.request.shift:
        return None
    found = page.services.store.find_page(JobFilter(recording_id=shown.recording_id), SHOWN)
    mine = [job for job in found if job.request.reference is None]
    newest = {
        job.request.shift: job for job in reversed(mine) if job.replaced_by is None and job.request.shift
    }
    if shown.request.shift not in newest:
        return None
    ordered = sorted(newest.items(), key=lambda item: parse_interval(item[0]).start)
    links = [
        ShiftLink(
            job.id, format_iso_moment(shift.partition("/")[0], page.language), shift == shown.request.shift
        )
        for shift, job in ordered
    ]
    place = next(number for number, link in enumerate(links, 1) if link.is_this)
    whole = (job.id for job in mine if not job.request.shift and job.state is JobState.SUCCEEDED)
    heading = fill(page.words()["finish"]["shift_of"], {"n": str(place), "all": str(len(links))})
    return {"heading": heading, "links": links, "change": next(whole, "")}


# The answer of a finished analysis, and its figures beside those before a correction.

ALWAYS_DIFFER = frozenset({"added", "id", "size", "sha256"})


def read_answer(page: Page, job: Job, asked: ReportRequest) -> dict[str, Any]:
    """Load answer, hours, day and links of a finished analysis; the form shows ``asked``.

    Other analyses have empty values. If a file is damaged, the parts loaded before it are shown with the
    damage.
    """
    services, language = page.services, page.language
    shown: dict[str, Any] = dict.fromkeys(("answer", "day", "page_one", "damage"))
    shown |= {"hours": (), "offers": None}
    try:
        results = find_results(services, job)
        if results is None:
            return shown
        name = f"answer.{find_nearest(language, job.request.languages)}.txt"
        shown["answer"] = build_answer(results, services.results.read(job, name).decode())
        shown["hours"] = build_hours(results, language)
        shown["offers"] = build_offers(page, job, results)
        day = None
        with suppress(NoSuchFile):
            day = load_day(services, job)
        shown["day"] = build_day(day, asked, language) if day else None
        shown["page_one"] = read_page_one(services, job, day, language)
    except ResultDamaged as damaged:
        shown["damage"] = build_damage(page, damaged.facts)
    return shown


def read_figures(page: Page, history: History, job: Job, before_id: str) -> FigureTable | None:
    """Load the figures of a finished analysis, and before them the figures of the analysis that it corrects.

    If that one has none, the previous version is used; a conclusion alone changes no figure. None without
    results.
    """
    services, language = page.services, page.language
    try:
        now = find_results(services, job)
    except ResultDamaged:  # read_answer shows the damage
        return None
    if now is None:
        return None
    earlier = [other for other in history.reports if other.request.version < job.request.version]
    earlier.sort(key=lambda it: (it.id == before_id, it.request.version, it.created_at))
    before = earlier[-1] if earlier and job.request.changes != ("conclusion",) else None
    results = None
    with suppress(ResultDamaged):  # the page of that analysis shows the damage
        results = find_results(services, before) if before else None
    if before is None or results is None:
        return FigureTable(build_figures(now, None, language))
    clock = get_clock(services, history)
    settings = (build_settings(one, clock, language) for one in (before, job))
    differ = tuple(
        (new.label, old.value, new.value)
        for old, new in zip(*settings, strict=True)
        if new.key not in ALWAYS_DIFFER and old.value != new.value
    )
    versions = (before.request.version, job.request.version)
    return FigureTable(build_figures(now, results, language), differ, before.id, versions)


def get_clock(services: Services, history: History) -> DayClock | None:
    """Return the clock of the recording from its newest readable report."""
    for report in history.reports:
        with suppress(ResultDamaged):
            results = find_results(services, report)
            if results is None:
                return None
            duration_us = round(results["time"]["recorded_s"] * MICROSECONDS)
            return DayClock(read_start(results.get("recording", {})), duration_us)
    return None


def find_results(services: Services, job: Job) -> Mapping[str, Any] | None:
    """Read ``results.json`` of a finished analysis. Raises ResultDamaged."""
    if job.state is not JobState.SUCCEEDED or job.token is None:
        return None
    return load_results(services.results.read(job, "results.json"))


# A clinician's conclusion makes the next version of the report. After a correction it is shown as a draft
# until a person confirms or dismisses it.


def build_conclusion(page: Page, job: Job, own_name: str, *, is_current: bool) -> dict[str, Any] | None:
    """Return the conclusion of a finished analysis or, if it is the current report, its draft.

    None for any other analysis. ``draft``: the origin of the draft in words; "" if ``said`` is in the report.
    ``own_name``: of the person who is signed in, "" if a name must be typed. ``is_open``: the figures are
    from the current engine; a report of an earlier engine must be analysed again first, because they may
    change.
    """
    if job.state is not JobState.SUCCEEDED or job.replaced_by is not None:
        return None
    draft = job.request.draft if is_current else None
    said = draft.conclusion if draft else job.request.conclusion
    return {
        "said": said,
        "draft": describe_draft(draft, page.language) if draft else "",
        "when": format_date(date.fromisoformat(said.date), page.language) if said else "",
        "today": date.today().isoformat(),  # noqa: DTZ011
        "most": LONGEST_CONCLUSION,
        "is_open": any(one.id == job.id for one in page.services.store.find_same(job.sha256, job.request)),
        "own_name": own_name,
    }


def get_draft_place(job: Job) -> str:
    """Return the place of an unsent conclusion: the recording, or the analysis of a shift of it."""
    return job.id if job.request.shift else job.recording_id


def describe_draft(draft: ConclusionDraft, language: Language) -> str:
    """Describe the version that a draft was written for, and the changes since."""
    words, names = load_wording(language, "page")["conclude"]["draft"], load_wording(language)["changed"]
    kind = "other" if set(draft.changes) - {"subject"} else "subject" if draft.changes else "same"
    changed = ", ".join(str(names.get(name, name)) for name in draft.changes)
    return fill(words[kind], {"n": str(draft.version), "changed": changed})


def read_conclusion(form: Form) -> Conclusion:
    """Parse the conclusion form. Raises BadParameter."""
    text, name, typed_date = (first(form, field) for field in ("text", "name", "date"))
    if not clean_paragraphs(text) or len(text) > LONGEST_CONCLUSION:
        raise BadParameter(name="text", value=text[:60], allowed=f"1 … {LONGEST_CONCLUSION}")
    if not clean_text(name) or len(name) > LONGEST_SUBJECT:
        raise BadParameter(name="name", value=name[:60], allowed=f"1 … {LONGEST_SUBJECT}")
    try:
        day = date.fromisoformat(typed_date)
    except ValueError:
        raise BadParameter(name="date", value=typed_date[:60], allowed="2026-11-23") from None
    return Conclusion("\n".join(clean_paragraphs(text)), clean_text(name), day.isoformat())


class Seen(BaseModel):
    """The previous page: the analysis that was corrected, or the failed attempt whose settings are shown."""

    before: str = ""
    attempt: str = ""


router = APIRouter(default_response_class=HTMLResponse, include_in_schema=False)


@router.get("/")
def home(page: UsedPage) -> Response:
    """Show the upload area and the recordings."""
    services, limit_bytes = page.services, page.services.settings.max_upload_bytes
    return page.render(
        "library/home.html",
        **build_library(page, read_filter(page.request)),
        max_bytes=limit_bytes,
        max_size=format_size(limit_bytes, page.language),
        devices=load_device_names(page.language),
        has_columns=bool(services.mappings.find_all()),
        address=get_host_url(page.request) + page.base,
        quarantined=str(len(services.quarantined) or ""),
    )


@router.get("/rows")
def rows(page: UsedPage, only: str = "") -> Response:
    """Return only the list, to update an open page; if ``only`` is set, only that analysis."""
    if not only:
        return page.render("library/rows.html", **build_library(page, read_filter(page.request)))
    entry = Entry(page.services.store.get(only), None)
    entries = [build_entry(entry, page.language, find_durations(page.services, [entry]))]
    return page.render("library/rows.html", entries=entries, is_empty=False, count="", query="")


@router.get("/analyses/{analysis_id}")
def analysis(analysis_id: str, page: UsedPage, seen: Annotated[Seen, Query()]) -> Response:
    """Show one analysis: its state or its answer, files, day and versions; a notice if it is in the trash."""
    services, language, store = page.services, page.language, page.services.store
    trashed = store.find_trashed(analysis_id)
    if trashed is not None:
        return _show_trashed(page, trashed)
    job = store.get(analysis_id)
    if job.request.reference is not None:
        return page.go(f"/validations/{job.id}")
    if (
        job.state is JobState.SUCCEEDED and job.replaced_by is not None
    ):  # it was damaged and has been repeated
        return page.go(f"/analyses/{job.replaced_by}")
    history = History.of(services, job)
    attempt = next((other for other in history.jobs if other.id == seen.attempt != job.id), None)
    asked = attempt.request if attempt else job.request
    clock, failed = get_clock(services, history), history.find_failed(job)
    report = next(iter(history.reports), None)
    is_current = report is not None and report.id == job.id
    entry = build_entry(Entry(job, None), language, find_durations(services, [Entry(job, None)]))
    subject = get_subject(page.request)
    own_name = get_person_name(page.request, subject.id)
    return page.render(
        "recording/analysis.html",
        row=entry.row,
        entry=entry,
        settings=build_settings(job, clock, language),
        job_request=asked,
        reason=asked.reason if attempt else "",
        attempt_id=attempt.id if attempt else "",
        why_unusable={why: page.words("report")["fact"]["why"][why] for why in WINDOW_FAULTS},
        axes=list_axes(),
        is_of_sensors=job.problem_code == SeveralSensors.code,
        offer=find_offer(page, job, str(job.problem_facts.get("header", ""))),
        figures=None if job.request.side == "trunk" else read_figures(page, history, job, seen.before),
        conclusion=build_conclusion(page, job, own_name, is_current=is_current),
        release=build_release(page, subject, job.id),
        versions=build_versions(page, history, job, clock),
        recording_id=job.recording_id,
        draft_place=get_draft_place(job),
        source=describe_source(page, job),
        shifts=build_shifts(page, job),
        failed=build_row(failed, language) if failed else None,
        report=None if is_current else report,
        old=describe_old(job, history.reports, page),
        **find_neighbours(page, job),
        **read_answer(page, job, asked),
    )


def _show_trashed(page: Page, recording_id: str) -> HTMLResponse:
    recording = page.services.recordings.get(recording_id, trashed=True)
    return page.render("library/in_trash.html", status=NotHere.outcome.status, recording=recording)


@router.get("/analyses/{analysis_id}/report.html")
def show_report(analysis_id: str, page: UsedPage) -> Response:
    """Show the report of a recording, or of a comparison with a reference."""
    services = page.services
    job = services.store.get(analysis_id)
    stem, place = ("report", "analyses") if job.request.reference is None else ("validation", "validations")
    made = find_nearest(page.language, job.request.languages)
    report = read_report(page.request, services, job, f"{stem}.{made}.html").decode()
    pdf = f"{page.base}/api/v1/{place}/{job.id}/{stem}.pdf?{urlencode({'lang': made})}"
    reports = services.store.find_reports(job) if stem == "report" else ()
    old = describe_old(job, reports, page)
    return add_navigation(page, report, f"{page.base}/{place}/{job.id}", pdf, old)


@router.post("/analyses/{analysis_id}/cancel")
def cancel(analysis_id: str, page: UsedPage) -> Response:
    """Stop an analysis (a plain form, so that it works without scripts)."""
    page.services.store.cancel(analysis_id)
    return page.go("/")


@router.post("/analyses/{analysis_id}/retry")
def retry(analysis_id: str, page: UsedPage) -> Response:
    """Repeat an analysis."""
    store = page.services.store
    again = retry_job(store, page.services.storage, analysis_id, "web")
    if again.state is JobState.SUCCEEDED:  # the report lacks files that this version writes
        again = store.add_correction(again, again.request, is_fresh=True)
    return page.go(f"/analyses/{again.id}")


@router.post("/analyses/{analysis_id}/withdraw")
def withdraw(analysis_id: str, page: UsedPage) -> Response:
    """Keep the current report: a later failed attempt no longer counts."""
    return page.go(f"/analyses/{page.services.store.withdraw(analysis_id).id}")


@router.post("/analyses/{analysis_id}/conclude")
def conclude(analysis_id: str, page: UsedPage, subject: UsedSubject, form: UsedForm) -> Response:
    """Make the next version of the report, with the conclusion and the same figures.

    The name is that of the person who is signed in; without accounts it is typed.
    """
    own_name, store = get_person_name(page.request, subject.id), page.services.store
    concluded = read_conclusion({**form, **({"name": [own_name]} if own_name else {})})
    concluded_on = store.get(analysis_id)
    job = store.conclude(concluded_on, concluded)
    page.services.drafts.drop(subject.id, f"conclusion:{get_draft_place(concluded_on)}")
    return page.go_to(job)


@router.post("/analyses/{analysis_id}/dismiss")
def dismiss(analysis_id: str, page: UsedPage) -> Response:
    """Dismiss the draft of a conclusion, or make the next version without the report's conclusion."""
    store = page.services.store
    job = store.get(analysis_id)
    if job.request.conclusion is not None:
        job = store.conclude(job, None)
    else:
        store.dismiss_draft(job.id)
    return page.go_to(job)


def respond_with_page(request: Request, error: Refusal) -> HTMLResponse:
    """Show a refusal as a page; for a damaged report, it offers to analyse again."""
    page = Page(request, find_services(request), choose_language(request))
    may_read = may(request, "read")
    if may_read and error.code == NotHere.code:  # an analysis in the address may be in the trash
        for analysis_id in re.findall(r"\ban_[0-9a-f]{16}\b", str(request.url)):
            recording_id = page.services.store.find_trashed(analysis_id)
            if recording_id is not None:
                return _show_trashed(page, recording_id)
    is_damaged = may_read and error.code == ResultDamaged.code
    return page.render(
        "error.html",
        status=find_outcome_of_code(error.code).status,
        problem=describe_problem(error.code, error.facts, page.language),
        code=error.code,
        newer=error.facts.get("analysis", "") if may_read and error.code == StaleVersion.code else "",
        damage=build_damage(page, error.facts) if is_damaged else None,
    )
