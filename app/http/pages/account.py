"""Account pages: your own account (password, second factor, sessions, tokens), and the list of people.

Managers of people use the list to invite people, set roles and close accounts; it shows no health data.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import cast

from fastapi import APIRouter, Response

from acromion.app.accounts.accounts import DAYS, LONGEST_S, MOST_DAYS, Person, hash_secret, make_token
from acromion.app.accounts.sign_in import FORGOTTEN_S, INVITED_S
from acromion.app.accounts.subjects import ROLES, Permission, Role, Subject, collect_permissions
from acromion.app.errors import (
    AppError,
    BadParameter,
    LoginRefused,
    NotPermitted,
    SecondFactorLost,
    TooManyTries,
    WeakPassword,
)
from acromion.app.http.api.trust import UsedPerson, get_names
from acromion.app.http.middleware.guard import (
    SESSION_COOKIE,
    get_caller,
    get_host_url,
    get_settings,
    set_cookie,
)
from acromion.app.http.pages.login import render_enrolment, render_with_problem, sanitize_next
from acromion.app.http.pages.rendering import Form, Page, UsedForm, UsedPage, first, get_secret
from acromion.app.report.words.numbers import format_iso_moment, format_moment
from acromion.app.report.words.wording import Language, load_wording

router = APIRouter(include_in_schema=False)
TERMS_DAYS = (30, DAYS, 180, MOST_DAYS)


@dataclass(frozen=True, slots=True)
class LinkView:
    """The link that set a password; ``is_told``: the account owner has confirmed the notice."""

    facts: Mapping[str, str]
    is_told: bool


@router.get("/account")
def show_account(page: UsedPage, person: UsedPerson, next: str = "/account") -> Response:  # noqa: A002
    """Show your own account; ``next`` is the page to go to after a notice is confirmed."""
    return _render_account(page, person, wanted=sanitize_next(next))


@router.post("/account/told")
def mark_link_use_shown(page: UsedPage, form: UsedForm, person: UsedPerson) -> Response:
    """Record that the notice about the password link was read, and redirect."""
    page.sign_in.credentials.mark_link_use_shown(person.id)
    return page.go(sanitize_next(first(form, "next")))


@router.post("/account/password")
def change_password(page: UsedPage, form: UsedForm, person: UsedPerson) -> Response:
    """Change the password; every other session ends."""
    proof, password = get_secret(form, "proof"), get_secret(form, "password")
    try:
        cookie = page.sign_in.change_password(person, proof, password, get_caller(page.request))
    except (LoginRefused, SecondFactorLost, TooManyTries, WeakPassword) as refusal:
        return _render_account(page, person, refusal)
    response = _render_account(page, replace(person, session=hash_secret(cookie)), done="password")
    set_cookie(page.request, response, SESSION_COOKIE, cookie, int(LONGEST_S))
    return response


@router.post("/account/second-factor")
def set_up_second_factor(page: UsedPage, person: UsedPerson) -> Response:
    """Start to set up an authenticator; the old one stays valid until a code of the new one is entered."""
    return render_enrolment(page, page.sign_in.begin_enrolment(person.id), "/account")


@router.post("/account/second-factor/drop")
def drop_second_factor(page: UsedPage, person: UsedPerson) -> Response:
    """Turn the second factor off, unless it is required."""
    if get_settings(page.request).second_factor == "required":
        raise NotPermitted(permission="own")
    page.sign_in.drop_second_factor(person.id)
    return page.go("/account")


@router.post("/account/sessions/end")
def end_sessions(page: UsedPage, form: UsedForm, person: UsedPerson) -> Response:
    """End one session, or every session except this one."""
    accounts, session = page.sign_in.accounts, first(form, "session")
    if session:
        accounts.end_session_of(person.id, session)
    else:
        accounts.end_sessions(person.id, person.session)
    return page.go("/account")


@router.post("/account/tokens")
def add_token(page: UsedPage, form: UsedForm, person: UsedPerson) -> Response:
    """Create a token and show it once."""
    chosen = cast("list[Permission]", form.get("permission", []))
    name, days = first(form, "name"), first(form, "days")
    try:
        _, bearer = make_token(
            page.sign_in.accounts, person, name, chosen, int(days) if days.isdecimal() else 0
        )
    except (BadParameter, NotPermitted) as refusal:
        return _render_account(page, person, refusal, done="token")
    return _render_account(page, person, bearer=bearer)


@router.post("/account/tokens/{token_id}/revoke")
def revoke_token(token_id: str, page: UsedPage, person: UsedPerson) -> Response:
    """Revoke a token."""
    page.sign_in.accounts.end_token(person.id, token_id)
    return page.go("/account")


def _render_account(
    page: Page,
    subject: Subject,
    refusal: AppError | None = None,
    *,
    done: str = "",
    bearer: str = "",
    wanted: str = "/account",
) -> Response:
    """Render the account page.

    ``done``: what was changed, or "token" if none could be made; ``bearer``: a token to show once;
    ``wanted``: the page to go to next.
    """
    accounts, credentials = page.sign_in.accounts, page.sign_in.credentials
    person, use = accounts.get_person(subject.id), credentials.find_link_use(subject.id)
    set_by = None
    if use is not None:
        name = get_names(page.request, [use.made_by], page.language)[use.made_by]
        facts = {
            "name": name,
            "when": f"{format_iso_moment(use.used_at, page.language)} UTC",
            "address": use.address,
        }
        set_by = LinkView(facts, use.is_told)
    return render_with_problem(
        page,
        "access/account.html",
        refusal,
        person=person,
        roles=_list_roles(person.roles, page.language),
        set_by=set_by,
        codes_left=credentials.count_recovery_codes(person.id),
        is_required=get_settings(page.request).second_factor == "required",
        sessions=[
            (
                *(_format_utc(moment_s, page.language) for moment_s in (held.began_s, held.used_s)),
                *(held.id, held.id == subject.session),
            )
            for held in accounts.find_sessions(person.id)
        ],
        tokens=[
            (
                token,
                _format_utc(token.expires_s, page.language),
                format_iso_moment(token.used_at or "", page.language),
            )
            for token in accounts.find_tokens(person.id)
        ],
        permissions=[name for name in sorted(collect_permissions(person.roles)) if name != "own"],
        done=done,
        bearer=bearer,
        next=wanted,
        terms=TERMS_DAYS,
        usual_days=DAYS,
    )


def _list_roles(roles: frozenset[Role], language: Language) -> str:
    names = load_wording(language, "access")["role"]
    return ", ".join(str(names[role]) for role in names if role in roles)


def _format_utc(moment_s: float, language: Language) -> str:
    return f"{format_moment(datetime.fromtimestamp(moment_s, UTC), language)} UTC"


@router.get("/people")
def show_people(page: UsedPage, subject: UsedPerson) -> Response:
    """List the people."""
    return _render_people(page, subject)


@router.post("/people")
def invite(page: UsedPage, form: UsedForm, subject: UsedPerson) -> Response:
    """Invite a person, and show the one-time link for setting a password."""
    try:
        roles = _read_roles(form)
        person = page.sign_in.accounts.add_person(first(form, "login"), first(form, "name"), roles)
    except BadParameter as refusal:
        return _render_people(page, subject, refusal)
    return _render_link(page, subject, person, INVITED_S)


@router.post("/people/{person_id}/roles")
def set_roles(person_id: str, page: UsedPage, form: UsedForm, subject: UsedPerson) -> Response:
    """Set the roles of a person; you cannot change your own."""
    person = _get_other(page, subject, person_id)
    if person.issuer is not None:
        raise NotPermitted(permission="provided")  # the provider sets the roles at each sign-in
    page.sign_in.accounts.set_roles(person.id, _read_roles(form))
    return page.go("/people")


@router.post("/people/{person_id}/link")
def make_link(person_id: str, page: UsedPage, subject: UsedPerson) -> Response:
    """Show a one-time link for a person who forgot the password."""
    person = _get_other(page, subject, person_id)
    if person.issuer is not None or person.ended_at is not None:
        raise NotPermitted(permission="provided")
    return _render_link(page, subject, person, FORGOTTEN_S)


@router.post("/people/{person_id}/end")
def end(person_id: str, page: UsedPage, subject: UsedPerson) -> Response:
    """Close an account and end its sessions and tokens."""
    page.sign_in.accounts.end_person(_get_other(page, subject, person_id).id)
    return page.go("/people")


@router.post("/people/{person_id}/resume")
def resume(person_id: str, page: UsedPage, subject: UsedPerson) -> Response:
    """Reopen an account."""
    page.sign_in.accounts.resume_person(_get_other(page, subject, person_id).id)
    return page.go("/people")


def _get_other(page: Page, subject: Subject, person_id: str) -> Person:
    """Return a person other than the subject. Raises NotPermitted."""
    person = page.sign_in.accounts.get_person(person_id)
    if person.id == subject.id:
        raise NotPermitted(permission="themselves")
    return person


def _read_roles(form: Form) -> frozenset[Role]:
    chosen = form.get("role", [])
    if not chosen or not set(chosen) <= set(ROLES):
        raise BadParameter(name="role", value=", ".join(chosen)[:60], allowed=", ".join(ROLES))
    return frozenset(cast("list[Role]", chosen))


def _render_link(page: Page, subject: Subject, person: Person, term_s: float) -> Response:
    ticket = page.sign_in.make_link(person.id, term_s)
    link = f"{get_host_url(page.request)}{page.base}/login/link/{ticket}"
    return _render_people(page, subject, link=link, link_of=person.name, link_hours=str(int(term_s // 3600)))


def _render_people(page: Page, subject: Subject, refusal: AppError | None = None, **link: str) -> Response:
    """Render the list of people.

    ``link``: the one-time link to pass on, with its person (``link_of``) and lifetime (``link_hours``).
    """
    people = page.sign_in.accounts.find_people()
    rows = [(person, _list_roles(person.roles, page.language), person.id == subject.id) for person in people]
    shown = {"link": "", "link_of": "", "link_hours": ""} | link
    return render_with_problem(page, "access/people.html", refusal, rows=rows, roles=tuple(ROLES), **shown)
