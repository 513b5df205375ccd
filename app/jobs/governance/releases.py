"""Releases: a report released under somebody's name. It is one report: a later version is not released by it.

A release is a row of its own, and is taken back by a further row: the bytes of the report stay as they are.
"""

import secrets
from dataclasses import dataclass, fields

from sqlalchemy import insert, select

from app.errors import NoSuchFile
from app.jobs.audit_log import Act, record
from app.jobs.database.tables import analyses, answers, releases, result_files
from app.jobs.job import Job, JobState
from app.jobs.queries import RowStore, format_now
from app.jobs.side_files import increment_revision

REPORT = "report.pdf"


@dataclass(frozen=True, slots=True)
class Release:
    """Who released a report, and when. ``report_id`` is the SHA-256 of its results."""

    analysis_id: str
    who: str
    at: str
    method_version: str
    report_id: str
    is_taken_back: bool


_COLUMNS = tuple(field.name for field in fields(Release))


class ReleaseStore(RowStore):
    """Rows of releases."""

    def find(self, analysis_id: str) -> Release | None:
        """Give the release of an analysis; None where it was never released, or that was taken back."""
        query = select(releases).where(releases.c.analysis_id == analysis_id)
        rows = self._read_all(query.order_by(releases.c.at.desc(), releases.c.id.desc()).limit(1))
        if not rows or rows[0].is_taken_back:
            return None
        columns = rows[0]._asdict()
        return Release(**{name: columns[name] for name in _COLUMNS} | {"is_taken_back": False})

    def release(self, job: Job, who: str) -> Release | None:
        """Release the report of an analysis; one that is released already stays so.

        Raises NoSuchFile: there is no report, or another has replaced it.
        """
        known = self.find(job.id)
        return known if known is not None else self._add(job, who, "report.released")

    def take_back(self, job: Job, who: str) -> Release | None:
        """Take a release back; a report that is not released stays as it is."""
        return None if self.find(job.id) is None else self._add(job, who, "report.taken_back")

    def _add(self, job: Job, who: str, act: Act) -> Release | None:
        if job.state is not JobState.SUCCEEDED or job.replaced_by is not None:
            raise NoSuchFile(name=REPORT)
        row = {"id": f"rel_{secrets.token_hex(8)}", "analysis_id": job.id, "who": who, "at": format_now()}
        version = select(answers.c.method_version).where(answers.c.analysis_id == job.id)
        results = select(result_files.c.sha256).where(
            result_files.c.analysis_id == job.id, result_files.c.name == "results.json"
        )
        with self._engine.begin() as connection:
            connection.execute(select(analyses.c.id).where(analyses.c.id == job.id).with_for_update())
            row |= {"method_version": str(connection.execute(version).scalar() or "")}
            row |= {"report_id": str(connection.execute(results).scalar() or "")}
            taken = {"is_taken_back": int(act == "report.taken_back")}
            connection.execute(insert(releases).values(row | taken))
            increment_revision(connection, job.recording_id)
            record(connection, act, job.recording_id, job.id)
        return self.find(job.id)
