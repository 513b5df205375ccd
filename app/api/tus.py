"""Uploads that may be broken off and gone on with: tus 1.0.0 (https://tus.io/protocols/resumable-upload).

Core, creation, creation-with-upload, termination, checksum and expiration. A whole upload becomes a
recording at once; its id comes with the last answer and with every later one.
"""

from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field

from app.api.problems import PROBLEM_RESPONSES, TUS_HEADERS
from app.api.services import Services, UsedServices
from app.api.tus_body import (
    CHECKSUMS,
    OFFSET_BODY,
    drop_upload,
    finish_upload,
    get_upload_row,
    take_bytes,
)
from app.api.tus_ends import TAIL_BODY, TAIL_BYTES, keep_tail, read_both_ends
from app.api.tus_metadata import read_metadata
from app.api.upload import check_room, read_small_body
from app.errors import UnknownProtocol, WrongLength, WrongMediaType, WrongVerb
from app.jobs.uploads import UploadRow
from app.request import ReportRequest
from fusion.errors import EmptyFile

EXTENSIONS = "creation,creation-with-upload,termination,checksum,expiration"

router = APIRouter(prefix="/api/v1/uploads", responses=PROBLEM_RESPONSES, tags=["uploads"])


class TusHeaders(BaseModel):
    """What a tus client says in headers."""

    tus_resumable: Annotated[str | None, Field(description="1.0.0")] = None
    upload_length: Annotated[int | None, Field(ge=0, description="Bytes of the whole file.")] = None
    upload_offset: Annotated[int | None, Field(ge=0, description="Where these bytes begin.")] = None
    upload_metadata: Annotated[str, Field(max_length=8000, description="name base64,name base64 ...")] = ""
    upload_checksum: Annotated[str, Field(max_length=200, description="sha256 base64, of these bytes")] = ""

    def check_protocol(self) -> None:
        """Refuse another version of tus.

        Raises
        ------
        UnknownProtocol
        """
        if self.tus_resumable != TUS_HEADERS["Tus-Resumable"]:
            raise UnknownProtocol(allowed=TUS_HEADERS["Tus-Resumable"])


Said = Annotated[TusHeaders, Header()]


class UploadView(BaseModel):
    """An upload. ``recording_id`` is there once every byte is."""

    id: str
    offset_bytes: int
    length_bytes: int
    file_name: str
    recording_id: str | None
    created_at: str
    links: dict[str, str]


class HeadView(BaseModel):
    """What the first and the last bytes of a file show; null: not yet, or not in them."""

    file: str
    device: str | None
    rate_hz: float | None
    start: str | None
    end: Annotated[str | None, Field(description="Told by the last bytes, sent ahead or come.")]
    time_zone: str | None
    serial_hash: str | None


@router.options("", status_code=204)
@router.options("/{upload_id}", status_code=204, include_in_schema=False)
def describe_uploads(services: UsedServices) -> Response:
    """Say which version and extensions of tus are spoken, and how large a file may be."""
    about = {
        "Tus-Extension": EXTENSIONS,
        "Tus-Max-Size": str(services.settings.max_upload_bytes),
        "Tus-Checksum-Algorithm": ",".join(CHECKSUMS),
    }
    return Response(status_code=204, headers=dict(TUS_HEADERS) | about)


@router.post("", status_code=201)
async def create_upload(request: Request, services: UsedServices, said: Said) -> Response:
    """Announce a file: 201 and the address its bytes go to; the first bytes may come along."""
    said.check_protocol()
    if said.upload_length is None:
        raise WrongLength
    if said.upload_length == 0:
        raise EmptyFile
    check_room(services, said.upload_length)
    about = read_metadata(said.upload_metadata).describe()
    row = await run_in_threadpool(services.uploads.open, said.upload_length, said.upload_metadata, about)
    services.inspector.get_ready()
    if request.headers.get("content-type") == OFFSET_BODY:
        row = await take_bytes(request, services, row.id, 0)
    headers = _tell(row, services) | {"Location": f"/api/v1/uploads/{row.id}"}
    return Response(status_code=201, headers=headers)


@router.get("/{upload_id}")
def get_upload(upload_id: str, services: UsedServices, said: Said) -> UploadView:
    """Say how many bytes are safe (HEAD gives the same in headers, as tus asks)."""
    if said.tus_resumable is not None:
        said.check_protocol()
    row = finish_upload(services, get_upload_row(services, upload_id))
    headers = _tell(row, services) | {"Upload-Length": str(row.length_bytes), "Cache-Control": "no-store"}
    if row.metadata:
        headers["Upload-Metadata"] = row.metadata
    return JSONResponse(view_upload(row).model_dump(), headers=headers)  # type: ignore[return-value]


@router.patch("/{upload_id}", status_code=204, openapi_extra={"requestBody": {"content": {OFFSET_BODY: {}}}})
async def append_to_upload(upload_id: str, request: Request, services: UsedServices, said: Said) -> Response:
    """Take the next bytes; what came before a broken connection is kept."""
    said.check_protocol()
    if request.headers.get("content-type") != OFFSET_BODY:
        raise WrongMediaType(found=request.headers.get("content-type", "")[:60], allowed=OFFSET_BODY)
    if said.upload_offset is None:
        raise WrongLength
    row = await take_bytes(request, services, upload_id, said.upload_offset, said.upload_checksum)
    return Response(status_code=204, headers=_tell(row, services))


@router.delete("/{upload_id}", status_code=204)
def terminate_upload(upload_id: str, services: UsedServices, said: Said) -> Response:
    """Give an upload up; the recording of a finished one stays."""
    said.check_protocol()
    drop_upload(services, services.uploads.get(upload_id))
    return Response(status_code=204, headers=dict(TUS_HEADERS))


@router.post("/{upload_id}", include_in_schema=False)
async def override_method(upload_id: str, request: Request, services: UsedServices, said: Said) -> Response:
    """Do what ``X-HTTP-Method-Override`` says, for networks that let only GET and POST pass."""
    method = request.headers.get("x-http-method-override", "").upper()
    if method == "PATCH":
        return await append_to_upload(upload_id, request, services, said)
    if method == "DELETE":
        return await run_in_threadpool(terminate_upload, upload_id, services, said)
    raise WrongVerb(allowed="HEAD, GET, PATCH, DELETE")


@router.put("/{upload_id}/tail", status_code=204, openapi_extra={"requestBody": {"content": {TAIL_BODY: {}}}})
async def send_tail_ahead(upload_id: str, request: Request, services: UsedServices) -> Response:
    """Take the last bytes of a file, 64 KiB at most, ahead of the rest: they tell when the recording ends.

    They never become part of the recording, and are kept only while the upload is under way.
    """
    if request.headers.get("content-type") != TAIL_BODY:
        raise WrongMediaType(found=request.headers.get("content-type", "")[:60], allowed=TAIL_BODY)
    await run_in_threadpool(services.uploads.get, upload_id)
    tail = await read_small_body(request, TAIL_BYTES)
    await run_in_threadpool(keep_tail, services, upload_id, tail)
    return Response(status_code=204)


@router.get("/{upload_id}/inspection")
def inspect_upload(
    upload_id: str,
    services: UsedServices,
    rate_hz: Annotated[float | None, Query(ge=1, le=10_000)] = None,
) -> HeadView:
    """Say what the first bytes show while the rest is on its way: device, rate, start; null is not yet.

    The end is told once the last bytes are here: sent ahead (``PUT .../tail``), or with all the others.
    """
    row = services.uploads.get(upload_id)
    head, tail = read_both_ends(services, row)
    wish = ReportRequest(row.about.file_name, rate_hz=rate_hz)
    return HeadView(**services.inspector.look_at_head(head, tail, wish))


def view_upload(row: UploadRow) -> UploadView:
    """Show an upload."""
    own = f"/api/v1/uploads/{row.id}"
    links = {"self": own, "inspection": f"{own}/inspection", "tail": f"{own}/tail"}
    if row.recording_id:
        links["recording"] = f"/api/v1/recordings/{row.recording_id}"
    return UploadView(
        id=row.id,
        offset_bytes=row.offset_bytes,
        length_bytes=row.length_bytes,
        file_name=row.about.file_name,
        recording_id=row.recording_id,
        created_at=row.created_at,
        links=links,
    )


def _tell(row: UploadRow, services: Services) -> dict[str, str]:
    """Give the headers that every answer about an upload has."""
    left_s = max(0.0, services.settings.upload_term_s - row.idle_s)
    expires = format_datetime(datetime.now(UTC) + timedelta(seconds=left_s), usegmt=True)
    headers = dict(TUS_HEADERS) | {"Upload-Offset": str(row.offset_bytes)}
    if row.recording_id is None:
        return headers | {"Upload-Expires": expires}
    return headers | {"Acromion-Recording": row.recording_id}
