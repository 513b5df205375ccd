"""Migrate the tables of an earlier release, after a copy of every row.

This module imports Alembic: the server loads it only when there is something to migrate.
"""

from datetime import UTC, datetime
from pathlib import Path

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection

import app.jobs.migrations
from app.jobs.database.connect import connect, is_older, lock_tables
from app.jobs.database.dump import write_rows_file
from app.jobs.database.tables import REVISION


def migrate(url: str, backups: Path) -> Path | None:
    """Migrate if the tables are older than ours; gives the copy that was made before, None if none was.

    The whole change is one transaction: after a crash the tables are the old ones or the new ones.
    """
    engine = connect(url)
    try:
        with engine.connect() as connection:
            if not is_older(connection):
                return None
            stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S%f")
            copy = backups / f"rows-before-{REVISION}-{stamp}.zip"
            write_rows_file(connection, copy)
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
