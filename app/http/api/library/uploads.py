"""Resumable uploads: tus 1.0.0 (https://tus.io/protocols/resumable-upload).

Core, creation, creation-with-upload, termination, checksum and expiration. A complete upload becomes a
recording at once; the last response and every later one contain its id. If an upload was announced with
``settings``, its analysis starts with the last byte, even if the client sends no further request.
"""

import asyncio
import base64
import binascii
import hashlib
import time
import zlib
from collections.abc import AsyncIterable, AsyncIterator, Awaitable, Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from typing import Annotated, TypeVar

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.requests import ClientDisconnect

from acromion.app.errors import (
    BadChecksum,
    BadParameter,
    BrokenUpload,
    LockedUpload,
    PurgedSince,
    UnknownProtocol,
    WrongDigest,
    WrongLength,
    WrongMediaType,
    WrongOffset,
)
from acromion.app.http.api.library.models import DeclaredOptions, RecordingWords
from acromion.app.http.middleware.problems import PROBLEM_RESPONSES, TUS_HEADERS, parse_json, validate_model
from acromion.app.library.audit_log import get_actor
from acromion.app.library.claims import WayIn
from acromion.app.library.recordings import PURGED, UploadRow
from acromion.app.request import ReportRequest
from acromion.app.services import Services, UsedServices, get_request_origin
from acromion.app.store.folder import StoredRecording, Upload, read_recording, too_large
from acromion.app.store.incoming import GrowingFile, name_recording
from acromion.fusion.documents import HEAD_BYTES, refuse_document
from acromion.fusion.errors import EmptyFile, UnknownFormat

# Uploads in one request: bytes are written to disk, and acknowledged once they are durable.


PIECE_BYTES = 256 << 10
"""Bytes per write; each upload holds about four such pieces in memory, and larger ones are not faster."""

T = TypeVar("T")
Copy = Callable[[Request, Callable[[bytes], None]], Awaitable[None]]


async def receive_recording(
    request: Request, services: Services, commit: Callable[[StoredRecording], T]
) -> T:
    """Store the body as a recording; ``commit`` writes its row, and a file without a row is removed.

    Raises FileTooLarge, DiskFull, EmptyFile, SlowUpload, BadParameter or WrongDigest.
    """
    kind = request.headers.get("content-type", "")
    if kind.startswith("multipart/"):  # the body must be the recording itself
        raise BadParameter(name="Content-Type", value=kind[:60], allowed="application/octet-stream")
    digest = read_digest(request.headers)

    def check_and_commit(stored: StoredRecording) -> T:
        if digest not in ("", stored.sha256):
            raise WrongDigest
        return commit(stored)

    return await store_recording(
        request, services, lambda sent, write: copy_chunks(sent.stream(), write), check_and_commit
    )


async def store_recording(
    request: Request, services: Services, copy: Copy, commit: Callable[[StoredRecording], T]
) -> T:
    """Write the bytes that ``copy`` reads from the request to disk, then call ``commit`` to write the row.

    Raises FileTooLarge, DiskFull, EmptyFile, SlowUpload, BadParameter or TooMany.
    """
    announced = request.headers.get("content-length", "")
    check_room(services, int(announced) if announced.isdecimal() else 0)
    with services.upload_slots.take(get_actor()):
        upload = await run_in_threadpool(services.storage.open_upload, services.settings.max_upload_bytes)
        try:
            await copy(request, upload.write)
            return await run_in_threadpool(_acknowledge, upload, services, commit)
        finally:
            await run_in_threadpool(upload.discard)


def read_digest(headers: Mapping[str, str]) -> str:
    """Return the SHA-256 that the client stated (RFC 9530), in hex; "" if it stated none.

    Raises BadChecksum.
    """
    stated = f"{headers.get('content-digest', '')}, {headers.get('repr-digest', '')}"
    member = next((m.strip() for m in stated.split(",") if m.strip().lower().startswith("sha-256=")), "")
    if not member:
        return ""
    try:
        digest = base64.b64decode(member[len("sha-256=") :].strip(":"), validate=True)
    except ValueError:
        digest = b""
    if len(digest) != hashlib.sha256().digest_size:
        raise BadChecksum(value=member[:60], allowed="sha-256=:…:")
    return digest.hex()


def check_room(services: Services, expected_bytes: int) -> None:
    """Refuse an upload that is too large or would fill the disk. Raises FileTooLarge or DiskFull."""
    limit_bytes = services.settings.max_upload_bytes
    if expected_bytes > limit_bytes:
        raise too_large(expected_bytes, limit_bytes)
    services.storage.check_space(expected_bytes, services.settings.min_free_bytes)


async def copy_chunks(chunks: AsyncIterable[bytes], write: Callable[[bytes], None]) -> None:
    """Write in large pieces, each in a thread while the next one arrives.

    Bytes that arrived before the connection broke are also written. Raises BrokenUpload.
    """
    waiting = bytearray()
    writing: asyncio.Task[None] | None = None
    try:
        async for chunk in chunks:
            waiting += chunk
            if len(waiting) >= PIECE_BYTES:
                piece, waiting = bytes(waiting), bytearray()
                if writing is not None:
                    await writing
                writing = asyncio.create_task(run_in_threadpool(write, piece))
    except ClientDisconnect as error:
        raise BrokenUpload from error
    finally:
        if writing is not None:
            await writing
        await run_in_threadpool(write, bytes(waiting))


async def read_small_body(request: Request, most_bytes: int) -> bytes:
    """Return a small body that is not a recording. Raises FileTooLarge."""
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > most_bytes:
            raise too_large(len(body), most_bytes)
    return bytes(body)


def _acknowledge(upload: Upload, services: Services, commit: Callable[[StoredRecording], T]) -> T:
    """Write, fsync, rename, fsync the folder, commit."""
    if upload.size_bytes == 0:
        raise EmptyFile
    stored = upload.keep()
    try:
        return commit(stored)
    except BaseException:
        if not services.store.may_have_row(stored.id):  # the row may be committed although the reply was lost
            services.storage.drop_recording(stored.id)
        raise


# A recording in a form, as browsers and ``curl -F`` send it. python-multipart parses it while it streams in,
# without its own files: those would write every byte twice, first to the temporary folder, which is small in
# a container.

MAX_FIELDS, MAX_FIELD_BYTES = 20, 4096


class RecordingForm:
    """Read one file and a few short fields, in any order, from a form.

    ``digest`` is the SHA-256 of the whole form that the client stated, in hex, or "".
    """

    def __init__(self, content_type: str, digest: str = "") -> None:
        _, options = parse_options_header(content_type)
        if not options.get(b"boundary"):
            raise BadParameter(name="Content-Type", value=content_type[:60], allowed="boundary=…")
        self._digest, self._sha256 = digest, hashlib.sha256()
        self.words: dict[str, str] = {}
        self.file_name: str | None = None
        self._piece, self._word, self._header, self._value = (bytearray() for _ in range(4))
        self._name, self._in_file, self._ended = "", False, False
        self._parser = MultipartParser(
            options[b"boundary"],
            {
                "on_part_begin": self._begin_part,
                "on_header_field": lambda octets, start, end: self._header.extend(octets[start:end]),
                "on_header_value": lambda octets, start, end: self._value.extend(octets[start:end]),
                "on_header_end": self._end_header,
                "on_part_data": self._take,
                "on_part_end": self._end_part,
                "on_end": lambda: setattr(self, "_ended", True),
            },
        )

    async def copy_file(self, request: Request, write: Callable[[bytes], None]) -> None:
        """Write the file as it arrives. Raises BadParameter, BrokenUpload or WrongDigest."""
        await copy_chunks(self._read_file(request), write)
        if not self._ended:
            raise BrokenUpload
        if self._digest not in ("", self._sha256.hexdigest()):
            raise WrongDigest
        if self.file_name is None:
            raise BadParameter(name="form", value=", ".join(self.words)[:60], allowed="file")

    async def _read_file(self, request: Request) -> AsyncIterator[bytes]:
        """Yield the bytes of the file in each chunk of the form."""
        async for chunk in request.stream():
            self._sha256.update(chunk if self._digest else b"")
            try:
                self._parser.write(chunk)
            except FormParserError:
                raise BadParameter(name="form", value="", allowed="multipart/form-data") from None
            piece, self._piece = bytes(self._piece), bytearray()
            yield piece

    def _begin_part(self) -> None:
        self._name, self._in_file, self._word = "", False, bytearray()

    def _end_header(self) -> None:
        if bytes(self._header).lower() == b"content-disposition":
            _, options = parse_options_header(bytes(self._value))
            self._name = options.get(b"name", b"").decode("utf-8", "replace")
            if b"filename" in options:
                file_name = options[b"filename"].decode("utf-8", "replace")
                if self.file_name is not None:
                    raise BadParameter(name=self._name[:60], value=file_name[:60], allowed="1")
                self.file_name, self._in_file = file_name, True
        self._header.clear()
        self._value.clear()

    def _take(self, octets: bytes, start_byte: int, end_byte: int) -> None:
        if self._in_file:
            self._piece += octets[start_byte:end_byte]
            return
        self._word += octets[start_byte:end_byte]
        if len(self._word) > MAX_FIELD_BYTES or len(self.words) >= MAX_FIELDS:
            raise BadParameter(name=self._name[:60], value="", allowed=f"≤ {MAX_FIELD_BYTES}")

    def _end_part(self) -> None:
        if not self._in_file:
            self.words[self._name] = self._word.decode("utf-8", "replace").strip()


# The bytes of a tus upload: written on arrival, counted once they are durable on disk.

OFFSET_BODY = "application/offset+octet-stream"
PREVIEW_BYTES = 2 << 20
CHECKSUMS = ("sha1", "sha256", "sha512", "md5")
SYNC_S = 0.5
_GZIP_WINDOW = 16 + zlib.MAX_WBITS


async def append_bytes(
    request: Request, services: Services, upload_id: str, offset_bytes: int, checksum: str = ""
) -> UploadRow:
    """Append the body to an upload; unpack it on arrival if it is packed (Content-Encoding: gzip).

    Raises LockedUpload, WrongOffset, WrongLength, WrongDigest, WrongMediaType, BrokenUpload, SlowUpload,
    DiskFull or TooMany.
    """
    with services.upload_slots.take(get_actor()):
        encoding = request.headers.get("content-encoding", "")
        if encoding.strip().lower() not in ("", "identity", "gzip"):
            raise WrongMediaType(found=encoding[:60], allowed="gzip")
        with _lock_upload(services, upload_id):
            row = await run_in_threadpool(get_upload_row, services, upload_id)
            if row.offset_bytes != offset_bytes:
                raise WrongOffset(expected=row.offset_bytes)
            announced = request.headers.get("content-length", "")
            is_plain = "content-encoding" not in request.headers
            if is_plain and announced.isdecimal() and offset_bytes + int(announced) > row.length_bytes:
                raise WrongLength
            body = await run_in_threadpool(_open_body, services, row, checksum, encoding)
            try:
                await copy_chunks(request.stream(), body.take)
                await run_in_threadpool(body.check)
            finally:
                await run_in_threadpool(body.end)
            return await run_in_threadpool(finish_upload, services, body.row, get_request_origin(request))


@contextmanager
def _lock_upload(services: Services, upload_id: str) -> Iterator[None]:
    """Lock an upload for one request. Raises LockedUpload."""
    if not services.incoming.acquire(upload_id):
        raise LockedUpload
    try:
        yield
    finally:
        services.incoming.release(upload_id)


def get_upload_row(services: Services, upload_id: str) -> UploadRow:
    """Return the row of an upload; if counted bytes are no longer on disk, reduce its offset.

    The client then sends those bytes again; otherwise zeros would replace them. Raises NotHere or
    PurgedSince.
    """
    row = services.uploads.get(upload_id)
    if row.recording_id == PURGED:
        raise PurgedSince
    found_bytes = services.incoming.measure(upload_id)
    if row.recording_id is None and found_bytes < row.offset_bytes:
        return services.uploads.reset_offset(row, found_bytes)
    return row


def finish_upload(services: Services, row: UploadRow, way_in: WayIn = "api") -> UploadRow:
    """Convert a complete upload to a recording and start its declared analysis; return its row.

    The bytes stay among the uploads until the recording's row is committed, so the next request can repeat an
    interrupted step.
    """
    if not row.is_whole or row.recording_id is not None:
        return row
    _refuse_document(services, row)
    try:
        sha256 = services.incoming.hash(row.id, row.length_bytes)
        stored = StoredRecording(name_recording(row.id), sha256, row.length_bytes)
        services.storage.adopt(services.incoming.path(row.id), stored.id)
    except FileNotFoundError:  # another request was faster
        return services.uploads.get(row.id)
    declared, study, asked = read_declared(row.metadata), "", None
    if declared is not None:
        study = declared.study
        if (
            services.store.count_waiting() < services.settings.max_queued
        ):  # if the queue is full, no analysis starts
            whole, language = declared.complete(row.about), declared.lang or "en"
            asked = whole.build_request(row.about.file_name, language, services.settings)
    counts = services.uploads.finish(row, stored, asked, way_in, study)
    if counts != stored.id and not services.store.may_have_row(stored.id):
        services.storage.drop_recording(stored.id)
    services.incoming.forget(row.id)
    return services.uploads.get(row.id)


def _refuse_document(services: Services, row: UploadRow) -> None:
    """Refuse a photo or a document, and delete its upload. Raises acromion.fusion.errors.UnknownFormat."""
    try:
        with services.incoming.path(row.id).open("rb") as file:
            refuse_document(file.read(HEAD_BYTES))
    except FileNotFoundError:  # a peer was quicker
        return
    except UnknownFormat:
        services.uploads.drop(row.id)
        services.incoming.forget(row.id)
        raise


def drop_upload(services: Services, row: UploadRow) -> None:
    """Delete an upload and its bytes; the recording of a finished one stays. Raises LockedUpload."""
    with _lock_upload(services, row.id):
        services.uploads.drop(row.id)
        services.incoming.forget(row.id)


def _open_body(services: Services, row: UploadRow, checksum: str, encoding: str) -> "_Body":
    digest, expected = None, b""
    if checksum:
        name, _, coded = checksum.strip().partition(" ")
        allowed = "|".join(CHECKSUMS) + " base64"
        if name not in CHECKSUMS:
            raise BadChecksum(value=name[:20], allowed=allowed)
        try:
            expected = base64.b64decode(coded, validate=True)
        except binascii.Error:
            raise BadChecksum(value=coded[:60], allowed=allowed) from None
        digest = hashlib.new(name, usedforsecurity=False)
    unpacker = zlib.decompressobj(_GZIP_WINDOW) if encoding.strip().lower() == "gzip" else None
    file = services.incoming.open(row.id, row.offset_bytes)
    return _Body(services, row, file, digest, expected, unpacker)


@dataclass(slots=True)
class _Body:
    """The bytes of one request. They count once they are durable and any checksum (gzip has one) is correct.

    Disk and network work in parallel: while ``counting`` makes bytes durable, more are written.
    """

    services: Services
    row: UploadRow
    file: GrowingFile
    digest: "hashlib._Hash | None"
    expected: bytes
    unpacker: "zlib._Decompress | None"
    synced_s: float = field(default_factory=time.monotonic)
    counter: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "count"))
    counting: "Future[None] | None" = None

    @property
    def is_checked(self) -> bool:
        """Return whether the body has a checksum (gzip always has one); its bytes count only at the end."""
        return self.digest is not None or self.unpacker is not None

    def take(self, chunk: bytes) -> None:
        """Write the next bytes of the body; packed bytes are unpacked in small pieces to limit memory.

        Raises WrongDigest, WrongLength or DiskFull.
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
        self.services.incoming.hash_chunk(self.row.id, self.file.offset_bytes, chunk)
        self.file.write(chunk)
        if self.digest is not None:
            self.digest.update(chunk)
        is_idle = self.counting is None or self.counting.done()
        if not self.is_checked and time.monotonic() - self.synced_s > SYNC_S and is_idle:
            self.wait()
            self.counting = self.counter.submit(self._count, self.file.flush())
            self.synced_s = time.monotonic()

    def wait(self) -> None:
        """Wait until pending bytes are counted; re-raise their error."""
        counting, self.counting = self.counting, None
        if counting is not None:
            counting.result()

    def count(self) -> None:
        """Count every byte written so far."""
        self.wait()
        if self.file.flush() > self.row.offset_bytes:
            self._count(self.file.offset_bytes)

    def _count(self, offset_bytes: int) -> None:
        """Count the bytes before an offset: first make them durable, then update the row."""
        self.file.sync()
        if not self.services.uploads.advance(self.row, offset_bytes):
            raise WrongOffset(expected=self.services.uploads.get(self.row.id).offset_bytes)
        self.row = self.services.uploads.get(self.row.id)

    def end(self) -> None:
        """Count the bytes written so far, even if the request failed; discard bytes that need a checksum."""
        try:
            if not self.is_checked:
                self.count()
        finally:
            self.counter.shutdown()
            self.file.close()

    def check(self) -> None:
        """Compare the checksum (also gzip's), then count the bytes. Raises WrongDigest."""
        if self.unpacker is not None and not self.unpacker.eof:
            raise WrongDigest
        if self.digest is not None and self.digest.digest() != self.expected:
            raise WrongDigest
        if self.is_checked:
            self.count()


# Metadata of the file, in ``Upload-Metadata``.

DECLARED = "settings"
NAMES = {"filename": "file_name", "name": "file_name"} | {name: name for name in RecordingWords.model_fields}


def read_metadata(header: str) -> RecordingWords:
    """Parse ``name base64,name base64``; ignore unknown names (``filetype``). Raises BadParameter."""
    pairs = _read_pairs(header)
    known = {NAMES[name]: value for name, value in pairs.items() if name in NAMES and value}
    return validate_model(RecordingWords, known)


def read_declared(header: str) -> DeclaredOptions | None:
    """Parse the analysis that starts with the last byte (``settings``: JSON); None if none is declared.

    Raises BadParameter.
    """
    declared = _read_pairs(header).get(DECLARED)
    return None if declared is None else validate_model(DeclaredOptions, parse_json(declared.encode()))


def _read_pairs(header: str) -> dict[str, str]:
    pairs = {}
    for pair in filter(str.strip, header.split(",")):
        name, _, coded = pair.strip().partition(" ")
        try:
            pairs[name] = base64.b64decode(coded, validate=True).decode("utf-8")
        except (binascii.Error, ValueError):
            raise BadParameter(name="Upload-Metadata", value=pair[:60], allowed="name base64") from None
    return pairs


EXTENSIONS = "creation,creation-with-upload,termination,checksum,expiration"

router = APIRouter(prefix="/api/v1/uploads", responses=PROBLEM_RESPONSES, tags=["uploads"])


class TusHeaders(BaseModel):
    """The headers of a tus request."""

    tus_resumable: Annotated[str | None, Field(description="1.0.0")] = None
    upload_length: Annotated[int | None, Field(ge=0, description="Bytes of the whole file.")] = None
    upload_offset: Annotated[int | None, Field(ge=0, description="Position of the first of these bytes.")] = (
        None
    )
    upload_metadata: Annotated[str, Field(max_length=8000, description="name base64,name base64 ...")] = ""
    upload_checksum: Annotated[str, Field(max_length=200, description="sha256 base64, of these bytes")] = ""

    def check_protocol(self) -> None:
        """Refuse another version of tus. Raises UnknownProtocol."""
        if self.tus_resumable != TUS_HEADERS["Tus-Resumable"]:
            raise UnknownProtocol(allowed=TUS_HEADERS["Tus-Resumable"])


TusRequest = Annotated[TusHeaders, Header()]


class UploadView(BaseModel):
    """An upload. ``recording_id`` is set once it is complete."""

    id: str
    offset_bytes: int
    length_bytes: int
    file_name: str
    recording_id: str | None
    is_repeated: Annotated[
        bool, Field(description="The recording existed: the same bytes and description within 24 h.")
    ]
    created_at: str
    links: dict[str, str]


class HeadView(BaseModel):
    """Properties found in the first bytes of a file; null: not found, or not yet."""

    file: str
    device: str | None
    rate_hz: float | None
    start: str | None
    time_zone: str | None
    serial_hash: str | None


@router.options("", status_code=204)
@router.options("/{upload_id}", status_code=204, include_in_schema=False)
def describe_uploads(services: UsedServices) -> Response:
    """Return the supported version and extensions of tus, and the largest file size."""
    about = {
        "Tus-Extension": EXTENSIONS,
        "Tus-Max-Size": str(services.settings.max_upload_bytes),
        "Tus-Checksum-Algorithm": ",".join(CHECKSUMS),
    }
    return Response(status_code=204, headers=dict(TUS_HEADERS) | about)


@router.post("", status_code=201)
async def create_upload(request: Request, services: UsedServices, tus: TusRequest) -> Response:
    """Announce a file: 201 and the address for its bytes; the first bytes may be in this request."""
    tus.check_protocol()
    if tus.upload_length is None:
        raise WrongLength
    if tus.upload_length == 0:
        raise EmptyFile
    check_room(services, tus.upload_length)
    about = read_metadata(tus.upload_metadata).describe()
    read_declared(tus.upload_metadata)
    row = await run_in_threadpool(services.uploads.open, tus.upload_length, tus.upload_metadata, about)
    services.inspector.get_ready()
    if request.headers.get("content-type") == OFFSET_BODY:
        row = await append_bytes(request, services, row.id, 0)
    headers = _build_headers(row, services) | {"Location": f"/api/v1/uploads/{row.id}"}
    return Response(status_code=201, headers=headers)


@router.get("/{upload_id}")
def get_upload(upload_id: str, services: UsedServices, tus: TusRequest) -> UploadView:
    """Return how many bytes are stored (HEAD returns the same in headers, as tus requires)."""
    if tus.tus_resumable is not None:
        tus.check_protocol()
    row = finish_upload(services, get_upload_row(services, upload_id))
    headers = _build_headers(row, services) | {
        "Upload-Length": str(row.length_bytes),
        "Cache-Control": "no-store",
    }
    if row.metadata:
        headers["Upload-Metadata"] = row.metadata
    return JSONResponse(view_upload(row).model_dump(), headers=headers)  # type: ignore[return-value]


@router.patch("/{upload_id}", status_code=204, openapi_extra={"requestBody": {"content": {OFFSET_BODY: {}}}})
async def append_to_upload(
    upload_id: str, request: Request, services: UsedServices, tus: TusRequest
) -> Response:
    """Append the next bytes; bytes that arrived before a broken connection are kept."""
    tus.check_protocol()
    if request.headers.get("content-type") != OFFSET_BODY:
        raise WrongMediaType(found=request.headers.get("content-type", "")[:60], allowed=OFFSET_BODY)
    if tus.upload_offset is None:
        raise WrongLength
    row = await append_bytes(request, services, upload_id, tus.upload_offset, tus.upload_checksum)
    return Response(status_code=204, headers=_build_headers(row, services))


@router.delete("/{upload_id}", status_code=204)
def terminate_upload(upload_id: str, services: UsedServices, tus: TusRequest) -> Response:
    """Cancel an upload; the recording of a finished one stays."""
    tus.check_protocol()
    drop_upload(services, services.uploads.get(upload_id))
    return Response(status_code=204, headers=dict(TUS_HEADERS))


@router.get("/{upload_id}/inspection")
def inspect_upload(
    upload_id: str, services: UsedServices, rate_hz: Annotated[float | None, Query(ge=1, le=10_000)] = None
) -> HeadView:
    """Inspect the first bytes during the upload: device, rate, start; null: not yet known."""
    row = get_upload_row(services, upload_id)
    size_bytes = min(row.offset_bytes, PREVIEW_BYTES)
    if row.recording_id is None:
        head = services.incoming.read_first(row.id, size_bytes)
    else:
        head = read_recording(services.storage, row.recording_id, 0, size_bytes)
    request = ReportRequest(row.about.file_name, rate_hz=rate_hz)
    return HeadView(**services.inspector.preview(head, request))


def view_upload(row: UploadRow) -> UploadView:
    """Build the view of an upload."""
    own = f"/api/v1/uploads/{row.id}"
    links = {"self": own, "inspection": f"{own}/inspection"}
    if row.recording_id:
        links["recording"] = f"/api/v1/recordings/{row.recording_id}"
    return UploadView(
        id=row.id,
        offset_bytes=row.offset_bytes,
        length_bytes=row.length_bytes,
        file_name=row.about.file_name,
        recording_id=row.recording_id,
        is_repeated=bool(row.is_repeated),
        created_at=row.created_at,
        links=links,
    )


def _build_headers(row: UploadRow, services: Services) -> dict[str, str]:
    """Return the headers of every response about an upload."""
    left_s = max(0.0, services.settings.upload_term_s - row.idle_s)
    expires = format_datetime(datetime.now(UTC) + timedelta(seconds=left_s), usegmt=True)
    headers = dict(TUS_HEADERS) | {"Upload-Offset": str(row.offset_bytes)}
    if row.recording_id is None:
        return headers | {"Upload-Expires": expires}
    repeated = {"Acromion-Repeated": "true"} if row.is_repeated else {}
    return headers | repeated | {"Acromion-Recording": row.recording_id}
