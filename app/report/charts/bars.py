"""Static charts as SVG: the stacked bar and the reference scales.

The same strings stand in the HTML and in the PDF. Elevation is a single-hue ramp from light to dark; what
is pointed at is vermillion and always doubled by a shape or a word, so that grey paper loses nothing.
"""

from collections.abc import Callable, Sequence
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
    keys, height = _draw_keys(classes, sheet.left, bottom, width)
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
    body += _hatch(row, top, sheet, key) if row.left_out else _stack_part(row, top, sheet)
    return [*body, svg.text(sheet.width, top + 10, row.label, "ink", "end")]


def _stack_part(row: PartRow, y: float, sheet: _Sheet) -> list[str]:
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


def _draw_keys(classes: Sequence[str], left: float, y: float, width: float) -> tuple[list[str], float]:
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


@dataclass(frozen=True, slots=True)
class Slice:
    """One class of the stacked bar with its labels."""

    percent: float
    range_label: str
    duration_label: str
    percent_label: str


# ------------------------------------------------------------------ the stacked bar


def draw_bar(slices: Sequence[Slice], words: tuple[str, str], width: float) -> str:
    """Draw time in elevation classes: one bar, and under it what each class is."""
    columns = len(slices) if width > NARROW else 1
    rows = -(-len(slices) // columns)
    key = f"bar{width:.0f}"
    height = 34 + (48 if columns > 1 else rows * 20 + 8)
    body = [*_stack(slices, width), *_bar_legend(slices, width, columns)]
    return svg.picture(width, height, key, words, body)


def _stack(slices: Sequence[Slice], width: float) -> list[str]:
    body, x = [], 0.5
    for rank, item in enumerate(slices):
        length = (width - 1) * item.percent / 100
        colour = svg.RAMP[rank]
        if length > 0:
            body.append(svg.rect(x, 0.5, length, 30, f'class="bar" fill="{colour}"'))
        if length > svg.estimate_width(item.percent_label) + 8:
            kind = "light" if rank >= 2 else "onlight"
            body.append(svg.text(x + length / 2, 19.5, item.percent_label, kind, "middle"))
        x += length
    outline = f'class="edge" fill="none" stroke="{svg.SOFT}"'
    return [*body, svg.rect(0.5, 0.5, width - 1, 30, outline)]


def _bar_legend(slices: Sequence[Slice], width: float, columns: int) -> list[str]:
    body = []
    step = width / columns
    for rank, item in enumerate(slices):
        x, y = (rank * step, 48.0) if columns > 1 else (0.0, 48.0 + rank * 20)
        swatch = f'class="edge" fill="{svg.RAMP[rank]}" stroke="{svg.SOFT}" stroke-width="0.8"'
        body.append(svg.rect(x + 0.5, y - 9, 10, 10, swatch))
        body.append(svg.text(x + 16, y, item.range_label, "strong"))
        if columns > 1:
            body.append(svg.text(x + 16, y + 15, item.percent_label, "ink"))
            body.append(svg.text(x + 16, y + 29, item.duration_label))
        else:
            body.append(svg.text(width - 100, y, item.percent_label, "ink", "end"))
            body.append(svg.text(width, y, item.duration_label, "soft", "end"))
    return body


# ------------------------------------------------------------------ the reference scales


@dataclass(frozen=True, slots=True)
class Scale:
    """A reference beside a measured value. ``low`` is None for a single reference mark, else a range."""

    key: str
    words: tuple[str, str]
    end: float
    low: float | None
    high: float
    high_label: str
    measured: float
    measured_label: str
    interval: tuple[float, float] | None = None


def draw_scale(scale: Scale, width: float = 230.0) -> str:
    """Draw a horizontal scale: the reference as a tick (or a range), the measured value as a diamond.

    The interval of the measured value is a thick line under the diamond.
    """
    left, right, y = 2.0, width - 2.0, 20.0

    def x(value: float) -> float:
        return left + (right - left) * min(max(value / scale.end, 0.0), 1.0)

    rule = f'class="rule" stroke="{svg.SOFT}" stroke-width="1"'
    body = [svg.line(left, y, right, y, rule), *_draw_reference(scale, x(scale.high), y, x)]
    if scale.interval is not None:
        low, high = (x(value) for value in scale.interval)
        body.append(svg.line(low, y, high, y, f'class="median" stroke="{svg.RAMP[3]}" stroke-width="3.5"'))
    at = x(scale.measured)
    diamond = f"M{svg.number(at)} {svg.number(y - 5.5)}l5.5 5.5l-5.5 5.5l-5.5 -5.5Z"
    body.append(svg.path(diamond, f'class="mark" fill="{svg.RAMP[3]}" stroke="{svg.PAPER}"'))
    half = svg.estimate_width(scale.measured_label) / 2
    place = min(max(at, half), width - half)
    body.append(svg.text(place, y + 17, scale.measured_label, "strong", "middle"))
    return svg.picture(width, 40, scale.key, scale.words, body)


def _draw_reference(scale: Scale, x_high: float, y: float, place: Callable[[float], float]) -> list[str]:
    tick = f'class="accent-line" stroke="{svg.ORANGE}" stroke-width="2"'
    half = svg.estimate_width(scale.high_label) / 2
    body = [svg.line(x_high, y - 7, x_high, y + 7, tick)]
    centre = x_high
    if scale.low is not None:
        x_low = place(scale.low)
        body += [svg.line(x_low, y - 7, x_low, y + 7, tick), svg.line(x_low, y, x_high, y, tick)]
        centre = (x_low + x_high) / 2
    return [*body, svg.text(max(centre, half), y - 10, scale.high_label, "accent", "middle")]
