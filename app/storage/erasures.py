"""The ledger of erasures: which recordings were erased and when, and nothing else about them.

    data_dir/erasures.jsonl     one line each, appended and synced before the key is destroyed

Where the rows are in PostgreSQL it is a table beside the wrapped keys (:mod:`app.storage.key_table`). Each
entry holds a digest over itself and the one before: a line that was altered or taken out of the middle is
noticed.
``restore``, ``recover`` and every start erase again what is in it.
"""

import hashlib
import json
import os
import sys
from collections.abc import Collection, Iterable, Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Protocol

from app.storage.permissions import make_folder
from app.storage.store import sync_folder, translate_disk_full

if sys.platform != "win32":
    import fcntl

FIRST = "0" * 64


@dataclass(frozen=True, slots=True)
class Erasure:
    """One erased recording; ``chain`` is a digest over this entry and the one before."""

    id: str
    at: str
    chain: str


class Ledger(Protocol):
    """Where the entries are; nothing is ever taken out."""

    def read(self) -> tuple[Erasure, ...]:
        """Give every entry, the oldest first."""

    def append(self, recording_ids: Collection[str]) -> None:
        """Add what is not there yet; durable when this returns."""


def make_entries(before: Iterable[Erasure], recording_ids: Collection[str]) -> Iterator[Erasure]:
    """Make the entries of what is not in the ledger yet."""
    known = tuple(before)
    ids = {entry.id for entry in known}
    chain = known[-1].chain if known else FIRST
    at = datetime.now(UTC).isoformat(timespec="seconds")
    for recording_id in sorted(set(recording_ids) - ids):
        chain = hash_entry(chain, recording_id, at)
        yield Erasure(recording_id, at, chain)


def hash_entry(before: str, recording_id: str, at: str) -> str:
    """Give the digest of an entry and of the one before."""
    return hashlib.sha256(f"{before}\n{recording_id}\n{at}".encode()).hexdigest()


def is_chained(entries: Iterable[Erasure]) -> bool:
    """Tell whether no entry was altered, and none taken out before the last."""
    before = FIRST
    for entry in entries:
        if entry.chain != hash_entry(before, entry.id, entry.at):
            return False
        before = entry.chain
    return True


@dataclass(frozen=True, slots=True)
class FolderLedger:
    """The ledger as a file."""

    path: Path

    def read(self) -> tuple[Erasure, ...]:
        """Read the file."""
        try:
            with self.path.open("rb") as file:
                return tuple(_read(file))
        except FileNotFoundError:
            return ()

    def append(self, recording_ids: Collection[str]) -> None:
        """Append lines, one writer at a time."""
        make_folder(self.path.parent)
        with translate_disk_full(), open(self.path, "a+b", opener=_open_private) as file:
            if sys.platform != "win32":
                fcntl.flock(file, fcntl.LOCK_EX)
            file.seek(0)
            entries = tuple(_read(file))
            file.seek(0, os.SEEK_END)
            if file.tell() and not _ends_whole(file):  # a power cut has torn the last line: it never counted
                file.write(b"\n")
            for entry in make_entries(entries, recording_ids):
                file.write(json.dumps(asdict(entry)).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        sync_folder(self.path.parent)


def _open_private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


def _ends_whole(file: IO[bytes]) -> bool:
    file.seek(-1, os.SEEK_END)
    return file.read(1) == b"\n"


def _read(file: IO[bytes]) -> Iterator[Erasure]:
    for line in file:
        try:
            yield Erasure(**json.loads(line))
        except (ValueError, TypeError):
            continue
