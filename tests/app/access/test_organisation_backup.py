"""Each organisation has a backup of its own; that of "own" names those it does not hold."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text
from typer.testing import CliRunner

from app.access.accounts import AccountStore
from app.cli import app
from app.jobs.database.connect import make_schema
from app.jobs.side_files import SideWriter
from app.jobs.store import JobStore
from app.request import ReportRequest
from app.settings import Settings
from app.storage.open import open_storage
from app.storage.permissions import make_folder
from app.upkeep.organisations import find_further
from tests.app.conftest import on_both_set_ups
from tests.app.test_upkeep import drop_fact
from tests.postgres import PostgresServer
from tests.swift import SwiftServer

RIVERSIDE = "org_0123456789abcdef"


@contextmanager
def open_rows(settings: Settings) -> Iterator[JobStore]:
    store = JobStore(settings)
    try:
        yield store
    finally:
        store.close()


def add_recording(settings: Settings, content: bytes) -> str:
    """Make the place of an organisation, and keep a recording in it; gives the analysis that waits."""
    make_folder(settings.data_dir)
    make_schema(settings.database_url)
    storage = open_storage(settings)
    storage.prepare()
    upload = storage.open_upload(1000)
    upload.write(content)
    with open_rows(settings) as store:
        return store.add(upload.keep(), ReportRequest("shift.gt3x", "S-1")).id


@pytest.fixture
def two(settings: Settings, accounts: AccountStore, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """An installation with a further organisation, each with a recording."""
    accounts.add_organisation("own", "Own")
    accounts.add_organisation(RIVERSIDE, "Riverside clinic")
    add_recording(settings, b"of own")
    add_recording(settings.for_organisation(RIVERSIDE), b"of Riverside")
    for name, value in settings.as_environment().items():
        monkeypatch.setenv(name, value)
    return settings


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(word) for word in words])
    return done.exit_code, done.output


def empty_everything(settings: Settings, request: pytest.FixtureRequest) -> Settings:
    """Give settings of an empty place of the same kind, which commands use from now on."""
    place = settings.data_dir.with_name("restored")
    changes = {"data_dir": place, "database_url": f"sqlite:///{place / 'acromion.sqlite3'}"}
    if settings.object_store:
        swift: SwiftServer = request.getfixturevalue("swift")
        postgres: PostgresServer = request.getfixturevalue("postgres")
        postgres.empty()
        changes |= {"database_url": settings.database_url, "object_store": swift.make_bucket()}
    new = settings.model_copy(update=changes)
    os.environ.update(new.as_environment())  # put right again by the fixture that set them first
    return new


@on_both_set_ups
def test_a_further_organisation_is_restored_into_its_own_place(
    two: Settings, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    chosen = ("--organisation", RIVERSIDE)
    assert run("backup", tmp_path / "r.zip", *chosen)[0] == 0
    new = empty_everything(two, request)

    code, told = run("restore", tmp_path / "r.zip", *chosen)

    assert code == 0, told
    assert run("verify", *chosen) == (0, "1 files checked: each holds the bytes its row says.\n")
    with open_rows(new.for_organisation(RIVERSIDE)) as store:
        (job,) = map(store.get, store.find_analyses())
        assert (job.file_name, job.request.subject) == ("shift.gt3x", "S-1")
    assert not (new.data_dir / "recordings").exists()


@on_both_set_ups
def test_the_backup_of_own_names_last_what_it_does_not_hold(two: Settings, tmp_path: Path) -> None:
    code, told = run("backup", tmp_path / "b.zip")

    assert code == 0
    assert told.splitlines()[-1] == (
        f"Not in it, for each has a backup of its own (--organisation ID): Riverside clinic ({RIVERSIDE})"
    )


def test_the_backup_of_a_further_organisation_holds_no_accounts(two: Settings, tmp_path: Path) -> None:
    _, told = run("backup", tmp_path / "r.zip", "--organisation", RIVERSIDE)

    assert "Accounts" not in told
    assert "Riverside" not in told.splitlines()[-1]


def test_accounts_come_back_into_own_alone(
    two: Settings, accounts: AccountStore, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    accounts.add_person("own", "clara", "Clara", ["clinician"])
    run("backup", tmp_path / "b.zip")
    new = empty_everything(two, request)

    run("restore", tmp_path / "b.zip")

    assert list(new.data_dir.rglob("accounts.sqlite3")) == [new.data_dir / "accounts.sqlite3"]


@pytest.mark.parametrize(("of", "into"), [("own", RIVERSIDE), (RIVERSIDE, "own")])
def test_a_backup_is_not_restored_into_another_organisation(
    two: Settings, tmp_path: Path, request: pytest.FixtureRequest, of: str, into: str
) -> None:
    run("backup", tmp_path / "b.zip", "--organisation", of)
    new = empty_everything(two, request)

    code, told = run("restore", tmp_path / "b.zip", "--organisation", into)

    assert (code, told.split()[0]) == (3, "E-BACKUP-OTHER")
    assert f'that of "{of}", and was to be restored into "{into}"' in told
    assert not new.data_dir.exists()


def test_a_backup_that_names_nobody_is_that_of_own(
    two: Settings, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    run("backup", tmp_path / "b.zip")
    drop_fact(tmp_path / "b.zip", tmp_path / "old.zip", "organisation")
    empty_everything(two, request)

    words = ("restore", tmp_path / "old.zip")

    assert run(*words, "--organisation", RIVERSIDE)[1].split()[0] == "E-BACKUP-OTHER"
    assert run(*words)[0] == 0


def test_a_drill_takes_the_backup_of_a_further_organisation(two: Settings, tmp_path: Path) -> None:
    chosen = ("--organisation", RIVERSIDE)
    run("backup", tmp_path / "r.zip", *chosen)

    code, told = run("drill", tmp_path / "r.zip")

    assert code == 0
    assert "Drill passed: 1 files" in told


@pytest.mark.parametrize("name", ["org_none", "../../elsewhere", "org_/../.."])
def test_an_organisation_that_is_not_there_is_not_backed_up(two: Settings, tmp_path: Path, name: str) -> None:
    code, told = run("backup", tmp_path / "b.zip", "--organisation", name)

    assert code == 3
    assert "E-NOT-FOUND" in told
    assert [path.name for path in (two.data_dir / "organisations").iterdir()] == [RIVERSIDE]


@on_both_set_ups
def test_nor_is_it_recovered(two: Settings) -> None:
    code, told = run("recover", "--organisation", "org_0000000000000000")

    assert (code, told.split()[0]) == (3, "E-NOT-FOUND")
    assert "org_0000000000000000" in told
    assert [one.id for one in find_further(two)] == [RIVERSIDE]


@on_both_set_ups
def test_one_whose_rows_and_accounts_were_lost_is_recovered(two: Settings) -> None:
    place = two.for_organisation(RIVERSIDE)
    with open_rows(place) as store:
        SideWriter(store.engine, store.reader, open_storage(place)).write(*store.find_recordings())
    lose_rows(two)

    code, told = run("recover", "--organisation", RIVERSIDE)

    assert code == 0, told
    assert told.startswith("Recordings brought back: 1 ")


def lose_rows(settings: Settings) -> None:
    """Lose the databases of everybody, with the accounts; on PostgreSQL the keys stay."""
    for file in settings.data_dir.rglob("*.sqlite3*"):
        file.unlink()
    if settings.database_url.startswith("sqlite"):
        return
    engine = create_engine(settings.database_url)
    with engine.begin() as connection:
        connection.execute(text("DROP SCHEMA accounts CASCADE"))
        connection.execute(text(f"TRUNCATE {RIVERSIDE}.recordings, {RIVERSIDE}.analyses CASCADE"))
    engine.dispose()


def test_nothing_is_restored_outside_the_folder_of_organisations(two: Settings, tmp_path: Path) -> None:
    run("backup", tmp_path / "b.zip")

    code, told = run("restore", tmp_path / "b.zip", "--organisation", "../../elsewhere")

    assert code == 3
    assert "E-NOT-FOUND" in told
