"""The rows of recordings and of unfinished uploads."""

import hashlib
import json
import logging
import secrets
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, get_args

from sqlalchemy import Connection, Row, delete, exists, insert, select, update

from acromion.app.errors import NotHere, OnHold, PurgedSince, StaleVersion
from acromion.app.library.audit_log import Act, get_actor, record
from acromion.app.library.batches import join_study
from acromion.app.library.claims import WayIn, cancel_job, enqueue
from acromion.app.library.database.connect import BUSY_TIMEOUT_S, lock_tables
from acromion.app.library.database.tables import (
    analyses,
    batch_items,
    batches,
    purged_uploads,
    recordings,
    result_files,
    uploads,
)
from acromion.app.library.rows import (
    PURGING,
    REFERENCE,
    STORED,
    TRASHED,
    JobState,
    Place,
    RowStore,
    format_diary,
    format_now,
    format_tags,
    read_diary,
    read_tags,
    select_page,
    select_running_s,
)
from acromion.app.library.side_files import increment_revision, writing_side_file
from acromion.app.request import ReportRequest
from acromion.app.store.folder import StoredRecording
from acromion.fusion.conventions import Side
from acromion.fusion.diary import DiaryEntry

HoldReason = Literal["legal", "complaint", "insurance", "study", "other"]
"""Why a recording is kept: codes, because the audit log contains no sentence."""
HOLD_REASONS: tuple[HoldReason, ...] = get_args(HoldReason)

REPETITION_S = 24 * 3600.0
"""How long an identical upload counts as a repetition, in running time of the server."""
PURGED = "purged"
"""Replaces the recording id in an upload's row after permanent deletion."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Description:
    """Details entered by people. ``external_id`` is the recording's name in their system.

    ``folder``: the folders that the file was in when it was dropped, which may suggest whose arm it is; a
    file from another folder is the same file. ``job_title``, ``isco_code``: the person's job.
    """

    file_name: str
    subject: str = ""
    side: Side | None = None
    external_id: str = ""
    note: str = ""
    folder: str = field(default="", compare=False)
    job_title: str = ""
    isco_code: str = ""


@dataclass(frozen=True, slots=True)
class StoredRow:
    """A stored recording.

    ``start`` is the device's clock at the first sample, ISO 8601, once it has been inspected. ``version``
    increases with every change. ``duplicate_of`` is the oldest recording of the same bytes. ``hold``: code of
    the reason that forbids permanent deletion, and ``hold_by`` the person who set it; "" without a hold.
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


DESCRIBED = ("subject", "side", "job_title", "isco_code")
"""Details that analyses of the recording use."""
_DESCRIPTION_COLUMNS = tuple(column.name for column in fields(Description))
_ROW_COLUMNS = tuple(column.name for column in fields(StoredRow))


@dataclass(frozen=True, slots=True)
class RecordingFilter:
    """A filter for recordings; "" or None matches any. ``begin`` and ``end`` bound the start."""

    subject: str = ""
    external_id: str = ""
    sha256: str = ""
    begin: str = ""
    end: str = ""
    trashed: bool = False

    @property
    def by_start(self) -> bool:
        """Whether to order by start, because the filter bounds it; else by the time of storing."""
        return bool(self.begin or self.end)

    def place(self, row: StoredRow) -> Place:
        """Return the place of a row in the list."""
        return (row.start or "" if self.by_start else row.created_at), row.id


@dataclass(frozen=True, slots=True)
class Purged:
    """The ids whose files a purge must still remove from the store."""

    analyses: tuple[str, ...]
    recordings: tuple[str, ...]


class RecordingStore(RowStore):
    """Recordings in the database; every change is one guarded UPDATE that names the version it saw."""

    def add(self, stored: StoredRecording, about: Description) -> StoredRow:
        """Store a recording without an analysis.

        If the same subject sends the same bytes and description again within a day, the existing row is
        returned, with another id. Raises PurgedSince.
        """
        with self._engine.begin() as connection:
            check_not_purged(connection, stored, about)
            repeated = _find_repeated(connection, stored, about)
            if repeated is None:
                insert_recording(connection, stored, about)
        return self.get(repeated or stored.id)

    def add_reference(self, stored: StoredRecording, file_name: str) -> None:
        """Store a file as the reference of another recording's comparison."""
        with self._engine.begin() as connection:
            insert_recording(connection, stored, Description(file_name), REFERENCE)

    def get(self, recording_id: str, *, trashed: bool = False) -> StoredRow:
        """Return one recording. Raises NotHere, also for one in the trash unless ``trashed``."""
        row = self._read_one(select(recordings).where(recordings.c.id == recording_id))
        if row is None or row.state == PURGING or (row.state == TRASHED and not trashed):
            raise NotHere(id=recording_id)
        return _read_recording(row)

    def find_page(
        self, wanted: RecordingFilter, limit: int, after: Place | None = None
    ) -> tuple[StoredRow, ...]:
        """Return the newest recordings that match the filter, from ``after`` on."""
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
        """Return those of the ids that have a recording, in the trash or not."""
        return self._read_ids(select(recordings.c.id).where(recordings.c.id.in_(recording_ids)))

    def find_of_subject(self, subject: str) -> frozenset[str]:
        """Return the ids of a subject's current recordings, in the trash or not."""
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
        """Add tags to recordings, or remove one; return the number of changed recordings."""
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
        """Store the result of an inspection; it depends only on the bytes, so that no version guards it."""
        values = {"inspection": json.dumps(dict(found)), "start": found.get("start")}
        with self._engine.begin() as connection:
            connection.execute(update(recordings).where(recordings.c.id == recording_id).values(values))
            increment_revision(connection, recording_id)

    def trash(self, recording_id: str) -> None:
        """Move a recording to the trash and cancel its analyses, without deleting anything.

        For a recording that is already in the trash, the term does not start again. Raises NotHere.
        """
        self.get(recording_id, trashed=True)
        with self._engine.begin() as connection:
            _cancel_analyses(connection, recording_id)
            gone = update(recordings).where(recordings.c.id == recording_id, recordings.c.state == STORED)
            grown = {"version": recordings.c.version + 1, "revision": recordings.c.revision + 1}
            if connection.execute(gone.values(state=TRASHED, trashed_s=0.0, **grown)).rowcount == 1:
                record(connection, "recording.trashed", recording_id)

    def hasten_purge(self, recording_id: str, trashed_s: float) -> None:
        """Advance the time of a recording in the trash to at least ``trashed_s``."""
        mine = update(recordings).where(recordings.c.id == recording_id, recordings.c.state == TRASHED)
        self._write(mine.where(recordings.c.trashed_s < trashed_s).values(trashed_s=trashed_s))

    def restore(self, recording_id: str) -> StoredRow:
        """Restore a recording from the trash."""
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
        """Hide a recording and its references permanently; return the ids whose files must be removed now.

        Its analyses are cancelled, so that none publishes files afterwards. The rows are deleted last
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
        """Delete the records of purges from more than a day of running time ago."""
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
        """Empty SQLite's write-ahead log, which may contain copies of deleted rows.

        SQLite waits for readers, but refuses at once if another connection writes the log back.
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

    def advance_trash(self, elapsed_s: float, term_s: float) -> tuple[str, ...]:
        """Add elapsed time to everything in the trash; return the recordings whose term has passed.

        Recordings on hold do not age and are not returned.
        """
        trashed = (recordings.c.state == TRASHED) & recordings.c.hold.is_(None)
        older = update(recordings).where(trashed).values(trashed_s=recordings.c.trashed_s + elapsed_s)
        with self._engine.begin() as connection:
            connection.execute(older)
            due = select(recordings.c.id).where(trashed, recordings.c.trashed_s >= term_s)
            return tuple(connection.execute(due).scalars())

    def check_hold(self, recording_id: str) -> None:
        """Check that a recording may be deleted permanently. Raises OnHold."""
        with self._reader.connect() as connection:
            _check_hold(connection, recording_id)

    def hold(self, recording_id: str, reason: HoldReason, who: str) -> StoredRow:
        """Put a recording on hold, which prevents permanent deletion. Raises NotHere."""
        return self._change_hold(recording_id, {"hold": reason, "hold_by": who}, "recording.held")

    def release_hold(self, recording_id: str) -> StoredRow:
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
    """Reject a recording on hold, and lock its row until the transaction ends."""
    query = select(recordings.c.hold).where(recordings.c.id == recording_id).with_for_update()
    held = connection.execute(query).scalar()
    if held is not None:
        raise OnHold(id=recording_id, why=held)


def delete_recording(connection: Connection, recording_id: str) -> bool:
    """Delete every row of a recording, its references, its analyses and empty studies.

    Rows of its uploads stay without their text until their term, so that clients can query the end. Returns
    False if there was no recording.
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
    """Delete the batches without analyses."""
    no_item = ~exists().where(batch_items.c.batch_id == batches.c.id)
    connection.execute(delete(batches).where(no_item))


def _find_repeated(connection: Connection, stored: StoredRecording, about: Description) -> str | None:
    """Find the recording of the same bytes and description that this subject stored within a day.

    Of two simultaneous requests, the second waits until the first has its row.
    """
    lock_tables(connection)
    is_new = recordings.c.since_s >= select_running_s() - REPETITION_S
    mine = (recordings.c.sha256 == stored.sha256, recordings.c.stored_by == get_actor())
    query = select(recordings).where(*mine, is_new, recordings.c.state == STORED)
    rows = connection.execute(query.order_by(recordings.c.created_at)).all()
    return next((row.id for row in rows if _read_description(row) == about), None)


def _read_description(row: Row[Any]) -> Description:
    return Description(**{name: getattr(row, name) for name in _DESCRIPTION_COLUMNS})


def check_not_purged(connection: Connection, stored: StoredRecording, about: Description) -> None:
    """Reject a repeated request that would bring back permanently deleted data. Raises PurgedSince."""
    key = _hash_upload(get_actor(), stored.sha256, about)
    is_old = purged_uploads.c.since_s < select_running_s() - REPETITION_S
    known = select(purged_uploads.c.key).where(purged_uploads.c.key == key, ~is_old)
    if connection.execute(known).first() is not None:
        raise PurgedSince


def _hash_upload(who: str, sha256: str, about: Description) -> str:
    return hashlib.sha256(json.dumps([who, sha256, asdict(about)]).encode()).hexdigest()


def _cancel_analyses(connection: Connection, recording_id: str) -> None:
    """Cancel the analyses that wait or run.

    Call this before locking the recording, because an ending analysis takes its locks in this order.
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
    """Add the row of a recording, with the id of the oldest one of the same bytes."""
    same = (
        select(recordings.c.id)
        .where(recordings.c.sha256 == stored.sha256, recordings.c.state == STORED)
        .order_by(recordings.c.created_at)
        .limit(1)
    )
    row = asdict(stored) | {"state": state, "created_at": format_now()}
    row |= {"duplicate_of": connection.execute(same).scalar_one_or_none(), "since_s": select_running_s()}
    row |= {"stored_by": get_actor()}
    connection.execute(insert(recordings).values(row | asdict(about)))
    record(connection, "recording.stored", stored.id)


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
    """Parse an inspection; None if it is unreadable, because the bytes can be inspected again."""
    try:
        found = json.loads(text or "null")
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


@dataclass(frozen=True, slots=True)
class UploadRow:
    """An upload. ``metadata`` is the client's text, returned unchanged.

    ``is_repeated``: a recording with the same bytes and description already existed.
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
        """Whether every byte has arrived."""
        return self.offset_bytes == self.length_bytes


class UploadStore(RowStore):
    """Uploads in the database. The offset only counts bytes on disk."""

    def open(self, length_bytes: int, metadata: str, about: Description) -> UploadRow:
        """Begin an upload."""
        row: dict[str, object] = {
            "id": f"up_{secrets.token_hex(14)}",  # the column has 32 characters; PostgreSQL enforces it
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
        """Acknowledge bytes on disk; return False if another writer has moved the offset."""
        mine = (uploads.c.id == row.id, uploads.c.offset_bytes == row.offset_bytes)
        return self._write(update(uploads).where(*mine).values(offset_bytes=offset_bytes, idle_s=0.0)) == 1

    def reset_offset(self, row: UploadRow, offset_bytes: int) -> UploadRow:
        """Reset the offset to the bytes still on disk, unless the upload has become a recording."""
        mine = (uploads.c.id == row.id, uploads.c.offset_bytes == row.offset_bytes)
        lost = update(uploads).where(*mine, uploads.c.recording_id.is_(None))
        self._write(lost.values(offset_bytes=offset_bytes))
        return self.get(row.id)

    def finish(
        self,
        row: UploadRow,
        stored: StoredRecording,
        request: ReportRequest | None = None,
        way_in: WayIn = "api",
        study: str = "",
    ) -> str:
        """Turn the upload into a recording, once, and queue the requested analysis, in one commit.

        If the same subject sends the same bytes and description again within a day, the existing recording is
        used.

        With ``study``, the analysis joins the study of that name.

        Bytes that were already analysed for another recording are not analysed again without a request.
        Returns the id of the recording that counts.
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
        """Delete the row of an upload; a recording made from it stays."""
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
        """Add elapsed time to every upload; return those without activity for the whole term."""
        with self._engine.begin() as connection:
            connection.execute(update(uploads).values(idle_s=uploads.c.idle_s + elapsed_s))
            due = select(uploads.c.id).where(uploads.c.idle_s >= term_s)
            return tuple(connection.execute(due).scalars())


def _is_analysed(connection: Connection, stored: StoredRecording) -> bool:
    """Return whether a recording of the same bytes has an analysis that has not failed or been cancelled."""
    twins = (recordings.c.sha256 == stored.sha256, recordings.c.state == STORED)
    query = select(analyses.c.id).join(recordings, analyses.c.recording_id == recordings.c.id)
    counts = analyses.c.state.in_((JobState.QUEUED, JobState.RUNNING, JobState.SUCCEEDED))
    return connection.execute(query.where(*twins, counts).limit(1)).first() is not None
