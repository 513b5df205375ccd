"""The drawings of several days: overlaid by the clock, and a row for each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from fusion.days import Trend
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
    placed = [_place(arm.bands, first_s) for _, arm in arms]
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
        (name, *row) for (name, _), run in zip(arms, placed, strict=True) for row in _tabulate(run, clock)
    )
    return Chart(
        title=entry["title"],
        alternative=alternative,
        wide=draw_overlays(panels, labels, WIDE),
        narrow=draw_overlays(panels, labels, NARROW),
        table=Table(entry["title"], tuple(entry["columns"]), rows),
    )


def _place(bands: Sequence[ClockBand], first_s: float) -> list[Placed]:
    """Put the quarter hours on an axis that begins at ``first_s``, midnight or not."""
    placed = (((band.start_s - first_s) % _DAY_S, band) for band in bands)
    return sorted(placed, key=lambda place: place[0])


def _lay_out(name: str, placed: list[Placed], clock: Clock, end_s: float, entry: Words) -> Overlay:
    most = max(band.days for _, band in placed)
    return Overlay(
        name=fill(entry["panel"], {"name": name, "days": str(most)}),
        day=Day(end_s, clock, _list_runs(placed, (10, 90)), _mark_unknown(placed, end_s, entry), None),
        inner=_list_runs(placed, (25, 75)),
        counts=tuple((at, at + QUARTER_S, band.days) for at, band in placed),
        days=most,
        counts_label=entry["counts"],
    )


def _list_runs(placed: Sequence[Placed], ends: tuple[int, int]) -> tuple[tuple[MinuteBand, ...], ...]:
    runs = _split(placed, lambda place: place[1].percentiles_deg is not None)
    return tuple(tuple(_lay(at, band, ends) for at, band in run) for run in runs)


def _split(placed: Sequence[Placed], is_kept: Callable[[Placed], bool]) -> list[list[Placed]]:
    """Give the runs of touching quarter hours that are kept."""
    kept = [place for place in placed if is_kept(place)]
    ranked = enumerate(kept)
    return [
        [place for _, place in run]
        for _, run in groupby(ranked, key=lambda item: round(item[1][0] / QUARTER_S) - item[0])
    ]


def _lay(at_s: float, band: ClockBand, ends: tuple[int, int]) -> MinuteBand:
    angles = band.percentiles_deg or {}
    return MinuteBand(at_s, at_s + QUARTER_S, angles[ends[0]], angles[50], angles[ends[1]])


def _mark_unknown(placed: Sequence[Placed], end_s: float, entry: Words) -> tuple[Mark, ...]:
    """Mark the time of the clock in which too few days, or none, were analysed."""
    known = list(_split(placed, lambda place: place[1].percentiles_deg is not None))
    edges = [0.0, *(edge for run in known for edge in (run[0][0], run[-1][0] + QUARTER_S)), end_s]
    gaps = zip(edges[::2], edges[1::2], strict=True)
    return tuple(Mark(a, b, "missing", entry["unknown"]) for a, b in gaps if b > a)


def _tabulate(placed: Sequence[Placed], clock: Clock) -> tuple[tuple[str, ...], ...]:
    return tuple(
        (
            clock.format(at),
            str(band.days),
            *(format_angle((band.percentiles_deg or {}).get(p), clock.language) for p in PERCENTS),
        )
        for at, band in placed
    )


def build_visits(arms: Sequence[ArmDays], words: Words, language: Language) -> tuple[Chart, ...]:
    """Draw every day by its date against the first; nothing where no arm has two days with a date."""
    entry = words["visits"]
    followed = [(arm, trend) for arm in arms if (trend := follow_days(arm))]
    if not followed:
        return ()
    panels = [_lay_visits(arm, trend, language) for arm, trend in followed]
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


def _lay_visits(arm: ArmDays, trend: Trend, language: Language) -> VisitPanel:
    visits = (_lay_visit(day, day.start) for day in arm.days if day.start)
    band = trend.first - trend.detectable, trend.first + trend.detectable
    return VisitPanel(name_arm(arm.side, arm.stage, language), tuple(filter(None, visits)), band)


def _lay_visit(day: MeasuredDay, start: datetime) -> Visit | None:
    percent = day.list_figures()[MAIN]
    if percent is None:
        return None
    at_days = (start - _MIDNIGHT).total_seconds() / _DAY_S
    return Visit(at_days, f"{start:%Y-%m-%d}", percent, _find_span(day), day.left_out is not None)


def _find_span(day: MeasuredDay) -> tuple[float, float] | None:
    interval = day.find_interval(MAIN)
    return (interval.low, interval.high) if interval else None


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
