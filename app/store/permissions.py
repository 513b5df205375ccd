"""Files and folders that only the user who runs Acromion may read, regardless of the umask.

Each is created with its final mode. A given folder that contains other files keeps its mode.
"""

import os
import stat
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import IO

FILE_MODE, FOLDER_MODE = 0o600, 0o700
OTHERS = 0o077

OUR_FOLDERS = frozenset(
    {"analyses", "cache", "copies", "incoming", "inspections", "live", "quarantine", "recordings", "uploads"}
)
OUR_FILES = frozenset(
    {
        "backups.json",
        "erasures.jsonl",
        "has_accounts",
        "open.html",
        "reserve",
        "secret",
        "server.key",
        "server.lock",
        "store.id",
    }
)
DATABASE_ENDINGS = ("", "-wal", "-shm", "-journal")
OUR_DATABASE = "acromion.sqlite3"


def restrict_new_files() -> None:
    """Make every file of this process and its children private, also files that libraries write."""
    os.umask(OTHERS)


def make_folder(folder: Path) -> None:
    """Create a folder, and missing folders above it."""
    for place in (*reversed(folder.parents), folder):
        if place == folder or not place.exists():
            place.mkdir(mode=FOLDER_MODE, exist_ok=True)


def create_file(path: Path) -> IO[bytes]:
    """Create a file that does not exist yet, and open it for reading and writing. Raises FileExistsError."""
    return open(path, "x+b", opener=partial(os.open, mode=FILE_MODE))  # Path.open has no opener


def restrict_permissions(data_dir: Path, database: Path | None = None) -> None:
    """Remove permissions that a wide umask gave to other users.

    Only files and folders with one of our names are changed; the data folder itself only if it contains
    nothing else. ``database`` is the database file, if there is one.
    """
    ours = {*OUR_FILES, *OUR_FOLDERS, *(f"{OUR_DATABASE}{ending}" for ending in DATABASE_ENDINGS)}
    held = list(data_dir.iterdir())
    if all(path.name in ours for path in held):
        _restrict(data_dir)
    for path in held:
        if path.name in ours:
            _restrict(path)
    if database is not None:
        for ending in DATABASE_ENDINGS:
            _restrict(database.with_name(f"{database.name}{ending}"))


def is_readable_by_others(path: Path) -> bool:
    """Return whether other users may read it; False for a link, and on systems without such modes."""
    if sys.platform == "win32":
        return False
    mode = path.lstat().st_mode
    return not stat.S_ISLNK(mode) and bool(mode & OTHERS)


def _restrict(path: Path) -> None:
    with suppress(FileNotFoundError, PermissionError):  # it may be another user's
        if is_readable_by_others(path):
            path.chmod(stat.S_IMODE(path.stat().st_mode) & ~OTHERS)
