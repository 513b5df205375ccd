"""A job: one analysis that somebody asked for, and the states it may pass through."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum

from app.request import ReportRequest
from fusion.errors import Fact


class JobState(StrEnum):
    """Where a job is; the names are a contract."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"


# From a state to those that may follow. Running goes back to queued when its worker died or was stopped.
TRANSITIONS: Mapping[JobState, frozenset[JobState]] = {
    JobState.QUEUED: frozenset({JobState.RUNNING, JobState.CANCELLED}),
    JobState.RUNNING: frozenset(
        {JobState.QUEUED, JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED},
    ),
    JobState.SUCCEEDED: frozenset(),
    JobState.FAILED: frozenset(),
    JobState.CANCELLED: frozenset(),
}


def list_sources(state: JobState) -> tuple[JobState, ...]:
    """From which states this one may be reached."""
    return tuple(source for source, followers in TRANSITIONS.items() if state in followers)


@dataclass(frozen=True, slots=True)
class Job:
    """One row of the analyses, with what its recording is.

    ``token`` names the attempt that runs now or that succeeded; only its holder may move the job on.
    ``stage`` and ``progress`` (0 to 1) only inform people. ``problem_code`` and ``problem_facts`` say why a
    failed job failed, or what holds up one that is not over. ``attempts`` counts the analyses that died while
    their worker lived, and the one that runs or succeeded. ``interruptions`` counts the ends of the worker or
    its computer. ``put_backs`` counts how often a full disk held it up. ``replaced_by`` names the job that
    repeats it, or the report that stays after it.
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

    @property
    def is_over(self) -> bool:
        """Nothing more will happen to it."""
        return not TRANSITIONS[self.state]


@dataclass(frozen=True, slots=True)
class Claimer:
    """A worker process, told apart from every other that ever was.

    ``place`` is the computer, its boot and its process namespace: inside one place a process number and
    its start time are enough to see whether the process lives. ``started`` is "" where that cannot be told.
    """

    place: str
    pid: int
    started: str


@dataclass(frozen=True, slots=True)
class Claim:
    """A running job as another worker sees it. ``beats`` grows while its holder lives."""

    analysis_id: str
    token: str
    beats: int
    attempts: int
    claimer: Claimer
