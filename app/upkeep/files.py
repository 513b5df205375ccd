"""The files that the rows promise, and what each must hash to."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from app.errors import BackupRefused
from app.jobs.reading import PURGING
from app.storage import Storage

_NAME = re.compile(r"(recordings|analyses)(/\w[\w.-]*){1,3}", re.ASCII)

Rows = Iterable[Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class KeptFile:
    """A file by its name in the store, with the SHA-256 of its row."""

    name: str
    sha256: str

    def fetch(self, storage: Storage) -> Path:
        """Give it as a file of this machine, whatever it holds: what is compared or saved is always read."""
        return storage.fetch(self.name).path


@dataclass(frozen=True, slots=True)
class Fault:
    """A file that is not as its row says, or that has no row; a side file may be behind or ahead of it.

    ``known``: the backup that holds the file says so.
    """

    name: str
    finding: Literal[
        "missing",
        "damaged",
        "orphan",
        "no_row",
        "known_missing",
        "known_damaged",
        "side_missing",
        "side_damaged",
        "side_behind",
        "side_ahead",
        "quarantine",
    ]


def list_files(recordings: Rows, analyses: Rows, result_files: Rows) -> Iterator[KeptFile]:
    """Give every recording and every result that a row promises."""
    kept = [row for row in recordings if row["state"] != PURGING]
    for row in kept:
        yield _name(f"recordings/{row['id']}", row["sha256"])
    ids = {row["id"] for row in kept}
    tokens = {row["id"]: row["token"] for row in analyses if row["recording_id"] in ids}
    for row in result_files:
        analysis_id = row["analysis_id"]
        if analysis_id not in tokens:
            continue
        yield _name(f"analyses/{analysis_id}/{tokens[analysis_id]}/{row['name']}", row["sha256"])


def _name(name: str, sha256: str) -> KeptFile:
    """Trust no name of a backup more than its letters."""
    if not _NAME.fullmatch(name):
        raise BackupRefused(why=name[:80])
    return KeptFile(name, sha256)
