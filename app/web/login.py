"""The way in for a browser: an address that works once, or the secret typed."""

from typing import Any, cast
from urllib.parse import urlencode

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from app.access.gate import Gate
from app.api.access import SESSION_COOKIE
from app.errors import NotSignedIn
from app.report.words.wording import Language, load_wording
from app.services import UsedLanguage
from app.web.forms import first, read_form
from app.web.rendering import YEAR_S, find_base, render_page

router = APIRouter(include_in_schema=False)


@router.get("/login")
def ask_login(request: Request, language: UsedLanguage, next: str = "/") -> Response:  # noqa: A002
    """Ask who comes."""
    return render_page(request, "login.html", language, _build_values(language, next, is_wrong=False))


@router.get("/login/once/{ticket}")
def open_once(ticket: str, request: Request) -> Response:
    """Let the browser in that opens the address which the server showed; it works once."""
    secret = find_gate(request).secret
    if secret is None or find_gate(request).needs_accounts or not secret.take_address(ticket):
        raise NotSignedIn
    return _let_in(request, secret.cookie, "/", YEAR_S)


@router.post("/login")
async def log_in(request: Request, language: UsedLanguage) -> Response:
    """Let in whoever has the secret."""
    form = await read_form(request)
    secret = find_gate(request).secret
    if secret is not None and secret.matches(first(form, "secret"), ""):
        return _let_in(request, secret.cookie, first(form, "next"), YEAR_S)
    values = _build_values(language, first(form, "next"), is_wrong=True)
    return render_page(request, "login.html", language, values, NotSignedIn.outcome.status)


@router.post("/logout")
def log_out(request: Request) -> Response:
    """Let the browser out."""
    response = RedirectResponse(f"{find_base(request)}/login", status_code=303)
    response.delete_cookie(SESSION_COOKIE, path=find_base(request) or "/", httponly=True, samesite="lax")
    response.headers["Clear-Site-Data"] = '"cache", "storage"'
    return response


def find_gate(request: Request) -> Gate:
    """Give the gate of the application that answers."""
    return cast("Gate", request.app.state.gate)


def respond_with_login(request: Request) -> Response:
    """Send a browser that nobody is known behind to the way in, and afterwards to where it wanted."""
    wanted = request.url.path.removeprefix(find_base(request))
    query = f"?{request.url.query}" if request.url.query else ""
    link = f"{find_base(request)}/login?{urlencode({'next': wanted + query})}"
    return RedirectResponse(link, status_code=303)


def _let_in(request: Request, cookie: str, wanted: str, age_s: int) -> Response:
    response = RedirectResponse(find_base(request) + _check_next(wanted), status_code=303)
    response.set_cookie(
        SESSION_COOKIE,
        cookie,
        max_age=age_s,
        httponly=True,
        secure=request.url.scheme == "https",
        samesite="lax",
        path=find_base(request) or "/",
    )
    return response


def _build_values(language: Language, wanted: str, *, is_wrong: bool) -> dict[str, Any]:
    return {"l": load_wording(language, "access"), "next": _check_next(wanted), "is_wrong": is_wrong}


def _check_next(wanted: str) -> str:
    """Give a place of ours to go on to; the first page for any other."""
    is_ours = wanted.startswith("/") and not wanted.startswith(("//", "/\\"))
    return wanted if is_ours and wanted.isprintable() else "/"
