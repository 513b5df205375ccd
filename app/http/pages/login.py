"""The way in for a browser, and out: password and second factor, a provider, or the secret of the start."""

from typing import Any
from urllib.parse import urlencode, urlsplit

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from app.accounts.accounts import LONGEST_S
from app.accounts.gate import ADMISSION_TERM_S
from app.accounts.logins import BROWSER_TERM_S, EXTRA, Entered
from app.accounts.subjects import Permission, Subject
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
from app.http.middleware.access import UsedSubject, find_gate
from app.http.middleware.guard import (
    BROWSER_COOKIE,
    SESSION_COOKIE,
    STATE_COOKIE,
    drop_cookie,
    find_address,
    find_caller,
    find_origin,
    find_settings,
    name_cookie,
    set_cookie,
)
from app.http.middleware.problems import drop_secrets
from app.http.pages.rendering import Form, Page, UsedForm, UsedPage, find_base, first, take_secret
from app.report.words.messages import describe_problem
from app.services import SUBJECT
from app.store.folder import load_extra

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
def ask_login(page: UsedPage, next: str = "/") -> Response:  # noqa: A002
    """Ask who comes."""
    return _render_login(page, next)


@router.get("/login/code")
@router.get("/login/enrol")
def begin_again(page: UsedPage) -> Response:
    """Begin the login again where somebody turns the language of its second step."""
    query = page.request.url.query
    return page.go(f"/login?{query}" if query else "/login")


@router.post("/login")
def log_in(page: UsedPage, form: UsedForm) -> Response:
    """Let in whoever has the secret; of people, ask for the second factor."""
    gate, wanted = find_gate(page.request), first(form, "next")
    if not gate.needs_accounts:
        if gate.secret is not None and gate.secret.matches(first(form, "secret"), ""):
            return _lead_with(page, gate.secret.admit_browser(), wanted, ADMISSION_TERM_S)
        return _render_login(page, wanted, NotSignedIn())
    caller = find_caller(page.request)
    try:
        step = page.logins.give_password(first(form, "login"), take_secret(form, "password"), caller)
    except (LoginRefused, TooManyTries) as refusal:
        return _render_login(page, wanted, refusal)
    if step.next == "in":
        return _let_in(page, page.logins.enter(step.person_id, caller), wanted)
    if step.next == "enrol":
        return render_enrolment(page, step.ticket, wanted)
    return _render_code(page, form, step.ticket)


@router.post("/login/code")
def give_code(page: UsedPage, form: UsedForm) -> Response:
    """Let in whoever gives the code of the authenticator, or a recovery code, too."""
    ticket = first(form, "ticket")
    try:
        entered = page.logins.give_code(ticket, first(form, "code"), find_caller(page.request))
    except (LoginRefused, SecondFactorLost, TooManyTries) as refusal:
        return _render_code(page, form, ticket, refusal)
    except TicketSpent as refusal:
        return _render_login(page, first(form, "next"), refusal)
    return _let_in(page, entered, first(form, "next"))


@router.post("/login/enrol")
def enrol(page: UsedPage, form: UsedForm) -> Response:
    """Turn the authenticator on by its first code, and show the recovery codes once."""
    ticket, wanted = first(form, "ticket"), first(form, "next")
    try:
        person_id, codes = page.logins.enrol(ticket, first(form, "code"))
    except LoginRefused as refusal:
        return render_enrolment(page, ticket, wanted, refusal)
    except TicketSpent as refusal:
        return _render_login(page, wanted, refusal)
    if page.subject is not None and page.subject.id == person_id:
        return page.render("access/codes.html", codes=codes, next=check_next(wanted))
    entered = page.logins.enter(person_id, find_caller(page.request))
    response = page.render("access/codes.html", codes=codes, next=_find_way_on(entered, wanted))
    _set_cookies(page, response, entered)
    return response


# In, by an address that works once.


@router.get("/login/once/{ticket}")
def open_once(ticket: str, page: UsedPage) -> Response:
    """Let the browser in that opens the address which the server showed; it works once."""
    gate = find_gate(page.request)
    if gate.secret is None or gate.needs_accounts or not gate.secret.take_address(ticket):
        raise NotSignedIn
    return _lead_with(page, gate.secret.admit_browser(), "/", ADMISSION_TERM_S)


@router.get("/login/link/{ticket}")
def open_link(ticket: str, page: UsedPage) -> Response:
    """Ask for a password; the link is used up by setting one, not by looking."""
    page.logins.tickets.look("password", ticket)
    return render_with_problem(page, "access/new_password.html", None, ticket=ticket)


@router.post("/login/link/{ticket}")
def set_password(ticket: str, page: UsedPage, form: UsedForm) -> Response:
    """Set a password; its person logs in by it then, with the second factor."""
    try:
        address = find_address(page.request)
        page.logins.set_password_by_link(ticket, take_secret(form, "password"), address)
    except WeakPassword as refusal:
        return render_with_problem(page, "access/new_password.html", refusal, ticket=ticket)
    return page.go("/login")


# In, by a provider.


@router.get("/login/provider")
def go_to_provider(page: UsedPage, next: str = "/") -> Response:  # noqa: A002
    """Send the browser to the identity provider."""
    return _send_to_provider(page, check_next(next))


@router.get("/confirm/provider")
def confirm_by_provider(page: UsedPage, subject: UsedSubject, next: str = "/") -> Response:  # noqa: A002
    """Send the browser to the provider, which is to ask for the password again."""
    return _send_to_provider(page, check_next(next), subject.session)


@router.get("/login/provider/back")
def come_back(page: UsedPage) -> Response:
    """Let in whom the provider sent back, or confirm the session that asked, if it is the same person's."""
    request = page.request
    state = request.cookies.get(name_cookie(request, STATE_COOKIE), "")
    try:
        back = _open_provider(page).finish(dict(request.query_params), state, _find_back(page))
    except (ProviderRefused, NotPermitted) as refusal:
        return _render_login(page, "/", refusal)
    if back.confirms:
        subject = page.subject
        if subject is None or subject.id != back.person.id or subject.session != back.confirms:
            raise NotSignedIn
        response = _lead_with(page, page.logins.accounts.confirm_session(back.confirms), back.wanted)
    else:
        response = _let_in(page, page.logins.enter(back.person.id, find_caller(request)), back.wanted)
    drop_cookie(request, response, STATE_COOKIE)
    return response


# Who one is, once more; and out.


@router.get("/confirm")
def ask_again(page: UsedPage, subject: UsedSubject, next: str = "/") -> Response:  # noqa: A002
    """Ask for the password again before what cannot be undone."""
    return _render_confirmation(page, subject, next)


@router.post("/confirm")
def confirm(page: UsedPage, form: UsedForm, subject: UsedSubject) -> Response:
    """Take the password or a code again, and lead on."""
    wanted = first(form, "next")
    try:
        cookie = page.logins.confirm(subject, take_secret(form, "proof"), find_caller(page.request))
    except (LoginRefused, SecondFactorLost, TooManyTries) as refusal:
        return _render_confirmation(page, subject, wanted, refusal)
    return _lead_with(page, cookie, wanted)


@router.post("/logout")
def log_out(page: UsedPage) -> Response:
    """End the session, and have the browser forget what it keeps of us."""
    request = page.request
    gate, cookie = find_gate(request), request.cookies.get(name_cookie(request, SESSION_COOKIE), "")
    if gate.needs_accounts:
        page.logins.accounts.end_session(cookie)
    elif gate.secret is not None:
        gate.secret.sign_out(cookie)
    response = page.go("/login")
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


def _find_wanted(request: Request) -> str:
    kept = drop_secrets(request.url.query)
    return request.url.path.removeprefix(find_base(request)) + (f"?{kept}" if kept else "")


def _lead(request: Request, place: str, wanted: str) -> Response:
    link = f"{find_base(request)}{place}?{urlencode({'next': check_next(wanted)})}"
    return RedirectResponse(link, status_code=303)


def render_enrolment(page: Page, ticket: str, wanted: str, refusal: AppError | None = None) -> Response:
    """Show the secret of an authenticator, and ask for its first code."""
    secret, drawing = page.logins.show_enrolment(ticket)
    values = {"ticket": ticket, "secret": secret, "drawing": drawing, "next": check_next(wanted)}
    return render_with_problem(page, "access/enrol.html", refusal, **values)


def render_with_problem(page: Page, template: str, refusal: AppError | None, **values: Any) -> Response:
    """Render a page of the accounts, with what was refused above its form."""
    if refusal is None:
        return page.render(template, problem=None, **values)
    problem = describe_problem(refusal.code, refusal.facts, page.language)
    told = {"problem": problem, "problem_code": refusal.code}
    status = find_outcome_of_code(refusal.code).status
    response = page.render(template, status=status, **told, **values)
    if isinstance(refusal, TooManyTries):
        response.headers["Retry-After"] = str(refusal.facts["wait_s"])
    return response


def check_next(wanted: str) -> str:
    """Return a place of ours to go on to; the first page for any other."""
    is_ours = wanted.startswith("/") and not wanted.startswith(("//", "/\\"))
    return wanted if is_ours and wanted.isprintable() else "/"


def _render_login(page: Page, wanted: str, refusal: AppError | None = None) -> Response:
    has_accounts = find_gate(page.request).needs_accounts
    provider = urlsplit(find_settings(page.request).oidc_issuer).netloc
    values = {"next": check_next(wanted), "has_accounts": has_accounts, "provider": provider}
    return render_with_problem(page, "access/login.html", refusal, **values)


def _render_code(page: Page, form: Form, ticket: str, refusal: AppError | None = None) -> Response:
    wanted = check_next(first(form, "next"))
    return render_with_problem(page, "access/code.html", refusal, ticket=ticket, next=wanted)


def _render_confirmation(
    page: Page, subject: Subject, wanted: str, refusal: AppError | None = None
) -> Response:
    if subject.kind != "person":
        raise NotPermitted(permission="own")
    by_provider = page.logins.accounts.get_person(subject.id).issuer is not None
    values = {"next": check_next(wanted), "by_provider": by_provider}
    return render_with_problem(page, "access/confirm.html", refusal, **values)


def _let_in(page: Page, entered: Entered, wanted: str) -> Response:
    """Return a browser its new session; one that it had before ends."""
    response = page.go(_find_way_on(entered, wanted))
    _set_cookies(page, response, entered)
    return response


def _find_way_on(entered: Entered, wanted: str) -> str:
    """Return where a login leads: first to the account, if there is something that its person is to know."""
    on = check_next(wanted)
    return f"/account?{urlencode({'next': on})}" if entered.is_to_be_told else on


def _set_cookies(page: Page, response: Response, entered: Entered) -> None:
    before = page.request.cookies.get(name_cookie(page.request, SESSION_COOKIE), "")
    if before:
        page.logins.accounts.end_session(before)
    set_cookie(page.request, response, SESSION_COOKIE, entered.session, int(LONGEST_S))
    set_cookie(page.request, response, BROWSER_COOKIE, entered.browser, BROWSER_TERM_S)


def _lead_with(page: Page, cookie: str, wanted: str, term_s: int = int(LONGEST_S)) -> Response:
    response = page.go(check_next(wanted))
    set_cookie(page.request, response, SESSION_COOKIE, cookie, term_s)
    return response


def _send_to_provider(page: Page, wanted: str, confirms: str = "") -> Response:
    address, state = _open_provider(page).begin(_find_back(page), wanted, confirms)
    response = RedirectResponse(address, status_code=303)
    set_cookie(page.request, response, STATE_COOKIE, state, 600)
    return response


def _open_provider(page: Page) -> Any:
    settings = find_settings(page.request)
    if not settings.oidc_issuer or not find_gate(page.request).needs_accounts:
        raise ProviderRefused(said="none")
    return load_extra("app.accounts.provider", EXTRA).Provider(page.logins.accounts, settings)


def _find_back(page: Page) -> str:
    return f"{find_origin(page.request)}{page.base}/login/provider/back"
