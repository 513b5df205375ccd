"""Who manages people lets them in and ends them; he sees no health data."""

import json
import re

import pytest
from httpx2 import Response

from acromion.app.accounts.accounts import AccountStore
from acromion.app.accounts.sign_in import Caller, SignIn
from acromion.app.library.audit_log import AuditFilter, find_lines
from acromion.app.library.jobs import JobStore
from acromion.app.settings import Settings
from tests.app.accounts.conftest import AddPerson, Clock, Enter, Visit, Visitor, make_code, read_ticket

NEW_PASSWORD = "five yellow umbrellas"


@pytest.fixture
def boss(add_person: AddPerson, enter: Enter) -> Visitor:
    add_person("boss", "manager")
    return enter("boss")


def set_by_link(page: Response, visitor: Visitor) -> None:
    """Open the link that a page shows, and set a password by it."""
    link = re.search(r"http://localhost:8080(/login/link/[\w-]+)", page.text)
    assert link is not None
    visitor.post(link[1], password=NEW_PASSWORD)


def test_an_invited_person_chooses_a_password_logs_in_and_is_told_nothing(
    boss: Visitor, visit: Visit, sign_in: SignIn
) -> None:
    visitor = visit()
    page = boss.post("/people", login="Dora@Clinic.example", name="Dora", role=["clinician"])

    set_by_link(page, visitor)

    assert visitor.submit_password("dora@clinic.example", NEW_PASSWORD).status_code == 200
    dora = sign_in.accounts.find_person("dora@clinic.example")
    assert dora is not None
    assert not sign_in.enter(dora.id, Caller("192.0.2.1", "")).must_show_link_use


def test_nobody_manages_himself(boss: Visitor, accounts: AccountStore) -> None:
    own = accounts.find_person("boss")
    assert own is not None

    for act in ("roles", "link", "end", "resume"):
        assert boss.post(f"/people/{own.id}/{act}", role="clinician").status_code == 403, act


def test_a_manager_ends_a_person_and_lets_him_in_again(
    boss: Visitor, add_person: AddPerson, enter: Enter, clock: Clock
) -> None:
    person = add_person("dora")
    dora = enter("dora")

    boss.post(f"/people/{person.id}/end")
    assert dora.client.get("/api/v1/version").status_code == 401
    boss.post(f"/people/{person.id}/resume")
    assert dora.client.get("/api/v1/version").status_code == 401
    clock.wait(60)

    assert enter("dora").client.get("/api/v1/version").status_code == 200


def test_a_manager_gives_roles_of_which_one_is_needed(
    boss: Visitor, add_person: AddPerson, accounts: AccountStore
) -> None:
    person = add_person("dora")

    boss.post(f"/people/{person.id}/roles", role=["researcher", "auditor"])

    assert boss.post(f"/people/{person.id}/roles").status_code == 422
    assert boss.post(f"/people/{person.id}/roles", role="king").status_code == 422
    assert accounts.get_person(person.id).roles == {"researcher", "auditor"}


def test_a_name_that_somebody_has_is_refused_on_the_page(boss: Visitor, add_person: AddPerson) -> None:
    add_person("dora")

    page = boss.post("/people", login="DORA", name="Another", role="clinician")

    assert page.status_code == 422
    assert 'role="alert"' in page.text


# A link that a manager makes for somebody who has a password already.


@pytest.fixture
def reset(boss: Visitor, add_person: AddPerson, visit: Visit) -> Visitor:
    """A browser in which the password of Dora was set by a link of the manager."""
    visitor, dora = visit(), add_person("dora")
    set_by_link(boss.post(f"/people/{dora.id}/link"), visitor)
    return visitor


def log_in(visitor: Visitor, clock: Clock, wanted: str = "/trash") -> Response:
    clock.wait(60)
    asked = visitor.post("/login", login="dora", password=NEW_PASSWORD, next=wanted)
    return visitor.post("/login/code", ticket=read_ticket(asked), code=make_code(clock), next=wanted)


def test_a_person_is_told_at_the_next_login_who_made_the_link(reset: Visitor, clock: Clock) -> None:
    led = log_in(reset, clock)
    page = reset.get(led.headers["location"]).text

    assert led.headers["location"] == "/account?next=%2Ftrash"
    assert "your password was reset with a link that Boss created" in page
    assert "192.0.2.1" in page


def test_a_person_is_told_until_he_says_that_he_knows(reset: Visitor, clock: Clock) -> None:
    log_in(reset, clock)
    again = log_in(reset, clock)
    known = reset.post("/account/told", next="/trash")
    after = log_in(reset, clock)

    assert again.headers["location"] == "/account?next=%2Ftrash"
    assert known.headers["location"] == "/trash"
    assert after.headers["location"] == "/trash"
    assert "Boss" in reset.get("/account").text


def test_the_audit_log_holds_who_made_the_link_and_from_where_it_was_used(
    reset: Visitor, accounts: AccountStore, settings: Settings
) -> None:
    boss, dora = accounts.find_person("boss"), accounts.find_person("dora")
    assert boss is not None
    assert dora is not None
    store = JobStore(settings)

    lines = [
        (line.who, line.act, json.loads(line.other))
        for line in find_lines(store.reader, AuditFilter())
        if line.act == "link.made" or (line.act == "password.changed" and "link" in line.other)
    ]
    store.close()

    used = {"by": "link", "made_by": boss.id, "address": "192.0.2.1", "person": dora.id}
    assert lines == [("nobody", "password.changed", used), (boss.id, "link.made", {"person": dora.id})]
