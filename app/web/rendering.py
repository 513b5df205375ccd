"""Rendering: from a template and its values to a page, with its scripts and styles."""

import gzip
import hashlib
import re
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from os import PathLike, stat_result
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlencode

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse
from fastapi.staticfiles import StaticFiles
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.types import Scope

from app.access.subjects import Permission, Subject
from app.api.middleware.echoes import drop_secrets
from app.errors import NotHere
from app.report.render.html import trust_drawing
from app.report.words.numbers import format_angle, format_duration, format_number, format_percent
from app.report.words.wording import Language, fill, is_french, load_wording
from app.services import LANGUAGE_COOKIE, SUBJECT, prefer_language

# Scripts, styles and drawings of the pages, under an address that changes with them, so that browsers keep
# them for good. plotly's script comes from the installed package: no page loads anything from another host.


FOLDER = Path(__file__).resolve().parent / "static"
FOR_EVER = "public, max-age=31536000, immutable"

router = APIRouter(include_in_schema=False)


class Assets(StaticFiles):
    """The static files, which never change under their address."""

    def file_response(
        self, full_path: str | PathLike[str], stat_result: stat_result, scope: Scope, status_code: int = 200
    ) -> Response:
        """Let the browser keep the file."""
        response = super().file_response(full_path, stat_result, scope, status_code)
        response.headers["Cache-Control"] = FOR_EVER
        return response


@cache
def find_assets() -> str:
    """Give the address of the static files, without the proxy's part: ``/static/<fingerprint>``."""
    digest = hashlib.sha256()
    for path in sorted(FOLDER.rglob("*")):
        if path.is_file():
            digest.update(path.relative_to(FOLDER).as_posix().encode() + path.read_bytes())
    return f"/static/{digest.hexdigest()[:12]}"


@cache
def find_plotly() -> str:
    """Give the address of plotly's script, without the proxy's part."""
    return f"/vendor/plotly-{version('plotly')}.min.js"


@cache
def find_style_ids() -> tuple[str, ...]:
    """Give the ids of the styles that plotly's script puts into a page unless an element of that name is
    there: map controls, which we never draw, and which our policy would refuse.
    """
    return tuple(re.findall(r'getElementById\("([0-9a-f]{32,})"\)', _read_script().decode()))


@router.get("/vendor/{name}")
def plotly(name: str, request: Request) -> Response:
    """Give plotly's script from the installed package."""
    if f"/vendor/{name}" != find_plotly():
        raise NotHere
    headers = {"Cache-Control": FOR_EVER, "Vary": "Accept-Encoding"}
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers["Content-Encoding"] = "gzip"
        return Response(_read_packed(), media_type="text/javascript", headers=headers)
    return Response(gzip.decompress(_read_packed()), media_type="text/javascript", headers=headers)


@cache
def _read_packed() -> bytes:
    """Compress the script once: a third of the bytes to send and to hold."""
    return gzip.compress(_read_script(), 6, mtime=0)


def _read_script() -> bytes:
    package = find_spec("plotly")
    if package is None or package.origin is None:
        raise NotHere
    return (Path(package.origin).parent / "package_data" / "plotly.min.js").read_bytes()


YEAR_S = 365 * 24 * 3600

_PACKAGED = Path(__file__).resolve().parents[1] / "templates" / "web"
_CHECKOUT = Path(__file__).resolve().parents[2] / "templates" / "web"

pages = Environment(
    loader=FileSystemLoader(_PACKAGED if _PACKAGED.is_dir() else _CHECKOUT),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
pages.filters["drawing"] = trust_drawing
pages.globals["fill"] = fill
pages.globals["find_style_ids"] = find_style_ids
pages.globals |= {
    "percent": format_percent,
    "angle": format_angle,
    "duration": format_duration,
    "number": format_number,
}


def render_page(
    request: Request, template: str, language: Language, values: dict[str, Any], status: int = 200
) -> HTMLResponse:
    """Render a template with the words of the language, and remember a choice of language."""
    subject: Subject | None = request.scope.get(SUBJECT)
    body = pages.get_template(template).render(
        values,
        words=load_wording(language, "page"),
        language=language,
        base=find_base(request),
        static=find_base(request) + find_assets(),
        plotly=find_base(request) + find_plotly(),
        language_link=turn_language(request, language),
        subject=subject,
        links=find_links(subject, language),
    )
    response = HTMLResponse(body, status, headers={"Content-Language": language})
    if request.query_params.get("lang") == language:
        response.set_cookie(
            LANGUAGE_COOKIE,
            language,
            max_age=YEAR_S,
            httponly=True,
            samesite="lax",
            path=find_base(request) or "/",
        )
    return response


def find_links(subject: Subject | None, language: Language) -> tuple[tuple[str, str], ...]:
    """Give the pages of trust that somebody may open: address, without the proxy's part, and title."""
    words = load_wording(language, "trail")
    known: tuple[tuple[Permission, str, str], ...] = (
        ("aggregate", "/aggregate", words["group"]["title"]),
        ("read", "/retention", words["terms"]["title"]),
        ("trail", "/trail", words["title"]),
    )
    return tuple((address, title) for needed, address, title in known if subject and subject.may(needed))


def find_base(request: Request) -> str:
    """Give the path under which a proxy serves us, "" at the root; every address of ours begins with it."""
    return str(request.scope.get("root_path", "")).rstrip("/")


def turn_language(request: Request, language: Language) -> str:
    """Give the same page in the other language; French is that of the place that the browser names."""
    shown = parse_qsl(drop_secrets(request.url.query), keep_blank_values=True)
    kept = [(name, value) for name, value in shown if name != "lang"]
    other = "en" if is_french(language) else prefer_language(request, ("fr", "fr-CA"))
    return "?" + urlencode([*kept, ("lang", other)])
