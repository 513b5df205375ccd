"""Room for the values of a whole recording, which grows without a second copy of them.

A day at 500 Hz takes more than a gigabyte. From 8 MiB on the values lie in a temporary file without a name,
mapped into memory: the system writes parts of it out when memory is short, and mostly never does. Where there
is no room on the disk, or the system has no such files, they stay in memory.
"""

import mmap
import os
import tempfile
import weakref
from typing import IO, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

LEAST_FILE_BYTES = 8 << 20
MOST_OF_FREE = 0.5
"""So much of what is free on the disk is taken at most."""
LARGE_FILES = "/var/tmp"  # noqa: S108 - the system's place for large temporary files; /tmp may be memory

Item = TypeVar("Item", np.float32, np.int64)


class Room(Generic[Item]):
    """Rows of a fixed width, filled from the first.

    ``values``: shape (rows,) or (rows, width). Every change of its length gives a new array; no view of the
    one before may be used any more.
    """

    def __init__(self, dtype: type[Item], rows: int, width: int | None = None) -> None:
        self._width = () if width is None else (width,)
        self._file: IO[bytes] | None = None
        self._is_in_file = False
        self.values: NDArray[Item] = np.empty((rows, *self._width), dtype)

    def resize(self, rows: int) -> None:
        """Make it hold ``rows``; the first keep their values, and those that are added have any."""
        if self._is_in_file and rows <= len(self.values):
            self.values = self.values[:rows]
        elif rows <= len(self.values) or not self._grow_in_file(rows):
            self._resize_in_memory(rows)

    def replace(self, values: NDArray[Item]) -> None:
        """Hold these, in the place of all."""
        self.values, self._is_in_file = values, False

    def _grow_in_file(self, rows: int) -> bool:
        """Grow in a file, where the values before may be already; False where that cannot be."""
        size_bytes = rows * self.values.itemsize * (self._width[0] if self._width else 1)
        if size_bytes < LEAST_FILE_BYTES or not hasattr(os, "posix_fallocate"):
            return False
        mapped = self._map(size_bytes)
        if mapped is None:
            return False
        grown = np.frombuffer(mapped, self.values.dtype).reshape((rows, *self._width))
        if not self._is_in_file:
            grown[: len(self.values)] = self.values
        self.values, self._is_in_file = grown, True
        return True

    def _map(self, size_bytes: int) -> mmap.mmap | None:
        """Map the file, with the room for it taken on the disk; None where there is none.

        Want of room that is found later, at the moment of writing, would end the process.
        """
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(dir=_find_folder())  # noqa: SIM115 - it is kept
                weakref.finalize(self, self._file.close)
            file = self._file.fileno()
            disk = os.fstatvfs(file)
            if size_bytes > MOST_OF_FREE * disk.f_bavail * disk.f_frsize:
                return None
            os.posix_fallocate(file, 0, size_bytes)
            return mmap.mmap(file, size_bytes)
        except OSError:
            return None

    def _resize_in_memory(self, rows: int) -> None:
        if self._is_in_file:
            self.replace(self.values.copy())
        self.values.resize((rows, *self._width), refcheck=False)  # reallocates in place


def _find_folder() -> str | None:
    """Return the folder of large temporary files; the one that ``TMPDIR`` names goes first."""
    is_usable = not os.environ.get("TMPDIR") and os.access(LARGE_FILES, os.W_OK)
    return LARGE_FILES if is_usable else None
