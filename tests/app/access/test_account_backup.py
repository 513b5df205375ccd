"""A backup holds who may log in, and a restore brings them back where nobody is yet."""

import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from sqlalchemy import Table, func, select

from app.access.accounts import AccountStore
from app.access.logins import Caller, Logins
from app.access.tables import known_browsers, sessions, tickets, tries
from app.errors import LoginRefused, WrongSchema
from app.jobs.store import JobStore
from app.jobs.trail import TrailQuestion, find_lines
from app.settings import Settings
from app.upkeep.account_rows import CopiedPeople
from app.upkeep.backup import back_up, find_damage, restore
from tests.app.access.conftest import PASSWORD, SECRET, AddPerson, Clock, make_code
from tests.postgres import PostgresServer

HERE = Caller("192.0.2.1", "")
OTHER = "org_0123456789abcdef"
on_both_databases = pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)


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

    def restore(self) -> CopiedPeople | None:
        """Restore the backup."""
        return restore(self.new, self.file).people

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

    found = move.restore()

    logins = Logins(move.open(), move.new)
    step = logins.give_password("clara", PASSWORD, HERE)
    assert logins.give_code(step.ticket, make_code(move.clock), HERE).session
    assert logins.accounts.get_person(person.id) == person
    assert found == CopiedPeople(1)


@on_both_databases
def test_tokens_and_recovery_codes_come_back(
    move: Move, add_person: AddPerson, accounts: AccountStore, logins: Logins
) -> None:
    person = add_person()
    bearer = accounts.add_token(person.id, "nightly", ["read"], move.clock() + 3600)
    logins.credentials.set_second_factor(person.id, SECRET, 0, ["aaaa-bbbb"])
    move.back_up()

    move.restore()

    store = move.open()
    subject = store.find_by_token(bearer)
    assert subject is not None
    assert subject.permissions == {"own", "read"}
    assert Logins(store, move.new).credentials.use_recovery_code(person.id, "aaaa-bbbb") is True


def test_what_goes_on_now_is_in_no_backup(move: Move, add_person: AddPerson, logins: Logins) -> None:
    person = add_person()
    logins.enter(person.id, HERE)
    logins.make_link(person.id, 3600)
    with pytest.raises(LoginRefused):
        logins.give_password("clara", "a wrong password", HERE)
    tables = (sessions, tickets, tries, known_browsers)
    assert all(count_rows(logins.accounts, table) for table in tables)
    move.back_up()

    move.restore()

    assert [count_rows(move.open(), table) for table in tables] == [0, 0, 0, 0]


def count_rows(accounts: AccountStore, table: Table) -> int:
    return int(accounts.database.read_value(select(func.count()).select_from(table)))


@on_both_databases
def test_people_who_are_there_stay_as_they_are(move: Move, add_person: AddPerson) -> None:
    add_person("clara")
    add_person("dora")
    move.back_up()
    there = move.open()
    there.add_organisation("own", "Own")
    there.add_person("own", "boss", "Boss", ["manager"])

    found = move.restore()

    assert [one.login for one in there.find_people()] == ["boss"]
    assert found == CopiedPeople(2, present=1)


def test_an_organisation_that_is_there_stays_as_it_is(move: Move, add_person: AddPerson) -> None:
    add_person("clara")
    add_person("dora", organisation=OTHER)
    move.back_up()
    there = move.open()
    there.add_organisation("own", "Riverside")

    move.restore()

    assert {one.id: one.name for one in there.find_organisations()} == {"own": "Riverside", OTHER: OTHER}
    assert [one.login for one in there.find_people()] == ["clara", "dora"]


def test_the_trail_says_how_many_people_came_back(move: Move, add_person: AddPerson) -> None:
    add_person()
    move.back_up()

    move.restore()

    store = JobStore(move.new)
    lines = find_lines(store.reader, TrailQuestion(act="store.restored"))
    assert [line.other for line in lines] == ['{"people": "1"}']
    store.close()


def test_a_backup_of_an_installation_without_accounts_makes_none(move: Move) -> None:
    move.back_up()

    assert move.restore() is None
    assert not (move.new.data_dir / "accounts.sqlite3").exists()


def test_accounts_of_another_version_are_refused_before_any_is_written(
    move: Move, add_person: AddPerson
) -> None:
    add_person()
    move.back_up()
    move.rewrite("manifest.json", b'"accounts": "1"', b'"accounts": "99"')

    with pytest.raises(WrongSchema):
        move.restore()

    assert not (move.new.data_dir / "accounts.sqlite3").exists()


def test_verify_finds_a_damaged_row_of_the_accounts(move: Move, add_person: AddPerson) -> None:
    add_person()
    move.back_up()
    move.rewrite("manifest.json", b"backup", b"backup")
    move.file.write_bytes(move.file.read_bytes().replace(b'"login": "clara"', b'"login": "clarx"'))

    found = find_damage(move.file)

    assert [(fault.name, fault.finding) for fault in found.faults] == [("accounts/people.jsonl", "damaged")]
