"""Page 1 of the report on the page of its recording, and the moments to look at on the curve."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from app.errors import NoSuchFile
from app.jobs.job import Job
from app.report.analysis.report import build_report
from app.report.charts.day import WORST_WINDOW_S, build_timeline
from app.report.export.results import decode_results
from app.report.findings import Findings, Kept
from app.report.model import Report
from app.report.words.numbers import Clock, format_angle, format_duration, format_percent
from app.report.words.wording import Language, Words, fill, load_wording
from app.services import Services
from app.storage.day_file import DayFile
from app.web.recording.day_views import DayClock
from fusion.conventions import MAIN_THRESHOLD_DEG

HIGHEST = 10
LEAST_S = 0.5
"""As of every episode (fusion.exposure.episodes): shorter ones are none, shorter gaps do not end one."""
AROUND_S = 5.0
"""Shown before and after an episode."""


Minutes = tuple[tuple[tuple[float, ...], ...], ...]
"""Unbroken runs of minutes: start and end, s; P10, median and P90, deg."""


@dataclass(frozen=True, slots=True)
class Look:
    """A stretch to look at: what it is, its mark on the curve, and from when to when the curve shows it."""

    words: str
    mark: str
    at: str
    start: str
    end: str


@dataclass(frozen=True, slots=True)
class PageOne:
    """Page 1 of the report, and where to look: two stretches, then the highest episodes.

    ``minutes`` are those of the report's day, for the curve.
    """

    report: Report
    looks: tuple[Look, ...]
    highest: tuple[Look, ...]
    minutes: Minutes = ()


def read_page_one(services: Services, job: Job, day: DayFile | None, language: Language) -> PageOne | None:
    """Build page 1 of a finished analysis; None if its results cannot be read.

    Raises
    ------
    ResultDamaged
    """
    try:
        kept = decode_results(services.results.read(job, "results.json"))
    except (NoSuchFile, ValueError):
        return None
    subject = replace(kept.subject, reason=job.request.reason)
    return build_page_one(replace(kept, subject=subject), day, language)


def build_page_one(kept: Kept, day: DayFile | None, language: Language) -> PageOne:
    """Build page 1 from findings; without a day there is nothing to look at."""
    report = build_report(kept.findings, kept.subject, language)
    if day is None:
        return PageOne(report, (), ())
    clock = Clock(kept.findings.recording.start, language)
    place = _Place(DayClock.of(day.facts), clock, language)
    looks, highest = tuple(_list_looks(kept.findings, place)), tuple(_list_highest(day, place))
    return PageOne(report, looks, highest, list_minutes(kept.findings, language))


def list_minutes(findings: Findings, language: Language) -> Minutes:
    """List the minutes of the report's day."""
    clock = Clock(findings.recording.start, language)
    runs = build_timeline(findings, clock, load_wording(clock.language)).runs
    return tuple(
        tuple(
            (b.start_s, b.end_s, *(round(angle, 2) for angle in (b.low_deg, b.middle_deg, b.high_deg)))
            for b in run
        )
        for run in runs
    )


@dataclass(frozen=True, slots=True)
class _Place:
    """Writes stretches: ``clock`` as the form reads moments, ``told`` as people do."""

    clock: DayClock
    told: Clock
    language: Language

    @property
    def words(self) -> Words:
        words: Words = load_wording(self.language, "page")["page_one"]
        return words

    def look(self, words: str, mark: str, span_s: tuple[float, float], around_s: float) -> Look:
        start_s, end_s = span_s
        shown = max(start_s - around_s, 0.0), min(end_s + around_s, self.clock.duration_s)
        return Look(words, mark, self.clock.format((start_s + end_s) / 2), *map(self.clock.format, shown))


def _list_looks(findings: Findings, place: _Place) -> Iterator[Look]:
    """Give the 15 minutes with the most time above 60 deg and the longest continuous time above it."""
    window = next((w for w in findings.exposure.peak_windows if w.length_s == WORST_WINDOW_S), None)
    if window is not None and window.start_s is not None and window.percent_above_60:
        span_s = window.start_s, window.start_s + window.length_s
        told = {
            "start": place.told.format(span_s[0]),
            "end": place.told.format(span_s[1]),
            "percent": format_percent(window.percent_above_60, place.language),
        }
        yield place.look(fill(place.words["window"], told), "", span_s, 60.0)
    stays = next((e for e in findings.exposure.episodes if e.threshold_deg == MAIN_THRESHOLD_DEG), None)
    if stays is not None and stays.longest_s and stays.longest_start_s is not None:
        span_s = stays.longest_start_s, stays.longest_start_s + stays.longest_s
        told = {
            "time": place.told.format(span_s[0]),
            "duration": format_duration(stays.longest_s, place.language),
        }
        yield place.look(fill(place.words["longest"], told), "", span_s, 2 * AROUND_S)


def _list_highest(day: DayFile, place: _Place) -> Iterator[Look]:
    highest = day.find_highest(float(MAIN_THRESHOLD_DEG), LEAST_S, HIGHEST)
    for number, episode in enumerate(highest, 1):
        told = {
            "time": place.told.format(episode.start_s),
            "angle": format_angle(episode.highest_deg, place.language),
            "duration": format_duration(episode.end_s - episode.start_s, place.language),
        }
        span_s = episode.start_s, episode.end_s
        yield place.look(fill(place.words["episode"], told), str(number), span_s, AROUND_S)
