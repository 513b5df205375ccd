"""Curves of several recordings above one another, moved together: both arms, two visits."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, time

from app.errors import NoSuchFile
from app.jobs.job import Job
from app.report.export.results import decode_results
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
        with suppress(NoSuchFile, ValueError):  # results that cannot be read
            results = decode_results(page.services.results.read(job, "results.json"))
            minutes = list_minutes(results.findings, "en")
        address = f"{page.base}/analyses/{job.id}/curve"
        curves.append(CurveView(name, address, clock, start_s - min(starts_s), minutes))
    return tuple(curves)
