"""Column mappings: the meaning of table columns as people stated it, stored by file header."""

import json
from typing import Annotated, Any

from fastapi import APIRouter, Response
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from acromion.app.http.api.library.files import respond_with_file
from acromion.app.http.middleware.problems import PROBLEM_RESPONSES
from acromion.app.report.words.wording import clean_text
from acromion.app.services import UsedServices

router = APIRouter(prefix="/api/v1/columns", responses=PROBLEM_RESPONSES, tags=["columns"])


class MappingView(BaseModel):
    """The column mapping of every file with one header."""

    header: Annotated[
        str, Field(description='Identity of the header; it starts with "-" if no line names the columns.')
    ]
    name: str
    profile: Annotated[
        dict[str, Any],
        BeforeValidator(json.loads),
        Field(description="In the format of `--profile` and `settings.profile`."),
    ]
    is_confirmed: Annotated[
        bool, Field(description="Further files with this header are read without asking.")
    ]
    created_at: str


class MappingList(BaseModel):
    """Every mapping, newest first."""

    items: list[MappingView]


class MappingPatch(BaseModel):
    """The changes to a mapping."""

    model_config = ConfigDict(extra="forbid")

    name: Annotated[str | None, Field(min_length=1, max_length=200)] = None
    is_confirmed: bool | None = None


@router.get("")
def list_column_mappings(services: UsedServices) -> MappingList:
    """Return every mapping."""
    every = services.mappings.find_all()
    return MappingList(items=[MappingView.model_validate(one, from_attributes=True) for one in every])


@router.get("/{header}")
def get_column_mapping(header: str, services: UsedServices) -> MappingView:
    """Return the mapping of one header."""
    return MappingView.model_validate(services.mappings.get(header), from_attributes=True)


@router.get("/{header}/profile.json", response_class=Response)
def export_column_mapping(header: str, services: UsedServices) -> Response:
    """Return the mapping as a file for `acromion run --profile`."""
    mapping = services.mappings.get(header)
    profile = {"name": mapping.name} | json.loads(mapping.profile)
    body = json.dumps(profile, ensure_ascii=False, indent=1).encode() + b"\n"
    return respond_with_file(body, "application/json", "profile.json")


@router.patch("/{header}")
def change_column_mapping(header: str, body: MappingPatch, services: UsedServices) -> MappingView:
    """Rename a mapping, or set whether further files with its header are read without asking."""
    values: dict[str, str | int] = {}
    if name := clean_text(body.name or ""):
        values["name"] = name
    if body.is_confirmed is not None:
        values["is_confirmed"] = int(body.is_confirmed)
    return MappingView.model_validate(services.mappings.change(header, **values), from_attributes=True)


@router.delete("/{header}", status_code=204)
def delete_column_mapping(header: str, services: UsedServices) -> Response:
    """Delete a mapping; reports that used it stay."""
    services.mappings.drop(header)
    return Response(status_code=204)
