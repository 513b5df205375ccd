"""From what was found to a report: choose, round, order, say. Pure; nothing here knows HTML or PDF."""

from __future__ import annotations

from app.report.answers import Teller, tell_answers
from app.report.chapters import build_sections
from app.report.charts import build_bar, build_day
from app.report.clock import Clock
from app.report.comparison import compare_with_references
from app.report.findings import Findings
from app.report.limits import choose_ranges, tell_accuracy, tell_pose_caution, tell_verdict
from app.report.numbers import format_clock, format_date, format_duration
from app.report.parts import Note, Pair, Report
from app.report.results import identify_report
from app.report.subject import ReportSubject, Software, clean_text, cut_text
from app.report.wording import Language, Words, fill, load_wording
from fusion.recording import MICROSECONDS

LONGEST_CODE = 24
"""Of a subject code at the head of the page; the provenance holds it whole."""

__all__ = ["Report", "ReportSubject", "Software", "build_report"]


def build_report(findings: Findings, subject: ReportSubject, language: Language) -> Report:
    """Turn what was found into all that a template may use, in one language."""
    words = load_wording(language)
    clock = Clock(findings.recording.start, language)
    arm = words["arm"][subject.side or "unknown"]
    header, footer = _build_header(findings, subject, clock, words), _tell_footer(findings, subject, words)
    return Report(
        language=language,
        title=words["report"]["title"],
        subtitle=words["report"]["subtitle"],
        header=header,
        verdict=tell_verdict(findings, words, language),
        sentences=tell_answers(findings.exposure, Teller(words, language, clock, arm)),
        range_note=words["ranges"][choose_ranges(findings)],
        pose_caution=tell_pose_caution(findings, words),
        figures=(build_bar(findings.exposure, words, language), build_day(findings, clock, words)),
        references=compare_with_references(findings, words, language),
        limits=_build_limits(findings, words),
        intended_use=Note(words["intended_use"]["title"], (words["intended_use"]["text"],)),
        sections=build_sections(findings, subject, clock, words),
        report_id=identify_report(findings, subject),
        footer=footer,
        brief=_tell_brief(header, footer, words),
        made_of=clock.at(findings.recording.duration_us / MICROSECONDS),
        amendment=_tell_amendment(subject, words),
        words=words["label"],
    )


def _build_header(findings: Findings, subject: ReportSubject, clock: Clock, words: Words) -> tuple[Pair, ...]:
    label = words["label"]
    time = findings.time
    analysed = format_duration(time.analysed_us / MICROSECONDS, clock.language)
    recorded = format_duration(time.recorded_us / MICROSECONDS, clock.language)
    return (
        Pair(label["subject"], cut_text(clean_text(subject.subject), LONGEST_CODE) or label["not_given"]),
        Pair(label["date"], _tell_date(findings, clock, words)),
        Pair(label["arm"], words["side"][subject.side or "unknown"]),
        Pair(label["device"], words["device"].get(findings.recording.device, words["device"]["other"])),
        Pair(label["analysed"], fill(words["report"]["of"], {"part": analysed, "whole": recorded})),
    )


def _tell_date(findings: Findings, clock: Clock, words: Words) -> str:
    if clock.start is None:
        return str(words["label"]["no_clock"])
    end = clock.at(findings.recording.duration_us / MICROSECONDS) or clock.start
    facts = {
        "date": format_date(clock.start, clock.language),
        "start": format_clock(clock.start, clock.language),
        "end": format_clock(end, clock.language),
    }
    return fill(words["report"]["from_to"], facts)


def _build_limits(findings: Findings, words: Words) -> Note:
    paragraphs = (*words["limits"]["paragraphs"], tell_accuracy(findings, words))
    return Note(words["limits"]["title"], paragraphs)


def _tell_footer(findings: Findings, subject: ReportSubject, words: Words) -> str:
    facts = {"version": subject.software.version, "id": identify_report(findings, subject)}
    return fill(words["report"]["footer"], facts)


def _tell_brief(header: tuple[Pair, ...], footer: str, words: Words) -> str:
    subject, date, arm, device, _ = (pair.value for pair in header)
    facts = {"subject": subject, "date": date, "arm": arm, "device": device, "footer": footer}
    return fill(words["label"]["brief"], facts)


def _tell_amendment(subject: ReportSubject, words: Words) -> str:
    """Say that a report replaces an earlier one; a first one says nothing."""
    if subject.version < 2:
        return ""
    changed = (words["changed"].get(name, clean_text(name)) for name in subject.changes)
    facts = {
        "version": str(subject.version),
        "earlier": str(subject.version - 1),
        "changes": ", ".join(changed),
        "reason": clean_text(subject.reason),
    }
    return fill(words["report"]["amended"], facts)
