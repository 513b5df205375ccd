"""Rows as frozen values: jobs and their states, and queries shared by the stores."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

from sqlalchemy import Engine, Executable, Row, ScalarSelect, Select, func, select, tuple_

from acromion.app.library.database.tables import analyses, batch_items, recordings, running_time
from acromion.app.request import ReportRequest
from acromion.fusion.diary import DiaryEntry
from acromion.fusion.errors import Fact


class JobState(StrEnum):
    """State of a job; the names are a contract."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"


# Each state and the states that may follow. A running job is queued again if its worker died or was stopped.
TRANSITIONS: Mapping[JobState, frozenset[JobState]] = {
    JobState.QUEUED: frozenset({JobState.RUNNING, JobState.CANCELLED}),
    JobState.RUNNING: frozenset({JobState.QUEUED, JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED}),
    JobState.SUCCEEDED: frozenset(),
    JobState.FAILED: frozenset(),
    JobState.CANCELLED: frozenset(),
}


def find_sources(state: JobState) -> tuple[JobState, ...]:
    """Return the states from which this one can be reached."""
    return tuple(source for source, followers in TRANSITIONS.items() if state in followers)


Place = tuple[str, str]
"""Where a page of a list ended: the timestamp of the order and the id of its last row."""


def select_page(query: Select[Any], order: tuple[Any, Any], limit: int, after: Place | None) -> Select[Any]:
    """Select the rows after a place, newest first (a keyset: later pages cost no more)."""
    if after is not None:
        query = query.where(tuple_(*order) < tuple_(*after))
    return query.order_by(*(column.desc() for column in order)).limit(limit)


@dataclass(frozen=True, slots=True)
class Job:
    """One row of the analyses, with name, size and digest of its recording.

    ``token`` identifies the running or successful attempt; only its holder may change the state. ``stage``
    and ``progress`` (0 to 1) only inform people. ``problem_code`` and ``problem_facts`` state why a job
    failed, or what delays an unfinished one. ``attempts`` counts the attempts that died while their worker
    lived, plus a running or successful one. ``interruptions`` counts how often the worker or its computer
    stopped. ``asked_by``: who requested it; "" for the machine. ``put_backs`` counts the delays by a full
    disk. ``replaced_by`` is the id of the job that repeats it, or of the earlier report that replaces it.
    """

    id: str
    recording_id: str
    file_name: str
    size_bytes: int
    sha256: str
    request: ReportRequest
    state: JobState
    stage: str | None
    progress: float
    attempts: int
    token: str | None
    created_at: datetime
    started_at: datetime | None
    ended_at: datetime | None
    problem_code: str | None
    problem_facts: Mapping[str, Fact]
    batch_id: str | None = None
    replaced_by: str | None = None
    put_backs: int = 0
    interruptions: int = 0
    asked_by: str = ""
    priority: int = 1

    @property
    def is_label(self) -> bool:
        """Whether only the label of the report changes; no analysis is needed."""
        return self.priority < 0

    @property
    def is_over(self) -> bool:
        """Whether the state is final."""
        return not TRANSITIONS[self.state]


STORED = "stored"
TRASHED = "trashed"
PURGING = "purging"
"""Being deleted permanently: its files are removed first, its rows last."""
REFERENCE = "reference"
"""Stored for the comparison of another recording: in no list, and deleted with that recording."""


_JOB_COLUMNS = tuple(field.name for field in fields(Job))


class RowStore:
    """Base class of the stores: one engine writes, another engine of the same database only reads.

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
        """Execute a change in a separate transaction; return the number of changed rows."""
        with self._engine.begin() as connection:
            return connection.execute(change).rowcount


def select_jobs() -> Select[Any]:
    """Select the jobs of recordings that are not in the trash."""
    about = (recordings.c.file_name, recordings.c.size_bytes, recordings.c.sha256)
    joined = select(analyses, *about).join(recordings, analyses.c.recording_id == recordings.c.id)
    # coalesce, so that no planner starts from this index: nearly every recording is stored
    return joined.where(func.coalesce(recordings.c.state, "") == STORED)


def select_items(batch_id: str) -> Select[Any]:
    """Select the ids of the analyses of a batch."""
    return select(batch_items.c.analysis_id).where(batch_items.c.batch_id == batch_id)


def read_job(row: Row[Any]) -> Job:
    """Convert a row of :func:`select_jobs` to a job."""
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
    """Select the total running time of the server, by which ages are counted instead of a clock."""
    return select(func.coalesce(func.max(running_time.c.running_s), 0.0)).scalar_subquery()


def read_diary(text: str) -> tuple[DiaryEntry, ...]:
    """Parse the stored diary of a recording."""
    return tuple(DiaryEntry(**entry) for entry in json.loads(text))


def format_diary(diary: Sequence[DiaryEntry]) -> str:
    """Format a diary for storage."""
    return json.dumps([asdict(entry) for entry in diary])


def read_tags(text: str) -> tuple[str, ...]:
    """Parse the stored tags of a recording."""
    return tuple(json.loads(text))


def format_tags(tags: Iterable[str]) -> str:
    """Format tags for storage, each once, in alphabetical order."""
    return json.dumps(sort_tags(tags))


def sort_tags(tags: Iterable[str]) -> tuple[str, ...]:
    """Sort tags alphabetically, ignoring case; each once."""
    return tuple(sorted(set(tags), key=lambda tag: (tag.lower(), tag)))


def format_now() -> str:
    """Return the time in the stored format, which sorts as text."""
    return datetime.now(UTC).isoformat(timespec="microseconds")
