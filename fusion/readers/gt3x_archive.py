"""The zip around a `.gt3x`: judged before a byte of it is unpacked, and again while it is."""

import zipfile
import zlib
from collections.abc import Iterator
from typing import BinaryIO

from fusion.errors import (
    CorruptArchive,
    MissingMember,
    OldDevice,
    TruncatedArchive,
    UnknownFormat,
    UnsafeArchive,
)
from fusion.readers.source import CHUNK_BYTES, Source

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
    check_members(members)
    return archive


def check_members(members: list[zipfile.ZipInfo]) -> None:
    """Refuse an archive for what its directory says."""
    if len(members) > MAX_MEMBERS:
        raise UnsafeArchive(reason="members", count=len(members), limit=MAX_MEMBERS)
    names = [member.filename for member in members]
    if len(set(names)) < len(names):
        raise UnsafeArchive(reason="duplicate")
    if sum(member.file_size for member in members) > MAX_UNPACKED_BYTES:
        raise UnsafeArchive(reason="size", limit=MAX_UNPACKED_BYTES)
    for member in members:
        _check_member(member)


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

    Raises
    ------
    OldDevice, MissingMember, UnknownFormat
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
    raise UnknownFormat(kind=_name_archive(names))


def _name_archive(names: set[str]) -> str:
    if all(name.endswith(".npy") for name in names):
        return "NumPy (.npz)"
    if "xl/workbook.xml" in names:
        return "Excel (.xlsx)"
    if "word/document.xml" in names:
        return "Word (.docx)"
    return "ZIP"


def read_text(archive: zipfile.ZipFile, name: str) -> bytes:
    """At most 64 KiB of a member."""
    return b"".join(read_member(archive, name, limit_bytes=MAX_TEXT_BYTES))


def read_member(
    archive: zipfile.ZipFile, name: str, limit_bytes: int = MAX_UNPACKED_BYTES
) -> Iterator[bytes]:
    """Unpack a member in pieces, counting what really comes out; never to disk.

    Raises
    ------
    CorruptArchive
        The member fails its CRC or its compressed stream is broken.
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


def is_archive(file: BinaryIO, head: bytes) -> bool:
    """Whether the bytes begin like a zip (an empty one begins with its index)."""
    return file.seekable() and head[:4] in (b"PK\x03\x04", b"PK\x05\x06")
