"""The side file of each stored recording: a copy of its rows beside its bytes, in case the database is lost.

Every change of a recording or of its analyses increments ``recordings.revision`` in the same transaction
(:func:`increment_revision`). Housekeeping writes outdated side files within a second or two of the commit;
``recordings.side_revision`` is then the written revision. If a side file and the rows differ, the rows count.
"""

import hashlib
import json
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Engine, Table, delete, insert, select, update

from acromion.app.library.database.connect import reset_row
from acromion.app.library.database.tables import (
    REVISION,
    analyses,
    answers,
    batch_items,
    batches,
    recordings,
    releases,
    result_files,
)
from acromion.app.library.rows import PURGING, TRANSITIONS, JobState
from acromion.app.store.folder import SIDE_SUFFIX, Storage, format_side_file_name

SCHEMA = "acromion.recording/1"
TABLES: tuple[Table, ...] = (recordings, analyses, result_files, answers, releases, batches, batch_items)
"""Tables of a side file, in the order in which rows may be added."""

Rows = Mapping[str, Sequence[Mapping[str, Any]]]

writing_side_file = threading.Lock()
"""Held while a side file is written and while a purge begins, so that none appears after a purge."""


@dataclass(frozen=True, slots=True)
class SideFile:
    """The rows of one recording by table, at one revision."""

    revision: int
    rows: Rows
    tables: str = REVISION

    @property
    def recording(self) -> Mapping[str, Any]:
        """The row of the recording itself."""
        return self.rows["recordings"][0]

    def encode(self) -> bytes:
        """Return the content of the file: indented JSON, with a digest of the rows."""
        content = {"schema": SCHEMA, "tables": self.tables, "revision": self.revision}
        content |= {"sha256": _hash_rows(self.rows), "rows": self.rows}
        return json.dumps(content, ensure_ascii=False, indent=1).encode()


def decode_side_file(content: bytes | None, recording_id: str) -> SideFile | None:
    """Parse the content of a side file; None if it is missing, damaged, or of another recording."""
    try:
        found = json.loads(content or b"")
        side = SideFile(int(found["revision"]), found["rows"], str(found["tables"]))
        is_whole = found["schema"] == SCHEMA and found["sha256"] == _hash_rows(side.rows)
        return side if is_whole and side.recording["id"] == recording_id else None
    except (ValueError, KeyError, TypeError, IndexError):
        return None


def _hash_rows(rows: Rows) -> str:
    return hashlib.sha256(json.dumps(rows, sort_keys=True).encode()).hexdigest()


def increment_revision(connection: Connection, *recording_ids: str) -> None:
    """Increment the revision of recordings, in the transaction that changes them or their analyses.

    The order is always the same, so that two transactions do not wait for each other.
    """
    for recording_id in sorted(set(recording_ids)):
        mine = recordings.c.id == recording_id
        connection.execute(update(recordings).where(mine).values(revision=recordings.c.revision + 1))


def increment_revision_of(connection: Connection, analysis_id: str) -> str:
    """Increment the revision of an analysis's recording; return the recording id, "" if there is none."""
    query = select(analyses.c.recording_id).where(analyses.c.id == analysis_id)
    recording_id = connection.execute(query).scalar()
    if recording_id is None:
        return ""
    increment_revision(connection, recording_id)
    return str(recording_id)


def read_side_rows(connection: Connection, recording_id: str) -> SideFile | None:
    """Return the rows of a recording for its side file; None if it does not exist."""
    row = connection.execute(select(recordings).where(recordings.c.id == recording_id)).one_or_none()
    if row is None:
        return None
    own = row._asdict()
    del own["side_revision"]  # it changes when the side file is written
    of_it = select(analyses.c.id).where(analyses.c.recording_id == recording_id)
    items = select(batch_items).where(batch_items.c.analysis_id.in_(of_it))
    of_batches = select(batches).where(batches.c.id.in_(items.with_only_columns(batch_items.c.batch_id)))
    queries = {
        "analyses": select(analyses)
        .where(analyses.c.recording_id == recording_id)
        .order_by(analyses.c.created_at, analyses.c.id),
        "result_files": select(result_files)
        .where(result_files.c.analysis_id.in_(of_it))
        .order_by(result_files.c.analysis_id, result_files.c.name),
        "answers": select(answers).where(answers.c.analysis_id.in_(of_it)).order_by(answers.c.analysis_id),
        "releases": select(releases).where(releases.c.analysis_id.in_(of_it)).order_by(releases.c.id),
        "batches": of_batches.order_by(batches.c.id),
        "batch_items": items.order_by(batch_items.c.batch_id, batch_items.c.place),
    }
    rows: dict[str, Sequence[Mapping[str, Any]]] = {"recordings": [own]}
    for name, query in queries.items():
        found = connection.execute(query)
        rows[name] = [reset_row(name, line._asdict()) for line in found]
    return SideFile(own["revision"], rows)


def add_missing_rows(connection: Connection, side: SideFile) -> Rows:
    """Add the rows of a side file that the database lacks; return the added rows.

    Present rows stay unchanged, except for an analysis that is unfinished in the database and over in the
    side file: states only move forward. Files and figures are added with their analysis.
    """
    kept, ended = set(), []
    for row in side.rows["analyses"]:
        mine = analyses.c.id == row["id"]
        state = connection.execute(select(analyses.c.state).where(mine)).scalar()
        if state is None:
            continue
        if TRANSITIONS[JobState(state)] and not TRANSITIONS[JobState(row["state"])]:
            connection.execute(update(analyses).where(mine).values(row))
            ended.append(row)
        else:
            kept.add(row["id"])
    added: dict[str, list[Mapping[str, Any]]] = {table.name: [] for table in TABLES}
    for table in TABLES:
        analysis_id = "id" if table is analyses else "analysis_id"
        for row in side.rows.get(table.name, ()):
            if row.get(analysis_id) in kept:
                continue
            key = [column == row[column.name] for column in table.primary_key.columns]
            if connection.execute(select(table).where(*key)).first() is None:
                connection.execute(insert(table).values(row))
                added[table.name].append(row)
    return added | {"analyses": [*added["analyses"], *ended]}


def replace_rows(connection: Connection, side: SideFile) -> Rows:
    """Replace the older rows of a recording by those of its side file; return the new rows."""
    recording_id = str(side.recording["id"])
    of_it = select(analyses.c.id).where(analyses.c.recording_id == recording_id)
    connection.execute(delete(result_files).where(result_files.c.analysis_id.in_(of_it)))
    connection.execute(delete(analyses).where(analyses.c.recording_id == recording_id))
    values = {**side.recording, "side_revision": side.revision}
    connection.execute(update(recordings).where(recordings.c.id == recording_id).values(values))
    return add_missing_rows(connection, side)


def mark_side_file_stale(connection: Connection, side: SideFile) -> None:
    """Raise the revision of the row above that of the side file, so that the side file is written again."""
    mine = recordings.c.id == side.recording["id"]
    revision = connection.execute(select(recordings.c.revision).where(mine)).scalar_one()
    later = max(revision, side.revision) + 1
    connection.execute(update(recordings).where(mine).values(revision=later, side_revision=0))


def quarantine_side_file(storage: Storage, side: SideFile) -> None:
    """Keep a copy of a side file in quarantine before it is overwritten."""
    name = f"quarantine/{side.recording['id']}.{side.revision}{SIDE_SUFFIX}"
    storage.write_small(name, side.encode())


@dataclass(frozen=True, slots=True)
class SideWriter:
    """Writes outdated side files."""

    engine: Engine
    reader: Engine
    storage: Storage

    def write_lagging(self, most: int) -> int:
        """Write outdated side files, those never written first; return their number."""
        lagging = (
            select(recordings.c.id)
            .where(recordings.c.side_revision < recordings.c.revision, recordings.c.state != PURGING)
            .order_by(recordings.c.side_revision, recordings.c.id)
            .limit(most)
        )
        with self.reader.connect() as connection:
            found = connection.execute(lagging).scalars().all()
        for recording_id in found:
            self.write(recording_id)
        return len(found)

    def write_all(self) -> int:
        """Write every outdated side file; return their number."""
        number = 0
        while written := self.write_lagging(500):
            number += written
        return number

    def write(self, recording_id: str) -> None:
        """Write one side file; repeat if the row changes before its revision is recorded."""
        name = format_side_file_name(recording_id)
        with writing_side_file:
            while (side := self._read(recording_id)) is not None:
                present = decode_side_file(self.storage.read_small(name), recording_id)
                if present is not None and present.revision > side.revision:
                    row = self._read(recording_id)
                    if row is not None and row.revision < present.revision:  # the database is an older copy
                        quarantine_side_file(self.storage, present)
                self.storage.write_small(name, side.encode())
                mine = (recordings.c.id == recording_id, recordings.c.revision == side.revision)
                with self.engine.begin() as connection:
                    written = update(recordings).where(*mine).values(side_revision=side.revision)
                    if connection.execute(written).rowcount == 1:
                        return
                if self._read(recording_id) is None:  # another server purges it: also remove its side file
                    self.storage.add_erased([recording_id])
                    self.storage.drop_recording(recording_id)

    def _read(self, recording_id: str) -> SideFile | None:
        """Return the rows of a recording; None if it is gone or being purged."""
        with self.reader.connect() as connection:
            side = read_side_rows(connection, recording_id)
        return None if side is None or side.recording["state"] == PURGING else side

    def mark_side_files_missing(self, recording_ids: Sequence[str]) -> None:
        """Record that these recordings have no side file, so that it is written again."""
        with self.engine.begin() as connection:
            for recording_id in recording_ids:
                mine = recordings.c.id == recording_id
                connection.execute(update(recordings).where(mine).values(side_revision=0))
