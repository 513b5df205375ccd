"""The first and the last bytes of an upload, by which it is told what the file is while the rest comes."""

import os
from pathlib import Path

from app.api.services import Services
from app.errors import NotHere
from app.jobs.uploads import UploadRow
from app.storage import borrow_recording

TAIL_BODY = "application/octet-stream"
TAIL_BYTES = 64 << 10
HEAD_BYTES = 2 << 20


def keep_tail(services: Services, upload_id: str, tail: bytes) -> None:
    """Keep the last bytes of an upload that is under way; of any other nothing is left behind.

    Raises
    ------
    NotHere, DiskFull
    """
    services.incoming.keep_tail(upload_id, tail)
    try:
        is_over = services.uploads.get(upload_id).recording_id is not None
    except NotHere:
        services.incoming.forget_tail(upload_id)
        raise
    if is_over:  # it ended while the tail was written
        services.incoming.forget_tail(upload_id)


def read_both_ends(services: Services, row: UploadRow) -> tuple[bytes, bytes | None]:
    """Give the first bytes that count, and the last ones behind them: None where they are not known yet.

    Where the two meet, all is the head, and the tail is empty.
    """
    if row.recording_id is None:
        head = _read_head(services.incoming.path(row.id), row.offset_bytes)
        tail = services.incoming.read_tail(row.id)
    else:
        sha256 = services.store.find_sha256(row.recording_id)
        with borrow_recording(services.storage, row.recording_id, sha256) as log:
            head, tail = _read_head(log, row.offset_bytes), _read_tail(log)
    unseen_bytes = row.length_bytes - len(head)
    if unseen_bytes and (tail is None or unseen_bytes > len(tail)):
        return head, tail
    return head + (tail or b"")[-unseen_bytes:] if unseen_bytes else head, b""


def _read_head(path: Path, offset_bytes: int) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(min(offset_bytes, HEAD_BYTES))
    except FileNotFoundError:
        return b""


def _read_tail(path: Path) -> bytes:
    with path.open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - TAIL_BYTES))
        return file.read()
