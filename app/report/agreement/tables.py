"""The tables of a comparison: every statistic, in the layout of the source paper's Table 1 where it fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

from app.report.model import Table
from app.report.words.numbers import NONE, format_angle, format_duration, format_number, format_percent
from app.report.words.subject import clean_text, cut_text
from app.report.words.wording import Language, Words, fill, load_wording
from fusion.source_paper import QUASI_STATIC, TABLE_1, TaskFigures

if TYPE_CHECKING:
    from fusion.agreement import Agreement, Comparison, FigureDifference, Stratum, TaskAgreement
    from fusion.agreement.pairs import WindowLag


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


LONGEST_TASK = 40


def tabulate_tasks(comparison: Comparison, words: Words, language: Language) -> Table:
    """Lay every task in a row, then all of them; the paper's figures beside those that repeat one of its."""
    entry, device = words["tasks"], comparison.ours.device
    rows = [
        (
            cut_text(clean_text(task.name), LONGEST_TASK),
            *tell_statistics(task.agreement, language),
            *tell_paper(find_paper(device, task.paper_task), task.paper_task, language),
        )
        for task in comparison.tasks
    ]
    everything = (words["all"], *tell_statistics(comparison.overall, language), *([NONE] * 3))
    has_paper = any(find_paper(device, task.paper_task) for task in comparison.tasks)
    columns = (*entry["columns"], *entry["paper_columns"])
    cut = len(columns) if has_paper else len(columns) - 3
    table = tuple(row[:cut] for row in (*rows, everything))
    return Table(entry["caption"], columns[:cut], table, entry["note_paper" if has_paper else "note"])


def tell_statistics(agreement: Agreement, language: Language) -> tuple[str, ...]:
    """Give r, RMSE, mean absolute error, bias and limits of agreement."""
    low, high = (format_angle(edge, language, 1) for edge in (agreement.loa_low_deg, agreement.loa_high_deg))
    return (
        tell_r(agreement.r, language),
        format_angle(agreement.rmse_deg, language, 2),
        format_angle(agreement.mean_absolute_error_deg, language, 2),
        format_angle(agreement.bias_deg, language, 2),
        NONE if low == NONE else f"{low}\u00a0…\u00a0{high}",
    )


def find_paper(device: str, paper_task: int | None) -> TaskFigures | None:
    """Give the paper's figures for a device and one of its tasks."""
    return TABLE_1.get(device, {}).get(paper_task) if paper_task else None


def tell_paper(
    figures: TaskFigures | None, paper_task: int | None, language: Language
) -> tuple[str, str, str]:
    """Write the paper's r, RMSE and mean absolute error as it prints them."""
    if figures is None:
        return NONE, NONE, NONE
    r = "NA" if paper_task in QUASI_STATIC else format_number(figures.r, 3, language)
    return r, format_angle(figures.rmse_deg, language, 2), format_angle(figures.absolute_deg, language, 2)


def tabulate_overall(overall: Agreement, words: Words, language: Language) -> Table:
    """Give every statistic over all rows."""
    entry = words["overall"]
    values = {
        "r": tell_r(overall.r, language),
        "rmse": format_angle(overall.rmse_deg, language, 2),
        "absolute": format_angle(overall.mean_absolute_error_deg, language, 2),
        "bias": format_angle(overall.bias_deg, language, 2),
        "sd": format_angle(overall.sd_deg, language, 2),
        "low": format_angle(overall.loa_low_deg, language, 2),
        "high": format_angle(overall.loa_high_deg, language, 2),
        "icc": tell_r(overall.icc, language),
        "concordance": tell_r(overall.concordance, language),
        "duration": format_duration(overall.duration_s, language),
        "samples": format_number(overall.count, 0, language),
    }
    rows = tuple((entry["row"][name], value) for name, value in values.items())
    return Table(entry["caption"], tuple(entry["columns"]), rows, entry["note"])


def tabulate_strata(strata: tuple[Stratum, ...], key: str, words: Words, language: Language) -> Table:
    """Give the error in each class; ``key`` is "by_elevation" or "by_speed"."""
    entry, unit = words[key], words[key]["unit"]
    rows = []
    for stratum in strata:
        lower, upper = (format_number(edge, 0, language) for edge in (stratum.lower, stratum.upper))
        form = entry["last" if stratum.upper == float("inf") else "class"]
        errors = (stratum.agreement.rmse_deg, stratum.agreement.mean_absolute_error_deg)
        rows.append(
            (
                fill(form, {"lower": lower, "upper": upper, "unit": unit}),
                format_percent(stratum.percent, language),
                *(format_angle(value, language, 2) for value in (*errors, stratum.agreement.bias_deg)),
            )
        )
    return Table(entry["caption"], tuple(entry["columns"]), tuple(rows))


def tabulate_exposure(figures: tuple[FigureDifference, ...], words: Words, language: Language) -> Table:
    """Give each exposure figure from both sides, and the difference."""
    entry = words["exposure"]
    rows = tuple((name_figure(figure.name, words), *_tell_figure(figure, language)) for figure in figures)
    return Table(entry["caption"], tuple(entry["columns"]), rows, entry["note"])


def name_figure(name: str, words: Words) -> str:
    """Say a figure's name: ``time_30_45_percent`` is "Time at 30–45°"."""
    entry, parts = words["exposure"], name.split("_")
    if name.startswith("time_above"):
        return fill(entry["above"], {"c": parts[2]})
    if parts[0] == "time":
        return fill(entry["bin"], {"low": parts[1], "high": parts[2]})
    if parts[0] == "entries":
        return fill(entry["entries"], {"c": parts[2]})
    return fill(entry["percentile"], {"p": parts[1].removeprefix("p")})


def _tell_figure(figure: FigureDifference, language: Language) -> tuple[str, str, str]:
    values = (figure.ours, figure.reference, figure.difference)
    if figure.name.endswith("_percent"):
        told = [format_percent(value, language) for value in values]
    elif figure.name.endswith("_deg"):
        told = [format_angle(value, language, 1) for value in values]
    else:
        told = [format_number(value, 0, language) for value in values]
    return told[0], told[1], told[2]


def tabulate_repeated(tasks: tuple[TaskAgreement, ...], words: Words, language: Language) -> Table:
    """Give limits of agreement with the repetitions as repeated measures."""
    entry = words["repeated"]
    rows = tuple(
        (
            cut_text(clean_text(task.name), LONGEST_TASK),
            format_number(task.repetitions, 0, language),
            *(
                format_angle(value, language, 2)
                for value in (
                    task.limits.bias_deg,
                    task.limits.low_deg,
                    task.limits.high_deg,
                    task.limits.between_sd_deg,
                    task.limits.within_sd_deg,
                )
            ),
        )
        for task in tasks
        if task.repetitions > 1
    )
    return Table(entry["caption"], tuple(entry["columns"]), rows, entry["note"])


MOST_LAGS = 12


def tabulate_lags(windows: Sequence[WindowLag], words: Words, language: Language) -> Table:
    """Show what each stretch alone said of the clocks, before the last refinement; of many an even choice."""
    entry, last, is_cut = words["windows"], len(windows) - 1, len(windows) > MOST_LAGS
    chosen = [round(k * last / (MOST_LAGS - 1)) for k in range(MOST_LAGS)]
    rows = tuple(
        (
            format_number(windows[k].start_s, 0, language),
            format_number(1000.0 * windows[k].lag_s, 0, language),
            format_number(windows[k].r, 3, language),
        )
        for k in (chosen if is_cut else range(len(windows)))
    )
    cut = {"shown": str(MOST_LAGS), "all": str(len(windows))} if is_cut else {}
    return Table(entry["caption"], tuple(entry["columns"]), rows, fill(entry["note"], cut))
