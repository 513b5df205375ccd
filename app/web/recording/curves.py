"""Curves of several recordings above one another, moved together: both arms, two visits."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from app.errors import NoSuchFile
from app.jobs.job import Job
from app.report.export.results import decode_results
from app.services import Services
from app.web.recording.day import find_day
from app.web.recording.day_views import DayClock
from app.web.recording.page_one import Minutes, list_minutes


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


def build_curves(services: Services, laid: Sequence[Laid], base: str) -> tuple[CurveView, ...]:
    """Build a curve for each analysis; none if one of them has no curve."""
    try:
        clocks = [DayClock.of(find_day(services, job).facts) for job, _, _ in laid]
    except NoSuchFile:
        return ()
    starts_s = [
        _find_time_of_day_s(clock.start) if start_s is None else start_s
        for clock, (_, _, start_s) in zip(clocks, laid, strict=True)
    ]
    return tuple(
        CurveView(
            name,
            f"{base}/analyses/{job.id}/curve",
            clock,
            start_s - min(starts_s),
            _read_minutes(services, job),
        )
        for (job, name, _), clock, start_s in zip(laid, clocks, starts_s, strict=True)
    )


def _find_time_of_day_s(start: datetime | None) -> float:
    """Give the seconds since midnight; 0 without a clock."""
    return (
        (start - start.replace(hour=0, minute=0, second=0, microsecond=0)).total_seconds() if start else 0.0
    )


def _read_minutes(services: Services, job: Job) -> Minutes:
    """Read the minutes of the report's day; none if its results cannot be read."""
    try:
        return list_minutes(decode_results(services.results.read(job, "results.json")).findings, "en")
    except (NoSuchFile, ValueError):
        return ()
