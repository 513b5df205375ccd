"""The database, SQLite or PostgreSQL: connected to, and refused when its tables are not those we know.

A new database gets its tables here. One of an earlier release is brought up to date by
:mod:`app.jobs.database.migrate`, which only the server and ``acromion restore`` do.
"""

import importlib
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, NullPool, create_engine, event, inspect, select, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError

from app.errors import (
    AppError,
    DatabaseAway,
    DatabaseDamaged,
    DatabaseLocked,
    DatabaseTooNew,
    DatabaseTooOld,
    DiskFull,
)
from app.jobs.database.tables import REVISION, analyses, metadata, schema_revision
from app.settings import Settings
from app.storage.permissions import create_file, make_folder
from app.storage.store import check_folder, translate_folder_errors

READ_ONLY = {"acromion_read_only": True}
_PREPARING = 0x6163726F  # any number of our own: who holds it prepares the tables
_PATIENCE_S = 10
BUSY_S = 30
_WRITE_LOCK_BYTE = 120  # of SQLite's file "-shm" (sqlite.org/walformat.html, "WAL locks")
FULL_DISK = ("disk is full", "No space left")  # SQLite's words, and PostgreSQL's
DAMAGED = ("malformed", "not a database")
LOCKED = "database is locked"
UNWRITABLE = ("unable to open", "readonly database")
SQLITE_AWAY = (LOCKED, *UNWRITABLE, "disk I/O error")


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
    return importlib.import_module("app.jobs.database.migrate").migrate(url, backups) if older else None


def connect(url: str) -> Engine:
    """Give an engine whose commits outlast a power cut, and whose errors hold no subject code."""
    if make_url(url).get_backend_name() != "sqlite":
        patience = {"connect_timeout": _PATIENCE_S}
        return create_engine(
            url, pool_size=20, pool_pre_ping=True, connect_args=patience, hide_parameters=True
        )
    return _connect_sqlite(create_engine(url, hide_parameters=True))


def check_writable(url: str, patience_s: int) -> None:
    """See that rows could be written now; writes none, and waits no longer than ``patience_s`` for a lock.

    Raises
    ------
    DatabaseAway, DatabaseLocked, DatabaseDamaged, DiskFull
    """
    if make_url(url).get_backend_name() == "sqlite":
        engine = _connect_sqlite(create_engine(url, poolclass=NullPool))
        event.listen(engine, "connect", partial(_set_patience, patience_s))
    else:
        patience = {"connect_timeout": patience_s, "options": f"-c lock_timeout={patience_s}s"}
        engine = create_engine(url, poolclass=NullPool, connect_args=patience)
    with translate_database_errors(url), engine.begin() as connection:  # SQLite's write lock is taken here
        if connection.dialect.name == "postgresql":
            connection.execute(text("LOCK TABLE analyses IN ROW EXCLUSIVE MODE"))


def check_whole(url: str) -> None:
    """Read the whole file of a SQLite database, and see that it is in order; it is not changed.

    Raises
    ------
    DatabaseDamaged
    """
    if make_url(url).get_backend_name() != "sqlite" or not Path(_find_file(url)).exists():
        return
    engine = connect(url).execution_options(**READ_ONLY)
    try:
        with translate_database_errors(url), engine.connect() as connection:
            found = str(connection.exec_driver_sql("PRAGMA quick_check(1)").scalar())
    finally:
        engine.dispose()
    if found != "ok":
        raise DatabaseDamaged(file=_find_file(url), why=found.splitlines()[-1][:200])


@contextmanager
def translate_start_errors(settings: Settings) -> Iterator[None]:
    """Turn what keeps data folder or database from being opened into a refusal with a code."""
    with translate_folder_errors(settings.data_dir), translate_database_errors(settings.database_url):
        yield


@contextmanager
def translate_database_errors(url: str) -> Iterator[None]:
    """Turn an error of the database into a refusal with a code; let bugs through."""
    try:
        yield
    except DBAPIError as error:
        refusal = classify_error(error, url)
        if refusal is None:
            raise
        raise refusal from error


def classify_error(error: DBAPIError, url: str) -> AppError | None:
    """Tell a full disk, a damaged, a locked and an absent database from each other; None for a bug."""
    words = " ".join(str(error.orig).split())
    if any(sign in words for sign in FULL_DISK):
        return DiskFull()
    if not isinstance(error.orig, sqlite3.Error):
        return DatabaseAway(why=words[:300]) if _is_about_connection(error) else None
    if any(sign in words for sign in DAMAGED):
        return DatabaseDamaged(file=_find_file(url), why=words)
    if LOCKED in words:
        return _explain_lock(_find_file(url))
    if any(sign in words for sign in UNWRITABLE):
        return _explain_unwritable(Path(_find_file(url))) or DatabaseAway(why=words)
    return DatabaseAway(why=words) if any(sign in words for sign in SQLITE_AWAY) else None


def find_database_file(url: str) -> Path | None:
    """Say which file holds the rows; None where they are on a server."""
    parts = make_url(url)
    return Path(str(parts.database)) if parts.get_backend_name() == "sqlite" else None


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


def _create_private(path: Path) -> None:
    """Make the file of a new database; SQLite gives its log the same mode."""
    make_folder(path.parent)
    with suppress(OSError):  # it is there already, or SQLite says why it cannot be
        create_file(path).close()


def _is_about_connection(error: DBAPIError) -> bool:
    return isinstance(error, OperationalError | InterfaceError) or error.connection_invalidated


def _find_file(url: str) -> str:
    return str(make_url(url).database)


def _explain_unwritable(file: Path) -> AppError | None:
    try:
        check_folder(file.parent)
        with translate_folder_errors(file.parent), file.open("r+b"):
            return None
    except AppError as refusal:
        return refusal


def _explain_lock(file: str) -> DatabaseLocked:
    """Name the process that holds the write lock, where the system tells it (Linux)."""
    pid = _find_lock_holder(Path(f"{file}-shm"))
    return DatabaseLocked(file=file, pid=str(pid)) if pid else DatabaseLocked(file=file)


def _find_lock_holder(file: Path) -> int | None:
    """Look the holder up in the system's list; opening the file ourselves could let go of locks of ours."""
    try:
        inode = file.stat().st_ino
        rows = [line.split() for line in Path("/proc/locks").read_text().splitlines() if "->" not in line]
    except OSError:
        return None
    ours = [row for row in rows if row[5].endswith(f":{inode}") and row[6] == str(_WRITE_LOCK_BYTE)]
    return int(ours[0][4]) if ours and int(ours[0][4]) > 0 else None


def _connect_sqlite(engine: Engine) -> Engine:
    _create_private(Path(str(engine.url.database)))
    event.listen(engine, "connect", _prepare_sqlite)
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def _set_patience(patience_s: int, connection: Any, _record: Any) -> None:
    connection.execute(f"PRAGMA busy_timeout={1000 * patience_s}").close()


def _prepare_sqlite(connection: Any, _record: Any) -> None:
    """Make a commit durable through a power cut, and let nobody fail because another is writing.

    The time-out goes first: turning on WAL takes a lock that a peer starting up at once may hold.
    """
    connection.isolation_level = None  # transactions are begun by us, below
    cursor = connection.cursor()
    settings = ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "secure_delete=ON")
    for pragma in (f"busy_timeout={1000 * BUSY_S}", *settings):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def _begin_sqlite(connection: Connection) -> None:
    """Take the write lock at once, so that no transaction has to be given up half-way."""
    reads = connection.get_execution_options().get("acromion_read_only")
    connection.exec_driver_sql("BEGIN" if reads else "BEGIN IMMEDIATE")
