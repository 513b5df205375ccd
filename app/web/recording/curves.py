"""Curves of several recordings above one another, moved together: both arms, two visits."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, time

from app.errors import NoSuchFile
from app.jobs.job import Job
from app.report.export.results import decode_results
from app.services import Services
from app.web.recording.day import DayClock, find_day
from app.web.recording.page_one import Minutes, list_minutes
from app.web.rendering import Page


@dataclass(frozen=True, slots=True)
class CurveView:
    """One curve: its name, where its samples are, and by how many seconds it begins after the first.

    ``beside``: where the samples of another curve in the same drawing are; empty for none.
    """

    name: str
    address: str
    clock: DayClock
    shift_s: float
    minutes: Minutes = ()
    beside: str = ""


Laid = tuple[Job, str, float | None]
"""An analysis, its name, and when it began, s; None: by its clock's time of the day."""


def build_curves(page: Page, laid: Sequence[Laid]) -> tuple[CurveView, ...]:
    """Build a curve for each analysis; none if one of them has no curve."""
    try:
        clocks = [DayClock.of(find_day(page.services, job).facts) for job, _, _ in laid]
    except NoSuchFile:
        return ()
    starts_s = [
        _find_time_of_day_s(clock.start) if start_s is None else start_s
        for clock, (_, _, start_s) in zip(clocks, laid, strict=True)
    ]
    return tuple(
        CurveView(
            name,
            f"{page.base}/analyses/{job.id}/curve",
            clock,
            start_s - min(starts_s),
            _read_minutes(page.services, job),
        )
        for (job, name, _), clock, start_s in zip(laid, clocks, starts_s, strict=True)
    )


def _find_time_of_day_s(start: datetime | None) -> float:
    """Return the seconds since midnight; 0 without a clock."""
    return (start - datetime.combine(start, time(), start.tzinfo)).total_seconds() if start else 0.0


def _read_minutes(services: Services, job: Job) -> Minutes:
    """Read the minutes of the report's day; none if its results cannot be read."""
    try:
        return list_minutes(decode_results(services.results.read(job, "results.json")).findings, "en")
    except (NoSuchFile, ValueError):
        return ()
