"""Studies: batches that go by their name, and hold each recording once, by its latest analysis.

A batch that a script asks for as a whole keeps the analyses it asked for. A study grows with each recording
that is added under its name, and follows a recording that is corrected.
"""

import hashlib

from sqlalchemy import Connection, Select, func, insert, select, update
from sqlalchemy.dialects import postgresql, sqlite

from app.jobs.audit_log import record
from app.jobs.database.tables import analyses, batch_items, batches
from app.jobs.queries import format_now
from app.jobs.side_files import increment_revision_of


def identify_study(name: str) -> str:
    """Give the id of the batch that is the study of this name: two that begin it at once begin the same."""
    return "ba_" + hashlib.sha256(f"study\n{name}".encode()).hexdigest()[:16]


def join_study(connection: Connection, name: str, analysis_id: str) -> str:
    """Add an analysis to the study of a name, which begins with its first; gives the study's id."""
    study_id = _begin(connection, name)
    if not _replace_recording(connection, study_id, analysis_id):
        mine = batch_items.c.batch_id == study_id
        place = select(func.coalesce(func.max(batch_items.c.place) + 1, 0)).where(mine).scalar_subquery()
        row = {"batch_id": study_id, "place": place, "analysis_id": analysis_id}
        connection.execute(insert(batch_items).values(row))
    recording_id = increment_revision_of(connection, analysis_id)
    record(connection, "study.joined", recording_id, analysis_id, other={"study": study_id})
    return study_id


def follow_recording(connection: Connection, analysis_id: str) -> None:
    """Let every study that holds the recording of an analysis go on with this analysis."""
    same = _select_siblings(analysis_id)
    holding = (
        select(batches.c.id, batches.c.name)
        .join(batch_items, batch_items.c.batch_id == batches.c.id)
        .where(batch_items.c.analysis_id.in_(same))
        .distinct()
    )
    for batch in connection.execute(holding).all():
        if batch.id == identify_study(batch.name):
            _replace_recording(connection, batch.id, analysis_id)
            increment_revision_of(connection, analysis_id)


def _begin(connection: Connection, name: str) -> str:
    """Write the row of the study unless it is there, and lock it; gives its id."""
    study_id = identify_study(name)
    make_insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
    row = {"id": study_id, "name": name, "item_count": 0, "created_at": format_now(), "duplicate_count": 0}
    connection.execute(make_insert(batches).values(row).on_conflict_do_nothing())
    connection.execute(select(batches.c.id).where(batches.c.id == study_id).with_for_update())
    return study_id


def _replace_recording(connection: Connection, study_id: str, analysis_id: str) -> bool:
    """Put an analysis in the place of an earlier one of its recording; False where the study has none."""
    mine = (batch_items.c.batch_id == study_id, batch_items.c.analysis_id.in_(_select_siblings(analysis_id)))
    change = update(batch_items).where(*mine).values(analysis_id=analysis_id)
    return connection.execute(change).rowcount > 0


def _select_siblings(analysis_id: str) -> Select[tuple[str]]:
    """Select every analysis of the same recording."""
    recording = select(analyses.c.recording_id).where(analyses.c.id == analysis_id).scalar_subquery()
    return select(analyses.c.id).where(analyses.c.recording_id == recording)
