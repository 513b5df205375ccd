"""Packed files: the zip of a `.gt3x`, `.csv.gz`, `.zip` with one recording. One level only, never to disk."""

import gzip
import io
import re
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import IO, BinaryIO, cast

from fusion.errors import (
    CorruptArchive,
    EmptyFile,
    MissingMember,
    OldDevice,
    TruncatedArchive,
    UnknownFormat,
    UnsafeArchive,
)
from fusion.readers.source import CHUNK_BYTES, HEAD_BYTES, Source

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
    """Open the archive and refuse what could do harm, by its directory alone.

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
    """Refuse an archive that is no `.gt3x` of the generation with a gyroscope.

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

    Raises CorruptArchive: the member fails its CRC or its compressed stream is broken.
    """
    left = limit_bytes
    try:
        with archive.open(name) as member:
            while left > 0 and (piece := member.read(min(CHUNK_BYTES, left))):
                left -= len(piece)
                yield piece
    except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, NotImplementedError) as error:
        # ValueError: bytes are lost in the middle, so that the index points before the file's start
        raise CorruptArchive(member=name) from error


GZIP_MAGIC = b"\x1f\x8b"
ZIP_MAGIC, EMPTY_ZIP_MAGIC = b"PK\x03\x04", b"PK\x05\x06"
"""An empty archive begins with its index."""
BROKEN = (gzip.BadGzipFile, zipfile.BadZipFile, zlib.error, ValueError, NotImplementedError, RuntimeError)
"""What the standard library raises on packed bytes that contradict themselves."""
OWN_FOLDERS = ("xl/", "word/")
LEFT_FOLDERS = ("__MACOSX/", "meta/")
"""What a Mac and phyphox put beside the recording."""
DEVICE_PARTS = ("log.bin", "info.txt")
OWN_ARCHIVES = ("log.bin", "info.txt", "activity.bin", "[Content_Types].xml", "mimetype")
"""Members of archives that are a format of their own: `.gt3x`, Office, OpenDocument and NumPy files."""


# A pair of tables: one of the accelerometer, one of the gyroscope.

ANGULAR_RATE = re.compile(r"gyro", re.IGNORECASE)
TOTAL, ACCELERATION = re.compile(r"total_?accel", re.IGNORECASE), re.compile(r"accel", re.IGNORECASE)
GRAVITY = re.compile(r"gravity", re.IGNORECASE)
WITHOUT_GRAVITY = re.compile(r"linear|user_?accel", re.IGNORECASE)
LEFT_ASIDE = re.compile(r"uncalibrated|^meta", re.IGNORECASE)
TABLES = (".csv", ".txt", ".tsv")


@dataclass(frozen=True, slots=True)
class PairNames:
    """The tables of a pair by their names in the archive; ``gravity`` is to be added to the acceleration."""

    acceleration: str
    angular_rate: str
    gravity: str = ""
    is_linear: bool = False


def find_pair(names: Sequence[str]) -> PairNames | None:
    """Find the two tables by their names; None where there is not one of each."""
    tables = {
        name: PurePath(name).stem
        for name in names
        if name.lower().endswith(TABLES) and not name.startswith(LEFT_FOLDERS)
    }
    tables = {name: stem for name, stem in tables.items() if not LEFT_ASIDE.search(stem)}
    rates = [name for name, stem in tables.items() if ANGULAR_RATE.search(stem)]
    linear = [name for name, stem in tables.items() if WITHOUT_GRAVITY.search(stem)]
    gravity = [name for name, stem in tables.items() if GRAVITY.search(stem)]
    for pattern in (TOTAL, ACCELERATION):
        found = [name for name, stem in tables.items() if pattern.search(stem) and name not in linear]
        if len(found) == len(rates) == 1:
            return PairNames(found[0], rates[0], "" if pattern is TOTAL else next(iter(gravity), ""))
    return PairNames(linear[0], rates[0], is_linear=True) if len(linear) == len(rates) == 1 else None


# What is unpacked as it is read.


class UnpackedFile(io.RawIOBase):
    """The bytes of a packed file, counted as they come out; seeking begins anew and reads on.

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
        try:
            return self._open_member()
        except BROKEN as error:
            raise CorruptArchive(member=self._name) from error

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


def unpack(source: Source) -> Source:
    """Return the one recording inside; the source itself if nothing is packed.

    Raises DamagedFile: the archive is cut, corrupt or unsafe, packed twice, or holds several files.
    """

    def open_gzip() -> IO[bytes]:
        source.file.seek(0)
        return cast("IO[bytes]", gzip.GzipFile(fileobj=source.file, mode="rb"))

    if source.head.startswith(GZIP_MAGIC):
        name = source.name[:-3] if source.extension == ".gz" else source.name
        return _open_unpacked(UnpackedFile(open_gzip, source.size_bytes, source.name), name, source)
    if not source.head.startswith(ZIP_MAGIC):
        return source
    archive = open_archive(source)
    names = archive.namelist()
    if any(name in OWN_ARCHIVES or name.startswith(OWN_FOLDERS) or name.endswith(".npy") for name in names):
        return source
    if find_pair(names):
        return source
    members = [m for m in archive.infolist() if not m.is_dir() and not m.filename.startswith(LEFT_FOLDERS)]
    if any(PurePath(member.filename).name in DEVICE_PARTS for member in members):
        raise UnsafeArchive(reason="folder")
    if len(members) != 1:
        raise UnsafeArchive(reason="several", count=len(members))
    (member,) = members
    file = UnpackedFile(lambda: archive.open(member.filename), source.size_bytes, member.filename)
    return _open_unpacked(file, PurePath(member.filename).name, source)


def _open_unpacked(file: UnpackedFile, name: str, packed: Source) -> Source:
    head = b""
    while len(head) < HEAD_BYTES and (piece := file.read(HEAD_BYTES - len(head))):
        head += piece
    if not head:
        raise EmptyFile
    if head.startswith((GZIP_MAGIC, ZIP_MAGIC, EMPTY_ZIP_MAGIC)):
        raise UnsafeArchive(reason="nested")
    return Source(cast("BinaryIO", file), name, packed.size_bytes, head, packed.file)
