"""Charts of several days: overlaid by the clock, in order of time, and one row each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import groupby
from math import ceil

from acromion.app.report.charts import svg
from acromion.app.report.charts.day import Day, DayLabels, Mark, MinuteBand, Overlay, draw_overlays
from acromion.app.report.charts.svg import NARROW, Plot, Span
from acromion.app.report.figures import format_figure
from acromion.app.report.model import Chart
from acromion.app.report.pairs import format_points
from acromion.app.report.several.document import MAIN, compute_trend
from acromion.app.report.several.people import ArmDays
from acromion.app.report.words.numbers import Clock, format_angle
from acromion.app.report.words.wording import Language, Words, fill
from acromion.fusion.comparison.days import PERCENTS, QUARTER_S, ClockBand, Trend, find_first_quarter

_DAY_S = 86_400.0
_MIDNIGHT = datetime(2000, 1, 1)  # noqa: DTZ001  any day: only its clock is used

# Overlaid by the clock.


Placed = tuple[float, ClockBand]
"""A quarter hour with its start on the axis in s."""


def build_overlays(arms: Sequence[tuple[str, ArmDays]], words: Words, language: Language) -> Chart:
    """Draw the overlaid days of each arm, all arms on one clock, each with its name."""
    entry = words["overlay"]
    first_s = find_first_quarter([arm.bands for _, arm in arms])
    clock = Clock(_MIDNIGHT + timedelta(seconds=first_s), language)
    placed = [  # quarter hours on an axis that starts at ``first_s``, also across midnight
        sorted((((band.start_s - first_s) % _DAY_S, band) for band in arm.bands), key=lambda place: place[0])
        for _, arm in arms
    ]
    end_s = max(run[-1][0] for run in placed) + QUARTER_S
    names = [name for name, _ in arms]
    facts = {"list": ", ".join(names), "start": clock.format(0), "end": clock.format(end_s)}
    alternative = fill(entry["alternative"], facts)
    panels = [_lay_out(name, run, clock, end_s, entry) for name, run in zip(names, placed, strict=True)]
    shown = (entry["outer"], entry["median"], "", entry["unknown"])
    labels = DayLabels(entry["title"], alternative, *shown, inner=entry["inner"])
    return Chart.draw(
        (entry["title"], alternative),
        lambda _, width_px: draw_overlays(panels, labels, width_px),
        entry["columns"],
        (
            (
                name,
                clock.format(at),
                str(band.days),
                *(format_angle((band.percentiles_deg or {}).get(p), language) for p in PERCENTS),
            )
            for name, run in zip(names, placed, strict=True)
            for at, band in run
        ),
    )


def _lay_out(name: str, placed: list[Placed], clock: Clock, end_s: float, entry: Words) -> Overlay:
    """Lay out one arm: runs of adjacent quarter hours, and the time with too few analysed days."""
    known = enumerate((at, band.percentiles_deg) for at, band in placed if band.percentiles_deg is not None)
    runs = [
        [place for _, place in run]
        for _, run in groupby(known, key=lambda item: round(item[1][0] / QUARTER_S) - item[0])
    ]
    outer, inner = (
        tuple(
            tuple(MinuteBand(at, at + QUARTER_S, angles[low], angles[50], angles[high]) for at, angles in run)
            for run in runs
        )
        for low, high in ((10, 90), (25, 75))
    )
    edges = [0.0, *(edge for run in runs for edge in (run[0][0], run[-1][0] + QUARTER_S)), end_s]
    gaps = zip(edges[::2], edges[1::2], strict=True)
    marks = tuple(Mark(a, b, "missing", entry["unknown"]) for a, b in gaps if b > a)
    most = max(band.days for _, band in placed)
    return Overlay(
        name=fill(entry["panel"], {"name": name, "days": str(most)}),
        day=Day(end_s, clock, outer, marks, None),
        inner=inner,
        counts=tuple((at, at + QUARTER_S, band.days) for at, band in placed),
        days=most,
        counts_label=entry["counts"],
    )


# In order of time, compared with the first day.


_PANEL_PX = 130.0
_NAME_PX = 34.0
_DATES_PX = 26.0
_LEFT_PX = 44.0
_RIGHT_PX = 14.0
_MOST_TICKS = 5
_STEPS = (1.0, 2.0, 5.0, 10.0, 20.0, 25.0)
_TOP_PERCENT = 100.0


@dataclass(frozen=True, slots=True)
class Visit:
    """One day: its start, its share in percent and the range; days that do not count are left out."""

    start: datetime
    percent: float
    span: Span | None
    is_left_out: bool

    @property
    def at_days(self) -> float:
        """Its time in days."""
        return (self.start - _MIDNIGHT).total_seconds() / _DAY_S

    @property
    def date(self) -> str:
        """Its date."""
        return f"{self.start:%Y-%m-%d}"


@dataclass(frozen=True, slots=True)
class VisitPanel:
    """The days of one arm in order of time, and their trend; None for fewer than two that count."""

    name: str
    visits: Sequence[Visit]
    trend: Trend | None

    @property
    def band(self) -> Span | None:
        """The first day plus and minus the minimal detectable change."""
        trend = self.trend
        return (trend.first - trend.detectable, trend.first + trend.detectable) if trend else None


def build_visits(arms: Sequence[tuple[str, ArmDays]], words: Words, language: Language) -> tuple[Chart, ...]:
    """Draw every day by its date against the first; none if no arm has two days with a date."""
    panels = []
    for name, arm in arms:
        trend = compute_trend(arm)
        if trend is None:
            continue
        visits = []
        for day in arm.days:
            percent, interval = day.list_figures()[MAIN], day.find_interval(MAIN)
            if day.start and percent is not None:
                span = (interval.low, interval.high) if interval else None
                visits.append(Visit(day.start, percent, span, day.left_out is not None))
        panels.append(VisitPanel(name, visits, trend))
    return (draw_visits(panels, words, language),) if panels else ()


def draw_visits(panels: Sequence[VisitPanel], words: Words, language: Language) -> Chart:
    """Draw the arms one above the other, each day by its date against the band of its first day."""
    entry = words["visits"]
    spreads = [
        f"{panel.name} {format_points(panel.trend.detectable, MAIN, language)}"
        for panel in panels
        if panel.trend
    ]
    alternative = fill(entry["alternative"], {"list": ", ".join(panel.name for panel in panels)})
    return Chart.draw(
        (entry["title"], alternative),
        lambda words, width_px: _draw_visits(panels, words, width_px),
        entry["columns"],
        (
            (panel.name, visit.date, format_figure(visit.percent, MAIN, language))
            for panel in panels
            for visit in panel.visits
        ),
        fill(entry["note"], {"spreads": ", ".join(spreads)}) if spreads else entry["note_alone"],
    )


def _draw_visits(panels: Sequence[VisitPanel], words: tuple[str, str], width_px: float) -> str:
    every = [visit for panel in panels for visit in panel.visits]
    first, last = (find(visit.at_days for visit in every) for find in (min, max))
    step, top = _find_scale(panels)
    left, room = _LEFT_PX + 6, width_px - _LEFT_PX - _RIGHT_PX
    panel_px, body = _PANEL_PX + _NAME_PX + _DATES_PX, []
    for rank, panel in enumerate(panels):
        y = rank * panel_px + _NAME_PX
        across = first, max(last, first + 1e-9)
        plot = Plot(left, left + room * 0.97, y, y + _PANEL_PX, across, (0.0, top))
        body.append(svg.text(0, y - 14, panel.name, "strong"))
        if panel.band:
            low, high = (plot.y(end) for end in panel.band)
            band = f'class="band" fill="{svg.RAMP[0]}"'
            body.append(svg.rect(_LEFT_PX, high, room, max(low - high, 1.0), band))
        for tick in range(round(top / step) + 1):
            y = plot.y(tick * step)
            rule = f'{svg.RULE} stroke-width="{0.3 if tick else 0.8}"'
            body.append(svg.line(_LEFT_PX, y, width_px - _RIGHT_PX, y, rule))
            body.append(svg.text(_LEFT_PX - 6, y + 4, f"{tick * step:g}\u202f%", "soft", "end"))
        body += _draw_panel(panel.visits, plot, width_px)
    return svg.picture(width_px, len(panels) * panel_px, f"visits{width_px:.0f}", words, body)


def _find_scale(panels: Sequence[VisitPanel]) -> Span:
    """Return the step and the end of a scale that includes every day, its range and the band."""
    visits = [visit for panel in panels for visit in panel.visits]
    ends = [
        *(visit.percent for visit in visits),
        *(visit.span[1] for visit in visits if visit.span),
        *(panel.band[1] for panel in panels if panel.band),
    ]
    most = min(max(ends), _TOP_PERCENT)
    step = next((step for step in _STEPS if step * _MOST_TICKS >= most), _STEPS[-1])
    return step, step * max(ceil(most / step), 1)


def _draw_panel(visits: Sequence[Visit], plot: Plot, width_px: float) -> list[str]:
    """Draw a point for each day, its range and its date; connect the days that count."""
    body = []
    counted = [visit for visit in visits if not visit.is_left_out]
    if len(counted) > 1:
        steps = " L".join(f"{plot.x(v.at_days):.1f} {plot.y(v.percent):.1f}" for v in counted)
        stroke = f'fill="none" {svg.RULE} stroke-width="0.8"'
        body.append(svg.path(f"M{steps}", stroke))
    for visit in visits:
        x, y = plot.x(visit.at_days), plot.y(visit.percent)
        if visit.span:
            low, high = map(plot.y, visit.span)
            body.append(svg.line(x, low, x, high, f'{svg.ACCENT} stroke-width="1.2"'))
        kind, fill_colour = ("edge", svg.PAPER) if visit.is_left_out else ("mark", svg.RAMP[3])
        place = f'cx="{svg.number(x)}" cy="{svg.number(y)}" r="4"'
        body.append(f'<circle class="{kind}" {place} fill="{fill_colour}" stroke="{svg.RAMP[3]}"/>')
    return [*body, *_draw_dates(visits, plot, width_px)]


def _draw_dates(visits: Sequence[Visit], plot: Plot, width_px: float) -> list[str]:
    """Draw the dates that fit: first, last, then from the left; the period if first and last do not fit."""

    def place(label: str, at_px: float) -> tuple[float, Span]:
        half = svg.estimate_width(label) / 2
        x = min(max(at_px, half), width_px - half)
        return x, (x - half - 6, x + half)

    first, last = visits[0], visits[-1]
    labels = [(visit.date, plot.x(visit.at_days)) for visit in (first, last, *visits[1:-1])]
    if first.date != last.date and place(*labels[0])[1][1] > place(*labels[1])[1][0]:
        labels = [(f"{first.date} – {last.date}", (labels[0][1] + labels[1][1]) / 2)]
    body, taken = [], list[Span]()
    for label, at_px in labels:
        x, (start, stop) = place(label, at_px)
        if not any(start < other_stop and other_start < stop for other_start, other_stop in taken):
            taken.append((start, stop))
            body.append(svg.text(x, plot.bottom_px + 19, label, "soft", "middle"))
    return body


# A row for each day, or person.


_ROW_PX = 24.0
_GAP_PX = 10.0


@dataclass(frozen=True, slots=True)
class FigureRow:
    """A day, or a mean of days (``is_mean``, in bold).

    ``values`` and ``shown``: each figure and its text; None if unknown. ``ranges``: drawn as lines over the
    bars; empty if there are none. ``is_left_out``: does not count, so that its bar is empty.
    """

    label: str
    values: tuple[float | None, ...]
    shown: tuple[str, ...]
    ranges: tuple[Span | None, ...] = ()
    is_mean: bool = False
    is_left_out: bool = False


def build_rows(
    rows: Sequence[FigureRow], heads: tuple[str, str], columns: Sequence[str], words: Words
) -> Chart:
    """Draw a row for each day or person; ``heads`` are the title and the heading of the first column."""
    title, first = heads
    return Chart.draw(
        (title, fill(words["rows"]["alternative"], {"title": title})),
        lambda words, width_px: _draw_rows(rows, columns, words, width_px),
        (first, *columns),
        ((row.label, *row.shown) for row in rows),
        words["rows"]["note"],
    )


def _draw_rows(
    rows: Sequence[FigureRow], columns: Sequence[str], words: tuple[str, str], width_px: float
) -> str:
    """Draw the rows below their headings; each column has a separate scale."""
    is_narrow = width_px <= NARROW  # a label is then above its bars
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
            x = left + column * room
            plot = Plot(x, x + room - _GAP_PX, across=(0.0, end))
            body += _draw_figure(row, column, plot, top)
        top += _ROW_PX
    return svg.picture(width_px, top + 4, f"rows{width_px:.0f}", words, body)


def _find_end(rows: Sequence[FigureRow], column: int) -> float:
    largest = max((row.values[column] or 0.0 for row in rows), default=0.0)
    ends = (span[1] for row in rows if row.ranges and (span := row.ranges[column]))
    return max(largest, max(ends, default=0.0), 1e-9)


def _draw_figure(row: FigureRow, column: int, plot: Plot, top_px: float) -> list[str]:
    x, value = plot.left_px, row.values[column]
    body = [svg.text(x, top_px + 11, row.shown[column], "strong" if row.is_mean else "ink")]
    if value is None:
        return body
    kind = f'{svg.EDGE} stroke-width="0.7"' if row.is_left_out else svg.BAND
    body.append(svg.rect(x, top_px + 14.5, max(plot.x(value) - x, 0.6), 5, kind))
    span = row.ranges[column] if row.ranges else None
    if span:
        low, high = map(plot.x, span)
        stroke = f'{svg.ACCENT} stroke-width="1.6"'
        body.append(svg.line(low, top_px + 17, high, top_px + 17, stroke))
        body += [svg.line(end, top_px + 14, end, top_px + 20, stroke) for end in (low, high)]
    return body
