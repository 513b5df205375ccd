"""The drawings of a comparison: Bland and Altman's plot, both angles over time, the error over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.report.agreement.study_tables import find_paper_row
from app.report.charts import svg
from app.report.charts.svg import NARROW, WIDE
from app.report.model import Chart, Table
from app.report.words.numbers import format_angle
from app.report.words.subject import clean_text
from app.report.words.wording import Language, Words, fill, find_device_name, load_wording

if TYPE_CHECKING:
    from fusion.agreement import AgreementCell, AgreementEntry


# The figure of a study: each person's error in each task, their mean, and the paper's.


ROW = 19
TOP = 26
STEPS_DEG = (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0)


@dataclass(frozen=True, slots=True)
class _Rows:
    """What is drawn: the cells of one device, and each task's errors, one for each person."""

    device: str
    cells: Sequence[AgreementCell]
    errors_deg: dict[str, list[float]]


def draw_study(
    entries: Sequence[AgreementEntry],
    cells: Sequence[AgreementCell],
    device: str,
    words: Words,
    language: Language,
) -> Chart:
    """Draw a row for each task of a device: a ring for each person, a bar at their mean, the paper's mark."""
    entry = words["study_figure"]
    shown = [cell for cell in cells if cell.device == device]
    name = find_device_name(load_wording(language), device)
    title = fill(entry["title"], {"device": name})
    labels = (title, fill(entry["alternative"], {"device": name}))
    errors_deg = {
        cell.task: [e.agreement.rmse_deg for e in entries if (e.task, e.device) == (cell.task, device)]
        for cell in shown
    }
    rows = _Rows(device, shown, errors_deg)
    drawn = {width: _draw(rows, width, labels, entry, language) for width in (WIDE, NARROW)}
    table = tuple((clean_text(cell.task), *_format_row(cell, language)) for cell in shown)
    return Chart(*labels, drawn[WIDE], drawn[NARROW], Table(title, tuple(entry["columns"]), table))


def _format_row(cell: AgreementCell, language: Language) -> tuple[str, str]:
    paper = find_paper_row(cell)
    return (
        format_angle(cell.rmse_deg.mean, language, 2),
        format_angle(paper["rmse_deg"] if paper else None, language, 2),
    )


def _draw(rows: _Rows, width_px: float, labels: tuple[str, str], entry: Words, language: Language) -> str:
    left = 190.0 if width_px > NARROW else 110.0
    papers = [paper["rmse_deg"] or 0.0 for cell in rows.cells if (paper := find_paper_row(cell))]
    most = max([*papers, *(value for values in rows.errors_deg.values() for value in values), 0.5])
    step = next((step for step in STEPS_DEG if most / step <= 6), STEPS_DEG[-1])
    scale = (width_px - left - 14) / (most * 1.03)
    bottom = TOP + ROW * len(rows.cells)
    body = _draw_axis(left, bottom, scale, (step, most), language)
    for at, cell in enumerate(rows.cells):
        y = TOP + ROW * (at + 0.5)
        body.append(svg.text(0, y + 4, svg.shorten(clean_text(cell.task), left - 8), "ink"))
        body += _draw_row(cell, rows.errors_deg[cell.task], (left, y, scale))
    body += _draw_legend(min(left, 60.0), bottom + 36, entry)
    return svg.picture(width_px, bottom + 44, f"st-{rows.device}-{width_px:.0f}", labels, body)


def _draw_axis(
    left_px: float, bottom_px: float, px_per_deg: float, span: tuple[float, float], language: Language
) -> list[str]:
    step, most = span
    dash = f'class="rule" stroke="{svg.SOFT}" stroke-width="0.6" stroke-dasharray="2 3"'
    body = []
    for k in range(int(most / step) + 1):
        x, label = left_px + k * step * px_per_deg, format_angle(k * step, language, 0 if step >= 1 else 2)
        body.append(svg.line(x, TOP - 4, x, bottom_px, dash))
        body.append(svg.text(x, bottom_px + 15, label, "soft", "middle"))
    return body


def _draw_row(cell: AgreementCell, values: Sequence[float], place: tuple[float, float, float]) -> list[str]:
    left, y, scale = place
    body = [_draw_ring(left + value * scale, y) for value in values]
    body.append(_draw_bar(left + cell.rmse_deg.mean * scale, y))
    paper = find_paper_row(cell)
    return [*body, _draw_diamond(left + (paper["rmse_deg"] or 0.0) * scale, y)] if paper else body


def _draw_ring(x_px: float, y_px: float) -> str:
    arcs = "a3.2 3.2 0 1 0 6.4 0a3.2 3.2 0 1 0 -6.4 0"
    stroke = f'class="median" fill="none" stroke="{svg.RAMP[3]}" stroke-width="1.2"'
    return svg.path(f"M{svg.number(x_px - 3.2)} {svg.number(y_px)}{arcs}", stroke)


def _draw_bar(x_px: float, y_px: float) -> str:
    return svg.line(
        x_px, y_px - 7, x_px, y_px + 7, f'class="median" stroke="{svg.RAMP[3]}" stroke-width="2.4"'
    )


def _draw_diamond(x_px: float, y_px: float) -> str:
    colour = f'class="accent-line" fill="{svg.ORANGE}" stroke="{svg.ORANGE}"'
    return svg.path(f"M{svg.number(x_px - 4.5)} {svg.number(y_px)}l4.5 -4.5l4.5 4.5l-4.5 4.5Z", colour)


def _draw_legend(left_px: float, y_px: float, entry: Words) -> list[str]:
    body = []
    signs = ((entry["person"], _draw_ring), (entry["mean"], _draw_bar), (entry["paper"], _draw_diamond))
    for label, draw in signs:
        body += [draw(left_px, y_px - 4), svg.text(left_px + 9, y_px, label)]
        left_px += 26 + svg.estimate_width(label)
    return body


AxisTitles = tuple[str, str]
COLUMNS, ROWS = 60, 40


@dataclass(frozen=True, slots=True)
class Frame:
    """Where values fall on the sheet: ``across`` and ``upwards`` are (low, high)."""

    left_px: float
    right_px: float
    top_px: float
    bottom_px: float
    across: tuple[float, float]
    upwards: tuple[float, float]

    def x(self, value: float) -> float:
        """Give the place of a value, kept inside."""
        low, high = self.across
        return self.left_px + (self.right_px - self.left_px) * min(
            max((value - low) / (high - low), 0.0), 1.0
        )

    def y(self, value: float) -> float:
        """Give the place of a value, kept inside."""
        low, high = self.upwards
        return self.bottom_px - (self.bottom_px - self.top_px) * min(
            max((value - low) / (high - low), 0.0), 1.0
        )


@dataclass(frozen=True, slots=True)
class Axes:
    """Names of the axes, and the values at which they are marked."""

    across: str
    upwards: str
    across_ticks: Sequence[tuple[float, str]]
    upwards_ticks: Sequence[tuple[float, str]]


@dataclass(frozen=True, slots=True)
class Line:
    """One or more unbroken runs of points (x, y), in one stroke."""

    label: str
    runs: Sequence[Sequence[tuple[float, float]]]
    is_reference: bool


@dataclass(frozen=True, slots=True)
class Density:
    """How many rows fall into each cell (column, row), of ``COLUMNS`` by ``ROWS``; and the marked lines."""

    cells: Sequence[tuple[int, int, int]]
    marks: Sequence[tuple[float, str]]


def frame_plot(
    width_px: float, height_px: float, across: tuple[float, float], upwards: tuple[float, float]
) -> Frame:
    """Lay the frame of a drawing of this width."""
    return Frame(38, width_px - 8, 24, 24 + height_px, across, upwards)


def draw_density(key: str, density: Density, frame: Frame, axes: Axes, words: AxisTitles) -> str:
    """Draw shaded cells, the darker the more rows, under lines at the bias and the limits."""
    most = max((count for _, _, count in density.cells), default=1)
    wide, high = (frame.right_px - frame.left_px) / COLUMNS, (frame.bottom_px - frame.top_px) / ROWS
    cells = [
        svg.rect(
            frame.left_px + column * wide,
            frame.bottom_px - (row + 1) * high,
            wide + 0.1,
            high + 0.1,
            f'fill="{svg.RAMP[_shade(count, most)]}"',
        )
        for column, row, count in density.cells
    ]
    body = [
        *cells,
        *_draw_axes(frame, axes),
        *(part for mark in density.marks for part in _draw_mark(frame, mark)),
    ]
    return svg.picture(frame.right_px + 8, frame.bottom_px + 34, key, words, body)


def _shade(count: int, most: int) -> int:
    """Five shades, each for a share of the fullest cell five times that of the one before."""
    share = count / most
    return sum(share >= limit for limit in (1 / 625, 1 / 125, 1 / 25, 1 / 5))


def _draw_mark(frame: Frame, mark: tuple[float, str]) -> list[str]:
    value, label = mark
    y = frame.y(value)
    stroke = f'class="accent-line" stroke="{svg.ORANGE}" stroke-width="1.2" stroke-dasharray="5 3"'
    length = svg.estimate_width(label)
    plate = svg.rect(frame.right_px - length - 4, y - 12, length + 4, 11, f'class="paper" fill="{svg.PAPER}"')
    words = svg.text(frame.right_px - 2, y - 3, label, "strong", "end")
    return [svg.line(frame.left_px, y, frame.right_px, y, stroke), plate, words]


def draw_lines(key: str, lines: Sequence[Line], frame: Frame, axes: Axes, words: AxisTitles) -> str:
    """Draw curves: the reference wide and light, ours thin and dark upon it."""
    body = _draw_axes(frame, axes)
    at = frame.left_px
    for line in lines:
        stroke = _choose_stroke(is_reference=line.is_reference)
        body += [_draw_run(run, frame, stroke) for run in line.runs if len(run) > 1]
        body.append(svg.path(f"M{svg.number(at)} {svg.number(frame.bottom_px + 29)}l18 0", stroke))
        body.append(svg.text(at + 23, frame.bottom_px + 33, line.label))
        at += 40 + svg.estimate_width(line.label)
    return svg.picture(frame.right_px + 8, frame.bottom_px + 40, key, words, body)


def _choose_stroke(*, is_reference: bool) -> str:
    if is_reference:
        return f'class="accent-line" fill="none" stroke="{svg.ORANGE}" stroke-width="3" stroke-opacity="0.55"'
    return f'class="median" fill="none" stroke="{svg.RAMP[3]}" stroke-width="1.3"'


def _draw_run(run: Sequence[tuple[float, float]], frame: Frame, stroke: str) -> str:
    points = (f"{svg.number(frame.x(x))} {svg.number(frame.y(y))}" for x, y in run)
    return svg.path("M" + "L".join(points), f'{stroke} stroke-linejoin="round"')


def _draw_axes(frame: Frame, axes: Axes) -> list[str]:
    rule = f'class="rule" stroke="{svg.SOFT}"'
    dash = f'{rule} stroke-width="0.6" stroke-dasharray="2 3"'
    body = [
        svg.text(0, 11, axes.upwards),
        svg.text(frame.right_px, frame.bottom_px + 31, axes.across, "soft", "end"),
    ]
    for value, label in axes.upwards_ticks:
        y = frame.y(value)
        body += [
            svg.line(frame.left_px, y, frame.right_px, y, dash),
            svg.text(frame.left_px - 5, y + 3.8, label, "soft", "end"),
        ]
    for value, label in axes.across_ticks:
        x = frame.x(value)
        anchor = "end" if x > frame.right_px - 1 else "middle"
        body.append(svg.line(x, frame.bottom_px, x, frame.bottom_px + 4, rule))
        body.append(svg.text(x, frame.bottom_px + 16, label, "soft", anchor))
    return [*body, svg.line(frame.left_px, frame.bottom_px, frame.right_px, frame.bottom_px, rule)]
