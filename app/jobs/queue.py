"""Who comes next: a person before a script, and scripts in turn.

A job asked for on the page goes first. Everything else waits in flows: each batch is one, all single
requests of scripts are another. The jobs of a flow are numbered; whoever has the lowest number is next, so
that the flows take turns. A new flow begins at the lowest number that waits, neither before nor behind the
others (start-time fair queueing: Goyal et al. 1996, with all jobs taken as equally long).
"""

import secrets
from collections.abc import Mapping, Sequence
from typing import Literal

from sqlalchemy import ColumnElement, Connection, Update, exists, func, insert, select, update

from app.jobs.database.tables import analyses, batch_items, recordings
from app.jobs.job import TRANSITIONS, Claimer, JobState, list_sources
from app.jobs.rows import tell_now
from app.jobs.side_files import count_change, count_change_of
from app.jobs.versions import identify_work, number_versions
from app.jobs.webhooks import announce_end
from app.request import ReportRequest

# From one state of a job to the next: guarded updates, so that of two who want the same one wins.


def start_job(connection: Connection, analysis_id: str, claimer: Claimer) -> None:
    """Give a queued job to a worker, with a token of its own for the attempt."""
    held: dict[str, object] = {
        "token": secrets.token_hex(8),
        "stage": None,
        "progress": 0.0,
        "problem_code": None,
        "problem_facts": None,
        "attempts": analyses.c.attempts + 1,
        "beats": analyses.c.beats + 1,
        "claimer_place": claimer.place,
        "claimer_pid": claimer.pid,
        "claimer_started": claimer.started,
        "started_at": func.coalesce(analyses.c.started_at, tell_now()),
    }
    move_job(connection, analysis_id, JobState.RUNNING, held)


def move_job(
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
    moved = is_changed(connection, change.values({"state": to, **values}))
    if moved and not TRANSITIONS[to]:
        count_change_of(connection, analysis_id)
        announce_end(connection, analysis_id, to)
    return moved


def cancel_job(connection: Connection, analysis_id: str) -> None:
    """Stop a job unless it is over; what held it up is not why it ended."""
    ended = {"ended_at": tell_now(), "problem_code": None, "problem_facts": None}
    move_job(connection, analysis_id, JobState.CANCELLED, ended)


def replace_job(connection: Connection, analysis_id: str, again: str) -> None:
    """Let the job that repeats another take its place, in every batch that asked for it."""
    connection.execute(update(analyses).where(analyses.c.id == analysis_id).values(replaced_by=again))
    mine = batch_items.c.analysis_id == analysis_id
    connection.execute(update(batch_items).where(mine).values(analysis_id=again))
    count_change_of(connection, analysis_id)


def is_changed(connection: Connection, change: Update) -> bool:
    """Make a change of one row, and tell whether it was there to be changed."""
    return connection.execute(change).rowcount == 1


WayIn = Literal["web", "api"]
AT_ONCE, IN_TURN = 0, 1


def enqueue(
    connection: Connection,
    recording: tuple[str, str],
    request: ReportRequest,
    way_in: WayIn,
    batch_id: str | None = None,
) -> str:
    """Write the row of a new job of ``recording`` (its id and SHA-256); gives the job's id."""
    (analysis_id,) = enqueue_all(connection, [(*recording, request)], way_in, batch_id)
    return analysis_id


def enqueue_all(
    connection: Connection,
    items: Sequence[tuple[str, str, ReportRequest]],
    way_in: WayIn,
    batch_id: str | None = None,
) -> list[str]:
    """Write the rows of several jobs (recording, its SHA-256, request); gives their ids in order."""
    requests = number_versions(connection, items)
    first = 0 if way_in == "web" else _find_turn(connection, batch_id)
    rows = [
        {
            "id": f"an_{secrets.token_hex(8)}",
            "recording_id": recording_id,
            "request": request.to_json(),
            "key": identify_work(sha256, request),
            "way_in": way_in,
            "state": JobState.QUEUED,
            "progress": 0.0,
            "attempts": 0,
            "beats": 0,
            "created_at": tell_now(),
            "priority": AT_ONCE if way_in == "web" else IN_TURN,
            "turn": first + place,
            "batch_id": batch_id,
        }
        for place, ((recording_id, sha256, _), request) in enumerate(zip(items, requests, strict=True))
    ]
    if rows:
        connection.execute(insert(analyses), rows)
        count_change(connection, *(recording_id for recording_id, _, _ in items))
    return [str(row["id"]) for row in rows]


def find_next(connection: Connection) -> str | None:
    """Give the waiting job whose turn it is, locked for this transaction; None when none may begin.

    The analyses of one recording are made one after another: each report says which one it replaces.
    """
    query = (
        select(analyses.c.id, analyses.c.recording_id)
        .join(recordings, analyses.c.recording_id == recordings.c.id)
        .where(analyses.c.state == JobState.QUEUED, ~_runs(analyses.c.recording_id))
        .order_by(analyses.c.priority, analyses.c.turn, analyses.c.created_at, analyses.c.id)
        .limit(1)
        .with_for_update(key_share=True, skip_locked=True)
    )
    row = connection.execute(query).one_or_none()
    # A peer may have begun another of this recording after our question was put and before we had the lock.
    if row is None or connection.execute(select(_runs(row.recording_id))).scalar():
        return None
    return str(row.id)


def _runs(recording_id: ColumnElement[str] | str) -> ColumnElement[bool]:
    """Say whether an analysis of a recording is under way."""
    other = analyses.alias()
    return exists().where(other.c.recording_id == recording_id, other.c.state == JobState.RUNNING)


def _find_turn(connection: Connection, batch_id: str | None) -> int:
    """Give the number behind the last of the flow, or the lowest that waits where the flow is new."""
    waits = (analyses.c.state == JobState.QUEUED, analyses.c.priority == IN_TURN)
    own = select(func.max(analyses.c.turn)).where(analyses.c.batch_id.is_not_distinct_from(batch_id), *waits)
    last = connection.execute(own).scalar()
    if last is not None:
        return int(last) + 1
    return int(connection.execute(select(func.min(analyses.c.turn)).where(*waits)).scalar() or 0)
