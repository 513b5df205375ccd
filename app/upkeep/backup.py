"""A backup: one ZIP with every row and every file, made while the server runs.

    manifest.json            {"format": "acromion.backup/1", "revision", "version", "made_at"}
    rows/<table>.jsonl       one row a line, as one moment saw them all
    files/recordings/<id>    files/analyses/<analysis>/<attempt>/<name>

Files never change once a row promises them, so those of the moment's rows can be copied afterwards. One
that was deleted meanwhile makes the backup start again. Later releases read the format: rows are put
into tables of the backup's own revision, which are then migrated.
"""

import hashlib
import json
import shutil
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from sqlalchemy import Connection, insert, select

from app.errors import BackupRefused, DatabaseTooNew, NotEmpty
from app.jobs.database import READ_ONLY, connect, create_tables, lock_tables, read_revision
from app.jobs.migrate import upgrade
from app.jobs.rows import read_rows, reflect_tables, write_all_rows
from app.jobs.tables import REVISION, recordings, schema_revision
from app.settings import Settings
from app.storage import FolderLock, hash_file, name_full_disk, sync_file, sync_folder
from app.stores import open_storage
from app.upkeep.files import KeptFile, list_files
from app.version import software_version

FORMAT = "acromion.backup/1"
TRIES = 3


def back_up(settings: Settings, path: Path) -> int:
    """Write a backup, whole or not at all; gives the number of files in it.

    Raises
    ------
    BackupRefused
        When ``path`` exists, or files were deleted under our hands three times over.
    DiskFull
    """
    if path.exists():
        raise BackupRefused(why=f"{path} exists")
    part = path.with_name(f"{path.name}.part")
    try:
        for _ in range(TRIES):
            try:
                return _write(settings, part, path)
            except FileNotFoundError as error:
                missing = str(error)
        raise BackupRefused(why=missing)
    finally:
        part.unlink(missing_ok=True)


def _write(settings: Settings, part: Path, path: Path) -> int:
    with name_full_disk():
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
            _write_rows(settings, archive)
            number = _write_files(settings, archive)
        sync_file(part)
        part.rename(path)
        sync_folder(path.resolve().parent)
    return number


def _write_rows(settings: Settings, archive: zipfile.ZipFile) -> None:
    """Write all rows as one transaction sees them."""
    engine = connect(settings.database_url).execution_options(**READ_ONLY)
    if engine.dialect.name == "postgresql":
        engine = engine.execution_options(isolation_level="REPEATABLE READ")
    try:
        with engine.connect() as connection:
            manifest = {
                "format": FORMAT,
                "revision": read_revision(connection),
                "version": software_version(),
                "made_at": datetime.now(UTC).isoformat(timespec="seconds"),
            }
            archive.writestr("manifest.json", json.dumps(manifest, indent=1))
            write_all_rows(connection, archive)
    finally:
        engine.dispose()


def _write_files(settings: Settings, archive: zipfile.ZipFile) -> int:
    storage, number = open_storage(settings), 0
    storage.prepare()
    for file in _list_promised(archive):
        path = file.fetch(storage)
        try:
            archive.write(path, f"files/{file.name}", zipfile.ZIP_STORED)
        finally:
            storage.give_back(path)
        number += 1
    return number


def _list_promised(archive: zipfile.ZipFile) -> Iterator[KeptFile]:
    tables = ("recordings", "analyses", "result_files")
    return list_files(*(tuple(read_rows(archive, table)) for table in tables))


@contextmanager
def open_backup(path: Path) -> Iterator[tuple[zipfile.ZipFile, str]]:
    """Open a backup; gives it with the revision of its tables.

    Raises
    ------
    BackupRefused, DatabaseTooNew
    """
    try:
        with zipfile.ZipFile(path) as archive:
            manifest = json.loads(archive.read("manifest.json"))
            if manifest["format"] != FORMAT:
                raise BackupRefused(why=str(manifest["format"])[:80])
            if manifest["revision"] > REVISION:
                raise DatabaseTooNew(found=manifest["revision"], needed=REVISION)
            yield archive, manifest["revision"]
    except (zipfile.BadZipFile, KeyError, ValueError, OSError) as error:
        raise BackupRefused(why=str(error)[:200]) from error


def find_damage(path: Path) -> tuple[int, tuple[str, ...]]:
    """Count the files of a backup, and name those that are absent or not what their row says.

    Raises
    ------
    BackupRefused, DatabaseTooNew
    """
    with open_backup(path) as (archive, _):
        files = tuple(_list_promised(archive))
        return len(files), tuple(file.name for file in files if not _is_whole(archive, file))


def _is_whole(archive: zipfile.ZipFile, file: KeptFile) -> bool:
    try:
        with archive.open(f"files/{file.name}") as member:
            digest = hashlib.file_digest(member, "sha256")  # type: ignore[arg-type]
    except (KeyError, zipfile.BadZipFile):
        return False
    return digest.hexdigest() == file.sha256


def restore(settings: Settings, path: Path) -> int:
    """Put a backup into an empty database and store; gives the number of files.

    Files go first, then all rows in one transaction: a restore cut short has brought nothing that anybody
    sees, and may be done again. Analyses that ran when the backup was made wait again.

    Raises
    ------
    BackupRefused, DatabaseTooNew, NotEmpty, FolderTaken, DiskFull
    """
    settings.data_dir.mkdir(parents=True, exist_ok=True, mode=0o700)
    lock, engine = FolderLock(settings.data_dir), connect(settings.database_url)
    try:
        with open_backup(path) as (archive, revision), engine.begin() as connection:
            lock_tables(connection)
            _check_empty(connection)
            number = _restore_files(settings, archive)
            _restore_rows(connection, archive, revision)
        return number
    finally:
        engine.dispose()
        lock.release()


def _check_empty(connection: Connection) -> None:
    if read_revision(connection) is None:
        return
    number = len(connection.execute(select(recordings.c.id)).all())
    if number:
        raise NotEmpty(number=number)
    for table in reversed(reflect_tables(connection)):
        table.drop(connection)
    schema_revision.drop(connection)


def _restore_files(settings: Settings, archive: zipfile.ZipFile) -> int:
    storage, number = open_storage(settings), 0
    storage.prepare()
    part = settings.data_dir / "uploads" / "restored.part"
    for file in _list_promised(archive):
        with name_full_disk(), archive.open(f"files/{file.name}") as member, part.open("wb") as copy:
            shutil.copyfileobj(member, copy)
        if hash_file(part) != file.sha256:
            raise BackupRefused(why=f"{file.name}: SHA-256")
        storage.put(part, file.name)
        number += 1
    part.unlink(missing_ok=True)
    return number


def _restore_rows(connection: Connection, archive: zipfile.ZipFile, revision: str) -> None:
    if revision == REVISION:
        create_tables(connection)
    else:
        upgrade(connection, to=revision)
    for table in reflect_tables(connection):
        rows = [_settle(table.name, row) for row in read_rows(archive, table.name)]
        kept = [row for row in rows if row.get("name") != "store" or table.name != "facts"]
        if kept:
            connection.execute(insert(table), kept)
    if revision != REVISION:
        upgrade(connection)


def _settle(table: str, row: dict[str, object]) -> dict[str, object]:
    """Let an analysis that ran wait again, uncounted: whoever ran it is not here."""
    if table == "analyses" and row["state"] == "running":
        attempts = int(str(row["attempts"])) - 1
        return row | {"state": "queued", "token": None, "stage": None, "progress": 0.0, "attempts": attempts}
    return row
