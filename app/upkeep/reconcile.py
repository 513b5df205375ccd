"""At a start: what lies in the store is compared with the rows, and nothing that is not known is removed.

- A recording without a row but with a valid side file: the database is lost, older or foreign, and the start
  is refused.
- An entry with neither goes to quarantine, and people are told.
- An interrupted purge goes on.
- Old temporary files, and attempts of known analyses that do not count, are removed.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from app.errors import UnknownRecordings
from app.jobs.side_files import SideFile, SideWriter, decode_side_file
from app.jobs.store import JobStore
from app.storage import SIDE_SUFFIX, Storage, name_side

TEMPORARY_S = 6 * 3600.0
"""A temporary file that nobody has written to for so long belongs to no upload under way."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """Entries among the recordings that have no row."""

    recoverable: tuple[str, ...]
    """Recordings with a valid side file."""
    strange: tuple[str, ...]
    """Names of entries of which nothing is known."""


def find_unknown(store: JobStore, storage: Storage) -> Unknown:
    """Compare the entries among the recordings with the rows."""
    names = storage.list_recordings()  # first: what is stored meanwhile has its row when those are read
    rows = store.list_recordings()
    found = {name for name in names if name.removesuffix(SIDE_SUFFIX) not in rows}
    if not found:
        return Unknown((), ())
    suspects = sorted({name.removesuffix(SIDE_SUFFIX) for name in found if name.endswith(SIDE_SUFFIX)})
    sides = [recording_id for recording_id in suspects if read_side_file(storage, recording_id)]
    # a recording that was purged meanwhile had lost its side file before its row
    kept = {name for recording_id in sides for name in (recording_id, f"{recording_id}{SIDE_SUFFIX}")}
    return Unknown(tuple(sides), tuple(sorted(found - kept)))


def check_known(store: JobStore, storage: Storage) -> None:
    """See that the database knows every stored recording.

    Raises
    ------
    UnknownRecordings
        A recording has a valid side file and no row: the database is lost, older or foreign.
    """
    unknown = find_unknown(store, storage)
    if unknown.recoverable:
        raise UnknownRecordings(number=len(unknown.recoverable), first=unknown.recoverable[0])


def return_known(store: JobStore, storage: Storage) -> int:
    """Move back from quarantine what has a row by now (its database was restored); gives the number."""
    rows, present = store.list_recordings(), storage.list_recordings()
    known = [name for name in storage.list_quarantine() if name in rows - present]
    return sum(storage.take_back(name) for name in known)


def set_strange_aside(store: JobStore, storage: Storage) -> int:
    """Move what is not known into quarantine; gives the number of entries moved."""
    return sum(storage.set_aside(name) for name in find_unknown(store, storage).strange)


def read_side_file(storage: Storage, recording_id: str) -> SideFile | None:
    """Read the side file of a recording; None where it is absent or not valid."""
    return decode_side_file(storage.read_small(name_side(recording_id)), recording_id)


def drop_stale_attempts(store: JobStore, storage: Storage) -> int:
    """Remove the folders of attempts that do not count, of analyses that the database knows."""
    found = storage.list_attempts()  # first: an attempt that begins meanwhile has its row when those are read
    known, counted = store.list_analyses(), store.list_attempts()
    stale = [attempt for attempt in found if attempt[0] in known and attempt not in counted]
    for analysis_id, token in stale:
        storage.drop_attempt(analysis_id, token)
    return len(stale)


def catch_up(store: JobStore, storage: Storage) -> int:
    """Write every side file that is absent or behind its row; gives their number."""
    writer = SideWriter(store.engine, store.reader, storage)
    writer.note_absent(tuple(_list_without_side(store, storage)))
    return writer.write_all()


def _list_without_side(store: JobStore, storage: Storage) -> Iterator[str]:
    names = storage.list_recordings()
    for recording_id in sorted(store.list_with_side()):
        if f"{recording_id}{SIDE_SUFFIX}" not in names:
            yield recording_id
