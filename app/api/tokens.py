"""Tokens, by which scripts ask in the name of a person: made, listed and revoked by that person alone."""

from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.requests import HTTPConnection

from app.access.accounts import DAYS, MOST_DAYS, Token, format_end, make_token
from app.access.subjects import Permission, Subject
from app.api.middleware.access import UsedSubject
from app.api.middleware.callers import find_logins
from app.api.middleware.problems import PROBLEM_RESPONSES
from app.errors import NotPermitted

router = APIRouter(prefix="/api/v1/tokens", responses=PROBLEM_RESPONSES, tags=["tokens"])
LONGEST_NAME = 100
Granted = Literal["upload", "read", "correct", "release", "export", "erase", "aggregate", "people", "trail"]


def find_person(subject: UsedSubject) -> Subject:
    """Give the person who asks; a token is none, so that none prolongs itself. Raises NotPermitted."""
    if subject.kind != "person":
        raise NotPermitted(permission="own")
    return subject


UsedPerson = Annotated[Subject, Depends(find_person)]


class TokenWish(BaseModel):
    """A token: what it is for, what it may, and for how long."""

    model_config = ConfigDict(extra="forbid")

    name: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME)]
    permissions: Annotated[list[Granted], Field(min_length=1)]
    days: Annotated[int, Field(ge=1, le=MOST_DAYS)] = DAYS


class TokenView(BaseModel):
    """A token. ``token`` itself is shown once, when it is made."""

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


@router.post("", status_code=201)
def create_token(body: TokenWish, connection: HTTPConnection, person: UsedPerson) -> TokenView:
    """Make a token with at most the permissions of whoever asks."""
    accounts = find_logins(connection).accounts
    token, bearer = make_token(accounts, person, body.name, body.permissions, body.days)
    view = _view(token)
    view.token = bearer
    return JSONResponse(view.model_dump(), 201)  # type: ignore[return-value]


@router.get("", response_model_exclude_none=True)
def list_tokens(connection: HTTPConnection, person: UsedPerson) -> TokenList:
    """Give the tokens that hold."""
    return TokenList(
        items=[_view(token) for token in find_logins(connection).accounts.find_tokens(person.id)]
    )


@router.delete("/{token_id}", status_code=204)
def delete_token(token_id: str, connection: HTTPConnection, person: UsedPerson) -> Response:
    """Revoke a token: from the next request on it is nobody's."""
    find_logins(connection).accounts.end_token(person.id, token_id)
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
