"""The queue: state changes of jobs, new jobs, and the choice of the next job.

A job requested on the page has priority. All other jobs wait in flows: each batch is one, and the single
requests of each subject (a token, or the machine) are another. The jobs of a flow are numbered and the lowest
number is next, so that the flows take turns. A new flow starts at the lowest waiting number, neither before
nor after the others (start-time fair queueing: Goyal et al. 1996, with all jobs taken as equally long).

A job that changes only the label of a report (:data:`acromion.app.request.LABEL`) needs no analysis. It comes
before all others, as soon as the analysis with its figures is finished.
"""

import secrets
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from sqlalchemy import ColumnElement, Connection, Float, exists, func, insert, or_, select, update
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement

from acromion.app.errors import OutOfTime
from acromion.app.library.audit_log import Act, get_actor, record
from acromion.app.library.database.tables import analyses, batch_items, recordings
from acromion.app.library.rows import TRANSITIONS, JobState, find_sources, format_now, select_running_s
from acromion.app.library.side_files import increment_revision, increment_revision_of
from acromion.app.library.versions import identify_work, number_versions
from acromion.app.library.webhooks import announce_end
from acromion.app.request import ReportRequest

WayIn = Literal["web", "api"]
LABEL_PRIORITY, PAGE_PRIORITY, SCRIPT_PRIORITY = -1, 0, 1
SLOW_TIMEOUTS, SLOW_S = 2, 3600.0
"""A subject with this many time-outs within this time waits for all others."""
_ENDS: Mapping[JobState, Act] = {
    JobState.SUCCEEDED: "analysis.succeeded",
    JobState.FAILED: "analysis.failed",
    JobState.CANCELLED: "analysis.cancelled",
}


class DatabaseClock(FunctionElement[float]):
    """Time by the clock of the database in s, so that clocks of different computers are never compared."""

    type = Float()
    inherit_cache = True


@compiles(DatabaseClock, "sqlite")
def _compile_clock_for_sqlite(*_: object, **__: object) -> str:
    return "((julianday('now') - 2440587.5) * 86400.0)"


@compiles(DatabaseClock, "postgresql")
def _compile_clock_for_postgresql(*_: object, **__: object) -> str:
    return "CAST(extract(epoch FROM clock_timestamp()) AS double precision)"


def start_job(connection: Connection, analysis_id: str, lease_s: float) -> None:
    """Assign a queued job to a worker, with a new token for the attempt and a lease."""
    started: dict[str, object] = {
        "token": secrets.token_hex(8),
        "stage": None,
        "progress": 0.0,
        "problem_code": None,
        "problem_facts": None,
        "awaits": None,
        "attempts": analyses.c.attempts + 1,
        "lease_until_s": DatabaseClock() + lease_s,
        "is_lease_missed": 0,
        "started_at": func.coalesce(analyses.c.started_at, format_now()),
    }
    change_state(connection, analysis_id, JobState.RUNNING, started)


def change_state(
    connection: Connection,
    analysis_id: str,
    to: JobState,
    values: Mapping[str, object],
    token: str | None = None,
) -> bool:
    """Change the state by one guarded update; return False if transitions or token do not allow it.

    Of two callers who change the same job at once, one wins.
    """
    change = update(analyses).where(analyses.c.id == analysis_id, analyses.c.state.in_(find_sources(to)))
    if token is not None:
        change = change.where(analyses.c.token == token)
    is_end = not TRANSITIONS[to]
    clock = {"ended_s": select_running_s()} if is_end else {}
    is_changed = connection.execute(change.values({"state": to, **clock, **values})).rowcount == 1
    if is_changed and is_end:
        recording_id = increment_revision_of(connection, analysis_id)
        record(connection, _ENDS[to], recording_id, analysis_id)
        announce_end(connection, analysis_id, to)
    return is_changed


def cancel_job(connection: Connection, analysis_id: str) -> None:
    """Cancel a job unless it is over, and clear a problem that delayed it."""
    ended = {"ended_at": format_now(), "problem_code": None, "problem_facts": None}
    change_state(connection, analysis_id, JobState.CANCELLED, ended)


def replace_job(connection: Connection, analysis_id: str, again: str, *, keeps_batches: bool = False) -> None:
    """Replace a job by its repetition, also in every batch that requested it, unless ``keeps_batches``."""
    connection.execute(update(analyses).where(analyses.c.id == analysis_id).values(replaced_by=again))
    if not keeps_batches:
        mine = batch_items.c.analysis_id == analysis_id
        connection.execute(update(batch_items).where(mine).values(analysis_id=again))
    recording_id = increment_revision_of(connection, analysis_id)
    record(connection, "analysis.replaced", recording_id, analysis_id, other={"again": again})


def enqueue(
    connection: Connection,
    recording: tuple[str, str],
    request: ReportRequest,
    way_in: WayIn,
    batch_id: str | None = None,
    *,
    is_fresh: bool = False,
) -> str:
    """Add a new job of ``recording`` (its id and SHA-256); return the job's id."""
    items = [(*recording, request)]
    (analysis_id,) = enqueue_all(connection, items, way_in, batch_id, is_fresh=is_fresh)
    return analysis_id


def enqueue_all(
    connection: Connection,
    items: Sequence[tuple[str, str, ReportRequest]],
    way_in: WayIn,
    batch_id: str | None = None,
    *,
    is_fresh: bool = False,
) -> list[str]:
    """Add several new jobs (recording, its SHA-256, request); return their ids in order.

    ``is_fresh``: read every recording again, also if an analysis already has the figures.
    """
    requests = number_versions(connection, items)
    usual = PAGE_PRIORITY if way_in == "web" else SCRIPT_PRIORITY
    first = 0 if way_in == "web" else _find_turn(connection, batch_id)
    rows: list[dict[str, Any]] = [
        {
            "id": f"an_{secrets.token_hex(8)}",
            "recording_id": recording_id,
            "request": request.to_json(),
            "shift": request.shift,
            "key": identify_work(sha256, request),
            "way_in": way_in,
            "state": JobState.QUEUED,
            "progress": 0.0,
            "attempts": 0,
            "created_at": format_now(),
            "priority": LABEL_PRIORITY if is_label and not is_fresh else usual,
            "turn": first + place,
            "batch_id": batch_id,
            "asked_by": get_actor(),
        }
        for place, ((recording_id, sha256, _), (request, is_label)) in enumerate(
            zip(items, requests, strict=True)
        )
    ]
    if rows:
        connection.execute(insert(analyses), rows)
        increment_revision(connection, *(recording_id for recording_id, _, _ in items))
    batch = {"batch": batch_id} if batch_id else {}
    for row, (request, _) in zip(rows, requests, strict=True):
        changes = {"changes": "+".join(request.changes)} if request.changes else {}
        record(connection, "analysis.asked", row["recording_id"], row["id"], other=batch | changes)
    return [str(row["id"]) for row in rows]


def find_next(connection: Connection, *, is_label: bool | None = None) -> str | None:
    """Find the next waiting job and lock it for this transaction; None if no job may start.

    ``is_label``: find only a job without an analysis, or only one with an analysis. The analyses of one
    recording run one after another: each report states which one it replaces. Subjects whose analyses timed
    out repeatedly in the last hour come after all others.
    """
    if is_label:
        return _find_next(connection, analyses.c.priority == LABEL_PRIORITY)
    lane = () if is_label is None else (analyses.c.priority != LABEL_PRIORITY,)
    first = _find_next(connection, *lane)
    if first is None or not (
        slow := _find_slow_subjects(connection)
    ):  # no job waits, so slow subjects need not be looked up
        return first
    others = analyses.c.asked_by.is_(None) | analyses.c.asked_by.not_in(slow)
    return _find_next(connection, others, *lane) or first


def _find_slow_subjects(connection: Connection) -> Sequence[str]:
    recent = analyses.c.ended_s >= select_running_s() - SLOW_S
    timed_out = (analyses.c.state == JobState.FAILED, analyses.c.problem_code == OutOfTime.code)
    query = select(analyses.c.asked_by).where(*timed_out, recent).group_by(analyses.c.asked_by)
    return connection.execute(query.having(func.count() >= SLOW_TIMEOUTS)).scalars().all()


def _find_next(connection: Connection, *which: ColumnElement[bool]) -> str | None:
    query = (
        select(analyses.c.id, analyses.c.recording_id)
        .join(recordings, analyses.c.recording_id == recordings.c.id)
        .where(analyses.c.state == JobState.QUEUED, ~_is_running(analyses.c.recording_id), *which)
        .where(or_(analyses.c.priority != LABEL_PRIORITY, ~_awaits_figures()))
        .order_by(analyses.c.priority, analyses.c.turn, analyses.c.created_at, analyses.c.id)
        .limit(1)
        .with_for_update(key_share=True, skip_locked=True)
    )
    row = connection.execute(query).one_or_none()
    # Another worker may have started an analysis of this recording between our query and our lock.
    if row is None or connection.execute(select(_is_running(row.recording_id))).scalar():
        return None
    return str(row.id)


def _is_running(recording_id: ColumnElement[str] | str) -> ColumnElement[bool]:
    """Return the condition that an analysis of a recording is running."""
    other = analyses.alias()
    return exists().where(other.c.recording_id == recording_id, other.c.state == JobState.RUNNING)


def _awaits_figures() -> ColumnElement[bool]:
    """Return the condition that an earlier analysis of the same recording has not started yet."""
    other = analyses.alias()
    is_before = (other.c.recording_id == analyses.c.recording_id, other.c.created_at < analyses.c.created_at)
    return exists().where(*is_before, other.c.state == JobState.QUEUED, other.c.priority != LABEL_PRIORITY)


def _find_turn(connection: Connection, batch_id: str | None) -> int:
    """Return the number after the last one of the flow, or the lowest waiting one for a new flow.

    Each batch is a flow, and the single requests of each subject are another.
    """
    waits = (analyses.c.state == JobState.QUEUED, analyses.c.priority == SCRIPT_PRIORITY)
    flow = analyses.c.batch_id.is_not_distinct_from(batch_id)
    if batch_id is None:
        flow &= analyses.c.asked_by == get_actor()
    own = select(func.max(analyses.c.turn)).where(flow, *waits)
    last = connection.execute(own).scalar()
    if last is not None:
        return int(last) + 1
    return int(connection.execute(select(func.min(analyses.c.turn)).where(*waits)).scalar() or 0)
