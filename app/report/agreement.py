"""Agreement of a recording with a reference, and of a study of several: JSON and CSV, tables, the report.

This module is independent of HTML and PDF.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from acromion.app.report.charts.agreement import (
    draw_bland_altman,
    draw_error_over_time,
    draw_overlay,
    draw_study,
    find_paper_row,
)
from acromion.app.report.export.tables import Row, encode_table
from acromion.app.report.figures import round_all
from acromion.app.report.findings import Software
from acromion.app.report.inspection import describe_understood
from acromion.app.report.model import AgreementReport, Chart, Note, Pair, Section, Table
from acromion.app.report.words.numbers import (
    NONE,
    format_angle,
    format_duration,
    format_number,
    format_percent,
)
from acromion.app.report.words.wording import (
    Language,
    Words,
    clean_text,
    cut_text,
    fill,
    find_device_name,
    load_device_names,
    load_wording,
)
from acromion.fusion.comparison.change import QUASI_STATIC, TABLE_1

if TYPE_CHECKING:
    from acromion.app.errors import StudyProblem
    from acromion.fusion.comparison.agreement import (
        Agreement,
        AgreementCell,
        AgreementEntry,
        Comparison,
        FigureDifference,
        Limits,
        Side,
        Stratum,
        TaskAgreement,
    )
    from acromion.fusion.comparison.alignment import WindowLag


# JSON and CSV.

STATISTICS = (
    "r",
    "rmse_deg",
    "mean_absolute_error_deg",
    "bias_deg",
    "loa_low_deg",
    "loa_high_deg",
    "sd_deg",
    "icc",
    "concordance",
    "samples",
    "duration_s",
)
COLUMNS = ("subject", "device", "kind", "name", "lower", "upper", "paper_task", "repetitions", *STATISTICS)


def encode_agreement_table(validation: Mapping[str, Any]) -> bytes:
    """Encode ``validation.csv``: a row for each task, each class of elevation and speed, and for everything.

    ``kind`` is overall, task, elevation or speed; edges are in deg or deg/s; empty is "not computable".
    """
    rows: list[Row] = [{"kind": "overall", "name": "overall", **validation["overall"]}]
    rows += [{"kind": "task", **task} for task in validation["tasks"]]
    for kind, key, unit in (("elevation", "by_elevation", "deg"), ("speed", "by_speed", "dps")):
        for stratum in validation[key]:
            edges = {edge: stratum[f"{edge}_{unit}"] for edge in ("lower", "upper")}
            rows.append({"kind": kind, "name": kind, **stratum, **edges})
    shared = {"subject": validation["subject"], "device": validation["recording"]["device"]}
    return encode_table(COLUMNS, (shared | row for row in rows))


@dataclass(frozen=True, slots=True)
class ComparisonSubject:
    """Names and settings of a comparison; ``method`` and ``pose`` are "" if the file contained angles.

    All texts are untrusted and are only ever used as text.
    """

    file_name: str
    reference_name: str
    subject: str
    side: str | None
    method: str
    pose: str
    software: Software


SCHEMA = "acromion.validation/1"
STUDY_SCHEMA = "acromion.study/1"
SPREADS = ("r", "rmse_deg", "mean_absolute_error_deg", "bias_deg")


def build_validation(comparison: Comparison, subject: ComparisonSubject) -> dict[str, Any]:
    """Return the comparison as a document; NaN becomes None, numbers are rounded to six decimals."""
    alignment = comparison.alignment
    built: dict[str, Any] = round_all(
        {
            "schema": SCHEMA,
            "alignment": {
                "offset_s": alignment.offset_s,
                "drift_ppm": alignment.drift_ppm,
                "drift_margin_ppm": alignment.drift_margin_ppm,
                "r": alignment.r,
                "offset_given": alignment.is_offset_given,
                "drift_given": alignment.is_drift_given,
                "drift_fitted": alignment.is_drift_fitted,
                "windows": [{"start_s": w.start_s, "lag_s": w.lag_s, "r": w.r} for w in alignment.windows],
            },
            "overall": _describe_agreement(comparison.overall),
            "tasks": [
                {
                    "name": clean_text(task.name),
                    **_describe_agreement(task.agreement),
                    "repetitions": task.repetitions,
                    "paper_task": task.paper_task,
                    "repeated_measures": _describe_limits(task.limits),
                }
                for task in comparison.tasks
            ],
            "by_elevation": [_describe_stratum(s, "deg") for s in comparison.by_elevation],
            "by_speed": [_describe_stratum(s, "dps") for s in comparison.by_speed],
            "exposure": [
                {"name": f.name, "ours": f.ours, "reference": f.reference, "difference": f.difference}
                for f in comparison.exposure
            ],
            "recording": _describe_side(comparison.ours, subject.file_name) | {"side": subject.side},
            "reference": _describe_side(comparison.reference, subject.reference_name)
            | {"axis": comparison.axis},
            "subject": clean_text(subject.subject),
            "method": subject.method,
            "pose": subject.pose,
            "rate_hz": comparison.pairs.rate_hz,
            "software": {"version": subject.software.version, "revision": subject.software.revision},
        }
    )
    return built


def encode_validation(validation: Mapping[str, Any]) -> bytes:
    """Encode it as UTF-8 JSON: the same comparison gives the same bytes."""
    text = json.dumps(validation, ensure_ascii=False, indent=2, allow_nan=False)
    return text.encode("utf-8") + b"\n"


def _describe_agreement(agreement: Agreement) -> dict[str, Any]:
    *shared, samples, duration_s = STATISTICS
    return {
        **{name: getattr(agreement, name) for name in shared},
        "quasi_static": agreement.is_quasi_static,
        samples: agreement.count,
        duration_s: agreement.duration_s,
    }


def _describe_limits(limits: Limits) -> dict[str, Any]:
    return {
        "bias_deg": limits.bias_deg,
        "loa_low_deg": limits.low_deg,
        "loa_high_deg": limits.high_deg,
        "between_sd_deg": limits.between_sd_deg,
        "within_sd_deg": limits.within_sd_deg,
    }


def _describe_stratum(stratum: Stratum, unit: str) -> dict[str, Any]:
    upper = stratum.upper if math.isfinite(stratum.upper) else None
    edges = {f"lower_{unit}": stratum.lower, f"upper_{unit}": upper, "percent": stratum.percent}
    return edges | _describe_agreement(stratum.agreement)


def _describe_side(side: Side, file_name: str) -> dict[str, Any]:
    return {
        "file_name": clean_text(file_name),
        "sha256": side.sha256,
        "device": side.device,
        "duration_s": side.duration_s,
        "understood": {name: clean_text(value) for name, value in side.understood.items()},
    }


# A study.


def build_study_json(
    entries: Sequence[AgreementEntry],
    cells: Sequence[AgreementCell],
    problems: Sequence[StudyProblem],
    method: str,
    software: Software,
) -> bytes:
    """Encode every figure of the study; ``id`` is a hash of them all."""
    study: dict[str, Any] = round_all(
        {
            "schema": STUDY_SCHEMA,
            "method": method,
            "table": [_describe_cell(cell) for cell in cells],
            "comparisons": [_describe_entry(entry) for entry in entries],
            "problems": [
                {"file": clean_text(p.name), "code": p.code, "facts": dict(p.facts)} for p in problems
            ],
            "software": asdict(software),
        }
    )
    study["id"] = hashlib.sha256(json.dumps(study, sort_keys=True).encode()).hexdigest()[:16]
    return encode_validation(study)


def _describe_cell(cell: AgreementCell) -> dict[str, Any]:
    spreads = {name: asdict(getattr(cell, name)) for name in SPREADS}
    return {
        "task": clean_text(cell.task),
        "paper_task": cell.paper_task,
        "device": cell.device,
        "people": cell.people,
        **spreads,
        "repeated_measures": _describe_limits(cell.limits),
        "paper": find_paper_row(cell),
    }


def _describe_entry(entry: AgreementEntry) -> dict[str, Any]:
    return {
        "person": clean_text(entry.person),
        "device": entry.device,
        "task": clean_text(entry.task),
        "paper_task": entry.paper_task,
        **_describe_agreement(entry.agreement),
    }


def encode_cells(cells: Sequence[AgreementCell]) -> bytes:
    """Encode one row per task and device: means, standard deviations, limits, the paper's figures."""
    names = ["task", "paper_task", "device", "people"]
    names += [f"{name}_{part}" for name in SPREADS for part in ("mean", "sd")]
    names += ["loa_low_deg", "loa_high_deg", "paper_r", "paper_rmse_deg", "paper_mean_absolute_error_deg"]
    return encode_table(names, [_make_row(cell) for cell in cells])


def _make_row(cell: AgreementCell) -> Row:
    described: dict[str, Any] = round_all(_describe_cell(cell))
    spreads = {f"{name}_{part}": described[name][part] for name in SPREADS for part in ("mean", "sd")}
    limits = {name: described["repeated_measures"][name] for name in ("loa_low_deg", "loa_high_deg")}
    paper = {f"paper_{name}": value for name, value in (described["paper"] or {}).items()}
    own = {name: described[name] for name in ("task", "paper_task", "device", "people")}
    return {**own, **spreads, **limits, **paper}


def encode_entries(entries: Sequence[AgreementEntry]) -> bytes:
    """Encode one row per person, task and device."""
    rows: list[Row] = [round_all(_describe_entry(entry)) for entry in entries]
    return encode_table([name for name in rows[0] if name != "quasi_static"], rows)


# The tables.

LONGEST_TASK = 40
MOST_LAGS = 12

# The answer of a comparison in a few lines of plain text.


def encode_sentences(validation: Mapping[str, Any], language: Language) -> bytes:
    """Encode the sentences of :func:`list_sentences` as text."""
    return ("\n".join(list_sentences(validation, language)) + "\n").encode("utf-8")


def list_sentences(validation: Mapping[str, Any], language: Language) -> tuple[str, ...]:
    """Return how well the two agree, and how their clocks were aligned."""
    words = load_wording(language, "agreement")["sentence"]
    overall, alignment = validation["overall"], validation["alignment"]
    facts = {
        "rmse": format_angle(overall["rmse_deg"], language, 2),
        "absolute": format_angle(overall["mean_absolute_error_deg"], language, 2),
        "bias": format_angle(overall["bias_deg"], language, 2),
        "low": format_angle(overall["loa_low_deg"], language, 1),
        "high": format_angle(overall["loa_high_deg"], language, 1),
        "r": format_r(overall["r"], language),
        "duration": format_duration(overall["duration_s"], language),
        "offset": format_number(alignment["offset_s"], 3, language),
        "drift": format_drift(alignment["drift_ppm"], alignment["drift_margin_ppm"], language),
    }
    clocks = (
        words["clocks"] if alignment["drift_fitted"] or alignment["drift_given"] else words["clocks_no_drift"]
    )
    return tuple(fill(text, facts) for text in (words["error"], words["bias"], words["r"], clocks))


def format_drift(drift_ppm: float, margin_ppm: float | None, language: Language) -> str:
    """Format a drift with its margin: without decimals from 1 ppm; a drift set by hand has no margin."""
    if margin_ppm is None or not math.isfinite(margin_ppm):
        return format_number(drift_ppm, 1, language)
    decimals = 0 if margin_ppm >= 1.0 else 1
    drift, margin = (format_number(value, decimals, language) for value in (drift_ppm, margin_ppm))
    return f"{drift}\u00a0±\u00a0{margin}"


def format_r(r: float | None, language: Language) -> str:
    """Format a correlation; NA if there is none, as in the paper."""
    text = format_number(r, 3, language)
    return "NA" if text == NONE else text


# The tables.


def format_angles(values_deg: Iterable[float | None], language: Language) -> list[str]:
    """Format angles to a hundredth of a degree."""
    return [format_angle(value_deg, language, 2) for value_deg in values_deg]


def name_task(name: str, most: int = LONGEST_TASK) -> str:
    """Return the name of a task, cut to its column."""
    return cut_text(clean_text(name), most)


def tabulate_tasks(comparison: Comparison, words: Words, language: Language) -> Table:
    """Tabulate every task, then all together; add the paper's figures for tasks that repeat the paper's."""
    entry, paper_figures = words["tasks"], TABLE_1.get(comparison.ours.device, {})
    rows, has_paper = [], False
    for task in comparison.tasks:
        figures = paper_figures.get(task.paper_task) if task.paper_task else None
        paper = [NONE] * 3
        if figures is not None:  # as the paper prints them
            has_paper = True
            r = "NA" if task.paper_task in QUASI_STATIC else format_number(figures.r, 3, language)
            paper = [r, *format_angles((figures.rmse_deg, figures.absolute_deg), language)]
        rows.append((name_task(task.name), *_format_statistics(task.agreement, language), *paper))
    rows.append((words["all"], *_format_statistics(comparison.overall, language), *[NONE] * 3))
    columns = (*entry["columns"], *entry["paper_columns"])
    cut = len(columns) if has_paper else len(columns) - 3
    table = tuple(row[:cut] for row in rows)
    return Table(entry["caption"], columns[:cut], table, entry["note_paper" if has_paper else "note"])


def _format_statistics(agreement: Agreement, language: Language) -> list[str]:
    low, high = (format_angle(edge, language, 1) for edge in (agreement.loa_low_deg, agreement.loa_high_deg))
    errors = (agreement.rmse_deg, agreement.mean_absolute_error_deg, agreement.bias_deg)
    limits = NONE if low == NONE else f"{low}\u00a0…\u00a0{high}"
    return [format_r(agreement.r, language), *format_angles(errors, language), limits]


def tabulate_overall(overall: Agreement, words: Words, language: Language) -> Table:
    """Tabulate every statistic over all rows."""
    entry = words["overall"]
    errors = {
        "rmse": overall.rmse_deg,
        "absolute": overall.mean_absolute_error_deg,
        "bias": overall.bias_deg,
        "sd": overall.sd_deg,
        "low": overall.loa_low_deg,
        "high": overall.loa_high_deg,
    }
    values = {
        "r": format_r(overall.r, language),
        **dict(zip(errors, format_angles(errors.values(), language), strict=True)),
        "icc": format_r(overall.icc, language),
        "concordance": format_r(overall.concordance, language),
        "duration": format_duration(overall.duration_s, language),
        "samples": format_number(overall.count, 0, language),
    }
    return Table.build(entry, ((entry["row"][name], value) for name, value in values.items()), entry["note"])


def tabulate_strata(strata: Sequence[Stratum], key: str, words: Words, language: Language) -> Table:
    """Tabulate the error in each class; ``key`` is "by_elevation" or "by_speed"."""
    entry, rows = words[key], []
    for stratum in strata:
        lower, upper = (format_number(edge, 0, language) for edge in (stratum.lower, stratum.upper))
        form = entry["last" if stratum.upper == float("inf") else "class"]
        name = fill(form, {"lower": lower, "upper": upper, "unit": entry["unit"]})
        one = stratum.agreement
        errors = format_angles((one.rmse_deg, one.mean_absolute_error_deg, one.bias_deg), language)
        rows.append((name, format_percent(stratum.percent, language), *errors))
    return Table.build(entry, rows)


def tabulate_exposure(figures: Sequence[FigureDifference], words: Words, language: Language) -> Table:
    """Tabulate each exposure figure from both sides, and the difference."""
    entry, rows = words["exposure"], []
    for figure in figures:
        values = (figure.ours, figure.reference, figure.difference)
        if figure.name.endswith("_percent"):
            shown = [format_percent(value, language) for value in values]
        elif figure.name.endswith("_deg"):
            shown = [format_angle(value, language, 1) for value in values]
        else:
            shown = [format_number(value, 0, language) for value in values]
        rows.append((_name_figure(figure.name, entry), *shown))
    return Table.build(entry, rows, entry["note"])


def _name_figure(name: str, entry: Words) -> str:
    """Return the name of a figure: ``time_30_45_percent`` is "Time at 30–45°"."""
    parts = name.split("_")
    if name.startswith("time_above"):
        return fill(entry["above"], {"c": parts[2]})
    if parts[0] == "time":
        return fill(entry["bin"], {"low": parts[1], "high": parts[2]})
    if parts[0] == "entries":
        return fill(entry["entries"], {"c": parts[2]})
    return fill(entry["percentile"], {"p": parts[1].removeprefix("p")})


def tabulate_repeated(tasks: Sequence[TaskAgreement], words: Words, language: Language) -> Table:
    """Tabulate limits of agreement with the repetitions as repeated measures."""
    rows = (
        (
            name_task(task.name),
            format_number(task.repetitions, 0, language),
            *format_limits(task.limits, language),
        )
        for task in tasks
        if task.repetitions > 1
    )
    return Table.build(words["repeated"], rows, words["repeated"]["note"])


def format_limits(limits: Limits, language: Language) -> list[str]:
    """Format bias, both limits, and the deviation between and within people."""
    ends = (limits.bias_deg, limits.low_deg, limits.high_deg)
    return format_angles((*ends, limits.between_sd_deg, limits.within_sd_deg), language)


def tabulate_lags(windows: Sequence[WindowLag], words: Words, language: Language) -> Table:
    """Tabulate the clock lag of each stretch, before the last refinement; of many show an even selection."""
    entry, last, is_cut = words["windows"], len(windows) - 1, len(windows) > MOST_LAGS
    chosen = [round(k * last / (MOST_LAGS - 1)) for k in range(MOST_LAGS)]
    rows = (
        (
            format_number(windows[k].start_s, 0, language),
            format_number(1000.0 * windows[k].lag_s, 0, language),
            format_number(windows[k].r, 3, language),
        )
        for k in (chosen if is_cut else range(len(windows)))
    )
    cut = {"shown": str(MOST_LAGS), "all": str(len(windows))} if is_cut else {}
    return Table.build(entry, rows, fill(entry["note"], cut))


# The report.

DECIMALS = {"r": 3, "rmse_deg": 2, "mean_absolute_error_deg": 2}
"""Statistics in the table of a study, with their decimals."""
LONGEST_STUDY_NAME = 32


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
    """Build the parts that the reports of a comparison and of a study share; empty chapters are left out."""
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


# One comparison.


def build_agreement(
    comparison: Comparison, subject: ComparisonSubject, validation: Mapping[str, Any], language: Language
) -> AgreementReport:
    """Build the report of a comparison; ``validation`` is its ``validation.json``."""
    words, devices = load_wording(language, "agreement"), load_device_names(language)
    overall, pairs, label = comparison.overall, comparison.pairs, words["header"]
    error = draw_error_over_time(pairs, words, language)
    sides = ((comparison.ours, subject.file_name), (comparison.reference, subject.reference_name))
    ours, reference = (f"{devices.get(side.device, NONE)} ({clean_text(name)})" for side, name in sides)
    unknown = load_wording(language)["label"]["not_given"]
    named = [  # its id: a hash of both inputs, settings and version
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
    told_drift = format_drift(alignment.drift_ppm, alignment.drift_margin_ppm, language)
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
    line = load_wording(language)["label"]["brief_fact"]
    understood = [
        fill(line, {"name": name, "value": value})
        for name, value in describe_understood(comparison.reference.understood, language)
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


# A study, as in the source paper's Table 1.


def build_study(
    entries: Sequence[AgreementEntry],
    cells: Sequence[AgreementCell],
    problems: Sequence[tuple[str, str, str]],
    software: Software,
    report_id: str,
    language: Language,
) -> AgreementReport:
    """Build the report of a study; ``problems`` are (file, error, code)."""
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
    for device, name in names.items():  # the range of its mean errors
        means = [cell.rmse_deg.mean for cell in cells if cell.device == device]
        known = [mean for mean in means if math.isfinite(mean)] or [float("nan")]
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
    """Tabulate the tasks in rows and each statistic of each device in columns: mean [SD] (paper)."""
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
        texts = (_format_cell(of.get(device), name, language) for name, device in shown)
        rows.append((name_task(task, LONGEST_STUDY_NAME), *texts))
    return Table(entry["caption"], (entry["task"], *columns), tuple(rows), entry["note"], even=True)


def _format_cell(cell: AgreementCell | None, name: str, language: Language) -> str:
    """Format mean [standard deviation over people] (the paper's); NA if nobody has the figure."""
    if cell is None:
        return NONE
    decimals, spread, shown = DECIMALS[name], getattr(cell, name), "NA"
    if math.isfinite(spread.mean):
        shown = format_number(spread.mean, decimals, language)
        if math.isfinite(spread.sd):
            shown += f"\u00a0[{format_number(spread.sd, decimals, language)}]"
    paper = find_paper_row(cell)
    if paper is None:
        return shown
    value = paper[name]
    return f"{shown} ({'NA' if value is None else format_number(value, decimals, language)})"


def _build_study_sections(
    entries: Sequence[AgreementEntry],
    cells: Sequence[AgreementCell],
    problems: Sequence[tuple[str, str, str]],
    entry: Words,
    language: Language,
) -> tuple[Section, ...]:
    limits = [
        (
            name_task(cell.task, LONGEST_STUDY_NAME),
            entry["short"].get(cell.device, cell.device),
            format_number(cell.people, 0, language),
            *format_limits(cell.limits, language),
        )
        for cell in cells
    ]
    people = [
        (
            name_task(one.person, LONGEST_STUDY_NAME),
            entry["short"].get(one.device, one.device),
            name_task(one.task, LONGEST_STUDY_NAME),
            format_r(of.r, language),
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
