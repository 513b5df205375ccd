"""The distribution of elevation as SVG: how much of the time the arm stayed below each angle (APDF).

Amplitude probability distribution function (Jonsson 1982): the curve rises from 0 % at 0 deg to 100 % at
180 deg; four percentiles are marked, each with the range allowing for measurement error where one is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from app.report import svg
from app.report.svg import NARROW

TOP_DEG = 180
GUIDES_DEG = (30, 60, 90)


@dataclass(frozen=True, slots=True)
class MarkedPercentile:
    """A percentile on the curve; ``interval`` in degrees."""

    percent: int
    angle_deg: float
    interval: tuple[float, float] | None
    label: str


@dataclass(frozen=True, slots=True)
class Distribution:
    """``below_percent[d]``: share of the time below d degrees, d from 0 to 180."""

    below_percent: Sequence[float]
    marks: tuple[MarkedPercentile, ...]
    axes: tuple[str, str]
    """Names of the axes: across, and up."""


@dataclass(frozen=True, slots=True)
class _Plot:
    left: float
    right: float
    top: float
    bottom: float

    def x(self, degrees: float) -> float:
        return self.left + (self.right - self.left) * degrees / TOP_DEG

    def y(self, percent: float) -> float:
        return self.bottom - (self.bottom - self.top) * percent / 100


def draw_apdf(shown: Distribution, words: tuple[str, str], width: float) -> str:
    """Draw the curve with its percentiles; guide lines at 30, 60 and 90 deg."""
    plot = _Plot(40, width - 8, 22, 200 if width > NARROW else 230)
    body = [
        *_draw_frame(plot, shown.axes),
        _draw_curve(shown.below_percent, plot),
        *(stroke for mark in shown.marks for stroke in _draw_mark(mark, plot)),
    ]
    return svg.picture(width, plot.bottom + 34, f"apdf{width:.0f}", words, body)


def _draw_frame(plot: _Plot, axes: tuple[str, str]) -> list[str]:
    rule = f'class="rule" stroke="{svg.SOFT}"'
    dash = f'{rule} stroke-width="0.7" stroke-dasharray="3 3"'
    body = [svg.line(plot.x(angle), plot.top, plot.x(angle), plot.bottom, dash) for angle in GUIDES_DEG]
    for percent in (0, 25, 50, 75, 100):
        y = plot.y(percent)
        body.append(svg.line(plot.left - 4, y, plot.left, y, rule))
        body.append(svg.text(plot.left - 7, y + 3.8, f"{percent}", "soft", "end"))
    for angle in range(0, TOP_DEG + 1, 30):
        kind = "strong" if angle == 60 else "soft"
        anchor = "end" if angle == TOP_DEG else "middle"
        x = min(plot.x(angle), plot.right + 6) if angle == TOP_DEG else plot.x(angle)
        body.append(svg.text(x, plot.bottom + 15, f"{angle}°", kind, anchor))
    across, upwards = axes
    body.append(svg.text(plot.right, plot.bottom + 30, across, "soft", "end"))
    body.append(svg.text(0, 10, upwards))
    body.append(svg.line(plot.left, plot.top, plot.left, plot.bottom, rule))
    return [*body, svg.line(plot.left, plot.bottom, plot.right, plot.bottom, rule)]


def _draw_curve(below_percent: Sequence[float], plot: _Plot) -> str:
    points = (
        f"{svg.number(plot.x(degrees))} {svg.number(plot.y(percent))}"
        for degrees, percent in enumerate(below_percent)
    )
    stroke = f'class="median" fill="none" stroke="{svg.RAMP[3]}" stroke-width="1.8"'
    return svg.path("M" + "L".join(points), f'{stroke} stroke-linejoin="round"')


def _draw_mark(mark: MarkedPercentile, plot: _Plot) -> list[str]:
    """Mark the point; its label stands to the right, where the curve has already risen above it."""
    x, y = plot.x(mark.angle_deg), plot.y(mark.percent)
    body, end = [], x
    if mark.interval is not None:
        low, end = (plot.x(value) for value in mark.interval)
        bar = f'class="accent-line" stroke="{svg.ORANGE}" stroke-width="1.6"'
        body = [
            svg.line(low, y, end, y, bar),
            *(svg.line(at, y - 3, at, y + 3, bar) for at in (low, end)),
        ]
    dot = f"M{svg.number(x - 4)} {svg.number(y)}l4 -4l4 4l-4 4Z"
    body.append(svg.path(dot, f'class="mark" fill="{svg.RAMP[3]}" stroke="{svg.PAPER}"'))
    return [*body, *_label(mark, x if mark.percent > 50 else max(x, end), y, plot)]


def _label(mark: MarkedPercentile, x: float, y: float, plot: _Plot) -> list[str]:
    """Write beside a low percentile, below a high one, where the curve is flat; a plate hides the guides."""
    length = svg.estimate_width(mark.label)
    place = min(x + 8, plot.right - length)
    baseline = y + (15 if mark.percent > 50 else 3.8)
    plate = svg.rect(place - 2, baseline - 9, length, 11, f'class="paper" fill="{svg.PAPER}"')
    return [plate, svg.text(place, baseline, mark.label, "strong")]
