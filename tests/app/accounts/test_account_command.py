"""``acromion account``: first manager, forgotten passwords and tokens by command line."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.access.accounts import AccountStore
from app.access.logins import Caller, Logins
from app.cli import app
from tests.app.accounts.conftest import AddPerson

HERE = Caller("192.0.2.1", "")


def run(data: Path, *arguments: str, typed: str = "") -> tuple[int, str]:
    result = CliRunner().invoke(app, ["account", *arguments, "--data", str(data)], input=typed)
    return result.exit_code, result.output


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return tmp_path / "data"


def test_the_first_manager_gets_an_address_that_works_once(data: Path, logins: Logins) -> None:
    code, told = run(data, "add", "boss", "--role", "manager")
    link = re.search(r"/login/link/([\w-]+)", told)
    assert link is not None

    person = logins.set_password_by_link(link[1], "five yellow umbrellas", "192.0.2.1")

    assert (code, person.login) == (0, "boss")
    assert person.roles == {"manager"}


def test_a_password_may_be_typed_instead(data: Path, logins: Logins) -> None:
    code, _ = run(data, "add", "boss", "--role", "manager", "--password", typed="five yellow umbrellas\n")

    assert code == 0
    assert logins.give_password("boss", "five yellow umbrellas", HERE).next == "enrol"


def test_a_weak_password_is_refused_by_its_code(data: Path) -> None:
    code, told = run(data, "add", "boss", "--role", "manager", "--password", typed="short\n")

    assert code == 3
    assert "E-PASSWORD" in told


def test_a_lost_phone_is_set_up_anew(data: Path, add_person: AddPerson, accounts: AccountStore) -> None:
    person = add_person()

    run(data, "reset", "clara", "--second-factor")

    assert accounts.get_person(person.id).has_second_factor is False


def test_a_person_ended_by_command_is_out(data: Path, add_person: AddPerson, accounts: AccountStore) -> None:
    session = accounts.begin_session(add_person().id)

    run(data, "end", "clara")

    assert accounts.find_by_session(session) is None


def test_roles_are_given_by_command(data: Path, add_person: AddPerson, accounts: AccountStore) -> None:
    person = add_person()

    run(data, "roles", "clara", "--role", "auditor", "--role", "manager")

    assert accounts.get_person(person.id).roles == {"auditor", "manager"}


def test_a_token_made_by_command_asks_for_its_person(
    data: Path, add_person: AddPerson, accounts: AccountStore
) -> None:
    add_person()

    _, told = run(data, "token", "clara", "--name", "nightly", "--may", "read")

    subject = accounts.find_by_token(told.splitlines()[0])
    assert subject is not None
    assert subject.permissions == {"own", "read"}


def test_a_token_may_no_more_than_its_person_by_command_either(data: Path, add_person: AddPerson) -> None:
    add_person("clara", "assistant")

    code, told = run(data, "token", "clara", "--name", "nightly", "--may", "erase")

    assert code == 3
    assert "E-PERMISSION" in told


def test_the_list_tells_who_may_log_in(data: Path, add_person: AddPerson, accounts: AccountStore) -> None:
    add_person()
    accounts.end_person(add_person("dora").id)

    _, told = run(data, "list")

    assert re.search(r"clara .* may log in", told)
    assert re.search(r"dora .* may not log in", told)


def test_a_name_that_is_not_there_is_told(data: Path) -> None:
    code, told = run(data, "end", "nobody")

    assert code == 3
    assert "E-NOT-FOUND" in told


@pytest.mark.parametrize("name", [" ", "x" * 201, "Clara\nManager"])
def test_a_name_that_is_none_is_refused(data: Path, accounts: AccountStore, name: str) -> None:
    code, output = run(data, "add", "clara", "--role", "clinician", "--name", name)

    assert code == 3
    assert "E-PARAMETER" in output
    assert list(accounts.find_people()) == []
