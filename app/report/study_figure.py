"""The figure of a study: each person's error in each task, their mean, and the paper's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.report import svg
from app.report.numbers import format_angle
from app.report.parts import Figure, Table
from app.report.study_tables import find_paper_row
from app.report.subject import clean_text
from app.report.svg import NARROW, WIDE
from app.report.wording import Language, Words, fill, load_wording

if TYPE_CHECKING:
    from fusion.agreement import StudyCell, StudyEntry

ROW = 19
TOP = 26
STEPS_DEG = (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0)


@dataclass(frozen=True, slots=True)
class _Rows:
    """What is drawn: the cells of one device, and each task's errors, one for each person."""

    device: str
    cells: Sequence[StudyCell]
    errors_deg: dict[str, list[float]]


def draw_study(
    entries: Sequence[StudyEntry], cells: Sequence[StudyCell], device: str, words: Words, language: Language
) -> Figure:
    """Draw a row for each task of a device: a ring for each person, a bar at their mean, the paper's mark."""
    entry = words["study_figure"]
    shown = [cell for cell in cells if cell.device == device]
    name = load_wording(language)["device"].get(device, device)
    title = fill(entry["title"], {"device": name})
    told = (title, fill(entry["alternative"], {"device": name}))
    errors_deg = {
        cell.task: [e.agreement.rmse_deg for e in entries if (e.task, e.device) == (cell.task, device)]
        for cell in shown
    }
    rows = _Rows(device, shown, errors_deg)
    drawn = {width: _draw(rows, width, told, entry, language) for width in (WIDE, NARROW)}
    table = tuple((clean_text(cell.task), *_tell_row(cell, language)) for cell in shown)
    return Figure(*told, drawn[WIDE], drawn[NARROW], Table(title, tuple(entry["columns"]), table))


def _tell_row(cell: StudyCell, language: Language) -> tuple[str, str]:
    paper = find_paper_row(cell)
    return (
        format_angle(cell.rmse_deg.mean, language, 2),
        format_angle(paper["rmse_deg"] if paper else None, language, 2),
    )


def _draw(rows: _Rows, width: float, told: tuple[str, str], entry: Words, language: Language) -> str:
    left = 190.0 if width > NARROW else 110.0
    papers = [paper["rmse_deg"] or 0.0 for cell in rows.cells if (paper := find_paper_row(cell))]
    most = max([*papers, *(value for values in rows.errors_deg.values() for value in values), 0.5])
    step = next((step for step in STEPS_DEG if most / step <= 6), STEPS_DEG[-1])
    scale = (width - left - 14) / (most * 1.03)
    bottom = TOP + ROW * len(rows.cells)
    body = _draw_axis(left, bottom, scale, (step, most), language)
    for at, cell in enumerate(rows.cells):
        y = TOP + ROW * (at + 0.5)
        body.append(svg.text(0, y + 4, svg.shorten(clean_text(cell.task), left - 8), "ink"))
        body += _draw_row(cell, rows.errors_deg[cell.task], (left, y, scale))
    body += _draw_legend(min(left, 60.0), bottom + 36, entry)
    return svg.picture(width, bottom + 44, f"st-{rows.device}-{width:.0f}", told, body)


def _draw_axis(
    left: float, bottom: float, scale: float, span: tuple[float, float], language: Language
) -> list[str]:
    step, most = span
    dash = f'class="rule" stroke="{svg.SOFT}" stroke-width="0.6" stroke-dasharray="2 3"'
    body = []
    for k in range(int(most / step) + 1):
        x, label = left + k * step * scale, format_angle(k * step, language, 0 if step >= 1 else 2)
        body.append(svg.line(x, TOP - 4, x, bottom, dash))
        body.append(svg.text(x, bottom + 15, label, "soft", "middle"))
    return body


def _draw_row(cell: StudyCell, values: Sequence[float], place: tuple[float, float, float]) -> list[str]:
    left, y, scale = place
    body = [_draw_ring(left + value * scale, y) for value in values]
    body.append(_draw_bar(left + cell.rmse_deg.mean * scale, y))
    paper = find_paper_row(cell)
    return [*body, _draw_diamond(left + (paper["rmse_deg"] or 0.0) * scale, y)] if paper else body


def _draw_ring(x: float, y: float) -> str:
    arcs = "a3.2 3.2 0 1 0 6.4 0a3.2 3.2 0 1 0 -6.4 0"
    stroke = f'class="median" fill="none" stroke="{svg.RAMP[3]}" stroke-width="1.2"'
    return svg.path(f"M{svg.number(x - 3.2)} {svg.number(y)}{arcs}", stroke)


def _draw_bar(x: float, y: float) -> str:
    return svg.line(x, y - 7, x, y + 7, f'class="median" stroke="{svg.RAMP[3]}" stroke-width="2.4"')


def _draw_diamond(x: float, y: float) -> str:
    colour = f'class="accent-line" fill="{svg.ORANGE}" stroke="{svg.ORANGE}"'
    return svg.path(f"M{svg.number(x - 4.5)} {svg.number(y)}l4.5 -4.5l4.5 4.5l-4.5 4.5Z", colour)


def _draw_legend(at: float, y: float, entry: Words) -> list[str]:
    body = []
    signs = ((entry["person"], _draw_ring), (entry["mean"], _draw_bar), (entry["paper"], _draw_diamond))
    for label, draw in signs:
        body += [draw(at, y - 4), svg.text(at + 9, y, label)]
        at += 26 + svg.estimate_width(label)
    return body
