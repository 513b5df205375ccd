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
    JobState.RUNNING: frozenset({JobState.QUEUED, JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED}),
    JobState.SUCCEEDED: frozenset(),
    JobState.FAILED: frozenset(),
    JobState.CANCELLED: frozenset(),
}


def find_sources(state: JobState) -> tuple[JobState, ...]:
    """Find the states from which this one may be reached."""
    return tuple(source for source, followers in TRANSITIONS.items() if state in followers)


@dataclass(frozen=True, slots=True)
class Job:
    """One row of the analyses, with name, size and digest of its recording.

    ``token`` identifies the attempt that runs now or that succeeded; only its holder may change the state.
    ``stage`` and ``progress`` (0 to 1) only inform people. ``problem_code`` and ``problem_facts`` state why a
    failed job failed, or what delays one that is not over. ``attempts`` counts the attempts that died while
    their worker lived, and the one that runs or succeeded. ``interruptions`` counts the ends of the worker or
    its computer. ``asked_by``: who asked for it; "" for the machine.
    ``put_backs`` counts the delays by a full disk. ``replaced_by`` is the id of the job that
    repeats it, or of the earlier report that replaces it.
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

    @property
    def is_over(self) -> bool:
        """The state is final."""
        return not TRANSITIONS[self.state]
