"""The rows of uploads under way: how many bytes are safe, and what is said about the recording."""

import json
import secrets
from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import Engine, Row, delete, insert, select, update

from app.errors import NotHere
from app.jobs.reading import tell_now
from app.jobs.recordings import Description, insert_recording
from app.jobs.tables import uploads
from app.storage import StoredRecording


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
        return _read_row(row)

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


def _read_row(row: Row[Any]) -> UploadRow:
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
