"""The report on its recording's page, highlights on the curve, and curves of several recordings."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, time

from acromion.app.errors import NoSuchFile
from acromion.app.http.pages.recording.day import DayClock, load_day
from acromion.app.http.pages.rendering import Page
from acromion.app.library.rows import Job
from acromion.app.report.charts.day import WORST_WINDOW_S, build_timeline
from acromion.app.report.export.results import decode_results
from acromion.app.report.findings import Findings
from acromion.app.report.model import Report
from acromion.app.report.single.report import build_report
from acromion.app.report.words.numbers import Clock, format_angle, format_duration, format_percent
from acromion.app.report.words.wording import Language, fill, load_wording
from acromion.app.services import Services
from acromion.app.store.day_file import DayFile
from acromion.fusion.conventions import MAIN_THRESHOLD_DEG

MAX_EPISODES = 10
MIN_EPISODE_S = 0.5
"""Shorter stays do not count, and shorter gaps end no episode: :mod:`acromion.fusion.exposure.stays`."""
AROUND_S = 5.0
"""Time shown before and after an episode."""


Minutes = tuple[tuple[tuple[float, ...], ...], ...]
"""Uninterrupted runs of minutes: start and end, s; P10, median and P90, deg."""


@dataclass(frozen=True, slots=True)
class Highlight:
    """A highlighted time range: its description, its mark on the curve, and the visible part of the curve."""

    words: str
    mark: str
    at: str
    start: str
    end: str


@dataclass(frozen=True, slots=True)
class PageOne:
    """The report, and highlights: two time ranges, then the highest episodes.

    ``minutes`` are the minutes of the day as in the report; the curve shows them.
    """

    report: Report
    looks: Sequence[Highlight] = ()
    highest: Sequence[Highlight] = ()
    minutes: Minutes = ()


def read_page_one(services: Services, job: Job, day: DayFile | None, language: Language) -> PageOne | None:
    """Build the report of a finished analysis; None if its results cannot be read. Raises ResultDamaged.

    Without a day there are no highlights.
    """
    try:
        kept = decode_results(services.results.read(job, "results.json"))
    except (NoSuchFile, ValueError):
        return None
    report = build_report(kept.findings, replace(kept.subject, reason=job.request.reason), language)
    if day is None:
        return PageOne(report)
    if report.profile is None:  # of the trunk: nothing about an arm is worth a look
        return PageOne(report, minutes=list_minutes(kept.findings, language))
    looks, highest = _list_highlights(kept.findings, day, language)
    return PageOne(report, looks, highest, list_minutes(kept.findings, language))


def list_minutes(findings: Findings, language: Language) -> Minutes:
    """List the minutes of the day as the report shows them."""
    clock = Clock(findings.recording.start, language, findings.recording.duration_s)
    runs = build_timeline(findings, clock, load_wording(language)).runs
    return tuple(
        tuple(
            (b.start_s, b.end_s, *(round(angle, 2) for angle in (b.low_deg, b.middle_deg, b.high_deg)))
            for b in run
        )
        for run in runs
    )


def _list_highlights(
    findings: Findings, day: DayFile, language: Language
) -> tuple[list[Highlight], list[Highlight]]:
    """Return the 15 minutes with most time above 60 deg and the longest stay, then the highest episodes."""
    clock = DayClock.of(day.facts)
    report_clock = Clock(findings.recording.start, language, clock.duration_s)
    words = load_wording(language, "page")["page_one"]

    def build_highlight(
        sentence: str, start_s: float, end_s: float, around_s: float, mark: str = ""
    ) -> Highlight:
        shown = max(start_s - around_s, 0.0), min(end_s + around_s, clock.duration_s)
        return Highlight(sentence, mark, clock.format((start_s + end_s) / 2), *map(clock.format, shown))

    looks = []
    window = next((w for w in findings.exposure.peak_windows if w.length_s == WORST_WINDOW_S), None)
    if window is not None and window.start_s is not None and window.percent_above_60:
        start_s, end_s = window.start_s, window.start_s + window.length_s
        share = format_percent(window.percent_above_60, language)
        facts = {**report_clock.format_span(start_s, end_s), "percent": share}
        flag = fill(words["window_flag"], facts)
        looks.append(build_highlight(fill(words["window"], facts), start_s, end_s, 60.0, flag))
    stays = next((e for e in findings.exposure.episodes if e.threshold_deg == MAIN_THRESHOLD_DEG), None)
    if stays is not None and stays.longest_s and stays.longest_start_s is not None:
        start_s, end_s = stays.longest_start_s, stays.longest_start_s + stays.longest_s
        facts = {"time": report_clock.format(start_s), "duration": format_duration(stays.longest_s, language)}
        flag = fill(words["longest_flag"], facts)
        looks.append(build_highlight(fill(words["longest"], facts), start_s, end_s, 2 * AROUND_S, flag))
    highest = []
    for number, episode in enumerate(
        day.find_highest(float(MAIN_THRESHOLD_DEG), MIN_EPISODE_S, MAX_EPISODES), 1
    ):
        facts = {
            "time": report_clock.format(episode.start_s),
            "angle": format_angle(episode.highest_deg, language),
            "duration": format_duration(episode.end_s - episode.start_s, language),
        }
        sentence = fill(words["episode"], facts)
        highest.append(build_highlight(sentence, episode.start_s, episode.end_s, AROUND_S, str(number)))
    return looks, highest


# Curves of several recordings in one view that pan and zoom together: both arms, two visits.


@dataclass(frozen=True, slots=True)
class CurveView:
    """One curve: its name, the address of its samples, and its start in seconds after the earliest curve.

    ``beside``: the address of another curve in the same drawing; "" for none.
    """

    name: str
    address: str
    clock: DayClock
    shift_s: float
    minutes: Minutes = ()
    beside: str = ""


PlacedCurve = tuple[Job, str, float | None]
"""An analysis, its name, and its start, s; if the start is None, the time of day on its clock is used."""


def build_curves(page: Page, laid: Sequence[PlacedCurve]) -> tuple[CurveView, ...]:
    """Build a curve for each analysis; none if one of them has no curve."""
    try:
        clocks = [DayClock.of(load_day(page.services, job).facts) for job, _, _ in laid]
    except NoSuchFile:
        return ()
    starts_s = []
    for clock, (_, _, begins_s) in zip(clocks, laid, strict=True):
        start_s = begins_s or 0.0
        if begins_s is None and clock.start is not None:
            midnight = datetime.combine(clock.start, time(), clock.start.tzinfo)
            start_s = (clock.start - midnight).total_seconds()
        starts_s.append(start_s)
    curves = []
    for (job, name, _), clock, start_s in zip(laid, clocks, starts_s, strict=True):
        minutes: Minutes = ()
        with suppress(NoSuchFile, ValueError):  # unreadable results
            results = decode_results(page.services.results.read(job, "results.json"))
            minutes = list_minutes(results.findings, "en")
        address = f"{page.base}/analyses/{job.id}/curve"
        curves.append(CurveView(name, address, clock, start_s - min(starts_s), minutes))
    return tuple(curves)
