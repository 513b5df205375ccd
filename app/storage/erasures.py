"""The ledger of erasures: which recordings and analyses were erased and when, and nothing else about them.

    data_dir/erasures.jsonl     one line each, appended and synced before the first file is deleted
    erasures/<recording>        in a bucket: one object each

It is outside the database: ``restore``, ``recover`` and every start erase again what is in it.
"""

import json
import os
import sys
from collections.abc import Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from app.storage.permissions import make_folder
from app.storage.store import sync_folder, translate_disk_full

if sys.platform != "win32":
    import fcntl

LEDGER_FILE = "erasures.jsonl"


@dataclass(frozen=True, slots=True)
class FolderLedger:
    """The ledger as a file."""

    path: Path

    def find(self) -> frozenset[str]:
        """Return every id."""
        try:
            return parse_ledger(self.path.read_bytes())
        except FileNotFoundError:
            return frozenset()

    def add(self, ids: Collection[str]) -> None:
        """Append lines, one writer at a time.

        Raises
        ------
        DiskFull
        """
        make_folder(self.path.parent)
        with translate_disk_full(), open(self.path, "a+b", opener=_open_private) as file:
            if sys.platform != "win32":
                fcntl.flock(file, fcntl.LOCK_EX)
            file.seek(0)
            content = file.read()
            if not content.endswith(b"\n") and content:  # a power cut has torn the last line
                file.write(b"\n")
            file.write(format_ledger(set(ids) - parse_ledger(content)))
            file.flush()
            os.fsync(file.fileno())
        sync_folder(self.path.parent)


def format_ledger(ids: Collection[str]) -> bytes:
    """Return the lines of erasures of now."""
    at = datetime.now(UTC).isoformat(timespec="seconds")
    return b"".join(json.dumps({"id": one, "at": at}).encode() + b"\n" for one in sorted(ids))


def parse_ledger(content: bytes) -> frozenset[str]:
    """Return the ids of a ledger; a torn line never counted."""
    found = set()
    for line in content.splitlines():
        try:
            found.add(str(json.loads(line)["id"]))
        except (ValueError, TypeError, KeyError):
            continue
    return frozenset(found)


def _open_private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)
