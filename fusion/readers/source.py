"""The bytes of one file, read in pieces: never the whole file at once."""

import hashlib
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePath
from typing import BinaryIO

HEAD_BYTES = 65_536
CHUNK_BYTES = 4 << 20


@dataclass(frozen=True, slots=True)
class Source:
    """A file as the readers see it.

    ``name`` is only ever used to judge its extension; ``head`` holds the first 64 KiB.
    """

    file: BinaryIO
    name: str
    size_bytes: int
    head: bytes

    @property
    def extension(self) -> str:
        """Lower case, with its dot; empty where the name has none."""
        return PurePath(self.name.replace("\\", "/")).suffix.lower()


def open_source(file: BinaryIO, file_name: str = "") -> Source:
    """Take the size and the head; the name falls back to the file object's own."""
    name = file_name or str(getattr(file, "name", ""))
    size_bytes = file.seek(0, io.SEEK_END)
    file.seek(0)
    return Source(file, PurePath(name.replace("\\", "/")).name, size_bytes, file.read(HEAD_BYTES))


def hash_source(source: Source) -> str:
    """SHA-256 of the bytes, hexadecimal."""
    source.file.seek(0)
    return hashlib.file_digest(source.file, "sha256").hexdigest()  # type: ignore[arg-type]


def read_chunks(source: Source, start_byte: int = 0) -> Iterator[bytes]:
    """Read from ``start_byte`` to the end in pieces of 4 MiB."""
    source.file.seek(start_byte)
    while chunk := source.file.read(CHUNK_BYTES):
        yield chunk
