"""What a folder and a bucket promise about bytes; they know nothing of keys (:mod:`app.storage.sealing`)."""

from pathlib import Path
from typing import Protocol

from app.storage.store import FileStore, Mark


class ByteWriter(Protocol):
    """The bytes of a new recording, as they come."""

    def write(self, chunk: bytes) -> None:
        """Write the next bytes. Raises DiskFull, StoreAway."""

    def keep(self) -> None:
        """Make the bytes durable under their final name."""

    def discard(self) -> None:
        """Leave nothing behind; harmless after :meth:`keep`."""


class ByteStore(FileStore, Protocol):
    """A folder, or a bucket with a folder for temporary files."""

    def open_writer(self, recording_id: str) -> ByteWriter:
        """Begin a recording under a new name."""

    def adopt(self, path: Path, recording_id: str) -> None:
        """Store a durable file of this machine as a recording; no harm where that is done already."""

    def read_start(self, name: str, count: int) -> tuple[bytes, Mark] | None:
        """Give the first bytes of a file, and its mark; None where there is none."""

    def keep_attempt(self, analysis_id: str, token: str) -> None:
        """Make the attempt's files durable, and readable from every machine."""
