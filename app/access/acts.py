"""What is done about accounts, on its way into the trail.

The accounts have a database of their own. An act and its note are one commit there; the line of the trail
follows, and the note goes once the line stands. A crash in between leaves the note, and no second line.
The line has the time at which it was chained, and names the moment of the act.
"""

import json
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, Engine, Row, delete, func, insert, select
from sqlalchemy.exc import SQLAlchemyError

from app.access.tables import acts
from app.jobs.audit_log import Act, find_actor, record
from app.jobs.database.connect import connect, find_database_file, read_revision
from app.jobs.database.tables import REVISION, audit_log
from app.settings import Settings

if TYPE_CHECKING:
    from app.access.database import AccountDatabase

_LATE_LINES = 1_000
"""So many lines may have joined the trail since the one whose note a crash left behind."""


def note_act(connection: Connection, act: Act, person_id: str, *, who: str = "", **codes: str) -> None:
    """Note an act in the commit of it; ``person_id`` is "" where it is about nobody."""
    told = {"person": person_id} | codes if person_id else codes
    row = {
        "at": datetime.now(UTC).isoformat(timespec="microseconds"),
        "who": who or find_actor(),
        "act": act,
        "other": json.dumps(told, sort_keys=True) if told else "",
    }
    connection.execute(insert(acts).values(row))


def carry_acts(database: "AccountDatabase", engine: Engine) -> None:
    """Write the lines of all notes, in order.

    Raises
    ------
    sqlalchemy.exc.SQLAlchemyError
        A database is away; what was not written waits.
    """
    if not database.has_notes or not database.is_there:
        return
    database.has_notes = False
    is_done = False
    try:
        with database.write(is_act=False) as connection:
            for row in connection.execute(select(acts).order_by(acts.c.id)).all():
                _write_line(engine, row)
                connection.execute(delete(acts).where(acts.c.id == row.id))
        is_done = True
    finally:
        database.has_notes = database.has_notes or not is_done


def carry_acts_by_command(database: "AccountDatabase", settings: Settings) -> None:
    """Write the lines of a command; what cannot be written now is left to the next server."""
    engine = _open_tables(settings)
    if engine is None:
        return
    try:
        with suppress(SQLAlchemyError):
            carry_acts(database, engine)
    finally:
        engine.dispose()


def _open_tables(settings: Settings) -> Engine | None:
    """Open the tables, where there are any of this release."""
    file = find_database_file(settings.database_url)
    if file and not Path(file).exists():
        return None
    engine = connect(settings.database_url)
    with suppress(SQLAlchemyError), engine.connect() as connection:
        if read_revision(connection) == REVISION:
            return engine
    engine.dispose()
    return None


def _write_line(engine: Engine, row: Row[Any]) -> None:
    """Write the line of a note, unless it stands there."""
    is_late = audit_log.c.seq > select(func.max(audit_log.c.seq)).scalar_subquery() - _LATE_LINES
    told = (json.loads(row.other) if row.other else {}) | {"done_at": row.at}
    is_it = (audit_log.c.act == row.act, audit_log.c.other == json.dumps(told, sort_keys=True))
    with engine.begin() as connection:
        if connection.execute(select(audit_log.c.seq).where(is_late, *is_it)).first() is None:
            record(connection, row.act, other=told, who=row.who)
