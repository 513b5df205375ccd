"""Samples while they are being read: columns that grow in place and are written once."""

import mmap
import os
import tempfile
import weakref
from typing import IO, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.checks.faults import is_too_frequent, mark_fillers, measure_usual
from acromion.fusion.errors import TooLong, UnsafeArchive
from acromion.fusion.numba_kernels import njit
from acromion.fusion.readers.source import Source
from acromion.fusion.recording import QualityFlag
from acromion.fusion.runs import find_runs

# Room for the values of a whole recording, which grows without a second copy of them.
#
# A day at 500 Hz takes more than a gigabyte. From 8 MiB on the values are in a temporary file without a name,
# mapped into memory: the system writes parts of it out when memory is short, and mostly never does. Where
# there is no room on the disk, or the system has no such files, they stay in memory.

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
        """Change the number of rows; the first keep their values, added rows have arbitrary values."""
        if self._is_in_file and rows <= len(self.values):
            self.values = self.values[:rows]
        elif rows <= len(self.values) or not self._grow_in_file(rows):
            self._resize_in_memory(rows)

    def replace(self, values: NDArray[Item]) -> None:
        """Replace all values by these."""
        self.values, self._is_in_file = values, False

    def _grow_in_file(self, rows: int) -> bool:
        """Grow in a file, which may already contain the values; return False if that is impossible."""
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
        """Map the file after reserving its room on the disk; None if there is no room.

        If the disk were full only at the moment of writing, the process would end.
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
    """Return the folder of large temporary files; the folder that ``TMPDIR`` names goes first."""
    is_usable = not os.environ.get("TMPDIR") and os.access(LARGE_FILES, os.W_OK)
    return LARGE_FILES if is_usable else None


# The columns of a table of samples.

FIRST_CAPACITY = 65_536
MOST_FORESEEN_BYTES = 1 << 30
"""Three days of a device. For a file that claims to be longer, room is made as its rows arrive."""

PAUSE = 1 << 32
"""Added to the row number at a blank line or a new header where the layout has no time: a break of unknown
length."""
UNASKED_ROWS = 16_000_000
"""So many rows, half a GiB, are read before the number of all rows is estimated."""
MOST_ROWS = 1 << 27
"""15 days at 100 Hz, three at 500 Hz: more than any device records."""
LEAST_ROW_BYTES = 2
"""A sensor's row takes more bytes of the file, however well it is packed, because six channels have noise
(a worn LSM9DS1: 19 bytes, packed)."""
SECOND_ROW_BYTES = 24
"""The analysis holds the samples once more."""


def check_rows(rows: int, read_bytes: int, all_bytes: int, least_row_bytes: float = LEAST_ROW_BYTES) -> None:
    """Refuse a file that cannot be a recording, or does not fit in memory, before its rows fill the memory.

    ``rows``: how many rows the first ``read_bytes`` of the file contain; the total is estimated from them.
    ``read_bytes``, ``all_bytes``: of the file, packed as it may be.
    ``least_row_bytes``: fewest bytes of a row in the file.

    Raises
    ------
    UnsafeArchive
        The rows are compressed more than any sensor's rows.
    TooLong
        There are more rows than any device records.
    MemoryError
        The system does not have the memory that the remaining rows need.
    """
    if rows <= UNASKED_ROWS:
        return
    if rows * least_row_bytes > read_bytes:
        raise UnsafeArchive(reason="ratio")
    foreseen = max(rows, round(rows * all_bytes / read_bytes))
    if foreseen > MOST_ROWS:
        raise TooLong(rows=round(foreseen / 1e6), most=round(MOST_ROWS / 1e6))
    np.empty(foreseen * SECOND_ROW_BYTES, np.uint8)  # asked for and given back: it costs nothing untouched


class SampleColumns:
    """Acceleration, angular rate and stamps of the rows read so far.

    ``source``: what the rows come from, where too many of them are to be refused.

    ``acc``, ``gyr``: shape (capacity, 3), float32, in the units of the file times the reader's scale.
    ``stamps``: shape (capacity,), int64: microseconds, or row numbers where the layout has no time. Empty
    where the reader keeps time in another way.
    ``rows``: number of filled rows.
    """

    def __init__(self, source: Source | None = None, *, has_stamps: bool = True) -> None:
        self.rows = 0
        self._source = source
        self._acc = Room(np.float32, FIRST_CAPACITY, 3)
        self._gyr = Room(np.float32, FIRST_CAPACITY, 3)
        self._stamps = Room(np.int64, FIRST_CAPACITY * has_stamps)
        self._rooms: tuple[Room[Any], ...] = (self._acc, self._gyr, self._stamps)[: 2 + has_stamps]

    @property
    def acc(self) -> NDArray[np.float32]:
        """Acceleration."""
        return self._acc.values

    @property
    def gyr(self) -> NDArray[np.float32]:
        """Angular rate."""
        return self._gyr.values

    @property
    def stamps(self) -> NDArray[np.int64]:
        """Time of each row."""
        return self._stamps.values

    def extend(self, rows: int) -> slice:
        """Make room for ``rows`` more, to be written by the caller, and return their place.

        Grows by a sixteenth at least, so that the work stays linear.

        Raises UnsafeArchive, TooLong or MemoryError: as :func:`check_rows`, by what has been read of the
        source.
        """
        if self._source is not None:
            check_rows(self.rows, self._source.read_bytes, self._source.size_bytes)
        first, self.rows, capacity = self.rows, self.rows + rows, len(self.acc)
        if self.rows > capacity:
            self._resize(max(self.rows, capacity + capacity // 16))
        return slice(first, self.rows)

    def reserve(self, read_bytes: int, to_come_bytes: int) -> None:
        """Reserve room for the rest of the file, if it has as many rows per byte as the part read.

        Reserved room uses memory only when it is filled.
        """
        foreseen_bytes = min(to_come_bytes, MOST_FORESEEN_BYTES)
        foreseen = round(1.02 * self.rows * foreseen_bytes / read_bytes)
        if foreseen > len(self.acc):
            self._resize(foreseen)

    def trim(self) -> None:
        """Return the unused room to the system."""
        self._resize(self.rows)

    def keep(self, chosen: NDArray[np.bool_]) -> None:
        """Keep some of the rows, shape (rows,), in place."""
        kept = int(chosen.sum())
        for room in self._rooms:
            room.values[:kept] = room.values[: self.rows][chosen]
        self.rows = kept
        self.trim()

    def arrange(self, rows: NDArray[np.int64]) -> None:
        """Keep these rows, in this order. Only for damaged files, because it copies the rows."""
        for room in self._rooms:
            room.replace(room.values[rows])
        self.rows = len(rows)

    def open_holes(self, rows: NDArray[np.int64], added: NDArray[np.int64]) -> None:
        """Insert ``added`` interpolated rows before each of ``rows``; the stamps do not change.

        In place: no second copy of the samples is made. No view of them may exist yet.
        """
        total = self.rows + int(added.sum())
        for room in (self._acc, self._gyr):
            room.resize(max(total, len(room.values)))
            open_rows(room.values, self.rows, rows, added)
        self.rows = total

    def _resize(self, capacity_rows: int) -> None:
        for room in self._rooms:
            room.resize(capacity_rows)


@njit(cache=True, nogil=True)
def open_rows(
    values: NDArray[np.float32], n_rows: int, rows: NDArray[np.int64], added: NDArray[np.int64]
) -> None:
    """Insert linearly interpolated rows before each of ``rows``, in place, from the end backwards.

    ``values`` has room for them after its ``n_rows``.
    """
    to = n_rows
    for rows_added in added:
        to += rows_added
    source = n_rows
    for hole in range(len(rows) - 1, -1, -1):
        while source > rows[hole]:
            source -= 1
            to -= 1
            for axis in range(3):
                values[to, axis] = values[source, axis]
        for k in range(added[hole], 0, -1):
            weight = k / (added[hole] + 1)
            to -= 1
            for axis in range(3):
                before, after = values[source - 1, axis], values[source, axis]
                values[to, axis] = before * (1.0 - weight) + after * weight


def drop_blank_rows(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Drop stamped rows of zeros that are neither a sample nor a hole (W-ROWS-DROPPED).

    These are rows with a zero stamp (a card block that was never written). All rows of zeros are also dropped
    if they are spread through the whole file (read before the sensor had a new sample).
    """
    is_blank = mark_fillers(columns.acc, columns.gyr, measure_usual(columns.acc))
    if not is_blank.any():
        return ()
    if not is_too_frequent(len(find_runs(is_blank)), columns.rows):
        is_blank &= columns.stamps == 0
        is_blank[0] &= is_blank.sum() > 1  # a clock may well begin at zero
    dropped = int(is_blank.sum())
    if dropped in (0, columns.rows):
        return ()
    columns.keep(~is_blank)
    return (QualityFlag(Caveat.ROWS_DROPPED, dropped),)
