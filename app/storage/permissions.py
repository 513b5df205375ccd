"""Files and folders that only the user who runs Acromion may read, whatever the umask.

Each is made with its mode at once. A folder that was given, and holds anything that is not ours, keeps its
mode.
"""

import os
import stat
import sys
from contextlib import suppress
from pathlib import Path
from typing import IO

FILE_MODE, FOLDER_MODE = 0o600, 0o700
OTHERS = 0o077

OUR_FOLDERS = frozenset(
    {
        "analyses",
        "backups",
        "cache",
        "fetched",
        "incoming",
        "inspections",
        "quarantine",
        "recordings",
        "uploads",
    }
)
OUR_FILES = frozenset({"server.id", "server.lock", "store.id"})
DATABASE_ENDINGS = ("", "-wal", "-shm", "-journal")
OUR_DATABASE = "acromion.sqlite3"


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it that are not there."""
    for place in (*reversed(folder.parents), folder):
        if place == folder or not place.exists():
            place.mkdir(mode=FOLDER_MODE, exist_ok=True)


def create_file(path: Path) -> IO[bytes]:
    """Make a file that is not there yet, and open it for reading and writing.

    Raises
    ------
    FileExistsError
    """
    return open(path, "x+b", opener=_open_private)  # Path.open knows no opener


def restrict_permissions(data_dir: Path, database: Path | None = None) -> None:
    """Put right what an earlier release, or a wide umask, left readable to others.

    Only what bears one of our names; the folder itself only when it holds nothing else. ``database``: the
    file of the rows, where they are in one.
    """
    ours = {*OUR_FILES, *OUR_FOLDERS, *_name_database(OUR_DATABASE)}
    held = list(data_dir.iterdir())
    if all(path.name in ours for path in held):
        _close(data_dir)
    for path in held:
        if path.name in ours:
            _close(path)
    for path in (data_dir / "backups").glob("rows-before-*.zip"):
        _close(path)
    for name in _name_database(database.name) if database else ():
        _close(database.with_name(name))  # type: ignore[union-attr]


def is_readable_by_others(path: Path) -> bool:
    """Tell whether anybody else may read it; False where there are no such modes, and for a link."""
    if sys.platform == "win32":
        return False
    mode = path.lstat().st_mode
    return not stat.S_ISLNK(mode) and bool(mode & OTHERS)


def _name_database(name: str) -> tuple[str, ...]:
    return tuple(f"{name}{ending}" for ending in DATABASE_ENDINGS)


def _close(path: Path) -> None:
    with suppress(FileNotFoundError, PermissionError):  # it may be another user's
        if is_readable_by_others(path):
            path.chmod(stat.S_IMODE(path.stat().st_mode) & ~OTHERS)


def _open_private(path: str, flags: int) -> int:
    return os.open(path, flags, FILE_MODE)
