"""Measured people: the list of their codes, and a page for each with its days, both arms and their trend."""

import calendar
import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime
from typing import TYPE_CHECKING, Any, get_args
from urllib.parse import urlencode

from fastapi import APIRouter, Response
from markupsafe import Markup

from acromion.app.errors import NotHere
from acromion.app.http.pages.pairs import build_pair_address
from acromion.app.http.pages.rendering import Page, UsedPage
from acromion.app.library.listing import Entry, Library, find_other_arm
from acromion.app.report.model import Chart
from acromion.app.report.words.numbers import format_percent, format_range
from acromion.app.report.words.wording import Language
from acromion.fusion.conventions import Side

if TYPE_CHECKING:
    from acromion.app.report.several.charts import Visit, VisitPanel

PER_PAGE = 50
MAX_TEXT = 100
ARMS: tuple[Side | None, ...] = (*get_args(Side), None)

router = APIRouter(include_in_schema=False)


@dataclass(frozen=True, slots=True)
class Measured:
    """A recording on a day: its arm, share above 60 deg with its range, and the page of both arms.

    ``pair``: the address of the page of both arms, "" if the other arm was not recorded at the same time.
    """

    id: str
    side: str
    above: str
    span: str
    is_short: bool
    verdict: str
    pair: str = ""


@dataclass(frozen=True, slots=True)
class DayRow:
    """A day with its recordings, the left arm first; ``day`` is None without a clock."""

    day: date | None
    measured: tuple[Measured, ...]

    @property
    def pairs(self) -> tuple[str, ...]:
        """The pages of both arms, each once."""
        return tuple(dict.fromkeys(filter(None, (one.pair for one in self.measured))))


@dataclass(frozen=True, slots=True)
class Person:
    """A line of the list: the number of recordings and days, the last day, and each arm on its last day."""

    subject: str
    query: str
    count: int
    days: int
    last: str
    arms: Mapping[str, str]


@router.get("/persons")
def list_people(page: UsedPage, text: str = "", number: int = 1) -> Response:
    """List the people with a subject code, each with the last day of each arm."""
    library, wanted = Library(page.services.store.reader), text.strip()[:MAX_TEXT]
    count = library.count_people(wanted)
    pages = max(1, -(-count // PER_PAGE))
    number = min(max(number, 1), pages)
    rows = library.find_people(wanted, PER_PAGE, (number - 1) * PER_PAGE)
    entries = library.find_of_people([row.subject for row in rows])
    people = [
        _summarise(row.subject, row.count, [e for e in entries if e.subject == row.subject], page.language)
        for row in rows
    ]
    links = {
        name: urlencode({"text": wanted, "number": number + step})
        for name, step, is_there in (("earlier", -1, number > 1), ("later", 1, number < pages))
        if is_there
    }
    shown: dict[str, Any] = {"people": people, "text": wanted, "number": number, "pages": pages}
    return page.render("library/persons.html", **shown, ways=links)


def _summarise(subject: str, count: int, entries: Sequence[Entry], language: Language) -> Person:
    """Summarise the reports of a person, newest first; a whole day counts before a short recording."""
    dates = sorted({entry.start.date() for entry in entries if entry.start})
    arms = {}
    for side in ("left", "right"):
        mine = [entry.headline for entry in entries if entry.job.request.side == side and entry.headline]
        newest = max(mine, key=lambda headline: (not headline.is_short, headline.start or ""), default=None)
        arms[side] = format_percent(newest.above_60_percent, language) if newest else ""
    query = urlencode({"subject": subject})
    return Person(subject, query, count, len(dates), f"{dates[-1]}" if dates else "", arms)


@router.get("/person")
def show_person(page: UsedPage, subject: str) -> Response:
    """Show one person: the trend of both arms, a calendar of the days, and each day with its pair.

    Raises NotHere for a code without recordings.
    """
    library = Library(page.services.store.reader)
    count = library.count_of_person(subject)
    if not count:
        raise NotHere(id=subject[:MAX_TEXT])
    entries = library.find_of_people([subject])
    days = _list_days(entries, page.language)
    chart = _draw_trend(page, entries)
    if chart:
        chart = replace(chart, wide=Markup(chart.wide), narrow=Markup(chart.narrow))  # noqa: S704  our own SVG
    return page.render(
        "library/person.html",
        person=_summarise(subject, count, entries, page.language),
        first=f"{min((row.day for row in days if row.day), default='')}",
        days=days,
        months=_lay_on_months([row for row in days if row.day], page.words("report")["months"]),
        chart=chart,
    )


def _list_days(entries: Sequence[Entry], language: Language) -> list[DayRow]:
    """Return the days of a person, the newest first; recordings without a clock come last."""
    by_day: dict[date | None, list[Entry]] = {}
    for entry in entries:
        by_day.setdefault(entry.start.date() if entry.start else None, []).append(entry)
    rows = []
    for day, found in by_day.items():
        found.sort(key=lambda entry: (ARMS.index(entry.job.request.side), entry.start or datetime.min))  # noqa: DTZ901
        measured = tuple(_describe(entry, find_other_arm(entry, entries), language) for entry in found)
        rows.append(DayRow(day, measured))
    return sorted(rows, key=lambda row: row.day or date.min, reverse=True)


def _describe(entry: Entry, other: Entry | None, language: Language) -> Measured:
    headline = entry.headline
    assert headline is not None  # people are listed by their reports
    pair = build_pair_address(entry.job, other.job) if other else ""
    share = headline.above_60_percent  # none for the trunk
    above = "" if share is None else format_percent(share, language)
    span, side = format_range(headline.interval, language), entry.job.request.side or "unknown"
    return Measured(entry.job.id, side, above, span, headline.is_short, headline.verdict, pair)


def _lay_on_months(rows: Sequence[DayRow], names: Sequence[str]) -> list[dict[str, Any]]:
    """Return the months with recordings, the newest first: a name, and weeks from Monday of day and row."""
    known = {row.day: row for row in rows}
    months = sorted({(row.day.year, row.day.month) for row in rows if row.day}, reverse=True)
    return [
        {
            "name": f"{names[month - 1]} {year}",
            "weeks": [
                [(day.day if day.month == month else None, known.get(day)) for day in week]
                for week in calendar.Calendar().monthdatescalendar(year, month)
                if any(day in known and day.month == month for day in week)
            ],
        }
        for year, month in months
    ]


def _draw_trend(page: Page, entries: Sequence[Entry]) -> Chart | None:
    """Draw the arms one above the other; None without a dated report.

    Short recordings are drawn, but do not count in the trend. SciPy is loaded with the first trend.
    """
    charts = importlib.import_module("acromion.app.report.several.charts")
    change, days = map(
        importlib.import_module, ("acromion.fusion.comparison.change", "acromion.fusion.comparison.days")
    )
    between_sd = change.BETWEEN_DAY_SD[charts.MAIN]
    panels: list[VisitPanel] = []
    for side in ARMS:
        visits: list[Visit] = []
        for entry in entries:
            headline = entry.headline
            if headline is None or headline.above_60_percent is None or entry.start is None:
                continue
            if entry.job.request.side == side:
                span = (headline.interval.low, headline.interval.high) if headline.interval else None
                visits.append(charts.Visit(entry.start, headline.above_60_percent, span, headline.is_short))
        visits.sort(key=lambda visit: visit.start)
        counted = [visit.percent for visit in visits if not visit.is_left_out]
        if visits and (side or not panels):  # a trunk is not shown below the arms
            name = page.words()["persons"][side or "no_arm"]
            panels.append(charts.VisitPanel(name, visits, days.find_trend(counted, between_sd)))
    chart: Chart | None = charts.draw_visits(panels, page.words("days"), page.language) if panels else None
    return chart
