"""The bytes of one file, read in pieces: never the whole file at once."""

import hashlib
import io
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import PurePath
from typing import BinaryIO, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Found = TypeVar("Found")

HEAD_BYTES = 65_536
CHUNK_BYTES = 4 << 20
LARGE_PIECE_BYTES = 1 << 18
"""From this size on a piece is hashed in a thread."""
MAX_DAMAGED_PERCENT = 5.0
"""A device's binary file of which more is damaged is refused."""
EARLY_END_S = 60.0
"""A device that stopped by more than this before its planned end ended early (W-EARLY-END)."""


@dataclass(frozen=True, slots=True)
class Source:
    """A file as the readers see it.

    ``file``: gives the content, unpacked where the file itself is packed.
    ``name``: of the file or the member; only its extension is used.
    ``size_bytes``: of the file itself.
    ``head``: the first 64 KiB of the content.
    ``packed``: the file itself, where ``file`` gives what is unpacked from it.
    """

    file: BinaryIO
    name: str
    size_bytes: int
    head: bytes
    packed: BinaryIO | None = None

    @property
    def read_bytes(self) -> int:
        """How far the file itself, packed as it may be, has been read."""
        return (self.packed or self.file).tell()

    @property
    def extension(self) -> str:
        """Lower case, with its dot; empty where the name has none."""
        return PurePath(self.name.replace("\\", "/")).suffix.lower()


class HashedFile(io.RawIOBase):
    """A file that is hashed while it is read, so that its digest needs no second reading.

    Large pieces are hashed in a thread of their own (hashlib and the kernels both release the interpreter's
    lock), so that on two cores the digest costs almost nothing. Closing it leaves the file itself open.
    """

    def __init__(self, file: BinaryIO) -> None:
        super().__init__()
        self._file = file
        self._at = file.seek(0)
        self._digest = hashlib.sha256()
        self._hashed_bytes = 0
        self._worker = ThreadPoolExecutor(1)
        self._running: Future[None] | None = None

    def read(self, size: int = -1) -> bytes:
        """Read on, and hash what was not hashed before."""
        piece = self._file.read(size)
        if self._at <= self._hashed_bytes < self._at + len(piece):
            self._hash(memoryview(piece)[self._hashed_bytes - self._at :])
        self._at += len(piece)
        return piece

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Go to a place."""
        self._at = self._file.seek(offset, whence)
        return self._at

    def tell(self) -> int:
        """Where the next byte is read."""
        return self._at

    def readable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def finish(self) -> str:
        """Read what is left and give the digest of the whole, hexadecimal."""
        self.seek(self._hashed_bytes)
        while self.read(CHUNK_BYTES):
            pass
        self._wait()
        self._worker.shutdown()
        return self._digest.hexdigest()

    def _hash(self, piece: memoryview) -> None:
        self._wait()
        self._hashed_bytes += len(piece)
        if len(piece) < LARGE_PIECE_BYTES:
            self._digest.update(piece)
        else:
            self._running = self._worker.submit(self._digest.update, piece)

    def _wait(self) -> None:
        if self._running is not None:
            self._running.result()
            self._running = None


def open_source(file: BinaryIO, file_name: str = "", *, is_hashed: bool = True) -> Source:
    """Take the size and the head; the name falls back to the file object's own.

    ``is_hashed``: the digest will be needed (:func:`hash_source`), so it is computed while the file is read.
    """
    name = file_name or str(getattr(file, "name", ""))
    size_bytes = file.seek(0, io.SEEK_END)
    file.seek(0)
    watched = cast("BinaryIO", HashedFile(file)) if is_hashed else file
    return Source(watched, PurePath(name.replace("\\", "/")).name, size_bytes, watched.read(HEAD_BYTES))


def hash_source(source: Source) -> str:
    """SHA-256 of the bytes, hexadecimal."""
    if isinstance(source.file, HashedFile):
        return source.file.finish()
    source.file.seek(0)
    return hashlib.file_digest(source.file, "sha256").hexdigest()  # type: ignore[arg-type]


def read_chunks(source: Source, start_byte: int = 0, chunk_bytes: int = CHUNK_BYTES) -> Iterator[bytes]:
    """Read from ``start_byte`` to the end in pieces of 4 MiB."""
    source.file.seek(start_byte)
    while chunk := source.file.read(chunk_bytes):
        yield chunk


def scan_pieces(
    pieces: Iterable[bytes], scan: Callable[[NDArray[np.uint8], bool], tuple[int, Found]]
) -> Iterator[tuple[NDArray[np.uint8], Found]]:
    """Scan pieces one by one; what one does not finish is carried into the next.

    ``scan``: given bytes, and whether they are the last, return how many of them it used and what it found.
    """
    later = iter(pieces)
    carried, piece = b"", next(later, None)
    while piece is not None:
        following = next(later, None)
        buffer = np.frombuffer(carried + piece if carried else piece, np.uint8)
        used, found = scan(buffer, following is None)
        yield buffer, found
        carried, piece = buffer[used:].tobytes(), following
