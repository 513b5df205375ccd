"""What is done about accounts is in the audit log, in the transaction of the act."""

import json
from collections.abc import Iterator

import pytest
from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError
from typer.testing import CliRunner

from acromion.app.accounts.accounts import AccountStore
from acromion.app.accounts.sign_in import Caller, SignIn
from acromion.app.cli import app
from acromion.app.errors import LoginRefused
from acromion.app.library.audit_log import AuditFilter, AuditLine, acting, find_lines
from acromion.app.library.jobs import JobStore
from acromion.app.settings import Settings
from tests.app.accounts.conftest import PASSWORD, AddPerson

HERE = Caller("192.0.2.1", "")


@pytest.fixture
def store(settings: Settings) -> Iterator[JobStore]:
    """The tables of the server."""
    opened = JobStore(settings)
    yield opened
    opened.close()


def read(store: JobStore) -> list[AuditLine]:
    """Return the lines in order."""
    return list(find_lines(store.reader, AuditFilter()))[::-1]


def test_a_line_names_the_person_and_who_did_it_and_neither_login_nor_name(
    accounts: AccountStore, add_person: AddPerson, store: JobStore
) -> None:
    anna = add_person("anna", "clinician")
    with acting("per_boss"):
        accounts.end_person(anna.id)

    line = read(store)[-1]

    assert (line.who, line.act) == ("per_boss", "person.ended")
    assert json.loads(line.other) == {"person": anna.id}


def test_an_act_whose_line_cannot_be_written_is_not_done(
    accounts: AccountStore, add_person: AddPerson, store: JobStore
) -> None:
    anna = add_person("anna", "clinician")
    store.run(text("ALTER TABLE audit_log RENAME TO audit_log_away"))

    with pytest.raises(SQLAlchemyError):
        accounts.end_person(anna.id)

    assert accounts.get_person(anna.id).ended_at is None


def test_a_login_a_refused_one_and_its_end_are_lines(
    accounts: AccountStore, sign_in: SignIn, add_person: AddPerson, store: JobStore
) -> None:
    anna = add_person("anna", "clinician")
    with pytest.raises(LoginRefused):
        sign_in.submit_password("anna", "not this one", HERE)
    with pytest.raises(LoginRefused):
        sign_in.submit_password("nobody", "not this one", HERE)
    accounts.end_session(accounts.begin_session(anna.id))

    told = [(line.act, line.who) for line in read(store)[-4:]]

    assert told[:2] == [("login.failed", "nobody")] * 2
    assert told[2] == ("login.succeeded", anna.id)
    assert told[3][0] == "login.ended"


def test_the_same_roles_again_are_no_line(
    accounts: AccountStore, add_person: AddPerson, store: JobStore
) -> None:
    anna = add_person("anna", "clinician")
    before = read(store)

    accounts.set_roles(anna.id, {"clinician"})

    assert read(store) == before


def test_a_command_leaves_its_lines(settings: Settings, store: JobStore) -> None:
    data = ("--data", str(settings.data_dir))
    typed = ["account", "add", "boss", "--role", "manager", "--password", *data]

    assert CliRunner().invoke(app, typed, input=f"{PASSWORD}\n").exit_code == 0
    CliRunner().invoke(app, ["account", "list", *data])

    lines = list(find_lines(store.reader, AuditFilter(who="machine")))[::-1]
    assert [line.act for line in lines] == ["person.added", "password.changed", "people.read"]
    assert (lines[-1].recording_id, lines[-1].analysis_id) == ("", "")
