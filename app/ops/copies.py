"""Daily copies of the database, and the lifetime of backups: a lost database costs at most a day.

 data_dir/copies/rows-<number>.sqlite3     a whole database without sessions; the newest seven are kept

SQLite only: PostgreSQL has its own dump. ``acromion recover`` starts with the newest copy and updates its
rows from the side files. A purge deletes every copy, and writes a new one without the purged data.
"""

import json
import logging
import shutil
import sqlite3
import threading
import time
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Literal

from sqlalchemy import Engine, create_engine, select
from sqlalchemy.exc import DBAPIError

from acromion.app.errors import DiskFull
from acromion.app.library.database.connect import (
    FULL_DISK,
    LEFT_OUT,
    find_database_file,
    read_revision,
    translate_database_errors,
)
from acromion.app.library.database.tables import REVISION, recordings
from acromion.app.library.recordings import delete_recording
from acromion.app.library.rows import PURGING
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage, sync_file, sync_folder, translate_disk_full
from acromion.app.store.permissions import create_file, make_folder

FOLDER = "copies"
KEPT = 7
DAY_S = 24 * 3600.0
logger = logging.getLogger(__name__)
_turn = threading.Lock()
"""A purge and the daily copy of one server take turns: no copy from before a purge appears after it."""


def find_copies(settings: Settings) -> tuple[Path, ...]:
    """Return the copies, oldest first."""
    return tuple(sorted((settings.data_dir / FOLDER).glob("rows-*.sqlite3")))


def keep_daily_copy(settings: Settings, engine: Engine) -> None:
    """Write a copy if the newest one is older than 24 hours. Raises DiskFull, OSError."""
    with _turn:
        copies = find_copies(settings)
        if copies and abs(time.time() - copies[-1].stat().st_mtime) < DAY_S:
            return
        _write(settings, engine)
        for old in find_copies(settings)[:-KEPT]:
            old.unlink(missing_ok=True)


def renew_copies(settings: Settings, engine: Engine) -> None:
    """Delete every copy, and write a new one without recordings that are being purged.

    On a full disk :func:`keep_daily_copy` writes the new copy later. Raises OSError if the purge is
    unfinished: call this again before its last rows are deleted.
    """
    if engine.dialect.name != "sqlite":
        return
    with _turn:
        folder = settings.data_dir / FOLDER
        for path in folder.glob("rows-*"):  # includes a half-written one
            path.unlink()
        if folder.is_dir():
            sync_folder(folder)
        try:
            _write(settings, engine)
        except DiskFull:
            logger.warning("the disk is full: no copy of the rows could be written")


def restore_copy(settings: Settings) -> str:
    """Replace a lost database by the newest intact copy; return its date, "" if nothing was done.

    A database without a recording or person, as a failed start creates it, counts as lost.
    """
    file = find_database_file(settings.database_url)
    if file is None or _holds_rows(Path(file)):
        return ""
    copy = next(filter(_is_whole, reversed(find_copies(settings))), None)
    if copy is None:
        return ""
    place = Path(file)
    for ending in ("-wal", "-shm", "-journal"):  # of the lost database
        place.with_name(f"{place.name}{ending}").unlink(missing_ok=True)
    part = place.with_name(f"{place.name}.part")
    part.unlink(missing_ok=True)
    with translate_disk_full(), copy.open("rb") as source, create_file(part) as target:
        shutil.copyfileobj(source, target)
    sync_file(part)
    part.replace(place)
    sync_folder(place.parent)
    made = datetime.fromtimestamp(copy.stat().st_mtime, UTC)
    return made.isoformat(sep=" ", timespec="minutes").removesuffix("+00:00")


def _is_whole(copy: Path) -> bool:
    """Return whether a copy is completely readable and has the tables of this version."""
    engine, is_whole = create_engine(f"sqlite:///{copy}"), False
    try:
        with engine.connect() as connection:
            is_intact = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar() == "ok"
            is_whole = is_intact and read_revision(connection) == REVISION
    except DBAPIError:
        pass
    finally:
        engine.dispose()
    if not is_whole:
        logger.warning("%s is damaged or from another version, and is not used", copy)
    return is_whole


def _holds_rows(database: Path) -> bool:
    if not database.exists() or not database.stat().st_size:
        return False
    with closing(sqlite3.connect(database)) as connection:
        known = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
        asked = known.intersection(("recordings", "people", "webhooks"))
        return any(connection.execute(f"SELECT 1 FROM {name} LIMIT 1").fetchone() for name in sorted(asked))  # noqa: S608


def _write(settings: Settings, engine: Engine) -> None:
    if engine.dialect.name != "sqlite":
        return
    folder = settings.data_dir / FOLDER
    make_folder(folder)
    copies = find_copies(settings)
    number = int(copies[-1].stem.rpartition("-")[2]) + 1 if copies else 1
    part, copy = folder / "rows-new.part", folder / f"rows-{number:06d}.sqlite3"
    for left in folder.glob(f"{part.name}*"):
        left.unlink()
    try:
        with translate_disk_full(), translate_database_errors(f"sqlite:///{part}"):
            create_file(part).close()
            with closing(engine.raw_connection()) as connection:
                _vacuum_into(connection.cursor(), part)
            _leave_out(part)
            sync_file(part)
            part.rename(copy)
            sync_folder(folder)
    finally:
        part.unlink(missing_ok=True)


def _vacuum_into(cursor: Any, part: Path) -> None:
    try:
        cursor.execute("VACUUM INTO ?", (str(part),))
    except sqlite3.OperationalError as error:
        raise (
            DiskFull() if any(sign in str(error) for sign in FULL_DISK) else OSError(str(error))
        ) from error


def _leave_out(part: Path) -> None:
    """Delete sessions and the rows of recordings that are being purged; overwrite their bytes."""
    engine = create_engine(f"sqlite:///{part}")
    try:
        with engine.connect() as connection:
            connection.exec_driver_sql("PRAGMA secure_delete=ON")
            connection.exec_driver_sql("PRAGMA foreign_keys=ON")
            known = set(connection.exec_driver_sql("SELECT name FROM sqlite_master").scalars())
            for table in known.intersection(LEFT_OUT):
                connection.exec_driver_sql(f'DELETE FROM "{table}"')  # noqa: S608
            purging = select(recordings.c.id).where(recordings.c.state == PURGING)
            for recording_id in connection.execute(purging).scalars().all():
                delete_recording(connection, recording_id)
            connection.commit()
    finally:
        engine.dispose()


# How long backups can contain erased data: ``acromion backup`` records it.
#
#     backups.json    {"keep": number of kept backups or null, "made_at": [times of the kept backups]}
#
# After a backup without ``--keep``, which nothing deletes, ``keep`` stays null: delete that backup, then this
# file.


BACKUPS_FILE = "backups.json"
USUAL = timedelta(days=1)
"""Assumed time between two backups if only one is known."""


@dataclass(frozen=True, slots=True)
class BackupTerm:
    """``none``: no backup is known; ``until`` a date; ``unlimited``: nothing deletes old backups."""

    kind: Literal["none", "until", "unlimited"]
    until: str = ""


def record_backup(storage: Storage, keep: int | None) -> None:
    """Record that a backup was made."""
    kept, before = _read(storage)
    if before and kept is None:
        keep = None
    made_at = [*before, datetime.now(UTC).isoformat(timespec="seconds")]
    content = {"keep": keep, "made_at": made_at[-(keep or 2) :]}
    storage.write_small(BACKUPS_FILE, json.dumps(content).encode())


def find_backup_term(storage: Storage) -> BackupTerm:
    """Return until when backups can contain data erased now.

    The newest backup is deleted after as many further backups as are kept, at the known pace and at most one
    a day.
    """
    keep, made_at = _read(storage)
    if not made_at:
        return BackupTerm("none")
    if keep is None:
        return BackupTerm("unlimited")
    moments = [datetime.fromisoformat(one) for one in made_at]
    between = (moments[-1] - moments[0]) / (len(moments) - 1) if len(moments) > 1 else USUAL
    return BackupTerm("until", (moments[-1] + keep * max(between, USUAL) + USUAL).date().isoformat())


def find_newest_backup(storage: Storage) -> datetime | None:
    """Return when the newest known backup was made; None if none is known."""
    _, made_at = _read(storage)
    return datetime.fromisoformat(made_at[-1]) if made_at else None


def _read(storage: Storage) -> tuple[int | None, list[str]]:
    """Return how many backups are kept, and when they were made; nothing of a file that is not ours."""
    try:
        found = json.loads(storage.read_small(BACKUPS_FILE) or b"{}")
        made_at = [datetime.fromisoformat(one).isoformat() for one in found.get("made_at", ())]
        keep = found.get("keep")
        return keep if keep is None else int(keep), made_at
    except (ValueError, TypeError, AttributeError):
        return None, []
