"""Build the content of a report from findings: pure functions, without HTML or PDF."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from typing import Any

from acromion.app.report.charts.bars import build_bar
from acromion.app.report.charts.day import WORST_WINDOW_S
from acromion.app.report.findings import Findings, ReleaseStamp, ReportSubject, Software
from acromion.app.report.model import Note, Pair, Report
from acromion.app.report.single.chapters import (
    Context,
    build_sections,
    build_trunk_sections,
    build_verdict,
    choose_ranges,
    format_accuracy,
    format_needs_pose,
    format_pose_caution,
    format_pose_state,
    format_walking_note,
)
from acromion.app.report.single.profile import build_profile
from acromion.app.report.words.numbers import (
    NARROW,
    Clock,
    format_angle,
    format_date,
    format_duration,
    format_duration_range,
    format_number,
    format_percent,
    format_range,
    format_rate,
)
from acromion.app.report.words.wording import (
    LONGEST_CODE,
    Language,
    clean_paragraphs,
    clean_text,
    cut_text,
    fill,
    find_device_name,
    load_wording,
    name_ranges,
)
from acromion.fusion.comparison.levels import can_be_below
from acromion.fusion.conventions import MAIN_THRESHOLD_DEG
from acromion.fusion.exposure.types import LEAST_RANGED_S, Episodes
from acromion.fusion.recording import MICROSECONDS

MOST_ON_PAGE_1 = 400
"""Maximum length of a conclusion on page 1; page 2 has the whole text."""

__all__ = ["Report", "ReportSubject", "Software", "build_report"]


def build_report(
    findings: Findings, subject: ReportSubject, language: Language, release: ReleaseStamp | None = None
) -> Report:
    """Build the report on the findings in one language; page 1 has the stamp of a released report."""
    ranges = choose_ranges(findings)
    words = name_ranges(load_wording(language), ranges)
    clock = Clock(findings.recording.start, language, findings.recording.duration_s)
    context = Context(findings, subject, clock, words)
    header, use = _build_header(context), words["intended_use"]
    footer = fill(words["heading"]["footer"], {"version": subject.software.version, "id": subject.report_id})
    facts = dict(zip(("subject", "date", "arm", "device"), (pair.value for pair in header), strict=False))
    place = words["trunk" if subject.side == "trunk" else "label"]
    common: dict[str, Any] = {
        "language": language,
        "header": header,
        "verdict": build_verdict(context),
        "intended_use": Note(use["title"], (use["text"],)),
        "report_id": subject.report_id,
        "footer": footer,
        "brief": fill(place["brief"], facts | {"footer": footer}),
        "made_of": clock.at(clock.duration_s),
        "amendment": _format_amendment(context),
        "words": words["label"],
        "pose_state": format_pose_state(context),
        "needs_pose": format_needs_pose(context),
        "conclusion": _build_conclusion(context),
    }
    if subject.side == "trunk":
        return Report(**(common | _describe_trunk(context, release)))
    limits = words["limits"]
    slips = (limits["slips"],) if findings.calibration else ()
    return Report(
        **common,
        title=words["heading"]["title"],
        subtitle=words["heading"]["subtitle"],
        sentences=(
            _format_answer(context),
            f"{_format_time_above(context)} {_format_entries(context)}",
            _format_worst_window(context),
        ),
        range_note=words["ranges"][ranges],
        pose_caution=format_pose_caution(findings, words),
        figures=(build_bar(findings.exposure, words, language),),
        limits=Note(limits["title"], (*limits["paragraphs"], *slips, format_accuracy(findings, words))),
        sections=build_sections(context),
        walking_note=format_walking_note(context),
        profile=replace(
            build_profile(context),
            conclusion=_build_conclusion(context, MOST_ON_PAGE_1),
            released=_format_release(context, release),
        ),
    )


def _describe_trunk(context: Context, release: ReleaseStamp | None) -> dict[str, Any]:
    """Return the content of the report on a recording of the trunk, which has no figure of an arm."""
    entry, language, exposure = context.words["trunk"], context.language, context.exposure
    angles = exposure.percentiles_deg
    facts = {
        "analysed": format_duration(exposure.analysed_s, language),
        **{f"p{p}": format_angle(angles.get(p), language) for p in (10, 50, 90)},
    }
    return {
        "title": entry["title"],
        "subtitle": entry["subtitle"],
        "sentences": (entry["use"], fill(entry["inclination"], facts), entry["no_range"]),
        "range_note": "",
        "amendment": " ".join(filter(None, (_format_release(context, release), _format_amendment(context)))),
        "pose_caution": "",
        "figures": (),
        "limits": Note(context.words["limits"]["title"], (entry["limits"],)),
        "sections": build_trunk_sections(context),
    }


# The answer in three sentences: how much time above 60 deg beside the proposal and how sure; how long, above
# 90 deg and how often; and when. With a range only if the exposure has one.


def _format_answer(context: Context) -> str:
    """Return the main figure, its range with the pose, and whether it is below the proposal."""
    findings, language, entry = context.findings, context.language, context.words["answer"]
    above = findings.find_above_60()
    level = next(one for one in findings.compare_with_levels() if one.reference.key == "above_60")
    interval, state = above.interval, findings.calibration.state if findings.calibration else None
    ends = format_range(interval, language)
    if interval and state is None:
        ends = fill(entry["sampled"], {"range": ends})
    if interval and interval.high_pose is not None and interval.high_pose > interval.high:
        ends = fill(entry["posed"], {"range": ends, "high": format_percent(interval.high_pose, language)})
    why = ""
    if level.standing == "cannot tell" and not can_be_below(level.reference, findings.exposure, state):
        why = entry["why_pose" if state else "why_ready"]
    shift_us = findings.time.shift_us
    is_part = findings.extent == "part" and shift_us is not None
    facts = {
        "arm": context.words["arm"][context.subject.side or "unknown"],
        "percent": format_percent(above.percent, language),
        "analysed": format_duration(findings.exposure.analysed_s, language),
        "range": ends,
        "standing": entry[(level.standing or level.reason).replace(" ", "_")],
        "why": why,
        "shift": format_duration(shift_us / MICROSECONDS, language) if is_part and shift_us else "",
    }
    return fill(entry["line"], facts)


def _format_time_above(context: Context) -> str:
    language, facts = context.language, {}
    for suffix, threshold_deg in (("", MAIN_THRESHOLD_DEG), ("_90", 90)):
        above = context.find_above(threshold_deg)
        facts[f"above{suffix}"] = format_duration(above.duration_s, language)
        facts[f"percent{suffix}"] = format_percent(above.percent, language)
        facts[f"range{suffix}"] = format_range(above.interval, language)
    return fill(context.words["sentence"]["time_above"], facts)


def _format_entries(context: Context) -> str:
    exposure, language = context.exposure, context.language
    entries = next(e for e in exposure.entries if e.threshold_deg == MAIN_THRESHOLD_DEG)
    episodes = next(e for e in exposure.episodes if e.threshold_deg == MAIN_THRESHOLD_DEG)
    is_rated = entries.per_hour is not None and exposure.analysed_s >= LEAST_RANGED_S
    facts = {
        "arm": context.words["arm"][context.subject.side or "unknown"],
        "count": format_number(entries.count, 0, language),
        "per_hour": format_rate(entries.per_hour, language) if is_rated else "",
        "longest": _format_longest(episodes, context),
    }
    key = {0: "entries_none", 1: "entries_one"}.get(entries.count, "entries_many")
    return fill(context.words["sentence"][key], facts)


def _format_longest(episodes: Episodes, context: Context) -> str:
    """Format the longest episode above 60°, with its range, and its start if known."""
    if not episodes.longest_s:
        return ""
    language, entry = context.language, context.words["sentence"]
    interval = context.exposure.intervals.get(f"episodes_above_{MAIN_THRESHOLD_DEG}_longest_s")
    longest = format_duration(episodes.longest_s, language)
    if interval is not None:
        shown = {"longest": longest, "range": format_duration_range(interval, language)}
        longest = fill(entry["longest_range"], shown)
    if episodes.longest_start_s is None:
        return longest
    key = "longest_after" if context.clock.start is None else "longest_at"
    return fill(entry[key], {"longest": longest, "time": context.clock.format(episodes.longest_start_s)})


def _format_worst_window(context: Context) -> str:
    exposure, entry, clock = context.exposure, context.words["sentence"], context.clock
    window = next((w for w in exposure.peak_windows if w.length_s == WORST_WINDOW_S), None)
    if window is None or window.start_s is None:
        return str(entry["window_absent"])
    if not window.percent_above_60:
        return str(entry["window_zero"])
    interval = exposure.intervals.get(f"worst_{WORST_WINDOW_S // 60}_min_above_60_percent")
    facts = {
        **clock.format_span(window.start_s, window.start_s + window.length_s),
        "percent": format_percent(window.percent_above_60, context.language),
        "range": format_range(interval, context.language),
    }
    key = "window_elapsed" if clock.start is None else "window"
    return fill(entry[key], facts).replace(" – ", f"{NARROW}–{NARROW}")


# Header and footer.


def _build_header(context: Context) -> tuple[Pair, ...]:
    words, clock, subject = context.words, context.clock, context.subject
    label, heading, recording = words["label"], words["heading"], context.findings.recording
    place = words["trunk"] if subject.side == "trunk" else label
    time, when = context.findings.time, clock.format_whole() or str(label["no_clock"])
    analysed, recorded = (
        format_duration(us / MICROSECONDS, clock.language) for us in (time.analysed_us, time.recorded_us)
    )
    return (
        Pair(label["subject"], cut_text(clean_text(subject.subject), LONGEST_CODE) or label["not_given"]),
        Pair(label["date"], when),
        Pair(place["arm"], words["side"][subject.side or "unknown"]),
        Pair(label["device"], find_device_name(words, recording.device)),
        Pair(label["analysed"], fill(heading["of"], {"part": analysed, "whole": recorded})),
    )


def _build_conclusion(context: Context, most: int | None = None) -> Note | None:
    """Return the clinician's conclusion, cut if it is longer than ``most`` characters; None without one."""
    concluded, shown = context.subject.conclusion, context.words["conclusion"]
    if concluded is None:
        return None
    when = format_date(datetime.fromisoformat(concluded.date), context.language)
    title = fill(shown["title"], {"name": clean_text(concluded.name), "date": when})
    paragraphs, text = clean_paragraphs(concluded.text), " ".join(clean_paragraphs(concluded.text))
    if most is not None and len(text) > most:
        paragraphs = (fill(shown["longer"], {"text": cut_text(text, most)}),)
    return Note(title, (*paragraphs, shown["typed"]))


def _format_release(context: Context, release: ReleaseStamp | None) -> str:
    """Return who released the report, and when; empty for a report that was not released."""
    if release is None:
        return ""
    when = format_date(datetime.fromisoformat(release.date), context.language)
    return fill(context.words["label"]["released"], {"name": clean_text(release.name), "date": when})


def _format_amendment(context: Context) -> str:
    """Return the statement that a report replaces an earlier one; empty for a first report."""
    subject, words = context.subject, context.words
    if subject.version < 2:
        return ""
    facts = {
        "version": str(subject.version),
        "earlier": str(subject.version - 1),
        "changes": ", ".join(words["changed"].get(name, clean_text(name)) for name in subject.changes),
        "reason": clean_text(subject.reason),
    }
    return fill(words["heading"]["amended"], facts)
