"""What limits the figures, for the first page: the verdict with every grave reason, what was not analysed,
what the ranges hold, and how accurate the method is.
"""

from __future__ import annotations

from collections.abc import Iterator

from app.report.day import name_reason
from app.report.findings import Findings
from app.report.messages import describe_flag
from app.report.numbers import MINUTE_S, format_duration
from app.report.parts import VerdictLine
from app.report.wording import Language, Words, fill
from fusion.recording import MICROSECONDS, QualityFlag

SHORTEST_DRAWN_S = 1800.0
"""Six blocks of 5 minutes; as :data:`fusion.exposure.resampling.LEAST_BLOCKS`."""
LEAST_SHARE = 0.01
"""Of the recording: less that was not analysed, and less than a minute, is left to the table."""


def tell_verdict(findings: Findings, words: Words, language: Language) -> VerdictLine:
    """Give the verdict, the gravest reason in full, every other by its name, and what was not analysed.

    A sound recording never hides what the pose does to its figures.
    """
    entry = words["verdict"][findings.quality.verdict]
    is_posed = findings.quality.verdict == "good" and tell_pose_caution(findings, words)
    reasons = _tell_reasons(findings, words, language) or entry["posed" if is_posed else "reason"]
    told = (reasons, _tell_not_analysed(findings, words, language))
    return VerdictLine(findings.quality.verdict, entry["label"], " ".join(filter(None, told)))


def tell_pose_caution(findings: Findings, words: Words) -> str:
    """Give the known one-sided error of the calibration pose; empty where there is none."""
    if findings.calibration is None:
        return ""
    return str(words["pose_caution"].get(findings.calibration.pose, ""))


def tell_accuracy(findings: Findings, words: Words) -> str:
    """Say how accurate the method of these figures is known to be, and what of a sensor goes unnoticed."""
    told, name = words["accuracy"], findings.method.name if findings.method else "ready"
    return (
        f"{told[name]} {told['turned']}" if name in {"smoothed", "published", "live"} else str(told["ready"])
    )


def choose_ranges(findings: Findings) -> str:
    """Give the key of what the ranges hold: ``known``, ``short`` (little of the day) or ``ready`` (no error
    of the angle); ``none`` where there are none.
    """
    if findings.method is not None and findings.calibration is not None:
        return "known" if findings.exposure.analysed_s >= SHORTEST_DRAWN_S else "short"
    return "ready" if findings.exposure.intervals else "none"


def _tell_reasons(findings: Findings, words: Words, language: Language) -> str:
    """Give the gravest caveat in full and the others that count by name."""
    flags = {flag.code: flag for flag in reversed(findings.quality.flags)}
    counted = [flags[code] for code in findings.quality.reasons if code in flags]
    if not counted:
        return ""
    caveat = describe_flag(counted[0], language)
    told = f"{caveat.title}. {caveat.detail}" if caveat.detail else caveat.title
    others = "; ".join(_tell_name(flag, language) for flag in counted[1:])
    others = others.replace("; ", "\u00a0; ") if language == "fr" else others
    return f"{told} {fill(words['report']['also'], {'others': others})}" if others else told


def _tell_name(flag: QualityFlag, language: Language) -> str:
    title = describe_flag(flag, language).title
    title = title[0].lower() + title[1:]
    return f"{title} ({format_duration(flag.seconds, language)})" if flag.seconds else title


def _tell_not_analysed(findings: Findings, words: Words, language: Language) -> str:
    """Say what time is in no figure, the most of it first."""
    time = findings.time
    away_us = time.missing_us + time.excluded_us
    if away_us < max(LEAST_SHARE * time.recorded_us, MINUTE_S * MICROSECONDS):
        return ""
    parts = sorted(_list_away(findings, words), key=lambda part: -part[1])
    told = ", ".join(f"{name} {format_duration(us / MICROSECONDS, language)}" for name, us in parts)
    return fill(words["report"]["not_analysed"], {"parts": told})


def _list_away(findings: Findings, words: Words) -> Iterator[tuple[str, int]]:
    totals_us: dict[str, int] = {}
    for span in findings.exclusions:
        totals_us[span.reason] = totals_us.get(span.reason, 0) + span.duration_us
    yield from ((name_reason(reason, words), us) for reason, us in totals_us.items())
    if findings.time.missing_us >= MICROSECONDS:
        yield words["time"]["missing"].lower(), findings.time.missing_us
