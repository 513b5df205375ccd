"""One stacked bar for each part of the day, as SVG: the clock hours, the periods of the diary.

Elevation is the same ramp as everywhere; a part that was left out is hatched and says so, so that it is never
taken for a part without load.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from app.report import svg
from app.report.svg import NARROW

SHARES = 4
_LONGEST_SHARE = 0.42
"""Names that would take more of the width than this stand above their bars."""


@dataclass(frozen=True, slots=True)
class PartRow:
    """A part of the day: name, shares from low to high elevation (empty: left out), label at its end."""

    name: str
    percent: tuple[float, ...]
    label: str
    left_out: str = ""


@dataclass(frozen=True, slots=True)
class _Sheet:
    left: float
    right: float
    width: float
    row_height: float
    bar_top: float


def draw_parts(
    key: str, rows: Sequence[PartRow], classes: Sequence[str], words: tuple[str, str], width: float
) -> str:
    """Draw a stacked bar for each part, all to one scale; at its end the share at or above 60 deg."""
    sheet = _lay_out(rows, width)
    own_key = f"{key}{width:.0f}"
    body = [svg.define_hatch(own_key), svg.text(width, 10, "≥ 60°", "soft", "end")]
    for rank, row in enumerate(rows):
        body += _draw_row(row, 14 + rank * sheet.row_height, sheet, own_key)
    bottom = len(rows) * sheet.row_height + 30
    keys, height = _list_keys(classes, sheet.left, bottom, width)
    return svg.picture(width, height, own_key, words, [*body, *keys])


def _lay_out(rows: Sequence[PartRow], width: float) -> _Sheet:
    longest = max(svg.estimate_width(row.name) for row in rows)
    right = width - max(svg.estimate_width(row.label) for row in rows) - 8
    if longest > width * _LONGEST_SHARE:
        return _Sheet(0.5, right, width, 36.0, 17.0)
    return _Sheet(longest + 8, right, width, 18.0, 2.0)


def _draw_row(row: PartRow, y: float, sheet: _Sheet, key: str) -> list[str]:
    is_above = sheet.left < 1
    room = sheet.width if is_above else sheet.left
    top = y + sheet.bar_top
    body = [svg.text(0, y + 12, svg.shorten(row.name, room))]
    body += _hatch(row, top, sheet, key) if row.left_out else _stack(row, top, sheet)
    return [*body, svg.text(sheet.width, top + 10, row.label, "ink", "end")]


def _stack(row: PartRow, y: float, sheet: _Sheet) -> list[str]:
    body, x = [], sheet.left
    for rank, percent in enumerate(row.percent):
        length = (sheet.right - sheet.left) * max(percent, 0.0) / 100
        if length > 0:
            body.append(svg.rect(x, y, length, 13, f'class="bar" fill="{svg.RAMP[rank]}"'))
        x += length
    return [*body, _frame(y, sheet)]


def _hatch(row: PartRow, y: float, sheet: _Sheet, key: str) -> list[str]:
    middle, length = (sheet.left + sheet.right) / 2, svg.estimate_width(row.left_out) + 8
    hatch = svg.rect(sheet.left, y, sheet.right - sheet.left, 13, f'fill="url(#{key}-h)" fill-opacity="0.55"')
    plate = svg.rect(middle - length / 2, y, length, 13, f'class="paper" fill="{svg.PAPER}"')
    return [hatch, plate, svg.text(middle, y + 10, row.left_out, "ink", "middle"), _frame(y, sheet)]


def _frame(y: float, sheet: _Sheet) -> str:
    edge = f'class="edge" fill="none" stroke="{svg.SOFT}" stroke-width="0.7"'
    return svg.rect(sheet.left, y, sheet.right - sheet.left, 13, edge)


def _list_keys(classes: Sequence[str], left: float, y: float, width: float) -> tuple[list[str], float]:
    """Explain the colours under the bars; give the strokes and the height of the whole drawing."""
    body, x = [], left
    start = 0.5 if width <= NARROW else left
    x = start
    for rank, name in enumerate(classes):
        length = 14 + svg.estimate_width(name) + 10
        if x > start and x + length > width:
            x, y = start, y + 16
        swatch = f'class="edge" fill="{svg.RAMP[rank]}" stroke="{svg.SOFT}" stroke-width="0.8"'
        body += [svg.rect(x, y - 9, 10, 10, swatch), svg.text(x + 14, y, name)]
        x += length
    return body, y + 8
