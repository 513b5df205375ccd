"""Bring back from the side files the recordings that the database has lost."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from app.jobs.database import bring_up_to_date
from app.jobs.job import JobState
from app.jobs.reading import TRASHED
from app.jobs.side_files import (
    Rows,
    SideFile,
    SideWriter,
    add_missing_rows,
    outdate_side_file,
    spare_side_file,
)
from app.jobs.store import JobStore
from app.settings import Settings
from app.storage import SIDE_SUFFIX, FolderLock, Storage, name_recording
from app.stores import open_storage
from app.upkeep.reconcile import catch_up, find_unknown, finish_purges, read_side_file

Finding = Literal["no_bytes", "cut", "no_report", "newer", "trashed_since", "side_damaged", "strange"]


@dataclass(frozen=True, slots=True)
class Trouble:
    """What could not be brought back, or not wholly."""

    name: str
    finding: Finding


@dataclass(frozen=True, slots=True)
class Recovered:
    """What a recovery has done."""

    recordings: int
    trashed: int
    reports: int
    known: int
    troubles: tuple[Trouble, ...]


def recover(settings: Settings) -> Recovered:
    """Add the missing rows of every recording with a valid side file; rows that are there stay as they are.

    Accounts, webhooks and uploads under way do not come back. A recording whose bytes are gone gets its row
    all the same, so that page and ``acromion verify`` name it.

    Raises
    ------
    FolderTaken, StoreMismatch, StoreAway
    """
    storage = open_storage(settings)
    storage.prepare()
    lock = FolderLock(settings.data_dir)
    try:
        bring_up_to_date(settings.database_url, settings.data_dir / "backups")
        return _recover_into(JobStore(settings.database_url), storage)
    finally:
        lock.release()


def _recover_into(store: JobStore, storage: Storage) -> Recovered:
    try:
        store.check_belongs(storage.identify())
        return _recover(store, storage)
    finally:
        store.close()


def _recover(store: JobStore, storage: Storage) -> Recovered:
    names, before = storage.list_recordings(), store.list_recordings()
    results = frozenset(storage.list_names())
    troubles: list[Trouble] = []
    added: Counter[str] = Counter()
    with_side = (name.removesuffix(SIDE_SUFFIX) for name in names if name.endswith(SIDE_SUFFIX))
    finish_purges(store, storage)
    for recording_id in sorted(with_side):
        side = read_side_file(storage, recording_id)
        if side is not None and side.is_purging:
            store.mark_purging(recording_id)
        elif side is not None:
            rows, found = _bring_back(store, storage, side)
            troubles += [*found, *_find_absent(storage, rows, results)]
            added += _count(rows)
        elif recording_id in before:
            SideWriter(store.engine, store.reader, storage).write(recording_id)
            troubles.append(Trouble(recording_id, "side_damaged"))
    troubles += [Trouble(one, "no_bytes") for one in sorted(before - names) if store.is_kept(one)]
    troubles += [Trouble(name, "strange") for name in find_unknown(store, storage).strange]
    catch_up(store, storage)
    return Recovered(
        recordings=added["recordings"],
        trashed=added["trashed"],
        reports=added["reports"],
        known=len(before),
        troubles=tuple(troubles),
    )


def _bring_back(store: JobStore, storage: Storage, side: SideFile) -> tuple[Rows, list[Trouble]]:
    """Add the rows that are missing; a side file that differs from a row that is there is written anew."""
    recording_id = str(side.recording["id"])
    revision = store.read_revision(recording_id)
    is_newer = 0 < revision < side.revision
    is_trashed = is_newer and side.recording["state"] == TRASHED and store.is_kept(recording_id)
    if is_newer:
        spare_side_file(storage, side)
    with store.engine.begin() as connection:
        rows = add_missing_rows(connection, side)
        if revision and (revision != side.revision or any(rows.values())):
            outdate_side_file(connection, side)
    found: list[Finding] = ["newer"] * is_newer + ["trashed_since"] * is_trashed  # type: ignore[assignment]
    return rows, [Trouble(recording_id, finding) for finding in found]


def _count(rows: Rows) -> Counter[str]:
    trashed = [row for row in rows["recordings"] if row["state"] == TRASHED]
    reports = [row for row in rows["analyses"] if row["state"] == JobState.SUCCEEDED]
    return Counter(recordings=len(rows["recordings"]), trashed=len(trashed), reports=len(reports))


def _find_absent(storage: Storage, rows: Rows, results: frozenset[str]) -> Iterator[Trouble]:
    """Name the bytes that rows brought back promise and that are not there."""
    for row in rows["recordings"]:
        mark = storage.find_mark(name_recording(row["id"]))
        if mark is None or mark[0] != row["size_bytes"]:
            yield Trouble(row["id"], "no_bytes" if mark is None else "cut")
    tokens = {row["id"]: row["token"] for row in rows["analyses"]}
    promised = ((row["analysis_id"], row["name"]) for row in rows["result_files"])
    missing = {one for one, name in promised if f"analyses/{one}/{tokens.get(one)}/{name}" not in results}
    yield from (Trouble(analysis_id, "no_report") for analysis_id in sorted(missing))
