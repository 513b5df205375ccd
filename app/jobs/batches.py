"""Batches: many analyses under one name."""

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy import Engine, func, insert, select, update

from app.errors import NotHere
from app.jobs.job import Job, JobState
from app.jobs.queueing import enqueue_all
from app.jobs.reading import counts_in_batch, read_job, select_jobs, tell_now
from app.jobs.recordings import StoredRow
from app.jobs.tables import analyses, batches
from app.request import ReportRequest


@dataclass(frozen=True, slots=True)
class Batch:
    """A batch and how many of its analyses are in each state; one that was repeated counts once."""

    id: str
    name: str
    item_count: int
    created_at: str
    counts: Mapping[JobState, int]

    @property
    def is_over(self) -> bool:
        """Nothing more will happen to it, unless failed ones are tried again."""
        return not self.counts[JobState.QUEUED] and not self.counts[JobState.RUNNING]


class BatchStore:
    """Rows of batches; their analyses are ordinary jobs."""

    def __init__(self, engine: Engine, reader: Engine) -> None:
        self._engine, self._reader = engine, reader

    def add(self, name: str, items: Sequence[tuple[StoredRow, ReportRequest]]) -> Batch:
        """Queue an analysis for each item, in one commit."""
        batch_id = f"ba_{secrets.token_hex(8)}"
        row = {"id": batch_id, "name": name, "item_count": len(items), "created_at": tell_now()}
        with self._engine.begin() as connection:
            connection.execute(insert(batches).values(row))
            wanted = [(recording.id, recording.sha256, request) for recording, request in items]
            enqueue_all(connection, wanted, "api", batch_id)
        return self.get(batch_id)

    def get(self, batch_id: str) -> Batch:
        """Give one batch with its counts.

        Raises
        ------
        NotHere
        """
        counted = (
            select(analyses.c.state, func.count()).where(counts_in_batch(batch_id)).group_by(analyses.c.state)
        )
        with self._reader.connect() as connection:
            row = connection.execute(select(batches).where(batches.c.id == batch_id)).one_or_none()
            found = {JobState(state): number for state, number in connection.execute(counted)}
        if row is None:
            raise NotHere
        counts = {state: found.get(state, 0) for state in JobState}
        return Batch(row.id, row.name, row.item_count, row.created_at, counts)

    def list_newest(self, limit: int) -> tuple[Batch, ...]:
        """Give the batches asked for last, the newest first."""
        newest = select(batches.c.id).order_by(batches.c.created_at.desc(), batches.c.id.desc()).limit(limit)
        with self._reader.connect() as connection:
            ids = connection.execute(newest).scalars().all()
        return tuple(self.get(batch_id) for batch_id in ids)

    def list_jobs(self, batch_id: str) -> tuple[Job, ...]:
        """Give the analyses that count, in the order in which they were asked for."""
        query = select_jobs().where(counts_in_batch(batch_id))
        with self._reader.connect() as connection:
            rows = connection.execute(query.order_by(analyses.c.created_at, analyses.c.id)).all()
        return tuple(read_job(row) for row in rows)

    def retry_failed(self, batch_id: str) -> int:
        """Queue every failed analysis of the batch again, in one commit; gives how many."""
        failed = select_jobs().where(counts_in_batch(batch_id), analyses.c.state == JobState.FAILED)
        with self._engine.begin() as connection:
            jobs = [read_job(row) for row in connection.execute(failed.with_for_update())]
            wanted = [(job.recording_id, job.sha256, job.request) for job in jobs]
            repeated = enqueue_all(connection, wanted, "api", batch_id)
            for job, again in zip(jobs, repeated, strict=True):
                connection.execute(update(analyses).where(analyses.c.id == job.id).values(replaced_by=again))
        return len(jobs)
