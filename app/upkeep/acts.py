"""Lines of the audit log for what is done by command, by whoever sits at the machine."""

from contextlib import suppress

from sqlalchemy.exc import SQLAlchemyError

from app.jobs.audit_log import AT_MACHINE, Act, record
from app.jobs.database.connect import connect, read_revision
from app.jobs.database.tables import REVISION
from app.settings import Settings


def record_command(settings: Settings, act: Act) -> None:
    """Write the line of a command that changes no row.

    A store that cannot be written is backed up and verified all the same.
    """
    engine = connect(settings.database_url)
    try:
        with suppress(SQLAlchemyError), engine.begin() as connection:
            if read_revision(connection) == REVISION:
                record(connection, act, who=AT_MACHINE)
    finally:
        engine.dispose()
