"""The charts of a report with their words and the tables behind them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import isfinite, nan

from app.report.clock import Clock
from app.report.day import Day, draw_up_day
from app.report.figures import Slice, draw_bar
from app.report.findings import Findings
from app.report.numbers import format_angle, format_duration, format_percent
from app.report.part_bars import PartRow, draw_parts
from app.report.parts import Figure, Table
from app.report.svg import NARROW, WIDE
from app.report.timeline import DayLabels, draw_day
from app.report.wording import Language, Words, fill
from fusion.exposure.types import Exposure, PartExposure

SHOWN_EDGES_DEG = (0, 30, 60, 90, 120, 180)
"""The stored bins are finer; the page shows five classes that hold whole bins and the three guide lines."""


def build_bar(exposure: Exposure, words: Words, language: Language) -> Figure:
    """Build the stacked bar of time in five elevation classes."""
    slices = _slice_exposure(exposure, language)
    entry = words["bar"]
    told = "; ".join(f"{s.range_label}, {s.duration_label} ({s.percent_label})" for s in slices)
    described = fill(entry["alternative"], {"list": told})
    title = (entry["title"], described)
    rows = tuple((s.range_label, s.duration_label, s.percent_label) for s in slices)
    return Figure(
        title=entry["title"],
        alternative=described,
        wide=draw_bar(slices, title, WIDE),
        narrow=draw_bar(slices, title, NARROW),
        table=Table(entry["title"], tuple(entry["columns"]), rows),
    )


def _slice_exposure(exposure: Exposure, language: Language) -> list[Slice]:
    slices = []
    for low, high in pairwise(SHOWN_EDGES_DEG):
        inside = [b for b in exposure.bins if low <= b.lower_deg and b.upper_deg <= high]
        percent, duration_s = sum(b.percent for b in inside), sum(b.duration_s for b in inside)
        label = f"{low}–{high}°"
        told = format_duration(duration_s, language), format_percent(percent, language)
        slices.append(Slice(percent, label, *told))
    return slices


def build_day(findings: Findings, clock: Clock, words: Words) -> Figure:
    """Build the timeline of the day."""
    day = draw_up_day(findings, clock, words)
    labels = _label_day(findings, day, words)
    return Figure(
        title=labels.title,
        alternative=labels.description,
        wide=draw_day(day, labels, WIDE),
        narrow=draw_day(day, labels, NARROW),
        table=_tabulate_day(day, words),
    )


def _label_day(findings: Findings, day: Day, words: Words) -> DayLabels:
    entry, clock = words["day"], day.clock
    percent = next((w.percent_above_60 for w in findings.exposure.peak_windows if w.length_s == 900), None)
    worst = fill(entry["worst"], {"percent": format_percent(percent, clock.language)})
    facts = {
        "start": clock.tell(0),
        "end": clock.tell(day.duration_s),
        "p10": format_angle(findings.exposure.percentiles_deg.get(10), clock.language),
        "p50": format_angle(findings.exposure.percentiles_deg.get(50), clock.language),
        "p90": format_angle(findings.exposure.percentiles_deg.get(90), clock.language),
        "marks": "; ".join(f"{m.label}, {clock.tell(m.start_s)}–{clock.tell(m.end_s)}" for m in day.marks),
    }
    return label_day(entry["title"], fill(entry["alternative"], facts), words, worst)


def label_day(title: str, description: str, words: Words, worst: str = "") -> DayLabels:
    """Give the words of a timeline; those of its legend are the same in every report."""
    entry = words["day"]
    return DayLabels(
        title=title,
        description=description,
        band=entry["band"],
        median=entry["median"],
        left_out=entry["left_out"],
        missing=entry["missing"],
        worst=worst,
    )


def _tabulate_day(day: Day, words: Words) -> Table:
    entry, language = words["day"], day.clock.language
    rows = tuple(
        (
            day.clock.tell(band.start_s),
            format_angle(band.low_deg, language),
            format_angle(band.middle_deg, language),
            format_angle(band.high_deg, language),
        )
        for run in day.runs
        for band in run
    )
    return Table(entry["title"], tuple(entry["columns"]), rows, note=entry["table_note"])


def build_parts(
    key: str, parts: Sequence[tuple[str, PartExposure]], words: Words, language: Language
) -> Figure:
    """Build one stacked bar for each hour (``key`` "hours") or period of the diary ("periods")."""
    entry = words[key]
    rows = [_stack_part(name, part, entry, language) for name, part in parts if is_shown(part)]
    told = "; ".join(f"{row.name}, {row.label or row.left_out}" for row in rows)
    title = (entry["title"], fill(entry["alternative"], {"list": told}))
    classes = ("0–30°", "30–60°", "60–90°", "90–180°")
    return Figure(
        title=entry["title"],
        alternative=title[1],
        wide=draw_parts(key, rows, classes, title, WIDE),
        narrow=draw_parts(key, rows, classes, title, NARROW),
        table=Table(entry["title"], (entry["column"], *classes), _tabulate_rows(rows, language)),
    )


def _tabulate_rows(rows: Sequence[PartRow], language: Language) -> tuple[tuple[str, ...], ...]:
    return tuple(
        (row.name, *(format_percent(row.percent[k] if row.percent else None, language) for k in range(4)))
        for row in rows
    )


def is_drawable(part: PartExposure) -> bool:
    """Tell whether a part holds analysed time and its three shares."""
    return part.analysed_s > 0 and all(isfinite(part.percent_above.get(c, nan)) for c in (30, 60, 90))


def is_shown(part: PartExposure) -> bool:
    """Tell whether a part has a row in its chart: it can be drawn, or it was left out for a reason."""
    return is_drawable(part) or bool(part.reason)


def _stack_part(name: str, part: PartExposure, entry: Words, language: Language) -> PartRow:
    if not is_drawable(part):
        length = format_duration(part.recorded_s, language)
        return PartRow(name, (), "", left_out=fill(entry["left_out"], {"length": length}))
    above = part.percent_above
    shares = (100 - above[30], above[30] - above[60], above[60] - above[90], above[90])
    return PartRow(name, shares, format_percent(above[60], language))
