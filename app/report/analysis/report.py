"""From findings to the content of a report: choose, round, order, word. Pure, and without HTML or PDF."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from app.report.analysis.chapters import (
    build_sections,
    build_verdict,
    choose_ranges,
    format_accuracy,
    format_needs_pose,
    format_pose_caution,
    format_pose_state,
    format_walking_note,
)
from app.report.analysis.profile import build_profile
from app.report.charts.bars import build_bar
from app.report.charts.day import WORST_WINDOW_S
from app.report.findings import Findings
from app.report.model import Note, Pair, Report
from app.report.words.numbers import (
    NARROW,
    Clock,
    format_clock,
    format_date,
    format_duration,
    format_duration_range,
    format_elapsed,
    format_number,
    format_percent,
    format_range,
    format_rate,
)
from app.report.words.subject import (
    LONGEST_CODE,
    ReportSubject,
    Software,
    clean_paragraphs,
    clean_text,
    cut_text,
)
from app.report.words.wording import Language, Words, fill, find_device_name, load_wording, name_ranges
from fusion.conventions import MAIN_THRESHOLD_DEG
from fusion.exposure.types import LEAST_RANGED_S, Episodes, Exposure, Interval
from fusion.recording import MICROSECONDS

# The answer in three plain sentences; a range only where the exposure has one.


WORST_RANGE = f"worst_{WORST_WINDOW_S // 60}_min_above_60_percent"


@dataclass(frozen=True, slots=True)
class SentenceContext:
    """What every sentence needs: the words, the language, the clock and the name of the arm."""

    words: Words
    language: Language
    clock: Clock
    arm: str


def format_answers(exposure: Exposure, teller: SentenceContext) -> tuple[str, str, str]:
    """Write how long (above 90 deg too), how often and when the arm was raised above 60 deg."""
    return (
        _format_time_above(exposure, teller),
        _format_entries(exposure, teller),
        _format_worst_window(exposure, teller),
    )


def _format_time_above(exposure: Exposure, teller: SentenceContext) -> str:
    above, above_90 = (
        next(t for t in exposure.time_above if t.threshold_deg == threshold_deg)
        for threshold_deg in (MAIN_THRESHOLD_DEG, 90)
    )
    facts = {
        "arm": teller.arm,
        "above": format_duration(above.duration_s, teller.language),
        "analysed": format_duration(exposure.analysed_s, teller.language),
        "percent": format_percent(above.percent, teller.language),
        "range": format_range(above.interval, teller.language),
        "above_90": format_duration(above_90.duration_s, teller.language),
        "percent_90": format_percent(above_90.percent, teller.language),
        "range_90": format_range(above_90.interval, teller.language),
    }
    return fill(teller.words["sentence"]["time_above"], facts)


def _format_entries(exposure: Exposure, teller: SentenceContext) -> str:
    entries = next(e for e in exposure.entries if e.threshold_deg == MAIN_THRESHOLD_DEG)
    episodes = next(e for e in exposure.episodes if e.threshold_deg == MAIN_THRESHOLD_DEG)
    is_rated = entries.per_hour is not None and exposure.analysed_s >= LEAST_RANGED_S
    facts = {
        "arm": teller.arm,
        "count": format_number(entries.count, 0, teller.language),
        "per_hour": format_rate(entries.per_hour, teller.language) if is_rated else "",
        "longest": _format_longest(episodes, exposure.intervals, teller),
    }
    key = {0: "entries_none", 1: "entries_one"}.get(entries.count, "entries_many")
    return fill(teller.words["sentence"][key], facts)


def _format_longest(episodes: Episodes, ranges: Mapping[str, Interval], teller: SentenceContext) -> str:
    """Write the longest continuous time above 60°, with its range, and when it began where that is known."""
    if not episodes.longest_s:
        return ""
    interval = ranges.get(f"episodes_above_{MAIN_THRESHOLD_DEG}_longest_s")
    longest = format_duration(episodes.longest_s, teller.language)
    if interval is not None:
        told = {"longest": longest, "range": format_duration_range(interval, teller.language)}
        longest = fill(teller.words["sentence"]["longest_range"], told)
    if episodes.longest_start_s is None:
        return longest
    moment = teller.clock.at(episodes.longest_start_s)
    key = "longest_at" if moment else "longest_after"
    time = format_clock(moment, teller.language) if moment else format_elapsed(episodes.longest_start_s)
    return fill(teller.words["sentence"][key], {"longest": longest, "time": time})


def _format_worst_window(exposure: Exposure, teller: SentenceContext) -> str:
    window = next((w for w in exposure.peak_windows if w.length_s == WORST_WINDOW_S), None)
    if window is None or window.start_s is None:
        return str(teller.words["sentence"]["window_absent"])
    if not window.percent_above_60:
        return str(teller.words["sentence"]["window_zero"])
    facts = {
        "start": teller.clock.format(window.start_s),
        "end": teller.clock.format(window.start_s + window.length_s),
        "percent": format_percent(window.percent_above_60, teller.language),
        "range": format_range(exposure.intervals.get(WORST_RANGE), teller.language),
    }
    key = "window_elapsed" if teller.clock.start is None else "window"
    return fill(teller.words["sentence"][key], facts).replace(" – ", f"{NARROW}–{NARROW}")


__all__ = ["Report", "ReportSubject", "Software", "build_report"]


def build_report(findings: Findings, subject: ReportSubject, language: Language) -> Report:
    """Turn findings into all that a template may use, in one language."""
    words = name_ranges(load_wording(language), choose_ranges(findings))
    clock = Clock(findings.recording.start, language)
    arm = words["arm"][subject.side or "unknown"]
    header, limits = _build_header(findings, subject, clock, words), words["limits"]
    footer = fill(words["heading"]["footer"], {"version": subject.software.version, "id": subject.report_id})
    slips = (limits["slips"],) if findings.calibration else ()
    names = ("subject", "date", "arm", "device")
    facts = dict(zip(names, (pair.value for pair in header), strict=False)) | {"footer": footer}
    return Report(
        language=language,
        title=words["heading"]["title"],
        subtitle=words["heading"]["subtitle"],
        header=header,
        verdict=build_verdict(findings, words, language),
        sentences=format_answers(findings.exposure, SentenceContext(words, language, clock, arm)),
        range_note=words["ranges"][choose_ranges(findings)],
        pose_caution=format_pose_caution(findings, words),
        figures=(build_bar(findings.exposure, words, language),),
        limits=Note(limits["title"], (*limits["paragraphs"], *slips, format_accuracy(findings, words))),
        intended_use=Note(words["intended_use"]["title"], (words["intended_use"]["text"],)),
        sections=build_sections(findings, subject, clock, words),
        report_id=subject.report_id,
        footer=footer,
        brief=fill(words["label"]["brief"], facts),
        made_of=clock.at(findings.recording.duration_us / MICROSECONDS),
        amendment=_format_amendment(subject, words),
        words=words["label"],
        pose_state=format_pose_state(findings, clock, words),
        needs_pose=format_needs_pose(findings, clock, words),
        walking_note=format_walking_note(findings, words),
        profile=build_profile(findings, subject, clock, words),
        conclusion=_build_conclusion(subject, language, words),
    )


def _build_header(findings: Findings, subject: ReportSubject, clock: Clock, words: Words) -> tuple[Pair, ...]:
    label = words["label"]
    time = findings.time
    analysed = format_duration(time.analysed_us / MICROSECONDS, clock.language)
    recorded = format_duration(time.recorded_us / MICROSECONDS, clock.language)
    when = str(label["no_clock"])
    if clock.start is not None:
        facts = {
            "date": format_date(clock.start, clock.language),
            "start": format_clock(clock.start, clock.language),
            "end": clock.format(findings.recording.duration_us / MICROSECONDS),
        }
        when = fill(words["heading"]["from_to"], facts)
    return (
        Pair(label["subject"], cut_text(clean_text(subject.subject), LONGEST_CODE) or label["not_given"]),
        Pair(label["date"], when),
        Pair(label["arm"], words["side"][subject.side or "unknown"]),
        Pair(label["device"], find_device_name(words, findings.recording.device)),
        Pair(label["analysed"], fill(words["heading"]["of"], {"part": analysed, "whole": recorded})),
    )


def _build_conclusion(subject: ReportSubject, language: Language, words: Words) -> Note | None:
    """Write what a clinician concludes, as it was typed."""
    concluded, told = subject.conclusion, words["conclusion"]
    if concluded is None:
        return None
    when = format_date(datetime.fromisoformat(concluded.date), language)
    title = fill(told["title"], {"name": clean_text(concluded.name), "date": when})
    return Note(title, (*clean_paragraphs(concluded.text), told["typed"]))


def _format_amendment(subject: ReportSubject, words: Words) -> str:
    """Write that a report replaces an earlier one; empty for a first report."""
    if subject.version < 2:
        return ""
    changed = (words["changed"].get(name, clean_text(name)) for name in subject.changes)
    facts = {
        "version": str(subject.version),
        "earlier": str(subject.version - 1),
        "changes": ", ".join(changed),
        "reason": clean_text(subject.reason),
    }
    return fill(words["heading"]["amended"], facts)
