"""What the report of two arms and that of two days share: bars and curves to one scale, and the sources."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from typing import Any, Literal

from app.report.analysis.chapters import format_accuracy, format_found, format_pose_caution
from app.report.charts.bars import build_parts
from app.report.charts.distribution import build_two_curves
from app.report.figures import format_figure
from app.report.findings import Findings, Kept
from app.report.model import Chart, Note, Pair, Report, Section, Table, VerdictLine
from app.report.words.numbers import NONE, Clock, format_date, format_duration, format_number
from app.report.words.subject import clean_text
from app.report.words.wording import Language, Words, fill, find_device_name, load_wording
from app.request import find_code
from fusion.conventions import CONFIRMED, UNHELD
from fusion.exposure.types import PartExposure
from fusion.recording import MICROSECONDS


@dataclass(frozen=True, slots=True)
class PairSide:
    """One of the two, with the name it goes by."""

    name: str
    kept: Kept


OnePerson = Literal["codes", "person", "unknown", "no"]
"""Whether the recordings are of one person: their codes say so (or they are one recording), the person who
asks does, nobody does (then no report is made of them), or the codes are of two people."""


def read_code(kept: Kept) -> str:
    """Return the code of the person; empty if none was given."""
    return find_code(clean_text(kept.subject.subject))


def judge_person(every: Sequence[Kept], *, is_stated: bool) -> OnePerson:
    """Return whether all recordings are of one person; what a person states counts if a code is missing."""
    codes = {read_code(kept) for kept in every}
    if len(codes - {""}) > 1:
        return "no"
    if "" not in codes or len({kept.findings.recording.sha256 for kept in every}) == 1:
        return "codes"
    return "person" if is_stated else "unknown"


def name_method(findings: Findings) -> str:
    """Name the method and its version; empty for angles that another program made."""
    return f"{findings.method.name} {findings.method.version}" if findings.method else ""


def name_pose(findings: Findings) -> str:
    """Name what the angle rests on; a day without a pose is not like one with."""
    return (findings.calibration.pose or "axis") if findings.calibration else ""


def are_mixed(every: Iterable[Kept]) -> bool:
    """Tell whether several methods, or versions of one, made the figures."""
    return len({name_method(kept.findings) for kept in every}) > 1


def format_person(one_person: OnePerson, language: Language) -> str:
    """Return who says that all are of one person, if a code is missing; else empty."""
    return str(load_pair_words(language)["one_person"].get(one_person, ""))


def load_pair_words(language: Language) -> Words:
    """Read the words of both reports."""
    return load_wording(language, "pairs")


def build_two_bars(
    sides: Sequence[tuple[str, float, dict[int, float]]], note: str, language: Language
) -> Chart:
    """Build one stacked bar for each, to one scale; ``note`` says which time they cover.

    ``sides``: name, analysed time in s and the share of it above each threshold in percent.
    """
    parts = [
        (name, PartExposure("", 0.0, 0.0, analysed_s, {}, above, None)) for name, analysed_s, above in sides
    ]
    return build_parts("bars", parts, load_pair_words(language), language, note)


def build_curves(sides: Sequence[PairSide], language: Language) -> list[Chart]:
    """Build both distributions in one picture; nothing unless both hold analysed time."""
    named = [(side.name, side.kept.findings.exposure) for side in sides]
    if any(exposure.histogram_s.sum() <= 0 for _, exposure in named):
        return []
    return [build_two_curves(named, load_pair_words(language)["curves"], language)]


def format_start(kept: Kept, language: Language) -> str:
    """Write the date a recording began on, or that its file has no clock."""
    start = kept.findings.recording.start
    return format_date(start, language) if start else str(load_wording(language)["label"]["no_clock"])


def format_cautions(sides: Sequence[PairSide], language: Language) -> str:
    """Say which of the two has the one-sided error of the N-pose, and what that does to the difference."""
    words, entry = load_wording(language), load_pair_words(language)["pose_error"]
    posed = [side for side in sides if format_pose_caution(side.kept.findings, words)]
    if not posed:
        return ""
    told = entry["both"] if len(posed) == len(sides) else fill(entry["one"], {"name": posed[0].name})
    return f"{told} {entry['no_range']}"


def is_confirmed(findings: Findings) -> bool:
    """Return whether a person confirmed the pose; a strapped axis and ready angles need none."""
    calibration = findings.calibration
    return calibration is None or calibration.state == "axis" or calibration.state in CONFIRMED


def format_unconfirmed(sides: Sequence[PairSide], effect: str, language: Language) -> str:
    """Return whose pose nobody confirmed and what follows from it; empty if both are confirmed.

    ``effect``: key of the sentence that says what follows.
    """
    entry = load_pair_words(language)["unconfirmed"]
    told = [
        fill(entry[calibration.state], {"name": side.name})
        for side in sides
        if (calibration := side.kept.findings.calibration) and not is_confirmed(side.kept.findings)
    ]
    return " ".join((*told, entry[effect])) if told else ""


def build_report(
    every: Sequence[Kept],
    document: Mapping[str, Any],
    words: Words,
    language: Language,
    *,
    title: str,
    version: str,
    header: tuple[Pair, ...],
    verdict: VerdictLine,
    sentences: Iterable[str],
    cautions: Iterable[str],
    figures: Iterable[Chart],
    sections: Iterable[Section],
    range_note: str = "",
    needs_pose: str = "",
    first_limit: str = "",
) -> Report:
    """Build what every report of several analyses has; the rest is given.

    Its only date is the end of the recording that ended last. ``version`` is of the software;
    ``first_limit`` takes the place of the first limit that the report of one recording states.
    """
    common = load_wording(language)
    limits, use, label = common["limits"], common["intended_use"], common["label"]
    accuracy = dict.fromkeys(format_accuracy(kept.findings, common) for kept in every)
    stated = (first_limit or limits["paragraphs"][0], *limits["paragraphs"][1:], *accuracy)
    recordings = [kept.findings.recording for kept in every]  # compared by what their clocks showed
    ends = [r.start + timedelta(microseconds=r.duration_us) for r in recordings if r.start is not None]
    report_id = identify(document)
    footer = fill(words["footer"], {"version": version, "id": report_id})
    told = ", ".join(fill(label["brief_fact"], {"name": pair.name, "value": pair.value}) for pair in header)
    return Report(
        language=language,
        title=title,
        subtitle=common["heading"]["subtitle"],
        header=header,
        verdict=verdict,
        sentences=tuple(sentences),
        pose_caution=" ".join(filter(None, cautions)),
        range_note=range_note,
        figures=tuple(figures),
        limits=Note(limits["title"], stated),
        intended_use=Note(use["title"], (use["text"],)),
        sections=tuple(sections),
        report_id=report_id,
        footer=footer,
        brief=fill(label["brief_two"], {"header": told, "footer": footer}),
        made_of=max(
            ends, key=lambda end: end.replace(tzinfo=None), default=None
        ),  # by what the clocks showed
        needs_pose=needs_pose,
        words=label,
    )


def build_sources(sides: Sequence[PairSide], language: Language) -> Section:
    """Build the table of where each comes from."""
    words, pair_words = load_wording(language), load_pair_words(language)
    entry, unknown = pair_words["sources"], words["label"]["not_given"]
    columns = []
    for kept in (side.kept for side in sides):
        findings, subject, start = kept.findings, kept.subject, kept.findings.recording.start
        columns.append(
            (
                clean_text(subject.file_name) or unknown,
                findings.recording.sha256[:16] + "…",
                find_device_name(words, findings.recording.device),
                f"{format_date(start, language)}, {Clock(start, language).format(0)}" if start else NONE,
                format_duration(findings.time.analysed_us / MICROSECONDS, language),
                pair_words["pair"]["verdict"][findings.quality.verdict],
                name_method(findings) or NONE,
                format_pose(findings, words),
                f"Acromion {subject.software.version}",
                subject.report_id,
            )
        )
    rows = tuple(zip(entry["rows"], *columns, strict=True))
    table = Table(entry["caption"], (entry["column"], *(side.name for side in sides)), rows)
    return Section("provenance", entry["title"], tables=(table,))


def format_pose(findings: Findings, words: Words) -> str:
    """Write the pose, or how the axis was found without one."""
    calibration = findings.calibration
    if calibration is None:
        return NONE
    if calibration.pose is None or calibration.state in UNHELD:
        return format_found(findings, words)
    return str(words["pose"][calibration.pose])


def format_points(points: float, name: str, language: Language, *, is_signed: bool = False) -> str:
    """Write a difference or a deviation: of shares in points, whose French plural begins at 2."""
    sign = "+" if is_signed and round(points, 1) > 0 else ""
    if not name.endswith("_percent"):
        return sign + format_figure(points, name, language)
    form = "points" if round(abs(points), 1) >= 2 else "points_under_two"
    words = load_pair_words(language)["compare"]
    return sign + fill(words[form], {"value": format_number(points, 1, language)})


def describe_source(kept: Kept) -> dict[str, object]:
    """Describe for JSON which analysis is meant."""
    recording, subject = kept.findings.recording, kept.subject
    return {
        "report_id": subject.report_id,
        "sha256": recording.sha256,
        "file_name": subject.file_name,
        "subject": subject.subject,
        "side": subject.side,
        "start": recording.start.isoformat() if recording.start else None,
        "analysed_s": kept.findings.time.analysed_us / MICROSECONDS,
        "verdict": kept.findings.quality.verdict,
    }


def identify(document: Mapping[str, Any]) -> str:
    """Name a report of two by a hash of its figures: 16 hexadecimal digits."""
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:16]


def encode_document(document: Mapping[str, Any]) -> bytes:
    """Write the figures of a report of two as JSON: the same figures give the same bytes."""
    return json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False).encode() + b"\n"
