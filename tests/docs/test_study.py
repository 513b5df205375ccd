"""The scripts and the page of a study, beside a study of two people that a run has analysed."""

import csv
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest

from acromion.app.report.export.tables import Row, encode_datapackage, encode_rows
from benchmarks.study import CODE, analyse_study, call, compare_tables, simulate_study, write_paper
from tests.docs.test_code_blocks import run_page

Table = list[dict[str, str]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people on two days, one file damaged and one stored twice; the run, and the script's files."""
    mpl.use("Agg")
    folder = tmp_path_factory.mktemp("study")
    simulate_study(folder / "data", 2, 22.0, ("right",))
    analyse_study(folder / "data", folder / "out")
    write_paper(folder / "out")
    return folder


@pytest.fixture(scope="module")
def table(folder: Path) -> Table:
    with (folder / "table.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def page(folder: Path) -> dict[str, Any]:
    shutil.copytree(folder / "out", folder / "results")
    return run_page("docs/code/study.md", folder)


def test_each_number_of_the_table_of_a_paper_is_the_one_computed_apart_from_the_angles(folder: Path) -> None:
    compared = compare_tables(folder)

    assert len(compared) == 4 * (2 + 3 * 3)  # figures: people, days; mean and deviations with their ranges
    assert [one[3] for one in compared] == pytest.approx([one[4] for one in compared], abs=0.06, rel=0.02)


def test_a_damaged_and_a_doubled_file_are_not_in_the_table(folder: Path, page: dict[str, Any]) -> None:
    names = set(page["study"].summary["file_name"])

    problems = page["study"].problems.set_index("file_name")["code"]
    assert problems["copy_of_P01_day2_right.csv"] == "E-DOUBLE"
    assert set(problems.index) == {"P01_day1_right.csv", "copy_of_P01_day2_right.csv"}
    assert "P01_day2_right.csv" in names
    assert page["people"].keys() == {"P01", "P02"}


def test_the_page_compares_the_days_of_the_person_who_has_both(page: dict[str, Any]) -> None:
    (value, later) = page["people"]["P02"]

    assert page["change"].people == 1
    assert page["change"].change == pytest.approx(later - value)


def test_figure_and_methods_are_made(folder: Path) -> None:
    assert (folder / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "methods.md").read_text("utf-8") == (folder / "out" / "methods.md").read_text("utf-8")


@pytest.mark.parametrize("name", ["paper.py", "paper.R"])
def test_a_script_of_a_paper_has_fewer_than_sixty_lines(name: str) -> None:
    assert len((CODE / name).read_text("utf-8").splitlines()) < 60


@pytest.mark.parametrize(
    ("program", "name"),
    [(sys.executable, "paper.py"), pytest.param("Rscript", "paper.R", marks=pytest.mark.slow)],
)
def test_a_script_of_a_paper_says_if_no_day_counts(tmp_path: Path, program: str, name: str) -> None:
    if shutil.which(program) is None:
        pytest.skip(f"{program} is absent")
    rows: list[Row] = [{"subject": "P01", "side": "right", "left_out": "short", "verdict": "good"}]
    for table in ("summary", "days"):
        (tmp_path / f"{table}.csv").write_bytes(encode_rows(table, rows))
    (tmp_path / "datapackage.json").write_bytes(encode_datapackage(["summary.csv", "days.csv"]))
    (tmp_path / "run.json").write_text("{}")

    command = [program, str(CODE / name), str(tmp_path)]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)

    told = "No day of a right arm counts: see left_out and verdict in days.csv, and problems.csv.\n"
    assert (ended.returncode, ended.stderr) == (1, told)


@pytest.mark.slow
def test_the_script_for_r_gives_the_table_of_the_one_for_python(folder: Path, table: Table) -> None:
    if shutil.which("Rscript") is None:
        pytest.skip("R is absent")
    call("Rscript", CODE / "paper.R", folder / "out", cwd=folder)

    with (folder / "table_r.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for ours, theirs in zip(table, rows, strict=True):
        for column in ("mean", "sd_between", "sd_within"):
            assert float(ours[column].split()[0]) == pytest.approx(float(theirs[column]), abs=0.051)
