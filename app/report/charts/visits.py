"""The days of a person in order of time, each against what single days differ by anyway."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

from app.report.charts import svg

_PANEL_PX = 130.0
_NAME_PX = 34.0
_DATES_PX = 22.0
_LEFT_PX = 44.0
_RIGHT_PX = 14.0
_MOST_TICKS = 5
_STEPS = (1.0, 2.0, 5.0, 10.0, 20.0, 25.0)
_TOP_PERCENT = 100.0
Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Visit:
    """One day: when, in days since any moment, its date in words, its share in percent and the range."""

    at_days: float
    date: str
    percent: float
    span: Span | None
    is_left_out: bool = False


@dataclass(frozen=True, slots=True)
class VisitPanel:
    """The days of one arm, in order of time; ``band``: the first day, less and plus what days differ by."""

    name: str
    visits: tuple[Visit, ...]
    band: Span | None


def draw_visits(panels: Sequence[VisitPanel], words: tuple[str, str], width_px: float) -> str:
    """Draw a panel for each arm, all to one scale of time and of shares."""
    every = [visit for panel in panels for visit in panel.visits]
    first, last = (find(visit.at_days for visit in every) for find in (min, max))
    room = width_px - _LEFT_PX - _RIGHT_PX
    per_day = room / max(last - first, 1e-9)
    step, top = _find_scale(panels)
    body = []
    for number, panel in enumerate(panels):
        y = number * (_PANEL_PX + _NAME_PX + _DATES_PX) + _NAME_PX
        place = _Place(_LEFT_PX, first, per_day, y, _PANEL_PX / top, width_px - _RIGHT_PX)
        body.append(svg.text(0, y - 14, panel.name, "strong"))
        body += [*_draw_band(panel, place), *_draw_scale(place, step, top), *_draw_panel(panel, place)]
    height = len(panels) * (_PANEL_PX + _NAME_PX + _DATES_PX)
    return svg.picture(width_px, height, f"visits{width_px:.0f}", words, body)


@dataclass(frozen=True, slots=True)
class _Place:
    left_px: float
    first_days: float
    px_per_day: float
    top_px: float
    px_per_percent: float
    right_px: float

    @property
    def base_px(self) -> float:
        return self.top_px + _PANEL_PX

    def x(self, at_days: float) -> float:
        return self.left_px + 6 + (at_days - self.first_days) * self.px_per_day * 0.97

    def y(self, percent: float) -> float:
        return max(self.base_px - percent * self.px_per_percent, self.top_px)


def _find_scale(panels: Sequence[VisitPanel]) -> tuple[float, float]:
    """Give the step of the scale and its end, which holds every day, its range and the band."""
    spans = [visit.span for panel in panels for visit in panel.visits] + [panel.band for panel in panels]
    ends = [visit.percent for panel in panels for visit in panel.visits] + [span[1] for span in spans if span]
    most = min(max(ends), _TOP_PERCENT)
    step = next((step for step in _STEPS if step * _MOST_TICKS >= most), _STEPS[-1])
    return step, step * max(ceil(most / step), 1)


def _draw_scale(place: _Place, step: float, top: float) -> list[str]:
    body = []
    for tick in range(round(top / step) + 1):
        y = place.y(tick * step)
        rule = f'class="rule" stroke="{svg.SOFT}" stroke-width="{0.3 if tick else 0.8}"'
        body.append(svg.line(place.left_px, y, place.right_px, y, rule))
        body.append(svg.text(place.left_px - 6, y + 4, f"{tick * step:g}\u202f%", "soft", "end"))
    return body


def _draw_band(panel: VisitPanel, place: _Place) -> list[str]:
    if panel.band is None:
        return []
    low, high = (place.y(max(end, 0.0)) for end in panel.band)
    fill = f'class="band" fill="{svg.RAMP[0]}"'
    return [svg.rect(place.left_px, high, place.right_px - place.left_px, max(low - high, 1.0), fill)]


def _draw_panel(panel: VisitPanel, place: _Place) -> list[str]:
    body = []
    counted = [visit for visit in panel.visits if not visit.is_left_out]
    steps = " L".join(f"{place.x(v.at_days):.1f} {place.y(v.percent):.1f}" for v in counted)
    if len(counted) > 1:
        body.append(svg.path(f"M{steps}", f'fill="none" class="rule" stroke="{svg.SOFT}" stroke-width="0.8"'))
    for visit in panel.visits:
        body += _draw_visit(visit, place)
    return body + _draw_dates(panel.visits, place)


def _draw_visit(visit: Visit, place: _Place) -> list[str]:
    x, y = place.x(visit.at_days), place.y(visit.percent)
    body = []
    if visit.span:
        stroke = f'class="accent-line" stroke="{svg.ORANGE}" stroke-width="1.2"'
        body.append(svg.line(x, place.y(visit.span[0]), x, place.y(visit.span[1]), stroke))
    fill = svg.PAPER if visit.is_left_out else svg.RAMP[3]
    kind = "edge" if visit.is_left_out else "mark"
    place_words = f'cx="{svg.number(x)}" cy="{svg.number(y)}" r="4"'
    body.append(f'<circle class="{kind}" {place_words} fill="{fill}" stroke="{svg.RAMP[3]}"/>')
    return body


def _draw_dates(visits: Sequence[Visit], place: _Place) -> list[str]:
    """Write the dates that have room: the last first, then from the left."""
    body: list[str] = []
    taken: list[Span] = []
    for visit in (visits[-1], *visits[:-1]):
        half = svg.estimate_width(visit.date) / 2
        x = min(max(place.x(visit.at_days), half), place.right_px + _RIGHT_PX - half)
        if any(x - half - 6 < end and start < x + half + 6 for start, end in taken):
            continue
        taken.append((x - half, x + half))
        body.append(svg.text(x, place.base_px + 15, visit.date, "soft", "middle"))
    return body
