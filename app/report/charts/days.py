"""Rows of days, or of people, with a bar for each main figure, all of a column to one scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.report.charts import svg
from app.report.charts.svg import NARROW

_ROW_PX = 24.0
_GAP_PX = 10.0
_MOST_OVER = 1.3
"""Of the largest value: where a column ends; a range that goes on is cut without an end mark."""
Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class FigureRow:
    """A day, or a mean of days.

    Attributes
    ----------
    label
        Which.
    values, told
        Each figure and how it is written; None where it is not known.
    ranges
        Its range, drawn as a line over the bar; empty where none is.
    is_mean
        Set in bold.
    is_left_out
        Does not count: an empty bar.
    """

    label: str
    values: tuple[float | None, ...]
    told: tuple[str, ...]
    ranges: tuple[Span | None, ...] = ()
    is_mean: bool = False
    is_left_out: bool = False


def draw_rows(
    rows: Sequence[FigureRow], columns: Sequence[str], words: tuple[str, str], width_px: float
) -> str:
    """Draw the rows below their heads; each column has its own scale."""
    is_narrow = width_px <= NARROW  # there a label stands above its bars
    left, above = (0.0, 15.0) if is_narrow else (150.0, 0.0)
    room = (width_px - left) / len(columns)
    ends = [_find_end(rows, column) for column in range(len(columns))]
    body, lines = [], [svg.break_lines(name, room - _GAP_PX) for name in columns]
    for column, parts in enumerate(lines):
        for line, part in enumerate(parts):
            body.append(svg.text(left + column * room, 12 + 15 * line, part))
    top = 15.0 * max(map(len, lines)) + 8
    for row in rows:
        label = svg.shorten(row.label, (width_px if is_narrow else left) - 6)
        body.append(svg.text(0, top + 11, label, "strong" if row.is_mean else "ink"))
        top += above
        for column, end in enumerate(ends):
            body += _draw_cell(row, column, (left + column * room, top, room - _GAP_PX), end)
        top += _ROW_PX
    return svg.picture(width_px, top + 4, f"rows{width_px:.0f}", words, body)


def _find_end(rows: Sequence[FigureRow], column: int) -> float:
    largest = max((row.values[column] or 0.0 for row in rows), default=0.0)
    ends = (span[1] for row in rows if row.ranges and (span := row.ranges[column]))
    return max(largest, min(max(ends, default=0.0), _MOST_OVER * largest), 1e-9)


def _draw_cell(row: FigureRow, column: int, place: tuple[float, float, float], end: float) -> list[str]:
    x, top, room = place
    value = row.values[column]
    body = [svg.text(x, top + 11, row.told[column], "strong" if row.is_mean else "ink")]
    if value is None:
        return body
    frame = f'class="edge" fill="none" stroke="{svg.SOFT}" stroke-width="0.7"'
    kind = frame if row.is_left_out else f'class="band" fill="{svg.RAMP[1]}"'
    body.append(svg.rect(x, top + 14.5, max(room * value / end, 0.6), 5, kind))
    span = row.ranges[column] if row.ranges else None
    if span:
        low, high = (x + room * min(at / end, 1.0) for at in span)
        stroke = f'class="accent-line" stroke="{svg.ORANGE}" stroke-width="1.6"'
        body.append(svg.line(low, top + 17, high, top + 17, stroke))
        shown = [at for at, value in zip((low, high), span, strict=True) if value <= end]
        body += [svg.line(at, top + 14, at, top + 20, stroke) for at in shown]
    return body
