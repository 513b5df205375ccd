"""Migrate the tables of an earlier release, after a copy of every row, sealed.

This module imports Alembic: the server loads it only when there is something to migrate.
"""

from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection

import app.jobs.migrations
from app.jobs.database.connect import connect, is_older, lock_tables
from app.jobs.database.dump import write_rows_file
from app.jobs.database.seal_rows import COPIES_FOLDER, seal_row
from app.jobs.database.tables import REVISION
from app.settings import Settings
from app.storage.keys import open_keys
from app.storage.labels import LabelSealer


def migrate(settings: Settings) -> Path | None:
    """Migrate if the tables are older than ours; gives the copy that was made before, None if none was.

    The whole change is one transaction: after a crash the tables are the old ones or the new ones.

    Raises
    ------
    KeyFileMissing, KeyMismatch
        Nothing is changed: without the organisation's key the copy cannot be sealed.
    """
    engine, sealer = connect(settings.database_url), LabelSealer(open_keys(settings))
    try:
        with engine.connect() as connection:
            if not is_older(connection):
                return None
            stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
            copy = settings.data_dir / COPIES_FOLDER / f"rows-before-{REVISION}-{stamp}.zip"
            write_rows_file(connection, copy, partial(seal_row, sealer))
        with engine.begin() as connection:
            lock_tables(connection)
            upgrade(connection)
        return copy
    finally:
        engine.dispose()


def upgrade(connection: Connection, to: str = "head") -> None:
    """Run the migrations that are missing, in the transaction of the connection."""
    command.upgrade(configure(connection), to)


def configure(connection: Connection) -> Config:
    """Point Alembic at our migrations and at a connection."""
    config = Config()
    config.set_main_option("script_location", str(Path(app.jobs.migrations.__path__[0])))
    config.attributes["connection"] = connection
    return config
