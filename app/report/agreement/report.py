"""The sheet of a comparison, and of a study of several. Pure; nothing here knows HTML or PDF."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

from app.report.agreement.export import find_paper_row
from app.report.agreement.tables import (
    format_angles,
    format_limits,
    list_sentences,
    name_task,
    tabulate_exposure,
    tabulate_lags,
    tabulate_overall,
    tabulate_repeated,
    tabulate_strata,
    tabulate_tasks,
    tell_drift,
    tell_r,
)
from app.report.charts.agreement import draw_bland_altman, draw_error_over_time, draw_overlay, draw_study
from app.report.model import AgreementReport, Chart, Note, Pair, Section, Table
from app.report.words.numbers import NONE, format_duration, format_number
from app.report.words.subject import Software, clean_text
from app.report.words.wording import (
    Language,
    Words,
    fill,
    find_device_name,
    load_device_names,
    load_wording,
)

if TYPE_CHECKING:
    from app.report.agreement.export import ComparisonSubject
    from fusion.comparison.agreement import AgreementCell, AgreementEntry, Comparison

DECIMALS = {"r": 3, "rmse_deg": 2, "mean_absolute_error_deg": 2}
"""The statistics in the table of a study."""
LONGEST_TASK = 32


def _build_sheet(
    language: Language,
    report_id: str,
    software: Software,
    *,
    title: str,
    header: Sequence[Pair],
    sentences: Sequence[str],
    main: Table,
    figures: Sequence[Chart],
    sections: Sequence[Section],
    label: Mapping[str, str],
) -> AgreementReport:
    """Build what the sheet of a comparison and that of a study share; empty chapters are left out."""
    words, common = load_wording(language, "agreement"), load_wording(language)
    return AgreementReport(
        language=language,
        title=title,
        subtitle=words["subtitle"],
        header=tuple(header),
        sentences=tuple(sentences),
        main=(main,),
        figures=tuple(figures),
        limits=Note(words["limits"]["title"], tuple(words["limits"]["paragraphs"])),
        sections=tuple(section for section in sections if section.tables or section.pairs),
        report_id=report_id,
        footer=fill(common["heading"]["footer"], {"version": software.version, "id": report_id}),
        words={**common["label"], **words["label"], **label},
    )


# ------------------------------------------------------------------ one comparison


def build_agreement(
    comparison: Comparison, subject: ComparisonSubject, validation: Mapping[str, Any], language: Language
) -> AgreementReport:
    """Turn a comparison into all that a template may use; ``validation`` is its ``validation.json``."""
    words, devices = load_wording(language, "agreement"), load_device_names(language)
    overall, pairs, label = comparison.overall, comparison.pairs, words["header"]
    error = draw_error_over_time(pairs, words, language)
    sides = ((comparison.ours, subject.file_name), (comparison.reference, subject.reference_name))
    ours, reference = (f"{devices.get(side.device, NONE)} ({clean_text(name)})" for side, name in sides)
    unknown = load_wording(language)["label"]["not_given"]
    named = [  # its identity: a hash of both inputs, settings and version
        validation[key] for key in ("recording", "reference", "alignment", "tasks", "method", "software")
    ]
    return _build_sheet(
        language,
        hashlib.sha256(repr(named).encode()).hexdigest()[:16],
        subject.software,
        title=words["title"],
        header=(
            Pair(label["subject"], clean_text(subject.subject) or unknown),
            Pair(label["ours"], ours),
            Pair(label["reference"], reference),
            Pair(label["common"], format_duration(overall.duration_s, language)),
        ),
        sentences=list_sentences(validation, language),
        main=tabulate_tasks(comparison, words, language),
        figures=(
            draw_bland_altman(pairs, overall, words, language),
            draw_overlay(pairs, words, language),
            *([error] if error else []),
        ),
        sections=_build_sections(comparison, subject, words, language),
        label={},
    )


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
    return (
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


# ------------------------------------------------------------------ a study, as in the source paper's Table 1


def build_study(
    entries: Sequence[AgreementEntry],
    cells: Sequence[AgreementCell],
    problems: Sequence[tuple[str, str, str]],
    software: Software,
    report_id: str,
    language: Language,
) -> AgreementReport:
    """Turn a study into all that a template may use; ``problems`` are (file, what was wrong, code)."""
    words, common = load_wording(language, "agreement"), load_wording(language)
    entry, devices = words["study"], list(dict.fromkeys(cell.device for cell in cells))
    names = {device: find_device_name(common, device) for device in devices}
    counts = {
        "people": str(len({e.person for e in entries})),
        "tasks": str(len({cell.task for cell in cells})),
        "devices": ", ".join(names.values()),
        "problems": str(len(problems)),
    }
    sentences = []
    for device, name in names.items():  # between what means its error lies
        means = [cell.rmse_deg.mean for cell in cells if cell.device == device]
        known = [mean for mean in means if isfinite(mean)] or [float("nan")]
        low, high = format_angles((min(known), max(known)), language)
        sentences.append(fill(entry["sentence"], {"device": name, "low": low, "high": high}))
    return _build_sheet(
        language,
        report_id,
        software,
        title=entry["title"],
        header=[Pair(entry["header"][name], counts[name]) for name in entry["header"]],
        sentences=sentences,
        main=_tabulate_study(cells, devices, entry, language),
        figures=[draw_study(entries, cells, device, words, language) for device in devices],
        sections=_build_study_sections(entries, cells, problems, entry, language),
        label={"attachment": entry["attachment"]},
    )


def _tabulate_study(
    cells: Sequence[AgreementCell], devices: Sequence[str], entry: Words, language: Language
) -> Table:
    """Lay the tasks in rows and each statistic of each device in columns: mean [SD] (paper)."""
    shown = [(name, device) for name in DECIMALS for device in devices]
    columns = [
        fill(
            entry["column"],
            {"statistic": entry["statistic"][name], "device": entry["short"].get(device, device)},
        )
        for name, device in shown
    ]
    rows = []
    for task in dict.fromkeys(cell.task for cell in cells):
        of = {cell.device: cell for cell in cells if cell.task == task}
        told = (_tell_cell(of.get(device), name, language) for name, device in shown)
        rows.append((name_task(task, LONGEST_TASK), *told))
    return Table(entry["caption"], (entry["task"], *columns), tuple(rows), entry["note"], even=True)


def _tell_cell(cell: AgreementCell | None, name: str, language: Language) -> str:
    """Write mean [standard deviation over people] (the paper's); NA where nobody has the figure."""
    if cell is None:
        return NONE
    decimals, spread, told = DECIMALS[name], getattr(cell, name), "NA"
    if isfinite(spread.mean):
        told = format_number(spread.mean, decimals, language)
        if isfinite(spread.sd):
            told += f"\u00a0[{format_number(spread.sd, decimals, language)}]"
    paper = find_paper_row(cell)
    if paper is None:
        return told
    value = paper[name]
    return f"{told} ({'NA' if value is None else format_number(value, decimals, language)})"


def _build_study_sections(
    entries: Sequence[AgreementEntry],
    cells: Sequence[AgreementCell],
    problems: Sequence[tuple[str, str, str]],
    entry: Words,
    language: Language,
) -> tuple[Section, ...]:
    limits = [
        (
            name_task(cell.task, LONGEST_TASK),
            entry["short"].get(cell.device, cell.device),
            format_number(cell.people, 0, language),
            *format_limits(cell.limits, language),
        )
        for cell in cells
    ]
    people = [
        (
            name_task(one.person, LONGEST_TASK),
            entry["short"].get(one.device, one.device),
            name_task(one.task, LONGEST_TASK),
            tell_r(of.r, language),
            *format_angles((of.rmse_deg, of.mean_absolute_error_deg, of.bias_deg), language),
        )
        for one in entries
        for of in (one.agreement,)
    ]

    def lay(key: str, rows: Sequence[tuple[str, ...]], note: str = "", *, prose: bool = False) -> Section:
        columns = tuple(entry[f"{key}_columns"])
        table = Table(entry[f"{key}_caption"], columns, tuple(rows), note, prose=prose)
        return Section(key, entry[f"{key}_section"], tables=(table,) if rows or key != "problems" else ())

    return (
        lay("limits", limits, entry["limits_note"]),
        lay("people", people),
        lay("problems", problems, prose=True),
    )
