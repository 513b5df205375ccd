"""The report of a change: whether it is larger than the usual day-to-day variation, and what else differs.

Pure. :func:`describe_comparison` is what ``comparison.json`` and the API give, :func:`build_comparison` the
report for people; both come from :func:`fusion.comparison.compare_days`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from app.errors import CannotCompare
from app.report.figures import format_figure, round_all
from app.report.findings import Kept
from app.report.model import Pair, Report, Section, Table, VerdictLine
from app.report.pairs import (
    PairSide,
    are_mixed,
    build_curves,
    build_report,
    build_sources,
    build_two_bars,
    describe_source,
    format_cautions,
    format_person,
    format_points,
    format_start,
    format_unconfirmed,
    is_confirmed,
    judge_person,
    load_pair_words,
    name_method,
    name_pose,
    read_code,
)
from app.report.words.numbers import NONE
from app.report.words.subject import clean_text, cut_text
from app.report.words.wording import Language, Words, fill, load_wording
from fusion.comparison import (
    SOURCE,
    ComparedDay,
    DayComparison,
    FigureChange,
    compare_days,
)
from fusion.recording import MICROSECONDS

SCHEMA = "acromion.comparison/1"
_TOLD = ("time_above_60_percent", "elevation_p50_deg")
"""Figures of which the answer states the change."""
_LONGEST_CODE = 16


def describe_comparison(before: Kept, after: Kept, *, same_subject: bool = False) -> dict[str, Any]:
    """Give the changes, the verdicts and what the two differ in besides the work, for JSON.

    ``same_subject``: a person states that both are of one person, if a code is missing.
    """
    compared = _compare(before, after)
    document: dict[str, Any] = round_all(
        {
            "schema": SCHEMA,
            "before": describe_source(before),
            "after": describe_source(after),
            "one_person": judge_person((before, after), is_stated=same_subject),
            "figures": [asdict(change) for change in compared.changes],
            "differences": list(compared.differences),
            "source": SOURCE,
        }
    )
    return document


def refuse_no_comparison(
    before: Kept, after: Kept, *, same_subject: bool = False, mixed_methods: bool = False
) -> None:
    """Refuse two people, the same hours of one arm, one analysis twice, and methods mixed unasked.

    The two arms of one shift are no change either, which their report says, with the cure.

    ``same_subject``: a person states that both are of one person, if a code is missing.
    ``mixed_methods``: figures of two methods, or versions of one, may be compared.

    Raises
    ------
    CannotCompare
    """
    differences = _compare(before, after).differences
    if before.findings == after.findings:
        raise CannotCompare(why="same")
    if "subject" in differences:
        raise CannotCompare(why="subjects")
    if judge_person((before, after), is_stated=same_subject) == "unknown":
        raise CannotCompare(why="person")
    if "hours" in differences and "side" not in differences:
        raise CannotCompare(why="same hours")
    if are_mixed((before, after)) and not mixed_methods:
        raise CannotCompare(why="methods")


def build_comparison(before: Kept, after: Kept, language: Language, *, same_subject: bool = False) -> Report:
    """Turn two analyses into a report on the change between them."""
    words, common, compared = load_pair_words(language), load_wording(language), _compare(before, after)
    entry, label, sides_of = words["compare"], common["label"], common["side"]
    sides = (PairSide(entry["before"], before), PairSide(entry["after"], after))
    needs_pose = format_unconfirmed(sides, "change", language)
    subjects = [kept.subject for kept in (before, after)]
    codes = dict.fromkeys(
        cut_text(clean_text(subject.subject), _LONGEST_CODE) or label["not_given"] for subject in subjects
    )
    arms = dict.fromkeys(sides_of[subject.side or "unknown"] for subject in subjects)
    sentences = []
    for change in (each for name in _TOLD for each in compared.changes if each.name == name):
        facts, told = _format_change(change, language), entry["sentence"]
        sentences.append(f"{fill(told[change.name], facts)} {fill(told[change.verdict], facts)}")
    shares = [
        (side.name, exposure.analysed_s, {int(t.threshold_deg): t.percent for t in exposure.time_above})
        for side in sides
        for exposure in (side.kept.findings.exposure,)
    ]
    table, rows = entry["table"], format_rows(compared.changes, language)
    changes = Table.lay(table, rows, fill(table["note"], {"source": SOURCE}))
    return build_report(
        (before, after),
        describe_comparison(before, after, same_subject=same_subject),
        entry,
        language,
        title=entry["title"],
        version=after.subject.software.version,
        header=(
            Pair(label["subject"], " → ".join(codes)),
            Pair(label["arm"], " → ".join(arms)),
            *(Pair(side.name, format_start(side.kept, language)) for side in sides),
        ),
        verdict=_build_verdict(compared, entry),
        sentences=sentences,
        cautions=(
            format_person(judge_person((before, after), is_stated=same_subject), language),
            "" if needs_pose else fill(entry["caution"], {"source": SOURCE}),
            format_cautions(sides, language),
        ),
        figures=(build_two_bars(shares, words["bars"]["note"], language), *build_curves(sides, language)),
        sections=(Section("changes", table["title"], tables=(changes,)), build_sources(sides, language)),
        needs_pose=needs_pose,
    )


def _compare(before: Kept, after: Kept) -> DayComparison:
    return compare_days(_build_day(before), _build_day(after))


def _build_day(kept: Kept) -> ComparedDay:
    findings = kept.findings
    return ComparedDay(
        exposure=findings.exposure,
        method=name_method(findings),
        pose=name_pose(findings),
        side=kept.subject.side,
        verdict=findings.quality.verdict,
        sha256=findings.recording.sha256,
        subject=read_code(kept),
        start=findings.recording.start,
        duration_s=findings.recording.duration_us / MICROSECONDS,
        is_confirmed=is_confirmed(findings),
    )


def _build_verdict(compared: DayComparison, words: Words) -> VerdictLine:
    """Return whether like is compared with like."""
    if not compared.differences:
        return VerdictLine("good", words["alike"]["label"], words["alike"]["reason"])
    for name, entry in words["no_two_days"].items():
        if name in compared.differences:
            return VerdictLine("poor", entry["label"], entry["reason"])
    differences = ", ".join(words["difference"][name] for name in compared.differences)
    level = "poor" if "poor" in compared.differences else "caution"
    entry = words["unlike"]
    return VerdictLine(level, entry["label"], fill(entry["reason"], {"differences": differences}))


def _format_change(change: FigureChange, language: Language) -> dict[str, str]:
    detectable = change.detectable
    return {
        "before": format_figure(change.before, change.name, language),
        "after": format_figure(change.after, change.name, language),
        "change": format_points(change.change, change.name, language, is_signed=True),
        "detectable": NONE if detectable is None else format_points(detectable, change.name, language),
    }


def format_rows(changes: Iterable[FigureChange], language: Language) -> tuple[tuple[str, ...], ...]:
    """Write each change with its units: name, before, after, change, minimal detectable change, verdict."""
    entry = load_pair_words(language)["compare"]["table"]
    return tuple(
        (
            entry["figure"][change.name],
            *_format_change(change, language).values(),
            entry["verdict"][change.verdict],
        )
        for change in changes
    )
