"""The place that a command of operations works on: whether it holds anything, and a line in its audit log."""

from contextlib import suppress

from sqlalchemy.exc import SQLAlchemyError

from app.accounts.accounts import MARKER
from app.errors import NotHere
from app.library.audit_log import AT_MACHINE, Act, record
from app.library.database.connect import connect, read_revision
from app.library.database.tables import REVISION
from app.settings import Settings
from app.store.open import open_storage

_KEPT = ("acromion.sqlite3", MARKER, "recordings")
"""What a folder that was ever used has one of."""


def check_used(settings: Settings) -> None:
    """Check that something was ever kept here. To look makes nothing. Raises NotHere."""
    if not is_used(settings):
        raise NotHere(id=str(settings.data_dir))


def check_recoverable(settings: Settings) -> None:
    """Check that something is left here, even if the database is lost.

    Raises NotHere: nothing is in the folder, the database or the bucket.
    """
    is_there = _is_folder_used(settings) or is_used(settings)
    if not is_there and not (settings.object_store and open_storage(settings).find_recordings()):
        raise NotHere(id=str(settings.data_dir))


def is_used(settings: Settings) -> bool:
    """Return whether anything was ever kept here; to look makes nothing."""
    if settings.database_url.startswith("sqlite"):
        return _is_folder_used(settings)
    engine = connect(settings.database_url)
    try:
        with engine.connect() as connection:
            has_tables = read_revision(connection) is not None
    finally:
        engine.dispose()
    return has_tables and (bool(settings.object_store) or _is_folder_used(settings))


def _is_folder_used(settings: Settings) -> bool:
    folder = settings.data_dir
    return folder.is_file() or any((folder / name).exists() for name in _KEPT)  # a file is named as one later


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
