"""Sign-in and sign-out: by password and second factor, by a provider, or by the secret of the start."""

from typing import Any
from urllib.parse import urlencode, urlsplit

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from acromion.app.accounts.accounts import LONGEST_S
from acromion.app.accounts.gate import ADMISSION_TERM_S
from acromion.app.accounts.sign_in import BROWSER_TERM_S, EXTRA, SignedIn
from acromion.app.accounts.subjects import Permission, Subject
from acromion.app.errors import (
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
from acromion.app.http.middleware.access import UsedSubject, get_gate
from acromion.app.http.middleware.guard import (
    BROWSER_COOKIE,
    SESSION_COOKIE,
    STATE_COOKIE,
    drop_cookie,
    get_caller,
    get_client_address,
    get_host_url,
    get_settings,
    name_cookie,
    set_cookie,
)
from acromion.app.http.middleware.problems import drop_secrets
from acromion.app.http.pages.rendering import Form, Page, UsedForm, UsedPage, first, get_base, get_secret
from acromion.app.report.words.messages import describe_problem
from acromion.app.services import SUBJECT
from acromion.app.store.folder import load_extra

router = APIRouter(include_in_schema=False)

PLACES: tuple[tuple[Permission, str], ...] = (
    ("people", "/people"),
    ("trail", "/trail"),
    ("aggregate", "/aggregate"),
    ("own", "/account"),
)
"""The start page of a person without the permission to read recordings: the first permitted one."""


# Sign-in by password and second factor.


@router.get("/login")
def show_login(page: UsedPage, next: str = "/", saved: str = "") -> Response:  # noqa: A002
    """Show the sign-in form; ``saved``: the person has just set a password by link."""
    return _render_login(page, next, is_saved=bool(saved))


@router.get("/login/code")
@router.get("/login/enrol")
def restart_sign_in(page: UsedPage) -> Response:
    """Restart the sign-in if the language is changed during its second step."""
    query = page.request.url.query
    return page.go(f"/login?{query}" if query else "/login")


@router.post("/login")
def sign_in(page: UsedPage, form: UsedForm) -> Response:
    """Sign in with the secret of the start, or check a password and continue with the second factor."""
    gate, wanted = get_gate(page.request), first(form, "next")
    if not gate.needs_accounts:
        if gate.secret is not None and gate.secret.matches(first(form, "secret"), ""):
            return _redirect_with_session(page, gate.secret.admit_browser(), wanted, ADMISSION_TERM_S)
        return _render_login(page, wanted, NotSignedIn())
    caller = get_caller(page.request)
    try:
        step = page.sign_in.submit_password(first(form, "login"), get_secret(form, "password"), caller)
    except (LoginRefused, TooManyTries) as refusal:
        return _render_login(page, wanted, refusal)
    if step.next == "in":
        return _start_session(page, page.sign_in.enter(step.person_id, caller), wanted)
    if step.next == "enrol":
        return render_enrolment(page, step.ticket, wanted)
    return _render_code(page, form, step.ticket)


@router.post("/login/code")
def enter_code(page: UsedPage, form: UsedForm) -> Response:
    """Sign in with the authenticator's code or a recovery code."""
    ticket = first(form, "ticket")
    try:
        entered = page.sign_in.submit_code(ticket, first(form, "code"), get_caller(page.request))
    except (LoginRefused, SecondFactorLost, TooManyTries) as refusal:
        return _render_code(page, form, ticket, refusal)
    except TicketSpent as refusal:
        return _render_login(page, first(form, "next"), refusal)
    return _start_session(page, entered, first(form, "next"))


@router.post("/login/enrol")
def enrol(page: UsedPage, form: UsedForm) -> Response:
    """Activate the authenticator with its first code, and show the recovery codes once."""
    ticket, wanted = first(form, "ticket"), first(form, "next")
    try:
        person_id, codes = page.sign_in.enrol(ticket, first(form, "code"))
    except LoginRefused as refusal:
        return render_enrolment(page, ticket, wanted, refusal)
    except TicketSpent as refusal:
        return _render_login(page, wanted, refusal)
    if page.subject is not None and page.subject.id == person_id:
        return page.render("access/codes.html", codes=codes, next=sanitize_next(wanted))
    entered = page.sign_in.enter(person_id, get_caller(page.request))
    response = page.render("access/codes.html", codes=codes, next=_get_next_page(entered, wanted))
    _set_cookies(page, response, entered)
    return response


# Sign-in by a one-time link.


@router.get("/login/once/{ticket}")
def open_once(ticket: str, page: UsedPage) -> Response:
    """Sign in by the one-time address that the server printed."""
    gate = get_gate(page.request)
    if gate.secret is None or gate.needs_accounts or not gate.secret.take_address(ticket):
        raise NotSignedIn
    return _redirect_with_session(page, gate.secret.admit_browser(), "/", ADMISSION_TERM_S)


@router.get("/login/link/{ticket}")
def open_link(ticket: str, page: UsedPage) -> Response:
    """Ask for a new password; only setting the password uses up the link."""
    page.sign_in.tickets.peek("password", ticket)
    return render_with_problem(page, "access/new_password.html", None, ticket=ticket)


@router.post("/login/link/{ticket}")
def set_password(ticket: str, page: UsedPage, form: UsedForm) -> Response:
    """Set a password by link; the person then signs in with it and the second factor."""
    try:
        address = get_client_address(page.request)
        page.sign_in.set_password_by_link(ticket, get_secret(form, "password"), address)
    except WeakPassword as refusal:
        return render_with_problem(page, "access/new_password.html", refusal, ticket=ticket)
    return page.go("/login?saved=1")


# Sign-in by a provider.


@router.get("/login/provider")
def go_to_provider(page: UsedPage, next: str = "/") -> Response:  # noqa: A002
    """Redirect the browser to the identity provider."""
    return _send_to_provider(page, sanitize_next(next))


@router.get("/confirm/provider")
def confirm_by_provider(page: UsedPage, subject: UsedSubject, next: str = "/") -> Response:  # noqa: A002
    """Redirect the browser to the provider to enter the password again."""
    return _send_to_provider(page, sanitize_next(next), subject.session)


@router.get("/login/provider/back")
def finish_provider_sign_in(page: UsedPage) -> Response:
    """Sign in the person that the provider returned, or confirm the session if it is the same person's."""
    request = page.request
    state = request.cookies.get(name_cookie(request, STATE_COOKIE), "")
    try:
        back = _open_provider(page).finish(dict(request.query_params), state, _get_callback_url(page))
    except (ProviderRefused, NotPermitted) as refusal:
        return _render_login(page, "/", refusal)
    if back.confirms:
        subject = page.subject
        if subject is None or subject.id != back.person.id or subject.session != back.confirms:
            raise NotSignedIn
        response = _redirect_with_session(
            page, page.sign_in.accounts.confirm_session(back.confirms), back.wanted
        )
    else:
        response = _start_session(page, page.sign_in.enter(back.person.id, get_caller(request)), back.wanted)
    drop_cookie(request, response, STATE_COOKIE)
    return response


# Confirmation of the password, and sign-out.


@router.get("/confirm")
def ask_again(page: UsedPage, subject: UsedSubject, next: str = "/") -> Response:  # noqa: A002
    """Ask for the password again before an action that cannot be undone."""
    return _render_confirmation(page, subject, next)


@router.post("/confirm")
def confirm(page: UsedPage, form: UsedForm, subject: UsedSubject) -> Response:
    """Check the password or code again, and redirect."""
    wanted = first(form, "next")
    try:
        cookie = page.sign_in.confirm(subject, get_secret(form, "proof"), get_caller(page.request))
    except (LoginRefused, SecondFactorLost, TooManyTries) as refusal:
        return _render_confirmation(page, subject, wanted, refusal)
    return _redirect_with_session(page, cookie, wanted)


@router.post("/logout")
def sign_out(page: UsedPage) -> Response:
    """End the session, and delete its data in the browser."""
    request = page.request
    gate, cookie = get_gate(request), request.cookies.get(name_cookie(request, SESSION_COOKIE), "")
    if gate.needs_accounts:
        page.sign_in.accounts.end_session(cookie)
    elif gate.secret is not None:
        gate.secret.sign_out(cookie)
    response = page.go("/login")
    drop_cookie(request, response, SESSION_COOKIE)
    response.headers["Clear-Site-Data"] = '"cache", "storage"'
    return response


def respond_with_sign_in(request: Request) -> Response:
    """Redirect a browser without a session to the sign-in page, and back afterwards."""
    return _redirect(request, "/login", _get_wanted_path(request))


def respond_with_confirmation(request: Request) -> Response:
    """Ask for the password again, then redirect back; after a form, to the page with the form."""
    wanted = _get_wanted_path(request)
    if request.method not in ("GET", "HEAD"):
        page = urlsplit(request.headers.get("referer", ""))
        wanted = page.path.removeprefix(get_base(request)) + (f"?{page.query}" if page.query else "")
    return _redirect(request, "/confirm", wanted or "/")


def respond_with_permitted_page(request: Request) -> Response:
    """Redirect a person without the permission to read recordings to a permitted page."""
    subject: Subject = request.scope[SUBJECT]
    place = next(place for permission, place in PLACES if subject.may(permission))
    return RedirectResponse(get_base(request) + place, status_code=303)


def _get_wanted_path(request: Request) -> str:
    kept = drop_secrets(request.url.query)
    return request.url.path.removeprefix(get_base(request)) + (f"?{kept}" if kept else "")


def _redirect(request: Request, place: str, wanted: str) -> Response:
    link = f"{get_base(request)}{place}?{urlencode({'next': sanitize_next(wanted)})}"
    return RedirectResponse(link, status_code=303)


def render_enrolment(page: Page, ticket: str, wanted: str, refusal: AppError | None = None) -> Response:
    """Show the secret of an authenticator, and ask for its first code."""
    secret, drawing = page.sign_in.show_enrolment(ticket)
    values = {"ticket": ticket, "secret": secret, "drawing": drawing, "next": sanitize_next(wanted)}
    return render_with_problem(page, "access/enrol.html", refusal, **values)


def render_with_problem(page: Page, template: str, refusal: AppError | None, **values: Any) -> Response:
    """Render an account page, with the problem above its form if there is one."""
    if refusal is None:
        return page.render(template, problem=None, **values)
    problem = describe_problem(refusal.code, refusal.facts, page.language)
    shown = {"problem": problem, "problem_code": refusal.code}
    status = find_outcome_of_code(refusal.code).status
    response = page.render(template, status=status, **shown, **values)
    if isinstance(refusal, TooManyTries):
        response.headers["Retry-After"] = str(refusal.facts["wait_s"])
    return response


def sanitize_next(wanted: str) -> str:
    """Return the path to redirect to; "/" if it is not on this server."""
    is_ours = wanted.startswith("/") and not wanted.startswith(("//", "/\\"))
    return wanted if is_ours and wanted.isprintable() else "/"


def _render_login(
    page: Page, wanted: str, refusal: AppError | None = None, *, is_saved: bool = False
) -> Response:
    has_accounts = get_gate(page.request).needs_accounts
    provider = urlsplit(get_settings(page.request).oidc_issuer).netloc
    values = {"next": sanitize_next(wanted), "has_accounts": has_accounts, "provider": provider}
    return render_with_problem(page, "access/login.html", refusal, is_saved=is_saved, **values)


def _render_code(page: Page, form: Form, ticket: str, refusal: AppError | None = None) -> Response:
    wanted = sanitize_next(first(form, "next"))
    return render_with_problem(page, "access/code.html", refusal, ticket=ticket, next=wanted)


def _render_confirmation(
    page: Page, subject: Subject, wanted: str, refusal: AppError | None = None
) -> Response:
    if subject.kind != "person":
        raise NotPermitted(permission="own")
    by_provider = page.sign_in.accounts.get_person(subject.id).issuer is not None
    values = {"next": sanitize_next(wanted), "by_provider": by_provider}
    return render_with_problem(page, "access/confirm.html", refusal, **values)


def _start_session(page: Page, entered: SignedIn, wanted: str) -> Response:
    """Start a session in the browser; an earlier session of this browser ends."""
    response = page.go(_get_next_page(entered, wanted))
    _set_cookies(page, response, entered)
    return response


def _get_next_page(entered: SignedIn, wanted: str) -> str:
    """Return the page after sign-in: first the account page if it has a notice."""
    on = sanitize_next(wanted)
    return f"/account?{urlencode({'next': on})}" if entered.must_show_link_use else on


def _set_cookies(page: Page, response: Response, entered: SignedIn) -> None:
    before = page.request.cookies.get(name_cookie(page.request, SESSION_COOKIE), "")
    if before:
        page.sign_in.accounts.end_session(before)
    set_cookie(page.request, response, SESSION_COOKIE, entered.session, int(LONGEST_S))
    set_cookie(page.request, response, BROWSER_COOKIE, entered.browser, BROWSER_TERM_S)


def _redirect_with_session(page: Page, cookie: str, wanted: str, term_s: int = int(LONGEST_S)) -> Response:
    response = page.go(sanitize_next(wanted))
    set_cookie(page.request, response, SESSION_COOKIE, cookie, term_s)
    return response


def _send_to_provider(page: Page, wanted: str, confirms: str = "") -> Response:
    address, state = _open_provider(page).begin(_get_callback_url(page), wanted, confirms)
    response = RedirectResponse(address, status_code=303)
    set_cookie(page.request, response, STATE_COOKIE, state, 600)
    return response


def _open_provider(page: Page) -> Any:
    settings = get_settings(page.request)
    if not settings.oidc_issuer or not get_gate(page.request).needs_accounts:
        raise ProviderRefused(said="none")
    return load_extra("acromion.app.accounts.provider", EXTRA).Provider(page.sign_in.accounts, settings)


def _get_callback_url(page: Page) -> str:
    return f"{get_host_url(page.request)}{page.base}/login/provider/back"
