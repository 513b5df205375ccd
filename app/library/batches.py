"""Batches: many analyses under one name.

A batch that a script requests keeps the analyses that it requested. A study is a batch identified by its
name; it contains the latest analysis of each of its recordings. It grows with each recording added under its
name, and follows corrections of its recordings.
"""

import hashlib
import json
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, Select, and_, delete, func, insert, select, update
from sqlalchemy.dialects import postgresql, sqlite

from acromion.app.errors import NotHere
from acromion.app.library.audit_log import record
from acromion.app.library.claims import enqueue_all, replace_job
from acromion.app.library.database.connect import lock_tables
from acromion.app.library.database.tables import analyses, batch_items, batches
from acromion.app.library.rows import (
    Job,
    JobState,
    Place,
    RowStore,
    format_now,
    read_job,
    select_items,
    select_jobs,
    select_page,
)
from acromion.app.library.side_files import increment_revision_of
from acromion.app.library.versions import KEYS_PER_QUERY, build_item, identify_work, select_same
from acromion.app.library.webhooks import announce_batch
from acromion.app.request import ReportRequest

if TYPE_CHECKING:  # it imports this module
    from acromion.app.library.recordings import StoredRow


@dataclass(frozen=True, slots=True)
class Batch:
    """A batch and the number of its analyses in each state; a repeated analysis counts once.

    ``duplicate_count``: requested analyses that already existed and were reused.
    """

    id: str
    name: str
    duplicate_count: int
    created_at: str
    counts: Mapping[JobState, int]

    @property
    def item_count(self) -> int:
        """Current number of analyses."""
        return sum(self.counts.values())

    @property
    def is_over(self) -> bool:
        """Whether every analysis has ended; failed ones may still be retried."""
        return not self.counts[JobState.QUEUED] and not self.counts[JobState.RUNNING]


class BatchStore(RowStore):
    """Rows of batches; their analyses are ordinary jobs."""

    def add(
        self, name: str, items: Sequence[tuple["StoredRow", ReportRequest]], *, again: bool = False
    ) -> Batch:
        """Queue an analysis for each item, in one commit.

        The same bytes with the same settings are analysed once: a repeated item counts once, and an earlier
        analysis of the same bytes and settings by this engine is reused. A complete batch of the same name,
        items, settings and order is returned as it is. With ``again`` everything is analysed again.
        """
        batch_id = f"ba_{secrets.token_hex(8)}"
        parts = [name, *([recording.id, identify_work(recording.sha256, wish)] for recording, wish in items)]
        key = None if again else hashlib.sha256(json.dumps(parts).encode()).hexdigest()
        asked: dict[str, tuple[StoredRow, ReportRequest]] = {}
        for item in items:
            asked.setdefault(identify_work(item[0].sha256, item[1]), item)
        with self._engine.begin() as connection:
            repeated = None if key is None else _take_key(connection, key)
            if repeated is not None:
                return self.get(repeated)
            known = {} if again else _find_known(connection, list(asked))
            wanted = {key: item for key, item in asked.items() if key not in known}
            row = {"id": batch_id, "name": name, "created_at": format_now(), "key": key}
            counts = {"item_count": len(asked), "duplicate_count": len(items) - len(wanted)}
            connection.execute(insert(batches).values(row | counts))
            plain = [(recording.id, recording.sha256, request) for recording, request in wanted.values()]
            queued = enqueue_all(connection, plain, "api", batch_id, is_fresh=again)
            known |= dict(zip(wanted, queued, strict=True))
            rows = [
                {"batch_id": batch_id, "place": place, "analysis_id": known[key]}
                for place, key in enumerate(asked)
            ]
            connection.execute(insert(batch_items), rows)
            record(connection, "batch.asked", other={"batch": batch_id, "items": len(asked)})
            announce_batch(connection, batch_id)
        return self.get(batch_id)

    def get(self, batch_id: str) -> Batch:
        """Return one batch with its counts. Raises NotHere."""
        counted = (
            select(analyses.c.state, func.count())
            .where(analyses.c.id.in_(select_items(batch_id)))
            .group_by(analyses.c.state)
        )
        with self._reader.connect() as connection:
            row = connection.execute(select(batches).where(batches.c.id == batch_id)).one_or_none()
            found = {JobState(state): number for state, number in connection.execute(counted)}
        if row is None:
            raise NotHere(id=batch_id)
        counts = {state: found.get(state, 0) for state in JobState}
        return Batch(row.id, row.name, row.duplicate_count, row.created_at, counts)

    def find_page(self, limit: int, after: Place | None = None) -> tuple[Batch, ...]:
        """Return the most recently requested batches, newest first, from ``after`` on."""
        page = select_page(select(batches.c.id), (batches.c.created_at, batches.c.id), limit, after)
        return tuple(self.get(row.id) for row in self._read_all(page))

    def find_jobs(self, batch_id: str) -> tuple[Job, ...]:
        """Return the current analyses in the requested order."""
        rows = self._read_all(_select_jobs_of(batch_id).order_by(batch_items.c.place))
        return tuple(read_job(row) for row in rows)

    def retry_failed(self, batch_id: str) -> int:
        """Queue every failed analysis of the batch again, in one commit; return their number."""
        failed = _select_jobs_of(batch_id).where(analyses.c.state == JobState.FAILED)
        with self._engine.begin() as connection:
            # of two requests at once, the second waits here and then finds what the first has replaced
            connection.execute(select(batches.c.id).where(batches.c.id == batch_id).with_for_update())
            jobs = [read_job(row) for row in connection.execute(failed.with_for_update(of=analyses))]
            wanted = [build_item(connection, job, job.request) for job in jobs]
            repeated = enqueue_all(connection, wanted, "api", batch_id)
            for job, again in zip(jobs, repeated, strict=True):
                replace_job(connection, job.id, again)
            record(connection, "batch.retried", other={"batch": batch_id, "items": len(jobs)})
        return len(jobs)


def _select_jobs_of(batch_id: str) -> Select[Any]:
    mine = select_jobs().join(batch_items, batch_items.c.analysis_id == analyses.c.id)
    return mine.where(batch_items.c.batch_id == batch_id)


def _take_key(connection: Connection, key: str) -> str | None:
    """Find the complete batch of a key; an incomplete one loses the key."""
    lock_tables(connection)  # two simultaneous requests create one batch
    row = connection.execute(select(batches.c.id, batches.c.item_count).where(batches.c.key == key)).first()
    if row is None:
        return None
    held = select(func.count()).select_from(batch_items).where(batch_items.c.batch_id == row.id)
    if connection.execute(held).scalar_one() == row.item_count:
        return str(row.id)
    connection.execute(update(batches).where(batches.c.id == row.id).values(key=None))
    return None


def _find_known(connection: Connection, keys: Sequence[str]) -> dict[str, str]:
    """Return the oldest analysis of each key that has one."""
    found: dict[str, str] = {}
    for first in range(0, len(keys), KEYS_PER_QUERY):
        query = select_same(keys[first : first + KEYS_PER_QUERY])
        for key, analysis_id in connection.execute(query.with_only_columns(analyses.c.key, analyses.c.id)):
            found.setdefault(key, analysis_id)
    return found


# Studies.


def identify_study(name: str) -> str:
    """Return the id of the study of this name, the same for simultaneous requests."""
    return "ba_" + hashlib.sha256(f"study\n{name}".encode()).hexdigest()[:16]


def join_study(connection: Connection, name: str, analysis_id: str) -> str:
    """Add an analysis to the study of a name, created if needed; return the study's id."""
    study_id = identify_study(name)
    make_insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
    study = {"id": study_id, "name": name, "item_count": 0, "created_at": format_now(), "duplicate_count": 0}
    connection.execute(make_insert(batches).values(study).on_conflict_do_nothing())
    connection.execute(select(batches.c.id).where(batches.c.id == study_id).with_for_update())
    if not _replace_recording(connection, study_id, analysis_id):
        mine = batch_items.c.batch_id == study_id
        place = select(func.coalesce(func.max(batch_items.c.place) + 1, 0)).where(mine).scalar_subquery()
        row = {"batch_id": study_id, "place": place, "analysis_id": analysis_id}
        connection.execute(insert(batch_items).values(row))
    recording_id = increment_revision_of(connection, analysis_id)
    record(connection, "study.joined", recording_id, analysis_id, other={"study": study_id})
    return study_id


def replace_cut(
    connection: Connection, analysis_id: str, shifts: Sequence[str], *, is_finished: bool
) -> None:
    """Replace an analysis by those of the shifts of its recording, also in every study that contains it.

    Other batches keep a finished analysis, because it was requested as it is.
    """
    mine = batch_items.c.analysis_id == analysis_id
    holding = select(batches.c.id, batches.c.name).join(batch_items, batch_items.c.batch_id == batches.c.id)
    found = connection.execute(holding.where(mine)).all()
    studies = {batch.id: batch.name for batch in found if batch.id == identify_study(batch.name)}
    connection.execute(delete(batch_items).where(mine, batch_items.c.batch_id.in_(studies)))
    replace_job(connection, analysis_id, shifts[0], keeps_batches=is_finished)
    for name in studies.values():
        for shift in shifts:
            join_study(connection, name, shift)


def update_studies(connection: Connection, analysis_id: str) -> None:
    """Replace the recording's earlier analysis by this one in every study that contains it."""
    same = _select_siblings(analysis_id)
    holding = (
        select(batches.c.id, batches.c.name)
        .join(batch_items, batch_items.c.batch_id == batches.c.id)
        .where(batch_items.c.analysis_id.in_(same))
        .distinct()
    )
    for batch in connection.execute(holding).all():
        if batch.id == identify_study(batch.name):
            _replace_recording(connection, batch.id, analysis_id)
            increment_revision_of(connection, analysis_id)


def _replace_recording(connection: Connection, study_id: str, analysis_id: str) -> bool:
    """Replace an earlier analysis of the same recording; return False if the study has none."""
    mine = (batch_items.c.batch_id == study_id, batch_items.c.analysis_id.in_(_select_siblings(analysis_id)))
    change = update(batch_items).where(*mine).values(analysis_id=analysis_id)
    return connection.execute(change).rowcount > 0


def _select_siblings(analysis_id: str) -> Select[tuple[str]]:
    """Select every analysis of the same recording, or of the same shift of it."""
    this = analyses.alias()
    same = (analyses.c.recording_id == this.c.recording_id, analyses.c.shift == this.c.shift)
    return select(analyses.c.id).join(this, and_(*same)).where(this.c.id == analysis_id)
