"""The rows of recordings and of uploads under way."""

import hashlib
import json
import logging
import secrets
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, get_args

from sqlalchemy import Connection, Row, Select, delete, exists, insert, select, tuple_, update

from app.errors import NotHere, OnHold, PurgedSince, StaleVersion
from app.library.audit_log import Act, find_actor, record
from app.library.batches import join_study
from app.library.claims import WayIn, cancel_job, enqueue
from app.library.database.connect import BUSY_TIMEOUT_S, lock_tables
from app.library.database.tables import (
    analyses,
    batch_items,
    batches,
    purged_uploads,
    recordings,
    result_files,
    uploads,
)
from app.library.rows import (
    PURGING,
    REFERENCE,
    STORED,
    TRASHED,
    JobState,
    RowStore,
    format_diary,
    format_now,
    format_tags,
    read_diary,
    read_tags,
    select_running_s,
)
from app.library.side_files import increment_revision, writing_side_file
from app.request import ReportRequest
from app.store.folder import StoredRecording
from fusion.conventions import Side
from fusion.diary import DiaryEntry

HoldReason = Literal["legal", "complaint", "insurance", "study", "other"]
"""Why a recording is kept whatever happens: codes, for the audit log holds no sentence."""
HOLD_REASONS: tuple[HoldReason, ...] = get_args(HoldReason)

REPETITION_S = 24 * 3600.0
"""How long the same upload again is taken for a repetition, in running time of the server."""
PURGED = "purged"
"""Stands in the row of an upload for its recording, once that was deleted for good."""

Place = tuple[str, str]
"""Where a page of a list ended: the moment it is ordered by and the id of its last row."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Description:
    """What people enter about a recording. ``external_id`` is its name in their own system."""

    file_name: str
    subject: str = ""
    side: Side | None = None
    external_id: str = ""
    note: str = ""


@dataclass(frozen=True, slots=True)
class StoredRow:
    """A recording that was acknowledged.

    ``start`` is the device's clock at the first sample, ISO 8601, once it has been inspected. ``version``
    grows with every change. ``duplicate_of`` names the oldest recording of the same bytes. ``hold``: why
    nothing of it may be deleted for good, as a code, and ``hold_by`` who said so; "" where it may.
    """

    id: str
    sha256: str
    size_bytes: int
    state: Literal["stored", "trashed"]
    created_at: str
    about: Description
    duplicate_of: str | None
    version: int
    start: str | None
    inspection: Mapping[str, Any] | None
    diary: tuple[DiaryEntry, ...]
    hold: str = ""
    hold_by: str = ""


_ROW_COLUMNS = tuple(field.name for field in fields(StoredRow))


@dataclass(frozen=True, slots=True)
class RecordingFilter:
    """Which recordings are listed; "" or None asks for any. ``begin`` and ``end`` bound the start."""

    subject: str = ""
    external_id: str = ""
    sha256: str = ""
    begin: str = ""
    end: str = ""
    trashed: bool = False

    @property
    def by_start(self) -> bool:
        """Order by start, where the filter bounds it; else by the time of storing."""
        return bool(self.begin or self.end)

    def place(self, row: StoredRow) -> Place:
        """Return the place of a row in the list."""
        return (row.start or "" if self.by_start else row.created_at), row.id


@dataclass(frozen=True, slots=True)
class Purged:
    """The ids whose files a purge has still to remove from the store."""

    analyses: tuple[str, ...]
    recordings: tuple[str, ...]


class RecordingStore(RowStore):
    """Rows of recordings; every change is one guarded UPDATE that names the version it saw."""

    def add(self, stored: StoredRecording, about: Description) -> StoredRow:
        """Acknowledge a recording without asking for an analysis.

        The same bytes with the same description, sent again within a day by the same subject, give the row
        that is there: its id is another. Raises PurgedSince.
        """
        with self._engine.begin() as connection:
            check_not_purged(connection, stored, about)
            repeated = _find_repeated(connection, stored, about)
            if repeated is None:
                insert_recording(connection, stored, about)
        return self.get(repeated or stored.id)

    def add_reference(self, stored: StoredRecording, file_name: str) -> None:
        """Acknowledge a file that the comparison of another recording needs."""
        with self._engine.begin() as connection:
            insert_recording(connection, stored, Description(file_name), REFERENCE)

    def get(self, recording_id: str, *, trashed: bool = False) -> StoredRow:
        """Return one recording. Raises NotHere: also for one in the trash, unless asked for."""
        row = self._read_one(select(recordings).where(recordings.c.id == recording_id))
        if row is None or row.state == PURGING or (row.state == TRASHED and not trashed):
            raise NotHere(id=recording_id)
        return _read_recording(row)

    def find_page(
        self, wanted: RecordingFilter, limit: int, after: Place | None = None
    ) -> tuple[StoredRow, ...]:
        """Return the newest recordings that the filter lets through, from ``after`` on."""
        query = select(recordings).where(recordings.c.state == (TRASHED if wanted.trashed else STORED))
        for name in ("subject", "external_id", "sha256"):
            if value := getattr(wanted, name):
                query = query.where(recordings.c[name] == value)
        if wanted.begin:
            query = query.where(recordings.c.start >= wanted.begin)
        if wanted.end:
            query = query.where(recordings.c.start < wanted.end)
        moment = recordings.c.start if wanted.by_start else recordings.c.created_at
        page = select_page(query, (moment, recordings.c.id), limit, after)
        return tuple(_read_recording(row) for row in self._read_all(page))

    def find_known(self, recording_ids: Collection[str]) -> frozenset[str]:
        """Return the ids that belong to a recording, in the trash or not."""
        return self._read_ids(select(recordings.c.id).where(recordings.c.id.in_(recording_ids)))

    def find_of_subject(self, subject: str) -> frozenset[str]:
        """Return the ids of a subject's recordings of now, in the trash or not."""
        return self._read_ids(select(recordings.c.id).where(recordings.c.subject == subject))

    def change(self, recording_id: str, version: int, values: Mapping[str, object]) -> StoredRow:
        """Change columns, unless the row has changed since this version. Raises StaleVersion."""
        mine = (recordings.c.id == recording_id, recordings.c.version == version)
        change = update(recordings).where(*mine, recordings.c.state == STORED)
        with self._engine.begin() as connection:
            if connection.execute(change.values(version=version + 1, **values)).rowcount != 1:
                raise StaleVersion
            increment_revision(connection, recording_id)
            changed = dict.fromkeys(values, "changed")
            record(connection, "recording.changed", recording_id, other=changed)
        return self.get(recording_id)

    def describe(self, row: StoredRow, about: Description) -> StoredRow:
        """Change the description."""
        return self.change(row.id, row.version, asdict(about))

    def put_diary(self, row: StoredRow, diary: Sequence[DiaryEntry]) -> StoredRow:
        """Change the diary."""
        return self.change(row.id, row.version, {"diary": format_diary(diary)})

    def tag(self, recording_ids: Collection[str], added: Collection[str] = (), taken: str = "") -> int:
        """Add tags to recordings, or take one away; gives how many have changed."""
        changed = 0
        with self._engine.begin() as connection:
            for recording_id in sorted(recording_ids):
                mine = (recordings.c.id == recording_id, recordings.c.state == STORED)
                query = select(recordings.c.tags).where(*mine).with_for_update()
                text = connection.execute(query).scalar()
                if text is None:
                    continue
                tags = format_tags({*read_tags(text), *added} - {taken})
                if tags != text:
                    grown = {"version": recordings.c.version + 1, "revision": recordings.c.revision + 1}
                    connection.execute(update(recordings).where(*mine).values(tags=tags, **grown))
                    record(connection, "recording.tagged", recording_id)
                    changed += 1
        return changed

    def keep_inspection(self, recording_id: str, found: Mapping[str, Any]) -> None:
        """Store what an inspection found; it follows from the bytes, so that no version guards it."""
        values = {"inspection": json.dumps(dict(found)), "start": found.get("start")}
        with self._engine.begin() as connection:
            connection.execute(update(recordings).where(recordings.c.id == recording_id).values(values))
            increment_revision(connection, recording_id)

    def trash(self, recording_id: str) -> None:
        """Move a recording to the trash and cancel its analyses; nothing is deleted yet.

        A recording in the trash stays there as it is: its term does not start again. Raises NotHere.
        """
        self.get(recording_id, trashed=True)
        with self._engine.begin() as connection:
            _cancel_analyses(connection, recording_id)
            gone = update(recordings).where(recordings.c.id == recording_id, recordings.c.state == STORED)
            grown = {"version": recordings.c.version + 1, "revision": recordings.c.revision + 1}
            if connection.execute(gone.values(state=TRASHED, trashed_s=0.0, **grown)).rowcount == 1:
                record(connection, "recording.trashed", recording_id)

    def hasten_purge(self, recording_id: str, trashed_s: float) -> None:
        """Let a recording in the trash count as having been there for at least ``trashed_s``."""
        mine = update(recordings).where(recordings.c.id == recording_id, recordings.c.state == TRASHED)
        self._write(mine.where(recordings.c.trashed_s < trashed_s).values(trashed_s=trashed_s))

    def restore(self, recording_id: str) -> StoredRow:
        """Take a recording out of the trash."""
        self.get(recording_id, trashed=True)
        back = update(recordings).where(recordings.c.id == recording_id, recordings.c.state == TRASHED)
        with self._engine.begin() as connection:
            changed = back.values(state=STORED, trashed_s=None, version=recordings.c.version + 1)
            is_back = connection.execute(changed).rowcount == 1
            increment_revision(connection, recording_id)
            if is_back:
                record(connection, "recording.restored", recording_id)
        return self.get(recording_id)

    def begin_purge(self, recording_id: str) -> Purged:
        """Hide a recording and its references for good; gives the ids whose files are to be removed now.

        Its analyses are cancelled, so that none publishes files afterwards. The rows go last
        (:meth:`end_purge`), so that an interrupted purge can continue. Raises OnHold.
        """
        with writing_side_file, self._engine.begin() as connection:
            _cancel_analyses(connection, recording_id)
            _check_hold(connection, recording_id)
            mine = analyses.c.recording_id == recording_id
            of_it = tuple(connection.execute(select(analyses.c.id).where(mine)).scalars())
            files = (recording_id, *_find_references(connection, recording_id))
            row = connection.execute(select(recordings).where(recordings.c.id == recording_id)).one_or_none()
            if row is not None:
                key = _hash_upload(row.stored_by, row.sha256, _read_description(row))
                connection.execute(delete(purged_uploads).where(purged_uploads.c.key == key))
                connection.execute(insert(purged_uploads).values(key=key, since_s=select_running_s()))
            gone = update(recordings).where(recordings.c.id.in_(files))
            gone = gone.where(recordings.c.state != PURGING)
            if connection.execute(gone.values(state=PURGING, revision=recordings.c.revision + 1)).rowcount:
                record(connection, "recording.purging", recording_id)
        return Purged(of_it, files)

    def forget_purged(self) -> None:
        """Forget what was deleted for good more than a day of running time ago."""
        is_old = purged_uploads.c.since_s < select_running_s() - REPETITION_S
        self._write(delete(purged_uploads).where(is_old))

    def find_purging(self) -> tuple[str, ...]:
        """Return the recordings whose purge was interrupted."""
        query = select(recordings.c.id).where(recordings.c.state == PURGING)
        return tuple(row.id for row in self._read_all(query))

    def end_purge(self, recording_id: str) -> None:
        """Delete every row of a recording and of its references, once their files are gone."""
        with self._engine.begin() as connection:
            if delete_recording(connection, recording_id):
                record(connection, "recording.purged", recording_id)
        if self._engine.dialect.name == "sqlite":
            self._empty_log()

    def _empty_log(self) -> None:
        """Empty SQLite's write-ahead log, which may hold copies of deleted rows.

        While another connection writes the log back, SQLite refuses at once; a reader it waits for by itself.
        """
        end_s, raw = time.monotonic() + BUSY_TIMEOUT_S, self._engine.raw_connection()
        try:
            while raw.cursor().execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]:
                if time.monotonic() > end_s:
                    logger.warning("the write-ahead log could not be emptied: it is in use")
                    return
                time.sleep(0.05)
        finally:
            raw.close()

    def age_trash(self, elapsed_s: float, term_s: float) -> tuple[str, ...]:
        """Add elapsed time to everything in the trash; gives what has been there for the whole term.

        What is on hold neither ages nor is given.
        """
        trashed = (recordings.c.state == TRASHED) & recordings.c.hold.is_(None)
        older = update(recordings).where(trashed).values(trashed_s=recordings.c.trashed_s + elapsed_s)
        with self._engine.begin() as connection:
            connection.execute(older)
            due = select(recordings.c.id).where(trashed, recordings.c.trashed_s >= term_s)
            return tuple(connection.execute(due).scalars())

    def check_hold(self, recording_id: str) -> None:
        """Check that a recording may be deleted for good. Raises OnHold."""
        with self._reader.connect() as connection:
            _check_hold(connection, recording_id)

    def hold(self, recording_id: str, reason: HoldReason, who: str) -> StoredRow:
        """Put a recording on hold: nothing deletes it for good before it is let go. Raises NotHere."""
        return self._change_hold(recording_id, {"hold": reason, "hold_by": who}, "recording.held")

    def let_go(self, recording_id: str) -> StoredRow:
        """End the hold of a recording. Raises NotHere."""
        return self._change_hold(recording_id, {"hold": None, "hold_by": None}, "recording.let_go")

    def _change_hold(self, recording_id: str, values: Mapping[str, str | None], act: Act) -> StoredRow:
        mine = (recordings.c.id == recording_id, recordings.c.state.in_((STORED, TRASHED)))
        with self._engine.begin() as connection:
            if connection.execute(update(recordings).where(*mine).values(values)).rowcount != 1:
                raise NotHere(id=recording_id)
            increment_revision(connection, recording_id)
            why = {"reason": values["hold"]} if values["hold"] else {}
            record(connection, act, recording_id, other=why)
        return self.get(recording_id, trashed=True)


def _check_hold(connection: Connection, recording_id: str) -> None:
    """Refuse a recording on hold, and lock its row: nobody puts it on hold until the transaction ends."""
    query = select(recordings.c.hold).where(recordings.c.id == recording_id).with_for_update()
    held = connection.execute(query).scalar()
    if held is not None:
        raise OnHold(id=recording_id, why=held)


def delete_recording(connection: Connection, recording_id: str) -> bool:
    """Delete every row of a recording, its references, its analyses and the studies left empty.

    The rows of its uploads stay without words until their term: the upload has an end that can be told. False
    if there was none.
    """
    of_it = select(analyses.c.id).where(analyses.c.recording_id == recording_id)
    references = _find_references(connection, recording_id)
    connection.execute(delete(result_files).where(result_files.c.analysis_id.in_(of_it)))
    connection.execute(delete(analyses).where(analyses.c.recording_id == recording_id))
    emptied = {"recording_id": PURGED, "metadata": "", "description": json.dumps(asdict(Description("")))}
    connection.execute(update(uploads).where(uploads.c.recording_id == recording_id).values(emptied))
    files = (recording_id, *references)
    deleted = connection.execute(delete(recordings).where(recordings.c.id.in_(files))).rowcount
    drop_empty_batches(connection)
    return deleted > 0


def drop_empty_batches(connection: Connection) -> None:
    """Delete the batches that hold no analysis any more."""
    no_item = ~exists().where(batch_items.c.batch_id == batches.c.id)
    connection.execute(delete(batches).where(no_item))


def _find_repeated(connection: Connection, stored: StoredRecording, about: Description) -> str | None:
    """Find the recording of the same bytes and description that this subject stored within a day.

    Of two that come at once, the second waits until the first has its row.
    """
    lock_tables(connection)
    is_new = recordings.c.since_s >= select_running_s() - REPETITION_S
    mine = (recordings.c.sha256 == stored.sha256, recordings.c.stored_by == find_actor())
    query = select(recordings).where(*mine, is_new, recordings.c.state == STORED)
    rows = connection.execute(query.order_by(recordings.c.created_at)).all()
    return next((row.id for row in rows if _read_description(row) == about), None)


def _read_description(row: Row[Any]) -> Description:
    return Description(row.file_name, row.subject, row.side, row.external_id, row.note)


def check_not_purged(connection: Connection, stored: StoredRecording, about: Description) -> None:
    """Refuse to bring back by a repeated request what was deleted for good. Raises PurgedSince."""
    key = _hash_upload(find_actor(), stored.sha256, about)
    is_old = purged_uploads.c.since_s < select_running_s() - REPETITION_S
    known = select(purged_uploads.c.key).where(purged_uploads.c.key == key, ~is_old)
    if connection.execute(known).first() is not None:
        raise PurgedSince


def _hash_upload(who: str, sha256: str, about: Description) -> str:
    return hashlib.sha256(json.dumps([who, sha256, asdict(about)]).encode()).hexdigest()


def _cancel_analyses(connection: Connection, recording_id: str) -> None:
    """Cancel the analyses that wait or run.

    Call this before the recording is locked: an ending analysis takes its locks in this order.
    """
    going_on = analyses.c.state.in_((JobState.QUEUED, JobState.RUNNING))
    mine = select(analyses.c.id).where(analyses.c.recording_id == recording_id, going_on)
    for analysis_id in connection.execute(mine.with_for_update()).scalars().all():
        cancel_job(connection, analysis_id)


def _find_references(connection: Connection, recording_id: str) -> tuple[str, ...]:
    asked = select(analyses.c.request).where(analyses.c.recording_id == recording_id)
    requests = (ReportRequest.from_json(text) for text in connection.execute(asked).scalars())
    return tuple({request.reference.path for request in requests if request.reference is not None})


def insert_recording(
    connection: Connection, stored: StoredRecording, about: Description, state: str = STORED
) -> None:
    """Write the row of a recording, with the oldest one of the same bytes."""
    same = (
        select(recordings.c.id)
        .where(recordings.c.sha256 == stored.sha256, recordings.c.state == STORED)
        .order_by(recordings.c.created_at)
        .limit(1)
    )
    row = asdict(stored) | {"state": state, "created_at": format_now()}
    row |= {"duplicate_of": connection.execute(same).scalar_one_or_none(), "since_s": select_running_s()}
    row |= {"stored_by": find_actor()}
    connection.execute(insert(recordings).values(row | asdict(about)))
    record(connection, "recording.stored", stored.id)


def select_page(query: Select[Any], order: tuple[Any, Any], limit: int, after: Place | None) -> Select[Any]:
    """Select the rows after a place, the newest first (a keyset: later pages cost no more)."""
    if after is not None:
        query = query.where(tuple_(*order) < tuple_(*after))
    return query.order_by(*(column.desc() for column in order)).limit(limit)


def _read_recording(row: Row[Any]) -> StoredRow:
    columns = row._asdict()
    parsed = {
        "about": _read_description(row),
        "inspection": _read_inspection(row.inspection),
        "diary": read_diary(row.diary),
        "hold": row.hold or "",
        "hold_by": row.hold_by or "",
    }
    return StoredRow(**{name: columns.get(name) for name in _ROW_COLUMNS} | parsed)


def _read_inspection(text: str | None) -> Mapping[str, Any] | None:
    """Read an inspection; None where it is unreadable: the bytes can be inspected again."""
    try:
        found = json.loads(text or "null")
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


@dataclass(frozen=True, slots=True)
class UploadRow:
    """An upload under way. ``metadata`` is what the client sent, and is returned unchanged.

    ``is_repeated``: its recording was there before, with the same bytes and the same description.
    """

    id: str
    length_bytes: int
    offset_bytes: int
    metadata: str
    about: Description
    idle_s: float
    recording_id: str | None
    is_repeated: int
    created_at: str

    @property
    def is_whole(self) -> bool:
        """Every byte has arrived."""
        return self.offset_bytes == self.length_bytes


class UploadStore(RowStore):
    """Rows of uploads. The offset only counts bytes that are on the disk."""

    def open(self, length_bytes: int, metadata: str, about: Description) -> UploadRow:
        """Begin an upload."""
        row: dict[str, object] = {
            "id": f"up_{secrets.token_hex(14)}",  # the column holds 32 characters; PostgreSQL enforces it
            "length_bytes": length_bytes,
            "offset_bytes": 0,
            "idle_s": 0.0,
            "created_at": format_now(),
            "description": json.dumps(asdict(about)),
            "metadata": metadata,
        }
        with self._engine.begin() as connection:
            connection.execute(insert(uploads).values(row))
            record(connection, "upload.began", other={"upload": str(row["id"])})
        return self.get(str(row["id"]))

    def get(self, upload_id: str) -> UploadRow:
        """Return one upload. Raises NotHere."""
        row = self._read_one(select(uploads).where(uploads.c.id == upload_id))
        if row is None:
            raise NotHere
        columns = row._asdict()
        about = Description(**json.loads(columns.pop("description")))
        return UploadRow(about=about, **columns)

    def advance(self, row: UploadRow, offset_bytes: int) -> bool:
        """Acknowledge bytes that are on the disk; False when another writer has moved the offset."""
        mine = (uploads.c.id == row.id, uploads.c.offset_bytes == row.offset_bytes)
        return self._write(update(uploads).where(*mine).values(offset_bytes=offset_bytes, idle_s=0.0)) == 1

    def step_back(self, row: UploadRow, offset_bytes: int) -> UploadRow:
        """Reset the offset to the bytes that the disk still has, unless the upload has become a recording."""
        mine = (uploads.c.id == row.id, uploads.c.offset_bytes == row.offset_bytes)
        lost = update(uploads).where(*mine, uploads.c.recording_id.is_(None))
        self._write(lost.values(offset_bytes=offset_bytes))
        return self.get(row.id)

    def describe(self, upload_id: str, about: Description, metadata: str) -> UploadRow:
        """Change what is said of an upload; one that is a recording by now stays as it is."""
        mine = update(uploads).where(uploads.c.id == upload_id, uploads.c.recording_id.is_(None))
        with self._engine.begin() as connection:
            connection.execute(mine.values(description=json.dumps(asdict(about)), metadata=metadata))
            record(connection, "upload.described", other={"upload": upload_id})
        return self.get(upload_id)

    def finish(
        self,
        row: UploadRow,
        stored: StoredRecording,
        request: ReportRequest | None = None,
        way_in: WayIn = "api",
        study: str = "",
    ) -> str:
        """Make the upload a recording, once, and queue the analysis it asks for, in one commit.

        The same bytes with the same description, sent again within a day by the same subject, are the
        recording that is there.

        With ``study``, the analysis joins the study of that name.

        Bytes of which another recording has an analysis are not analysed again unasked. Gives the id of the
        recording that counts.
        """
        unfinished = (uploads.c.id == row.id, uploads.c.recording_id.is_(None))
        with self._engine.begin() as connection:
            repeated = _find_repeated(connection, stored, row.about)
            recording_id = repeated or stored.id
            ended = {"recording_id": recording_id, "is_repeated": int(repeated is not None)}
            if connection.execute(update(uploads).where(*unfinished).values(ended)).rowcount == 1:
                if repeated is None:
                    insert_recording(connection, stored, row.about)
                record(connection, "upload.stored", recording_id, other={"upload": row.id})
                if request is not None and not _is_analysed(connection, stored):
                    analysis_id = enqueue(connection, (recording_id, stored.sha256), request, way_in)
                    if study:
                        join_study(connection, study, analysis_id)
                return recording_id
        return self.get(row.id).recording_id or stored.id

    def drop(self, upload_id: str) -> None:
        """Delete the row of an upload; the recording that it became stays."""
        with self._engine.begin() as connection:
            if connection.execute(delete(uploads).where(uploads.c.id == upload_id)).rowcount == 1:
                record(connection, "upload.dropped", other={"upload": upload_id})

    def find_growing(self) -> frozenset[str]:
        """Return the id of every upload that is not a recording yet."""
        return self._read_ids(select(uploads.c.id).where(uploads.c.recording_id.is_(None)))

    def find_known(self) -> frozenset[str]:
        """Return the id of every upload that has a row."""
        return self._read_ids(select(uploads.c.id))

    def age(self, elapsed_s: float, term_s: float) -> tuple[str, ...]:
        """Add elapsed time to every upload; gives those that nobody has continued for the whole term."""
        with self._engine.begin() as connection:
            connection.execute(update(uploads).values(idle_s=uploads.c.idle_s + elapsed_s))
            due = select(uploads.c.id).where(uploads.c.idle_s >= term_s)
            return tuple(connection.execute(due).scalars())


def _is_analysed(connection: Connection, stored: StoredRecording) -> bool:
    """Whether a recording of the same bytes has an analysis that was neither refused nor cancelled."""
    twins = (recordings.c.sha256 == stored.sha256, recordings.c.state == STORED)
    query = select(analyses.c.id).join(recordings, analyses.c.recording_id == recordings.c.id)
    counts = analyses.c.state.in_((JobState.QUEUED, JobState.RUNNING, JobState.SUCCEEDED))
    return connection.execute(query.where(*twins, counts).limit(1)).first() is not None
