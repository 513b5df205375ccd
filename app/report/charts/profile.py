"""The drawings of the Arm Elevation Profile: a scale for each tile, and how sure the main figure is.

What is pointed at is vermillion and doubled by its shape; what the pose may add is hatched.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from app.report.charts import svg

TILE_PX = 134.0
SURE_PX = 318.0
_ROW_PX = 34.0
Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class TileScale:
    """A measured value on a scale from 0 to ``end``, with what was published beside it.

    ``interval`` is a bar and ``pose`` what the one-sided error of the pose adds to it, hatched. ``published``
    is one value or a range of two; empty where none may stand there.
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
    place, y = _lay_out(6.0, TILE_PX - 6.0, scale.end), 24.0
    body = [
        svg.define_hatch(scale.key),
        svg.line(6, y, TILE_PX - 6, y, f'class="rule" stroke="{svg.SOFT}"'),
        *_draw_ranges(scale, place, y),
        *_draw_published(scale, place, y),
        _draw_diamond(place(scale.measured), y),
        svg.text(2, y + 21, "0"),
        svg.text(TILE_PX, y + 21, scale.end_label, anchor="end"),
    ]
    return svg.picture(TILE_PX, 50, scale.key, scale.words, body)


def _lay_out(left_px: float, right_px: float, end: float) -> Callable[[float], float]:
    def place(value: float) -> float:
        return left_px + (right_px - left_px) * min(max(value / end, 0.0), 1.0)

    return place


def _draw_ranges(scale: TileScale, place: Callable[[float], float], y_px: float) -> list[str]:
    body = []
    if scale.pose:
        body += _hatch(place, scale.pose, y_px - 5, scale.key)
    if scale.interval:
        low, high = map(place, scale.interval)
        body.append(svg.rect(low, y_px - 3, high - low, 6, f'class="band" fill="{svg.RAMP[1]}"'))
    return body


def _hatch(place: Callable[[float], float], span: Span, y_px: float, key: str) -> list[str]:
    low, high = map(place, span)
    return svg.hatch(low, y_px, high - low, 10, key)


def _draw_diamond(x_px: float, y_px: float) -> str:
    shape = f"M{svg.number(x_px)} {svg.number(y_px - 6)}l6 6l-6 6l-6 -6Z"
    return svg.path(shape, f'class="mark" fill="{svg.RAMP[3]}" stroke="{svg.PAPER}"')


def _draw_published(scale: TileScale, place: Callable[[float], float], y_px: float) -> list[str]:
    if not scale.published:
        return []
    ends = [place(value) for value in scale.published]
    tick = f'class="accent-line" stroke="{svg.ORANGE}" stroke-width="2"'
    body = [svg.line(x, y_px - 9, x, y_px + 9, tick) for x in ends]
    body += [svg.line(ends[0], y_px - 9, ends[-1], y_px - 9, tick)] if len(ends) > 1 else []
    half = svg.estimate_width(scale.published_label) / 2
    centre = min(max((ends[0] + ends[-1]) / 2, half), TILE_PX - half)
    return [*body, svg.text(centre, y_px - 13, scale.published_label, "accent", "middle")]


# ------------------------------------------------------------------ how sure


@dataclass(frozen=True, slots=True)
class Doubt:
    """One reason for doubt: the range that the figure has with it; None where it is not known.

    ``is_pose``: hatched, and of unknown length where there is no range.
    """

    name: str
    told: str
    span: Span | None
    is_pose: bool = False


@dataclass(frozen=True, slots=True)
class Sureness:
    """The doubts about one figure, all on its scale from 0 to ``end``."""

    words: tuple[str, str]
    measured: float
    end: float
    end_label: str
    doubts: Sequence[Doubt]


def draw_sureness(shown: Sureness) -> str:
    """Draw a bar for each doubt on one scale, with the measured value through all of them."""
    place, bottom = _lay_out(2.0, SURE_PX - 2.0, shown.end), _ROW_PX * len(shown.doubts) + 2
    at = place(shown.measured)
    body = [svg.define_hatch("sure")]
    for rank, doubt in enumerate(shown.doubts):
        top = rank * _ROW_PX
        body += _draw_doubt(doubt, shown, place, top)
        body.append(
            svg.line(at, top + 16, at, top + 30, f'class="median" stroke="{svg.RAMP[3]}" stroke-width="2.4"')
        )
    body += [
        svg.line(2, bottom, SURE_PX - 2, bottom, f'class="rule" stroke="{svg.SOFT}"'),
        svg.text(0, bottom + 15, "0"),
        svg.text(SURE_PX, bottom + 15, shown.end_label, anchor="end"),
    ]
    return svg.picture(SURE_PX, bottom + 19, "sure", shown.words, body)


def _draw_doubt(doubt: Doubt, shown: Sureness, place: Callable[[float], float], y_px: float) -> list[str]:
    """Draw the name and the range of a doubt over its bar."""
    body = [
        svg.text(0, y_px + 12, doubt.name, "ink"),
        svg.text(SURE_PX, y_px + 12, doubt.told, "ink", "end"),
    ]
    if doubt.span and doubt.is_pose:
        body += _hatch(place, doubt.span, y_px + 18, "sure")
    elif doubt.span:
        low, high = map(place, doubt.span)
        body.append(svg.rect(low, y_px + 18, high - low, 10, f'class="band" fill="{svg.RAMP[1]}"'))
    elif doubt.is_pose:
        body.append(_draw_arrow(place(shown.measured) + 5, place(shown.end), y_px + 23))
    return body


def _draw_arrow(start_px: float, end_px: float, y_px: float) -> str:
    """Draw an arrow to the right: the value may be higher, nobody knows by how much."""
    commands = f"M{svg.number(start_px)} {svg.number(y_px)}H{svg.number(end_px)}m-6 -4l6 4l-6 4"
    dash = 'fill="none" stroke-width="1.3" stroke-dasharray="4 2"'
    return svg.path(commands, f'class="rule" stroke="{svg.SOFT}" {dash}')
