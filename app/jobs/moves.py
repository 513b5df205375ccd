"""From one state of a job to the next: guarded updates, so that of two who want the same one wins."""

import secrets
from collections.abc import Mapping

from sqlalchemy import Connection, Update, func, update

from app.jobs.job import TRANSITIONS, Claimer, JobState, list_sources
from app.jobs.reading import tell_now
from app.jobs.side_files import count_change_of
from app.jobs.tables import analyses, batch_items
from app.jobs.webhooks import announce_end


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
