"""The charts of a report with their words and the tables behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import isfinite, nan

import numpy as np

from app.report.analysis.day import Block, Day, build_timeline
from app.report.charts.bars import PartRow, PartWords, Slice, draw_bar, draw_parts
from app.report.charts.day import DayLabels, draw_day
from app.report.charts.distribution import Distribution, HeatMap, MarkedPercentile, draw_apdf, draw_eva
from app.report.charts.svg import NARROW, WIDE
from app.report.findings import Findings
from app.report.model import Chart, Table
from app.report.words.numbers import (
    Clock,
    format_angle,
    format_angle_range,
    format_duration,
    format_number,
    format_percent,
    percent_sign,
)
from app.report.words.wording import Language, Words, fill, join_clauses
from fusion.conventions import MAIN_THRESHOLD_DEG
from fusion.exposure.types import Eva, Exposure, PartExposure

MARKED_PERCENTILES = (10, 50, 90, 99)
_CELLS_PER_DEG = 10


def build_spread(exposure: Exposure, words: Words, language: Language) -> tuple[Chart, ...]:
    """Build what can be drawn of the distribution: nothing without analysed time."""
    apdf = (build_apdf(exposure, words, language),) if exposure.histogram_s.sum() > 0 else ()
    eva = (build_eva(exposure.eva, words, language),) if exposure.eva.percent.size else ()
    return apdf + eva


# ------------------------------------------------------------------ the curve


def build_apdf(exposure: Exposure, words: Words, language: Language) -> Chart:
    """Build the cumulative distribution with P10, P50, P90 and P99."""
    entry = words["apdf"]
    marks = tuple(
        _mark(p, exposure, entry, language) for p in MARKED_PERCENTILES if p in exposure.percentiles_deg
    )
    told = ", ".join(mark.label for mark in marks)
    title = (entry["title"], fill(entry["alternative"], {"list": told}))
    shown = Distribution(share_below(exposure), marks, tuple(entry["axes"]))
    rows = tuple(
        (f"{degrees}°", format_number(shown.below_percent[degrees], 1, language))
        for degrees in range(10, 181, 10)
    )
    return Chart(
        title=entry["title"],
        alternative=title[1],
        wide=draw_apdf(shown, title, WIDE),
        narrow=draw_apdf(shown, title, NARROW),
        table=Table(entry["title"], tuple(entry["columns"]), rows),
        note=entry["pose_note"] if any(mark.raised_deg is not None for mark in marks) else "",
    )


def share_below(exposure: Exposure) -> tuple[float, ...]:
    """Give the share of the time below each whole degree from 0 to 180, percent."""
    below_s = np.concatenate([[0.0], np.cumsum(exposure.histogram_s)])[::_CELLS_PER_DEG]
    return tuple((100 * below_s / below_s[-1]).tolist())


def _mark(percent: int, exposure: Exposure, entry: Words, language: Language) -> MarkedPercentile:
    angle_deg = exposure.percentiles_deg[percent]
    interval = exposure.intervals.get(f"elevation_p{percent}_deg")
    told = f" ({format_angle_range(interval, language)})" if interval else ""
    label = fill(entry["mark"], {"percent": str(percent), "angle": format_angle(angle_deg, language)}) + told
    ends = (interval.low, interval.high) if interval else None
    return MarkedPercentile(percent, angle_deg, ends, label, interval.high_pose if interval else None)


# ------------------------------------------------------------------ exposure variation


def build_eva(eva: Eva, words: Words, language: Language) -> Chart:
    """Build the heat map of elevation by how long the arm stayed in its class."""
    entry = words["eva"]
    shown = HeatMap(
        rows=format_classes(eva.angle_edges_deg, "°"),
        columns=format_classes(eva.duration_edges_s, "\u202fs"),
        percent=eva.percent.tolist(),
        told=tuple(_format_all(row, language) for row in eva.percent),
        row_sums=_format_all(eva.percent.sum(axis=1), language),
        column_sums=_format_all(eva.percent.sum(axis=0), language),
        axes=tuple(entry["axes"]),
    )
    told = ", ".join(
        f"{name}: {', '.join(cells)}" for name, cells in zip(shown.rows, shown.told, strict=True)
    )
    facts = {"columns": ", ".join(shown.columns), "list": told}
    title = (entry["title"], fill(entry["alternative"], facts))
    rows = zip(shown.rows, shown.told, shown.row_sums, strict=True)
    columns = (shown.axes[0], *shown.columns, shown.axes[2])
    return Chart(
        title=entry["title"],
        alternative=title[1],
        wide=draw_eva(shown, title, WIDE),
        narrow=draw_eva(shown, title, NARROW),
        table=Table(entry["title"], columns, tuple((name, *cells, total) for name, cells, total in rows)),
        note=entry["note"],
    )


def _format_all(values: Sequence[float], language: Language) -> tuple[str, ...]:
    return tuple(format_number(float(value), 1, language) for value in values)


def format_classes(edges: Sequence[float | None], unit: str) -> tuple[str, ...]:
    """Write classes by their edges: "3–7 s"; the last may be open."""
    return tuple(
        f"≥ {low:g}{unit}" if high is None else f"{low:g}–{high:g}{unit}" for low, high in pairwise(edges)
    )


SHOWN_EDGES_DEG = (0, 30, 60, 90, 180)
"""The stored bins are finer; every bar shows these classes, whose edges are the three guide lines."""


def build_bar(exposure: Exposure, words: Words, language: Language) -> Chart:
    """Build the stacked bar of time in the classes of elevation."""
    entry, slices = words["bar"], []
    for low, high in pairwise(SHOWN_EDGES_DEG):
        inside = [b for b in exposure.bins if low <= b.lower_deg and b.upper_deg <= high]
        percent, duration_s = sum(b.percent for b in inside), sum(b.duration_s for b in inside)
        labels = format_duration(duration_s, language), format_percent(percent, language)
        slices.append(Slice(percent, f"{low}–{high}°", *labels))
    told = join_clauses(
        (f"{s.range_label}, {s.duration_label} ({s.percent_label})" for s in slices), language
    )
    described = fill(entry["alternative"], {"list": told})
    title = (entry["title"], described)
    rows = tuple((s.range_label, s.duration_label, s.percent_label) for s in slices)
    return Chart(
        title=entry["title"],
        alternative=described,
        wide=draw_bar(slices, title, WIDE),
        narrow=draw_bar(slices, title, NARROW),
        table=Table(entry["title"], tuple(entry["columns"]), rows),
    )


def build_day(findings: Findings, blocks: tuple[Block, ...], clock: Clock, words: Words) -> Chart:
    """Build the timeline of the day, with the periods under it."""
    day = replace(build_timeline(findings, clock, words), blocks=blocks)
    labels, entry, language = _build_labels(findings, day, words), words["day"], clock.language
    rows = tuple(
        (
            clock.format(band.start_s),
            *(format_angle(deg, language) for deg in (band.low_deg, band.middle_deg, band.high_deg)),
        )
        for run in day.runs
        for band in run
    )
    return Chart(
        title=labels.title,
        alternative=labels.description,
        wide=draw_day(day, labels, WIDE),
        narrow=draw_day(day, labels, NARROW),
        table=Table(entry["title"], tuple(entry["columns"]), rows, note=entry["table_note"]),
    )


def _build_labels(findings: Findings, day: Day, words: Words) -> DayLabels:
    entry, clock = words["day"], day.clock
    percent = next((w.percent_above_60 for w in findings.exposure.peak_windows if w.length_s == 900), None)
    stay = next(e for e in findings.exposure.episodes if e.threshold_deg == MAIN_THRESHOLD_DEG)
    facts = {
        "start": clock.format(0),
        "end": clock.format(day.duration_s),
        "p10": format_angle(findings.exposure.percentiles_deg.get(10), clock.language),
        "p50": format_angle(findings.exposure.percentiles_deg.get(50), clock.language),
        "p90": format_angle(findings.exposure.percentiles_deg.get(90), clock.language),
        "marks": join_clauses(
            (f"{m.label}, {clock.format(m.start_s)}–{clock.format(m.end_s)}" for m in day.marks),
            clock.language,
        ),
    }
    return replace(
        build_day_labels(entry["title"], fill(entry["alternative"], facts), words),
        worst=fill(entry["worst"], {"percent": format_percent(percent, clock.language)}),
        longest=fill(entry["longest"], {"duration": format_duration(stay.longest_s, clock.language)}),
    )


def build_day_labels(title: str, description: str, words: Words) -> DayLabels:
    """Give the words of a timeline; those of its legend are the same in every report."""
    entry = words["day"]
    return DayLabels(
        title=title,
        description=description,
        band=entry["band"],
        median=entry["median"],
        left_out=entry["left_out"],
        missing=entry["missing"],
    )


def build_parts(
    key: str, parts: Sequence[tuple[str, PartExposure]], words: Words, language: Language
) -> Chart:
    """Build one stacked bar for each hour (``key`` "hours") or period of the diary ("periods")."""
    entry = words[key]
    rows = [_stack_part(name, part, entry, language) for name, part in parts if is_shown(part)]
    told = join_clauses((f"{row.name}, {row.label or row.left_out}" for row in rows), language)
    title = (entry["title"], fill(entry["alternative"], {"list": told}))
    classes, sign = format_classes(SHOWN_EDGES_DEG, "°"), percent_sign(language)
    told_rows = tuple(
        (row.name, *(format_percent(row.percent[k] if row.percent else None, language) for k in range(4)))
        for row in rows
    )
    labels = PartWords(title, tuple(classes), ("0", f"50{sign}", f"100{sign}"))
    return Chart(
        title=entry["title"],
        alternative=title[1],
        wide=draw_parts(key, rows, labels, WIDE),
        narrow=draw_parts(key, rows, labels, NARROW),
        table=Table(entry["title"], (entry["column"], *classes), told_rows),
    )


def is_drawable(part: PartExposure) -> bool:
    """Return whether a part holds analysed time and its three shares."""
    return part.analysed_s > 0 and all(isfinite(part.percent_above.get(c, nan)) for c in (30, 60, 90))


def is_shown(part: PartExposure) -> bool:
    """Return whether a part has a row in its chart: it can be drawn, or it was left out for a reason."""
    return is_drawable(part) or bool(part.reason)


def _stack_part(name: str, part: PartExposure, entry: Words, language: Language) -> PartRow:
    if not is_drawable(part):
        length = format_duration(part.recorded_s, language)
        return PartRow(name, (), "", left_out=fill(entry["left_out"], {"length": length}))
    above = part.percent_above
    shares = (100 - above[30], above[30] - above[60], above[60] - above[90], above[90])
    return PartRow(name, shares, format_percent(above[60], language))
