"""Bytes from the network to the disk, hashed on the way; acknowledged only when they cannot be lost."""

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from app.api.services import Services
from app.errors import BadParameter, BrokenUpload
from app.jobs.job import Job
from app.request import ReportRequest
from app.storage import COPY_BYTES, StoredRecording, Upload, too_large
from fusion.errors import EmptyFile


async def take_recording(request: Request, services: Services, wish: ReportRequest) -> Job:
    """Take the body as a recording and queue its analysis.

    Raises
    ------
    FileTooLarge, DiskFull, EmptyFile, SlowUpload, BadParameter
    """
    _check_announcement(request, services)
    upload = await run_in_threadpool(services.storage.open_upload, services.settings.max_upload_bytes)
    try:
        await _copy_body(request, upload)
        return await run_in_threadpool(_acknowledge, upload, services, wish)
    finally:
        await run_in_threadpool(upload.discard)


def _check_announcement(request: Request, services: Services) -> None:
    """Refuse before the first byte what can be refused then."""
    kind = request.headers.get("content-type", "")
    if kind.startswith("multipart/"):
        raise BadParameter(name="Content-Type", value=kind[:60], allowed="application/octet-stream")
    announced = request.headers.get("content-length", "")
    expected_bytes = int(announced) if announced.isdecimal() else 0
    limit_bytes = services.settings.max_upload_bytes
    if expected_bytes > limit_bytes:
        raise too_large(expected_bytes, limit_bytes)
    services.storage.check_space(expected_bytes, services.settings.min_free_bytes)


async def _copy_body(request: Request, upload: Upload) -> None:
    """Write in large pieces, each in a thread, so that other requests are answered meanwhile."""
    waiting = bytearray()
    try:
        async for chunk in request.stream():
            waiting += chunk
            if len(waiting) >= COPY_BYTES:
                await run_in_threadpool(upload.write, bytes(waiting))
                waiting.clear()
    except ClientDisconnect as error:
        raise BrokenUpload from error
    await run_in_threadpool(upload.write, bytes(waiting))


def _acknowledge(upload: Upload, services: Services, wish: ReportRequest) -> Job:
    """Write, fsync, rename, fsync the folder, commit; a file whose row could not be written is removed."""
    if upload.size_bytes == 0:
        raise EmptyFile
    stored = upload.keep()
    return _commit(stored, services, wish)


def _commit(stored: StoredRecording, services: Services, wish: ReportRequest) -> Job:
    try:
        return services.store.add(stored, wish)
    except BaseException:
        if not services.store.may_hold(stored.id):  # the answer to a commit can be lost on its way
            services.storage.drop_recording(stored.id)
        raise
