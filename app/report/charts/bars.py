"""Static charts as SVG: the stacked bar, and one bar for each part of the day.

The same strings stand in the HTML and in the PDF. Elevation is a single-hue ramp from light to dark; what
is pointed at is vermillion and always doubled by a shape or a word, so that grey paper loses nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from app.report.charts import svg
from app.report.charts.svg import NARROW

# ------------------------------------------------------------------ one bar for each part of the day
#
# The parts are clock hours or periods of the diary. A part that was left out is hatched and labelled, so
# that nobody takes it for a part without load.


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
class PartWords:
    """Title and description, names of the classes, and the scale's numbers: none, half and all."""

    title: tuple[str, str]
    classes: tuple[str, ...]
    percents: tuple[str, str, str]


@dataclass(frozen=True, slots=True)
class _Sheet:
    left_px: float
    right_px: float
    width_px: float
    row_height_px: float
    bar_top_px: float


def draw_parts(key: str, rows: Sequence[PartRow], words: PartWords, width_px: float) -> str:
    """Draw a stacked bar for each part, all to one scale; at its end the share at or above 60 deg."""
    sheet = _lay_out(rows, width_px)
    own_key = f"{key}{width_px:.0f}"
    body = [svg.define_hatch(own_key), svg.text(width_px, 10, "≥ 60°", "soft", "end")]
    for rank, row in enumerate(rows):
        body += _draw_row(row, 14 + rank * sheet.row_height_px, sheet, own_key)
    bottom = len(rows) * sheet.row_height_px + 28
    keys, height = _draw_keys(words.classes, sheet.left_px, bottom + 18, width_px)
    scale = _number_scale(sheet, bottom, words.percents)
    return svg.picture(width_px, height, own_key, words.title, [*body, *scale, *keys])


def _number_scale(sheet: _Sheet, y_px: float, percents: tuple[str, str, str]) -> list[str]:
    """Write 0, 50 and 100 % of a part's time under the bars."""
    middle = (sheet.left_px + sheet.right_px) / 2
    places = ((sheet.left_px, "start"), (middle, "middle"), (sheet.right_px, "end"))
    return [
        svg.text(x, y_px, told, "soft", anchor) for (x, anchor), told in zip(places, percents, strict=True)
    ]


def _lay_out(rows: Sequence[PartRow], width_px: float) -> _Sheet:
    longest = max(svg.estimate_width(row.name) for row in rows)
    right = width_px - max(svg.estimate_width(row.label) for row in rows) - 8
    if longest > width_px * _LONGEST_SHARE:
        return _Sheet(0.5, right, width_px, 36.0, 17.0)
    return _Sheet(longest + 8, right, width_px, 18.0, 2.0)


def _draw_row(row: PartRow, y_px: float, sheet: _Sheet, key: str) -> list[str]:
    is_above = sheet.left_px < 1
    room = sheet.width_px if is_above else sheet.left_px
    top = y_px + sheet.bar_top_px
    body = [svg.text(0, y_px + 12, svg.shorten(row.name, room))]
    body += _hatch(row, top, sheet, key) if row.left_out else _stack_part(row, top, sheet)
    return [*body, svg.text(sheet.width_px, top + 10, row.label, "ink", "end")]


def _stack_part(row: PartRow, y_px: float, sheet: _Sheet) -> list[str]:
    body, x = [], sheet.left_px
    for rank, percent in enumerate(row.percent):
        length = (sheet.right_px - sheet.left_px) * max(percent, 0.0) / 100
        if length > 0:
            body.append(svg.rect(x, y_px, length, 13, f'class="bar" fill="{svg.RAMP[rank]}"'))
        x += length
    return [*body, _frame(y_px, sheet)]


def _hatch(row: PartRow, y_px: float, sheet: _Sheet, key: str) -> list[str]:
    middle, length = (sheet.left_px + sheet.right_px) / 2, svg.estimate_width(row.left_out) + 8
    hatch = svg.rect(
        sheet.left_px, y_px, sheet.right_px - sheet.left_px, 13, f'fill="url(#{key}-h)" fill-opacity="0.55"'
    )
    plate = svg.rect(middle - length / 2, y_px, length, 13, f'class="paper" fill="{svg.PAPER}"')
    return [hatch, plate, svg.text(middle, y_px + 10, row.left_out, "ink", "middle"), _frame(y_px, sheet)]


def _frame(y_px: float, sheet: _Sheet) -> str:
    edge = f'class="edge" fill="none" stroke="{svg.SOFT}" stroke-width="0.7"'
    return svg.rect(sheet.left_px, y_px, sheet.right_px - sheet.left_px, 13, edge)


def _draw_keys(
    classes: Sequence[str], left_px: float, y_px: float, width_px: float
) -> tuple[list[str], float]:
    """Explain the colours under the bars; give the strokes and the height of the whole drawing."""
    body, x = [], left_px
    start = 0.5 if width_px <= NARROW else left_px
    x = start
    for rank, name in enumerate(classes):
        length = 14 + svg.estimate_width(name) + 10
        if x > start and x + length > width_px:
            x, y_px = start, y_px + 16
        swatch = f'class="edge" fill="{svg.RAMP[rank]}" stroke="{svg.SOFT}" stroke-width="0.8"'
        body += [svg.rect(x, y_px - 9, 10, 10, swatch), svg.text(x + 14, y_px, name)]
        x += length
    return body, y_px + 8


@dataclass(frozen=True, slots=True)
class Slice:
    """One class of the stacked bar with its labels."""

    percent: float
    range_label: str
    duration_label: str
    percent_label: str


# ------------------------------------------------------------------ the stacked bar


def draw_bar(slices: Sequence[Slice], words: tuple[str, str], width_px: float) -> str:
    """Draw time in elevation classes: one bar, and under it what each class is."""
    columns = len(slices) if width_px > NARROW else 1
    rows = -(-len(slices) // columns)
    key = f"bar{width_px:.0f}"
    height = 34 + (48 if columns > 1 else rows * 20 + 8)
    body = [*_stack(slices, width_px), *_bar_legend(slices, width_px, columns)]
    return svg.picture(width_px, height, key, words, body)


def _stack(slices: Sequence[Slice], width_px: float) -> list[str]:
    body, x = [], 0.5
    for rank, item in enumerate(slices):
        length = (width_px - 1) * item.percent / 100
        colour = svg.RAMP[rank]
        if length > 0:
            body.append(svg.rect(x, 0.5, length, 30, f'class="bar" fill="{colour}"'))
        if length > svg.estimate_width(item.percent_label) + 8:
            kind = "light" if rank >= 2 else "onlight"
            body.append(svg.text(x + length / 2, 19.5, item.percent_label, kind, "middle"))
        x += length
    outline = f'class="edge" fill="none" stroke="{svg.SOFT}"'
    return [*body, svg.rect(0.5, 0.5, width_px - 1, 30, outline)]


def _bar_legend(slices: Sequence[Slice], width_px: float, columns: int) -> list[str]:
    body = []
    step = width_px / columns
    for rank, item in enumerate(slices):
        x, y = (rank * step, 48.0) if columns > 1 else (0.0, 48.0 + rank * 20)
        swatch = f'class="edge" fill="{svg.RAMP[rank]}" stroke="{svg.SOFT}" stroke-width="0.8"'
        body.append(svg.rect(x + 0.5, y - 9, 10, 10, swatch))
        body.append(svg.text(x + 16, y, item.range_label, "strong"))
        if columns > 1:
            body.append(svg.text(x + 16, y + 15, item.percent_label, "ink"))
            body.append(svg.text(x + 16, y + 29, item.duration_label))
        else:
            body.append(svg.text(width_px - 100, y, item.percent_label, "ink", "end"))
            body.append(svg.text(width_px, y, item.duration_label, "soft", "end"))
    return body
