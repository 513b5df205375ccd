"""No report is overwritten: other settings make a new version, another language is the same report."""

import json
from dataclasses import dataclass
from pathlib import Path

import pytest
from pypdf import PdfReader
from typer.testing import CliRunner

from acromion.app.batch.folder import get_earlier_path, get_last_version, restore_earlier
from acromion.app.cli import app


def run(log: Path, out: Path, *more: str) -> str:
    result = CliRunner().invoke(app, ["run", str(log), "-o", str(out), "--report", "html", *more])
    assert result.exit_code == 0, result.output
    return result.output


def read_report(folder: Path, name: str = "report.html") -> str:
    return (folder / name).read_text("utf-8")


def tell_size(document: Path) -> tuple[int, int]:
    page = PdfReader(document).pages[0].mediabox
    return round(page.width), round(page.height)


@dataclass
class Twice:
    """A recording analysed for two subject codes one after the other."""

    folder: Path
    said: str


@pytest.fixture(scope="module")
def twice(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Twice:
    out = tmp_path_factory.mktemp("twice")
    run(shift_gt3x, out, "--subject", "S011")
    return Twice(out / shift_gt3x.stem, run(shift_gt3x, out, "--subject", "S012"))


def test_other_settings_keep_the_earlier_report_and_the_newest_says_what_is_different(twice: Twice) -> None:
    earlier = json.loads((twice.folder / "v1" / "results.json").read_text("utf-8"))

    assert earlier["recording"]["subject"] == "S011"
    assert "S011" in read_report(twice.folder / "v1")
    newest = "Version 2 of this report; it replaces version 1. What is different: the subject code."
    assert newest in read_report(twice.folder)
    assert "(version 2, because this changed: subject; version 1 is kept in v1)" in twice.said


def test_the_same_by_force_is_the_same_version_and_each_new_one_keeps_all_before_it(
    twice: Twice, shift_gt3x: Path
) -> None:
    before = read_report(twice.folder)

    run(shift_gt3x, twice.folder.parent, "--subject", "S012", "--force")
    forced = read_report(twice.folder), get_last_version(twice.folder)
    run(shift_gt3x, twice.folder.parent, "--subject", "S013")

    assert forced == (before, 1)
    assert {path.name for path in twice.folder.glob("v*/")} == {"v1", "v2"}


@pytest.fixture(scope="module")
def page(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a recording with its page in English."""
    out = tmp_path_factory.mktemp("page")
    run(shift_gt3x, out)
    return out / shift_gt3x.stem


def find_times(*files: Path) -> list[int]:
    return [file.stat().st_mtime_ns for file in files]


def test_another_language_is_written_without_a_new_analysis_and_back_again_nothing(
    page: Path, shift_gt3x: Path
) -> None:
    figures, english = page / "elevation.parquet", page / "report.html"
    analysed, written = find_times(figures), find_times(english)

    said = run(shift_gt3x, page.parent, "--lang", "fr")
    told = [read_report(page), read_report(page, "report.en.html")]
    run(shift_gt3x, page.parent, "--lang", "en")

    assert "déjà fait" in said
    assert find_times(figures) == analysed
    assert ['<html lang="fr">' in told[0], '<html lang="en">' in told[1]] == [True, True]
    assert find_times(english) == written
    assert '<html lang="fr">' in read_report(page, "report.fr.html")


def test_a_pdf_asked_for_later_joins_the_page_and_keeps_its_paper_until_another_is_asked_for(
    page: Path, shift_gt3x: Path
) -> None:
    analysed = find_times(page / "elevation.parquet")

    said = [run(shift_gt3x, page.parent, "--report", "html,pdf")]
    said.append(run(shift_gt3x, page.parent, "--report", "pdf", "--lang", "fr", "--paper", "letter"))
    kept = tell_size(page / "report.en.pdf")
    said.append(run(shift_gt3x, page.parent, "--report", "pdf", "--lang", "en", "--paper", "letter"))

    assert (kept, tell_size(page / "report.pdf")) == ((595, 842), (612, 792))
    assert tell_size(page / "report.fr.pdf") == (612, 792)
    assert "version" not in "".join(said)
    assert find_times(page / "elevation.parquet") == analysed


def test_a_run_cut_between_two_versions_gives_the_earlier_one_back(tmp_path: Path) -> None:
    folder = tmp_path / "S012"
    get_earlier_path(folder).mkdir()

    restore_earlier(folder)

    assert folder.exists()
    assert not get_earlier_path(folder).exists()
