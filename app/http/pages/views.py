"""Views of jobs and the library, with texts and formatted numbers ready for the templates."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from math import ceil
from pathlib import Path
from statistics import median
from typing import Any
from urllib.parse import urlencode

from fastapi import Request

from acromion.app.http.pages.recording.day import DayClock, format_axis
from acromion.app.http.pages.rendering import OldVersion, Page
from acromion.app.library.listing import (
    DESCENDING,
    GROUPS,
    ORDERS,
    AnalysisDuration,
    Entry,
    Group,
    HeadlineFigures,
    Library,
    LibraryFilter,
    Order,
    StudyName,
)
from acromion.app.library.rows import Job, JobState
from acromion.app.report.words.messages import Problem, describe_problem, format_columns
from acromion.app.report.words.numbers import (
    format_duration,
    format_iso_moment,
    format_moment,
    format_number,
    format_percent,
)
from acromion.app.report.words.wording import Language, Words, fill, load_wording
from acromion.app.request import ReportRequest
from acromion.app.services import Services
from acromion.fusion import errors
from acromion.fusion.clocks import format_clock_offset
from acromion.fusion.conventions import METHOD_VERSION
from acromion.fusion.exposure.periods import Placed, place_diary
from acromion.fusion.recording import MICROSECONDS

_CURED_BY_COLUMNS = (
    *(errors.MixedColumns, errors.ExchangedSensors, errors.UnknownColumns, errors.SeveralSensors),
    *(errors.UnknownRate, errors.UnknownUnit, errors.WrongScale, errors.UnusableTime),
    *(errors.UnknownFormat, errors.UnusableProfile),
)
ASK_COLUMNS = frozenset(refusal.code for refusal in _CURED_BY_COLUMNS)
"""Problems that a person may fix by naming the columns."""

ANY_FILE_S = 3.0
"""Time that an analysis of any file takes, however short, s."""
USUAL_S_PER_MB = {".gt3x": 0.3, ".cwa": 0.3, ".zip": 0.3, ".gz": 0.2, "": 0.05}
"""Time per size of a file until this computer has analysed one of the kind; "" for tables, s/MB."""
OPEN_POSES = ("assumed", "none")
"""Unconfirmed states of a calibration (:data:`acromion.fusion.conventions.CalibrationState`)."""
PREPARING_S = 10.0
"""Usual time of the preparation, once after installation, s."""
MAX_PERIODS = 12


def find_path(services: Services, job: Job) -> Path:
    """Return the path of a recording's file below the folder that was dropped."""
    return Path(services.recordings.get(job.recording_id).about.folder, job.file_name)


def describe_old(job: Job, reports: Sequence[Job], page: Page) -> OldVersion | None:
    """Return the notice above an old version; None for any other analysis.

    ``reports`` are those of the recording, newest first.
    """
    current = next(iter(reports), job)
    if job.state is not JobState.SUCCEEDED or job.request.version == current.request.version:
        return None
    words = page.words()["version"]
    count = max(report.request.version for report in (job, *reports))
    text = fill(words["old"], {"n": str(job.request.version), "count": str(count)})
    link = fill(words["current"], {"n": str(current.request.version)})
    return OldVersion(text, link, f"{page.base}/analyses/{current.id}")


@dataclass(frozen=True, slots=True)
class Fact:
    """A label and its value; ``key`` names the definition."""

    label: str
    value: str
    key: str = ""


@dataclass(frozen=True, slots=True)
class ProblemBox:
    """A problem in words, with its code and the text for "copy details"."""

    words: Problem
    code: str
    copy_text: str


@dataclass(frozen=True, slots=True)
class JobRow:
    """One recording in the list.

    ``version`` changes whenever anything shown changes. ``report`` is the address of the report without its
    extension. ``key`` is the same for all analyses of a recording, or of its shift. ``asks_columns``: a
    person may fix the problem by naming the columns. ``compared``: both file names of a comparison with a
    reference. ``file_meta``: ``meta`` without subject and arm.
    """

    id: str
    key: str
    name: str
    meta: tuple[str, ...]
    file_meta: tuple[str, ...]
    state: str
    state_word: str
    stage: str
    stage_word: str
    percent: int
    duration: str
    is_over: bool
    problem: ProblemBox | None
    announcement: str
    version: str
    report: str
    side: str
    asks_columns: bool
    compared: str


def build_row(job: Job, language: Language, took: Sequence[AnalysisDuration] = ()) -> JobRow:
    """Build the row of a job in the list; its time left is estimated from ``took``, earlier analyses."""
    words, request, now = load_wording(language, "page"), job.request, datetime.now(UTC)
    row_words, state_word, percent = (
        words["row"],
        str(words["state"][job.state.value]),
        round(100 * job.progress),
    )
    times, left_s = [], estimate_left_s(job, took, now)
    if left_s:
        times.append(fill(row_words["time_left"], {"duration": format_duration(left_s, language)}))
    elif job.started_at is not None and job.state not in (JobState.QUEUED, JobState.CANCELLED):
        seconds = max(0.0, ((job.ended_at or now) - job.started_at).total_seconds())
        shown = format_duration(seconds if job.ended_at else float(int(seconds)), language)
        times.append(fill(row_words["took" if job.ended_at else "running_for"], {"duration": shown}))
        if left_s is not None:
            times.append(str(row_words["longer"]))
    duration = ", ".join(times)
    # a first report needs no number, and a failed analysis has none
    has_version = request.version > 1 and job.state not in (JobState.FAILED, JobState.CANCELLED)
    version = fill(row_words["version"], {"n": str(request.version)}) if has_version else ""
    subject = fill(row_words["subject"], {"subject": request.subject}) if request.subject else ""
    has_arm = job.state is JobState.SUCCEEDED and request.reference is None
    side = str(row_words[request.side]) if request.side else str(row_words["no_side"]) if has_arm else ""
    of_file = (format_size(job.size_bytes, language), format_time(job.created_at, language))
    place = f"analyses/{job.id}/report" if request.reference is None else f"validations/{job.id}/validation"
    # the named columns of a table can also be corrected
    is_table = request.profile != "" and "header" in job.problem_facts
    return JobRow(
        id=job.id,
        key=f"of-{job.recording_id}" + re.sub(r"\W", "", request.shift),
        name=job.file_name,
        meta=tuple(filter(None, (version, subject, side, *of_file))),
        file_meta=tuple(filter(None, (version, *of_file))),
        state=job.state.value,
        state_word=state_word,
        stage=job.stage or "starting",
        stage_word=str(words["stage"][job.stage or "starting"]),
        percent=percent,
        duration=duration,
        is_over=job.is_over,
        problem=build_problem(job, language),
        announcement=fill(row_words["announce"], {"name": job.file_name, "state": state_word}),
        version=f"{job.state.value}-{job.stage}-{percent}-{duration}",
        report=f"/api/v1/{place}",
        side=request.side or "",
        asks_columns=request.reference is None and (job.problem_code in ASK_COLUMNS or is_table),
        compared=format_compared(job, words),
    )


def estimate_left_s(job: Job, took: Sequence[AnalysisDuration], now: datetime) -> float | None:
    """Estimate the remaining time of a running analysis, s; 0 if it already takes longer than estimated.

    Earlier analyses of the same kind of file are scaled by size, above the time that any file takes; without
    one, files of this kind usually take :data:`USUAL_S_PER_MB`. The first analysis after installation also
    prepares the calculations. None if the analysis does not run, or is a comparison.
    """
    if job.state is not JobState.RUNNING or job.started_at is None or job.request.reference is not None:
        return None
    kind = Path(job.file_name).suffix.lower()
    scaled = [
        ANY_FILE_S + max(each.took_s - ANY_FILE_S, 0.0) * job.size_bytes / max(each.size_bytes, 1)
        for each in took
        if Path(each.file_name).suffix.lower() == kind
    ]
    usual_s = ANY_FILE_S + USUAL_S_PER_MB.get(kind, USUAL_S_PER_MB[""]) * job.size_bytes / 1e6
    total_s = median(scaled) if scaled else usual_s
    elapsed_s = (now - job.started_at).total_seconds()
    if job.stage == "preparing":
        return float(ceil(max(PREPARING_S * (1.0 - job.progress), 1.0) + total_s))
    return float(max(0, ceil(total_s - elapsed_s)))


def format_compared(job: Job, words: Words) -> str:
    """Name both files of a comparison with a reference; "" for a report."""
    reference = job.request.reference
    facts = {"name": job.file_name, "reference": reference.file_name if reference else ""}
    return fill(words["row"]["compared"], facts) if reference else ""


def build_problem(job: Job, language: Language) -> ProblemBox | None:
    """Build the problem of a failed job; None for any other."""
    if job.problem_code is None:
        return None
    words = describe_problem(job.problem_code, job.problem_facts, language)
    lines = (job.problem_code, words.title, words.detail, words.fix, words.where or "", job.id)
    return ProblemBox(words, job.problem_code, "\n".join(filter(None, lines)))


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer of a finished analysis, and the verdict on its data ("good", "caution", "poor").

    ``brief`` is the answer in five lines, for pasting into a record. ``sentences`` are its first three lines;
    ``reason`` is the fourth, the quality and its reason.
    """

    verdict: str
    reason: str
    sentences: tuple[str, ...]
    brief: str


def build_answer(results: Mapping[str, Any], brief: str) -> Answer:
    """Build the answer in words and the verdict on the data."""
    lines, verdict = tuple(brief.splitlines()), str(results["quality"]["verdict"])
    return Answer(verdict, "".join(lines[3:4]), lines[:3], brief)


def build_settings(job: Job, clock: DayClock | None, language: Language) -> tuple[Fact, ...]:
    """List the settings and the file of an analysis; times are on the recording's clock if it is known."""
    words = load_wording(language, "page")["analysis"]
    request = job.request
    sides = load_wording(language, "page")["drop"]
    unstated = words["windows_held" if request.pose_held == "start" else "windows_proposed"]
    values = {
        "side": sides[f"side_{request.side}"] if request.side else words["none"],
        "subject": request.subject or words["none"],
        "method": words["method_name"][request.method],
        "pose": words["pose_name"][request.pose],
        "windows": format_windows(request.calibration_windows_s, clock, language) or str(unstated),
        "slips": format_times(request.slip_times_s, clock, language) or words["no_slip"],
        "no_slips": format_times(request.no_slip_times_s, clock, language),
        "time_zone": request.time_zone,
        "clock_offset": format_clock_offset(request.clock_offset_s),
        "columns": format_columns(request.profile, language) if request.profile else "",
        "periods": _format_periods(job, clock, language) or words["none"],
        "shift": request.shift.replace("T", " ").replace("/", " – "),
        "added": format_time(job.created_at, language),
        "size": format_size(job.size_bytes, language),
        "sha256": job.sha256,
        "id": job.id,
    }
    if request.arm_axis is not None:
        values["pose"] = fill(words["no_pose"], {"axis": format_axis(request.arm_axis)})
        values["windows"] = words["none_given"]
    return tuple(Fact(str(words[name]), str(value), name) for name, value in values.items())


def format_size(size_bytes: int, language: Language) -> str:
    """Format a file size: "12.3 MB", "12,3 Mo"."""
    units = load_wording(language, "page")["decimal_units"]
    power = min(3, max(0, (len(str(size_bytes)) - 1) // 3))
    decimals = 1 if power >= 2 else 0
    return f"{format_number(size_bytes / 1000**power, decimals, language)}\u00a0{units[power]}"


def format_time(moment: datetime, language: Language) -> str:
    """Format a time in the server's time zone."""
    return format_moment(moment.astimezone(), language)


def format_stored_time(text: str, language: Language) -> str:
    """Format a stored time in the server's time zone."""
    return format_time(datetime.fromisoformat(text), language)


def format_windows(windows: Sequence[tuple[float, float]], clock: DayClock | None, language: Language) -> str:
    """Format time windows on the recording's clock, or in seconds if it has none; "" for none."""
    if clock is not None and clock.start is not None:
        return "; ".join(clock.show_span(start_s, end_s, language) for start_s, end_s in windows)
    words = load_wording(language, "page")["analysis"]["window"]
    shown = ([format_number(moment_s, 1, language) for moment_s in window] for window in windows)
    return "; ".join(fill(words, {"start": start, "end": end}) for start, end in shown)


def format_times(times_s: Sequence[float], clock: DayClock | None, language: Language) -> str:
    """Format times on the recording's clock, or in seconds if it has none; "" for none."""
    if clock is not None and clock.start is not None:
        return "; ".join(clock.show(time_s, language) for time_s in times_s)
    return "; ".join(f"{format_number(time_s, 1, language)}\u202fs" for time_s in times_s)


def _format_periods(job: Job, clock: DayClock | None, language: Language) -> str:
    """List the periods and marks with their times, or only their number if the clock is not known."""
    diary, kinds = job.request.select_diary(), load_wording(language, "day")["kind_name"]
    try:
        placed = place_diary(diary, clock.start, clock.duration_us) if clock else Placed()
    except errors.UnusableDiary:
        placed = Placed()
    shown = [
        f"{period.label or kinds[period.kind]} "
        f"{clock.show_span(period.start_us / MICROSECONDS, period.end_us / MICROSECONDS, language)}"
        for period in placed.periods[:MAX_PERIODS]
        if clock
    ]
    shown += (
        f"{mark.label or kinds['mark']} {clock.show(mark.time_us / MICROSECONDS, language)}"
        for mark in placed.marks[: MAX_PERIODS - len(shown)]
        if clock
    )
    measured = sum(entry.kind == "posture" for entry in diary)
    if len(diary) - measured > len(shown):
        more = len(diary) - measured - len(shown)
        shown.append(f"+ {more}" if shown else str(more))
    if measured:
        shown.append(f"{kinds['posture']} ({measured})")
    return "; ".join(shown)


# The library: rows, groups with their counts, pages.

PER_PAGE = 50
SORTED: tuple[Order, ...] = ("subject", "date", "side", "hours", "quality", "above_60")
SPARK_PX = 20.0
SPARK_TOP_DEG = 120.0


@dataclass(frozen=True, slots=True)
class ShownEntry:
    """A row of the list: subject, time and arm, then the main figures of its report.

    ``when`` is the start of the recording or, if unknown (``is_added``), when it was added. ``figures`` is
    None without a report. ``attempt`` is a newer analysis that is running or failed; the row keeps its
    report. If only its label changes (``is_set``), the row has the new name and arm at once, and no progress.
    ``tags``: each with the query that lists its recordings. ``studies``: the named ones it is in.
    ``questions``: the open ones, see :func:`list_questions`. ``shift``: of a row that is one of several.
    """

    row: JobRow
    recording_id: str
    name: str
    when: str
    is_added: bool
    arm: str
    figures: Mapping[str, Any] | None
    tags: tuple[tuple[str, str], ...]
    studies: tuple[StudyName, ...]
    attempt: JobRow | None
    is_set: bool = False
    questions: tuple[str, ...] = ()
    shift: str = ""

    @property
    def active(self) -> JobRow | None:
        """The analysis of the row that is in progress."""
        return next((row for row in (self.attempt, self.row) if row and not row.is_over), None)


@dataclass(frozen=True, slots=True)
class Heading:
    """A column that sorts the list; ``turned``: "ascending", "descending" or ""."""

    order: str
    name: str
    address: str
    turned: str


@dataclass(frozen=True, slots=True)
class Chip:
    """A group to select, with the number of its recordings."""

    name: str
    count: int
    address: str
    is_chosen: bool


def read_filter(request: Request) -> LibraryFilter:
    """Parse the filter of an address."""
    return parse_filter(request.query_params)


def parse_filter(asked: Mapping[str, str]) -> LibraryFilter:
    """Parse a filter; invalid values are ignored."""
    group: Group = next((known for known in GROUPS if known == asked.get("group")), "all")
    order: Order = next((known for known in ORDERS if known == asked.get("order")), "newest")
    first_day, last_day = (_read_day(asked.get(name, "")) for name in ("first_day", "last_day"))
    text, batch = asked.get("text", "").strip()[:100], asked.get("batch", "")[:40]
    is_reversed = asked.get("reversed", "") == "1"
    tag, subject = (asked.get(name, "")[:100] for name in ("tag", "subject"))
    return LibraryFilter(text, first_day, last_day, group, order, batch, is_reversed, tag, subject)


def write_filter(wanted: LibraryFilter, **changes: str) -> str:
    """Format a filter as the query of an address."""
    parameters = {
        "text": wanted.text,
        "first_day": wanted.first_day,
        "last_day": wanted.last_day,
        "group": "" if wanted.group == "all" else wanted.group,
        "order": "" if wanted.order == "newest" else wanted.order,
        "batch": wanted.batch,
        "tag": wanted.tag,
        "subject": wanted.subject,
        "reversed": "1" if wanted.is_reversed else "",
    }
    return urlencode({name: value for name, value in (parameters | changes).items() if value})


def build_library(page: Page, wanted: LibraryFilter) -> dict[str, Any]:
    """Build the list of the first page or of a batch: its rows, and the links around them.

    ``number`` is the size of the selected group; ``source_query`` reloads the rows.
    """
    words, services = page.words(), page.services
    library = Library(services.store.reader)
    counts = library.count(wanted)
    pages = max(1, -(-counts[wanted.group] // PER_PAGE))
    asked = page.request.query_params.get("page", "")
    number = min(int(asked) if asked.isdecimal() and 0 < int(asked) < 1_000_000 else 1, pages)
    facts = {"done": str(counts["all"] - counts["active"]), "all": str(counts["all"])}
    done = fill(words["list"]["summary"], facts)
    entries = library.find_page(wanted, PER_PAGE, (number - 1) * PER_PAGE)
    took = find_durations(services, entries)
    studies = library.find_studies([entry.job.recording_id for entry in entries])
    return dict(  # noqa: C408  keywords of a template
        entries=[
            build_entry(entry, page.language, took, studies.get(entry.job.recording_id, ()))
            for entry in entries
        ],
        headings=[_build_heading(order, str(words["column"][order]), wanted) for order in SORTED],
        wanted=wanted,
        tags=library.find_tags(),
        views=() if wanted.batch else services.views.find_all(),
        number=counts[wanted.group],
        older=counts["older"],
        query=write_filter(wanted),
        chips=[
            Chip(
                str(words["group"][group]),
                counts[group],
                write_filter(wanted, group="" if group == "all" else group),
                group == wanted.group,
            )
            for group in GROUPS
            if counts[group] or group in ("all", wanted.group)
        ],
        count=f"{done}. {words['row']['close_hint']}" if counts["active"] else done,
        is_empty=not counts["all"] and wanted == LibraryFilter(),
        page=number,
        pages=pages,
        earlier_page=write_filter(wanted, page=str(number - 1)) if number > 1 else "",
        later_page=write_filter(wanted, page=str(number + 1)) if number < pages else "",
        source_query=write_filter(wanted, page=str(number) if number > 1 else ""),
    )


def find_durations(services: Services, entries: Sequence[Entry]) -> tuple[AnalysisDuration, ...]:
    """Return the durations of earlier analyses if one of the entries is running; else none."""
    jobs = (job for entry in entries for job in (entry.job, entry.attempt) if job)
    is_running = any(job.state is JobState.RUNNING for job in jobs)
    return Library(services.store.reader).find_durations() if is_running else ()


def _format_verdict(headline: HeadlineFigures, words: Words) -> str:
    """Return the quality in two words, and separately that a recording is short."""
    short = words["column"]["short"] if headline.is_short else ""
    shown = (words["verdict_short"].get(headline.verdict, ""), short)
    return ", ".join(filter(None, shown))


def build_entry(
    entry: Entry,
    language: Language,
    took: Sequence[AnalysisDuration] = (),
    studies: tuple[StudyName, ...] = (),
) -> ShownEntry:
    """Build the row of a recording with its report or, without one, its newest analysis."""
    job, words, attempt = entry.job, load_wording(language, "page"), entry.attempt
    if attempt is not None and attempt.state is JobState.CANCELLED:
        attempt = None
    label = entry.label
    headline, start, figures = entry.headline, "", None
    if headline is not None:
        start = headline.start or ""
        spark, lowest, highest = draw_spark(headline.day)  # "" if the day is not known
        figures = {
            "hours": format_duration(headline.recorded_s, language),
            "verdict": headline.verdict,
            "quality": _format_verdict(headline, words),
            "is_older": 0 < headline.method_version < int(METHOD_VERSION),
            "above": format_percent(headline.above_60_percent, language),
            "spark": spark,
            "spark_words": fill(words["column"]["spark"], {"low": lowest, "high": highest}) if spark else "",
        }
    return ShownEntry(
        row=build_row(job, language, took),
        recording_id=job.recording_id,
        name=label.subject or job.file_name,
        when=format_iso_moment(start, language) or format_time(job.created_at, language),
        is_added=not start,
        arm=str(words["column"][f"side_{label.side}"]) if label.side else "",
        figures=figures,
        studies=studies,
        tags=tuple((tag, urlencode({"tag": tag})) for tag in entry.tags),
        attempt=build_row(attempt, language, took) if attempt else None,
        is_set=entry.is_set,
        questions=list_questions(label, headline) if headline else (),
        shift=job.request.shift,
    )


def list_questions(request: ReportRequest, headline: HeadlineFigures) -> tuple[str, ...]:
    """Return the open questions about a recording with a report: "who", "arm", "pose"."""
    is_open = {
        "who": not request.subject,
        "arm": request.side is None,
        "pose": headline.calibration_state in OPEN_POSES,
    }
    return tuple(name for name, is_missing in is_open.items() if is_missing)


def draw_spark(day: str) -> tuple[str, str, str]:
    """Draw a day of :func:`acromion.app.library.listing.summarise_day` as an SVG path.

    The path is 100 by 20 for 0 to 120 deg. Return it with its lowest and highest angle; "" for each if no
    angle is known.
    """
    angles = [float(text) if text else None for text in day.split(",")]
    known = [angle for angle in angles if angle is not None]
    if not known:
        return "", "", ""
    step, parts, is_open = 100 / len(angles), [], False
    for place, angle in enumerate(angles):
        if angle is not None:
            height = SPARK_PX * (1 - min(angle, SPARK_TOP_DEG) / SPARK_TOP_DEG)
            parts.append(f"V{height:.1f}" if is_open else f"M{step * place:.1f} {height:.1f}")
        is_open = angle is not None
        if is_open:
            parts.append(f"H{step * (place + 1):.1f}")
    return "".join(parts), f"{min(known):.0f}", f"{max(known):.0f}"


def find_neighbours(page: Page, job: Job) -> dict[str, Any]:
    """Return the analyses before and after this one in the list that it was opened from."""
    wanted = read_filter(page.request)
    before, after = Library(page.services.store.reader).find_neighbours(job, wanted)
    back = f"/studies/{wanted.batch}" if wanted.batch else "/"
    return {"previous_id": before, "next_id": after, "query": write_filter(wanted), "back": back}


def _build_heading(order: Order, name: str, wanted: LibraryFilter) -> Heading:
    """Build a column heading; a second click reverses the order."""
    is_chosen = wanted.order == order
    is_falling = (order in DESCENDING) != (is_chosen and wanted.is_reversed)
    again = "1" if is_chosen and not wanted.is_reversed else ""
    turned = ("descending" if is_falling else "ascending") if is_chosen else ""
    return Heading(order, name, write_filter(wanted, order=order, reversed=again), turned)


def _read_day(text: str) -> str:
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        return ""
