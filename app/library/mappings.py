"""Column mappings: the columns of a table, named once by a person, for every file with the same header.

A mapping is stored under the identity of the header (:func:`acromion.fusion.readers.identify_header`) and
offered for the next file with that header. Once a person has confirmed it, it is applied without a question.
"""

from dataclasses import dataclass, replace

from sqlalchemy import ColumnElement, Row, delete, exists, insert, select, update

from acromion.app.errors import NotHere
from acromion.app.library.audit_log import record
from acromion.app.library.claims import enqueue_all, replace_job
from acromion.app.library.database.tables import analyses, column_mappings
from acromion.app.library.rows import Job, JobState, RowStore, format_now, read_job, select_jobs
from acromion.app.library.versions import build_item, identify_work, renumber
from acromion.app.request import ReportRequest

UNNAMED = "-"
"""Prefix of a header's identity if no line names the columns: many devices may write such a table."""


@dataclass(frozen=True, slots=True)
class ColumnMapping:
    """The columns of every file with one header.

    ``header`` is its identity; ``profile`` is the JSON of a column profile, as in a request; ``created_at``
    is when a person named the columns. ``is_confirmed``: apply it to further files without a question.
    """

    header: str
    name: str
    profile: str
    created_at: str
    is_confirmed: bool


class MappingStore(RowStore):
    """Column mappings in the database, one per header."""

    def put(self, header: str, name: str, profile: str, *, is_confirmed: bool) -> ColumnMapping:
        """Store the columns of a header, replacing earlier ones; a name given to the mapping stays.

        A mapping without a header line is never confirmed.
        """
        with self._engine.begin() as connection:
            mine = column_mappings.c.header == header
            known = connection.execute(select(column_mappings.c.name).where(mine)).scalar()
            connection.execute(delete(column_mappings).where(mine))
            row = {"header": header, "created_at": format_now(), "name": known or name, "profile": profile}
            confirmed = int(is_confirmed and not header.startswith(UNNAMED))
            connection.execute(insert(column_mappings).values(row | {"is_confirmed": confirmed}))
            record(connection, "columns.named", other={"header": header})
        return self.get(header)

    def get(self, header: str) -> ColumnMapping:
        """Return the mapping of a header. Raises NotHere."""
        found = self.find(header)
        if found is None:
            raise NotHere(id=header)
        return found

    def find(self, header: str) -> ColumnMapping | None:
        """Return the mapping of a header; None if its columns were never named."""
        row = self._read_one(select(column_mappings).where(column_mappings.c.header == header))
        return None if row is None else _read_mapping(row)

    def find_all(self) -> tuple[ColumnMapping, ...]:
        """Return every mapping, newest first."""
        newest = (column_mappings.c.created_at.desc(), column_mappings.c.header)
        return tuple(_read_mapping(row) for row in self._read_all(select(column_mappings).order_by(*newest)))

    def change(self, header: str, **values: str | int) -> ColumnMapping:
        """Change the name of a mapping, or whether it is confirmed. Raises NotHere."""
        if header.startswith(UNNAMED):
            values.pop("is_confirmed", None)
        if values:
            with self._engine.begin() as connection:
                mine = update(column_mappings).where(column_mappings.c.header == header)
                if connection.execute(mine.values(values)).rowcount == 1:
                    record(connection, "columns.changed", other={"header": header})
        return self.get(header)

    def drop(self, header: str) -> None:
        """Delete a mapping; reports made with it stay. Raises NotHere."""
        with self._engine.begin() as connection:
            gone = delete(column_mappings).where(column_mappings.c.header == header)
            if connection.execute(gone).rowcount != 1:
                raise NotHere(id=header)
            record(connection, "columns.dropped", other={"header": header})

    def count_waiting(self, header: str) -> int:
        """Count the recordings with this header that wait for their columns."""
        return len(self._read_all(select_jobs().where(_waits(header))))

    def analyse(self, job: Job, profile: str, waiting_for: str = "") -> Job:
        """Queue the analysis of a recording with these columns; return the new job.

        With a header ``waiting_for``, every analysis that waits for its columns is queued as well, in one
        commit. A failed analysis is replaced, also in its batch.
        """
        with self._engine.begin() as connection:
            wanted = select_jobs().where(_waits(waiting_for)).order_by(analyses.c.created_at, analyses.c.id)
            found = connection.execute(wanted.with_for_update(of=analyses)) if waiting_for else ()
            jobs = [job, *(other for other in map(read_job, found) if other.id != job.id)]
            items = [build_item(connection, one, replace(one.request, profile=profile)) for one in jobs]
            repeated = enqueue_all(connection, items, "web")
            for one, again in zip(jobs, repeated, strict=True):
                if one.state is JobState.FAILED:
                    replace_job(connection, one.id, again)
            row = connection.execute(select_jobs().where(analyses.c.id == repeated[0])).one()
        return read_job(row)

    def adopt(self, analysis_id: str, token: str, header: str) -> ReportRequest | None:
        """Apply the confirmed columns of a header to a running analysis; return None if there are none.

        Its stored request then contains the columns, as if they had been requested.
        """
        mapping = self.find(header)
        if mapping is None or not mapping.is_confirmed:
            return None
        mine = (analyses.c.id == analysis_id, analyses.c.token == token)
        with self._engine.begin() as connection:
            row = connection.execute(select_jobs().where(*mine)).one_or_none()
            if row is None or row.state != JobState.RUNNING:
                return None
            job = read_job(row)
            request = replace(job.request, profile=mapping.profile)
            values = {"request": request.to_json(), "key": identify_work(job.sha256, request)}
            connection.execute(update(analyses).where(*mine).values(values))
            renumber(connection, analysis_id)
            numbered = connection.execute(select(analyses.c.request).where(*mine)).scalar_one()
        return ReportRequest.from_json(numbered)


def _waits(header: str) -> ColumnElement[bool]:
    """Return the condition that an analysis failed because of its columns, and is the last of its kind."""
    later = analyses.alias()
    same = [later.c[name] == analyses.c[name] for name in ("recording_id", "shift")]
    is_last = ~exists().where(*same, later.c.created_at > analyses.c.created_at)
    waits = (analyses.c.state == JobState.FAILED) & (analyses.c.awaits == header)
    return waits & analyses.c.replaced_by.is_(None) & is_last


def _read_mapping(row: Row[tuple[str, str, str, str, int]]) -> ColumnMapping:
    return ColumnMapping(row.header, row.name, row.profile, row.created_at, bool(row.is_confirmed))
