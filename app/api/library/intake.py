"""Uploads in one request: bytes go from network to disk, and are acknowledged once they are durable."""

import asyncio
import base64
import hashlib
from collections.abc import AsyncIterable, AsyncIterator, Awaitable, Callable, Mapping
from typing import TypeVar

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.requests import ClientDisconnect

from app.errors import BadChecksum, BadParameter, BrokenUpload, WrongDigest
from app.services import Services
from app.storage.store import StoredRecording, Upload, too_large
from fusion.errors import EmptyFile

PIECE_BYTES = 256 << 10
"""Written at once: each upload holds some four such pieces, and larger ones are not written sooner."""

T = TypeVar("T")
Copy = Callable[[Request, Callable[[bytes], None]], Awaitable[None]]


async def receive_recording(
    request: Request, services: Services, commit: Callable[[StoredRecording], T]
) -> T:
    """Store the body as a recording; ``commit`` writes its row, and a file without a row is removed.

    Raises FileTooLarge, DiskFull, EmptyFile, SlowUpload, BadParameter or WrongDigest.
    """
    kind = request.headers.get("content-type", "")
    if kind.startswith("multipart/"):  # the body is the recording itself
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
    """Write what ``copy`` takes from the request to the disk, then let ``commit`` write its row.

    Raises FileTooLarge, DiskFull, EmptyFile, SlowUpload, BadParameter or TooMany.
    """
    announced = request.headers.get("content-length", "")
    check_room(services, int(announced) if announced.isdecimal() else 0)
    with services.upload_slots.take():
        upload = await run_in_threadpool(services.storage.open_upload, services.settings.max_upload_bytes)
        try:
            await copy(request, upload.write)
            return await run_in_threadpool(_acknowledge, upload, services, commit)
        finally:
            await run_in_threadpool(upload.discard)


def read_digest(headers: Mapping[str, str]) -> str:
    """Give the SHA-256 that the client has stated (RFC 9530), in hex; "" where it stated none.

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
    """Refuse what is too large, or would fill the disk. Raises FileTooLarge or DiskFull."""
    limit_bytes = services.settings.max_upload_bytes
    if expected_bytes > limit_bytes:
        raise too_large(expected_bytes, limit_bytes)
    services.storage.check_space(expected_bytes, services.settings.min_free_bytes)


async def copy_chunks(chunks: AsyncIterable[bytes], write: Callable[[bytes], None]) -> None:
    """Write in large pieces, each in a thread while the next comes; other requests are answered meanwhile.

    What came before a broken connection is written, too. Raises BrokenUpload.
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
    """Give a body that is no recording. Raises FileTooLarge."""
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
        if not services.store.may_hold(stored.id):  # the answer to a commit can be lost on its way
            services.storage.drop_recording(stored.id)
        raise


# A recording in a form, as browsers and ``curl -F`` send it. python-multipart parses it as it streams in; its
# own files would write every byte twice, first to the folder for temporary files, small in a container.


MOST_FIELDS, MOST_FIELD_BYTES = 20, 4096


class RecordingForm:
    """Takes one file and a few short fields, in any order, from a form.

    ``digest`` is the SHA-256 that the client has stated of the whole form, in hex, or "".
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
        """Write the file as it comes. Raises BadParameter, BrokenUpload or WrongDigest."""
        await copy_chunks(self._read_file(request), write)
        if not self._ended:
            raise BrokenUpload
        if self._digest not in ("", self._sha256.hexdigest()):
            raise WrongDigest
        if self.file_name is None:
            raise BadParameter(name="form", value=", ".join(self.words)[:60], allowed="file")

    async def _read_file(self, request: Request) -> AsyncIterator[bytes]:
        """Return what each chunk of the form holds of the file."""
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
        if len(self._word) > MOST_FIELD_BYTES or len(self.words) >= MOST_FIELDS:
            raise BadParameter(name=self._name[:60], value="", allowed=f"≤ {MOST_FIELD_BYTES}")

    def _end_part(self) -> None:
        if not self._in_file:
            self.words[self._name] = self._word.decode("utf-8", "replace").strip()
