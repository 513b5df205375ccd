"""Reference data of the server: formats, dictionary, codes, version, and its own documentation."""

import html
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Annotated, Any, cast

from fastapi import APIRouter, FastAPI, Request
from fastapi.responses import HTMLResponse
from pydantic import BaseModel, Field

from app.api.problems import PROBLEM_RESPONSES, ProblemView, view_flag, view_problem
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


@router.get("/docs", include_in_schema=False)
def show_docs(request: Request) -> HTMLResponse:
    """Show the OpenAPI document as a page of our own: nothing is loaded from elsewhere."""
    document = cast("FastAPI", request.app).openapi()
    return HTMLResponse("".join(_write_page(document)))


def _write_page(document: Mapping[str, Any]) -> Iterator[str]:
    yield '<!doctype html><html lang="en"><meta charset="utf-8"><title>Acromion: REST API</title>'
    yield '<meta name="viewport" content="width=device-width"><link rel="stylesheet" href="/static/page.css">'
    yield "<main><h1>REST API</h1><p>The same as <a href='/api/v1/openapi.json'>openapi.json</a>.</p>"
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            yield from _write_operation(f"{method.upper()} {path}", operation)
    yield "</main></html>"


def _write_operation(title: str, operation: Mapping[str, Any]) -> Iterator[str]:
    yield f'<section id="{html.escape(operation["operationId"])}"><h2><code>{html.escape(title)}</code></h2>'
    yield f"<p>{html.escape(operation.get('description', ''))}</p>"
    parameters = [p for p in operation.get("parameters", ()) if p["in"] != "path"]
    if parameters:
        yield "<dl>" + "".join(map(_write_parameter, parameters)) + "</dl>"
    bodies = operation.get("requestBody", {}).get("content", {})
    answers = ", ".join(operation["responses"])
    yield f"<p>{html.escape(', '.join(bodies))}{' → ' if bodies else ''}{html.escape(answers)}</p></section>"


def _write_parameter(parameter: Mapping[str, Any]) -> str:
    name, description = (html.escape(parameter.get(key, "")) for key in ("name", "description"))
    return f"<dt><code>{name}</code> ({parameter['in']})</dt><dd>{description}</dd>"
