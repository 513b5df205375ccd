"""The way in for a browser, and out: password and second factor, a provider, or the secret of the start."""

from collections.abc import Mapping
from typing import Any
from urllib.parse import urlencode, urlsplit

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from app.access.accounts import LONGEST_S
from app.access.gate import StartSecret
from app.access.logins import BROWSER_TERM_S, EXTRA, Entered
from app.access.subjects import Permission, Subject
from app.api.middleware.access import UsedSubject, find_gate
from app.api.middleware.callers import (
    BROWSER_COOKIE,
    SESSION_COOKIE,
    STATE_COOKIE,
    drop_cookie,
    find_address,
    find_caller,
    find_logins,
    find_origin,
    find_settings,
    name_cookie,
    set_cookie,
)
from app.api.middleware.echoes import drop_secrets
from app.errors import (
    AppError,
    LoginRefused,
    NotPermitted,
    NotSignedIn,
    ProviderRefused,
    SecondFactorLost,
    TicketSpent,
    TooManyTries,
    WeakPassword,
    find_outcome_of_code,
)
from app.report.words.messages import Problem, describe_problem
from app.report.words.wording import Language, load_wording
from app.services import SUBJECT, UsedLanguage
from app.storage.open import load_extra
from app.web.forms import Form, UsedForm, first, take_secret
from app.web.rendering import YEAR_S, find_base, render_page

router = APIRouter(include_in_schema=False)

PLACES: tuple[tuple[Permission, str], ...] = (
    ("people", "/people"),
    ("trail", "/trail"),
    ("aggregate", "/aggregate"),
    ("own", "/account"),
)
"""Where somebody is led who may not read recordings: the first that he may use."""


# In, by a password and a second factor.


@router.get("/login")
def ask_login(request: Request, language: UsedLanguage, next: str = "/") -> Response:  # noqa: A002
    """Ask who comes."""
    return _render_login(request, language, next)


@router.get("/login/code")
@router.get("/login/enrol")
def begin_again(request: Request) -> Response:
    """Begin the login again where somebody turns the language of its second step."""
    query = f"?{request.url.query}" if request.url.query else ""
    return RedirectResponse(f"{find_base(request)}/login{query}", status_code=303)


@router.post("/login")
def log_in(request: Request, form: UsedForm, language: UsedLanguage) -> Response:
    """Let in whoever has the secret; of people, ask for the second factor."""
    gate, wanted = find_gate(request), first(form, "next")
    if not gate.needs_accounts:
        if gate.secret is not None and gate.secret.matches(first(form, "secret"), ""):
            return _let_in_by_secret(request, gate.secret, wanted)
        return _render_login(request, language, wanted, NotSignedIn())
    logins = find_logins(request)
    try:
        step = logins.give_password(first(form, "login"), take_secret(form, "password"), find_caller(request))
    except (LoginRefused, TooManyTries) as refusal:
        return _render_login(request, language, wanted, refusal)
    if step.next == "in":
        return _let_in(request, logins.enter(step.person_id, find_caller(request)), wanted)
    if step.next == "enrol":
        return render_enrolment(request, language, step.ticket, wanted)
    return _render_code(request, language, form, step.ticket)


@router.post("/login/code")
def give_code(request: Request, form: UsedForm, language: UsedLanguage) -> Response:
    """Let in whoever gives the code of the authenticator, or a recovery code, too."""
    ticket = first(form, "ticket")
    try:
        entered = find_logins(request).give_code(ticket, first(form, "code"), find_caller(request))
    except (LoginRefused, SecondFactorLost, TooManyTries) as refusal:
        return _render_code(request, language, form, ticket, refusal)
    except TicketSpent as refusal:
        return _render_login(request, language, first(form, "next"), refusal)
    return _let_in(request, entered, first(form, "next"))


@router.post("/login/enrol")
def enrol(request: Request, form: UsedForm, language: UsedLanguage) -> Response:
    """Turn the authenticator on by its first code, and show the recovery codes once."""
    ticket, wanted = first(form, "ticket"), first(form, "next")
    logins = find_logins(request)
    try:
        person_id, codes = logins.enrol(ticket, first(form, "code"))
    except LoginRefused as refusal:
        return render_enrolment(request, language, ticket, wanted, refusal)
    except TicketSpent as refusal:
        return _render_login(request, language, wanted, refusal)
    subject: Subject | None = request.scope.get(SUBJECT)
    is_login = subject is None or subject.id != person_id
    entered = logins.enter(person_id, find_caller(request)) if is_login else None
    way_on = _find_way_on(entered, wanted) if entered else check_next(wanted)
    values = {"l": load_wording(language, "access"), "codes": codes, "next": way_on}
    response = render_page(request, "access/codes.html", language, values)
    if entered is not None:
        _set_cookies(request, response, entered)
    return response


# In, by an address that works once.


@router.get("/login/once/{ticket}")
def open_once(ticket: str, request: Request) -> Response:
    """Let the browser in that opens the address which the server showed; it works once."""
    gate = find_gate(request)
    if gate.secret is None or gate.needs_accounts or not gate.secret.take_address(ticket):
        raise NotSignedIn
    return _let_in_by_secret(request, gate.secret, "/")


@router.get("/login/link/{ticket}")
def open_link(ticket: str, request: Request, language: UsedLanguage) -> Response:
    """Ask for a password; the link is used up by setting one, not by looking."""
    find_logins(request).tickets.look("password", ticket)
    return _render_new_password(request, language, ticket)


@router.post("/login/link/{ticket}")
def set_password(ticket: str, request: Request, form: UsedForm, language: UsedLanguage) -> Response:
    """Set a password; its person logs in by it then, with the second factor."""
    try:
        address = find_address(request)
        find_logins(request).set_password_by_link(ticket, take_secret(form, "password"), address)
    except WeakPassword as refusal:
        return _render_new_password(request, language, ticket, refusal)
    return RedirectResponse(f"{find_base(request)}/login", status_code=303)


# In, by a provider.


@router.get("/login/provider")
def go_to_provider(request: Request, next: str = "/") -> Response:  # noqa: A002
    """Send the browser to the identity provider."""
    return _send_to_provider(request, check_next(next))


@router.get("/confirm/provider")
def confirm_by_provider(request: Request, subject: UsedSubject, next: str = "/") -> Response:  # noqa: A002
    """Send the browser to the provider, which is to ask for the password again."""
    return _send_to_provider(request, check_next(next), subject.session)


@router.get("/login/provider/back")
def come_back(request: Request, language: UsedLanguage) -> Response:
    """Let in whom the provider sent back."""
    state = request.cookies.get(name_cookie(request, STATE_COOKIE), "")
    try:
        back = _open_provider(request).finish(dict(request.query_params), state, _find_back(request))
    except (ProviderRefused, NotPermitted) as refusal:
        return _render_login(request, language, "/", refusal)
    logins = find_logins(request)
    if back.confirms:
        return _confirm(request, back.person.id, back.confirms, back.wanted)
    response = _let_in(request, logins.enter(back.person.id, find_caller(request)), back.wanted)
    drop_cookie(request, response, STATE_COOKIE)
    return response


# Who one is, once more; and out.


@router.get("/confirm")
def ask_again(request: Request, subject: UsedSubject, language: UsedLanguage, next: str = "/") -> Response:  # noqa: A002
    """Ask for the password again before what cannot be undone."""
    return _render_confirmation(request, language, subject, next)


@router.post("/confirm")
def confirm(request: Request, form: UsedForm, subject: UsedSubject, language: UsedLanguage) -> Response:
    """Take the password or a code again, and lead on."""
    wanted = first(form, "next")
    try:
        cookie = find_logins(request).confirm(subject, take_secret(form, "proof"), find_caller(request))
    except (LoginRefused, SecondFactorLost, TooManyTries) as refusal:
        return _render_confirmation(request, language, subject, wanted, refusal)
    return _lead_with(request, cookie, wanted)


@router.post("/logout")
def log_out(request: Request) -> Response:
    """End the session, and have the browser forget what it keeps of us."""
    cookie = request.cookies.get(name_cookie(request, SESSION_COOKIE), "")
    if find_gate(request).needs_accounts:
        find_logins(request).accounts.end_session(cookie)
    response = RedirectResponse(f"{find_base(request)}/login", status_code=303)
    drop_cookie(request, response, SESSION_COOKIE)
    response.headers["Clear-Site-Data"] = '"cache", "storage"'
    return response


def respond_with_login(request: Request) -> Response:
    """Send a browser that nobody is known behind to the way in, and afterwards to where it wanted."""
    return _lead(request, "/login", _find_wanted(request))


def respond_with_confirmation(request: Request) -> Response:
    """Ask for the password again, and lead back afterwards: of a form, to the page that it stood on."""
    wanted = _find_wanted(request)
    if request.method not in ("GET", "HEAD"):
        page = urlsplit(request.headers.get("referer", ""))
        wanted = page.path.removeprefix(find_base(request)) + (f"?{page.query}" if page.query else "")
    return _lead(request, "/confirm", wanted or "/")


def respond_with_place(request: Request) -> Response:
    """Send somebody who may not read recordings to what he may use."""
    subject: Subject = request.scope[SUBJECT]
    place = next(place for permission, place in PLACES if subject.may(permission))
    return RedirectResponse(find_base(request) + place, status_code=303)


def render_enrolment(
    request: Request, language: Language, ticket: str, wanted: str, refusal: AppError | None = None
) -> Response:
    """Show the secret of an authenticator, and ask for its first code."""
    secret, drawing = find_logins(request).show_enrolment(ticket)
    values = {"ticket": ticket, "secret": secret, "drawing": drawing, "next": check_next(wanted)}
    return render_with_problem(request, "access/enrol.html", language, values, refusal)


def render_with_problem(
    request: Request, template: str, language: Language, values: Mapping[str, Any], refusal: AppError | None
) -> Response:
    """Render a page of the accounts, with what was refused above its form."""
    problem: Problem | None = None
    status = 200
    if refusal is not None:
        problem = describe_problem(refusal.code, refusal.facts, language)
        status = find_outcome_of_code(refusal.code).status
    code = refusal.code if refusal is not None else ""
    known = {"l": load_wording(language, "access"), "problem": problem, "problem_code": code}
    response = render_page(request, template, language, known | dict(values), status)
    if isinstance(refusal, TooManyTries):
        response.headers["Retry-After"] = str(refusal.facts["wait_s"])
    return response


def check_next(wanted: str) -> str:
    """Give a place of ours to go on to; the first page for any other."""
    is_ours = wanted.startswith("/") and not wanted.startswith(("//", "/\\"))
    return wanted if is_ours and wanted.isprintable() else "/"


def _render_login(
    request: Request, language: Language, wanted: str, refusal: AppError | None = None
) -> Response:
    values = {
        "next": check_next(wanted),
        "has_accounts": find_gate(request).needs_accounts,
        "provider": urlsplit(find_settings(request).oidc_issuer).netloc,
    }
    return render_with_problem(request, "access/login.html", language, values, refusal)


def _render_code(
    request: Request, language: Language, form: Form, ticket: str, refusal: AppError | None = None
) -> Response:
    values = {"ticket": ticket, "next": check_next(first(form, "next"))}
    return render_with_problem(request, "access/code.html", language, values, refusal)


def _render_new_password(
    request: Request, language: Language, ticket: str, refusal: AppError | None = None
) -> Response:
    return render_with_problem(request, "access/new_password.html", language, {"ticket": ticket}, refusal)


def _render_confirmation(
    request: Request, language: Language, subject: Subject, wanted: str, refusal: AppError | None = None
) -> Response:
    if subject.kind != "person":
        raise NotPermitted(permission="own")
    person = find_logins(request).accounts.get_person(subject.id)
    values = {"next": check_next(wanted), "by_provider": person.issuer is not None}
    return render_with_problem(request, "access/confirm.html", language, values, refusal)


def _let_in(request: Request, entered: Entered, wanted: str) -> Response:
    """Give a browser its new session; one that it had before ends."""
    response = RedirectResponse(find_base(request) + _find_way_on(entered, wanted), status_code=303)
    _set_cookies(request, response, entered)
    return response


def _find_way_on(entered: Entered, wanted: str) -> str:
    """Give where a login leads: first to the account, where there is something that its person is to know."""
    on = check_next(wanted)
    return f"/account?{urlencode({'next': on})}" if entered.is_to_be_told else on


def _set_cookies(request: Request, response: Response, entered: Entered) -> None:
    before = request.cookies.get(name_cookie(request, SESSION_COOKIE), "")
    if before:
        find_logins(request).accounts.end_session(before)
    set_cookie(request, response, SESSION_COOKIE, entered.session, int(LONGEST_S))
    set_cookie(request, response, BROWSER_COOKIE, entered.browser, BROWSER_TERM_S)


def _let_in_by_secret(request: Request, secret: StartSecret, wanted: str) -> Response:
    response = RedirectResponse(find_base(request) + check_next(wanted), status_code=303)
    set_cookie(request, response, SESSION_COOKIE, secret.cookie, YEAR_S)
    return response


def _send_to_provider(request: Request, wanted: str, confirms: str = "") -> Response:
    address, state = _open_provider(request).begin(_find_back(request), wanted, confirms)
    response = RedirectResponse(address, status_code=303)
    set_cookie(request, response, STATE_COOKIE, state, 600)
    return response


def _confirm(request: Request, person_id: str, session: str, wanted: str) -> Response:
    """Confirm the session that asked, if the same person came back to it."""
    subject: Subject | None = request.scope.get(SUBJECT)
    if subject is None or subject.id != person_id or subject.session != session:
        raise NotSignedIn
    response = _lead_with(request, find_logins(request).accounts.confirm_session(session), wanted)
    drop_cookie(request, response, STATE_COOKIE)
    return response


def _lead_with(request: Request, cookie: str, wanted: str) -> Response:
    response = RedirectResponse(find_base(request) + check_next(wanted), status_code=303)
    set_cookie(request, response, SESSION_COOKIE, cookie, int(LONGEST_S))
    return response


def _open_provider(request: Request) -> Any:
    settings = find_settings(request)
    if not settings.oidc_issuer or not find_gate(request).needs_accounts:
        raise ProviderRefused(said="none")
    return load_extra("app.access.provider", EXTRA).Provider(find_logins(request).accounts, settings)


def _find_back(request: Request) -> str:
    return f"{find_origin(request)}{find_base(request)}/login/provider/back"


def _find_wanted(request: Request) -> str:
    kept = drop_secrets(request.url.query)
    query = f"?{kept}" if kept else ""
    return request.url.path.removeprefix(find_base(request)) + query


def _lead(request: Request, place: str, wanted: str) -> Response:
    link = f"{find_base(request)}{place}?{urlencode({'next': check_next(wanted)})}"
    return RedirectResponse(link, status_code=303)
