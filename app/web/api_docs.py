"""The OpenAPI document as a page of our own: nothing is loaded from elsewhere."""

import re
from dataclasses import dataclass
from typing import Any, cast

from fastapi import APIRouter, FastAPI, Request, Response
from fastapi.responses import JSONResponse
from markupsafe import Markup, escape

from app.web.rendering import UsedPage

router = APIRouter(include_in_schema=False)
_CODE = re.compile(r"``(.+?)``")


@dataclass(frozen=True, slots=True)
class Operation:
    """One operation: its name, what it does in paragraphs, its parameters, what goes in and comes out."""

    id: str
    title: str
    paragraphs: tuple[Markup, ...]
    parameters: tuple[tuple[str, str, Markup], ...]
    bodies: str
    answers: str


@router.get("/api/v1/openapi.json")
def give_openapi(request: Request) -> JSONResponse:
    """Return the OpenAPI document."""
    return JSONResponse(cast("FastAPI", request.app).openapi())


@router.get("/api/v1/docs")
def show_docs(page: UsedPage) -> Response:
    """Show every operation of the API."""
    document: dict[str, Any] = cast("FastAPI", page.request.app).openapi()
    operations = [
        Operation(
            told["operationId"],
            f"{method.upper()} {path}",
            tuple(_mark_code(part) for part in told.get("description", "").split("\n\n")),
            tuple(
                (p["name"], p["in"], _mark_code(p.get("description", "")))
                for p in told.get("parameters", ())
                if p["in"] != "path"
            ),
            ", ".join(told.get("requestBody", {}).get("content", {})),
            ", ".join(told["responses"]),
        )
        for path, methods in document["paths"].items()
        for method, told in methods.items()
    ]
    return page.render("api_docs.html", operations=operations)


def _mark_code(text: str) -> Markup:
    """Set what stands between double backticks as code."""
    return Markup(_CODE.sub(r"<code>\1</code>", str(escape(text))))  # noqa: S704 - escaped before
