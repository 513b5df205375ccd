"""The bytes of one file, read in pieces, never the whole file at once; packed files as well."""

import errno
import gzip
import hashlib
import io
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import PurePath
from typing import IO, BinaryIO, Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.clocks import ShiftWindow
from acromion.fusion.errors import (
    CorruptArchive,
    MissingMember,
    OldDevice,
    TruncatedArchive,
    UnknownFormat,
    UnsafeArchive,
)

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
class PairNames:
    """The tables of a pair by their names in the archive.

    ``gravity``: to be added to the acceleration. ``kind``: what the acceleration is called; "linear" lacks
    gravity, "total" includes it.
    """

    acceleration: str
    angular_rate: str
    gravity: str = ""
    kind: Literal["acc", "linear", "total"] = "acc"


@dataclass(frozen=True, slots=True)
class Source:
    """A file as the readers see it.

    ``file``: the content, unpacked if the file itself is packed.
    ``name``: of the file or the member; only its extension is used.
    ``size_bytes``: of the file itself.
    ``head``: the first 64 KiB of the content.
    ``packed``: the packed file, if ``file`` is unpacked from it.
    ``pair``: the tables of the archive that are read as one recording.
    ``left_aside``: files of the archive that are not part of the recording; ``beside``: those of them that
    are tables of another device's sensor. ``is_chosen``: it was chosen from the archive by its name.
    ``window``: only its samples are needed; a reader may decode more.
    ``is_thigh``: the sensor is on the thigh: its acceleration is enough, and the angular rate is then 0.
    """

    file: BinaryIO
    name: str
    size_bytes: int
    head: bytes
    packed: BinaryIO | None = None
    pair: PairNames | None = None
    left_aside: int = 0
    beside: tuple[str, ...] = ()
    is_chosen: bool = False
    window: ShiftWindow | None = None
    is_thigh: bool = False

    @property
    def read_bytes(self) -> int:
        """Return how many bytes of the file itself, packed or not, have been read."""
        return (self.packed or self.file).tell()

    @property
    def extension(self) -> str:
        """Return the extension in lower case, with its dot; empty if the name has none."""
        return PurePath(self.name.replace("\\", "/")).suffix.lower()


class HashedFile(io.RawIOBase):
    """A file that is hashed while it is read, so that its digest needs no second reading.

    Large pieces are hashed in a separate thread (hashlib and the kernels both release the interpreter's
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
        """Read the next bytes, and hash the new ones."""
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
        """Read the rest and return the digest of the whole file, hexadecimal."""
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
    """Scan pieces one by one; unfinished bytes are carried into the next piece.

    ``scan``: given bytes, and whether they are the last, return how many of them it used, and its result.
    """
    later = iter(pieces)
    carried, piece = b"", next(later, None)
    while piece is not None:
        following = next(later, None)
        buffer = np.frombuffer(carried + piece if carried else piece, np.uint8)
        used, found = scan(buffer, following is None)
        yield buffer, found
        carried, piece = buffer[used:].tobytes(), following


# Packed files: the zip of a `.gt3x`, `.csv.gz`, `.zip` with one recording. One level only, never to disk.

# A zip archive is checked by its directory before a byte is unpacked, and again while it is unpacked.

MAX_MEMBERS = 64
MAX_UNPACKED_BYTES = 4 << 30
MAX_RATIO = 200
RATIO_FREE_BYTES = 1 << 20
"""Small members may have any ratio: a few repeated lines of text pack well."""
MAX_TEXT_BYTES = 1 << 16

ENCRYPTED_BIT = 0x1
SYMLINK_MODE = 0o120000
ALLOWED_COMPRESSION = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def open_archive(source: Source) -> zipfile.ZipFile:
    """Open the archive and refuse a harmful one, judging by its directory.

    Raises
    ------
    TruncatedArchive
        Its index is missing.
    UnsafeArchive
        Too many or too large members, doubled or unsafe names, encryption, unknown compression.
    """
    source.file.seek(0)
    try:
        archive = zipfile.ZipFile(source.file)
        members = archive.infolist()
    except (zipfile.BadZipFile, ValueError, OverflowError, NotImplementedError) as error:
        raise TruncatedArchive(n=source.size_bytes) from error
    if len(members) > MAX_MEMBERS:
        raise UnsafeArchive(reason="members", count=len(members), limit=MAX_MEMBERS)
    names = [member.filename for member in members]
    if len(set(names)) < len(names):
        raise UnsafeArchive(reason="duplicate")
    if sum(member.file_size for member in members) > MAX_UNPACKED_BYTES:
        raise UnsafeArchive(reason="size", limit=MAX_UNPACKED_BYTES)
    for member in members:
        _check_member(member)
    return archive


def _check_member(member: zipfile.ZipInfo) -> None:
    # zipfile itself cuts a name at a NUL and turns os.sep into "/": orig_filename is what the file says
    name = member.orig_filename
    if name.startswith("/") or "\\" in name or "\0" in name or ":" in name or ".." in name.split("/"):
        raise UnsafeArchive(reason="name")
    if (member.external_attr >> 16) & 0o170000 == SYMLINK_MODE:
        raise UnsafeArchive(reason="link")
    if member.flag_bits & ENCRYPTED_BIT:
        raise UnsafeArchive(reason="encrypted")
    if member.compress_type not in ALLOWED_COMPRESSION:
        raise UnsafeArchive(reason="compression")
    if member.file_size > max(RATIO_FREE_BYTES, MAX_RATIO * member.compress_size):
        raise UnsafeArchive(reason="ratio", limit=MAX_RATIO)


def check_parts(archive: zipfile.ZipFile) -> None:
    """Refuse an archive that is not a `.gt3x` from a device with a gyroscope.

    Raises OldDevice, MissingMember or UnknownFormat.
    """
    names = set(archive.namelist())
    if "log.bin" in names and "info.txt" in names:
        return
    if "activity.bin" in names:
        raise OldDevice
    if "log.bin" in names:
        raise MissingMember(member="info.txt")
    if "info.txt" in names:
        raise MissingMember(member="log.bin")
    if all(name.endswith(".npy") for name in names):
        raise UnknownFormat(kind="NumPy (.npz)")
    if "xl/workbook.xml" in names:
        raise UnknownFormat(kind="Excel (.xlsx)")
    raise UnknownFormat(kind="Word (.docx)" if "word/document.xml" in names else "ZIP")


def read_text(archive: zipfile.ZipFile, name: str) -> bytes:
    """At most 64 KiB of a member."""
    return b"".join(read_member(archive, name, limit_bytes=MAX_TEXT_BYTES))


def read_member(
    archive: zipfile.ZipFile, name: str, limit_bytes: int = MAX_UNPACKED_BYTES
) -> Iterator[bytes]:
    """Unpack a member in pieces, counting what really comes out; never to disk.

    Raises CorruptArchive if the member fails its CRC or its compressed stream is broken.
    """
    left = limit_bytes
    with _refuse_damage(name, BROKEN_MEMBER), archive.open(name) as member:
        while left > 0 and (piece := member.read(min(CHUNK_BYTES, left))):
            left -= len(piece)
            yield piece


BROKEN_MEMBER = (zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError)
"""ValueError: bytes are lost in the middle, so that the index points before the start of the file."""


@contextmanager
def _refuse_damage(member: str, broken: tuple[type[Exception], ...]) -> Iterator[None]:
    try:
        yield
    except broken as error:
        raise CorruptArchive(member=member) from error
    except OSError as error:
        if error.errno != errno.EINVAL:  # in a file on disk the index points before the start
            raise
        raise CorruptArchive(member=member) from error


GZIP_MAGIC = b"\x1f\x8b"
ZIP_MAGIC, EMPTY_ZIP_MAGIC = b"PK\x03\x04", b"PK\x05\x06"
"""An empty archive begins with its index."""
BROKEN = (gzip.BadGzipFile, zipfile.BadZipFile, zlib.error, ValueError, NotImplementedError, RuntimeError)
"""Exceptions of the standard library for packed bytes that contradict themselves."""


# What is unpacked as it is read.


class UnpackedFile(io.RawIOBase):
    """The bytes of a packed file, counted as they come out; seeking starts again and reads on.

    Compared to trusting the archive's index: the sizes written in the file are not looked at.
    """

    def __init__(self, open_member: Callable[[], IO[bytes]], packed_bytes: int, name: str) -> None:
        super().__init__()
        self._open_member = open_member
        self._packed_bytes = packed_bytes
        self._name = name
        self._member = self._open()
        self._at = 0

    def _open(self) -> IO[bytes]:
        with _refuse_damage(self._name, BROKEN):
            return self._open_member()

    def read(self, size: int = -1) -> bytes:
        """Unpack up to ``size`` bytes."""
        try:
            piece = self._member.read(size)
        except EOFError as error:
            raise TruncatedArchive(n=self._packed_bytes) from error
        except BROKEN as error:
            raise CorruptArchive(member=self._name) from error
        self._at += len(piece)
        if self._at > MAX_UNPACKED_BYTES:
            raise UnsafeArchive(reason="size", limit=MAX_UNPACKED_BYTES)
        if self._at > max(RATIO_FREE_BYTES, MAX_RATIO * self._packed_bytes):
            raise UnsafeArchive(reason="ratio", limit=MAX_RATIO)
        return piece

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Go to a place counted from the start."""
        if whence != io.SEEK_SET:
            raise io.UnsupportedOperation
        if offset < self._at:
            self._member = self._open()
            self._at = 0
        while self._at < offset and self.read(min(HEAD_BYTES, offset - self._at)):
            pass
        return self._at
