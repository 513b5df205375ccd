"""From an analysis to a report: choose, round, order, say. Pure; nothing here knows HTML or PDF."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.report.answers import Teller, tell_answers
from app.report.chapters import build_sections
from app.report.charts import build_bar, build_day
from app.report.clock import Clock
from app.report.comparison import compare_with_references
from app.report.messages import describe_flag
from app.report.numbers import format_clock, format_date, format_duration
from app.report.parts import Note, Pair, Report, VerdictLine
from app.report.results import identify_report
from app.report.subject import ReportSubject, Software, clean_text, cut_text
from app.report.wording import Language, Words, fill, load_wording
from fusion.recording import MICROSECONDS

if TYPE_CHECKING:
    from fusion.pipeline import Analysis

LONGEST_CODE = 24
"""Of a subject code at the head of the page; the provenance holds it whole."""

__all__ = ["Report", "ReportSubject", "Software", "build_report"]


def build_report(analysis: Analysis, subject: ReportSubject, language: Language) -> Report:
    """Turn an analysis into all that a template may use, in one language."""
    words = load_wording(language)
    clock = Clock(analysis.recording.start, language)
    arm = words["arm"][subject.side or "unknown"]
    return Report(
        language=language,
        title=words["report"]["title"],
        subtitle=words["report"]["subtitle"],
        header=_build_header(analysis, subject, clock, words),
        verdict=_tell_verdict(analysis, words, language),
        sentences=tell_answers(analysis.exposure, Teller(words, language, clock, arm)),
        pose_caution=_tell_pose_caution(analysis, words),
        bar=build_bar(analysis.exposure, words, language),
        day=build_day(analysis, clock, words),
        references=compare_with_references(analysis, words, language),
        limits=Note(words["limits"]["title"], tuple(words["limits"]["paragraphs"])),
        intended_use=Note(words["intended_use"]["title"], (words["intended_use"]["text"],)),
        sections=build_sections(analysis, subject, clock, words),
        report_id=identify_report(analysis, subject),
        footer=_tell_footer(analysis, subject, words),
        made_of=clock.at(analysis.recording.duration_us / MICROSECONDS),
        amendment=_tell_amendment(subject, words),
        words=words["label"],
    )


def _build_header(analysis: Analysis, subject: ReportSubject, clock: Clock, words: Words) -> tuple[Pair, ...]:
    label = words["label"]
    time = analysis.time
    analysed = format_duration(time.analysed_us / MICROSECONDS, clock.language)
    recorded = format_duration(time.recorded_us / MICROSECONDS, clock.language)
    return (
        Pair(label["subject"], cut_text(clean_text(subject.subject), LONGEST_CODE) or label["not_given"]),
        Pair(label["date"], _tell_date(analysis, clock, words)),
        Pair(label["arm"], words["side"][subject.side or "unknown"]),
        Pair(label["device"], words["device"].get(analysis.recording.device, words["device"]["other"])),
        Pair(label["analysed"], fill(words["report"]["of"], {"part": analysed, "whole": recorded})),
    )


def _tell_date(analysis: Analysis, clock: Clock, words: Words) -> str:
    if clock.start is None:
        return str(words["label"]["no_clock"])
    end = clock.at(analysis.recording.duration_us / MICROSECONDS) or clock.start
    facts = {
        "date": format_date(clock.start, clock.language),
        "start": format_clock(clock.start, clock.language),
        "end": format_clock(end, clock.language),
    }
    return fill(words["report"]["from_to"], facts)


def _tell_verdict(analysis: Analysis, words: Words, language: Language) -> VerdictLine:
    """Give the verdict with its reason; a sound recording never hides what the pose does to its figures."""
    quality = analysis.quality
    entry = words["verdict"][quality.verdict]
    is_posed = quality.verdict == "good" and _tell_pose_caution(analysis, words)
    said = entry["posed"] if is_posed else entry["reason"]
    return VerdictLine(quality.verdict, entry["label"], _tell_reason(analysis, language) or said)


def _tell_reason(analysis: Analysis, language: Language) -> str:
    """Give the one caveat that decided the verdict, in words."""
    for code in analysis.quality.reasons[:1]:
        for flag in analysis.quality.flags:
            if flag.code == code:
                caveat = describe_flag(flag, language)
                return f"{caveat.title}. {caveat.detail}" if caveat.detail else caveat.title
    return ""


def _tell_pose_caution(analysis: Analysis, words: Words) -> str:
    if analysis.calibration is None:
        return ""
    return str(words["pose_caution"].get(analysis.calibration.pose, ""))


def _tell_footer(analysis: Analysis, subject: ReportSubject, words: Words) -> str:
    facts = {"version": subject.software.version, "id": identify_report(analysis, subject)}
    return fill(words["report"]["footer"], facts)


def _tell_amendment(subject: ReportSubject, words: Words) -> str:
    """Say that a report replaces an earlier one; a first one says nothing."""
    if subject.version < 2:
        return ""
    facts = {
        "version": str(subject.version),
        "earlier": str(subject.version - 1),
        "reason": clean_text(subject.reason),
    }
    return fill(words["report"]["amended"], facts)
