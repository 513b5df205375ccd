"""A token asks in the name of its person: never more than he may, never for ever, never in an address."""

import re
from collections.abc import Sequence
from typing import Any

import pytest
from starlette.requests import Request

from acromion.app.accounts.accounts import AccountStore, Person
from acromion.app.accounts.subjects import AT_THE_MACHINE, Permission, Subject
from acromion.app.services import get_request_origin
from tests.app.accounts.conftest import AddPerson, Clock, Enter, Visit, Visitor

DAY_S = 86400.0


def make(visitor: Visitor, *permissions: str, **more: Any) -> str:
    wish = {"name": "nightly", "permissions": permissions or ("read",)} | more
    answer = visitor.client.post("/api/v1/tokens", json=wish)
    assert answer.status_code == 201, answer.text
    return str(answer.json()["token"])


def ask(visit: Visit, token: str, method: str = "GET", path: str = "/api/v1/recordings") -> int:
    headers = {"authorization": f"Bearer {token}"}
    return visit().client.request(method, path, headers=headers).status_code


def test_a_token_has_a_prefix_that_scanners_know_and_is_shown_once(visitor: Visitor, visit: Visit) -> None:
    token = make(visitor)
    ask(visit, token)

    listed = visitor.client.get("/api/v1/tokens")

    assert re.fullmatch(r"acr_[\w-]{43}", token)
    assert token not in listed.text + visitor.get("/account").text
    assert [row["used_at"] for row in listed.json()["items"]] == ["2026-09-21T14:13:20+00:00"]


def test_nobody_gives_a_token_what_he_may_not(add_person: AddPerson, enter: Enter) -> None:
    add_person("clara", "assistant")

    answer = enter().client.post("/api/v1/tokens", json={"name": "x", "permissions": ["erase"]})

    assert (answer.status_code, answer.json()["code"]) == (403, "E-PERMISSION")


def test_a_token_loses_what_its_person_loses(
    person: Person, enter: Enter, visit: Visit, accounts: AccountStore
) -> None:
    token = make(enter(), "read")

    accounts.set_roles(person.id, ["auditor"])

    assert ask(visit, token) == 403


def test_a_token_lasts_a_year_at_most(person: Person, enter: Enter) -> None:
    visitor, wish = enter(), {"name": "x", "permissions": ["read"]}

    told = [visitor.client.post("/api/v1/tokens", json=wish | {"days": days}) for days in (0, 1, 365, 366)]

    assert [answer.status_code for answer in told] == [422, 201, 201, 422]


def test_a_token_lasts_ninety_days_where_nothing_is_said(
    person: Person, enter: Enter, visit: Visit, clock: Clock
) -> None:
    token = make(enter())

    clock.wait(90 * DAY_S - 1)
    assert ask(visit, token) == 200
    clock.wait(1)

    assert ask(visit, token) == 401


def test_a_revoked_token_is_nobodys(visitor: Visitor, visit: Visit) -> None:
    token = make(visitor)
    (row,) = visitor.client.get("/api/v1/tokens").json()["items"]

    assert visitor.client.delete(f"/api/v1/tokens/{row['id']}").status_code == 204

    assert ask(visit, token) == 401
    assert visitor.client.get("/api/v1/tokens").json() == {"items": []}


def test_the_token_of_an_ended_person_is_nobodys(
    person: Person, enter: Enter, visit: Visit, accounts: AccountStore
) -> None:
    token = make(enter())

    accounts.end_person(person.id)
    accounts.resume_person(person.id)

    assert ask(visit, token) == 401


def test_somebody_elses_token_is_not_there(
    person: Person, add_person: AddPerson, enter: Enter, clock: Clock
) -> None:
    add_person("dora")
    clara = enter()
    make(clara)
    (row,) = clara.client.get("/api/v1/tokens").json()["items"]

    dora = enter("dora")

    assert dora.client.delete(f"/api/v1/tokens/{row['id']}").status_code == 404
    assert dora.client.get("/api/v1/tokens").json() == {"items": []}


@pytest.mark.parametrize("accept", ["application/json", "text/html"])
def test_a_token_in_an_address_is_refused_and_neither_said_back_nor_logged(
    person: Person, enter: Enter, visit: Visit, caplog: pytest.LogCaptureFixture, accept: str
) -> None:
    token = make(enter())
    browser = visit().client

    for path in (
        "/api/v1/recordings?access_token={}",
        "/api/v1/recordings?lang=fr&x=y{}",
        "/api/v1/analyses/{}",
        "/api/v1/analyses/%61cr_{}",
        "/analyses/{}",
        "/login?next=/%3Ftoken={}",
        "/trash?x={}",
        "/trash?{}=1",
    ):
        written = path.replace("%61cr_{}", f"%61{token[1:]}").format(token)
        answer = browser.get(written, headers={"accept": accept})
        said = f"{answer.text} {answer.headers}"
        assert (answer.status_code, "E-TOKEN-ADDRESS" in said, token[4:] in said) == (400, True, False), path

    own = [record.getMessage() for record in caplog.records if not record.name.startswith("httpx")]
    assert token[4:] not in str(own)


def test_a_token_at_a_foreign_name_is_not_said_back(person: Person, enter: Enter, visit: Visit) -> None:
    token = make(enter())

    answer = visit().client.get(f"/api/v1/analyses/{token}", headers={"host": "evil.example"})

    assert (answer.status_code, token in answer.text) == (421, False)


def test_a_token_is_made_and_revoked_on_the_page(visitor: Visitor, visit: Visit) -> None:
    page = visitor.post("/account/tokens", name="nightly", permission=["read", "upload"], days="30")
    shown = re.search(r"acr_[\w-]{43}", page.text)
    assert shown is not None
    assert ask(visit, shown[0]) == 200
    revoke = re.search(r'action="(/account/tokens/tok_\w+/revoke)"', page.text)
    assert revoke is not None
    visitor.post(revoke[1])

    assert ask(visit, shown[0]) == 401


# Whose turn it is.


def find_way(subject: Subject, *headers: tuple[bytes, bytes]) -> str:
    return get_request_origin(Request({"type": "http", "headers": headers, "acromion.subject": subject}))


def of_kind(kind: Any, permissions: Sequence[Permission] = ()) -> Subject:
    return Subject(kind, "x", "x", frozenset(permissions))


def test_the_page_and_people_go_before_tokens_and_scripts() -> None:
    of_page = (b"origin", b"http://localhost")

    assert find_way(of_kind("token"), of_page) == "api"  # whatever its headers say
    assert find_way(of_kind("person")) == "web"
    assert find_way(AT_THE_MACHINE, of_page) == "web"
    assert find_way(AT_THE_MACHINE) == "api"
