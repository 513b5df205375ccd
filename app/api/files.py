"""What a finished analysis has left: stored bytes, handed out as they are."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from fastapi import Request, Response
from fastapi.responses import FileResponse
from starlette.types import Message, Receive, Scope, Send

from app.api.guard import REPORT_POLICY
from app.errors import NoSuchFile, NoSuchRange, NotFinished, ResultDamaged
from app.jobs.job import Job, JobState
from app.report.export.naming import Origin, format_file_name
from app.services import Services
from app.storage.store import ResultFile, borrow_result, read_mark

# Parts of a file (RFC 9110, 14): what cannot be understood is as if it had not been asked for.


_RANGE = re.compile(r"(\d*)-(\d*)", re.ASCII)


def check_range(request: Request, size_bytes: int) -> None:
    """Leave a ``Range`` header only where its parts can be given.

    Raises
    ------
    NoSuchRange
        When a part begins behind the end.
    """
    asked = request.headers.get("range")
    if asked is None or "if-range" in request.headers:
        return
    parts = _read_parts(asked, size_bytes)
    if not parts:
        headers = request.scope["headers"]
        request.scope["headers"] = [(name, value) for name, value in headers if name != b"range"]
    if any(first_byte >= size_bytes for first_byte in parts):
        raise NoSuchRange(size=size_bytes)


def _read_parts(asked: str, size_bytes: int) -> list[int]:
    """Give the first byte of each part; none where a part is malformed, or the unit is another."""
    unit, _, told = asked.partition("=")
    matches = [_RANGE.fullmatch(part.strip()) for part in told.split(",")]
    if unit.strip().lower() != "bytes":
        return []
    parts = []
    for match in matches:
        if match is None or match[0] == "-" or (match[1] and match[2] and int(match[1]) > int(match[2])):
            return []
        last_ones = min(int(match[2] or 0), size_bytes)
        parts.append(int(match[1]) if match[1] else size_bytes - last_ones)
    return parts


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


def serve_file(request: Request, services: Services, job: Job, name: str, download: str = "") -> Response:
    """Give the bytes of a published file, held against their row; ``download`` names them, else the one rule.

    Raises
    ------
    NotFinished, NoSuchFile, NoSuchRange, ResultDamaged
    """
    file = find_file(services, job, name)
    headers = head_file(name, file.sha256)
    if _is_known(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    check_range(request, file.size_bytes)
    with ExitStack() as opened:
        path = opened.enter_context(borrow_file(services, job, name))
        answer = _LentFile(
            path,
            headers=headers,
            media_type=MEDIA_TYPES[name.rpartition(".")[2]],
            filename=download or name_download(services, job, name),
            content_disposition_type="inline" if name.endswith(".html") else "attachment",
        )
        answer.lent = opened.pop_all()
    return answer


class _LentFile(FileResponse):
    """A borrowed file, given back at the end. Where it changes on the way, the answer breaks off."""

    def __init__(self, path: Path, **told: Any) -> None:
        super().__init__(path, **told)
        self._mark, self.lent = read_mark(path), ExitStack()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def watch(message: Message) -> None:
            if read_mark(Path(self.path)) != self._mark:
                raise ResultDamaged(name=Path(self.path).name)
            await send(message)

        try:
            await super().__call__(scope, receive, watch)
        finally:
            with suppress(ResultDamaged):
                self.lent.close()


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
    """Give the headers of a file. It is health data: no copy stays on a computer that people share."""
    headers = {"ETag": f'"{sha256}"', "Cache-Control": "no-store"}
    return headers | ({"Content-Security-Policy": REPORT_POLICY} if name.endswith(".html") else {})


def find_file(services: Services, job: Job, name: str) -> ResultFile:
    """Give what was published under a name.

    Raises
    ------
    NotFinished, NoSuchFile
    """
    check_succeeded(job, name)
    file = services.store.find_file(job.id, name)
    if file is None:
        raise NoSuchFile(name=name)
    return file


@contextmanager
def borrow_file(services: Services, job: Job, name: str) -> Iterator[Path]:
    """Lend a published file, held against its row.

    Raises
    ------
    NotFinished, NoSuchFile, ResultDamaged
    """
    file = find_file(services, job, name)
    try:
        with borrow_result(services.storage, job.id, str(job.token), file) as path:
            yield path
    except ResultDamaged as damaged:
        again = {"again": job.replaced_by} if job.replaced_by else {}
        raise ResultDamaged(**damaged.facts, **again) from damaged


def read_result(services: Services, job: Job, name: str) -> bytes:
    """Give the bytes of a published file.

    Raises
    ------
    NotFinished, NoSuchFile, ResultDamaged
    """
    with borrow_file(services, job, name) as path:
        return path.read_bytes()


def check_succeeded(job: Job, name: str) -> None:
    """See that an analysis has files.

    Raises
    ------
    NotFinished, NoSuchFile
    """
    if not job.is_over:
        raise NotFinished(state=job.state.value)
    if job.state is not JobState.SUCCEEDED or job.token is None:
        raise NoSuchFile(name=name)


def name_ascii(name: str) -> str:
    """Write a name with the signs that an HTTP header takes."""
    return name.encode("ascii", "replace").decode("ascii").replace("?", "_")


def name_download(services: Services, job: Job, name: str) -> str:
    """Name a download by the one rule for all files that leave."""
    asked = job.request
    origin = Origin(asked.subject, job.file_name, _find_start(services, job), asked.side or "", asked.version)
    return format_file_name(origin, name)


def _find_start(services: Services, job: Job) -> str:
    """Give when the recording began; empty where its clock was never set, or the results are damaged."""
    try:
        recording = json.loads(read_result(services, job, "results.json")).get("recording", {})
    except ResultDamaged:
        return ""
    return str(recording.get("start") or "")


def _is_known(request: Request, etag: str) -> bool:
    return etag in request.headers.get("if-none-match", "")
