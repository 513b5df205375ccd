"""The answer and the tables of a comparison, in the layout of the source paper's Table 1 where it fits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

from app.report.model import Table
from app.report.words.numbers import NONE, format_angle, format_duration, format_number, format_percent
from app.report.words.subject import clean_text, cut_text
from app.report.words.wording import Language, Words, fill, load_wording
from fusion.comparison.change import QUASI_STATIC, TABLE_1

if TYPE_CHECKING:
    from fusion.comparison.agreement import (
        Agreement,
        Comparison,
        FigureDifference,
        Limits,
        Stratum,
        TaskAgreement,
    )
    from fusion.comparison.alignment import WindowLag

LONGEST_TASK = 40
MOST_LAGS = 12

# The answer of a comparison in a few lines of plain text.


def tell_agreement(validation: Mapping[str, Any], language: Language) -> bytes:
    """Write the sentences of :func:`list_sentences` as text."""
    return ("\n".join(list_sentences(validation, language)) + "\n").encode("utf-8")


def list_sentences(validation: Mapping[str, Any], language: Language) -> tuple[str, ...]:
    """Say how far the two agree, and how their clocks were aligned."""
    words = load_wording(language, "agreement")["sentence"]
    overall, alignment = validation["overall"], validation["alignment"]
    facts = {
        "rmse": format_angle(overall["rmse_deg"], language, 2),
        "absolute": format_angle(overall["mean_absolute_error_deg"], language, 2),
        "bias": format_angle(overall["bias_deg"], language, 2),
        "low": format_angle(overall["loa_low_deg"], language, 1),
        "high": format_angle(overall["loa_high_deg"], language, 1),
        "r": tell_r(overall["r"], language),
        "duration": format_duration(overall["duration_s"], language),
        "offset": format_number(alignment["offset_s"], 3, language),
        "drift": tell_drift(alignment["drift_ppm"], alignment["drift_margin_ppm"], language),
    }
    clocks = (
        words["clocks"] if alignment["drift_fitted"] or alignment["drift_given"] else words["clocks_no_drift"]
    )
    return tuple(fill(text, facts) for text in (words["error"], words["bias"], words["r"], clocks))


def tell_drift(drift_ppm: float, margin_ppm: float | None, language: Language) -> str:
    """Write a drift with its margin, to what that bears: whole from 1 ppm on; one set by hand has none."""
    if margin_ppm is None or not isfinite(margin_ppm):
        return format_number(drift_ppm, 1, language)
    decimals = 0 if margin_ppm >= 1.0 else 1
    drift, margin = (format_number(value, decimals, language) for value in (drift_ppm, margin_ppm))
    return f"{drift}\u00a0±\u00a0{margin}"


def tell_r(r: float | None, language: Language) -> str:
    """Write a correlation; where it is not given, NA as in the paper."""
    text = format_number(r, 3, language)
    return "NA" if text == NONE else text


# The tables.


def format_angles(values_deg: Iterable[float | None], language: Language) -> list[str]:
    """Write angles to a hundredth of a degree."""
    return [format_angle(value_deg, language, 2) for value_deg in values_deg]


def name_task(name: str, most: int = LONGEST_TASK) -> str:
    """Write the name of a task as far as its column holds it."""
    return cut_text(clean_text(name), most)


def tabulate_tasks(comparison: Comparison, words: Words, language: Language) -> Table:
    """Lay every task in a row, then all of them; the paper's figures beside those that repeat one of its."""
    entry, paper_figures = words["tasks"], TABLE_1.get(comparison.ours.device, {})
    rows, has_paper = [], False
    for task in comparison.tasks:
        figures = paper_figures.get(task.paper_task) if task.paper_task else None
        paper = [NONE] * 3
        if figures is not None:  # as it prints them
            has_paper = True
            r = "NA" if task.paper_task in QUASI_STATIC else format_number(figures.r, 3, language)
            paper = [r, *format_angles((figures.rmse_deg, figures.absolute_deg), language)]
        rows.append((name_task(task.name), *_tell_statistics(task.agreement, language), *paper))
    rows.append((words["all"], *_tell_statistics(comparison.overall, language), *[NONE] * 3))
    columns = (*entry["columns"], *entry["paper_columns"])
    cut = len(columns) if has_paper else len(columns) - 3
    table = tuple(row[:cut] for row in rows)
    return Table(entry["caption"], columns[:cut], table, entry["note_paper" if has_paper else "note"])


def _tell_statistics(agreement: Agreement, language: Language) -> list[str]:
    low, high = (format_angle(edge, language, 1) for edge in (agreement.loa_low_deg, agreement.loa_high_deg))
    errors = (agreement.rmse_deg, agreement.mean_absolute_error_deg, agreement.bias_deg)
    limits = NONE if low == NONE else f"{low}\u00a0…\u00a0{high}"
    return [tell_r(agreement.r, language), *format_angles(errors, language), limits]


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
        "r": tell_r(overall.r, language),
        **dict(zip(errors, format_angles(errors.values(), language), strict=True)),
        "icc": tell_r(overall.icc, language),
        "concordance": tell_r(overall.concordance, language),
        "duration": format_duration(overall.duration_s, language),
        "samples": format_number(overall.count, 0, language),
    }
    return Table.lay(entry, ((entry["row"][name], value) for name, value in values.items()), entry["note"])


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
    return Table.lay(entry, rows)


def tabulate_exposure(figures: Sequence[FigureDifference], words: Words, language: Language) -> Table:
    """Tabulate each exposure figure from both sides, and the difference."""
    entry, rows = words["exposure"], []
    for figure in figures:
        values = (figure.ours, figure.reference, figure.difference)
        if figure.name.endswith("_percent"):
            told = [format_percent(value, language) for value in values]
        elif figure.name.endswith("_deg"):
            told = [format_angle(value, language, 1) for value in values]
        else:
            told = [format_number(value, 0, language) for value in values]
        rows.append((_name_figure(figure.name, entry), *told))
    return Table.lay(entry, rows, entry["note"])


def _name_figure(name: str, entry: Words) -> str:
    """Return a figure's name: ``time_30_45_percent`` is "Time at 30–45°"."""
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
    return Table.lay(words["repeated"], rows, words["repeated"]["note"])


def format_limits(limits: Limits, language: Language) -> list[str]:
    """Write bias, both limits, and the deviation between and within."""
    ends = (limits.bias_deg, limits.low_deg, limits.high_deg)
    return format_angles((*ends, limits.between_sd_deg, limits.within_sd_deg), language)


def tabulate_lags(windows: Sequence[WindowLag], words: Words, language: Language) -> Table:
    """Show what each stretch alone said of the clocks, before the last refinement; of many an even choice."""
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
    return Table.lay(entry, rows, fill(entry["note"], cut))
