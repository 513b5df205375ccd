"""The database, SQLite or PostgreSQL: connected to, and refused when its tables are not those we know.

A new database gets its tables here. One of an earlier release is brought up to date by
:mod:`app.jobs.migrate`, which only the server and ``acromion restore`` do.
"""

import importlib
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event, inspect, select, text
from sqlalchemy.engine import make_url

from app.errors import DatabaseTooNew, DatabaseTooOld
from app.jobs.tables import REVISION, analyses, metadata, schema_revision

READ_ONLY = {"acromion_read_only": True}
_PREPARING = 0x6163726F  # any number of our own: who holds it prepares the tables
_PATIENCE_S = 10


def open_database(url: str) -> Engine:
    """Connect, and make the tables of a database that has none.

    Raises
    ------
    DatabaseTooOld, DatabaseTooNew
    """
    engine = connect(url)
    try:
        with engine.begin() as connection:
            lock_tables(connection)
            _check_revision(connection)
    except BaseException:
        engine.dispose()
        raise
    return engine


def bring_up_to_date(url: str, backups: Path) -> Path | None:
    """Migrate the tables of an earlier release; gives the copy of the rows that was made before.

    Only for the server, before it opens the database.
    """
    engine = connect(url)
    with engine.connect() as connection:
        older = is_older(connection)
    engine.dispose()
    return importlib.import_module("app.jobs.migrate").migrate(url, backups) if older else None


def connect(url: str) -> Engine:
    """Give an engine whose commits outlast a power cut."""
    if make_url(url).get_backend_name() != "sqlite":
        patience = {"connect_timeout": _PATIENCE_S}
        return create_engine(
            url, hide_parameters=True, pool_size=20, pool_pre_ping=True, connect_args=patience
        )
    engine = create_engine(url, hide_parameters=True)  # a log tells no subject code
    Path(str(engine.url.database)).parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    event.listen(engine, "connect", _prepare_sqlite)
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def lock_tables(connection: Connection) -> None:
    """Let one process at a time prepare the tables (SQLite's transaction has locked them already)."""
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _PREPARING})


def read_revision(connection: Connection) -> str | None:
    """Say which revision the tables are of; None when none was ever written down."""
    if not inspect(connection).has_table(schema_revision.name):
        return None
    return connection.execute(select(schema_revision.c.version_num)).scalar()


def is_older(connection: Connection) -> bool:
    """Tell whether there are tables, and of an earlier revision than ours."""
    found = read_revision(connection)
    if found is None:
        return inspect(connection).has_table(analyses.name)
    return found < REVISION


def create_tables(connection: Connection) -> None:
    """Make every table of today, and write down the revision."""
    metadata.create_all(connection)
    schema_revision.create(connection, checkfirst=True)
    connection.execute(schema_revision.delete())
    connection.execute(schema_revision.insert().values(version_num=REVISION))


def _check_revision(connection: Connection) -> None:
    found = read_revision(connection)
    if is_older(connection):
        raise DatabaseTooOld(found=found or "0000", needed=REVISION)
    if found is None:
        create_tables(connection)
    elif found > REVISION:
        raise DatabaseTooNew(found=found, needed=REVISION)


def _prepare_sqlite(connection: Any, _record: Any) -> None:
    """Make a commit durable through a power cut, and let nobody fail because another is writing.

    The time-out goes first: turning on WAL takes a lock that a peer starting up at once may hold.
    """
    connection.isolation_level = None  # transactions are begun by us, below
    cursor = connection.cursor()
    settings = ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "secure_delete=ON")
    for pragma in ("busy_timeout=30000", *settings):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def _begin_sqlite(connection: Connection) -> None:
    """Take the write lock at once, so that no transaction has to be given up half-way."""
    reads = connection.get_execution_options().get("acromion_read_only")
    connection.exec_driver_sql("BEGIN" if reads else "BEGIN IMMEDIATE")
