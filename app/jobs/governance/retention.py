"""Retention: how long each kind of data is kept. Without a row a kind is kept for good.

Ages are counted in the running time of the server, never by the clock: a clock that is put forward deletes
nothing. What is on hold is not deleted.
"""

from collections.abc import Mapping
from typing import Literal, get_args

from sqlalchemy import ColumnElement, delete, func, insert, select, update

from app.errors import BadParameter
from app.jobs.audit_log import record
from app.jobs.database.tables import (
    analyses,
    answers,
    audit_log,
    recordings,
    result_files,
    retention,
    running_time,
)
from app.jobs.job import TRANSITIONS, JobState
from app.jobs.queries import STORED, RowStore, select_running_s
from app.jobs.recordings import drop_empty_batches
from app.jobs.side_files import increment_revision

Kind = Literal["recordings", "results", "trash", "trail"]
KINDS: tuple[Kind, ...] = get_args(Kind)
DAY_S = 24 * 3600.0
LONGEST_DAYS = 36_500
MOST_AT_ONCE = 50


class RetentionStore(RowStore):
    """Rows of terms, and what has reached its term."""

    def find_all(self) -> Mapping[Kind, int | None]:
        """Give the days of each kind; None where it is kept for good."""
        rows = {row.kind: int(row.days) for row in self._read_all(select(retention))}
        return {kind: rows.get(kind) for kind in KINDS}

    def put(self, kind: str, days: int | None) -> None:
        """Change the term of a kind; None keeps it for good. Raises BadParameter."""
        if kind not in KINDS:
            raise BadParameter(name="kind", value=kind[:20], allowed=", ".join(KINDS))
        if days is not None and not 1 <= days <= LONGEST_DAYS:
            raise BadParameter(name="days", value=str(days)[:20], allowed=f"1 … {LONGEST_DAYS}")
        with self._engine.begin() as connection:
            connection.execute(delete(retention).where(retention.c.kind == kind))
            if days is not None:
                connection.execute(insert(retention).values(kind=kind, days=days))
            record(connection, "retention.changed", other={"kind": kind, "days": days or "for_good"})

    def add_running_time(self, elapsed_s: float) -> None:
        """Count running time."""
        with self._engine.begin() as connection:
            longer = {"running_s": running_time.c.running_s + elapsed_s}
            if connection.execute(update(running_time).values(longer)).rowcount == 0:
                connection.execute(insert(running_time).values(id=1, running_s=elapsed_s))

    def find_due_recordings(self) -> tuple[str, ...]:
        """Give recordings whose term has passed, a few at a time; none on hold."""
        days = self.find_all()["recordings"]
        if days is None:
            return ()
        is_old = select_running_s() - recordings.c.since_s >= days * DAY_S
        query = select(recordings.c.id).where(
            recordings.c.state == STORED, recordings.c.hold.is_(None), is_old
        )
        return tuple(row.id for row in self._read_all(query.limit(MOST_AT_ONCE)))

    def find_due_results(self) -> tuple[str, ...]:
        """Give analyses whose term has passed since they ended, a few at a time; none of a held recording."""
        days = self.find_all()["results"]
        if days is None:
            return ()
        is_old = select_running_s() - func.coalesce(analyses.c.ended_s, 0.0) >= days * DAY_S
        query = (
            select(analyses.c.id)
            .join(recordings, analyses.c.recording_id == recordings.c.id)
            .where(recordings.c.hold.is_(None), recordings.c.state == STORED, is_old, _is_over())
        )
        return tuple(row.id for row in self._read_all(query.limit(MOST_AT_ONCE)))

    def find_trash_term_s(self, otherwise_s: float) -> float:
        """Return how long the trash is kept; ``otherwise_s`` where no term is set."""
        days = self.find_all()["trash"]
        return otherwise_s if days is None else days * DAY_S

    def drop_analysis(self, analysis_id: str) -> bool:
        """Delete the rows of an analysis that is over; False where its recording is on hold by now.

        Its files are to be removed after that: what no row names, a start puts into quarantine.
        """
        mine = analyses.c.id == analysis_id
        held = (
            select(recordings.c.id, recordings.c.hold)
            .join(analyses, analyses.c.recording_id == recordings.c.id)
            .where(mine, _is_over())
        )
        with self._engine.begin() as connection:
            row = connection.execute(held.with_for_update(of=recordings)).one_or_none()
            if row is None or row.hold is not None:
                return False
            connection.execute(delete(result_files).where(result_files.c.analysis_id == analysis_id))
            connection.execute(delete(answers).where(answers.c.analysis_id == analysis_id))
            connection.execute(delete(analyses).where(mine))
            drop_empty_batches(connection)
            increment_revision(connection, row.id)
            record(connection, "analysis.purged", row.id, analysis_id)
        return True

    def shorten_audit_log(self) -> int:
        """Delete the lines of the audit log whose term has passed; return how many. A new line says so."""
        days = self.find_all()["trail"]
        if days is None:
            return 0
        is_old = audit_log.c.since_s <= select_running_s() - days * DAY_S
        with self._engine.begin() as connection:
            gone = connection.execute(delete(audit_log).where(is_old)).rowcount
            if gone:
                record(connection, "trail.shortened", other={"lines": gone})
        return int(gone)


def _is_over() -> ColumnElement[bool]:
    return analyses.c.state.in_([state for state in JobState if not TRANSITIONS[state]])
