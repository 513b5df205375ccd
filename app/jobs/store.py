"""The job rows: the one truth about what was asked, what runs and what came of it."""

import json
import secrets
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any, cast

from sqlalchemy import Connection, Row, Select, Update, func, insert, select, update

from app.errors import NotHere
from app.jobs.job import Claim, Claimer, Job, JobState, list_sources
from app.jobs.tables import READ_ONLY, analyses, open_engine, recordings, result_files
from app.request import ReportRequest
from app.storage import ResultFile, StoredRecording
from fusion.errors import Fact


class JobStore:
    """Rows of recordings and analyses in one database.

    Every change of state is one guarded UPDATE that names the states it may start from and, for a running
    job, the attempt's token. So two workers, or a worker and a person, may do the same at once: one wins.
    """

    def __init__(self, url: str) -> None:
        self._engine = open_engine(url)
        self._reader = self._engine.execution_options(**READ_ONLY)

    def close(self) -> None:
        """Let go of the database."""
        self._engine.dispose()

    def add(self, stored: StoredRecording, request: ReportRequest, way_in: str = "api") -> Job:
        """Acknowledge a recording and queue its analysis, in one commit."""
        analysis_id, now = f"an_{secrets.token_hex(8)}", _now()
        recording = {
            "id": stored.id,
            "sha256": stored.sha256,
            "size_bytes": stored.size_bytes,
            "file_name": request.file_name,
            "state": "stored",
            "created_at": now,
        }
        analysis = {
            "id": analysis_id,
            "recording_id": stored.id,
            "request": request.to_json(),
            "way_in": way_in,
            "state": JobState.QUEUED,
            "progress": 0.0,
            "attempts": 0,
            "beats": 0,
            "created_at": now,
        }
        with self._engine.begin() as connection:
            connection.execute(insert(recordings).values(recording))
            connection.execute(insert(analyses).values(analysis))
        return self.get(analysis_id)

    def add_recording(self, stored: StoredRecording, file_name: str) -> None:
        """Acknowledge a file that an analysis needs beside its own recording, such as a reference."""
        row = {
            "id": stored.id,
            "sha256": stored.sha256,
            "size_bytes": stored.size_bytes,
            "file_name": file_name,
            "state": "stored",
            "created_at": _now(),
        }
        with self._engine.begin() as connection:
            connection.execute(insert(recordings).values(row))

    def get(self, analysis_id: str) -> Job:
        """Give one job.

        Raises
        ------
        NotHere
        """
        with self._reader.connect() as connection:
            row = connection.execute(_select_jobs().where(analyses.c.id == analysis_id)).one_or_none()
        if row is None:
            raise NotHere
        return _read_job(row)

    def list_newest(self, limit: int = 100) -> tuple[Job, ...]:
        """Give the jobs asked for last, newest first; comparisons have pages of their own."""
        newest_first = analyses.c.created_at.desc(), analyses.c.id
        reports = _select_jobs().where(analyses.c.way_in != "validation")
        with self._reader.connect() as connection:
            rows = connection.execute(reports.order_by(*newest_first).limit(limit)).all()
        return tuple(_read_job(row) for row in rows)

    def count_states(self) -> dict[JobState, int]:
        """Count the jobs of each state."""
        query = select(analyses.c.state, func.count()).group_by(analyses.c.state)
        with self._reader.connect() as connection:
            counts = {JobState(state): number for state, number in connection.execute(query)}
        return {state: counts.get(state, 0) for state in JobState}

    def claim(self, claimer: Claimer) -> Job | None:
        """Take the oldest queued job, or None when nothing waits."""
        oldest = (
            select(analyses.c.id)
            .where(analyses.c.state == JobState.QUEUED)
            .order_by(analyses.c.created_at, analyses.c.id)
            .limit(1)
            .with_for_update(skip_locked=True)
        )
        with self._engine.begin() as connection:
            analysis_id = connection.execute(oldest).scalar_one_or_none()
            if analysis_id is None:
                return None
            _start(connection, analysis_id, claimer)
        return self.get(analysis_id)

    def beat(self, analysis_id: str, token: str, stage: str | None, progress: float) -> bool:
        """Say that the attempt lives and how far it is; False when the job is no longer its own."""
        change = (
            update(analyses)
            .where(analyses.c.id == analysis_id, analyses.c.token == token)
            .where(analyses.c.state == JobState.RUNNING)
            .values(beats=analyses.c.beats + 1, stage=stage, progress=progress)
        )
        with self._engine.begin() as connection:
            return _changed(connection, change)

    def owns(self, analysis_id: str, token: str) -> bool:
        """Tell whether the attempt is still the one that counts; writes nothing."""
        query = select(analyses.c.id).where(
            analyses.c.id == analysis_id, analyses.c.token == token, analyses.c.state == JobState.RUNNING
        )
        with self._reader.connect() as connection:
            return connection.execute(query).one_or_none() is not None

    def finish(self, analysis_id: str, token: str, files: Iterable[ResultFile]) -> bool:
        """Publish the attempt's files; they appear together or, when another attempt counts, not at all."""
        rows = [
            {
                "analysis_id": analysis_id,
                "name": file.name,
                "sha256": file.sha256,
                "size_bytes": file.size_bytes,
            }
            for file in files
        ]
        with self._engine.begin() as connection:
            ended = {"progress": 1.0, "ended_at": _now()}
            won = _move(connection, analysis_id, JobState.SUCCEEDED, ended, token)
            if won:
                connection.execute(insert(result_files), rows)
        return won

    def fail(self, analysis_id: str, token: str, code: str, facts: Mapping[str, Fact]) -> bool:
        """End the job with the reason."""
        reason = {"problem_code": code, "problem_facts": json.dumps(dict(facts)), "ended_at": _now()}
        with self._engine.begin() as connection:
            return _move(connection, analysis_id, JobState.FAILED, reason, token)

    def release(self, analysis_id: str, token: str, *, forgiven: bool = False) -> bool:
        """Put the job back in the queue; ``forgiven`` attempts (an orderly stop) do not count as deaths."""
        back: dict[str, object] = {"token": None, "stage": None, "progress": 0.0}
        if forgiven:
            back["attempts"] = analyses.c.attempts - 1
        with self._engine.begin() as connection:
            return _move(connection, analysis_id, JobState.QUEUED, back, token)

    def cancel(self, analysis_id: str) -> Job:
        """Stop the job unless it is over; its worker sees that the attempt counts no more.

        Raises
        ------
        NotHere
        """
        with self._engine.begin() as connection:
            _move(connection, analysis_id, JobState.CANCELLED, {"ended_at": _now()})
        return self.get(analysis_id)

    def list_claims(self) -> tuple[Claim, ...]:
        """Give every running job and who holds it."""
        query = select(
            analyses.c.id,
            analyses.c.token,
            analyses.c.beats,
            analyses.c.attempts,
            analyses.c.claimer_place,
            analyses.c.claimer_pid,
            analyses.c.claimer_started,
        ).where(analyses.c.state == JobState.RUNNING)
        with self._reader.connect() as connection:
            rows = connection.execute(query).all()
        return tuple(Claim(*row[:4], Claimer(*row[4:])) for row in rows)

    def find_file(self, analysis_id: str, name: str) -> ResultFile | None:
        """Give what was published under this name."""
        query = select(result_files.c.name, result_files.c.sha256, result_files.c.size_bytes).where(
            result_files.c.analysis_id == analysis_id, result_files.c.name == name
        )
        with self._reader.connect() as connection:
            row = connection.execute(query).one_or_none()
        return ResultFile(*row) if row else None

    def list_recordings(self) -> frozenset[str]:
        """Every recording that was acknowledged."""
        with self._reader.connect() as connection:
            return frozenset(connection.execute(select(recordings.c.id)).scalars())

    def list_attempts(self) -> frozenset[tuple[str, str]]:
        """Every attempt that runs or counts: (analysis, token)."""
        kept = (JobState.RUNNING, JobState.SUCCEEDED)
        query = select(analyses.c.id, analyses.c.token).where(analyses.c.state.in_(kept))
        with self._reader.connect() as connection:
            return frozenset((row.id, row.token) for row in connection.execute(query))


def _start(connection: Connection, analysis_id: str, claimer: Claimer) -> None:
    held: dict[str, object] = {
        "token": secrets.token_hex(8),
        "stage": None,
        "progress": 0.0,
        "attempts": analyses.c.attempts + 1,
        "beats": analyses.c.beats + 1,
        "claimer_place": claimer.place,
        "claimer_pid": claimer.pid,
        "claimer_started": claimer.started,
        "started_at": func.coalesce(analyses.c.started_at, _now()),
    }
    _move(connection, analysis_id, JobState.RUNNING, held)


def _move(
    connection: Connection,
    analysis_id: str,
    to: JobState,
    values: Mapping[str, object],
    token: str | None = None,
) -> bool:
    """Change the state if the table of transitions and the attempt's token allow it."""
    change = update(analyses).where(analyses.c.id == analysis_id, analyses.c.state.in_(list_sources(to)))
    if token is not None:
        change = change.where(analyses.c.token == token)
    return _changed(connection, change.values({"state": to, **values}))


def _changed(connection: Connection, change: Update) -> bool:
    return connection.execute(change).rowcount == 1


def _select_jobs() -> Select[Any]:
    about = (recordings.c.file_name, recordings.c.size_bytes, recordings.c.sha256)
    return select(analyses, *about).join(recordings, analyses.c.recording_id == recordings.c.id)


def _read_job(row: Row[Any]) -> Job:
    return Job(
        id=row.id,
        recording_id=row.recording_id,
        file_name=row.file_name,
        size_bytes=row.size_bytes,
        sha256=row.sha256,
        request=ReportRequest.from_json(row.request),
        state=JobState(row.state),
        stage=row.stage,
        progress=row.progress,
        attempts=row.attempts,
        token=row.token,
        created_at=datetime.fromisoformat(row.created_at),
        started_at=_read_time(row.started_at),
        ended_at=_read_time(row.ended_at),
        problem_code=row.problem_code,
        problem_facts=cast("dict[str, Fact]", json.loads(row.problem_facts or "{}")),
    )


def _read_time(text: str | None) -> datetime | None:
    return datetime.fromisoformat(text) if text else None


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="microseconds")
