"""The side file of each stored recording: what its rows say, kept beside its bytes, for a lost database.

Every change of a recording or of its analyses counts up ``recordings.revision`` in its own transaction
(:func:`count_change`). The side file is written after that commit, and ``recordings.side_revision`` notes the
revision that it tells. A crash between the two leaves a lag, which the next writer makes good. Where a side
file and the rows differ, the rows count.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Engine, Table, insert, select, update

from app.jobs.database.dump import settle_row
from app.jobs.database.tables import (
    REVISION,
    analyses,
    answers,
    batch_items,
    batches,
    recordings,
    result_files,
)
from app.jobs.job import TRANSITIONS, JobState
from app.jobs.rows import PURGING
from app.storage.store import SIDE_SUFFIX, Storage, name_side

SCHEMA = "acromion.recording/1"
TABLES: tuple[Table, ...] = (recordings, analyses, result_files, answers, batches, batch_items)
"""What a side file holds, in the order in which rows may be added."""

Rows = Mapping[str, Sequence[Mapping[str, Any]]]


@dataclass(frozen=True, slots=True)
class SideFile:
    """The rows of one recording by table, as they were at a revision."""

    revision: int
    rows: Rows

    @property
    def is_purging(self) -> bool:
        """It was deleted for good, and the deletion was interrupted."""
        return bool(self.recording["state"] == PURGING)

    @property
    def recording(self) -> Mapping[str, Any]:
        """The row of the recording itself."""
        return self.rows["recordings"][0]

    def encode(self) -> bytes:
        """Write it as JSON that people can read, with a digest of the rows."""
        told = {"schema": SCHEMA, "tables": REVISION, "revision": self.revision}
        told |= {"sha256": _hash_rows(self.rows), "rows": self.rows}
        return json.dumps(told, ensure_ascii=False, indent=1).encode()


def decode_side_file(content: bytes | None, recording_id: str) -> SideFile | None:
    """Read a side file; None where it is absent, damaged, or of another recording."""
    try:
        told = json.loads(content or b"")
        side = SideFile(int(told["revision"]), told["rows"])
        is_whole = told["schema"] == SCHEMA and told["sha256"] == _hash_rows(side.rows)
        return side if is_whole and side.recording["id"] == recording_id else None
    except (ValueError, KeyError, TypeError, IndexError):
        return None


def _hash_rows(rows: Rows) -> str:
    return hashlib.sha256(json.dumps(rows, sort_keys=True).encode()).hexdigest()


def count_change(connection: Connection, *recording_ids: str) -> None:
    """Count a change of these recordings, or of their analyses, in the transaction that makes it.

    Always in the same order, so that two transactions do not wait for each other.
    """
    for recording_id in sorted(set(recording_ids)):
        mine = recordings.c.id == recording_id
        connection.execute(update(recordings).where(mine).values(revision=recordings.c.revision + 1))


def count_change_of(connection: Connection, analysis_id: str) -> None:
    """Count a change of the recording that an analysis is of."""
    query = select(analyses.c.recording_id).where(analyses.c.id == analysis_id)
    recording_id = connection.execute(query).scalar()
    if recording_id is not None:
        count_change(connection, recording_id)


def read_side_rows(connection: Connection, recording_id: str) -> SideFile | None:
    """Build the side file of a recording from its rows; None where it has none."""
    row = connection.execute(select(recordings).where(recordings.c.id == recording_id)).one_or_none()
    if row is None:
        return None
    own = row._asdict()
    del own["side_revision"]  # it says how far the side file is, and would change by writing it
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
        "batches": of_batches.order_by(batches.c.id),
        "batch_items": items.order_by(batch_items.c.batch_id, batch_items.c.place),
    }
    rows: dict[str, Sequence[Mapping[str, Any]]] = {"recordings": [own]}
    for name, query in queries.items():
        found = connection.execute(query)
        rows[name] = [settle_row(name, line._asdict()) for line in found]
    return SideFile(own["revision"], rows)


def add_missing_rows(connection: Connection, side: SideFile) -> Rows:
    """Add the rows of a side file that the database does not have; gives those that were added.

    Rows that are there stay as they are, but for an analysis that has ended since: states only move forward.
    Files and figures come with their analysis. Columns of another release are left out or take their default.
    """
    kept, moved_on = _compare_analyses(connection, side.rows["analyses"])
    added = {}
    for table in TABLES:
        rows = side.rows.get(table.name, ())
        if table is analyses:
            rows = [row for row in rows if row["id"] not in kept]
        elif "analysis_id" in table.columns:
            rows = [row for row in rows if row["analysis_id"] not in kept]
        added[table.name] = _add_missing(connection, table, rows)
    return added | {"analyses": [*added["analyses"], *moved_on]}


def _compare_analyses(
    connection: Connection, rows: Sequence[Mapping[str, Any]]
) -> tuple[frozenset[str], list[Mapping[str, Any]]]:
    """Give the analyses that stay as they are, and those that have ended since, as they ended."""
    kept, moved_on = set(), []
    for row in rows:
        mine = analyses.c.id == row["id"]
        state = connection.execute(select(analyses.c.state).where(mine)).scalar()
        if state is None:
            continue
        if TRANSITIONS[JobState(state)] and not TRANSITIONS[JobState(row["state"])]:
            values = {name: value for name, value in row.items() if name in analyses.columns}
            connection.execute(update(analyses).where(mine).values(values))
            moved_on.append(row)
        else:
            kept.add(str(row["id"]))
    return frozenset(kept), moved_on


def _add_missing(
    connection: Connection, table: Table, rows: Sequence[Mapping[str, Any]]
) -> list[Mapping[str, Any]]:
    added = []
    for row in rows:
        key = [column == row[column.name] for column in table.primary_key.columns]
        if connection.execute(select(table).where(*key)).first() is None:
            values = {name: value for name, value in row.items() if name in table.columns}
            connection.execute(insert(table).values(values))
            added.append(row)
    return added


def outdate_side_file(connection: Connection, side: SideFile) -> None:
    """Let the row count on from a side file that is ahead of it, and have the side file written anew."""
    mine = recordings.c.id == side.recording["id"]
    revision = connection.execute(select(recordings.c.revision).where(mine)).scalar_one()
    later = max(revision, side.revision) + 1
    connection.execute(update(recordings).where(mine).values(revision=later, side_revision=0))


def spare_side_file(storage: Storage, side: SideFile) -> None:
    """Keep a side file that is to be written anew in quarantine."""
    name = f"quarantine/{side.recording['id']}.{side.revision}{SIDE_SUFFIX}"
    storage.write_small(name, side.encode())


@dataclass(frozen=True, slots=True)
class SideWriter:
    """Writes the side files that are behind their rows."""

    engine: Engine
    reader: Engine
    storage: Storage

    def write_lagging(self, most: int) -> int:
        """Write the side files that lag, those that were never written first; gives their number."""
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
        """Write every side file that lags; gives their number."""
        number = 0
        while written := self.write_lagging(500):
            number += written
        return number

    def write(self, recording_id: str) -> None:
        """Write one side file, again if the row changes meanwhile."""
        while not self._try_to_write(recording_id):
            pass

    def _try_to_write(self, recording_id: str) -> bool:
        """Write what the row says now; False when it has changed before that was noted."""
        side = self._read(recording_id)
        if side is None:
            return True
        name = name_side(recording_id)
        self._spare_newer(recording_id, side)
        self.storage.write_small(name, side.encode())
        mine = (recordings.c.id == recording_id, recordings.c.revision == side.revision)
        with self.engine.begin() as connection:
            written = update(recordings).where(*mine).values(side_revision=side.revision)
            if connection.execute(written).rowcount == 1:
                return True
        if self._read(recording_id) is None:  # purged meanwhile: its side file goes, too
            self.storage.drop_recording(recording_id)
        return False

    def _spare_newer(self, recording_id: str, side: SideFile) -> None:
        """Keep a side file that is newer than the row in quarantine: the database is an older copy."""
        present = decode_side_file(self.storage.read_small(name_side(recording_id)), recording_id)
        if present is None or present.revision <= side.revision:
            return
        row = self._read(recording_id)
        if row is not None and row.revision < present.revision:
            spare_side_file(self.storage, present)

    def _read(self, recording_id: str) -> SideFile | None:
        with self.reader.connect() as connection:
            return read_side_rows(connection, recording_id)

    def note_absent(self, recording_ids: Sequence[str]) -> None:
        """Note that these recordings have no side file, so that it is written anew."""
        with self.engine.begin() as connection:
            for recording_id in recording_ids:
                mine = recordings.c.id == recording_id
                connection.execute(update(recordings).where(mine).values(side_revision=0))
