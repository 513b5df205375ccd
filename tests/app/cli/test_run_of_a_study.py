"""A run over a study: lists, participants, settings; one row for each recording."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from app.cli import app
from tests.app.cli.typed import read_table, run

Studied = tuple[Result, Path]


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
def studied(study: Path, tmp_path_factory: pytest.TempPathFactory) -> Studied:
    out = tmp_path_factory.mktemp("studied")
    options = ("--participants", study / "people.csv", "--config", study / "study.yaml", "-j", "2")
    return run("run", study, "-o", out, *options), out


def test_a_study_has_one_row_for_each_recording_of_whom_the_list_says(studied: Studied) -> None:
    rows = read_table(studied[1] / "summary.csv")

    # the list of participants goes before the settings, in which all are right arms
    assert [(row["file_name"], row["error_code"], row["subject"], row["side"]) for row in rows] == [
        ("broken.gt3x", "E-EMPTY", "", "right"),
        ("p1.gt3x", "", "S01", "left"),
        ("p2.gt3x", "", "", "right"),
    ]


def test_the_settings_file_chooses_language_and_reports(studied: Studied) -> None:
    made = studied[1] / "p1"

    assert 'lang="fr"' in (made / "report.html").read_text("utf-8")
    assert not (made / "report.pdf").exists()


def test_exit_code_total_and_problems_agree_and_what_was_left_aside_is_told(studied: Studied) -> None:
    result, out = studied

    assert result.exit_code == 1
    for told in ("en échec\u00a0: 1", "ignorés\u00a0: 1", "lost.gt3x"):
        assert told in result.stderr
    assert [row["code"] for row in read_table(out / "problems.csv")] == ["E-EMPTY"]


@pytest.mark.parametrize("is_typed", [True, False], ids=["standard input", "file"])
def test_a_list_names_the_recordings_and_what_is_typed_goes_before_the_settings_file(
    study: Path, tmp_path: Path, is_typed: bool
) -> None:
    (tmp_path / "list.txt").write_text(f"{study / 'p2.gt3x'}\n")
    list_ = "-" if is_typed else str(tmp_path / "list.txt")
    asked = [
        "run",
        "--list",
        list_,
        "-o",
        str(tmp_path),
        "--config",
        str(study / "study.yaml"),
        "--side",
        "left",
    ]

    CliRunner().invoke(app, asked, input=(tmp_path / "list.txt").read_text())

    (row,) = read_table(tmp_path / "summary.csv")
    assert (row["file_name"], row["side"]) == ("p2.gt3x", "left")


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
