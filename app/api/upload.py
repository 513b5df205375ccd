"""Bytes from the network to the disk, hashed on the way; acknowledged only when they cannot be lost."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from app.api.services import Services
from app.errors import BadParameter, BrokenUpload
from app.storage import COPY_BYTES, StoredRecording, Upload, too_large
from fusion.errors import EmptyFile

T = TypeVar("T")


async def receive_recording(
    request: Request, services: Services, commit: Callable[[StoredRecording], T]
) -> T:
    """Take the body as a recording; ``commit`` writes its row, and a file without one is removed.

    Raises
    ------
    FileTooLarge, DiskFull, EmptyFile, SlowUpload, BadParameter
    """
    check_announcement(request, services)
    upload = await run_in_threadpool(services.storage.open_upload, services.settings.max_upload_bytes)
    try:
        await copy_body(request, upload.write)
        return await run_in_threadpool(_acknowledge, upload, services, commit)
    finally:
        await run_in_threadpool(upload.discard)


def check_announcement(request: Request, services: Services) -> None:
    """Refuse before the first byte what can be refused then."""
    kind = request.headers.get("content-type", "")
    if kind.startswith("multipart/"):
        raise BadParameter(name="Content-Type", value=kind[:60], allowed="application/octet-stream")
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
    """Write in large pieces, each in a thread while the next comes; other requests are answered meanwhile.

    What came before a broken connection is written, too.
    """
    waiting = bytearray()
    writing: asyncio.Task[None] | None = None
    try:
        async for chunk in request.stream():
            waiting += chunk
            if len(waiting) >= COPY_BYTES:
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
