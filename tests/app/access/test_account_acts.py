"""What is done about accounts is in the trail."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import create_engine, func, select
from sqlalchemy.exc import SQLAlchemyError
from typer.testing import CliRunner

from app.access.accounts import AccountStore
from app.access.acts import carry_acts
from app.access.logins import Caller, Logins
from app.access.tables import acts
from app.cli import app
from app.errors import LoginRefused
from app.jobs.audit_log import AuditLine, AuditQuestion, acting, find_lines
from app.jobs.store import JobStore
from app.main import create_app
from app.settings import Settings
from tests.app.access.conftest import PASSWORD, AddPerson

HERE = Caller("192.0.2.1", "")


@pytest.fixture
def store(settings: Settings) -> Iterator[JobStore]:
    """The tables of the server."""
    opened = JobStore(settings)
    yield opened
    opened.close()


def carry(accounts: AccountStore, store: JobStore) -> list[AuditLine]:
    """Carry what waits; gives the lines in order."""
    carry_acts(accounts.database, store.engine)
    return list(find_lines(store.reader, AuditQuestion()))[::-1]


def count_notes(accounts: AccountStore) -> int:
    return int(accounts.database.read_value(select(func.count()).select_from(acts)))


def test_a_line_names_the_person_and_who_did_it_and_neither_login_nor_name(
    accounts: AccountStore, add_person: AddPerson, store: JobStore
) -> None:
    anna = add_person("anna", "clinician")
    carry(accounts, store)
    with acting("per_boss"):
        accounts.end_person(anna.id)

    line = carry(accounts, store)[-1]

    assert (line.who, line.act) == ("per_boss", "person.ended")
    assert json.loads(line.other).keys() == {"done_at", "person"}
    assert json.loads(line.other)["person"] == anna.id


def test_a_login_a_refused_one_and_its_end_are_lines(
    accounts: AccountStore, logins: Logins, add_person: AddPerson, store: JobStore
) -> None:
    anna = add_person("anna", "clinician")
    carry(accounts, store)
    with pytest.raises(LoginRefused):
        logins.give_password("anna", "not this one", HERE)
    with pytest.raises(LoginRefused):
        logins.give_password("nobody", "not this one", HERE)
    accounts.end_session(accounts.begin_session(anna.id))

    told = [(line.act, line.who) for line in carry(accounts, store)[-4:]]

    assert told[:2] == [("login.failed", "nobody")] * 2
    assert told[2] == ("login.succeeded", anna.id)
    assert told[3][0] == "login.ended"


def test_the_same_roles_again_are_no_line(
    accounts: AccountStore, add_person: AddPerson, store: JobStore
) -> None:
    anna = add_person("anna", "clinician")
    before = len(carry(accounts, store))

    accounts.set_roles(anna.id, {"clinician"})

    assert len(carry(accounts, store)) == before


def test_a_note_whose_line_stands_already_is_dropped_without_a_second_line(
    accounts: AccountStore, add_person: AddPerson, store: JobStore
) -> None:
    add_person("anna", "clinician")
    notes = [dict(row._mapping) for row in accounts.database.read_all(select(acts))]
    before = carry(accounts, store)
    with accounts.database.write() as connection:  # as a crash leaves them, before they were dropped
        connection.execute(acts.insert(), notes)

    assert carry(accounts, store) == before
    assert count_notes(accounts) == 0


def test_what_cannot_be_written_waits(accounts: AccountStore, add_person: AddPerson, store: JobStore) -> None:
    carry(accounts, store)
    add_person("anna", "clinician")

    away = create_engine("sqlite:////nowhere/at/all")
    with pytest.raises(SQLAlchemyError):
        carry_acts(accounts.database, away)

    assert count_notes(accounts) > 0
    carry(accounts, store)
    assert count_notes(accounts) == 0


def test_a_command_writes_its_lines_itself(settings: Settings, store: JobStore, tmp_path: Path) -> None:
    typed = ["account", "add", "boss", "--role", "manager", "--password", "--data", str(settings.data_dir)]

    assert CliRunner().invoke(app, typed, input=f"{PASSWORD}\n").exit_code == 0

    lines = list(find_lines(store.reader, AuditQuestion(who="machine")))[::-1]
    assert [line.act for line in lines if not line.act.startswith("trail.")] == [
        "person.added",
        "password.changed",
    ]


def test_a_list_by_command_leaves_the_line_of_the_page(settings: Settings, store: JobStore) -> None:
    data = ("--data", str(settings.data_dir))
    CliRunner().invoke(app, ["account", "add", "boss", "--role", "manager", *data])

    CliRunner().invoke(app, ["account", "list", *data])

    (line,) = find_lines(store.reader, AuditQuestion(who="machine", act="people.read"))
    assert (line.recording_id, line.analysis_id) == ("", "")


def test_a_server_writes_what_waits(
    accounts: AccountStore, add_person: AddPerson, settings: Settings
) -> None:
    add_person("anna", "clinician")
    application = create_app(settings)
    with TestClient(application):
        pass

    reopened = JobStore(settings)
    acts_told = [line.act for line in find_lines(reopened.reader, AuditQuestion())]
    reopened.close()
    assert "person.added" in acts_told
