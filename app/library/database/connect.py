"""Connect to the database, SQLite or PostgreSQL; reject tables of another revision.

A new database gets its tables here. Only the server migrates (:mod:`acromion.app.library.migrations`).
"""

import base64
import importlib
import json
import sqlite3
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import (
    Connection,
    Engine,
    MetaData,
    NullPool,
    Table,
    create_engine,
    event,
    inspect,
    select,
    text,
)
from sqlalchemy.engine import make_url
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError

from acromion.app.errors import AppError, DatabaseAway, DatabaseDamaged, DatabaseLocked, DiskFull, WrongSchema
from acromion.app.library.audit_log import attach_audit_log
from acromion.app.library.database.tables import REVISION, analyses, metadata, schema_revision
from acromion.app.settings import Settings
from acromion.app.store.folder import check_folder, translate_folder_errors
from acromion.app.store.permissions import create_file, make_folder

READ_ONLY = {"acromion_read_only": True}
_TABLES_LOCK = 0x6163726F  # arbitrary number of the advisory lock for creating tables
_REQUEST_LOCK = 0x61637271  # advisory lock for finding or adding a requested analysis
_CONNECT_TIMEOUT_S = 10
BUSY_TIMEOUT_S = 30
_WRITE_LOCK_BYTE = 120  # in SQLite's file "-shm" (sqlite.org/walformat.html, "WAL locks")
# Words of SQLite's messages, and of PostgreSQL's for a full disk.
FULL_DISK = ("disk is full", "No space left")
DAMAGED = ("malformed", "not a database")
LOCKED = "database is locked"
UNWRITABLE = ("unable to open", "readonly database")


def open_database(url: str) -> Engine:
    """Connect, and create the tables of an empty database. Raises WrongSchema."""
    engine = connect(url)
    try:
        with engine.begin() as connection:
            lock_tables(connection)
            found = read_revision(connection)
            if found is None and not inspect(connection).has_table(analyses.name):
                create_tables(connection)
            elif found != REVISION:
                raise WrongSchema(found=found or "-", needed=REVISION)
    except BaseException:
        engine.dispose()
        raise
    return engine


def bring_up_to_date(settings: Settings) -> None:
    """Migrate tables of an earlier revision.

    Only for the server and the recovery, before they open the database. Raises WrongSchema.
    """
    engine = connect(settings.database_url)
    try:
        with engine.begin() as connection:
            lock_tables(connection)
            found = read_revision(connection)
            if found not in (None, REVISION):
                importlib.import_module("acromion.app.library.migrations").upgrade(connection, found)
    finally:
        engine.dispose()


def connect(url: str) -> Engine:
    """Return an engine whose commits survive a power failure and include their lines of the audit log.

    Its errors contain no subject code.
    """
    if make_url(url).get_backend_name() == "sqlite":
        engine = _connect_sqlite(create_engine(url, hide_parameters=True))
    else:
        timeout = {"connect_timeout": _CONNECT_TIMEOUT_S}
        engine = create_engine(
            url, pool_size=20, pool_pre_ping=True, connect_args=timeout, hide_parameters=True
        )
    attach_audit_log(engine)
    return engine


def check_writable(url: str, timeout_s: int) -> None:
    """Check that rows could be written, without writing; wait at most ``timeout_s`` for a lock.

    Raises DatabaseAway, DatabaseLocked, DatabaseDamaged, DiskFull.
    """
    if make_url(url).get_backend_name() == "sqlite":
        engine = _connect_sqlite(create_engine(url, poolclass=NullPool))
        event.listen(engine, "connect", partial(_set_busy_timeout, timeout_s))
    else:
        chosen = make_url(url).query.get("options", "")
        timeouts = {"connect_timeout": timeout_s, "options": f"{chosen} -c lock_timeout={timeout_s}s"}
        engine = create_engine(url, poolclass=NullPool, connect_args=timeouts)
    with translate_database_errors(url), engine.begin() as connection:  # takes SQLite's write lock
        if connection.dialect.name == "postgresql":
            connection.execute(text("LOCK TABLE analyses IN ROW EXCLUSIVE MODE"))


def check_whole(url: str) -> None:
    """Check the whole file of a SQLite database without changing it. Raises DatabaseDamaged."""
    file = find_database_file(url)
    if file is None or not Path(file).exists():
        return
    engine = connect(url).execution_options(**READ_ONLY)
    try:
        with translate_database_errors(url), engine.connect() as connection:
            found = str(connection.exec_driver_sql("PRAGMA quick_check(1)").scalar())
    finally:
        engine.dispose()
    if found != "ok":
        raise DatabaseDamaged(file=file, why=found.splitlines()[-1][:200])


@contextmanager
def translate_start_errors(settings: Settings) -> Iterator[None]:
    """Convert an error from opening data folder or database to a refusal with a code."""
    with translate_folder_errors(settings.data_dir), translate_database_errors(settings.database_url):
        yield


@contextmanager
def translate_database_errors(url: str) -> Iterator[None]:
    """Convert an error of the database to a refusal with a code; bugs pass unchanged."""
    try:
        yield
    except DBAPIError as error:
        refusal = classify_error(error, url)
        if refusal is None:
            raise
        raise refusal from error


def classify_error(error: DBAPIError, url: str) -> AppError | None:
    """Classify an error: full disk, damaged, locked or unreachable database; None for a bug."""
    words = " ".join(str(error.orig).split())
    if any(sign in words for sign in FULL_DISK):
        return DiskFull()
    if not isinstance(error.orig, sqlite3.Error):
        is_about_connection = isinstance(error, OperationalError | InterfaceError)
        return DatabaseAway(why=words[:300]) if is_about_connection or error.connection_invalidated else None
    file = str(find_database_file(url))
    if any(sign in words for sign in DAMAGED):
        return DatabaseDamaged(file=file, why=words)
    if LOCKED in words:
        pid = _find_lock_holder(Path(f"{file}-shm"))
        return DatabaseLocked(file=file, pid=str(pid)) if pid else DatabaseLocked(file=file)
    if any(sign in words for sign in UNWRITABLE):
        return _explain_unwritable(Path(file)) or DatabaseAway(why=words)
    return DatabaseAway(why=words) if "disk I/O error" in words else None


def find_database_file(url: str) -> str | None:
    """Return the path of the SQLite file; None for a database server."""
    parts = make_url(url)
    return str(parts.database) if parts.get_backend_name() == "sqlite" else None


def lock_tables(connection: Connection, lock: int = _TABLES_LOCK) -> None:
    """Lock the creation of tables, or the search for a requested analysis, until the transaction ends.

    ``lock`` identifies other work. SQLite's transaction has already locked the database.
    """
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": lock})


@contextmanager
def lock_requests(engine: Engine) -> Iterator[None]:
    """Allow only one server of a PostgreSQL database at a time to find or add an analysis.

    SQLite has only one server, whose requests already take turns.
    """
    if engine.dialect.name != "postgresql":
        yield
        return
    with engine.begin() as connection:
        lock_tables(connection, _REQUEST_LOCK)
        yield


def read_revision(connection: Connection) -> str | None:
    """Return the revision of the tables; None if it was never recorded."""
    if not inspect(connection).has_table(schema_revision.name):
        return None
    return connection.execute(select(schema_revision.c.version_num)).scalar()


def create_tables(connection: Connection) -> None:
    """Create every table, and record the revision."""
    metadata.create_all(connection)
    schema_revision.create(connection, checkfirst=True)
    connection.execute(schema_revision.delete())
    connection.execute(schema_revision.insert().values(version_num=REVISION))


def _explain_unwritable(file: Path) -> AppError | None:
    try:
        check_folder(file.parent)
        with translate_folder_errors(file.parent), file.open("r+b"):
            return None
    except AppError as refusal:
        return refusal


def _find_lock_holder(file: Path) -> int | None:
    """Find the process that holds the write lock (Linux).

    This reads the system's list, because opening and closing the file would release our locks.
    """
    try:
        inode = file.stat().st_ino
        rows = [line.split() for line in Path("/proc/locks").read_text().splitlines() if "->" not in line]
    except OSError:
        return None
    ours = [row for row in rows if row[5].endswith(f":{inode}") and row[6] == str(_WRITE_LOCK_BYTE)]
    return int(ours[0][4]) if ours and int(ours[0][4]) > 0 else None


def _connect_sqlite(engine: Engine) -> Engine:
    """Prepare each connection; create a new database file with our mode, which SQLite also gives its log."""
    file = Path(str(engine.url.database))
    make_folder(file.parent)
    with suppress(OSError):  # it exists already, or SQLite reports the error
        create_file(file).close()
    event.listen(engine, "connect", _prepare_sqlite)
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def _set_busy_timeout(timeout_s: int, connection: Any, _record: Any) -> None:
    connection.execute(f"PRAGMA busy_timeout={1000 * timeout_s}").close()


def _prepare_sqlite(connection: Any, _record: Any) -> None:
    """Make commits survive a power failure, and wait for other writers instead of failing.

    The timeout is set first, because turning on WAL takes a lock that another starting process may have.
    """
    connection.isolation_level = None  # _begin_sqlite starts the transactions
    # SQLite's function supports ASCII only
    connection.create_function("lower", 1, lambda text: text and text.lower(), deterministic=True)
    cursor = connection.cursor()
    settings = ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "secure_delete=ON")
    for pragma in (f"busy_timeout={1000 * BUSY_TIMEOUT_S}", *settings):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def _begin_sqlite(connection: Connection) -> None:
    """Take the write lock at once, so that no transaction fails half-way."""
    only_reads = connection.get_execution_options().get("acromion_read_only")
    connection.exec_driver_sql("BEGIN" if only_reads else "BEGIN IMMEDIATE")


# The rows of a backup.

ROWS_AT_ONCE = 1000
LEFT_OUT = ("sessions", "tickets", "tries", "known_browsers")
"""Short-lived rows that are not copied: everyone must sign in again."""


def reflect_tables(connection: Connection) -> tuple[Table, ...]:
    """Return our tables as they are in this database, referenced tables first.

    Other tables are neither read nor changed.
    """
    found = MetaData()
    found.reflect(connection, only=lambda name, _: name in metadata.tables)
    return tuple(table for table in found.sorted_tables if table.name in metadata.tables)


def _write_bytes(value: object) -> dict[str, str]:
    if not isinstance(value, bytes | memoryview):
        raise TypeError(type(value).__name__)
    return {"base64": base64.b64encode(value).decode()}


def _read_bytes(value: dict[str, Any]) -> object:
    return base64.b64decode(value["base64"]) if value.keys() == {"base64"} else value


def write_all_rows(connection: Connection, archive: zipfile.ZipFile) -> None:
    """Write each copied table as a separate member ``rows/<table>.jsonl``."""
    tables = [table for table in reflect_tables(connection) if table.name not in LEFT_OUT]
    streamed = connection.execution_options(yield_per=ROWS_AT_ONCE)
    for table in tables:
        with archive.open(f"rows/{table.name}.jsonl", "w", force_zip64=True) as member:
            for row in streamed.execute(table.select().order_by(*table.primary_key.columns)):
                line = json.dumps(row._asdict(), ensure_ascii=False, default=_write_bytes)
                member.write(line.encode() + b"\n")


def read_rows(archive: zipfile.ZipFile, table: str) -> Iterator[dict[str, Any]]:
    """Return the rows of a table in a backup; none if the backup has no such table."""
    name = f"rows/{table}.jsonl"
    if name in archive.namelist():
        with archive.open(name) as member:
            for line in member:
                yield json.loads(line, object_hook=_read_bytes)


def reset_row(table: str, row: dict[str, Any]) -> dict[str, Any]:
    """Reset values that are only valid at the origin: running analyses and written side files."""
    if table == "recordings" and "side_revision" in row:
        return row | {"side_revision": 0}
    if table == "audit_log":  # numbered again, in order
        return {name: value for name, value in row.items() if name != "seq"}
    if table == "analyses" and row["state"] == "running":
        attempts = int(row["attempts"]) - 1
        return row | {"state": "queued", "token": None, "stage": None, "progress": 0.0, "attempts": attempts}
    return row
