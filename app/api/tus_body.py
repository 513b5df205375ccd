"""The bytes of a tus upload: written as they come, counted only when they are on the disk."""

import base64
import binascii
import hashlib
import time
import zlib
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace

from fastapi import Request
from fastapi.concurrency import run_in_threadpool

from app.api.services import Services
from app.api.upload import PIECE_BYTES, copy_body
from app.errors import BadChecksum, LockedUpload, WrongDigest, WrongLength, WrongMediaType, WrongOffset
from app.incoming import GrowingFile
from app.jobs.uploads import UploadRow

OFFSET_BODY = "application/offset+octet-stream"
CHECKSUMS = ("sha1", "sha256", "sha512", "md5")
SYNC_S = 0.5
_GZIP_WINDOW = 16 + zlib.MAX_WBITS


async def take_bytes(
    request: Request, services: Services, upload_id: str, offset_bytes: int, checksum: str = ""
) -> UploadRow:
    """Append the body to an upload; one that was packed (Content-Encoding: gzip) is unpacked as it comes.

    Raises
    ------
    LockedUpload, WrongOffset, WrongLength, WrongDigest, WrongMediaType, BrokenUpload, SlowUpload, DiskFull,
    TooMany
    """
    with services.turns.take():
        return await _take_alone(request, services, upload_id, offset_bytes, checksum)


async def _take_alone(
    request: Request, services: Services, upload_id: str, offset_bytes: int, checksum: str
) -> UploadRow:
    unpacker = _choose_unpacker(request.headers.get("content-encoding", ""))
    if not services.incoming.take(upload_id):
        raise LockedUpload
    try:
        row = await run_in_threadpool(get_upload_row, services, upload_id)
        _check_place(request, row, offset_bytes)
        body = await run_in_threadpool(_open_body, services, row, checksum)
        body.unpacker = unpacker
        try:
            await copy_body(request, body.take)
            await run_in_threadpool(body.check)
        finally:
            await run_in_threadpool(body.end)
        return await run_in_threadpool(finish_upload, services, body.row)
    finally:
        services.incoming.let_go(upload_id)


def _check_place(request: Request, row: UploadRow, offset_bytes: int) -> None:
    if row.offset_bytes != offset_bytes:
        raise WrongOffset(expected=row.offset_bytes)
    announced = request.headers.get("content-length", "")
    is_plain = "content-encoding" not in request.headers
    if is_plain and announced.isdecimal() and offset_bytes + int(announced) > row.length_bytes:
        raise WrongLength


def get_upload_row(services: Services, upload_id: str) -> UploadRow:
    """Give the row of an upload; what counted and is not on the disk any more has to be sent again.

    Otherwise zeros would take the place of the bytes that are lost.
    """
    row = services.uploads.get(upload_id)
    found_bytes = services.incoming.measure(upload_id)
    if row.recording_id is None and found_bytes < row.offset_bytes:
        return services.uploads.step_back(row, found_bytes)
    return row


def finish_upload(services: Services, row: UploadRow) -> UploadRow:
    """Make a whole upload a recording; any other is given back as it is.

    The bytes keep their name among the uploads until the recording's row is committed: whatever is cut
    short in between is done again by the next request.
    """
    if not row.is_whole or row.recording_id is not None:
        return row
    try:
        sha256 = services.incoming.hash(row.id, row.length_bytes)
        stored = services.storage.adopt(services.incoming.path(row.id), sha256, row.length_bytes)
    except FileNotFoundError:  # a peer was quicker
        return services.uploads.get(row.id)
    counts = services.uploads.finish(row, stored)
    if counts != stored.id:
        services.storage.drop_recording(stored.id)
    services.incoming.forget(row.id)
    return replace(row, recording_id=counts)


def drop_upload(services: Services, row: UploadRow) -> None:
    """Forget an upload and its bytes; the recording of a finished one stays.

    Raises
    ------
    LockedUpload
    """
    if not services.incoming.take(row.id):
        raise LockedUpload
    try:
        services.uploads.drop(row.id)
        services.incoming.forget(row.id)
    finally:
        services.incoming.let_go(row.id)


def _choose_unpacker(encoding: str) -> "zlib._Decompress | None":
    if encoding.strip().lower() in ("", "identity"):
        return None
    if encoding.strip().lower() != "gzip":
        raise WrongMediaType(found=encoding[:60], allowed="gzip")
    return zlib.decompressobj(_GZIP_WINDOW)


def _open_body(services: Services, row: UploadRow, checksum: str) -> "_Body":
    digest, expected = _read_checksum(checksum) if checksum else (None, b"")
    file = GrowingFile(services.incoming.path(row.id), row.offset_bytes)
    return _Body(services, row, file, digest, expected)


def _read_checksum(header: str) -> "tuple[hashlib._Hash, bytes]":
    name, _, coded = header.strip().partition(" ")
    allowed = "|".join(CHECKSUMS) + " base64"
    if name not in CHECKSUMS:
        raise BadChecksum(value=name[:20], allowed=allowed)
    try:
        return hashlib.new(name, usedforsecurity=False), base64.b64decode(coded, validate=True)
    except binascii.Error:
        raise BadChecksum(value=coded[:60], allowed=allowed) from None


@dataclass(slots=True)
class _Body:
    """The bytes of one request. They count once they are safe; packed or with a checksum, once that is right.

    The disk is waited for beside the network: while ``counting`` makes bytes durable, more are written.
    """

    services: Services
    row: UploadRow
    file: GrowingFile
    digest: "hashlib._Hash | None"
    expected: bytes
    synced_s: float = field(default_factory=time.monotonic)
    beside: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "count"))
    counting: "Future[None] | None" = None
    unpacker: "zlib._Decompress | None" = None

    @property
    def is_checked(self) -> bool:
        """Nothing counts before the last byte: gzip, too, ends with a checksum."""
        return self.digest is not None or self.unpacker is not None

    def take(self, chunk: bytes) -> None:
        """Take the next bytes of the body; however well they are packed, a little at a time is unpacked.

        Raises
        ------
        WrongDigest, WrongLength, DiskFull
        """
        while self.unpacker is not None and chunk:
            try:
                piece = self.unpacker.decompress(chunk, PIECE_BYTES)
            except zlib.error:
                raise WrongDigest from None
            chunk = self.unpacker.unconsumed_tail
            self.write(piece)
        self.write(chunk)

    def write(self, chunk: bytes) -> None:
        if self.file.offset_bytes + len(chunk) > self.row.length_bytes:
            raise WrongLength
        self.services.incoming.follow(self.row.id, self.file.offset_bytes, chunk)
        self.file.write(chunk)
        if self.digest is not None:
            self.digest.update(chunk)
        if not self.is_checked and time.monotonic() - self.synced_s > SYNC_S and self._is_idle():
            self.wait()
            self.counting = self.beside.submit(self._count, self.file.flush())
            self.synced_s = time.monotonic()

    def _is_idle(self) -> bool:
        return self.counting is None or self.counting.done()

    def wait(self) -> None:
        """Wait for what is being counted, and raise what hindered it."""
        counting, self.counting = self.counting, None
        if counting is not None:
            counting.result()

    def count(self) -> None:
        """Let every byte so far count."""
        self.wait()
        if self.file.flush() > self.row.offset_bytes:
            self._count(self.file.offset_bytes)

    def _count(self, offset_bytes: int) -> None:
        """Let the bytes before an offset count: on the disk first, then in the row."""
        self.file.sync()
        if not self.services.uploads.advance(self.row, offset_bytes):
            raise WrongOffset(expected=self.services.uploads.get(self.row.id).offset_bytes)
        self.row = self.services.uploads.get(self.row.id)

    def end(self) -> None:
        """Keep what came, however the request ended; bytes that cannot be checked are not kept."""
        try:
            if not self.is_checked:
                self.count()
        finally:
            self.beside.shutdown()
            self.file.close()

    def check(self) -> None:
        """Compare the checksum, that of gzip, too, and only then let the bytes count.

        Raises
        ------
        WrongDigest
        """
        if self.unpacker is not None and not self.unpacker.eof:
            raise WrongDigest
        if self.digest is not None and self.digest.digest() != self.expected:
            raise WrongDigest
        if self.is_checked:
            self.count()
