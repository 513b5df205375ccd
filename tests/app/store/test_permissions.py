"""Rows, backups and folders of ours are for the user who runs Acromion, whatever the umask."""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from acromion.app.library.database.connect import open_database
from acromion.app.library.jobs import JobStore
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage
from acromion.app.store.permissions import make_folder, restrict_permissions


@pytest.fixture(autouse=True)
def open_umask() -> Iterator[None]:
    """Let whatever is made without a mode of its own be readable to all."""
    before = os.umask(0)
    yield
    os.umask(before)


def mode_of(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_a_new_database_and_its_log_are_made_with_mode_600(settings: Settings) -> None:
    store = JobStore(settings)

    found = {path.name: mode_of(path) for path in settings.data_dir.iterdir()}
    store.close()

    assert found == dict.fromkeys(("acromion.sqlite3", "acromion.sqlite3-wal", "acromion.sqlite3-shm"), 0o600)


def test_folders_of_the_store_are_made_with_mode_700(tmp_path: Path) -> None:
    storage = Storage(tmp_path / "above" / "data")
    storage.prepare()
    storage.open_attempt("an_1", "token")

    folders = [path for path in (tmp_path / "above").rglob("*") if path.is_dir()]

    assert {mode_of(folder) for folder in (tmp_path / "above", *folders)} == {0o700}


def test_a_folder_that_is_there_is_left_as_it_is(tmp_path: Path) -> None:
    make_folder(tmp_path / "given")
    (tmp_path / "given").chmod(0o755)

    make_folder(tmp_path / "given" / "ours")

    assert (mode_of(tmp_path / "given"), mode_of(tmp_path / "given" / "ours")) == (0o755, 0o700)


@pytest.fixture
def open_folder(tmp_path: Path) -> Path:
    """A data folder that is readable to all."""
    folder = tmp_path / "data"
    for name in ("recordings", "copies"):
        (folder / name).mkdir(parents=True)
    for name in ("acromion.sqlite3", "acromion.sqlite3-wal"):
        (folder / name).touch()
    return folder


def test_what_was_left_open_is_closed(open_folder: Path) -> None:
    restrict_permissions(open_folder)

    assert {mode_of(path) for path in (open_folder, open_folder / "recordings", open_folder / "copies")} == {
        0o700
    }
    files = [path for path in open_folder.rglob("*") if path.is_file()]
    assert [mode_of(path) for path in files] == [0o600] * 2


def test_a_folder_that_holds_anything_else_keeps_its_mode(open_folder: Path) -> None:
    (open_folder / "thesis.docx").touch()

    restrict_permissions(open_folder)

    assert (mode_of(open_folder), mode_of(open_folder / "thesis.docx")) == (0o777, 0o666)
    assert (mode_of(open_folder / "recordings"), mode_of(open_folder / "acromion.sqlite3")) == (0o700, 0o600)


def test_what_a_link_leads_to_is_not_ours_to_close(open_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (open_folder / "cache").symlink_to(tmp_path / "elsewhere")

    restrict_permissions(open_folder)

    assert mode_of(tmp_path / "elsewhere") == 0o777


def test_a_database_in_another_folder_is_closed_and_the_folder_is_not(
    open_folder: Path, tmp_path: Path
) -> None:
    database = tmp_path / "elsewhere" / "rows.sqlite3"
    database.parent.mkdir()
    open_database(f"sqlite:///{database}").dispose()
    database.chmod(0o644)

    restrict_permissions(open_folder, database)

    assert (mode_of(database), mode_of(database.parent)) == (0o600, 0o777)
