"""Render pages and reports: the page object, templates, forms, scripts and styles."""

import gzip
import hashlib
import re
import time
from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.metadata import version
from importlib.util import find_spec
from os import PathLike, stat_result
from pathlib import Path
from typing import Annotated, Any, cast
from urllib.parse import parse_qsl, urlencode

from fastapi import APIRouter, Depends, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from fastapi.staticfiles import StaticFiles
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.types import Scope

from acromion.app.accounts.sign_in import SignIn
from acromion.app.accounts.subjects import Permission, Subject
from acromion.app.errors import BadParameter, NotHere
from acromion.app.http.middleware.guard import REPORT_POLICY, get_logins
from acromion.app.http.middleware.problems import drop_secrets
from acromion.app.library.rows import Job
from acromion.app.report.render.html import mark_drawing_safe
from acromion.app.report.words.numbers import (
    format_angle,
    format_duration,
    format_iso_moment,
    format_number,
    format_percent,
)
from acromion.app.report.words.wording import Language, Part, Words, fill, is_french, load_wording
from acromion.app.request import MAX_DIARY_BYTES
from acromion.app.services import (
    LANGUAGE_COOKIE,
    SUBJECT,
    Services,
    choose_language,
    find_services,
    prefer_language,
)

# Scripts, styles and drawings have addresses that change with their content, so browsers cache them
# permanently. plotly's script comes from the installed package: no page loads anything from another host.


FOLDER = Path(__file__).resolve().parent / "static"
FOR_EVER = "public, max-age=31536000, immutable"

router = APIRouter(include_in_schema=False)


class Assets(StaticFiles):
    """The static files, whose content never changes under the same address."""

    def file_response(
        self, full_path: str | PathLike[str], stat_result: stat_result, scope: Scope, status_code: int = 200
    ) -> Response:
        """Return the file with a permanent cache header."""
        response = super().file_response(full_path, stat_result, scope, status_code)
        response.headers["Cache-Control"] = FOR_EVER
        return response


@cache
def get_assets_path() -> str:
    """Return the path of the static files without the proxy's prefix: ``/static/<fingerprint>``."""
    digest = hashlib.sha256()
    for path in sorted(FOLDER.rglob("*")):
        if path.is_file():
            digest.update(path.relative_to(FOLDER).as_posix().encode() + path.read_bytes())
    return f"/static/{digest.hexdigest()[:12]}"


@cache
def list_imports(script: str) -> tuple[str, ...]:
    """Return all modules that a script of the static folder imports, so that a page can load them at once."""
    modules = [FOLDER / script]
    for path in modules:
        names = re.findall(r'^import .* from "(\..*)";$', path.read_text("utf-8"), re.MULTILINE)
        modules += [one for name in names if (one := (path.parent / name).resolve()) not in modules]
    return tuple(path.relative_to(FOLDER).as_posix() for path in modules[1:])


@cache
def get_plotly_path() -> str:
    """Return the path of plotly's script without the proxy's prefix."""
    return f"/vendor/plotly-{version('plotly')}.min.js"


@cache
def get_style_ids() -> tuple[str, ...]:
    """Return the ids of the style elements that plotly's script would add to a page.

    A page that already contains elements with these ids prevents this. The styles are for map controls, which
    are never used, and the content security policy would refuse them.
    """
    return tuple(re.findall(r'getElementById\("([0-9a-f]{32,})"\)', _read_script().decode()))


@router.get("/vendor/{name}")
def plotly(name: str, request: Request) -> Response:
    """Return plotly's script from the installed package."""
    if f"/vendor/{name}" != get_plotly_path():
        raise NotHere
    headers = {"Cache-Control": FOR_EVER, "Vary": "Accept-Encoding"}
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers["Content-Encoding"] = "gzip"
        return Response(_read_packed(), media_type="text/javascript", headers=headers)
    return Response(gzip.decompress(_read_packed()), media_type="text/javascript", headers=headers)


@cache
def _read_packed() -> bytes:
    """Compress the script once, to a third of its size."""
    return gzip.compress(_read_script(), 6, mtime=0)


def _read_script() -> bytes:
    package = find_spec("plotly")
    if package is None or package.origin is None:
        raise NotHere
    return (Path(package.origin).parent / "package_data" / "plotly.min.js").read_bytes()


YEAR_S = 365 * 24 * 3600

_PACKAGED = Path(__file__).resolve().parents[2] / "templates" / "web"
_CHECKOUT = Path(__file__).resolve().parents[3] / "templates" / "web"

pages = Environment(
    loader=FileSystemLoader(_PACKAGED if _PACKAGED.is_dir() else _CHECKOUT),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
pages.filters["drawing"] = mark_drawing_safe
pages.globals |= {
    "fill": fill,
    "get_style_ids": get_style_ids,
    "list_imports": list_imports,
    "percent": format_percent,
    "angle": format_angle,
    "duration": format_duration,
    "moment": format_iso_moment,
    "number": format_number,
}


class _Wording:
    """The words of one language, by part, for templates: ``wording.day.heading``."""

    def __init__(self, language: Language) -> None:
        self._language = language

    def __getattr__(self, part: str) -> Words:
        return load_wording(self._language, cast("Part", part))


SET_S, SET_PAUSE_S = 2.0, 0.05
"""How long a request waits for a report that is only set again, and between two looks."""


@dataclass(frozen=True, slots=True)
class Page:
    """A request for a page: its language, and the services behind it."""

    request: Request
    services: Services
    language: Language

    @property
    def base(self) -> str:
        """The path prefix set by the proxy, "" at the root; every link on a page starts with it."""
        return get_base(self.request)

    @property
    def subject(self) -> Subject | None:
        """The subject of the request; None for a browser without a session."""
        return cast("Subject | None", self.request.scope.get(SUBJECT))

    @property
    def sign_in(self) -> SignIn:
        """The sign-in service."""
        return get_logins(self.request)

    def words(self, part: Part = "page") -> Words:
        """Return one part of the words."""
        return load_wording(self.language, part)

    def go_to(self, job: Job, query: str = "") -> Response:
        """Open an analysis; if only its label changes, wait until its report is set again.

        Without a free worker the page of the analysis shows its progress.
        """
        end_s = time.monotonic() + SET_S
        while job.is_label and not job.is_over and time.monotonic() < end_s:
            time.sleep(SET_PAUSE_S)
            job = self.services.store.get(job.id)
        return self.go(f"/analyses/{job.id}{query}")

    def go(self, place: str) -> Response:
        """Redirect the browser to a page of this server."""
        return RedirectResponse(self.base + place, status_code=303)

    def render(self, template: str, status: int = 200, **values: Any) -> HTMLResponse:
        """Render a template, and store the selected language in a cookie."""
        body = pages.get_template(template).render(
            values,
            words=self.words(),
            wording=_Wording(self.language),
            language=self.language,
            base=self.base,
            static=self.base + get_assets_path(),
            plotly=self.base + get_plotly_path(),
            language_link=self.get_language_link(),
            subject=self.subject,
            links=self._list_links(),
            section=self.request.url.path.removeprefix(self.base).strip("/").partition("/")[0],
        )
        response = HTMLResponse(body, status, headers={"Content-Language": self.language})
        if self.request.query_params.get("lang") == self.language:
            path = self.base or "/"
            response.set_cookie(
                LANGUAGE_COOKIE, self.language, max_age=YEAR_S, httponly=True, samesite="lax", path=path
            )
        return response

    def get_language_link(self) -> str:
        """Return the query for this page in the other language; for French, the browser's variant."""
        shown = parse_qsl(drop_secrets(self.request.url.query), keep_blank_values=True)
        kept = [(name, value) for name, value in shown if name != "lang"]
        other = "en" if is_french(self.language) else prefer_language(self.request, ("fr", "fr-CA"))
        return "?" + urlencode([*kept, ("lang", other)])

    def _list_links(self) -> tuple[tuple[str, str], ...]:
        """List the address and title of the trust pages that the subject may open."""
        words = self.words("trail")
        known: tuple[tuple[Permission, str, str], ...] = (
            ("aggregate", "/aggregate", words["group"]["title"]),
            ("read", "/retention", words["terms"]["title"]),
            ("trail", "/trail", words["title"]),
        )
        return tuple(
            (place, title) for needed, place, title in known if self.subject and self.subject.may(needed)
        )


def get_base(request: Request) -> str:
    """Return the path prefix set by the proxy, "" at the root."""
    return str(request.scope.get("root_path", "")).rstrip("/")


async def open_page(request: Request) -> Page:
    """Return the page object of a request."""
    return Page(request, find_services(request), choose_language(request))


UsedPage = Annotated[Page, Depends(open_page)]


# A report as a page: above it links back, to the PDF and to the other language; the stored file has none.

NAVIGATION_STYLE = (
    ".way{display:flex;flex-wrap:wrap;gap:.4rem 1.4rem;max-width:60rem;margin:0 auto;padding:.6rem 1rem}"
    ".way a{display:inline-block;min-height:24px}"
    ".old{max-width:60rem;margin:0 auto;padding:.7rem 1rem;background:#fdf0d5;color:#6b4500}"
    ".old a{color:inherit}"
    "@media screen and (prefers-color-scheme:dark){.old{background:#38290f;color:#f1bd73}}"
    "@media print{.way,.old a{display:none}}"
)
NAVIGATION_HASH = b64encode(hashlib.sha256(NAVIGATION_STYLE.encode()).digest()).decode()
"""A report's policy allows styles only by their hash."""


@dataclass(frozen=True, slots=True)
class OldVersion:
    """The notice that a report is not the current one, with a link to the current one."""

    text: str
    link: str
    address: str


def add_navigation_of_query(page: Page, report: str, place: str) -> HTMLResponse:
    """Add navigation above a report whose page and PDF have the same query."""
    query = f"?{page.request.url.query}" if page.request.url.query else ""
    return add_navigation(page, report, f"{page.base}{place}{query}", f"{page.base}{place}/report.pdf{query}")


def add_navigation(
    page: Page, report: str, back: str, pdf: str, old: OldVersion | None = None
) -> HTMLResponse:
    """Add navigation, and the notice of an old version, above a report; its stored file does not change.

    ``back`` and ``pdf`` are the addresses of its page and its PDF in this language. The links are not
    printed.
    """
    words, labels = page.words(), page.words()["report_way"]
    links = (
        (back, labels["back"], ""),
        (pdf, labels["pdf"], " download"),
        (page.get_language_link(), words["other_language"], f' lang="{words["other_language_code"]}"'),
    )
    items = "".join(f'<a href="{escape(place)}"{more}>{escape(name)}</a>' for place, name, more in links)
    bar = f'<nav class="way" aria-label="{escape(labels["label"])}">{items}</nav>'
    if old is not None:
        link = f'<a href="{escape(old.address)}">{escape(old.link)}</a>'
        bar += f'<aside class="old">{escape(old.text)} {link}</aside>'
    head, end, body = report.partition("</head>")
    head = (
        head.replace("style-src ", f"style-src 'sha256-{NAVIGATION_HASH}' ", 1)
        + f"<style>{NAVIGATION_STYLE}</style>"
    )
    whole = head + end + body.replace('<div class="sheet">', f'{bar}<div class="sheet">', 1)
    # allow the PDF download; otherwise as strict as for the file
    policy = f"{REPORT_POLICY} allow-downloads"
    return HTMLResponse(whole, headers={"Content-Security-Policy": policy, "Cache-Control": "no-store"})


# Forms of short text fields (urlencoded).

MAX_BYTES = 4 << 20
MAX_FIELDS = 50_000

Form = Mapping[str, list[str]]


async def read_form(request: Request) -> Form:
    """Parse ``application/x-www-form-urlencoded`` to the values of each name. Raises BadParameter."""
    body = await read_body(request)
    try:
        pairs = parse_qsl(body.decode(), keep_blank_values=True, max_num_fields=MAX_FIELDS)
    except ValueError:
        raise BadParameter(name="form", value="", allowed=f"≤ {MAX_FIELDS}") from None
    form: dict[str, list[str]] = {}
    for name, value in pairs:
        form.setdefault(name, []).append(value)
    return form


UsedForm = Annotated[Form, Depends(read_form)]


async def read_body(request: Request) -> bytes:
    """Read a body of at most 4 MiB. Raises BadParameter."""
    return await _read_limited(request, MAX_BYTES)


async def read_diary_body(request: Request) -> bytes:
    """Read a diary. Raises BadParameter if it is too large."""
    return await _read_limited(request, MAX_DIARY_BYTES)


async def _read_limited(request: Request, most_bytes: int) -> bytes:
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > most_bytes:
            raise BadParameter(name="form", value="", allowed=f"≤ {most_bytes}")
    return bytes(body)


def first(form: Form, name: str) -> str:
    """Return the first value of a name; "" if there is none."""
    return form.get(name, [""])[0].strip()


def get_secret(form: Form, name: str) -> str:
    """Return the first value of a name as typed, including spaces."""
    return form.get(name, [""])[0]
