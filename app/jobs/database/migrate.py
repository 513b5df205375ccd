"""Migrate the tables of an earlier release, after a copy of every row, sealed.

This module imports Alembic: the server loads it only when there is something to migrate.
"""

from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, Text, select, type_coerce

import app.jobs.migrations
from app.errors import KeysNeeded
from app.jobs.database.connect import connect, is_older, lock_tables
from app.jobs.database.dump import write_rows_file
from app.jobs.database.seal_rows import COPIES_FOLDER, seal_row
from app.jobs.database.sealed_text import use_sealer
from app.jobs.database.tables import REVISION, recordings
from app.settings import Settings
from app.storage.keys import open_keys
from app.storage.labels import MARK, LabelSealer


def migrate(settings: Settings) -> Path | None:
    """Migrate if the tables are older than ours; gives the copy that was made before, None if none was.

    The whole change is one transaction: after a crash the tables are the old ones or the new ones.

    Raises
    ------
    KeyFileMissing, KeyMismatch, KeysNeeded
        Nothing is changed: without the keys that were, the copy cannot be sealed.
    """
    engine, sealer = connect(settings.database_url), LabelSealer(open_keys(settings))
    use_sealer(engine, sealer)
    try:
        with engine.connect() as connection:
            if not is_older(connection):
                return None
            _check_keys(connection, sealer)
            stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
            copy = settings.data_dir / COPIES_FOLDER / f"rows-before-{REVISION}-{stamp}.zip"
            write_rows_file(connection, copy, partial(seal_row, sealer))
        with engine.begin() as connection:
            lock_tables(connection)
            upgrade(connection)
        return copy
    finally:
        engine.dispose()


def _check_keys(connection: Connection, sealer: LabelSealer) -> None:
    """Refuse where words are sealed and no key is here: a new one would take the place of a lost one."""
    if not sealer.keys.wrapped.is_empty():
        return
    is_sealed = type_coerce(recordings.c.file_name, Text).startswith(MARK)
    found = connection.execute(select(recordings.c.id).where(is_sealed)).scalars()
    sealed = sorted(set(found) - sealer.keys.find_erased())  # what is being purged has no key
    if sealed:
        raise KeysNeeded(number=len(sealed), first=sealed[0])


def upgrade(connection: Connection, to: str = "head") -> None:
    """Run the migrations that are missing, in the transaction of the connection."""
    command.upgrade(configure(connection), to)


def configure(connection: Connection) -> Config:
    """Point Alembic at our migrations and at a connection."""
    config = Config()
    config.set_main_option("script_location", str(Path(app.jobs.migrations.__path__[0])))
    config.attributes["connection"] = connection
    return config
