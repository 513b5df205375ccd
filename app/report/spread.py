"""The charts of the distribution: the curve with its percentiles, and exposure variation."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from app.report.apdf import Distribution, MarkedPercentile, draw_apdf
from app.report.eva_map import HeatMap, draw_eva
from app.report.numbers import format_angle, format_angle_range, format_number
from app.report.parts import Figure, Table
from app.report.svg import NARROW, WIDE
from app.report.wording import Language, Words, fill
from fusion.exposure.types import Eva, Exposure

MARKED_PERCENTILES = (10, 50, 90, 99)
_CELLS_PER_DEG = 10


def build_spread(exposure: Exposure, words: Words, language: Language) -> tuple[Figure, ...]:
    """Build what can be drawn of the distribution: nothing without analysed time."""
    apdf = (build_apdf(exposure, words, language),) if exposure.histogram_s.sum() > 0 else ()
    eva = (build_eva(exposure.eva, words, language),) if exposure.eva.percent.size else ()
    return apdf + eva


# ------------------------------------------------------------------ the curve


def build_apdf(exposure: Exposure, words: Words, language: Language) -> Figure:
    """Build the cumulative distribution with P10, P50, P90 and P99."""
    entry = words["apdf"]
    marks = tuple(
        _mark(p, exposure, entry, language) for p in MARKED_PERCENTILES if p in exposure.percentiles_deg
    )
    told = ", ".join(mark.label for mark in marks)
    title = (entry["title"], fill(entry["alternative"], {"list": told}))
    shown = Distribution(share_below(exposure), marks, tuple(entry["axes"]))
    return Figure(
        title=entry["title"],
        alternative=title[1],
        wide=draw_apdf(shown, title, WIDE),
        narrow=draw_apdf(shown, title, NARROW),
        table=_tabulate_curve(shown.below_percent, entry, language),
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
    return MarkedPercentile(percent, angle_deg, (interval.low, interval.high) if interval else None, label)


def _tabulate_curve(below_percent: Sequence[float], entry: Words, language: Language) -> Table:
    rows = tuple(
        (f"{degrees}°", format_number(below_percent[degrees], 1, language)) for degrees in range(10, 181, 10)
    )
    return Table(entry["title"], tuple(entry["columns"]), rows)


# ------------------------------------------------------------------ exposure variation


def build_eva(eva: Eva, words: Words, language: Language) -> Figure:
    """Build the heat map of elevation by how long the arm stayed in its class."""
    entry = words["eva"]
    shown = _lay_out(eva, entry, language)
    told = ", ".join(
        f"{name}: {', '.join(cells)}" for name, cells in zip(shown.rows, shown.told, strict=True)
    )
    facts = {"columns": ", ".join(shown.columns), "list": told}
    title = (entry["title"], fill(entry["alternative"], facts))
    return Figure(
        title=entry["title"],
        alternative=title[1],
        wide=draw_eva(shown, title, WIDE),
        narrow=draw_eva(shown, title, NARROW),
        table=_tabulate_map(shown, entry),
        note=entry["note"],
    )


def _lay_out(eva: Eva, entry: Words, language: Language) -> HeatMap:
    return HeatMap(
        rows=name_classes(eva.angle_edges_deg, "°"),
        columns=name_classes(eva.duration_edges_s, "\u202fs"),
        percent=eva.percent.tolist(),
        told=tuple(_tell_all(row, language) for row in eva.percent),
        row_sums=_tell_all(eva.percent.sum(axis=1), language),
        column_sums=_tell_all(eva.percent.sum(axis=0), language),
        axes=tuple(entry["axes"]),
    )


def _tell_all(values: Sequence[float], language: Language) -> tuple[str, ...]:
    return tuple(format_number(float(value), 1, language) for value in values)


def _tabulate_map(shown: HeatMap, entry: Words) -> Table:
    rows = [
        (name, *cells, total)
        for name, cells, total in zip(shown.rows, shown.told, shown.row_sums, strict=True)
    ]
    return Table(entry["title"], (shown.axes[0], *shown.columns, shown.axes[2]), tuple(rows))


def name_classes(edges: Sequence[float | None], unit: str) -> tuple[str, ...]:
    """Name classes by their edges: "3–7 s"; the last may be open."""
    return tuple(
        f"≥ {low:g}{unit}" if high is None else f"{low:g}–{high:g}{unit}" for low, high in pairwise(edges)
    )
