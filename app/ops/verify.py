"""Verify: compare every stored file with its row, and find files without one."""

import re
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import Connection, func, select

from acromion.app.errors import BackupRefused
from acromion.app.library.database.connect import READ_ONLY, connect
from acromion.app.library.database.tables import analyses, recordings, result_files
from acromion.app.library.rows import PURGING, JobState
from acromion.app.library.side_files import decode_side_file
from acromion.app.ops.recover import find_strange
from acromion.app.settings import Settings
from acromion.app.store.folder import SIDE_SUFFIX, Storage, format_side_file_name, open_storage

RECHECKS, RECHECK_PAUSE_S = 10, 0.5
"""Number of repeated comparisons of a differing side file, and the pause between them."""

_NAME = re.compile(r"(recordings|analyses)(/\w[\w.-]*){1,3}", re.ASCII)

Rows = Iterable[Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class ExpectedFile:
    """A file by its name in the store, with the SHA-256 of its row."""

    name: str
    sha256: str


@dataclass(frozen=True, slots=True)
class Fault:
    """A file that differs from its row or has none; a side file may be behind or ahead of its row.

    ``side_waiting``: it is behind its row, and housekeeping is about to write it. ``known_...``: the backup
    with the file lists the fault itself.
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
        "side_waiting",
        "side_ahead",
        "quarantine",
    ]


def find_files(recordings: Rows, analyses: Rows, result_files: Rows) -> Iterator[ExpectedFile]:
    """Return every recording and every result that has a row."""
    kept = [row for row in recordings if row["state"] != PURGING]
    for row in kept:
        yield _check_name(ExpectedFile(f"recordings/{row['id']}", row["sha256"]))
    ids = {row["id"] for row in kept}
    tokens = {row["id"]: row["token"] for row in analyses if row["recording_id"] in ids}
    for row in result_files:
        analysis_id = row["analysis_id"]
        if analysis_id in tokens:
            name = f"analyses/{analysis_id}/{tokens[analysis_id]}/{row['name']}"
            yield _check_name(ExpectedFile(name, row["sha256"]))


def _check_name(file: ExpectedFile) -> ExpectedFile:
    """Check a name, which may come from a foreign backup, before it becomes a path."""
    if not _NAME.fullmatch(file.name):
        raise BackupRefused(why=file.name[:80])
    return file


def find_expected(settings: Settings) -> tuple[ExpectedFile, ...]:
    """Return every file that has a row now."""
    with _reading(settings) as connection:
        return read_expected(connection)


def read_expected(connection: Connection) -> tuple[ExpectedFile, ...]:
    """Return the files of the rows."""
    columns = (
        (recordings.c.id, recordings.c.sha256, recordings.c.state),
        (analyses.c.id, analyses.c.recording_id, analyses.c.token),
        (result_files.c.analysis_id, result_files.c.name, result_files.c.sha256),
    )
    rows = [[row._asdict() for row in connection.execute(select(*chosen))] for chosen in columns]
    return tuple(find_files(*rows))


def measure_expected(settings: Settings) -> int:
    """Return the total size of all recordings and results by their rows, in bytes."""
    sizes = [select(func.coalesce(func.sum(table.c.size_bytes), 0)) for table in (recordings, result_files)]
    with _reading(settings) as connection:
        return sum(int(connection.execute(size).scalar_one()) for size in sizes)


def find_faults(settings: Settings, files: tuple[ExpectedFile, ...]) -> Iterator[Fault]:
    """Read every file and compare it with its row, and find files without one.

    The server may run meanwhile: a file whose row was deleted or added since is not a fault, nor is a file of
    a running attempt.
    """
    storage = open_storage(settings)
    storage.prepare()
    beside = {f"{file.name}{SIDE_SUFFIX}" for file in files if file.name.startswith("recordings/")}
    strangers = set(storage.find_names()) - {file.name for file in files} - beside
    suspects = [fault for file in files if (fault := _check(storage, file))]
    still = {file.name for file in find_expected(settings)} if suspects or strangers else set()
    yield from (fault for fault in suspects if fault.name in still)
    if strangers:
        running = select(analyses.c.id, analyses.c.token).where(analyses.c.state == JobState.RUNNING)
        with _reading(settings) as connection:
            at_work = tuple(f"analyses/{row.id}/{row.token}/" for row in connection.execute(running))
        gone = strangers - set(storage.find_names())
        for name in sorted(strangers - still - gone):
            if not name.startswith(at_work):
                yield Fault(name, "orphan")
    yield from _check_side_files(settings, storage)
    yield from (Fault(name, "quarantine") for name in find_strange(storage))


def _check_side_files(settings: Settings, storage: Storage) -> Iterator[Fault]:
    """Compare every side file with its row; read a differing one again, as the server may be writing it."""
    suspects = _compare_side_files(settings, storage)
    for _ in range(RECHECKS):
        if not suspects:
            return
        time.sleep(RECHECK_PAUSE_S)
        suspects &= _compare_side_files(settings, storage)
    yield from sorted(suspects, key=lambda fault: fault.name)


def _compare_side_files(settings: Settings, storage: Storage) -> set[Fault]:
    present = storage.find_recordings()
    kept = (recordings.c.id, recordings.c.revision, recordings.c.side_revision)
    with _reading(settings) as connection:
        rows = connection.execute(select(*kept).where(recordings.c.state != PURGING)).all()
    faults = set()
    for recording_id, revision, written in rows:
        name = format_side_file_name(recording_id)
        side = decode_side_file(storage.read_small(name), recording_id)
        if side is None:
            is_there = f"{recording_id}{SIDE_SUFFIX}" in present
            faults.add(Fault(name, "side_damaged" if is_there else "side_missing"))
        elif side.revision > revision:
            faults.add(Fault(name, "side_ahead"))
        elif side.revision < revision:
            faults.add(Fault(name, "side_waiting" if written < revision else "side_behind"))
    return faults


@contextmanager
def _reading(settings: Settings) -> Iterator[Connection]:
    """Connect to the database for one reading."""
    engine = connect(settings.database_url).execution_options(**READ_ONLY)
    try:
        with engine.connect() as connection:
            yield connection
    finally:
        engine.dispose()


def _check(storage: Storage, file: ExpectedFile) -> Fault | None:
    try:
        sha256, _ = storage.hash(file.name)
    except FileNotFoundError:
        return Fault(file.name, "missing")
    except OSError:
        sha256 = ""
    return None if sha256 == file.sha256 else Fault(file.name, "damaged")
