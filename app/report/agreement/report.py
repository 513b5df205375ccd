"""From a comparison to its sheet: choose, round, order, say. Pure; nothing here knows HTML or PDF."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from app.report.agreement.tables import (
    list_sentences,
    tabulate_exposure,
    tabulate_lags,
    tabulate_overall,
    tabulate_repeated,
    tabulate_strata,
    tabulate_tasks,
    tell_drift,
)
from app.report.charts.agreement import draw_bland_altman, draw_error_over_time, draw_overlay
from app.report.model import AgreementReport, Note, Pair, Section
from app.report.words.numbers import NONE, format_duration, format_number
from app.report.words.subject import clean_text
from app.report.words.wording import Language, Words, fill, load_device_names, load_wording

if TYPE_CHECKING:
    from app.report.agreement.export import ComparisonSubject
    from fusion.agreement import Comparison


def build_agreement(
    comparison: Comparison, subject: ComparisonSubject, validation: Mapping[str, Any], language: Language
) -> AgreementReport:
    """Turn a comparison into all that a template may use; ``validation`` is its ``validation.json``."""
    words, common = load_wording(language, "agreement"), load_wording(language)
    report_id = identify_comparison(validation)
    overall, pairs = comparison.overall, comparison.pairs
    figures = [draw_bland_altman(pairs, overall, words, language), draw_overlay(pairs, words, language)]
    error = draw_error_over_time(pairs, words, language)
    facts = {"version": subject.software.version, "id": report_id}
    devices, label = load_device_names(language), words["header"]
    ours, reference = (
        f"{devices.get(side.device, NONE)} ({clean_text(name)})"
        for side, name in (
            (comparison.ours, subject.file_name),
            (comparison.reference, subject.reference_name),
        )
    )
    header = (
        Pair(label["subject"], clean_text(subject.subject) or common["label"]["not_given"]),
        Pair(label["ours"], ours),
        Pair(label["reference"], reference),
        Pair(label["common"], format_duration(overall.duration_s, language)),
    )
    return AgreementReport(
        language=language,
        title=words["title"],
        subtitle=words["subtitle"],
        header=header,
        sentences=list_sentences(validation, language),
        main=(tabulate_tasks(comparison, words, language),),
        figures=tuple(figure for figure in (*figures, error) if figure is not None),
        limits=Note(words["limits"]["title"], tuple(words["limits"]["paragraphs"])),
        sections=_build_sections(comparison, subject, words, language),
        report_id=report_id,
        footer=fill(common["heading"]["footer"], facts),
        made_of=None,
        words={**common["label"], **words["label"]},
    )


def identify_comparison(validation: Mapping[str, Any]) -> str:
    """Name the sheet by a hash of both inputs, settings and engine version: 16 hexadecimal digits."""
    named = [
        validation[key] for key in ("recording", "reference", "alignment", "tasks", "method", "software")
    ]
    return hashlib.sha256(repr(named).encode()).hexdigest()[:16]


def _build_sections(
    comparison: Comparison, subject: ComparisonSubject, words: Words, language: Language
) -> tuple[Section, ...]:
    title = words["section"]
    tables = (
        tabulate_overall(comparison.overall, words, language),
        tabulate_repeated(comparison.tasks, words, language),
        tabulate_strata(comparison.by_elevation, "by_elevation", words, language),
        tabulate_strata(comparison.by_speed, "by_speed", words, language),
    )
    exposure = tabulate_exposure(comparison.exposure, words, language)
    alignment, entry = comparison.alignment, words["clocks"]
    lags = tabulate_lags(alignment.windows, words, language)
    drift = "given" if alignment.is_drift_given else "found" if alignment.is_drift_fitted else "untold"
    told_drift = tell_drift(alignment.drift_ppm, alignment.drift_margin_ppm, language)
    clocks = (
        Pair(entry["offset"], f"{format_number(alignment.offset_s, 4, language)} s"),
        Pair(entry["offset_source"], entry["given" if alignment.is_offset_given else "found"]),
        Pair(entry["drift"], f"{told_drift} ppm"),
        Pair(entry["drift_source"], entry[drift]),
        Pair(entry["r"], format_number(alignment.r, 3, language)),
        Pair(entry["rate"], f"{format_number(comparison.pairs.rate_hz, 2, language)} Hz"),
        Pair(entry["axis"], entry["axes"][comparison.axis]),
    )
    entry = words["provenance"]
    understood = [
        f"{name}: {clean_text(value)}" for name, value in comparison.reference.understood.items() if value
    ]
    provenance = (
        Pair(entry["ours_sha256"], comparison.ours.sha256, code=True),
        Pair(entry["reference_sha256"], comparison.reference.sha256, code=True),
        Pair(entry["understood"], "; ".join(understood) or NONE),
        Pair(entry["method"], subject.method or NONE),
        Pair(entry["pose"], subject.pose or NONE),
        Pair(entry["software"], f"acromion {subject.software.version} ({subject.software.revision})"),
    )
    sections = (
        Section("agreement", title["agreement"], tables=tuple(t for t in tables if t.rows)),
        Section("exposure", title["exposure"], tables=(exposure,) if exposure.rows else ()),
        Section(
            "clocks",
            title["clocks"],
            (words["clocks"]["text"],),
            pairs=clocks,
            tables=(lags,) if lags.rows else (),
        ),
        Section("provenance", title["provenance"], pairs=provenance),
    )
    return tuple(section for section in sections if section.tables or section.pairs)
