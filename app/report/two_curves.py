"""Two distributions of elevation in one picture, as SVG: one day beside another, or one arm beside the other.

Blue is drawn through and vermillion dashed, so that grey paper loses nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from app.report import svg
from app.report.apdf import GUIDES_DEG, TOP_DEG
from app.report.svg import NARROW

_STYLES = (
    f'class="median" fill="none" stroke="{svg.RAMP[3]}" stroke-width="2"',
    f'class="accent-line" fill="none" stroke="{svg.ORANGE}" stroke-width="2" stroke-dasharray="6 3"',
)


@dataclass(frozen=True, slots=True)
class Curve:
    """``below_percent[d]``: share of the time below d degrees, d from 0 to 180."""

    name: str
    below_percent: Sequence[float]


def draw_two_curves(
    curves: tuple[Curve, Curve], axes: tuple[str, str], words: tuple[str, str], width: float
) -> str:
    """Draw both curves to one scale; guide lines at 30, 60 and 90 deg."""
    left, right, top, bottom = 40.0, width - 8, 40.0, 210.0 if width > NARROW else 240.0

    def place(degrees: float, percent: float) -> str:
        x = left + (right - left) * degrees / TOP_DEG
        return f"{svg.number(x)} {svg.number(bottom - (bottom - top) * percent / 100)}"

    body = _draw_frame(left, right, top, bottom, axes)
    for curve, style in zip(curves, _STYLES, strict=True):
        points = (place(degrees, percent) for degrees, percent in enumerate(curve.below_percent))
        body.append(svg.path("M" + "L".join(points), style))
    return svg.picture(width, bottom + 34, f"curves{width:.0f}", words, [*body, *_name_curves(curves, left)])


def _draw_frame(left: float, right: float, top: float, bottom: float, axes: tuple[str, str]) -> list[str]:
    rule = f'class="rule" stroke="{svg.SOFT}"'
    body = [svg.line(left, top, left, bottom, rule), svg.line(left, bottom, right, bottom, rule)]
    for percent in (0, 25, 50, 75, 100):
        y = bottom - (bottom - top) * percent / 100
        body += [
            svg.line(left - 4, y, left, y, rule),
            svg.text(left - 7, y + 3.8, f"{percent}", "soft", "end"),
        ]
    for angle in range(0, TOP_DEG + 1, 30):
        x = left + (right - left) * angle / TOP_DEG
        if angle in GUIDES_DEG:
            body.append(svg.line(x, top, x, bottom, f'{rule} stroke-width="0.7" stroke-dasharray="3 3"'))
        anchor = "end" if angle == TOP_DEG else "middle"
        shown = min(x, right + 6) if angle == TOP_DEG else x
        body.append(svg.text(shown, bottom + 15, f"{angle}°", "strong" if angle == 60 else "soft", anchor))
    across, upwards = axes
    return [*body, svg.text(right, bottom + 30, across, "soft", "end"), svg.text(0, 28, upwards)]


def _name_curves(curves: tuple[Curve, Curve], left: float) -> list[str]:
    body, x = [], left
    for curve, style in zip(curves, _STYLES, strict=True):
        body += [svg.line(x, 6, x + 26, 6, style), svg.text(x + 31, 10, curve.name, "ink")]
        x += 31 + svg.estimate_width(curve.name) + 16
    return body
