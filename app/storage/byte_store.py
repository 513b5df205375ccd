"""What a folder and a bucket promise about bytes; they know nothing of keys (:mod:`app.storage.sealing`)."""

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from app.storage.store import Fetched, Mark


class ByteWriter(Protocol):
    """The bytes of a new recording, as they come."""

    def write(self, chunk: bytes) -> None:
        """Write the next bytes. Raises DiskFull, StoreAway."""

    def keep(self) -> None:
        """Make the bytes durable under their final name."""

    def discard(self) -> None:
        """Leave nothing behind; harmless after :meth:`keep`."""


class ByteStore(Protocol):
    """A folder, or a bucket with a folder for temporary files.

    The methods that :class:`app.storage.store.Storage` has too are described there.
    """

    @property
    def is_local(self) -> bool:
        """Files can be read in place; else each reading is a copy."""

    @property
    def root(self) -> Path:
        """The folder of this machine."""

    def prepare(self) -> None:
        """Create missing folders; fail early where the store does not answer."""

    def identify(self) -> str:
        """Give the permanent id of this store."""

    def open_writer(self, recording_id: str) -> ByteWriter:
        """Begin a recording under a new name."""

    def adopt(self, path: Path, recording_id: str) -> None:
        """Store a durable file of this machine as a recording; no harm where that is done already."""

    def fetch(self, name: str) -> Fetched:
        """Give the bytes as a file of ``root/opened`` that no other takes the place of.

        Raises FileNotFoundError, StoreAway.
        """

    def read_start(self, name: str, count: int) -> tuple[bytes, Mark] | None:
        """Give the first bytes of a file, and its mark; None where there is none."""

    def put(self, path: Path, name: str) -> None:
        """Store a file of this machine under a name of the store, whole or not at all."""

    def keep_attempt(self, analysis_id: str, token: str) -> None:
        """Make the attempt's files durable, and readable from every machine."""

    def drop_recording(self, recording_id: str) -> None:
        """Remove a recording, then its side file; no harm when they are gone."""

    def open_attempt(self, analysis_id: str, token: str) -> Path:
        """Create an empty folder on this machine for the files of one attempt."""

    def drop_attempt(self, analysis_id: str, token: str) -> None:
        """Remove the files of an attempt that does not count."""

    def drop_analysis(self, analysis_id: str) -> None:
        """Remove every file of an analysis."""

    def release(self, path: Path) -> None:
        """End the use of a fetched file."""

    def check_space(self, expected_bytes: int, min_free_bytes: int) -> None:
        """Refuse an upload that would fill the disk. Raises DiskFull."""

    def find_names(self) -> Iterator[str]:
        """Give the name of every stored recording and result."""

    def find_recordings(self) -> frozenset[str]:
        """Give every name among the recordings, those of side files too."""

    def write_small(self, name: str, content: bytes) -> None:
        """Write a small file, durably, whole or not at all."""

    def read_small(self, name: str) -> bytes | None:
        """Read a small file; None where there is none."""

    def quarantine(self, name: str) -> bool:
        """Move an unknown entry of the recordings into quarantine."""

    def unquarantine(self, name: str) -> bool:
        """Move a recording back from quarantine."""

    def find_quarantined(self) -> tuple[str, ...]:
        """Give the names of everything in quarantine."""

    def find_attempts(self) -> tuple[tuple[str, str], ...]:
        """Give the folders of attempts on this machine: (analysis, token)."""

    def drop_temporary(self, min_age_s: float) -> int:
        """Remove temporary files that nobody has written to for so long; gives their number."""
