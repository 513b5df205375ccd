"""Recordings: store, describe, inspect, divide into periods, delete."""

from contextlib import suppress
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, JSONResponse
from pydantic import BaseModel
from sqlalchemy.exc import SQLAlchemyError

from acromion.app.errors import (
    AppError,
    Crashed,
    NotFinished,
    PurgeUnfinished,
    RecordedProblem,
    StaleVersion,
    StoreDamaged,
)
from acromion.app.http.api.library.files import serve_recording
from acromion.app.http.api.library.models import (
    PeriodList,
    PeriodView,
    RecordingList,
    RecordingPatch,
    RecordingQuery,
    RecordingView,
    RecordingWords,
    check_periods,
    cut_page,
    read_cursor,
    read_periods,
    view_periods,
    view_recording,
    write_periods,
)
from acromion.app.http.api.library.released import forget_released
from acromion.app.http.api.library.uploads import (
    RecordingForm,
    finish_upload,
    get_upload_row,
    read_digest,
    read_small_body,
    receive_recording,
    store_recording,
)
from acromion.app.http.middleware.access import check_confirmed, check_may, get_subject
from acromion.app.http.middleware.problems import PROBLEM_RESPONSES, parse_json, validate_model
from acromion.app.library.governance import DAY_S, GRACE_DAYS
from acromion.app.library.recordings import Description, Purged, StoredRow
from acromion.app.ops.copies import find_backup_term, renew_copies
from acromion.app.request import MAX_DIARY_BYTES, ReportRequest
from acromion.app.services import Services, UsedServices
from acromion.app.store.folder import StoredRecording, borrow_recording, seems_intact

router = APIRouter(prefix="/api/v1/recordings", responses=PROBLEM_RESPONSES, tags=["recordings"])
IfMatch = Annotated[
    str, Header(description='The ETag that you read, such as "3"; without it no check is made.')
]
MAX_JSON_BYTES = 4 << 20
WORD = {"type": "string"}
FORM_BODY: dict[str, Any] = {
    "schema": {
        "type": "object",
        "properties": dict.fromkeys(RecordingWords.model_fields, WORD)
        | {"file": {"type": "string", "format": "binary"}},
        "required": ["file"],
    }
}
RAW: dict[str, Any] = {
    "content": {"application/octet-stream": {}, "application/json": {}, "multipart/form-data": FORM_BODY}
}
DIARY_KINDS: dict[str, Any] = {
    "application/json": {"schema": {"type": "array", "items": {"$ref": "#/components/schemas/PeriodView"}}},
    "text/csv": {"schema": {"type": "string"}},
}
XLSX = "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"
SENT_KINDS = DIARY_KINDS | {XLSX: {"schema": {"type": "string", "format": "binary"}}}
DIARY_FILES = ("text/csv", XLSX)

ORIGINAL: dict[int | str, dict[str, Any]] = {
    200: {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}
}


class UploadedRecording(RecordingWords):
    """A finished upload of ``/uploads``, and its description."""

    upload_id: str


REPEATED: dict[int | str, dict[str, Any]] = {
    200: {"model": RecordingView, "description": "The same upload within 24 h: the existing recording."}
}


@router.post("", status_code=201, openapi_extra={"requestBody": RAW}, responses=REPEATED)
async def create_recording(
    request: Request, services: UsedServices, words: Annotated[RecordingWords, Query()]
) -> RecordingView:
    """Store a recording: the raw file, a form with it, or ``{"upload_id": ...}`` of a finished upload."""
    kind = request.headers.get("content-type", "")
    if kind.startswith("multipart/form-data"):
        row, is_new = await _receive_form(request, services, words)
    elif kind.startswith("application/json"):
        body = await read_small_body(request, MAX_JSON_BYTES)
        row, is_new = await run_in_threadpool(_describe_upload, services, body), True
    else:
        about = words.describe()
        row, is_new = await receive_recording(request, services, lambda stored: _add(services, stored, about))
    location = {"Location": f"/api/v1/recordings/{row.id}"}
    return _answer(row, 201 if is_new else 200, location)  # type: ignore[return-value]


def _add(services: Services, stored: StoredRecording, about: Description) -> tuple[StoredRow, bool]:
    """Return the recording and whether it is new; the bytes of a repeated upload are deleted."""
    row = services.recordings.add(stored, about)
    if row.id != stored.id:
        services.storage.drop_recording(stored.id)
    return row, row.id == stored.id


@router.get("")
def list_recordings(
    request: Request, answer: Response, services: UsedServices, asked: Annotated[RecordingQuery, Query()]
) -> RecordingList:
    """Return the newest recordings; ``from`` and ``to`` compare the device clock at the first sample."""
    limit = asked.limit
    wanted = asked.wanted()
    found = services.recordings.find_page(wanted, limit + 1, read_cursor(asked.cursor))
    rows, following = cut_page(found, limit, wanted.place, request, answer)
    return RecordingList(items=[view_recording(row) for row in rows], next_cursor=following)


@router.get("/{recording_id}")
def get_recording(recording_id: str, services: UsedServices) -> RecordingView:
    """Return one recording with its ETag; ``damage`` is set if its bytes are missing or altered."""
    row = services.recordings.get(recording_id)
    is_whole = seems_intact(services.storage, StoredRecording(row.id, row.sha256, row.size_bytes))
    view = view_recording(row).model_copy(update={} if is_whole else {"damage": StoreDamaged.code})
    return JSONResponse(view.model_dump(), headers={"ETag": _tag(row)})  # type: ignore[return-value]


@router.get("/{recording_id}/file", response_class=FileResponse, responses=ORIGINAL)
def get_file(recording_id: str, request: Request, services: UsedServices) -> Response:
    """Download the original file: the bytes and the name that were uploaded. ``Range`` resumes a download."""
    return serve_recording(request, services, services.recordings.get(recording_id))


@router.patch("/{recording_id}")
def change_recording(
    recording_id: str, patch: RecordingPatch, services: UsedServices, if_match: IfMatch = ""
) -> RecordingView:
    """Change the description (JSON merge patch); existing reports do not change."""
    row = _match(services.recordings.get(recording_id), if_match)
    return _answer(services.recordings.describe(row, patch.merge(row.about)))  # type: ignore[return-value]


class ErasureView(BaseModel):
    """An erasure. ``backups``: whether known backups can contain the recording.

    ``backups_until``: the date by which ``acromion backup --keep`` has deleted the last of them.
    """

    recording_id: str
    backups: Literal["none", "until", "unlimited"]
    backups_until: str | None = None


class ScheduledView(BaseModel):
    """A recording in the trash that is deleted permanently after at most so many days of running time."""

    recording_id: str
    purged_in_days: float


@router.delete(
    "/{recording_id}",
    status_code=204,
    responses={
        200: {"model": ErasureView, "description": "Deleted permanently."},
        202: {"model": ScheduledView, "description": "In the trash, to be deleted permanently."},
    },
)
def delete_recording(
    recording_id: str,
    request: Request,
    services: UsedServices,
    purge: bool | Literal["now"] = False,  # noqa: FBT001, FBT002
) -> Response:
    """Move a recording and everything made from it to the trash.

    With ``purge=true`` it is deleted permanently after at most 7 days of the server's running time; until
    then it can be restored. With ``purge=now``, or if the server has no trash, it is deleted permanently at
    once, and the answer says until when backups can contain it. Both need the permission to erase.
    """
    is_now = purge == "now" or not has_trash(services)
    if purge or is_now:
        check_may_erase(request)
        services.recordings.check_hold(recording_id)
    services.recordings.trash(recording_id)
    if not is_now and not purge:
        return Response(status_code=204)
    if not is_now:
        term_s = services.retention.find_trash_term_s(services.settings.trash_term_s)
        services.recordings.hasten_purge(recording_id, term_s - GRACE_DAYS * DAY_S)
        days = min(GRACE_DAYS, term_s / DAY_S)
        scheduled = ScheduledView(recording_id=recording_id, purged_in_days=days)
        return JSONResponse(scheduled.model_dump(), status_code=202)
    purge_recording(services, recording_id)
    term = find_backup_term(services.storage)
    view = ErasureView(recording_id=recording_id, backups=term.kind, backups_until=term.until or None)
    return JSONResponse(view.model_dump())


@router.post("/{recording_id}/restore")
def restore_recording(recording_id: str, services: UsedServices) -> RecordingView:
    """Restore a recording from the trash."""
    return _answer(services.recordings.restore(recording_id))  # type: ignore[return-value]


@router.get("/{recording_id}/inspection")
def get_inspection(
    recording_id: str,
    services: UsedServices,
    rate_hz: Annotated[
        float | None, Query(ge=1, le=10_000, description="For files without timestamps.")
    ] = None,
) -> dict[str, Any]:
    """Inspect the file: device, rate, clock, gaps, calibration proposals, warnings."""
    return _inspect(services, services.recordings.get(recording_id), rate_hz)


def _inspect(services: Services, row: StoredRow, rate_hz: float | None = None) -> dict[str, Any]:
    if not seems_intact(services.storage, StoredRecording(row.id, row.sha256, row.size_bytes)):
        raise StoreDamaged
    if row.inspection is not None and rate_hz is None:
        return dict(row.inspection)
    request = ReportRequest(row.about.file_name, rate_hz=rate_hz)
    with borrow_recording(services.storage, row.id, row.sha256) as log:
        found = services.inspector.look(log, request)
    if rate_hz is None:
        services.recordings.keep_inspection(row.id, found)
    return found


@router.get("/{recording_id}/periods", responses={200: {"content": DIARY_KINDS}})
def get_periods(recording_id: str, request: Request, services: UsedServices) -> list[PeriodView]:
    """Return the periods of the day; as a diary file if text/csv is accepted."""
    row = services.recordings.get(recording_id)
    headers = {"ETag": _tag(row), "Vary": "Accept"}
    if "text/csv" in request.headers.get("accept", ""):
        return Response(write_periods(row.diary), headers=headers, media_type="text/csv")  # type: ignore[return-value]
    periods = [period.model_dump() for period in view_periods(row.diary)]
    return JSONResponse(periods, headers=headers)  # type: ignore[return-value]


@router.put("/{recording_id}/periods", openapi_extra={"requestBody": {"content": SENT_KINDS}})
async def put_periods(
    recording_id: str, request: Request, services: UsedServices, if_match: IfMatch = ""
) -> list[PeriodView]:
    """Set the periods of the day, as JSON rows or a diary file (CSV, Excel), for the following analyses.

    A file with postures only (of ActiPASS or acti-motus) replaces the rows of the kind "posture"; the others
    remain.
    """
    is_file = request.headers.get("content-type", "").startswith(DIARY_FILES)
    body = await read_small_body(request, MAX_DIARY_BYTES if is_file else MAX_JSON_BYTES)
    row = await run_in_threadpool(_store_periods, services, recording_id, if_match, body, is_file=is_file)
    periods = [period.model_dump() for period in view_periods(row.diary)]
    return JSONResponse(periods, headers={"ETag": _tag(row)})  # type: ignore[return-value]


def _store_periods(
    services: Services, recording_id: str, if_match: str, body: bytes, *, is_file: bool
) -> StoredRow:
    row = _match(services.recordings.get(recording_id), if_match)
    if is_file:
        diary = services.inspector.read_diary(body)
        if all(entry.kind == "posture" for entry in diary):
            diary = (*(entry for entry in row.diary if entry.kind != "posture"), *diary)
    else:
        diary = read_periods(validate_model(PeriodList, parse_json(body)).root)
    if diary:
        diary = ReportRequest(row.about.file_name, row.about.subject).choose_rows(diary)
        found = None
        with suppress(RecordedProblem, Crashed):  # the file cannot be read without a rate or a profile
            found = _inspect(services, row)
        check_periods(diary, found)
    return services.recordings.put_diary(row, diary)


def has_trash(services: Services) -> bool:
    """Return whether deleted recordings go to the trash; with a period of 0 they are deleted at once."""
    return services.retention.find_trash_term_s(services.settings.trash_term_s) > 0


def check_may_erase(request: Request) -> None:
    """Check that the subject may delete permanently and entered the password a short time ago.

    Raises NotPermitted or NotConfirmed.
    """
    check_may(get_subject(request), "erase")
    check_confirmed(request)


def purge_recording(services: Services, recording_id: str) -> None:
    """Delete a recording and all its files permanently. Raises OnHold or PurgeUnfinished."""
    finish_purge(services, services.recordings.begin_purge(recording_id))


def finish_purge(services: Services, *begun: Purged) -> None:
    """Delete the files, then the rows, of recordings that are already hidden.

    The ledger of erasures lists them before the first file is deleted. The rows are deleted last, once the
    daily copies no longer contain them, so that housekeeping or the next start can resume an interrupted
    purge. Raises PurgeUnfinished.
    """
    if not begun:
        return
    services.storage.add_erased([one for purged in begun for one in (*purged.recordings, *purged.analyses)])
    for purged in begun:
        for analysis_id in purged.analyses:
            services.storage.drop_analysis(analysis_id)
        for stored_id in purged.recordings:
            services.storage.drop_recording(stored_id)
        services.cache.forget(purged.recordings)
    services.pairs.forget_all()
    forget_released()
    ids = [purged.recordings[0] for purged in begun]
    try:
        renew_copies(services.settings, services.store.engine)
    except (AppError, OSError, SQLAlchemyError) as error:
        why = error.code if isinstance(error, AppError) else str(getattr(error, "strerror", "") or error)
        raise PurgeUnfinished(id=ids[0], why=why[:200]) from error
    for recording_id in ids:
        services.recordings.end_purge(recording_id)
    forget_samples(services)


def forget_samples(services: Services) -> None:
    """Delete decoded samples whose recording no longer exists."""
    held = services.cache.find_recordings()
    services.cache.forget(held - services.recordings.find_known(held))


async def _receive_form(
    request: Request, services: Services, words: RecordingWords
) -> tuple[StoredRow, bool]:
    """Store the file of a form; its other fields are the same as the query's and take precedence."""
    form = RecordingForm(request.headers["content-type"], read_digest(request.headers))

    def commit(stored: StoredRecording) -> tuple[StoredRow, bool]:
        stated = {"file_name": form.file_name} | words.model_dump(exclude_unset=True)
        stated |= {name: word for name, word in form.words.items() if word}
        return _add(services, stored, validate_model(RecordingWords, stated).describe())

    return await store_recording(request, services, form.copy_file, commit)


def _describe_upload(services: Services, body: bytes) -> StoredRow:
    described = validate_model(UploadedRecording, parse_json(body))
    upload = finish_upload(services, get_upload_row(services, described.upload_id))
    if upload.recording_id is None:
        raise NotFinished(state=f"{upload.offset_bytes}/{upload.length_bytes}")
    row = services.recordings.get(upload.recording_id)
    changed = described.model_fields_set - {"upload_id"}
    if not changed:
        return row
    patch = RecordingPatch(**{name: getattr(described, name) for name in changed})
    return services.recordings.describe(row, patch.merge(row.about))


def _answer(row: StoredRow, status: int = 200, headers: dict[str, str] | None = None) -> JSONResponse:
    return JSONResponse(view_recording(row).model_dump(), status, {"ETag": _tag(row)} | (headers or {}))


def _tag(row: StoredRow) -> str:
    return f'"{row.version}"'


def _match(row: StoredRow, if_match: str) -> StoredRow:
    """Refuse a change that is based on an outdated version. Raises StaleVersion."""
    if if_match and if_match.strip() != "*" and _tag(row) not in if_match:
        raise StaleVersion
    return row
