"""Secrets of authenticators: a dump of the accounts shows none, and they open with the keys alone."""

import json
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select, update

from app.access.accounts import AccountStore
from app.access.logins import Caller, Logins
from app.errors import KeysNeeded, SecondFactorSealed
from app.jobs.database.tables import people, tickets
from app.jobs.store import JobStore
from app.main import create_app
from app.settings import Settings
from app.storage.keys import open_keys
from app.upkeep.backup import back_up, restore
from tests.app.access.conftest import PASSWORD, SECRET, AddPerson, Clock, Visit, make_code, read_ticket

HERE = Caller("192.0.2.1", "")


def dump(accounts: AccountStore) -> str:
    """Give every row of every table of the accounts, as bytes are."""
    found = []
    for table in (people, tickets):
        found += [
            bytes(value).decode() if isinstance(value, bytes | memoryview) else str(value)
            for row in accounts.database.read_all(table.select())
            for value in row
        ]
    return "\n".join(found)


def log_in(logins: Logins, clock: Clock) -> str:
    step = logins.give_password("clara", PASSWORD, HERE)
    return logins.give_code(step.ticket, make_code(clock), HERE).session


@pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)
def test_no_secret_of_an_authenticator_stands_open_in_the_accounts(
    accounts: AccountStore, logins: Logins, add_person: AddPerson, clock: Clock
) -> None:
    add_person()

    assert SECRET not in dump(accounts)
    assert log_in(logins, clock)


def test_a_secret_that_is_being_set_up_does_not_either(
    accounts: AccountStore, logins: Logins, add_person: AddPerson
) -> None:
    ticket = logins.begin_enrolment(add_person().id)

    shown, _ = logins.show_enrolment(ticket)

    assert len(shown) == 32
    assert shown not in dump(accounts)
    assert json.loads(accounts.database.read_value(select(tickets.c.told)))["secret"].startswith("~1~")


def keep_open(accounts: AccountStore, person_id: str) -> None:
    """Keep the secret as the release before did."""
    with accounts.database.write() as connection:
        connection.execute(update(people).where(people.c.id == person_id).values(totp_secret=SECRET.encode()))


def test_a_secret_of_an_earlier_release_is_read(
    accounts: AccountStore, logins: Logins, add_person: AddPerson, clock: Clock
) -> None:
    keep_open(accounts, add_person().id)

    assert log_in(logins, clock)


@pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)
def test_a_secret_of_an_earlier_release_is_sealed_by_a_start(
    settings: Settings, accounts: AccountStore, logins: Logins, add_person: AddPerson, clock: Clock
) -> None:
    keep_open(accounts, add_person().id)
    assert SECRET in dump(accounts)

    with TestClient(create_app(settings)):
        pass

    assert SECRET not in dump(accounts)
    assert log_in(logins, clock)


def test_without_the_key_no_code_is_compared_and_the_log_names_the_cure(
    settings: Settings, logins: Logins, add_person: AddPerson, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    person = add_person()
    open_keys(settings).destroy("accounts")

    with pytest.raises(SecondFactorSealed):
        log_in(logins, clock)

    assert f"the second factor of {person.id} cannot be read" in caplog.text
    assert "--second-factor" in caplog.text


@pytest.mark.parametrize(("language", "cure"), [("en", "restores the keys"), ("fr", "restaure les clés")])
def test_without_the_key_the_page_says_that_the_second_step_cannot_be_read(
    settings: Settings, add_person: AddPerson, visit: Visit, language: str, cure: str
) -> None:
    add_person()
    visitor = visit()
    visitor.client.cookies.set("acromion_lang", language)
    ticket = read_ticket(visitor.give_password("clara"))
    open_keys(settings).destroy("accounts")

    page = visitor.post("/login/code", ticket=ticket, code="123456", next="/")

    assert page.status_code == 503
    assert "E-SECOND-FACTOR" in page.text
    assert cure in page.text


@pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)
def test_no_name_stands_open_in_the_accounts(accounts: AccountStore) -> None:
    person = accounts.add_person("clara", "Clara Léger", ["clinician"])
    accounts.set_name(person.id, "Clara Roy")

    assert "Léger" not in dump(accounts)
    assert "Roy" not in dump(accounts)
    assert accounts.get_person(person.id).name == "Clara Roy"


@pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)
def test_a_name_of_an_earlier_release_is_read_and_sealed_by_a_start(
    settings: Settings, accounts: AccountStore, add_person: AddPerson
) -> None:
    person = add_person()
    with accounts.database.write() as connection:
        connection.execute(update(people).values(name="Clara Léger"))
    assert accounts.get_person(person.id).name == "Clara Léger"

    with TestClient(create_app(settings)):
        pass

    assert "Léger" not in dump(accounts)
    assert accounts.get_person(person.id).name == "Clara Léger"


def test_without_the_key_a_person_is_shown_by_the_login(
    settings: Settings, clock: Clock, add_person: AddPerson
) -> None:
    person = add_person()
    open_keys(settings).destroy("accounts")

    reopened = AccountStore(settings, clock)

    assert reopened.get_person(person.id).name == "clara"
    reopened.database.close()


def test_a_name_given_while_the_key_is_lost_makes_no_other_key(
    settings: Settings, accounts: AccountStore, add_person: AddPerson
) -> None:
    add_person()
    keys = open_keys(settings)
    kept = keys.get("accounts")
    keys.destroy("accounts")

    dora = accounts.add_person("dora", "Dora Roy", ["clinician"])
    assert keys.find("accounts") is None
    keys.keep(kept)
    accounts.seal_earlier()

    assert "Dora Roy" not in dump(accounts)
    assert accounts.get_person(dora.id).name == "Dora Roy"


def test_a_code_that_cannot_be_compared_is_no_guess(
    settings: Settings, logins: Logins, add_person: AddPerson, clock: Clock
) -> None:
    logins.credentials.set_second_factor(add_person().id, SECRET, 0, ["aaaa-bbbb"])
    open_keys(settings).destroy("accounts")
    step = logins.give_password("clara", PASSWORD, HERE)
    for _ in range(20):
        with pytest.raises(SecondFactorSealed):
            logins.give_code(step.ticket, make_code(clock), HERE)

    assert logins.give_code(step.ticket, "aaaa-bbbb", HERE).session


def test_without_the_key_a_recovery_code_lets_in(
    settings: Settings, logins: Logins, add_person: AddPerson
) -> None:
    logins.credentials.set_second_factor(add_person().id, SECRET, 0, ["aaaa-bbbb"])
    open_keys(settings).destroy("accounts")

    step = logins.give_password("clara", PASSWORD, HERE)

    assert logins.give_code(step.ticket, "aaaa-bbbb", HERE).session


def test_a_secret_does_not_open_as_another_persons(
    accounts: AccountStore, logins: Logins, add_person: AddPerson, clock: Clock
) -> None:
    clara, dora = add_person("clara"), add_person("dora")
    hers = select(people.c.totp_secret).where(people.c.id == dora.id).scalar_subquery()
    with accounts.database.write() as connection:
        connection.execute(update(people).where(people.c.id == clara.id).values(totp_secret=hers))

    with pytest.raises(SecondFactorSealed):
        log_in(logins, clock)


def test_accounts_whose_key_is_missing_are_not_restored(
    settings: Settings, add_person: AddPerson, tmp_path: Path
) -> None:
    add_person()
    JobStore(settings).close()
    back_up(settings, tmp_path / "b.zip")
    place = tmp_path / "restored"
    url = f"sqlite:///{place / 'acromion.sqlite3'}"
    new = settings.model_copy(update={"data_dir": place, "database_url": url})

    with pytest.raises(KeysNeeded):
        restore(new, tmp_path / "b.zip")

    there = AccountStore(new)
    assert there.find_people() == []
    there.database.close()
