"""The page of one's own account: password, second factor, sessions and tokens."""

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any, cast

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from app.access.accounts import DAYS, LONGEST_S, MOST_DAYS, hash_secret, make_token
from app.access.logins import LinkUse
from app.access.subjects import Permission, Role, Subject, collect_permissions
from app.api.middleware.callers import SESSION_COOKIE, find_caller, find_logins, find_settings, set_cookie
from app.api.trust import UsedPerson, find_names
from app.errors import (
    AppError,
    BadParameter,
    LoginRefused,
    NotPermitted,
    SecondFactorLost,
    TooManyTries,
    WeakPassword,
)
from app.report.words.wording import Language, load_wording
from app.services import UsedLanguage
from app.web.forms import UsedForm, first, take_secret
from app.web.login import check_next, render_enrolment, render_with_problem
from app.web.rendering import find_base

router = APIRouter(include_in_schema=False)
TERMS_DAYS = (30, DAYS, 180, MOST_DAYS)


@router.get("/account")
def show_account(
    request: Request,
    person: UsedPerson,
    language: UsedLanguage,
    next: str = "/account",  # noqa: A002
) -> Response:
    """Show one's own account; ``next``: where to go on to once something was read."""
    return _render(request, person, language, next=check_next(next))


@router.post("/account/told")
def note_told(request: Request, form: UsedForm, person: UsedPerson) -> Response:
    """Note that a person knows by which link the password was set, and lead on."""
    find_logins(request).credentials.note_told(person.id)
    return RedirectResponse(find_base(request) + check_next(first(form, "next")), status_code=303)


@router.post("/account/password")
def change_password(request: Request, form: UsedForm, person: UsedPerson, language: UsedLanguage) -> Response:
    """Set another password; every other session ends."""
    proof, password = take_secret(form, "proof"), take_secret(form, "password")
    try:
        cookie = find_logins(request).change_password(person, proof, password, find_caller(request))
    except (LoginRefused, SecondFactorLost, TooManyTries, WeakPassword) as refusal:
        return _render(request, person, language, refusal=refusal)
    response = _render(request, replace(person, session=hash_secret(cookie)), language, done="password")
    set_cookie(request, response, SESSION_COOKIE, cookie, int(LONGEST_S))
    return response


@router.post("/account/second-factor")
def set_up_second_factor(request: Request, person: UsedPerson, language: UsedLanguage) -> Response:
    """Begin to set up an authenticator; the one before holds until a code of the new one was given."""
    ticket = find_logins(request).begin_enrolment(person.id)
    return render_enrolment(request, language, ticket, "/account")


@router.post("/account/second-factor/drop")
def drop_second_factor(request: Request, person: UsedPerson) -> Response:
    """Turn the second factor off, where it is not required."""
    if find_settings(request).second_factor == "required":
        raise NotPermitted(permission="own")
    find_logins(request).drop_second_factor(person.id)
    return _lead_back(request)


@router.post("/account/sessions/end")
def end_sessions(request: Request, form: UsedForm, person: UsedPerson) -> Response:
    """End one session, or every one but this."""
    accounts, session = find_logins(request).accounts, first(form, "session")
    if session:
        accounts.end_session_of(person.id, session)
    else:
        accounts.end_sessions(person.id, person.session)
    return _lead_back(request)


@router.post("/account/tokens")
def add_token(request: Request, form: UsedForm, person: UsedPerson, language: UsedLanguage) -> Response:
    """Make a token, and show it once."""
    chosen = cast("list[Permission]", form.get("permission", []))
    days, name = first(form, "days"), first(form, "name")
    try:
        _, bearer = make_token(
            find_logins(request).accounts, person, name, chosen, int(days) if days.isdecimal() else 0
        )
    except (BadParameter, NotPermitted) as refusal:
        return _render(request, person, language, refusal=refusal)
    return _render(request, person, language, bearer=bearer)


@router.post("/account/tokens/{token_id}/revoke")
def revoke_token(token_id: str, request: Request, person: UsedPerson) -> Response:
    """Revoke a token."""
    find_logins(request).accounts.end_token(person.id, token_id)
    return _lead_back(request)


def list_roles(roles: frozenset[Role], language: Language) -> str:
    """Write somebody's roles."""
    names = load_wording(language, "access")["role"]
    return ", ".join(str(names[role]) for role in names if role in roles)


def format_moment(moment_s: float) -> str:
    """Write a moment (UTC)."""
    return datetime.fromtimestamp(moment_s, UTC).strftime("%Y-%m-%d %H:%M UTC")


def _render(
    request: Request,
    subject: Subject,
    language: Language,
    *,
    refusal: AppError | None = None,
    **shown: str,
) -> Response:
    """``shown``: what was ``done``, the ``bearer`` to be shown once, where to go on to (``next``)."""
    logins = find_logins(request)
    accounts, person = logins.accounts, logins.accounts.get_person(subject.id)
    values: dict[str, Any] = {"done": "", "bearer": "", "next": "/account"} | shown
    values |= {
        "set_by": _tell_link(request, logins.credentials.find_link_use(person.id), language),
        "person": person,
        "roles": list_roles(person.roles, language),
        "codes_left": logins.credentials.count_recovery_codes(person.id),
        "is_required": find_settings(request).second_factor == "required",
        "sessions": [
            (format_moment(held.began_s), format_moment(held.used_s), held.id, held.id == subject.session)
            for held in accounts.find_sessions(person.id)
        ],
        "tokens": [(token, format_moment(token.expires_s)) for token in accounts.find_tokens(person.id)],
        "permissions": [name for name in sorted(collect_permissions(person.roles)) if name != "own"],
        "names": load_wording(language)["fact"]["permission"],
        "terms": TERMS_DAYS,
        "usual_days": DAYS,
    }
    return render_with_problem(request, "access/account.html", language, values, refusal)


def _tell_link(request: Request, use: LinkUse | None, language: Language) -> dict[str, Any] | None:
    """Tell by which link a password was set; None where it was not by one."""
    if use is None:
        return None
    name = find_names(request, [use.made_by], language)[use.made_by]
    facts = {"name": name, "when": f"{use.used_at[:16].replace('T', ' ')} UTC", "address": use.address}
    return {"facts": facts, "is_told": use.is_told}


def _lead_back(request: Request) -> Response:
    return RedirectResponse(f"{find_base(request)}/account", status_code=303)
