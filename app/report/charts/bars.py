"""Stacked bars as SVG: of the whole recording, and one for each part of the day.

HTML and PDF contain the same strings. Elevation is a single-hue ramp from light to dark; highlights are
vermillion and also marked by a shape or a word, so that prints in grey lose nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite, nan

from acromion.app.report.charts import svg
from acromion.app.report.charts.svg import NARROW
from acromion.app.report.model import Chart
from acromion.app.report.words.numbers import (
    NONE,
    format_classes,
    format_duration,
    format_percent,
    percent_sign,
    round_classes,
)
from acromion.app.report.words.wording import Language, Words, fill, join_clauses
from acromion.fusion.exposure.types import Exposure, PartExposure

SHOWN_EDGES_DEG = (0, 30, 60, 90, 180)
"""Classes of every bar; the stored bins are finer. Their edges are the three guide lines."""
_LONGEST_SHARE = 0.42
"""Names wider than this share of the width are above their bars."""

# The stacked bar.


@dataclass(frozen=True, slots=True)
class Slice:
    """One class of the stacked bar with its labels."""

    percent: float
    range_label: str
    duration_label: str
    percent_label: str


def build_bar(exposure: Exposure, words: Words, language: Language) -> Chart:
    """Build the stacked bar of time in the classes of elevation."""
    entry, slices, sign = words["bar"], [], percent_sign(language)
    classes = [
        [b for b in exposure.bins if low <= b.lower_deg and b.upper_deg <= high]
        for low, high in pairwise(SHOWN_EDGES_DEG)
    ]
    percents = [sum(b.percent for b in inside) for inside in classes]
    shown = zip(format_classes(SHOWN_EDGES_DEG, "°"), classes, percents, round_classes(percents), strict=True)
    for name, inside, percent, whole in shown:
        duration = format_duration(sum(b.duration_s for b in inside), language)
        slices.append(Slice(percent, name, duration, f"{whole}{sign}"))
    told = (f"{s.range_label}, {s.duration_label} ({s.percent_label})" for s in slices)
    return Chart.draw(
        (entry["title"], fill(entry["alternative"], {"list": join_clauses(told, language)})),
        lambda title, width_px: draw_bar(slices, title, width_px),
        entry["columns"],
        ((s.range_label, s.duration_label, s.percent_label) for s in slices),
    )


def draw_bar(slices: Sequence[Slice], words: tuple[str, str], width_px: float) -> str:
    """Draw time in elevation classes: one bar, with the classes below."""
    body, x = [], 0.5
    for rank, item in enumerate(slices):
        length = (width_px - 1) * item.percent / 100
        if length > 0:
            body.append(svg.rect(x, 0.5, length, 30, f'class="bar" fill="{svg.RAMP[rank]}"'))
        if length > svg.estimate_width(item.percent_label) + 8:
            kind = "light" if rank >= 2 else "onlight"
            body.append(svg.text(x + length / 2, 19.5, item.percent_label, kind, "middle"))
        x += length
    body.append(svg.rect(0.5, 0.5, width_px - 1, 30, svg.EDGE))
    is_wide = width_px > NARROW
    for rank, item in enumerate(slices):
        x, y = (rank * width_px / len(slices), 48.0) if is_wide else (0.0, 48.0 + rank * 20)
        body += [svg.swatch(x + 0.5, y, rank), svg.text(x + 16, y, item.range_label, "strong")]
        if is_wide:
            body.append(svg.text(x + 16, y + 15, item.percent_label, "ink"))
            body.append(svg.text(x + 16, y + 29, item.duration_label))
        else:
            body.append(svg.text(width_px - 100, y, item.percent_label, "ink", "end"))
            body.append(svg.text(width_px, y, item.duration_label, "soft", "end"))
    height = 34 + (48 if is_wide else len(slices) * 20 + 8)
    return svg.picture(width_px, height, f"bar{width_px:.0f}", words, body)


# One bar for each part of the day. The parts are clock hours or periods of the diary. An excluded part is
# hatched and labelled, so that it does not look like a part without load.


@dataclass(frozen=True, slots=True)
class _PartRow:
    """A part of the day: name, shares from low to high elevation (empty if excluded), label at its end."""

    name: str
    percent: tuple[float, ...]
    label: str
    left_out: str = ""


def build_parts(
    key: str, parts: Sequence[tuple[str, PartExposure]], words: Words, language: Language, note: str = ""
) -> Chart:
    """Build one stacked bar for each hour (``key`` "hours") or period of the diary ("periods")."""
    entry, rows = words[key], []
    for name, part in parts:
        above = part.time_above_percent
        if is_drawable(part):
            shares = (100 - above[30], above[30] - above[60], above[60] - above[90], above[90])
            rows.append(_PartRow(name, shares, format_percent(above[60], language)))
        elif part.reason:
            length = format_duration(part.recorded_s, language)
            rows.append(_PartRow(name, (), "", fill(entry["left_out"], {"length": length})))
    shown = join_clauses((f"{row.name}, {row.label or row.left_out}" for row in rows), language)
    classes, sign = format_classes(SHOWN_EDGES_DEG, "°"), percent_sign(language)
    return Chart.draw(
        (entry["title"], fill(entry["alternative"], {"list": shown})),
        lambda title, width_px: _draw_parts(key, rows, sign, title, width_px),
        (entry["column"], *classes),
        (
            (row.name, *([f"{whole}{sign}" for whole in round_classes(row.percent)] or [NONE] * len(classes)))
            for row in rows
        ),
        note,
    )


def is_drawable(part: PartExposure) -> bool:
    """Return whether a part has analysed time and its three shares."""
    return part.analysed_s > 0 and all(isfinite(part.time_above_percent.get(c, nan)) for c in (30, 60, 90))


def _draw_parts(
    key: str, rows: Sequence[_PartRow], sign: str, words: tuple[str, str], width_px: float
) -> str:
    """Draw a stacked bar for each part on one scale, ending with the share at or above 60 deg."""
    key = f"{key}{width_px:.0f}"
    longest = max(svg.estimate_width(row.name) for row in rows)
    right = width_px - max(svg.estimate_width(row.label) for row in rows) - 8
    is_above = longest > width_px * _LONGEST_SHARE
    left, row_height, bar_top = (0.5, 36.0, 17.0) if is_above else (longest + 8, 18.0, 2.0)
    body = [svg.define_hatch(key), svg.text(width_px, 10, "≥ 60°", "soft", "end")]
    for rank, row in enumerate(rows):
        y = 14 + rank * row_height
        body.append(svg.text(0, y + 12, svg.shorten(row.name, width_px if is_above else left)))
        body += _draw_part(row, left, right, y + bar_top, key)
        body.append(svg.text(width_px, y + bar_top + 10, row.label, "ink", "end"))
    bottom = len(rows) * row_height + 28
    scale = ((left, "0", "start"), ((left + right) / 2, f"50{sign}", "middle"), (right, f"100{sign}", "end"))
    body += [svg.text(x, bottom, shown, "soft", anchor) for x, shown, anchor in scale]
    y, start = bottom + 18, 0.5 if width_px <= NARROW else left
    x = start
    for rank, name in enumerate(format_classes(SHOWN_EDGES_DEG, "°")):
        length = 14 + svg.estimate_width(name) + 10
        if x > start and x + length > width_px:
            x, y = start, y + 16
        body += [svg.swatch(x, y, rank), svg.text(x + 14, y, name)]
        x += length
    return svg.picture(width_px, y + 8, key, words, body)


def _draw_part(row: _PartRow, left_px: float, right_px: float, y_px: float, key: str) -> list[str]:
    """Draw the framed bar of a part; hatch and label an excluded part."""
    body, x = [], left_px
    if row.left_out:
        middle, length = (left_px + right_px) / 2, svg.estimate_width(row.left_out) + 8
        hatch = f'fill="url(#{key}-h)" fill-opacity="0.55"'
        body = [
            svg.rect(left_px, y_px, right_px - left_px, 13, hatch),
            svg.rect(middle - length / 2, y_px, length, 13, svg.PLATE),
            svg.text(middle, y_px + 10, row.left_out, "ink", "middle"),
        ]
    for rank, percent in enumerate(row.percent):
        length = (right_px - left_px) * max(percent, 0.0) / 100
        if length > 0:
            body.append(svg.rect(x, y_px, length, 13, f'class="bar" fill="{svg.RAMP[rank]}"'))
        x += length
    frame = f'{svg.EDGE} stroke-width="0.7"'
    return [*body, svg.rect(left_px, y_px, right_px - left_px, 13, frame)]
