"""The drawings of several days: overlaid by the clock, and a row for each."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from itertools import groupby

from app.report.analysis.day import Day, Mark, MinuteBand
from app.report.charts.day import DayLabels, Overlay, draw_overlays
from app.report.charts.days import FigureRow, draw_rows
from app.report.charts.svg import NARROW, WIDE
from app.report.charts.visits import Visit, VisitPanel, draw_visits
from app.report.days.document import MAIN, follow_days
from app.report.days.people import ArmDays, MeasuredDay
from app.report.days.tables import name_arm
from app.report.figures import format_figure
from app.report.model import Chart, Table
from app.report.pairs import format_points
from app.report.words.numbers import Clock, format_angle
from app.report.words.wording import Language, Words, fill
from fusion.days.overlay import PERCENTS, QUARTER_S, ClockBand, find_first_quarter

_DAY_S = 86_400.0
_MIDNIGHT = datetime(2000, 1, 1)  # noqa: DTZ001  any day: only its clock is read

Placed = tuple[float, ClockBand]
"""A quarter hour with where it begins on the axis, s."""


def build_overlays(arms: Sequence[tuple[str, ArmDays]], words: Words, language: Language) -> Chart:
    """Draw the days of each arm over one another, all arms to one clock; each has its name."""
    entry = words["overlay"]
    first_s = find_first_quarter([arm.bands for _, arm in arms])
    clock = Clock(_MIDNIGHT + timedelta(seconds=first_s), language)
    placed = [  # the quarter hours on an axis that begins at ``first_s``, midnight or not
        sorted((((band.start_s - first_s) % _DAY_S, band) for band in arm.bands), key=lambda place: place[0])
        for _, arm in arms
    ]
    end_s = max(run[-1][0] for run in placed) + QUARTER_S
    facts = {
        "list": ", ".join(name for name, _ in arms),
        "start": clock.format(0),
        "end": clock.format(end_s),
    }
    alternative = fill(entry["alternative"], facts)
    panels = [_lay_out(name, run, clock, end_s, entry) for (name, _), run in zip(arms, placed, strict=True)]
    labels = DayLabels(
        entry["title"],
        alternative,
        entry["outer"],
        entry["median"],
        "",
        entry["unknown"],
        inner=entry["inner"],
    )
    rows = tuple(
        (
            name,
            clock.format(at),
            str(band.days),
            *(format_angle((band.percentiles_deg or {}).get(p), language) for p in PERCENTS),
        )
        for (name, _), run in zip(arms, placed, strict=True)
        for at, band in run
    )
    return Chart(
        title=entry["title"],
        alternative=alternative,
        wide=draw_overlays(panels, labels, WIDE),
        narrow=draw_overlays(panels, labels, NARROW),
        table=Table(entry["title"], tuple(entry["columns"]), rows),
    )


def _lay_out(name: str, placed: list[Placed], clock: Clock, end_s: float, entry: Words) -> Overlay:
    """Lay one arm out: runs of touching quarter hours, and the time in which too few days were analysed."""
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


def build_visits(arms: Sequence[ArmDays], words: Words, language: Language) -> tuple[Chart, ...]:
    """Draw every day by its date against the first; nothing where no arm has two days with a date."""
    entry = words["visits"]
    followed = [(arm, trend) for arm in arms if (trend := follow_days(arm))]
    if not followed:
        return ()
    panels = []
    for arm, trend in followed:
        visits = (_lay_visit(day, day.start) for day in arm.days if day.start)
        band = trend.first - trend.detectable, trend.first + trend.detectable
        name = name_arm(arm.side, arm.stage, language)
        panels.append(VisitPanel(name, tuple(filter(None, visits)), band))
    spreads = (
        f"{name_arm(arm.side, arm.stage, language)} {format_points(trend.detectable, MAIN, language)}"
        for arm, trend in followed
    )
    alternative = fill(entry["alternative"], {"list": ", ".join(panel.name for panel in panels)})
    rows = tuple(
        (panel.name, visit.date, format_figure(visit.percent, MAIN, language))
        for panel in panels
        for visit in panel.visits
    )
    return (
        Chart(
            title=entry["title"],
            alternative=alternative,
            wide=draw_visits(panels, (entry["title"], alternative), WIDE),
            narrow=draw_visits(panels, (entry["title"], alternative), NARROW),
            table=Table(entry["title"], tuple(entry["columns"]), rows),
            note=fill(entry["note"], {"spreads": ", ".join(spreads)}),
        ),
    )


def _lay_visit(day: MeasuredDay, start: datetime) -> Visit | None:
    percent = day.list_figures()[MAIN]
    if percent is None:
        return None
    interval = day.find_interval(MAIN)
    span = (interval.low, interval.high) if interval else None
    at_days = (start - _MIDNIGHT).total_seconds() / _DAY_S
    return Visit(at_days, f"{start:%Y-%m-%d}", percent, span, day.left_out is not None)


def build_rows(
    rows: Sequence[FigureRow], heads: tuple[str, str], columns: Sequence[str], words: Words
) -> Chart:
    """Draw a row for each day or person; ``heads`` are its title and the head of the first column."""
    title, first = heads
    alternative = fill(words["rows"]["alternative"], {"title": title})
    table_rows = tuple((row.label, *row.told) for row in rows)
    return Chart(
        title=title,
        alternative=alternative,
        wide=draw_rows(rows, columns, (title, alternative), WIDE),
        narrow=draw_rows(rows, columns, (title, alternative), NARROW),
        table=Table(title, (first, *columns), table_rows),
        note=words["rows"]["note"],
    )
