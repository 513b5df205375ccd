"""The gravest cells of the damage matrix; all of them: ``python -m benchmarks.damage``."""

from pathlib import Path

import pytest

from tests.crash.damage import Cell, Stock, make_stock, observe

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def stock(tmp_path_factory: pytest.TempPathFactory) -> Stock:
    """A store made by a real server and worker."""
    return make_stock(tmp_path_factory.mktemp("stock"))


@pytest.mark.parametrize("damage", ["missing", "emptied", "older", "foreign"])
def test_a_server_whose_database_is_not_the_folders_does_not_start_and_removes_nothing(
    stock: Stock, tmp_path: Path, damage: str
) -> None:
    seen = observe(stock, Cell("database", damage, "start"), tmp_path)  # type: ignore[arg-type]

    assert (seen.word, seen.broken) == ("start refused", [])


def test_recover_brings_back_every_recording_of_a_lost_database(stock: Stock, tmp_path: Path) -> None:
    seen = observe(stock, Cell("database", "missing", "recover"), tmp_path)

    assert (seen.detail, seen.broken) == ("4 of 4 back", [])


def test_a_strangers_files_are_never_removed(stock: Stock, tmp_path: Path) -> None:
    seen = observe(stock, Cell("stranger's files", "foreign", "start"), tmp_path)

    assert (seen.word, seen.broken) == ("starts", [])


def test_an_altered_report_is_not_served(stock: Stock, tmp_path: Path) -> None:
    seen = observe(stock, Cell("report", "one byte altered", "serve"), tmp_path)

    assert (seen.word, seen.broken) == ("problem answers", [])


def test_a_missing_recording_is_named_by_verify_and_doctor(stock: Stock, tmp_path: Path) -> None:
    seen = observe(stock, Cell("raw file", "missing", "verify"), tmp_path)

    assert (seen.word, seen.broken) == ("names it", [])


def test_a_backup_of_a_damaged_store_is_made_and_names_the_damage(stock: Stock, tmp_path: Path) -> None:
    seen = observe(stock, Cell("raw file", "missing", "backup"), tmp_path)

    assert (seen.word, seen.broken) == ("made, names the damage", [])
