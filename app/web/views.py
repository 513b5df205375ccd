"""From a job to what a page shows of it: words and numbers only, so that the templates need not think."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from app.jobs.job import Job, JobState
from app.report.words.messages import Problem, describe_problem
from app.report.words.numbers import (
    format_angle,
    format_duration,
    format_number,
    format_percent,
)
from app.report.words.wording import Language, Words, fill, load_wording
from app.web.day_views import DayClock, place_rows
from fusion.errors import UnusableDiary

SENTENCES = 3
MOST_PERIODS = 12


@dataclass(frozen=True, slots=True)
class ProblemBox:
    """A refusal in words, with its code and the text that "copy details" copies."""

    words: Problem
    code: str
    copy_text: str


@dataclass(frozen=True, slots=True)
class JobRow:
    """One recording in the list.

    ``version`` changes whenever anything shown changes; ``report`` is the address of what can be opened,
    without its ending; ``key`` stays the same while the recording's analyses follow one another.
    """

    id: str
    key: str
    name: str
    meta: tuple[str, ...]
    state: str
    state_word: str
    stage_word: str
    percent: int
    duration: str
    is_over: bool
    problem: ProblemBox | None
    announcement: str
    version: str
    report: str
    side: str


@dataclass(frozen=True, slots=True)
class Fact:
    """A label and its value; ``key`` names the definition."""

    label: str
    value: str
    key: str = ""


def show_row(job: Job, language: Language, now: datetime) -> JobRow:
    """Show a job in the list."""
    words = load_wording(language, "page")
    state_word = str(words["state"][job.state.value])
    percent = round(100 * job.progress)
    duration = _tell_duration(job, words, language, now)
    return JobRow(
        id=job.id,
        key=f"of-{job.recording_id}",
        name=job.file_name,
        meta=_tell_meta(job, words, language),
        state=job.state.value,
        state_word=state_word,
        stage_word=str(words["stage"][job.stage or "starting"]),
        percent=percent,
        duration=duration,
        is_over=job.is_over,
        problem=show_problem(job, language),
        announcement=fill(words["row"]["announce"], {"name": job.file_name, "state": state_word}),
        version=f"{job.state.value}-{job.stage}-{percent}-{duration}",
        report=_find_report(job),
        side=job.request.side or "",
    )


def _find_report(job: Job) -> str:
    if job.request.reference is not None:
        return f"/api/v1/validations/{job.id}/validation"
    return f"/api/v1/analyses/{job.id}/report"


def show_problem(job: Job, language: Language) -> ProblemBox | None:
    """Say why a job failed; None when it did not."""
    if job.problem_code is None:
        return None
    words = describe_problem(job.problem_code, job.problem_facts, language)
    lines = (job.problem_code, words.title, words.detail, words.fix, words.where or "", job.id)
    return ProblemBox(words, job.problem_code, "\n".join(filter(None, lines)))


def show_figures(results: Mapping[str, Any], language: Language) -> tuple[Fact, ...]:
    """Choose the main figures of ``results.json``, written as the report writes them."""
    words = load_wording(language, "page")
    exposure, time = results["exposure"], results["time"]
    above = {row["threshold_deg"]: row["percent"] for row in exposure["time_above"]}
    count = {row["threshold_deg"]: row["count"] for row in exposure["entries"]}
    recorded = {"recorded": format_duration(time["recorded_s"], language)}
    percentiles = exposure["percentiles_deg"]
    values = {
        "above_60": format_percent(above[60], language),
        "above_90": format_percent(above[90], language),
        "entries": format_number(count[60], 0, language),
        "median": format_angle(percentiles["50"], language),
        "p90": format_angle(percentiles["90"], language),
        "analysed": format_duration(time["analysed_s"], language),
    }
    return tuple(Fact(fill(words["figure"][name], recorded), value, name) for name, value in values.items())


@dataclass(frozen=True, slots=True)
class Answer:
    """The figures of a finished analysis, and how far they may be trusted ("good", "caution", "poor").

    ``brief`` is the answer in five lines, to paste into a record; ``sentences`` are its first three, and
    ``reason`` is the fourth: what the quality is and why.
    """

    figures: tuple[Fact, ...]
    verdict: str
    reason: str
    sentences: tuple[str, ...]
    brief: str


def show_answer(results: Mapping[str, Any], brief: str, language: Language) -> Answer:
    """Show the main figures, the answer in words and the verdict on the data."""
    verdict = str(results["quality"]["verdict"])
    lines = tuple(brief.splitlines())
    reason = "".join(lines[SENTENCES : SENTENCES + 1])
    return Answer(show_figures(results, language), verdict, reason, lines[:SENTENCES], brief)


def show_settings(job: Job, clock: DayClock | None, language: Language) -> tuple[Fact, ...]:
    """List what was asked and of which file; moments by the clock of the recording, where it is known."""
    words = load_wording(language, "page")["analysis"]
    request = job.request
    sides = load_wording(language, "page")["drop"]
    values = {
        "side": sides[f"side_{request.side}"] if request.side else words["none"],
        "subject": request.subject or words["none"],
        "method": words["method_name"][request.method],
        "pose": words["pose_name"][request.pose],
        "windows": _tell_windows(job, clock, words, language),
        "periods": _tell_periods(job, clock, language) or words["none"],
        "added": tell_time(job.created_at),
        "size": format_size(job.size_bytes, language),
        "sha256": job.sha256,
        "id": job.id,
    }
    return tuple(Fact(str(words[name]), str(value), name) for name, value in values.items())


def format_size(size_bytes: int, language: Language) -> str:
    """Write a size as people read it: "12.3 MB", "12,3 Mo"."""
    units = load_wording(language, "page")["decimal_units"]
    power = min(3, max(0, (len(str(size_bytes)) - 1) // 3))
    decimals = 1 if power >= 2 else 0
    return f"{format_number(size_bytes / 1000**power, decimals, language)}\u00a0{units[power]}"


def tell_time(moment: datetime) -> str:
    """Write a time that cannot be misread, on this computer's clock."""
    return moment.astimezone().strftime("%Y-%m-%d %H:%M")


def tell_moment(text: str) -> str:
    """Write a time that a row holds."""
    return tell_time(datetime.fromisoformat(text))


def read_results(body: bytes) -> Mapping[str, Any]:
    """Read a stored ``results.json``."""
    results: Mapping[str, Any] = json.loads(body)
    return results


def _tell_meta(job: Job, words: Words, language: Language) -> tuple[str, ...]:
    request = job.request
    subject = fill(words["row"]["subject"], {"subject": request.subject}) if request.subject else ""
    side = str(words["row"][request.side]) if request.side else _tell_no_side(job, words)
    version = fill(words["row"]["version"], {"n": str(request.version)}) if _has_version(job) else ""
    meta = (version, subject, side, format_size(job.size_bytes, language), tell_time(job.created_at))
    return tuple(filter(None, meta))


def _tell_no_side(job: Job, words: Words) -> str:
    """A report of which nobody knows the arm says so; what has none, or compares, needs none."""
    is_open = job.state is JobState.SUCCEEDED and job.request.reference is None
    return str(words["row"]["no_side"]) if is_open else ""


def _has_version(job: Job) -> bool:
    """A first report needs no number, and what failed has none."""
    return job.request.version > 1 and job.state not in (JobState.FAILED, JobState.CANCELLED)


def _tell_duration(job: Job, words: Words, language: Language, now: datetime) -> str:
    if job.started_at is None or job.state in (JobState.QUEUED, JobState.CANCELLED):
        return ""
    seconds = max(0.0, ((job.ended_at or now) - job.started_at).total_seconds())
    key = "took" if job.ended_at else "running_for"
    shown = seconds if job.ended_at else float(int(seconds))
    return fill(words["row"][key], {"duration": format_duration(shown, language)})


def _tell_windows(job: Job, clock: DayClock | None, words: Words, language: Language) -> str:
    windows = job.request.calibration_windows_s
    if not windows:
        return str(words["windows_proposed"])
    if clock is not None and clock.start is not None:
        return "; ".join(f"{clock.format(start_s)} – {clock.format(end_s)}" for start_s, end_s in windows)
    pairs = (
        {"start": format_number(start_s, 1, language), "end": format_number(end_s, 1, language)}
        for start_s, end_s in windows
    )
    return "; ".join(fill(words["window"], pair) for pair in pairs)


def _tell_periods(job: Job, clock: DayClock | None, language: Language) -> str:
    """Name each period with its times; only how many there are where the clock is not known."""
    diary, kinds = job.request.list_diary(), load_wording(language, "day")["kind_name"]
    try:
        rows = place_rows(diary, clock) if clock else []
    except UnusableDiary:
        rows = []
    told = [
        f"{row['label'] or kinds[row['kind']]} {row['start']} – {row['end']}" for row in rows[:MOST_PERIODS]
    ]
    if len(diary) > len(told):
        told.append(f"+ {len(diary) - len(told)}" if told else str(len(diary)))
    return "; ".join(told)


def now_utc() -> datetime:
    """Give the time at which a page is shown."""
    return datetime.now(UTC)
