"""Bytes from the network to the disk, hashed on the way; acknowledged only when they cannot be lost."""

import asyncio
import base64
import hashlib
from collections.abc import AsyncIterable, Awaitable, Callable, Mapping
from typing import TypeVar

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from app.api.services import Services
from app.errors import BadChecksum, BadParameter, BrokenUpload, WrongDigest
from app.storage import StoredRecording, Upload, too_large
from fusion.errors import EmptyFile

PIECE_BYTES = 256 << 10
"""Written at once: each upload holds some four such pieces, and larger ones are not written sooner."""

T = TypeVar("T")
Copy = Callable[[Request, Callable[[bytes], None]], Awaitable[None]]


async def receive_recording(
    request: Request, services: Services, commit: Callable[[StoredRecording], T]
) -> T:
    """Take the body as a recording; ``commit`` writes its row, and a file without one is removed.

    Raises
    ------
    FileTooLarge, DiskFull, EmptyFile, SlowUpload, BadParameter, WrongDigest
    """
    refuse_form(request)
    digest = read_digest(request.headers)

    def check_and_commit(stored: StoredRecording) -> T:
        if digest not in ("", stored.sha256):
            raise WrongDigest
        return commit(stored)

    return await store_recording(request, services, copy_body, check_and_commit)


async def store_recording(
    request: Request, services: Services, copy: Copy, commit: Callable[[StoredRecording], T]
) -> T:
    """Write what ``copy`` takes from the request to the disk, then let ``commit`` write its row.

    Raises
    ------
    FileTooLarge, DiskFull, EmptyFile, SlowUpload, BadParameter, TooMany
    """
    check_announcement(request, services)
    with services.turns.take():
        upload = await run_in_threadpool(services.storage.open_upload, services.settings.max_upload_bytes)
        try:
            await copy(request, upload.write)
            return await run_in_threadpool(_acknowledge, upload, services, commit)
        finally:
            await run_in_threadpool(upload.discard)


def refuse_form(request: Request) -> None:
    """Refuse a form where the body is the recording itself."""
    kind = request.headers.get("content-type", "")
    if kind.startswith("multipart/"):
        raise BadParameter(name="Content-Type", value=kind[:60], allowed="application/octet-stream")


def read_digest(headers: Mapping[str, str]) -> str:
    """Give the SHA-256 that the client has told (RFC 9530), in hex; "" where it told none.

    Raises
    ------
    BadChecksum
    """
    told = f"{headers.get('content-digest', '')}, {headers.get('repr-digest', '')}"
    member = next((m.strip() for m in told.split(",") if m.strip().lower().startswith("sha-256=")), "")
    if not member:
        return ""
    try:
        digest = base64.b64decode(member[len("sha-256=") :].strip(":"), validate=True)
    except ValueError:
        digest = b""
    if len(digest) != hashlib.sha256().digest_size:
        raise BadChecksum(value=member[:60], allowed="sha-256=:…:")
    return digest.hex()


def check_announcement(request: Request, services: Services) -> None:
    """Refuse before the first byte what can be refused then."""
    announced = request.headers.get("content-length", "")
    check_room(services, int(announced) if announced.isdecimal() else 0)


def check_room(services: Services, expected_bytes: int) -> None:
    """Refuse what is too large, or would fill the disk.

    Raises
    ------
    FileTooLarge, DiskFull
    """
    limit_bytes = services.settings.max_upload_bytes
    if expected_bytes > limit_bytes:
        raise too_large(expected_bytes, limit_bytes)
    services.storage.check_space(expected_bytes, services.settings.min_free_bytes)


async def copy_body(request: Request, write: Callable[[bytes], None]) -> None:
    """Write the body as it comes.

    Raises
    ------
    BrokenUpload
    """
    await copy_chunks(request.stream(), write)


async def copy_chunks(chunks: AsyncIterable[bytes], write: Callable[[bytes], None]) -> None:
    """Write in large pieces, each in a thread while the next comes; other requests are answered meanwhile.

    What came before a broken connection is written, too.

    Raises
    ------
    BrokenUpload
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
    """Give a body that is no recording.

    Raises
    ------
    FileTooLarge
    """
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
