"""What a finished analysis has left: stored bytes, handed out as they are."""

import hashlib
import json
from collections.abc import Mapping

from fastapi import Request, Response
from fastapi.responses import FileResponse
from starlette.background import BackgroundTask

from app.api.guard import REPORT_POLICY
from app.api.ranges import check_range
from app.api.services import Services
from app.errors import NoSuchFile, NotFinished
from app.jobs.job import Job, JobState
from app.report.naming import Origin, name_file
from app.storage import borrow_result

MEDIA_TYPES: Mapping[str, str] = {
    "json": "application/json",
    "html": "text/html; charset=utf-8",
    "pdf": "application/pdf",
    "parquet": "application/vnd.apache.parquet",
    "csv": "text/csv; charset=utf-8",
    "txt": "text/plain; charset=utf-8",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "zip": "application/zip",
    "gz": "application/gzip",
    "yaml": "application/yaml",
}
FOR_EVER = "private, max-age=31536000, immutable"
"""What is published for an analysis never changes: another attempt is another analysis."""


def serve_file(request: Request, services: Services, job: Job, name: str) -> Response:
    """Give the stored bytes of a published file, and nothing of an attempt that does not count.

    Raises
    ------
    NotFinished, NoSuchFile, NoSuchRange
    """
    token = check_succeeded(job, name)
    file = services.store.find_file(job.id, name)
    if file is None:
        raise NoSuchFile(name=name)
    headers = head_file(name, file.sha256)
    if _is_known(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    check_range(request, file.size_bytes)
    path = services.storage.fetch_result(job.id, token, name)
    return FileResponse(
        path,
        background=BackgroundTask(services.storage.give_back, path),
        headers=headers,
        media_type=MEDIA_TYPES[name.rpartition(".")[2]],
        filename=name_download(services, job, name),
        content_disposition_type="inline" if name.endswith(".html") else "attachment",
    )


def serve_bytes(request: Request, services: Services, job: Job, name: str, body: bytes) -> Response:
    """Give bytes that were just made of stored ones; the same analysis always gives the same."""
    headers = head_file(name, hashlib.sha256(body).hexdigest())
    if _is_known(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    headers["Content-Disposition"] = (
        f'attachment; filename="{name_ascii(name_download(services, job, name))}"'
    )
    return Response(body, media_type=MEDIA_TYPES[name.rpartition(".")[2]], headers=headers)


def head_file(name: str, sha256: str) -> dict[str, str]:
    """Give the headers of a file that never changes."""
    headers = {"ETag": f'"{sha256}"', "Cache-Control": FOR_EVER}
    if name.startswith(("report", "answer")):  # the language may be the browser's choice
        headers["Cache-Control"] = "private, no-cache"
    return headers | ({"Content-Security-Policy": REPORT_POLICY} if name.endswith(".html") else {})


def read_result(services: Services, job: Job, name: str) -> bytes:
    """Give the bytes of a published file.

    Raises
    ------
    NotFinished, NoSuchFile
    """
    token = check_succeeded(job, name)
    with borrow_result(services.storage, job.id, token, name) as path:
        return path.read_bytes()


def check_succeeded(job: Job, name: str) -> str:
    """Give the attempt that counts.

    Raises
    ------
    NotFinished, NoSuchFile
    """
    if not job.is_over:
        raise NotFinished(state=job.state.value)
    if job.state is not JobState.SUCCEEDED or job.token is None:
        raise NoSuchFile(name=name)
    return job.token


def name_ascii(name: str) -> str:
    """Write a name with the signs that an HTTP header takes."""
    return name.encode("ascii", "replace").decode("ascii").replace("?", "_")


def name_download(services: Services, job: Job, name: str) -> str:
    """Name a download by the one rule for all files that leave."""
    asked = job.request
    origin = Origin(asked.subject, job.file_name, _find_start(services, job), asked.side or "", asked.version)
    return name_file(origin, name)


def _find_start(services: Services, job: Job) -> str:
    """Give when the recording began; empty where its clock was never set."""
    recording = json.loads(read_result(services, job, "results.json")).get("recording", {})
    return str(recording.get("start") or "")


def _is_known(request: Request, etag: str) -> bool:
    return etag in request.headers.get("if-none-match", "")
