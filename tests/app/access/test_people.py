"""Who manages people lets them in and ends them; he sees no health data, and only his own organisation."""

import re
from collections.abc import Callable

import pytest

from app.access.accounts import AccountStore
from tests.app.access.conftest import AddPerson, Clock, Visit, Visitor

Enter = Callable[..., Visitor]


@pytest.fixture
def boss(add_person: AddPerson, enter: Enter) -> Visitor:
    add_person("boss", "manager")
    return enter("boss")


def test_an_invited_person_chooses_a_password_and_logs_in(boss: Visitor, visit: Visit) -> None:
    page = boss.post("/people", login="Dora@Clinic.example", name="Dora", role=["clinician"])
    link = re.search(r"http://localhost:8080(/login/link/[\w-]+)", page.text)
    assert link is not None

    visitor = visit()
    visitor.post(link[1], password="five yellow umbrellas")

    assert visitor.give_password("dora@clinic.example", "five yellow umbrellas").status_code == 200


def test_the_page_lists_the_people_of_one_organisation(boss: Visitor, add_person: AddPerson) -> None:
    add_person("dora")
    add_person("foreign", organisation="org_other")

    page = boss.get("/people").text

    assert "Dora" in page
    assert "Foreign" not in page


@pytest.mark.parametrize("act", ["roles", "link", "end", "resume"])
def test_nobody_of_another_organisation_is_there(boss: Visitor, add_person: AddPerson, act: str) -> None:
    foreign = add_person("foreign", organisation="org_other")

    answers = [boss.post(f"/people/{person}/{act}", role="manager") for person in (foreign.id, "per_none")]

    assert [answer.status_code for answer in answers] == [404, 404]
    assert answers[0].text.replace(foreign.id, "per_none") == answers[1].text


@pytest.mark.parametrize("act", ["roles", "link", "end", "resume"])
def test_nobody_manages_himself(boss: Visitor, accounts: AccountStore, act: str) -> None:
    own = accounts.find_person("boss")
    assert own is not None

    assert boss.post(f"/people/{own.id}/{act}", role="clinician").status_code == 403


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


def test_a_manager_gives_roles(boss: Visitor, add_person: AddPerson, accounts: AccountStore) -> None:
    person = add_person("dora")

    boss.post(f"/people/{person.id}/roles", role=["researcher", "auditor"])

    assert accounts.get_person(person.id).roles == {"researcher", "auditor"}


def test_there_is_no_person_without_a_role(boss: Visitor, add_person: AddPerson) -> None:
    person = add_person("dora")

    assert boss.post(f"/people/{person.id}/roles").status_code == 422
    assert boss.post(f"/people/{person.id}/roles", role="king").status_code == 422


def test_a_name_that_somebody_has_is_refused_on_the_page(boss: Visitor, add_person: AddPerson) -> None:
    add_person("dora")

    page = boss.post("/people", login="DORA", name="Another", role="clinician")

    assert page.status_code == 422
    assert 'role="alert"' in page.text


@pytest.mark.parametrize("path", ["/", "/rows", "/trash", "/api/v1/recordings", "/api/v1/analyses"])
def test_a_manager_sees_no_health_data(boss: Visitor, path: str) -> None:
    assert boss.client.get(path).status_code == 403


def test_whoever_reads_recordings_manages_nobody(add_person: AddPerson, enter: Enter) -> None:
    add_person("dora")

    assert enter("dora").client.get("/people").status_code == 403
