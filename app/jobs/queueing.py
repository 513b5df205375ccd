"""Who comes next: a person before a script, and scripts in turn.

A job asked for on the page goes first. Everything else waits in flows: each batch is one, all single
requests of scripts are another. The jobs of a flow are numbered; whoever has the lowest number is next, so
that the flows take turns. A new flow begins at the lowest number that waits, neither before nor behind the
others (start-time fair queueing: Goyal et al. 1996, with all jobs taken as equally long).
"""

import secrets
from collections.abc import Sequence
from typing import Literal

from sqlalchemy import ColumnElement, Connection, exists, func, insert, select

from app.jobs.job import JobState
from app.jobs.reading import tell_now
from app.jobs.side_files import count_change
from app.jobs.tables import analyses, recordings
from app.jobs.versions import identify_work, number_versions
from app.request import ReportRequest

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
