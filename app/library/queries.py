"""Queries that several stores share, and how the values of a row are read."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Engine, Executable, Row, ScalarSelect, Select, func, select

from app.library.database.tables import analyses, batch_items, recordings, running_time
from app.library.job import Job, JobState
from app.request import ReportRequest
from fusion.diary import DiaryEntry

STORED = "stored"
TRASHED = "trashed"
PURGING = "purging"
"""Deleted for good: its files are being removed, its rows go last."""
REFERENCE = "reference"
"""Stored for the comparison of another recording: in no list, and deleted with that recording."""


_JOB_COLUMNS = tuple(field.name for field in fields(Job))


class RowStore:
    """Rows of one kind: one engine writes them, another, of the same database, only reads.

    Rows become frozen values here, not through SQLAlchemy's ORM: its dataclasses can be neither frozen nor
    slotted (2.1).
    """

    def __init__(self, engine: Engine, reader: Engine) -> None:
        self._engine, self._reader = engine, reader

    def _read_all(self, query: Select[Any]) -> Sequence[Any]:
        with self._reader.connect() as connection:
            return connection.execute(query).all()

    def _read_one(self, query: Select[Any]) -> Any | None:
        with self._reader.connect() as connection:
            return connection.execute(query).one_or_none()

    def _read_value(self, query: Select[Any]) -> Any:
        with self._reader.connect() as connection:
            return connection.execute(query).scalar()

    def _read_ids(self, query: Select[Any]) -> frozenset[str]:
        with self._reader.connect() as connection:
            return frozenset(connection.execute(query).scalars())

    def _write(self, change: Executable) -> int:
        """Execute a change in a transaction of its own; gives how many rows it met."""
        with self._engine.begin() as connection:
            return connection.execute(change).rowcount


def select_jobs() -> Select[Any]:
    """Select the jobs of recordings that are not in the trash."""
    about = (recordings.c.file_name, recordings.c.size_bytes, recordings.c.sha256)
    joined = select(analyses, *about).join(recordings, analyses.c.recording_id == recordings.c.id)
    # coalesce, so that no planner starts from this index: nearly every recording is stored
    return joined.where(func.coalesce(recordings.c.state, "") == STORED)


def select_items(batch_id: str) -> Select[Any]:
    """Select the ids of the analyses that a batch asked for."""
    return select(batch_items.c.analysis_id).where(batch_items.c.batch_id == batch_id)


def read_job(row: Row[Any]) -> Job:
    """Read a row of :func:`select_jobs`."""
    columns = row._asdict()
    times = {name: columns[name] for name in ("created_at", "started_at", "ended_at")}
    parsed: dict[str, Any] = {
        "request": ReportRequest.from_json(row.request),
        "state": JobState(row.state),
        "problem_facts": json.loads(row.problem_facts or "{}"),
        "asked_by": row.asked_by or "",
        **{name: datetime.fromisoformat(text) if text else None for name, text in times.items()},
    }
    return Job(**{name: columns[name] for name in _JOB_COLUMNS} | parsed)


def select_running_s() -> ScalarSelect[float]:
    """Select how long the server has run in all: ages are counted in it, so that no clock deletes."""
    return select(func.coalesce(func.max(running_time.c.running_s), 0.0)).scalar_subquery()


def read_diary(text: str) -> tuple[DiaryEntry, ...]:
    """Read the diary of a recording."""
    return tuple(DiaryEntry(**entry) for entry in json.loads(text))


def format_diary(diary: Sequence[DiaryEntry]) -> str:
    """Return a diary as the rows hold it."""
    return json.dumps([asdict(entry) for entry in diary])


def read_tags(text: str) -> tuple[str, ...]:
    """Read the tags of a recording."""
    return tuple(json.loads(text))


def format_tags(tags: Iterable[str]) -> str:
    """Return tags as the rows hold them, each once, by the alphabet."""
    return json.dumps(sort_tags(tags))


def sort_tags(tags: Iterable[str]) -> tuple[str, ...]:
    """Sort tags by the alphabet, whatever their case; each once."""
    return tuple(sorted(set(tags), key=lambda tag: (tag.lower(), tag)))


def format_now() -> str:
    """Return the time as the rows hold it: it sorts as text."""
    return datetime.now(UTC).isoformat(timespec="microseconds")
