"""Tables that come packed: `.csv.gz`, and `.zip` with one recording. One level only, never to disk."""

import gzip
import io
import zipfile
import zlib
from collections.abc import Callable
from pathlib import PurePath
from typing import IO, BinaryIO, cast

from fusion.errors import CorruptArchive, EmptyFile, TruncatedArchive, UnsafeArchive
from fusion.readers import gt3x_archive
from fusion.readers.gt3x_archive import MAX_RATIO, MAX_UNPACKED_BYTES, RATIO_FREE_BYTES
from fusion.readers.source import HEAD_BYTES, Source

GZIP_MAGIC = b"\x1f\x8b"
ZIP_MAGIC = b"PK\x03\x04"
BROKEN = (gzip.BadGzipFile, zipfile.BadZipFile, zlib.error, ValueError, NotImplementedError, RuntimeError)
"""What the standard library raises on packed bytes that contradict themselves."""
OWN_FOLDERS = ("xl/", "word/")
OWN_ARCHIVES = ("log.bin", "info.txt", "activity.bin", "[Content_Types].xml", "mimetype")
"""Members of archives that are a format of their own: `.gt3x`, Office, OpenDocument and NumPy files."""


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
    """Give the one recording inside; the source itself where nothing is packed.

    Raises
    ------
    fusion.errors.DamagedFile
        The archive is cut, corrupt or unsafe, packed twice, or holds several files.
    """
    if source.head.startswith(GZIP_MAGIC):
        return _unpack_gzip(source)
    if source.head.startswith(ZIP_MAGIC):
        return _unpack_zip(source)
    return source


def _unpack_gzip(source: Source) -> Source:
    def open_member() -> IO[bytes]:
        source.file.seek(0)
        return cast("IO[bytes]", gzip.GzipFile(fileobj=source.file, mode="rb"))

    name = source.name[:-3] if source.extension == ".gz" else source.name
    return _open_unpacked(UnpackedFile(open_member, source.size_bytes, source.name), name, source)


def _unpack_zip(source: Source) -> Source:
    archive = gt3x_archive.open_archive(source)
    names = archive.namelist()
    if any(name in OWN_ARCHIVES or name.startswith(OWN_FOLDERS) or name.endswith(".npy") for name in names):
        return source
    members = [m for m in archive.infolist() if not m.is_dir() and not m.filename.startswith("__MACOSX/")]
    if len(members) != 1:
        raise UnsafeArchive(reason="several", count=len(members))
    (member,) = members

    def open_member() -> IO[bytes]:
        return archive.open(member.filename)

    file = UnpackedFile(open_member, source.size_bytes, member.filename)
    return _open_unpacked(file, PurePath(member.filename).name, source)


def _open_unpacked(file: UnpackedFile, name: str, packed: Source) -> Source:
    head = b""
    while len(head) < HEAD_BYTES and (piece := file.read(HEAD_BYTES - len(head))):
        head += piece
    if not head:
        raise EmptyFile
    if head.startswith((GZIP_MAGIC, b"PK\x03\x04", b"PK\x05\x06")):
        raise UnsafeArchive(reason="nested")
    return Source(cast("BinaryIO", file), name, packed.size_bytes, head, packed.file)
