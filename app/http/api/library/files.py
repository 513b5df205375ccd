"""Responses with stored files, byte for byte: files of an analysis and original recordings."""

import hashlib
import json
import re
import unicodedata
from collections.abc import Mapping
from contextlib import AbstractContextManager, ExitStack, suppress
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from fastapi import Request, Response
from fastapi.responses import FileResponse
from starlette.types import Message, Receive, Scope, Send

from acromion.app.errors import AppError, NoSuchRange, ResultDamaged, StoreDamaged
from acromion.app.http.middleware.guard import REPORT_POLICY
from acromion.app.library.recordings import StoredRow
from acromion.app.library.rows import Job
from acromion.app.report.export.naming import Origin, format_file_name
from acromion.app.services import Services
from acromion.app.store.folder import borrow_recording, read_mark

# Ranges (RFC 9110, 14); a header that cannot be parsed is ignored.


_RANGE = re.compile(r"(\d{0,18})-(\d{0,18})", re.ASCII)
MAX_RANGE_LENGTH = 1000


def check_range(request: Request, size_bytes: int, etag: str) -> None:
    """Remove a ``Range`` header that cannot be parsed or is too long.

    Raises NoSuchRange if a range starts after the end of the file that ``If-Range`` names.
    """
    asked = request.headers.get("range")
    if asked is None:
        return
    parts = _parse_range(asked, size_bytes) if len(asked) <= MAX_RANGE_LENGTH else []
    if not parts:
        headers = request.scope["headers"]
        request.scope["headers"] = [(name, value) for name, value in headers if name != b"range"]
    is_meant = request.headers.get("if-range", etag) == etag
    if is_meant and any(first_byte >= size_bytes for first_byte in parts):
        raise NoSuchRange(size=size_bytes)


def _parse_range(asked: str, size_bytes: int) -> list[int]:
    """Return the first byte of each range; none if a range is malformed or the unit is not bytes."""
    unit, _, ranges = asked.partition("=")
    if unit.strip().lower() != "bytes":
        return []
    parts = []
    for match in (_RANGE.fullmatch(part.strip()) for part in ranges.split(",")):
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
    """Return a published file after checking it against its row; ``download`` overrides its name.

    Raises NotFinished, NoSuchFile, NoSuchRange or ResultDamaged.
    """
    file = services.results.find(job, name)
    headers = build_file_headers(name, file.sha256) | {
        "Content-Type": MEDIA_TYPES[name.rpartition(".")[2]],
        "Content-Disposition": format_disposition(
            download or build_download_name(services, job, name),
            "inline" if name.endswith(".html") else "attachment",
        ),
    }
    damaged = ResultDamaged(name=name, analysis=job.id)
    return _respond_with_borrowed(
        request, services.results.borrow(job, name), file.size_bytes, headers, damaged
    )


def serve_recording(request: Request, services: Services, row: StoredRow) -> Response:
    """Return the original bytes of a recording under its original name.

    Raises NoSuchRange or StoreDamaged.
    """
    headers = build_file_headers("", row.sha256) | {
        "Content-Type": "application/octet-stream",
        "Content-Disposition": format_disposition(row.about.file_name),
    }
    stored = borrow_recording(services.storage, row.id, row.sha256)
    return _respond_with_borrowed(request, stored, row.size_bytes, headers, StoreDamaged())


def _respond_with_borrowed(
    request: Request,
    borrowed: AbstractContextManager[Path],
    size_bytes: int,
    headers: dict[str, str],
    damaged: AppError,
) -> Response:
    """Return a borrowed file, or 304 if the client has it; the file is opened only if it is sent."""
    if is_known(request, headers["ETag"]):
        of_body = ("Content-Type", "Content-Disposition")
        return Response(None, 304, {name: headers[name] for name in headers if name not in of_body})
    check_range(request, size_bytes, headers["ETag"])
    with ExitStack() as opened:
        path = opened.enter_context(borrowed)
        answer = _BorrowedFile(path, damaged, headers=headers)
        answer.lent = opened.pop_all()
    return answer


class _BorrowedFile(FileResponse):
    """Sends a borrowed file and returns it at the end; the response is aborted if the file changes."""

    def __init__(self, path: Path, damaged: AppError, **options: Any) -> None:
        super().__init__(path, **options)
        self._mark, self._damaged, self.lent = read_mark(path), damaged, ExitStack()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def watch(message: Message) -> None:
            if read_mark(Path(self.path)) != self._mark:
                raise self._damaged
            await send(message)

        try:
            await super().__call__(scope, receive, watch)
        finally:
            with suppress(type(self._damaged)):
                self.lent.close()


def serve_bytes(request: Request, body: bytes, download: str) -> Response:
    """Return bytes derived from stored files, as a download or, if HTML, to display.

    The same analyses always give the same bytes.
    """
    headers = build_file_headers(download, hashlib.sha256(body).hexdigest())
    if is_known(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    if not download.endswith(".html"):
        headers["Content-Disposition"] = format_disposition(download)
    return Response(body, media_type=MEDIA_TYPES[download.rpartition(".")[2]], headers=headers)


def respond_with_file(body: bytes, media_type: str, download: str) -> Response:
    """Return bytes as a named download."""
    headers = {"Content-Disposition": format_disposition(download)}
    return Response(body, media_type=media_type, headers=headers)


def build_file_headers(name: str, sha256: str) -> dict[str, str]:
    """Return the headers of a file; they forbid caching, because it is health data."""
    headers = {"ETag": f'"{sha256}"', "Cache-Control": "no-store"}
    return headers | ({"Content-Security-Policy": REPORT_POLICY} if name.endswith(".html") else {})


def format_disposition(name: str, kind: Literal["attachment", "inline"] = "attachment") -> str:
    """Format the header that names a download (RFC 6266): in ASCII, then exactly in UTF-8."""
    letters = "".join(c for c in unicodedata.normalize("NFKD", name) if not unicodedata.combining(c))
    plain = re.sub(r'[^ -~]|["%/\\]', "_", letters)
    exact = "" if plain == name else f"; filename*=UTF-8''{quote(name, safe='')}"
    return f'{kind}; filename="{plain}"{exact}'


def build_download_name(services: Services, job: Job, name: str) -> str:
    """Build a download name with :func:`acromion.app.report.export.naming.format_file_name`."""
    asked, start = job.request, ""  # stays "" if the clock was never set or the results are damaged
    with suppress(ResultDamaged):
        recording = json.loads(services.results.read(job, "results.json")).get("recording", {})
        start = str(recording.get("start") or "")
    origin = Origin(asked.subject, job.file_name, start, asked.side or "", asked.version)
    return format_file_name(origin, name)


def is_known(request: Request, etag: str) -> bool:
    """Return whether the client already has these bytes (``If-None-Match``)."""
    return etag in request.headers.get("if-none-match", "")
