"""The page of who manages people: let in, give roles, end. It shows no health data."""

from typing import cast

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from app.access.accounts import Person
from app.access.logins import FORGOTTEN_S, INVITED_S
from app.access.subjects import ROLES, Role, Subject
from app.api.middleware.callers import find_logins, find_origin
from app.api.trust import UsedPerson
from app.errors import AppError, BadParameter, NotPermitted
from app.report.words.wording import Language
from app.services import UsedLanguage
from app.web.account import list_roles
from app.web.forms import Form, UsedForm, first
from app.web.login import render_with_problem
from app.web.rendering import find_base

router = APIRouter(include_in_schema=False)


@router.get("/people")
def show_people(request: Request, subject: UsedPerson, language: UsedLanguage) -> Response:
    """List the people."""
    return _render(request, subject, language)


@router.post("/people")
def invite(request: Request, form: UsedForm, subject: UsedPerson, language: UsedLanguage) -> Response:
    """Add a person, and show the address that works once by which a password is chosen."""
    logins, name = find_logins(request), first(form, "name")
    try:
        roles = _read_roles(form)
        person = logins.accounts.add_person(first(form, "login"), name, roles)
    except BadParameter as refusal:
        return _render(request, subject, language, refusal=refusal)
    return _render_link(request, subject, language, person, INVITED_S)


@router.post("/people/{person_id}/roles")
def set_roles(person_id: str, request: Request, form: UsedForm, subject: UsedPerson) -> Response:
    """Give a person other roles; nobody changes his own."""
    person = _get_other(request, subject, person_id)
    if person.issuer is not None:
        raise NotPermitted(permission="provided")  # the provider says them at each login
    find_logins(request).accounts.set_roles(person.id, _read_roles(form))
    return _lead_back(request)


@router.post("/people/{person_id}/link")
def make_link(person_id: str, request: Request, subject: UsedPerson, language: UsedLanguage) -> Response:
    """Show an address that works once for a person who forgot the password."""
    person = _get_other(request, subject, person_id)
    if person.issuer is not None or person.ended_at is not None:
        raise NotPermitted(permission="provided")
    return _render_link(request, subject, language, person, FORGOTTEN_S)


@router.post("/people/{person_id}/end")
def end(person_id: str, request: Request, subject: UsedPerson) -> Response:
    """Let a person log in no more; what is open ends, too."""
    find_logins(request).accounts.end_person(_get_other(request, subject, person_id).id)
    return _lead_back(request)


@router.post("/people/{person_id}/resume")
def resume(person_id: str, request: Request, subject: UsedPerson) -> Response:
    """Let a person log in again."""
    find_logins(request).accounts.resume_person(_get_other(request, subject, person_id).id)
    return _lead_back(request)


def _get_other(request: Request, subject: Subject, person_id: str) -> Person:
    """Return a person who is not the one who asks."""
    person = find_logins(request).accounts.get_person(person_id)
    if person.id == subject.id:
        raise NotPermitted(permission="themselves")
    return person


def _read_roles(form: Form) -> frozenset[Role]:
    chosen = form.get("role", [])
    if not chosen or not set(chosen) <= set(ROLES):
        raise BadParameter(name="role", value=", ".join(chosen)[:60], allowed=", ".join(ROLES))
    return frozenset(cast("list[Role]", chosen))


def _render_link(
    request: Request, subject: Subject, language: Language, person: Person, term_s: float
) -> Response:
    ticket = find_logins(request).make_link(person.id, term_s)
    link = f"{find_origin(request)}{find_base(request)}/login/link/{ticket}"
    hours = str(int(term_s // 3600))
    return _render(request, subject, language, link=link, link_of=person.name, link_hours=hours)


def _render(
    request: Request, subject: Subject, language: Language, *, refusal: AppError | None = None, **shown: str
) -> Response:
    """``shown``: a ``link``, whose it is (``link_of``), and how long it works (``link_hours``)."""
    people = find_logins(request).accounts.find_people()
    values = {"link": "", "link_of": "", "link_hours": ""} | shown
    rows = [(person, list_roles(person.roles, language), person.id == subject.id) for person in people]
    return render_with_problem(
        request, "access/people.html", language, values | {"rows": rows, "roles": tuple(ROLES)}, refusal
    )


def _lead_back(request: Request) -> Response:
    return RedirectResponse(f"{find_base(request)}/people", status_code=303)
