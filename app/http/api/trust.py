"""Releases, holds, retention periods, group figures, the audit log and tokens, for scripts."""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Response
from fastapi.responses import JSONResponse, StreamingResponse
from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from starlette.requests import HTTPConnection

from acromion.app.accounts.accounts import DAYS, MOST_DAYS, Token, format_end, make_token
from acromion.app.accounts.subjects import Granted, Permission, Subject
from acromion.app.errors import NotPermitted
from acromion.app.http.api.library.files import MEDIA_TYPES, respond_with_file
from acromion.app.http.middleware.access import UsedSubject
from acromion.app.http.middleware.guard import get_logins
from acromion.app.http.middleware.problems import PROBLEM_RESPONSES
from acromion.app.library.audit_log import (
    AT_MACHINE,
    AUDIT_COLUMNS,
    NOBODY,
    SYSTEM,
    AuditFilter,
    AuditLine,
    find_lines,
    parse_moment,
)
from acromion.app.library.governance import Release
from acromion.app.library.recordings import HoldReason
from acromion.app.report.export.tables import INTERNATIONAL, encode_table
from acromion.app.report.words.wording import Language, load_wording
from acromion.app.services import Services, UsedServices

MAX_LINES = 500

router = APIRouter(prefix="/api/v1", responses=PROBLEM_RESPONSES)


class ReleaseView(BaseModel):
    """The release of a report; nulls if it is not released."""

    analysis_id: str
    released_by: str | None
    released_at: str | None
    method_version: str | None
    report_id: str | None = Field(description="SHA-256 of the released results.")


def view_release(analysis_id: str, found: Release | None) -> ReleaseView:
    """Build the view of a release."""
    return ReleaseView(
        analysis_id=analysis_id,
        released_by=found.who if found else None,
        released_at=found.at if found else None,
        method_version=found.method_version if found else None,
        report_id=found.report_id if found else None,
    )


@router.get("/analyses/{analysis_id}/release", tags=["analyses"])
def get_release(analysis_id: str, services: UsedServices) -> ReleaseView:
    """Return who released a report and when."""
    job = services.store.get(analysis_id)
    return view_release(job.id, services.releases.find(job.id))


@router.post("/analyses/{analysis_id}/release", tags=["analyses"])
def release_report(analysis_id: str, services: UsedServices, subject: UsedSubject) -> ReleaseView:
    """Release a report in your name: page 1 of its downloads has a stamp. Later versions are not released."""
    job = services.store.get(analysis_id)
    return view_release(job.id, services.releases.release(job, subject.id))


@router.delete("/analyses/{analysis_id}/release", tags=["analyses"])
def take_release_back(analysis_id: str, services: UsedServices, subject: UsedSubject) -> ReleaseView:
    """Withdraw a release; the history keeps it."""
    job = services.store.get(analysis_id)
    return view_release(job.id, services.releases.withdraw(job, subject.id))


class HoldRequest(BaseModel):
    """Why a recording is on hold."""

    model_config = ConfigDict(extra="forbid")

    reason: HoldReason


class HoldView(BaseModel):
    """The hold of a recording; nulls if there is none."""

    recording_id: str
    reason: str | None
    held_by: str | None


@router.get("/recordings/{recording_id}/hold", tags=["recordings"])
def get_hold(recording_id: str, services: UsedServices) -> HoldView:
    """Return whether a recording is on hold."""
    row = services.recordings.get(recording_id, trashed=True)
    return HoldView(recording_id=row.id, reason=row.hold or None, held_by=row.hold_by or None)


@router.put("/recordings/{recording_id}/hold", tags=["recordings"])
def put_hold(recording_id: str, asked: HoldRequest, services: UsedServices, subject: UsedSubject) -> HoldView:
    """Put a recording on hold: neither people nor retention can delete it permanently."""
    services.recordings.hold(recording_id, asked.reason, subject.id)
    return get_hold(recording_id, services)


@router.delete("/recordings/{recording_id}/hold", tags=["recordings"])
def end_hold(recording_id: str, services: UsedServices) -> HoldView:
    """End the hold of a recording."""
    services.recordings.release_hold(recording_id)
    return get_hold(recording_id, services)


class TermView(BaseModel):
    """How many days of server running time a kind is kept.

    null: permanently; for the trash, the period set on the server (``ACROMION_TRASH_TERM_S``).
    """

    model_config = ConfigDict(extra="forbid")

    days: Annotated[int, Field(ge=1, le=36_500, strict=True)] | None
    now: bool = False


@router.get("/retention", tags=["recordings"])
def get_terms(services: UsedServices) -> dict[str, int | None]:
    """Return the retention period of each kind; null: none is set."""
    return {str(kind): days for kind, days in services.retention.find_all().items()}


@router.put("/retention/{kind}", tags=["recordings"])
def put_term(kind: str, asked: TermView, services: UsedServices) -> dict[str, int | None]:
    """Change the term of a kind: recordings, results, trash or trail.

    A shorter term takes effect after 7 days of the server's running time, with ``now`` at once.
    """
    services.retention.put(kind, asked.days, now=asked.now)
    return get_terms(services)


@router.get("/retention/{kind}/due", tags=["recordings"])
def count_due(
    kind: str, services: UsedServices, days: Annotated[int, Query(ge=1, le=36_500)]
) -> dict[str, int]:
    """Return how many of a kind a term of ``days`` would delete now."""
    return {"count": services.retention.count_due(kind, days)}


class BlockView(BaseModel):
    """Means over at least five people; counts are rounded down to a multiple of five."""

    published_at: str
    people: int
    recordings: int
    time_above_60_percent: float
    recorded_h: float


class AggregateView(BaseModel):
    """The published group figures of a study, oldest first; empty if fewer than five people count."""

    study_id: str
    blocks: list[BlockView]


@router.get("/studies/{study_id}/aggregate.json", tags=["studies"])
def get_aggregate(study_id: str, services: UsedServices) -> AggregateView:
    """Return group figures of a study, never of fewer than five people."""
    group = services.aggregates.publish(study_id)
    blocks = [
        BlockView(**{name: value for name, value in asdict(one).items() if name != "id"})
        for one in group.blocks
    ]
    return AggregateView(study_id=group.id, blocks=blocks)


Moment = Annotated[str, AfterValidator(parse_moment)]


class AuditQuery(BaseModel):
    """Filters of the audit log. ``subject`` selects its current recordings; find erased ones by their id."""

    model_config = ConfigDict(extra="forbid")

    subject: str = ""
    recording: str = ""
    who: str = ""
    act: str = ""
    begin: Annotated[Moment, Field(alias="from", description="ISO 8601; UTC if it has no time zone.")] = ""
    end: Annotated[Moment, Field(alias="to")] = ""
    before: Annotated[int, Field(ge=0, lt=1 << 63)] = 0
    lang: str | None = None


def build_question(services: Services, asked: AuditQuery) -> AuditFilter:
    """Convert a query to a filter; a subject code becomes the ids of its recordings."""
    ids: frozenset[str] | None = None
    if asked.recording:
        ids = frozenset({asked.recording})
    elif asked.subject:
        ids = services.recordings.find_of_subject(asked.subject)
    return AuditFilter(ids, asked.who, asked.act, asked.begin, asked.end)


class AuditView(BaseModel):
    """Audit log entries, newest first; ``next_before`` requests the next page and is null on the last one."""

    items: list[dict[str, str | int]]
    next_before: int | None


@router.get("/trail", tags=["trail"])
def get_trail(services: UsedServices, asked: Annotated[AuditQuery, Query()]) -> AuditView:
    """Return audit log entries of a subject, a recording or a person between two moments."""
    question = build_question(services, asked)
    found = list(find_lines(services.store.reader, question, before=asked.before, most=MAX_LINES))
    following = found[-1].seq if len(found) == MAX_LINES else None
    return AuditView(items=[asdict(line) for line in found], next_before=following)


@router.get("/trail/trail.csv", tags=["trail"])
def export_csv(services: UsedServices, asked: Annotated[AuditQuery, Query()]) -> Response:
    """Return the entries as a table."""
    rows: list[Any] = [asdict(line) for line in find_export(services, asked)]
    body = encode_table(AUDIT_COLUMNS, rows, INTERNATIONAL)
    return respond_with_file(body, MEDIA_TYPES["csv"], "audit_log.csv")


@router.get("/trail/trail.jsonl", tags=["trail"])
def export_lines(services: UsedServices, asked: Annotated[AuditQuery, Query()]) -> Response:
    """Return the entries as JSON, one per line."""

    def write() -> Iterator[bytes]:
        for line in find_export(services, asked):
            yield json.dumps(asdict(line)).encode() + b"\n"

    headers = {"Content-Disposition": 'attachment; filename="audit_log.jsonl"', "Cache-Control": "no-store"}
    return StreamingResponse(write(), media_type="application/jsonl", headers=headers)


def find_export(services: Services, asked: AuditQuery) -> Iterator[AuditLine]:
    """Return every matching entry."""
    return find_lines(services.store.reader, build_question(services, asked), before=asked.before)


# Tokens, with which scripts act for a person.

token_router = APIRouter(prefix="/api/v1/tokens", responses=PROBLEM_RESPONSES, tags=["tokens"])
MAX_NAME_LENGTH = 100


def get_person_subject(subject: UsedSubject) -> Subject:
    """Return the person who asks. Raises NotPermitted for a token, so that no token can extend itself."""
    if subject.kind != "person":
        raise NotPermitted(permission="own")
    return subject


UsedPerson = Annotated[Subject, Depends(get_person_subject)]


class TokenWish(BaseModel):
    """A new token: its name, permissions and lifetime."""

    model_config = ConfigDict(extra="forbid")

    name: Annotated[str, Field(min_length=1, max_length=MAX_NAME_LENGTH)]
    permissions: Annotated[list[Granted], Field(min_length=1)]
    days: Annotated[int, Field(ge=1, le=MOST_DAYS)] = DAYS


class TokenView(BaseModel):
    """A token. The secret ``token`` is shown only once, when it is created."""

    id: str
    name: str
    permissions: list[Permission]
    created_at: str
    expires_at: str
    used_at: str | None
    token: str | None = None


class TokenList(BaseModel):
    """Every token of the person who asks."""

    items: list[TokenView]


@token_router.post("", status_code=201)
def create_token(body: TokenWish, connection: HTTPConnection, person: UsedPerson) -> TokenView:
    """Create a token with at most your own permissions."""
    accounts = get_logins(connection).accounts
    token, bearer = make_token(accounts, person, body.name, body.permissions, body.days)
    view = _view(token)
    view.token = bearer
    return JSONResponse(view.model_dump(), 201)  # type: ignore[return-value]


@token_router.get("", response_model_exclude_none=True)
def list_tokens(connection: HTTPConnection, person: UsedPerson) -> TokenList:
    """Return the valid tokens."""
    return TokenList(items=[_view(token) for token in get_logins(connection).accounts.find_tokens(person.id)])


@token_router.delete("/{token_id}", status_code=204)
def delete_token(token_id: str, connection: HTTPConnection, person: UsedPerson) -> Response:
    """Revoke a token; it stops working at once."""
    get_logins(connection).accounts.end_token(person.id, token_id)
    return Response(status_code=204)


def _view(token: Token) -> TokenView:
    return TokenView(
        id=token.id,
        name=token.name,
        permissions=sorted(token.permissions),
        created_at=token.created_at,
        expires_at=format_end(token),
        used_at=token.used_at,
    )


# Names of people in the audit log.


def get_names(connection: HTTPConnection, ids: Iterable[str], language: Language) -> Mapping[str, str]:
    """Return a name for each id; a deleted account keeps its id."""
    accounts = get_logins(connection).accounts
    words = load_wording(language, "trail")["who"]
    known = {AT_MACHINE: words["machine"], SYSTEM: words["system"], NOBODY: words["nobody"], "": ""}
    return {one: known[one] if one in known else accounts.find_name(one) or one for one in set(ids)}


def get_person_name(connection: HTTPConnection, who: str) -> str:
    """Return the name of the person who acts, also through a token; "" for the command line."""
    accounts = get_logins(connection).accounts
    return "" if who == AT_MACHINE else accounts.find_person_name(who)
