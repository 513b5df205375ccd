"""The versions of a recording's report, what each changed, and the attempt after them that failed."""

from dataclasses import dataclass

from app.api.services import Services
from app.jobs.job import Job, JobState
from app.jobs.store import JobFilter
from app.report.wording import Language, fill, load_wording
from app.web.views import JobRow, now_utc, show_row, tell_time

SHOWN = 200


@dataclass(frozen=True, slots=True)
class VersionRow:
    """One version; ``changed`` says what is different from the one before, ``reason`` what a person said."""

    id: str
    name: str
    when: str
    changed: str
    reason: str
    is_this: bool


@dataclass(frozen=True, slots=True)
class History:
    """Every analysis of one recording, the newest first."""

    jobs: tuple[Job, ...]

    @classmethod
    def of(cls, services: Services, job: Job) -> "History":
        """Read it; comparisons with a reference are no reports."""
        found = services.store.list_page(JobFilter(recording_id=job.recording_id), SHOWN)
        return cls(tuple(other for other in found if other.request.reference is None))

    @property
    def reports(self) -> tuple[Job, ...]:
        """Those that have a report, but for damaged ones that were analysed again."""
        return tuple(job for job in self.jobs if job.state is JobState.SUCCEEDED and job.replaced_by is None)

    def find_before(self, job: Job) -> Job | None:
        """Give the version before the one that an analysis is or would be."""
        earlier = [other for other in self.reports if other.request.version < job.request.version]
        return max(earlier, key=lambda other: (other.request.version, other.created_at), default=None)

    def find_failed(self) -> Job | None:
        """Give the newest analysis that counts if it failed, and with it what the person wanted."""
        newest = next((job for job in self.jobs if job.replaced_by is None), None)
        return newest if newest is not None and newest.state is JobState.FAILED else None

    def find_report(self) -> Job | None:
        """Give the newest report."""
        return self.reports[0] if self.reports else None


def list_versions(history: History, shown: Job, language: Language) -> tuple[VersionRow, ...]:
    """List what can be opened, the newest first; nothing where there is but the one that is shown.

    A version that was computed more than once is there once: the one that is shown, or else the newest.
    """
    first = (shown, *history.reports) if shown.state is JobState.SUCCEEDED else history.reports
    found: dict[int, Job] = {}
    for job in first:
        found.setdefault(job.request.version, job)
    rows = tuple(_show_version(found[number], shown, language) for number in sorted(found, reverse=True))
    return () if all(row.is_this for row in rows) else rows


def show_failed(history: History, shown: Job, language: Language) -> JobRow | None:
    """Show the attempt that failed after an analysis that has a report."""
    failed = history.find_failed()
    if failed is None or failed.created_at <= shown.created_at:
        return None
    return show_row(failed, language, now_utc())


def tell_version(number: int, language: Language) -> str:
    """Write "version 2"."""
    return fill(load_wording(language, "page")["row"]["version"], {"n": str(number)})


def tell_changes(job: Job, language: Language) -> str:
    """Name what is different from the version before, as the report's first page does."""
    names = load_wording(language)["changed"]
    return ", ".join(str(names.get(name, name)) for name in job.request.changes)


def _show_version(job: Job, shown: Job, language: Language) -> VersionRow:
    name, changed = tell_version(job.request.version, language), tell_changes(job, language)
    return VersionRow(
        job.id, name, tell_time(job.created_at), changed, job.request.reason, job.id == shown.id
    )
