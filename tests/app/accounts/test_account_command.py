"""``acromion account``: first manager, forgotten passwords and tokens by command line."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.access.accounts import AccountStore, Person
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


def test_a_token_made_by_command_asks_for_its_person(
    person: Person, data: Path, accounts: AccountStore
) -> None:
    _, told = run(data, "token", "clara", "--name", "nightly", "--may", "read")

    subject = accounts.find_by_token(told.splitlines()[0])
    assert subject is not None
    assert subject.permissions == {"own", "read"}


def test_the_list_tells_who_may_log_in(
    person: Person, data: Path, add_person: AddPerson, accounts: AccountStore
) -> None:
    accounts.end_person(add_person("dora").id)

    _, told = run(data, "list")

    assert re.search(r"clara .* may log in", told)
    assert re.search(r"dora .* may not log in", told)


@pytest.mark.parametrize(
    ("words", "typed", "told"),
    [
        (("add", "boss", "--role", "manager", "--password"), "short\n", "E-PASSWORD"),
        (("token", "clara", "--name", "nightly", "--may", "erase"), "", "E-PERMISSION"),
        (("end", "nobody"), "", "E-NOT-FOUND"),
        *(
            (("add", "dora", "--role", "clinician", "--name", name), "", "E-PARAMETER")
            for name in (" ", "x" * 201, "Dora\nManager")
        ),
    ],
)
def test_what_cannot_be_is_refused_by_its_code(
    data: Path, accounts: AccountStore, add_person: AddPerson, words: tuple[str, ...], typed: str, told: str
) -> None:
    add_person("clara", "assistant")

    code, output = run(data, *words, typed=typed)

    assert (code, told in output) == (3, True)
    assert "dora" not in {person.login for person in accounts.find_people()}


def test_roles_second_factor_and_end_are_changed_by_command(
    person: Person, data: Path, accounts: AccountStore
) -> None:
    run(data, "roles", "clara", "--role", "auditor", "--role", "manager")
    run(data, "reset", "clara", "--second-factor")
    changed = accounts.get_person(person.id)
    session = accounts.begin_session(person.id)
    run(data, "end", "clara")

    assert changed.roles == {"auditor", "manager"}
    assert not changed.has_second_factor
    assert accounts.find_by_session(session) is None
