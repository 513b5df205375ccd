"""Compare the store with the rows at a start, and recover lost rows from the side files.

A start removes nothing unknown:
- A recording without a row but with a valid side file means that the database is lost, older or foreign: the
  start is refused.
- An entry with neither is moved into quarantine, and reported.
- An interrupted purge continues, and entries of the ledger of erasures are erased again.
- Old temporary files, and attempts of known analyses that do not count, are removed.
"""

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Literal

from sqlalchemy import delete

from acromion.app.errors import UnknownRecordings, WrongSchema
from acromion.app.library.audit_log import AT_MACHINE, record
from acromion.app.library.database.connect import bring_up_to_date
from acromion.app.library.database.tables import REVISION, known_browsers, sessions, tickets
from acromion.app.library.jobs import JobStore
from acromion.app.library.listing import SavedViews
from acromion.app.library.rows import TRASHED, JobState
from acromion.app.library.side_files import (
    Rows,
    SideFile,
    SideWriter,
    add_missing_rows,
    decode_side_file,
    mark_side_file_stale,
    quarantine_side_file,
    replace_rows,
)
from acromion.app.ops.copies import restore_copy
from acromion.app.ops.place import NO_ACCOUNTS, Accounts, find_accounts
from acromion.app.settings import Settings
from acromion.app.store.folder import (
    SIDE_SUFFIX,
    FolderLock,
    Storage,
    format_recording_name,
    format_side_file_name,
    open_storage,
)

OWN_NAME = re.compile(r"rec_[0-9a-f]{16}\.\d+\.json")
"""Name in quarantine of a side file that was newer than its row.

See :func:`acromion.app.library.side_files.quarantine_side_file`.
"""

Finding = Literal["no_bytes", "cut", "no_report", "newer", "trashed_since", "side_damaged", "strange"]


@dataclass(frozen=True, slots=True)
class Unknown:
    """Entries among the recordings that have no row."""

    recoverable: tuple[str, ...] = ()
    """Recordings with a valid side file."""
    strange: tuple[str, ...] = ()
    """Names of entries without a valid side file."""
    erased: tuple[str, ...] = ()
    """Recordings in the ledger of erasures that still have files."""


def find_unknown(store: JobStore, storage: Storage) -> Unknown:
    """Compare the entries among the recordings with the rows.

    Raises WrongSchema if side files belong to another version.
    """
    names = storage.find_recordings()  # first: the row of a recording stored meanwhile then exists
    rows = store.find_recordings()
    found = {name for name in names if name.removesuffix(SIDE_SUFFIX) not in rows}
    if not found:
        return Unknown()
    erased = storage.find_erased() & {name.removesuffix(SIDE_SUFFIX) for name in found}
    found = {name for name in found if name.removesuffix(SIDE_SUFFIX) not in erased}
    suspects = sorted({name.removesuffix(SIDE_SUFFIX) for name in found if name.endswith(SIDE_SUFFIX)})
    # a recording that is purged meanwhile loses its side file before its row
    sides = {one: side for one in suspects if (side := read_side_file(storage, one))}
    kept = {name for one in sides for name in (one, f"{one}{SIDE_SUFFIX}")}
    for side in sides.values():
        _check_schema(side)
    return Unknown(tuple(sides), tuple(sorted(found - kept)), tuple(sorted(erased)))


def _check_schema(side: SideFile) -> None:
    if side.tables != REVISION:
        raise WrongSchema(found=side.tables, needed=REVISION)


def check_known(store: JobStore, storage: Storage) -> Unknown:
    """Check that every stored recording has a row; return the other unknown entries.

    Raises WrongSchema. Raises UnknownRecordings if a recording has a valid side file and no row: the database
    is lost, older or foreign.
    """
    unknown = find_unknown(store, storage)
    if unknown.recoverable:
        raise UnknownRecordings(number=len(unknown.recoverable), first=unknown.recoverable[0])
    return unknown


def restore_known(store: JobStore, storage: Storage) -> int:
    """Move recordings with a row back from quarantine (after a restored database); return their number."""
    rows, present = store.find_recordings(), storage.find_recordings()
    known = [name for name in storage.find_quarantined() if name in rows - present]
    return sum(storage.unquarantine(name) for name in known)


def quarantine_strange(storage: Storage, unknown: Unknown) -> int:
    """Move unknown entries into quarantine; return their number."""
    return sum(storage.quarantine(name) for name in unknown.strange)


def finish_purges(storage: Storage, unknown: Unknown) -> None:
    """Remove remaining files of erased recordings without rows, and of their analyses."""
    erased = storage.find_erased()
    if not erased:
        return
    present = {analysis_id for analysis_id, _ in storage.find_attempts()}  # includes those of a killed worker
    if unknown.erased:
        present |= {name.split("/")[1] for name in storage.find_names() if name.startswith("analyses/")}
    for analysis_id in present & erased:
        storage.drop_analysis(analysis_id)
    for recording_id in unknown.erased:
        storage.drop_recording(recording_id)


def find_strange(storage: Storage) -> tuple[str, ...]:
    """Find everything in quarantine except our own copies of side files."""
    return tuple(name for name in storage.find_quarantined() if not OWN_NAME.fullmatch(name))


def read_side_file(storage: Storage, recording_id: str) -> SideFile | None:
    """Return the side file of a recording; None if it is missing or invalid."""
    return decode_side_file(storage.read_small(format_side_file_name(recording_id)), recording_id)


def drop_stale_attempts(store: JobStore, storage: Storage) -> tuple[int, int]:
    """Remove the folders of discarded attempts of known analyses.

    An attempt that counts by the side file of its recording stays, because the database is an older copy.
    Returns the numbers of removed and of such newer attempts.
    """
    found = storage.find_attempts()  # first: the row of an attempt that starts meanwhile then exists
    known, counted = store.find_analyses(), store.find_attempts()
    stale = [attempt for attempt in found if attempt[0] in known and attempt not in counted]
    newer = 0
    for analysis_id, token in stale:
        side = read_side_file(storage, store.find_recording(analysis_id))
        rows = side.rows["analyses"] if side else ()
        named = {(row["id"], row["token"]) for row in rows if row["state"] == JobState.SUCCEEDED}
        if (analysis_id, token) in named:
            newer += 1
        else:
            storage.drop_attempt(analysis_id, token)
    return len(stale) - newer, newer


def update_side_files(store: JobStore, storage: Storage) -> int:
    """Write every missing or outdated side file, and the file of views; return their number."""
    writer = SideWriter(store.engine, store.reader, storage)
    names = storage.find_recordings()
    missing = [one for one in sorted(store.find_with_side()) if f"{one}{SIDE_SUFFIX}" not in names]
    writer.mark_side_files_missing(missing)
    SavedViews(store.engine, store.reader, storage).write_file()
    return writer.write_all()


@dataclass(frozen=True, slots=True)
class Trouble:
    """A recording, analysis or entry that was not recovered, or not completely."""

    name: str
    finding: Finding


@dataclass(frozen=True, slots=True)
class Recovered:
    """The counts and findings of a recovery."""

    recordings: int
    trashed: int
    reports: int
    known: int
    troubles: tuple[Trouble, ...]
    accounts: Accounts = NO_ACCOUNTS
    copied_at: str = ""
    """Date of the daily copy that was restored first."""
    erased: int = 0
    """Number of erased recordings that were found in the store or the database and skipped."""


def recover(settings: Settings) -> Recovered:
    """Add the missing rows of every recording with a valid side file; keep present rows.

    If the database is lost, the newest daily copy replaces it first; rows older than their side file are then
    replaced.

    Accounts, tokens and webhooks are restored with the copy; every session ends. Unfinished uploads are not
    recovered. A recording without bytes also gets its row, so that page and ``acromion verify`` report it.
    Raises FolderTaken, StoreMismatch, StoreAway, WrongSchema.
    """
    storage = open_storage(settings)
    storage.prepare()
    lock = FolderLock(settings.data_dir)
    try:
        copied_at = restore_copy(settings)
        bring_up_to_date(settings)
        with closing(JobStore(settings)) as store:
            store.check_belongs(storage.identify())
            recovered = _recover(store, storage, has_copy=bool(copied_at))
            recovered = replace(recovered, accounts=find_accounts(store.reader), copied_at=copied_at)
            with store.engine.begin() as connection:
                for table in (sessions, tickets, known_browsers):  # everyone must sign in again
                    connection.execute(delete(table))
                record(connection, "store.recovered", other={"added": recovered.recordings}, who=AT_MACHINE)
            return recovered
    finally:
        lock.release()


def _recover(store: JobStore, storage: Storage, *, has_copy: bool) -> Recovered:
    unknown = find_unknown(store, storage)
    finish_purges(storage, unknown)
    known_erased = storage.find_erased() & store.find_recordings()
    for recording_id in known_erased:
        store.mark_purging(recording_id)  # an older database was restored: the next start deletes it again
    names, before = storage.find_recordings(), store.find_recordings()
    results = frozenset(storage.find_names())
    troubles: list[Trouble] = []
    added: Counter[str] = Counter()
    with_side = (name.removesuffix(SIDE_SUFFIX) for name in names if name.endswith(SIDE_SUFFIX))
    for recording_id in sorted(with_side):
        side = read_side_file(storage, recording_id)
        if side is not None:
            _check_schema(side)
            rows, found = _recover_rows(store, storage, side, has_copy=has_copy)
            troubles += [*found, *_find_absent(storage, rows, results)]
            states = Counter(row["state"] for row in rows["analyses"])
            trashed = sum(row["state"] == TRASHED for row in rows["recordings"])
            added += Counter(
                recordings=len(rows["recordings"]), trashed=trashed, reports=states[JobState.SUCCEEDED]
            )
        elif recording_id in before:
            SideWriter(store.engine, store.reader, storage).mark_side_files_missing([recording_id])
            troubles.append(Trouble(recording_id, "side_damaged"))
    troubles += [Trouble(one, "no_bytes") for one in sorted(before - names) if store.is_kept(one)]
    troubles += [Trouble(name, "strange") for name in find_unknown(store, storage).strange]
    SavedViews(store.engine, store.reader, storage).recover()
    update_side_files(store, storage)
    return Recovered(
        recordings=added["recordings"],
        trashed=added["trashed"],
        reports=added["reports"],
        known=len(before),
        troubles=tuple(troubles),
        erased=len(known_erased.union(unknown.erased)),
    )


def _recover_rows(
    store: JobStore, storage: Storage, side: SideFile, *, has_copy: bool
) -> tuple[Rows, list[Trouble]]:
    """Add the missing rows of one recording; rewrite a side file that differs from a present row."""
    recording_id = str(side.recording["id"])
    revision = store.read_revision(recording_id)
    is_newer = 0 < revision < side.revision
    if is_newer and has_copy:
        with store.engine.begin() as connection:
            return replace_rows(connection, side), []
    is_trashed = is_newer and side.recording["state"] == TRASHED and store.is_kept(recording_id)
    if is_newer:
        quarantine_side_file(storage, side)
    with store.engine.begin() as connection:
        rows = add_missing_rows(connection, side)
        if revision and (revision != side.revision or any(rows.values())):
            mark_side_file_stale(connection, side)
    found: list[Finding] = ["newer"] * is_newer + ["trashed_since"] * is_trashed  # type: ignore[assignment]
    return rows, [Trouble(recording_id, finding) for finding in found]


def _find_absent(storage: Storage, rows: Rows, results: frozenset[str]) -> Iterator[Trouble]:
    """Find files of recovered rows that are missing or incomplete."""
    for row in rows["recordings"]:
        mark = storage.find_mark(format_recording_name(row["id"]))
        if mark is None or mark[0] != row["size_bytes"]:
            yield Trouble(row["id"], "no_bytes" if mark is None else "cut")
    tokens = {row["id"]: row["token"] for row in rows["analyses"]}
    promised = ((row["analysis_id"], row["name"]) for row in rows["result_files"])
    missing = {one for one, name in promised if f"analyses/{one}/{tokens.get(one)}/{name}" not in results}
    yield from (Trouble(analysis_id, "no_report") for analysis_id in sorted(missing))
