"""Bring back from the side files the recordings that the database has lost."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from app.errors import UnknownRecordings
from app.jobs.database.connect import bring_up_to_date
from app.jobs.job import JobState
from app.jobs.queries import TRASHED
from app.jobs.side_files import (
    Rows,
    SideFile,
    SideWriter,
    add_missing_rows,
    decode_side_file,
    mark_side_file_stale,
    quarantine_side_file,
)
from app.jobs.store import JobStore
from app.settings import Settings
from app.storage.open import open_storage
from app.storage.store import SIDE_SUFFIX, FolderLock, Storage, format_recording_name, format_side_file_name

# At a start: what lies in the store is compared with the rows, and nothing that is not known is removed.
#
# - A recording without a row but with a valid side file: the database is lost, older or foreign, and the
#   start   is refused.
# - An entry with neither goes to quarantine, and people are told.
# - An interrupted purge goes on.
# - Old temporary files, and attempts of known analyses that do not count, are removed.


SPARED = re.compile(r"rec_[0-9a-f]{16}\.\d+\.json")
"""The name of a side file that was newer than its row (:func:`app.jobs.side_files.quarantine_side_file`)."""
TEMPORARY_S = 6 * 3600.0
"""A temporary file that nobody has written to for so long belongs to no upload under way."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """Entries among the recordings that have no row."""

    recoverable: tuple[str, ...] = ()
    """Recordings with a valid side file."""
    strange: tuple[str, ...] = ()
    """Names of entries of which nothing is known."""
    purging: tuple[SideFile, ...] = ()
    """What is left of purges that were interrupted, and whose rows are gone or lost."""


def find_unknown(store: JobStore, storage: Storage) -> Unknown:
    """Compare the entries among the recordings with the rows."""
    names = storage.find_recordings()  # first: what is stored meanwhile has its row when those are read
    rows = store.find_recordings()
    found = {name for name in names if name.removesuffix(SIDE_SUFFIX) not in rows}
    if not found:
        return Unknown()
    suspects = sorted({name.removesuffix(SIDE_SUFFIX) for name in found if name.endswith(SIDE_SUFFIX)})
    # a recording that was purged meanwhile had lost its side file before its row
    sides = {one: side for one in suspects if (side := read_side_file(storage, one))}
    kept = {name for one in sides for name in (one, f"{one}{SIDE_SUFFIX}")}
    purging = tuple(side for side in sides.values() if side.is_purging)
    recoverable = tuple(one for one, side in sides.items() if not side.is_purging)
    return Unknown(recoverable, tuple(sorted(found - kept)), purging)


def check_known(store: JobStore, storage: Storage) -> Unknown:
    """See that the database knows every stored recording; gives what else is not known.

    Raises
    ------
    UnknownRecordings
        A recording has a valid side file and no row: the database is lost, older or foreign.
    """
    unknown = find_unknown(store, storage)
    if unknown.recoverable:
        raise UnknownRecordings(number=len(unknown.recoverable), first=unknown.recoverable[0])
    return unknown


def restore_known(store: JobStore, storage: Storage) -> int:
    """Move back from quarantine what has a row by now (its database was restored); gives the number."""
    rows, present = store.find_recordings(), storage.find_recordings()
    known = [name for name in storage.find_quarantined() if name in rows - present]
    return sum(storage.unquarantine(name) for name in known)


def quarantine_strange(storage: Storage, unknown: Unknown) -> int:
    """Move what is not known into quarantine; gives the number of entries moved."""
    return sum(storage.quarantine(name) for name in unknown.strange)


def finish_purges(storage: Storage, unknown: Unknown) -> None:
    """Remove what is left of purges whose rows are gone."""
    for side in unknown.purging:
        for row in side.rows["analyses"]:
            storage.drop_analysis(str(row["id"]))
        storage.drop_recording(str(side.recording["id"]))


def find_strange(storage: Storage) -> tuple[str, ...]:
    """Name what lies in quarantine and is not known; a spared side file of our own is."""
    return tuple(name for name in storage.find_quarantined() if not SPARED.fullmatch(name))


def read_side_file(storage: Storage, recording_id: str) -> SideFile | None:
    """Read the side file of a recording; None where it is absent or not valid."""
    return decode_side_file(storage.read_small(format_side_file_name(recording_id)), recording_id)


def drop_stale_attempts(store: JobStore, storage: Storage) -> tuple[int, int]:
    """Remove the folders of attempts that do not count, of analyses that the database knows.

    One that counts by the side file of its recording stays: the database is an older copy. Returns how many
    were removed, and how many of those stay.
    """
    found = storage.find_attempts()  # first: an attempt that begins meanwhile has its row when those are read
    known, counted = store.find_analyses(), store.find_attempts()
    stale = [attempt for attempt in found if attempt[0] in known and attempt not in counted]
    newer = 0
    for analysis_id, token in stale:
        if _counts_by_side_file(store, storage, analysis_id, token):
            newer += 1
        else:
            storage.drop_attempt(analysis_id, token)
    return len(stale) - newer, newer


def _counts_by_side_file(store: JobStore, storage: Storage, analysis_id: str, token: str) -> bool:
    side = read_side_file(storage, store.find_recording(analysis_id))
    rows = side.rows["analyses"] if side else ()
    named = ((row["id"], row["token"], row["state"]) for row in rows)
    return (analysis_id, token, JobState.SUCCEEDED) in named


def catch_up(store: JobStore, storage: Storage) -> int:
    """Write every side file that is absent or behind its row; gives their number."""
    writer = SideWriter(store.engine, store.reader, storage)
    writer.mark_side_files_missing(tuple(_find_without_side(store, storage)))
    return writer.write_all()


def _find_without_side(store: JobStore, storage: Storage) -> Iterator[str]:
    names = storage.find_recordings()
    for recording_id in sorted(store.find_with_side()):
        if f"{recording_id}{SIDE_SUFFIX}" not in names:
            yield recording_id


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
    names, before = storage.find_recordings(), store.find_recordings()
    results = frozenset(storage.find_names())
    troubles: list[Trouble] = []
    added: Counter[str] = Counter()
    with_side = (name.removesuffix(SIDE_SUFFIX) for name in names if name.endswith(SIDE_SUFFIX))
    finish_purges(storage, find_unknown(store, storage))
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
        quarantine_side_file(storage, side)
    with store.engine.begin() as connection:
        rows = add_missing_rows(connection, side)
        if revision and (revision != side.revision or any(rows.values())):
            mark_side_file_stale(connection, side)
    found: list[Finding] = ["newer"] * is_newer + ["trashed_since"] * is_trashed  # type: ignore[assignment]
    return rows, [Trouble(recording_id, finding) for finding in found]


def _count(rows: Rows) -> Counter[str]:
    trashed = [row for row in rows["recordings"] if row["state"] == TRASHED]
    reports = [row for row in rows["analyses"] if row["state"] == JobState.SUCCEEDED]
    return Counter(recordings=len(rows["recordings"]), trashed=len(trashed), reports=len(reports))


def _find_absent(storage: Storage, rows: Rows, results: frozenset[str]) -> Iterator[Trouble]:
    """Name the bytes that rows brought back promise and that are not there."""
    for row in rows["recordings"]:
        mark = storage.find_mark(format_recording_name(row["id"]))
        if mark is None or mark[0] != row["size_bytes"]:
            yield Trouble(row["id"], "no_bytes" if mark is None else "cut")
    tokens = {row["id"]: row["token"] for row in rows["analyses"]}
    promised = ((row["analysis_id"], row["name"]) for row in rows["result_files"])
    missing = {one for one, name in promised if f"analyses/{one}/{tokens.get(one)}/{name}" not in results}
    yield from (Trouble(analysis_id, "no_report") for analysis_id in sorted(missing))
