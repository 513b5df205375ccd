"""The rows of recordings: what is stored, whose arm it is, what its day consisted of."""

import json
import secrets
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from sqlalchemy import Connection, Engine, Row, Select, delete, insert, select, tuple_, update

from app.errors import NotHere, StaleVersion
from app.jobs.database.tables import analyses, recordings, result_files, uploads
from app.jobs.idempotency import drop_traces
from app.jobs.job import JobState
from app.jobs.queue import cancel_job
from app.jobs.rows import PURGING, REFERENCE, STORED, TRASHED, tell_now
from app.jobs.side_files import count_change
from app.request import ReportRequest
from app.storage.store import StoredRecording
from fusion.conventions import Side
from fusion.diary import DiaryEntry

Place = tuple[str, str]
"""Where a page of a list ended: the moment it is ordered by and the id of its last row."""


@dataclass(frozen=True, slots=True)
class Description:
    """What people say about a recording. ``external_id`` is its name in their own system."""

    file_name: str
    subject: str = ""
    side: Side | None = None
    external_id: str = ""
    note: str = ""


@dataclass(frozen=True, slots=True)
class StoredRow:
    """A recording that was acknowledged.

    ``start`` is the device's clock at the first sample, ISO 8601, once it has been inspected. ``version``
    grows with every change. ``duplicate_of`` names the oldest recording of the same bytes.
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
        """Asked for by their start, recordings are listed by it, too; else by the time of their storing."""
        return bool(self.begin or self.end)

    def place(self, row: StoredRow) -> Place:
        """Say where a row stands in the list."""
        return (row.start or "" if self.by_start else row.created_at), row.id


@dataclass(frozen=True, slots=True)
class Purged:
    """What a deletion leaves to be removed from the store: the analyses' files and the recordings'."""

    analyses: tuple[str, ...]
    recordings: tuple[str, ...]


class RecordingStore:
    """Rows of recordings; every change is one guarded UPDATE that names the version it saw."""

    def __init__(self, engine: Engine, reader: Engine) -> None:
        self._engine, self._reader = engine, reader

    def add(self, stored: StoredRecording, about: Description) -> StoredRow:
        """Acknowledge a recording without asking for an analysis."""
        with self._engine.begin() as connection:
            insert_recording(connection, stored, about)
        return self.get(stored.id)

    def add_reference(self, stored: StoredRecording, file_name: str) -> None:
        """Acknowledge a file that the comparison of another recording needs."""
        with self._engine.begin() as connection:
            insert_recording(connection, stored, Description(file_name), REFERENCE)

    def get(self, recording_id: str, *, trashed: bool = False) -> StoredRow:
        """Give one recording.

        Raises
        ------
        NotHere
            Also for one in the trash, unless asked for.
        """
        query = select(recordings).where(recordings.c.id == recording_id)
        with self._reader.connect() as connection:
            row = connection.execute(query).one_or_none()
        if row is None or row.state == PURGING or (row.state == TRASHED and not trashed):
            raise NotHere(id=recording_id)
        return _read_row(row)

    def list_page(
        self, wanted: RecordingFilter, limit: int, after: Place | None = None
    ) -> tuple[StoredRow, ...]:
        """Give the newest recordings that are wanted, from ``after`` on."""
        query = _select_wanted(wanted)
        moment = recordings.c.start if wanted.by_start else recordings.c.created_at
        if after is not None:
            query = query.where(is_after((moment, recordings.c.id), after))
        newest_first = moment.desc(), recordings.c.id.desc()
        with self._reader.connect() as connection:
            rows = connection.execute(query.order_by(*newest_first).limit(limit)).all()
        return tuple(_read_row(row) for row in rows)

    def list_known(self, digests: Collection[str]) -> frozenset[str]:
        """Give those of some SHA-256 of which there is a recording, in the trash or not."""
        query = select(recordings.c.sha256).where(recordings.c.sha256.in_(digests)).distinct()
        with self._reader.connect() as connection:
            return frozenset(connection.execute(query).scalars())

    def change(self, recording_id: str, version: int, values: Mapping[str, object]) -> StoredRow:
        """Change columns, if nobody else has meanwhile.

        Raises
        ------
        StaleVersion
        """
        mine = (recordings.c.id == recording_id, recordings.c.version == version)
        change = update(recordings).where(*mine, recordings.c.state == STORED)
        with self._engine.begin() as connection:
            if connection.execute(change.values(version=version + 1, **values)).rowcount != 1:
                raise StaleVersion
            count_change(connection, recording_id)
        return self.get(recording_id)

    def describe(self, row: StoredRow, about: Description) -> StoredRow:
        """Say anew whose arm it is."""
        return self.change(row.id, row.version, asdict(about))

    def put_diary(self, row: StoredRow, diary: Sequence[DiaryEntry]) -> StoredRow:
        """Say what the day consisted of."""
        return self.change(row.id, row.version, {"diary": json.dumps([asdict(entry) for entry in diary])})

    def keep_inspection(self, recording_id: str, found: Mapping[str, Any]) -> None:
        """Remember what an inspection found; it follows from the bytes, so nobody need be asked."""
        values = {"inspection": json.dumps(dict(found)), "start": found.get("start")}
        with self._engine.begin() as connection:
            connection.execute(update(recordings).where(recordings.c.id == recording_id).values(values))
            count_change(connection, recording_id)

    def trash(self, recording_id: str) -> None:
        """Take a recording out of every list and stop its analyses; nothing is deleted yet.

        One that is in the trash stays there as it is: its term does not begin anew.

        Raises
        ------
        NotHere
        """
        self.get(recording_id, trashed=True)
        going_on = analyses.c.state.in_((JobState.QUEUED, JobState.RUNNING))
        mine = select(analyses.c.id).where(analyses.c.recording_id == recording_id, going_on)
        with self._engine.begin() as connection:
            # the analyses first, as those do who end one: nobody then waits for us while we wait for him
            for analysis_id in connection.execute(mine.with_for_update()).scalars().all():
                cancel_job(connection, analysis_id)
            connection.execute(
                update(recordings)
                .where(recordings.c.id == recording_id, recordings.c.state == STORED)
                .values(
                    state=TRASHED,
                    trashed_s=0.0,
                    version=recordings.c.version + 1,
                    revision=recordings.c.revision + 1,
                )
            )

    def restore(self, recording_id: str) -> StoredRow:
        """Take a recording out of the trash."""
        self.get(recording_id, trashed=True)
        back = update(recordings).where(recordings.c.id == recording_id, recordings.c.state == TRASHED)
        with self._engine.begin() as connection:
            connection.execute(back.values(state=STORED, trashed_s=None, version=recordings.c.version + 1))
            count_change(connection, recording_id)
        return self.get(recording_id)

    def begin_purge(self, recording_id: str) -> Purged:
        """Take a recording and its references out of reach for good; gives whose files are to go now.

        The rows go last (:meth:`end_purge`), so that a purge that is interrupted can go on.
        """
        with self._engine.begin() as connection:
            mine = analyses.c.recording_id == recording_id
            of_it = tuple(connection.execute(select(analyses.c.id).where(mine)).scalars())
            files = (recording_id, *_list_references(connection, recording_id))
            gone = update(recordings).where(recordings.c.id.in_(files))
            connection.execute(gone.values(state=PURGING, revision=recordings.c.revision + 1))
        return Purged(of_it, files)

    def list_purging(self) -> tuple[str, ...]:
        """Give the recordings whose purge was interrupted."""
        query = select(recordings.c.id).where(recordings.c.state == PURGING)
        with self._reader.connect() as connection:
            return tuple(connection.execute(query).scalars())

    def end_purge(self, recording_id: str) -> None:
        """Delete every row of a recording and of its references, once their files are gone."""
        with self._engine.begin() as connection:
            of_it = select(analyses.c.id).where(analyses.c.recording_id == recording_id)
            gone = tuple(connection.execute(of_it).scalars())
            references = _list_references(connection, recording_id)
            connection.execute(delete(result_files).where(result_files.c.analysis_id.in_(of_it)))
            connection.execute(delete(analyses).where(analyses.c.recording_id == recording_id))
            connection.execute(delete(uploads).where(uploads.c.recording_id == recording_id))
            files = (recording_id, *references)
            connection.execute(delete(recordings).where(recordings.c.id.in_(files)))
            drop_traces(connection, {*gone, *files})
        self._empty_log()

    def _empty_log(self) -> None:
        """Leave no copy of deleted rows in SQLite's write-ahead log."""
        if self._engine.dialect.name != "sqlite":
            return
        connection = self._engine.raw_connection()
        try:
            connection.cursor().execute("PRAGMA wal_checkpoint(TRUNCATE)")
        finally:
            connection.close()

    def age_trash(self, elapsed_s: float, term_s: float) -> tuple[str, ...]:
        """Let time pass for what is in the trash; gives what has been there for the whole term."""
        trashed = recordings.c.state == TRASHED
        older = update(recordings).where(trashed).values(trashed_s=recordings.c.trashed_s + elapsed_s)
        with self._engine.begin() as connection:
            connection.execute(older)
            due = select(recordings.c.id).where(trashed, recordings.c.trashed_s >= term_s)
            return tuple(connection.execute(due).scalars())


def _list_references(connection: Connection, recording_id: str) -> tuple[str, ...]:
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
    row: dict[str, object] = {
        "id": stored.id,
        "sha256": stored.sha256,
        "size_bytes": stored.size_bytes,
        "state": state,
    }
    row |= {"created_at": tell_now(), "duplicate_of": connection.execute(same).scalar_one_or_none()}
    connection.execute(insert(recordings).values(row | asdict(about)))


def is_after(columns: tuple[Any, Any], place: Place) -> Any:
    """Say which rows come after a place, newest first (a keyset, so that later pages cost no more)."""
    return tuple_(*columns) < tuple_(*place)


def _select_wanted(wanted: RecordingFilter) -> Select[Any]:
    query = select(recordings).where(recordings.c.state == (TRASHED if wanted.trashed else STORED))
    named = {"subject": wanted.subject, "external_id": wanted.external_id, "sha256": wanted.sha256}
    for name, value in named.items():
        if value:
            query = query.where(recordings.c[name] == value)
    if wanted.begin:
        query = query.where(recordings.c.start >= wanted.begin)
    return query.where(recordings.c.start < wanted.end) if wanted.end else query


def _read_row(row: Row[Any]) -> StoredRow:
    return StoredRow(
        id=row.id,
        sha256=row.sha256,
        size_bytes=row.size_bytes,
        state=row.state,
        created_at=row.created_at,
        about=Description(row.file_name, row.subject, row.side, row.external_id, row.note),
        duplicate_of=row.duplicate_of,
        version=row.version,
        start=row.start,
        inspection=_read_inspection(row.inspection),
        diary=tuple(DiaryEntry(**entry) for entry in json.loads(row.diary)),
    )


def _read_inspection(text: str | None) -> Mapping[str, Any] | None:
    """Read an inspection; None where it cannot be read, for the bytes can be inspected again."""
    try:
        found = json.loads(text or "null")
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


# The rows of uploads under way: how many bytes are safe, and what is said about the recording.


@dataclass(frozen=True, slots=True)
class UploadRow:
    """An upload. ``metadata`` is what the client sent, to be given back as it came."""

    id: str
    length_bytes: int
    offset_bytes: int
    metadata: str
    about: Description
    idle_s: float
    recording_id: str | None
    created_at: str

    @property
    def is_whole(self) -> bool:
        """Every byte has come."""
        return self.offset_bytes == self.length_bytes


class UploadStore:
    """Rows of uploads. The offset only ever tells bytes that are on the disk."""

    def __init__(self, engine: Engine, reader: Engine) -> None:
        self._engine, self._reader = engine, reader

    def open(self, length_bytes: int, metadata: str, about: Description) -> UploadRow:
        """Begin an upload."""
        row: dict[str, object] = {
            "id": f"up_{secrets.token_hex(14)}",  # the column holds 32 letters, and PostgreSQL minds
            "length_bytes": length_bytes,
            "offset_bytes": 0,
            "metadata": metadata,
            "description": json.dumps(asdict(about)),
            "idle_s": 0.0,
            "created_at": tell_now(),
        }
        with self._engine.begin() as connection:
            connection.execute(insert(uploads).values(row))
        return self.get(str(row["id"]))

    def get(self, upload_id: str) -> UploadRow:
        """Give one upload.

        Raises
        ------
        NotHere
        """
        with self._reader.connect() as connection:
            row = connection.execute(select(uploads).where(uploads.c.id == upload_id)).one_or_none()
        if row is None:
            raise NotHere
        return _read_upload(row)

    def advance(self, row: UploadRow, offset_bytes: int) -> bool:
        """Acknowledge bytes that are on the disk; False when somebody else has moved the offset."""
        mine = (uploads.c.id == row.id, uploads.c.offset_bytes == row.offset_bytes)
        change = update(uploads).where(*mine).values(offset_bytes=offset_bytes, idle_s=0.0)
        with self._engine.begin() as connection:
            return connection.execute(change).rowcount == 1

    def step_back(self, row: UploadRow, offset_bytes: int) -> UploadRow:
        """Let bytes count no more that the disk has lost, unless the upload has become a recording."""
        mine = (uploads.c.id == row.id, uploads.c.offset_bytes == row.offset_bytes)
        lost = update(uploads).where(*mine, uploads.c.recording_id.is_(None))
        with self._engine.begin() as connection:
            connection.execute(lost.values(offset_bytes=offset_bytes))
        return self.get(row.id)

    def finish(self, row: UploadRow, stored: StoredRecording) -> str:
        """Make the upload a recording, once, in one commit; gives the id of the one that counts."""
        unfinished = (uploads.c.id == row.id, uploads.c.recording_id.is_(None))
        with self._engine.begin() as connection:
            change = update(uploads).where(*unfinished).values(recording_id=stored.id)
            if connection.execute(change).rowcount == 1:
                insert_recording(connection, stored, row.about)
                return stored.id
        return self.get(row.id).recording_id or stored.id

    def drop(self, upload_id: str) -> None:
        """Forget an upload; the recording that it became stays."""
        with self._engine.begin() as connection:
            connection.execute(delete(uploads).where(uploads.c.id == upload_id))

    def list_growing(self) -> frozenset[str]:
        """Every upload whose bytes are kept for more to come."""
        query = select(uploads.c.id).where(uploads.c.recording_id.is_(None))
        with self._reader.connect() as connection:
            return frozenset(connection.execute(query).scalars())

    def list_known(self) -> frozenset[str]:
        """Every upload that has a row."""
        with self._reader.connect() as connection:
            return frozenset(connection.execute(select(uploads.c.id)).scalars())

    def age(self, elapsed_s: float, term_s: float) -> tuple[str, ...]:
        """Let time pass; gives the uploads that nobody has gone on with for the whole term."""
        with self._engine.begin() as connection:
            connection.execute(update(uploads).values(idle_s=uploads.c.idle_s + elapsed_s))
            due = select(uploads.c.id).where(uploads.c.idle_s >= term_s)
            return tuple(connection.execute(due).scalars())


def _read_upload(row: Row[Any]) -> UploadRow:
    return UploadRow(
        id=row.id,
        length_bytes=row.length_bytes,
        offset_bytes=row.offset_bytes,
        metadata=row.metadata,
        about=Description(**json.loads(row.description)),
        idle_s=row.idle_s,
        recording_id=row.recording_id,
        created_at=row.created_at,
    )
