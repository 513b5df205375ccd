"""Charts of the Arm Elevation Profile: a scale for each tile, and the uncertainty of the main figure.

Highlights are vermillion and also marked by their shape; the possible addition by the pose is hatched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from acromion.app.report.charts import svg
from acromion.app.report.charts.svg import Plot, Span

TILE_PX = 134.0
SURE_PX = 318.0
_ROW_PX = 27.0


@dataclass(frozen=True, slots=True)
class TileScale:
    """A measured value on a scale from 0 to ``end``, with the published value.

    ``interval`` is a bar and ``pose`` the hatched addition by the one-sided error of the pose. ``published``
    is one value or a range of two; empty if none applies.
    """

    key: str
    words: tuple[str, str]
    end: float
    end_label: str
    measured: float
    interval: Span | None = None
    pose: Span | None = None
    published: tuple[float, ...] = ()
    published_label: str = ""


def draw_tile(scale: TileScale) -> str:
    """Draw the scale of a tile: the value as a diamond, its range as a bar, the published value as a mark."""
    plot, y = Plot(6.0, TILE_PX - 6.0, across=(0.0, scale.end)), 24.0
    body = [svg.define_hatch(scale.key), svg.line(6, y, TILE_PX - 6, y, svg.RULE)]
    if scale.pose:
        low, high = map(plot.x, scale.pose)
        body += svg.hatch(low, y - 5, high - low, 10, scale.key)
    if scale.interval:
        low, high = map(plot.x, scale.interval)
        body.append(svg.rect(low, y - 3, high - low, 6, svg.BAND))
    if scale.published:
        ends = [plot.x(value) for value in scale.published]
        tick = f'{svg.ACCENT} stroke-width="2"'
        body += [svg.line(x, y - 9, x, y + 9, tick) for x in ends]
        body += [svg.line(ends[0], y - 9, ends[-1], y - 9, tick)] if len(ends) > 1 else []
        half = svg.estimate_width(scale.published_label) / 2
        centre = min(max((ends[0] + ends[-1]) / 2, half), TILE_PX - half)
        body.append(svg.text(centre, y - 13, scale.published_label, "accent", "middle"))
    diamond = f"M{svg.number(plot.x(scale.measured))} {svg.number(y - 6)}l6 6l-6 6l-6 -6Z"
    body += [
        svg.path(diamond, f'class="mark" fill="{svg.RAMP[3]}" stroke="{svg.PAPER}"'),
        svg.text(2, y + 21, "0"),
        svg.text(TILE_PX, y + 21, scale.end_label, anchor="end"),
    ]
    return svg.picture(TILE_PX, 50, scale.key, scale.words, body)


@dataclass(frozen=True, slots=True)
class UncertaintyBar:
    """One source of uncertainty: the range of the figure with it; None if unknown.

    ``is_pose``: hatched; without a range its length is unknown. ``is_combined``: of all sources together.
    """

    name: str
    shown: str
    span: Span | None
    is_pose: bool = False
    is_combined: bool = False


@dataclass(frozen=True, slots=True)
class UncertaintyChart:
    """The uncertainties of one figure on a scale from 0 to ``end``, with the proposed ``level``, if any."""

    words: tuple[str, str]
    measured: float
    end: float
    end_label: str
    doubts: Sequence[UncertaintyBar]
    level: float | None = None
    level_label: str = ""


def draw_uncertainty(shown: UncertaintyChart) -> str:
    """Draw a bar for each uncertainty on one scale, crossed by the measured value."""
    plot, bottom = Plot(2.0, SURE_PX - 2.0, across=(0.0, shown.end)), _ROW_PX * len(shown.doubts) + 4
    at, median = plot.x(shown.measured), f'{svg.MEDIAN} stroke-width="2.4"'
    body = [svg.define_hatch("sure")]
    for rank, doubt in enumerate(shown.doubts):
        top, kind = 2 + rank * _ROW_PX, "strong" if doubt.is_combined else "ink"
        body += [
            svg.text(0, top + 12, doubt.name, kind),
            svg.text(SURE_PX, top + 12, doubt.shown, kind, "end"),
        ]
        if doubt.span:
            low, high = map(plot.x, doubt.span)
            place = (low, top + 17, high - low, 9)
            band = svg.STRONG_BAND if doubt.is_combined else svg.BAND
            body += svg.hatch(*place, "sure") if doubt.is_pose else [svg.rect(*place, band)]
        elif doubt.is_pose:  # an arrow to the right: the value may be higher by an unknown amount
            start, end = svg.number(at + 5), svg.number(plot.x(shown.end))
            dash = f'{svg.RULE} fill="none" stroke-width="1.3" stroke-dasharray="4 2"'
            body.append(svg.path(f"M{start} {svg.number(top + 21.5)}H{end}m-6 -4l6 4l-6 4", dash))
        body.append(svg.line(at, top + 15, at, top + 28, median))
        if shown.level is not None:
            x = plot.x(shown.level)
            body.append(svg.line(x, top + 15, x, top + 28, f'{svg.ACCENT} stroke-width="2"'))
    body += [
        svg.line(2, bottom, SURE_PX - 2, bottom, svg.RULE),
        svg.text(0, bottom + 15, "0"),
        svg.text(SURE_PX, bottom + 15, shown.end_label, anchor="end"),
    ]
    if shown.level is not None:
        body.append(svg.text(plot.x(shown.level), bottom + 15, shown.level_label, "accent", "middle"))
    return svg.picture(SURE_PX, bottom + 19, "sure", shown.words, body)
