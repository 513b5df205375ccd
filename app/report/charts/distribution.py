"""The distribution of elevation as SVG: share of the time below each angle (APDF).

Amplitude probability distribution function (Jonsson 1982): the curve rises from 0 % at 0 deg to 100 % at 180
deg. Four percentiles are marked, each with its range for measurement error if known; the possible addition by
the error of the N-pose is hatched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acromion.app.report.charts import svg
from acromion.app.report.charts.svg import GUIDES_DEG, NARROW, Plot, Span
from acromion.app.report.model import Chart
from acromion.app.report.words.numbers import format_angle, format_angle_range, format_classes, format_number
from acromion.app.report.words.wording import Language, Words, fill, load_wording
from acromion.fusion.exposure.types import Eva, Exposure

MARKED_PERCENTILES = (10, 50, 90, 99)
_CELLS_PER_DEG = 10
_PERCENTS = (0.0, 100.0)
_REACHED_PERCENT = 99.95


def build_spread(exposure: Exposure, words: Words, language: Language) -> tuple[Chart, ...]:
    """Build the charts of the distribution; none without analysed time."""
    apdf = (_build_apdf(exposure, words["apdf"], language),) if exposure.histogram_s.sum() > 0 else ()
    eva = (_build_eva(exposure.eva, words["eva"], language),) if exposure.eva.percent.size else ()
    return apdf + eva


def compute_share_below(exposure: Exposure) -> tuple[float, ...]:
    """Return the share of the time below each whole degree from 0 to 180, in percent."""
    below_s = np.concatenate([[0.0], np.cumsum(exposure.histogram_s)])[::_CELLS_PER_DEG]
    return tuple((100 * below_s / below_s[-1]).tolist())


# The curve.


@dataclass(frozen=True, slots=True)
class _MarkedPercentile:
    """A percentile on the curve; ``interval`` and the highest value with the N-pose's error, in degrees."""

    percent: int
    angle_deg: float
    interval: Span | None
    label: str
    raised_deg: float | None


def _build_apdf(exposure: Exposure, entry: Words, language: Language) -> Chart:
    below, marks = compute_share_below(exposure), []
    for percent in MARKED_PERCENTILES:
        if percent not in exposure.percentiles_deg:
            continue
        angle_deg = exposure.percentiles_deg[percent]
        interval = exposure.intervals.get(f"elevation_p{percent}_deg")
        facts = {"percent": str(percent), "angle": format_angle(angle_deg, language)}
        shown = f" ({format_angle_range(interval, language)})" if interval else ""
        ends = (interval.low, interval.high) if interval else None
        raised_deg = interval.high_pose if interval else None
        marks.append(
            _MarkedPercentile(percent, angle_deg, ends, fill(entry["mark"], facts) + shown, raised_deg)
        )
    is_raised = any(mark.raised_deg is not None for mark in marks)

    def draw(words: tuple[str, str], width_px: float) -> str:
        bottom, key = 208 if width_px > NARROW else 238, f"apdf{width_px:.0f}"
        plot = Plot(40, width_px - 8, 30, bottom, upwards=_PERCENTS)
        dash = f'{svg.RULE} stroke-width="0.7" stroke-dasharray="3 3"'
        across, upwards = entry["axes"]
        body = [
            *([svg.define_hatch(key)] if is_raised else []),
            *(svg.line(plot.x(deg), plot.top_px, plot.x(deg), bottom, dash) for deg in GUIDES_DEG),
            *_mark_percents(plot),
            *(_label_angle(angle, plot) for angle in range(0, 181, 30)),
            svg.text(plot.right_px, bottom + 30, across, "soft", "end"),
            svg.text(0, 10, upwards),
            svg.line(plot.left_px, plot.top_px, plot.left_px, bottom, svg.RULE),
            plot.draw_baseline(),
            plot.follow(enumerate(below), f'{svg.CURVE} stroke-width="1.8" stroke-linejoin="round"'),
            *(stroke for mark in marks for stroke in _draw_mark(mark, plot, key)),
        ]
        return svg.picture(width_px, bottom + 34, key, words, body)

    return Chart.draw(
        (entry["title"], fill(entry["alternative"], {"list": ", ".join(mark.label for mark in marks)})),
        draw,
        entry["columns"],
        ((f"{deg}°", format_number(below[deg], 1, language)) for deg in range(10, 181, 10)),
        entry["pose_note"] if is_raised else "",
    )


def _mark_percents(plot: Plot) -> list[str]:
    body = []
    for percent in (0, 25, 50, 75, 100):
        y = plot.y(percent)
        body.append(svg.line(plot.left_px - 4, y, plot.left_px, y, svg.RULE))
        body.append(svg.text(plot.left_px - 7, y + 3.8, f"{percent}", "soft", "end"))
    return body


def _label_angle(angle: int, plot: Plot) -> str:
    kind, anchor = "strong" if angle == 60 else "soft", "end" if angle == plot.across[1] else "middle"
    return svg.text(plot.x(angle), plot.bottom_px + 15, f"{angle}°", kind, anchor)


def _draw_mark(mark: _MarkedPercentile, plot: Plot, key: str) -> list[str]:
    """Draw the point and its label on the right, where the curve has already risen above it.

    The label is beside a low percentile, and below a high one, where the curve is flat; that of the highest
    is above the curve, where it hides no range. A plate hides the guides.
    """
    x, y = plot.x(mark.angle_deg), plot.y(mark.percent)
    body, end = [], x
    if mark.interval is not None:
        low, end = (plot.x(value) for value in mark.interval)
        body = svg.range_bar(low, end, y)
    if mark.raised_deg is not None and plot.x(mark.raised_deg) > end:
        raised = plot.x(mark.raised_deg)
        body += svg.hatch(end, y - 3, raised - end, 6, key)
        end = raised
    dot = f"M{svg.number(x - 4)} {svg.number(y)}l4 -4l4 4l-4 4Z"
    length, is_high = svg.estimate_width(mark.label), mark.percent > 50
    place = min((x if is_high else max(x, end)) + 8, plot.right_px - length)
    baseline = y + (-7 if mark.percent == MARKED_PERCENTILES[-1] else 15 if is_high else 3.8)
    return [
        *body,
        svg.path(dot, f'class="mark" fill="{svg.RAMP[3]}" stroke="{svg.PAPER}"'),
        svg.rect(place - 2, baseline - 9, length, 11, svg.PLATE),
        svg.text(place, baseline, mark.label, "strong"),
    ]


# Two distributions in one chart. The blue curve is solid and the vermillion one dashed, so that they differ
# in grey prints.


_STYLES = (
    f'{svg.CURVE} stroke-width="2"',
    f'{svg.ACCENT_CURVE} stroke-width="2" stroke-dasharray="6 3"',
)


def build_two_curves(named: Sequence[tuple[str, Exposure]], entry: Words, language: Language) -> Chart:
    """Build a chart of both distributions on one scale, with guide lines at 30, 60 and 90 deg.

    The scale ends at the first guide line with 100 % of both, as printed.
    """
    (first, _), (second, _) = named
    below = [compute_share_below(exposure) for _, exposure in named]
    reached = (deg for deg in range(90, 180, 30) if all(curve[deg] >= _REACHED_PERCENT for curve in below))
    end_deg = next(reached, 180)

    def draw(words: tuple[str, str], width_px: float) -> str:
        bottom = 210.0 if width_px > NARROW else 240.0
        plot = Plot(40.0, width_px - 8, 40.0, bottom, (0.0, end_deg), _PERCENTS)
        dash = f'{svg.RULE} stroke-width="0.7" stroke-dasharray="3 3"'
        body = [
            svg.line(plot.left_px, plot.top_px, plot.left_px, bottom, svg.RULE),
            plot.draw_baseline(),
            *_mark_percents(plot),
        ]
        for angle in range(0, end_deg + 1, 30):
            if angle in GUIDES_DEG:
                body.append(svg.line(plot.x(angle), plot.top_px, plot.x(angle), bottom, dash))
            body.append(_label_angle(angle, plot))
        across, upwards = entry["axes"]
        body += [svg.text(plot.right_px, bottom + 30, across, "soft", "end"), svg.text(0, 28, upwards)]
        shown = [curve[: end_deg + 1] for curve in below]
        body += [plot.follow(enumerate(curve), style) for curve, style in zip(shown, _STYLES, strict=True)]
        x = plot.left_px
        for name, style in zip((first, second), _STYLES, strict=True):
            body += [svg.line(x, 6, x + 26, 6, style), svg.text(x + 31, 10, name, "ink")]
            x += 31 + svg.estimate_width(name) + 16
        return svg.picture(width_px, bottom + 34, f"curves{width_px:.0f}", words, body)

    return Chart.draw(
        (entry["title"], fill(entry["alternative"], {"first": first, "second": second})),
        draw,
        (entry["column"], first, second),
        (
            (f"{deg}°", *(format_number(curve[deg], 1, language) for curve in below))
            for deg in range(10, 181, 10)
        ),
    )


# Exposure variation. A heat map of elevation by duration (Mathiassen and Winkel 1991). Every cell shows its
# number, so that nothing depends on the shade.


SHADES_PERCENT = (0.05, 1.0, 3.0, 6.0, 12.0)
"""Lower limit of each shade as a share of the time; below the first a cell stays white."""


@dataclass(frozen=True, slots=True)
class _Grid:
    """Rows from the top, columns from the left; cells in percent and as text, sums of rows and columns."""

    rows: Sequence[str]
    columns: Sequence[str]
    cells: Sequence[Sequence[tuple[float, str]]]
    row_sums: Sequence[str]
    column_sums: Sequence[str]


def _build_eva(eva: Eva, entry: Words, language: Language) -> Chart:
    def tell(values: Sequence[float]) -> tuple[str, ...]:
        return tuple(format_number(float(value), 1, language) for value in values)

    rows, columns = format_classes(eva.angle_edges_deg, "°"), format_classes(eva.duration_edges_s, "\u202fs")
    cells = [list(zip(row.tolist(), tell(row), strict=True)) for row in eva.percent]
    row_sums, column_sums = tell(eva.percent.sum(axis=1)), tell(eva.percent.sum(axis=0))
    highest_first = _Grid(rows[::-1], columns, cells[::-1], row_sums[::-1], column_sums)
    plain = [name.removesuffix("°") for name in rows]  # the sign is written once, so that names do not touch
    turned = _Grid(columns, plain, list(zip(*cells, strict=True)), column_sums, row_sums)
    line = load_wording(language)["label"]["brief_fact"]
    shown = ", ".join(
        fill(line, {"name": name, "value": ", ".join(shown for _, shown in row)})
        for name, row in zip(rows, cells, strict=True)
    )
    by_rows, _, sums = entry["axes"]
    return Chart.draw(
        (entry["title"], fill(entry["alternative"], {"columns": ", ".join(columns), "list": shown})),
        lambda words, width_px: _draw_eva(
            turned if width_px <= NARROW else highest_first, entry["axes"], words, width_px
        ),
        (by_rows, *columns, sums),
        (
            (name, *(shown for _, shown in row), total)
            for name, row, total in zip(rows, cells, row_sums, strict=True)
        ),
        entry["note"],
    )


def _draw_eva(grid: _Grid, axes: Sequence[str], words: tuple[str, str], width_px: float) -> str:
    """Draw the map; on a phone transposed, so that its numbers stay as large."""
    by_rows, by_columns, sums = axes
    left = max(svg.estimate_width(name) for name in (*grid.rows, sums)) + 8
    cell = (width_px - left) / (len(grid.columns) + 1)
    middles = [left + (rank + 0.5) * cell for rank in range(len(grid.columns) + 1)]
    if width_px <= NARROW:
        body = [svg.text(left - 4, 25, "°", anchor="end"), svg.text(0, 10, by_columns)]
    else:
        body = [svg.text(0, 25, by_rows), svg.text(left, 10, by_columns)]
    for x, name in zip(middles, (*grid.columns, sums), strict=True):
        body.append(svg.text(x, 25, name, "soft", "middle"))
    for rank, (name, row) in enumerate(zip(grid.rows, grid.cells, strict=True)):
        y = 32 + rank * 22.0
        body.append(svg.text(0, y + 15, name, "ink"))
        for place, (percent, shown) in enumerate(row):
            body += _draw_cell(left + place * cell, y, cell, percent, shown)
        body.append(svg.text(middles[-1], y + 15, grid.row_sums[rank], "ink", "middle"))
    y = 32 + len(grid.rows) * 22 + 15
    body.append(svg.text(0, y, sums))
    for x, shown in zip(middles, grid.column_sums, strict=False):
        body.append(svg.text(x, y, shown, "ink", "middle"))
    return svg.picture(width_px, y + 6, f"eva{width_px:.0f}", words, body)


def _draw_cell(x_px: float, y_px: float, cell_px: float, percent: float, shown: str) -> list[str]:
    shade = sum(percent >= least for least in SHADES_PERCENT) - 1
    ground = svg.PLATE if shade < 0 else f'class="bar" fill="{svg.RAMP[shade]}"'
    kind = "soft" if shade < 0 else "onlight" if shade < 2 else "light"
    return [
        svg.rect(x_px, y_px, cell_px, 22, ground),
        svg.rect(x_px, y_px, cell_px, 22, f'{svg.EDGE} stroke-width="0.4"'),
        svg.text(x_px + cell_px / 2, y_px + 15, shown, kind, "middle"),
    ]
