"""A run over a study: lists, participants, settings; one row for each recording."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from app.cli import app
from tests.ways_in.typed import read_table, run


@pytest.fixture(scope="module")
def study(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings, one that is none, a list of participants and a file of settings."""
    folder = tmp_path_factory.mktemp("study")
    for name in ("p1.gt3x", "p2.gt3x"):
        shutil.copy(shift_gt3x, folder / name)
    (folder / "broken.gt3x").write_bytes(b"")
    (folder / "notes.docx").write_bytes(b"no recording")
    (folder / "people.csv").write_text("file,subject,side\np1.gt3x,S01,left\nlost.gt3x,S09,left\n")
    (folder / "study.yaml").write_text("lang: fr\nreport: [html]\nside: right\n")
    return folder


@pytest.fixture(scope="module")
def studied(study: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    out = tmp_path_factory.mktemp("studied")
    options = ("--participants", study / "people.csv", "--config", study / "study.yaml", "-j", "2")
    return run("run", study, "-o", out, *options), out


def test_a_study_has_one_row_for_each_recording_and_the_code_of_a_failure(
    studied: tuple[Result, Path],
) -> None:
    rows = read_table(studied[1] / "summary.csv")

    assert [(row["file_name"], row["error_code"]) for row in rows] == [
        ("broken.gt3x", "E-EMPTY"),
        ("p1.gt3x", ""),
        ("p2.gt3x", ""),
    ]


def test_the_participants_go_before_the_settings(studied: tuple[Result, Path]) -> None:
    rows = {row["file_name"]: row for row in read_table(studied[1] / "summary.csv")}

    assert (rows["p1.gt3x"]["subject"], rows["p1.gt3x"]["side"]) == ("S01", "left")
    assert rows["p2.gt3x"]["side"] == "right"


def test_the_settings_file_chooses_language_and_reports(studied: tuple[Result, Path]) -> None:
    made = studied[1] / "p1"

    assert 'lang="fr"' in (made / "report.html").read_text("utf-8")
    assert not (made / "report.pdf").exists()


def test_what_is_typed_goes_before_the_settings_file(study: Path, tmp_path: Path) -> None:
    run("run", study / "p1.gt3x", "-o", tmp_path, "--config", study / "study.yaml", "--side", "left")

    assert read_table(tmp_path / "summary.csv")[0]["side"] == "left"


def test_a_row_that_fits_no_recording_is_told(studied: tuple[Result, Path]) -> None:
    assert "lost.gt3x" in studied[0].stderr


def test_exit_code_total_and_problems_come_from_one_list(studied: tuple[Result, Path]) -> None:
    result, out = studied

    assert result.exit_code == 1
    assert "en échec\u00a0: 1" in result.stderr
    assert [row["code"] for row in read_table(out / "problems.csv")] == ["E-EMPTY"]


def test_files_that_are_no_recordings_are_counted(studied: tuple[Result, Path]) -> None:
    assert "laissés de côté\u00a0: 1" in studied[0].stderr


def test_a_list_names_the_recordings(study: Path, tmp_path: Path) -> None:
    (study / "list.txt").write_text("p2.gt3x\n")

    run("run", "--list", study / "list.txt", "-o", tmp_path, "--report", "html")

    assert [row["file_name"] for row in read_table(tmp_path / "summary.csv")] == ["p2.gt3x"]


def test_the_list_may_come_on_standard_input(study: Path, tmp_path: Path) -> None:
    arguments = ["run", "--list", "-", "-o", str(tmp_path), "--report", "html"]

    CliRunner().invoke(app, arguments, input=f"{study / 'p2.gt3x'}\n")

    assert [row["file_name"] for row in read_table(tmp_path / "summary.csv")] == ["p2.gt3x"]


def test_a_dry_run_says_what_would_be_done_and_writes_nothing(study: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"

    result = run("run", study / "p1.gt3x", "-o", out, "--dry-run")

    assert result.output.startswith("would do: ")
    assert not out.exists()


@pytest.mark.parametrize(
    ("option", "content", "code"),
    [
        ("--config", "metod: live\n", "E-SETTINGS"),
        ("--participants", "subject\nS01\n", "E-PARTICIPANTS"),
        ("--list", "nowhere.gt3x\n", "E-LIST"),
    ],
)
def test_a_file_that_steers_the_run_is_checked_before_any_recording(
    shift_gt3x: Path, tmp_path: Path, option: str, content: str, code: str
) -> None:
    (tmp_path / "steering").write_text(content)

    result = run("run", shift_gt3x, "-o", tmp_path / "out", option, tmp_path / "steering")

    assert (result.exit_code, code in result.stderr) == (2, True)
