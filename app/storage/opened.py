"""Copies of sealed files in clear, only as long as somebody of this machine reads them.

    root/opened/<hex>     0600; whoever reads it holds a lock on it

What a killed process left has no lock, and is removed by whoever looks next: the server at its start and each
minute, a worker before each job.
"""

import os
import secrets
import sys
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from app.storage.permissions import create_file
from app.storage.store import translate_disk_full

if sys.platform != "win32":
    import fcntl

UNHELD_S = 2.0
"""A file without a lock that is younger may be about to get one."""
UNLOCKED_TERM_S = 6 * 3600.0
"""Where there are no such locks, a copy that is older is nobody's."""


@dataclass(frozen=True, slots=True)
class OpenedFiles:
    """The folder of copies, and those that this process holds."""

    folder: Path
    _held: dict[Path, int] = field(default_factory=dict, repr=False)
    _guard: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def write(self, pieces: Iterable[bytes]) -> Path:
        """Write a copy, held until :meth:`release`.

        Raises
        ------
        DiskFull
        """
        path = self.folder / secrets.token_hex(8)
        with translate_disk_full():
            try:
                with create_file(path) as file:
                    self.hold(path)
                    file.writelines(pieces)
            except BaseException:
                self.release(path)
                raise
        return path

    def hold(self, path: Path) -> None:
        """Hold a file that is in the folder already."""
        handle = os.open(path, os.O_RDONLY)
        if sys.platform != "win32":
            fcntl.flock(handle, fcntl.LOCK_SH)
        with self._guard:
            self._held[path] = handle

    def release(self, path: Path) -> None:
        """Remove a copy."""
        path.unlink(missing_ok=True)
        with self._guard:
            handle = self._held.pop(path, None)
        if handle is not None:
            os.close(handle)

    def sweep(self) -> int:
        """Remove what nobody holds; gives the number."""
        return sum(self._remove_unheld(path) for path in tuple(self.folder.glob("*")))

    def _remove_unheld(self, path: Path) -> bool:
        with suppress(FileNotFoundError, BlockingIOError), path.open("rb") as file:
            age_s = abs(time.time() - os.fstat(file.fileno()).st_ctime)
            if age_s < (UNLOCKED_TERM_S if sys.platform == "win32" else UNHELD_S):
                return False
            if sys.platform != "win32":
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()
            return True
        return False
