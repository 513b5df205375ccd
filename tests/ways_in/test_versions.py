"""No report is overwritten: other settings make a new version, another language is the same report."""

import json
from pathlib import Path

import pytest
from pypdf import PdfReader
from typer.testing import CliRunner

from app.batch.folder import find_earlier, find_last_version, restore_earlier
from app.cli import app

Folder = Path


def run(log: Path, out: Path, *more: str) -> str:
    result = CliRunner().invoke(app, ["run", str(log), "-o", str(out), "--report", "html", *more])
    assert result.exit_code == 0, result.output
    return result.output


def read_report(folder: Folder, name: str = "report.html") -> str:
    return (folder / name).read_text("utf-8")


@pytest.fixture(scope="module")
def twice(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Folder, str]:
    """A recording done twice, with two subject codes; its folder and what was said the second time."""
    out = tmp_path_factory.mktemp("twice")
    run(shift_gt3x, out, "--subject", "S011")
    return out / shift_gt3x.stem, run(shift_gt3x, out, "--subject", "S012")


def test_other_settings_keep_the_earlier_report(twice: tuple[Folder, str]) -> None:
    folder, _ = twice

    earlier = json.loads((folder / "v1" / "results.json").read_text("utf-8"))

    assert earlier["recording"]["subject"] == "S011"
    assert "S011" in read_report(folder / "v1")


def test_the_newest_report_has_the_plain_names_and_says_what_is_different(twice: tuple[Folder, str]) -> None:
    folder, _ = twice

    assert "Version 2 of this report; it replaces version 1. What is different: the subject code." in (
        read_report(folder)
    )


def test_the_command_says_where_the_earlier_report_is(twice: tuple[Folder, str]) -> None:
    assert "(version 2, for this is different: subject; version 1 is kept in v1)" in twice[1]


def test_each_new_version_keeps_all_before_it(
    twice: tuple[Folder, str], shift_gt3x: Path, tmp_path: Path
) -> None:
    for code in ("A", "B", "C"):
        run(shift_gt3x, tmp_path, "--subject", code)

    kept = {path.name for path in (tmp_path / shift_gt3x.stem).glob("v*/")}

    assert kept == {"v1", "v2"}


def test_asking_again_for_the_same_by_force_is_the_same_version(
    twice: tuple[Folder, str], shift_gt3x: Path
) -> None:
    folder, _ = twice
    before = read_report(folder)

    run(shift_gt3x, folder.parent, "--subject", "S012", "--force")

    assert read_report(folder) == before
    assert find_last_version(folder) == 1


def test_another_language_is_told_without_a_new_analysis(shift_gt3x: Path, tmp_path: Path) -> None:
    run(shift_gt3x, tmp_path)
    folder = tmp_path / shift_gt3x.stem
    parquet_made = (folder / "elevation.parquet").stat().st_mtime_ns

    said = run(shift_gt3x, tmp_path, "--lang", "fr")

    assert "déjà fait" in said
    assert (folder / "elevation.parquet").stat().st_mtime_ns == parquet_made
    assert '<html lang="fr">' in read_report(folder)
    assert '<html lang="en">' in read_report(folder, "report.en.html")


def test_back_in_the_first_language_nothing_is_written_anew(shift_gt3x: Path, tmp_path: Path) -> None:
    run(shift_gt3x, tmp_path)
    folder = tmp_path / shift_gt3x.stem
    english_made = (folder / "report.html").stat().st_mtime_ns
    run(shift_gt3x, tmp_path, "--lang", "fr")

    run(shift_gt3x, tmp_path, "--lang", "en")

    assert (folder / "report.html").stat().st_mtime_ns == english_made
    assert '<html lang="fr">' in read_report(folder, "report.fr.html")


def test_a_pdf_asked_for_later_joins_the_page(shift_gt3x: Path, tmp_path: Path) -> None:
    run(shift_gt3x, tmp_path)

    run(shift_gt3x, tmp_path, "--report", "html,pdf")

    assert (tmp_path / shift_gt3x.stem / "report.pdf").read_bytes().startswith(b"%PDF-")


def tell_size(document: Path) -> tuple[int, int]:
    page = PdfReader(document).pages[0].mediabox
    return round(page.width), round(page.height)


def test_another_paper_is_the_same_report_and_told_without_a_new_analysis(
    shift_gt3x: Path, tmp_path: Path
) -> None:
    run(shift_gt3x, tmp_path, "--report", "pdf")
    folder = tmp_path / shift_gt3x.stem
    parquet_made = (folder / "elevation.parquet").stat().st_mtime_ns

    said = run(shift_gt3x, tmp_path, "--report", "pdf", "--paper", "letter")

    assert "version" not in said
    assert tell_size(folder / "report.pdf") == (612, 792)
    assert (folder / "elevation.parquet").stat().st_mtime_ns == parquet_made


def test_a_pdf_in_another_language_keeps_its_own_paper_until_asked_for(
    shift_gt3x: Path, tmp_path: Path
) -> None:
    folder = tmp_path / shift_gt3x.stem
    run(shift_gt3x, tmp_path, "--report", "pdf")
    run(shift_gt3x, tmp_path, "--report", "pdf", "--lang", "fr", "--paper", "letter")
    kept = tell_size(folder / "report.en.pdf")

    run(shift_gt3x, tmp_path, "--report", "pdf", "--lang", "en", "--paper", "letter")

    assert (kept, tell_size(folder / "report.pdf")) == ((595, 842), (612, 792))
    assert tell_size(folder / "report.fr.pdf") == (612, 792)


def test_a_run_cut_between_two_versions_gives_the_earlier_one_back(tmp_path: Path) -> None:
    folder = tmp_path / "S012"
    find_earlier(folder).mkdir()

    restore_earlier(folder)

    assert folder.exists()
    assert not find_earlier(folder).exists()
