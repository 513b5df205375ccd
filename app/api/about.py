"""Reference data of the server: formats, dictionary, codes, version, and its own documentation."""

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.api.middleware.problems import PROBLEM_RESPONSES, ProblemView, view_flag, view_problem
from app.errors import NotHere, list_refusals
from app.formats import FORMATS, find_added_formats
from app.report.export.columns import describe_dictionary
from app.report.words.messages import find_flag_codes
from app.report.words.wording import is_french
from app.services import UsedLanguage
from app.version import installed_readers, software_revision, software_version

router = APIRouter(prefix="/api/v1", responses=PROBLEM_RESPONSES, tags=["about"])


class ReaderView(BaseModel):
    """A reader of another package."""

    name: str
    version: str


class VersionView(BaseModel):
    """Which software answers."""

    name: str
    version: str
    revision: str
    readers: Annotated[list[ReaderView], Field(description="Readers that other packages add.")]


class FormatView(BaseModel):
    """A kind of file that is taken."""

    name: str
    extensions: list[str]
    holds: str


class FormatList(BaseModel):
    """Every kind of file that is taken."""

    items: list[FormatView]


class WordView(BaseModel):
    """What a column of a table or a field of ``results.json`` means."""

    file: str
    column: str
    kind: str | None
    unit: str
    meaning: str


class Dictionary(BaseModel):
    """Every column and field."""

    items: list[WordView]


@router.get("/formats")
def list_formats() -> FormatList:
    """Say which kinds of file are taken, those of the plug-ins that are installed last."""
    return FormatList(items=[FormatView(**asdict(kind)) for kind in (*FORMATS, *find_added_formats())])


@router.get("/dictionary")
def get_dictionary(language: UsedLanguage) -> Dictionary:
    """Say what every column and field means."""
    meaning = "french" if is_french(language) else "english"
    names = ("file", "column", "kind", "unit")
    rows = describe_dictionary()
    return Dictionary(
        items=[WordView(**{name: row[name] for name in names}, meaning=row[meaning]) for row in rows]  # type: ignore[arg-type]
    )


@router.get("/problems/{code}")
def get_problem(code: str, language: UsedLanguage) -> ProblemView:
    """Explain the code of a refusal, or of a warning (status 200: it refuses nothing)."""
    if code in find_flag_codes():
        return view_flag(code, language, f"/api/v1/problems/{code}")
    if code not in {refusal.code for refusal in list_refusals()}:
        raise NotHere
    return view_problem(code, {}, language, f"/api/v1/problems/{code}")


@router.get("/version")
def get_version() -> VersionView:
    """Say which software answers."""
    readers = [ReaderView(name=name, version=version) for name, version in installed_readers()]
    return VersionView(
        name="acromion", version=software_version(), revision=software_revision(), readers=readers
    )
