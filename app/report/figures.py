"""Static charts as SVG: the stacked bar and the reference scales.

The same strings stand in the HTML and in the PDF. Elevation is a single-hue ramp from light to dark; what
is pointed at is vermillion and always doubled by a shape or a word, so that grey paper loses nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from app.report import svg
from app.report.svg import NARROW


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
