"""A backup holds who may sign in, and a restore brings them back."""

import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from sqlalchemy import Table, func, select
from typer.testing import CliRunner

from acromion.app.accounts.accounts import AccountStore, Person
from acromion.app.accounts.sign_in import Caller, SignIn
from acromion.app.cli import app
from acromion.app.errors import AccountsLost, LoginRefused, NotEmpty
from acromion.app.library.database.tables import known_browsers, sessions, tickets, tries
from acromion.app.library.jobs import JobStore
from acromion.app.main import create_app
from acromion.app.ops.backup import back_up, find_damage, restore
from acromion.app.ops.place import Accounts
from acromion.app.settings import Settings
from tests.app.accounts.conftest import PASSWORD, SECRET, AddPerson, Clock, make_code
from tests.app.conftest import on_both_databases
from tests.postgres import PostgresServer

HERE = Caller("192.0.2.1", "")


@dataclass
class Move:
    """A backup of an installation, and an empty place of the same kind that it may be restored into."""

    settings: Settings
    file: Path
    clock: Clock
    empty: Callable[[], Settings]
    opened: list[AccountStore] = field(default_factory=list)
    new: Settings = field(init=False)

    def back_up(self) -> None:
        """Back up rows and files."""
        JobStore(self.settings).close()
        back_up(self.settings, self.file)
        self.new = self.empty()

    def restore(self) -> Accounts:
        """Restore the backup."""
        return restore(self.new, self.file).accounts

    def open(self) -> AccountStore:
        """Open the accounts of the new place."""
        self.opened.append(AccountStore(self.new, self.clock))
        return self.opened[-1]

    def rewrite(self, name: str, before: bytes, after: bytes) -> None:
        """Write the backup anew, unpacked, with other bytes in one of its members."""
        with zipfile.ZipFile(self.file) as old:
            members = {one: old.read(one) for one in old.namelist()}
        assert before in members[name]
        with zipfile.ZipFile(self.file, "w") as changed:
            for one, content in members.items():
                changed.writestr(one, content.replace(before, after) if one == name else content)


@pytest.fixture
def move(settings: Settings, tmp_path: Path, clock: Clock, request: pytest.FixtureRequest) -> Iterator[Move]:
    """A move of this installation."""

    def empty() -> Settings:
        place = settings.data_dir.with_name("restored")
        if settings.database_url.startswith("sqlite"):
            url = f"sqlite:///{place / 'acromion.sqlite3'}"
            return settings.model_copy(update={"data_dir": place, "database_url": url})
        server: PostgresServer = request.getfixturevalue("postgres")
        server.empty()
        return settings.model_copy(update={"data_dir": place})

    moved = Move(settings, tmp_path / "b.zip", clock, empty)
    yield moved
    for one in moved.opened:
        one.database.close()


@on_both_databases
def test_people_log_in_after_a_restore_as_before(move: Move, add_person: AddPerson) -> None:
    person = add_person("clara", "clinician", "manager")
    move.back_up()

    move.restore()

    sign_in = SignIn(move.open(), move.new)
    step = sign_in.submit_password("clara", PASSWORD, HERE)
    assert sign_in.submit_code(step.ticket, make_code(move.clock), HERE).session
    assert sign_in.accounts.get_person(person.id) == person


def test_tokens_and_recovery_codes_come_back(
    person: Person, move: Move, accounts: AccountStore, sign_in: SignIn
) -> None:
    bearer = accounts.add_token(person.id, "nightly", ["read"], move.clock() + 3600)
    sign_in.credentials.set_second_factor(person.id, SECRET, 0, ["aaaa-bbbb"])
    move.back_up()

    found = move.restore()

    store = move.open()
    assert found.people == (("clara", "clinician"),)
    assert [token[:3] for token in found.tokens] == [("nightly", "clara", "read")]
    subject = store.find_by_token(bearer)
    assert subject is not None
    assert subject.permissions == {"own", "read"}
    assert SignIn(store, move.new).credentials.use_recovery_code(person.id, "aaaa-bbbb") is True


def test_what_goes_on_now_is_in_no_backup(person: Person, move: Move, sign_in: SignIn) -> None:
    sign_in.enter(person.id, HERE)
    sign_in.make_link(person.id, 3600)
    with pytest.raises(LoginRefused):
        sign_in.submit_password("clara", "a wrong password", HERE)
    tables = (sessions, tickets, tries, known_browsers)
    assert all(count_rows(sign_in.accounts, table) for table in tables)
    move.back_up()

    move.restore()

    assert [count_rows(move.open(), table) for table in tables] == [0, 0, 0, 0]


def count_rows(accounts: AccountStore, table: Table) -> int:
    return int(accounts.database.read_value(select(func.count()).select_from(table)))


def test_nothing_is_restored_over_people(move: Move, add_person: AddPerson) -> None:
    add_person("clara")
    move.back_up()
    there = move.open()
    there.add_person("boss", "Boss", ["manager"])

    with pytest.raises(NotEmpty):
        move.restore()

    assert [one.login for one in there.find_people()] == ["boss"]


def test_the_command_lists_the_accounts_and_tokens_that_came_back(
    move: Move, add_person: AddPerson, accounts: AccountStore
) -> None:
    accounts.add_token(add_person().id, "nightly", ["read"], move.clock() + 3600)
    move.back_up()

    words = ["restore", str(move.file)]
    told = CliRunner().invoke(app, [*words, "--data", str(move.new.data_dir)]).output

    assert "Account: clara (clinician)" in told
    assert "Token: nightly of clara, until" in told


# A database that lost its accounts.


def lose_database(settings: Settings) -> None:
    for path in settings.data_dir.glob("acromion.sqlite3*"):
        path.unlink()


def test_a_server_that_lost_its_accounts_does_not_start_without_them(
    person: Person, settings: Settings, accounts: AccountStore
) -> None:
    accounts.database.close()
    lose_database(settings)

    with pytest.raises(AccountsLost) as refused:
        create_app(settings)

    assert refused.value.facts == {"file": str(settings.data_dir / "has_accounts")}


def test_a_restored_place_does_not_start_without_its_accounts_either(person: Person, move: Move) -> None:
    move.back_up()
    move.restore()
    lose_database(move.new)

    with pytest.raises(AccountsLost):
        create_app(move.new)


def test_accounts_that_are_lost_may_be_added_again(
    person: Person, settings: Settings, accounts: AccountStore
) -> None:
    accounts.database.close()
    lose_database(settings)

    words = ["account", "add", "boss", "--role", "manager", "--data", str(settings.data_dir)]
    assert CliRunner().invoke(app, words).exit_code == 0

    create_app(settings).state.services.store.close()


def test_verify_finds_a_damaged_row_of_the_accounts(person: Person, move: Move) -> None:
    move.back_up()
    move.rewrite("manifest.json", b"backup", b"backup")
    move.file.write_bytes(move.file.read_bytes().replace(b'"login": "clara"', b'"login": "clarx"'))

    found = find_damage(move.file)

    assert [(fault.name, fault.finding) for fault in found.faults] == [("rows/people.jsonl", "damaged")]


def test_the_doctor_names_lost_accounts_and_the_cure(
    person: Person, settings: Settings, accounts: AccountStore
) -> None:
    accounts.exist()
    accounts.database.close()
    lose_database(settings)

    done = CliRunner().invoke(app, ["doctor", "--data", str(settings.data_dir)])

    assert done.exit_code == 1
    assert str(settings.data_dir / "has_accounts") in done.output
    assert "acromion account add" in done.output


@pytest.mark.parametrize("key", [None, b"x" * 45])
def test_the_doctor_names_a_server_key_that_fits_no_second_factor_and_the_cure(
    person: Person, settings: Settings, key: bytes | None
) -> None:
    doctor = ["doctor", "--data", str(settings.data_dir)]
    before = CliRunner().invoke(app, doctor)
    secret = settings.data_dir / "server.key"
    secret.unlink() if key is None else secret.write_bytes(key)

    done = CliRunner().invoke(app, doctor)

    assert "ok    server.key can decrypt" in before.output
    assert done.exit_code == 1
    assert f"(not with {secret}: second factors 1, webhooks 0)" in done.output
    assert "acromion account reset LOGIN --second-factor" in done.output
