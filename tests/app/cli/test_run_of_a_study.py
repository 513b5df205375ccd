"""A run over a study: lists, participants, settings; one row for each recording."""

import shutil
from pathlib import Path

import openpyxl
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner, Result

from acromion.app.cli import app
from acromion.app.report.export.tables import name_variables
from acromion.fusion import Study
from tests.app.cli.typed import copy_gt3x, read_table, run

Studied = tuple[Result, Path]
SHEETS = ("summary.xlsx, bins", "summary.xlsx, warnings")


@pytest.fixture(scope="module")
def study(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings, one that is none, a list of participants and a file of settings."""
    folder = tmp_path_factory.mktemp("study")
    for name in ("p1.gt3x", "p2.gt3x"):
        copy_gt3x(shift_gt3x, folder / name)
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


@pytest.fixture(scope="module")
def described(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings, one of them twice, and a list with further columns, an unknown file and a diary."""
    folder = tmp_path_factory.mktemp("described")
    copy_gt3x(shift_gt3x, folder / "p1.gt3x")
    shutil.copy(folder / "p1.gt3x", folder / "p1 copy.gt3x")
    copy_gt3x(shift_gt3x, folder / "p2.gt3x")
    (folder / "p1_diary.csv").write_text("start_s,end_s,kind,label\n10,60,task,Painting\n60,120,break,\n")
    (folder / "people.csv").write_text(
        "file,subject,side,diary,axis,age,group,score,badge\n"
        "p1.gt3x,S01,left,p1_diary.csv,,34,=A1,-1.5,007\nlost.gt3x,S09,left,,y,,,,\n"
    )
    return folder


def test_a_dry_run_shows_who_pose_diary_settings_and_further_columns_of_each(
    described: Path, tmp_path: Path
) -> None:
    result = run(
        *("run", described, "-o", tmp_path / "out", "--participants", described / "people.csv"),
        *("--pose-held", "start", "--dry-run"),
    )

    shown = [line.strip() for line in result.stdout.splitlines() if line.startswith("  ")]
    assert shown[1:] == [
        (
            "subject: S01, side: left, pose: n-pose, diary: 2, pose_held: start, "
            "age: 34, group: =A1, score: -1.5, badge: 007"
        ),
        "subject: -, side: -, pose: n-pose, diary: 0, pose_held: start",
    ]
    assert "would not do, the same recording again: " in result.stdout


def test_a_dry_run_lists_rows_without_a_file_and_files_without_a_row(described: Path, tmp_path: Path) -> None:
    result = run(
        *("run", described, "-o", tmp_path / "out", "--participants", described / "people.csv", "--dry-run")
    )

    assert "Line 3 of the participant list matches no recording: lost.gt3x" in result.stderr
    assert "No row in the participant list: p2.gt3x" in result.stderr
    assert "p1 copy.gt3x" not in result.stderr  # the same recording as p1, which has a row


@pytest.fixture(scope="module")
def carried(described: Path, tmp_path_factory: pytest.TempPathFactory) -> Studied:
    out = tmp_path_factory.mktemp("carried")
    options = ("--participants", described / "people.csv", "--report", "html", "-j", "1")
    return run("run", described, "-o", out, *options), out


def test_further_columns_of_the_list_are_carried_into_every_table(carried: Studied) -> None:
    of_list = {
        name: {(row["path"], row["age"], row["group"]) for row in read_table(carried[1] / name)}
        for name in ("summary.csv", "hours.csv", "problems.csv")
    }

    first, second, copy = ("p1.gt3x", "34", "'=A1"), ("p2.gt3x", "", ""), ("p1 copy.gt3x", "", "")
    assert of_list["summary.csv"] == {first, second, copy}
    assert of_list["hours.csv"] == {first, second}
    assert of_list["problems.csv"] == {copy}


def test_further_columns_are_explained_and_are_fields_of_the_form_of_redcap(carried: Studied) -> None:
    out = carried[1]
    explained = {
        (row["file"], row["kind"], row["unit"], row["english"])
        for row in read_table(out / "dictionary.csv")
        if row["column"] == "score"
    }
    tables = ("summary", "days", "hours", "periods", "tasks", "postures", "marks", "pairs", "problems")
    files = {*(f"{name}.csv" for name in (*tables, "redcap_import")), *SHEETS}

    assert explained == {(file, "number", "", "from the list of participants, as given") for file in files}
    form = {row["Variable / Field Name"]: row for row in read_table(out / "redcap_dictionary.csv")}
    assert form["score"]["Text Validation Type OR Show Slider Number"] == "number"
    assert {(row["score"], row["badge"]) for row in read_table(out / "redcap_import.csv")} == {
        ("-1.5", "007"),
        ("", ""),
    }


def test_a_header_becomes_a_name_that_redcap_and_bids_accept() -> None:
    names = name_variables(["Age (years)", "Groupe d'âge", "2nd visit", "年齢"])

    assert list(names) == ["age_years", "groupe_d_age", "further_2nd_visit", "further_4"]


def test_further_columns_are_in_the_workbook_as_numbers_or_text(carried: Studied) -> None:
    sheet = openpyxl.load_workbook(carried[1] / "summary.xlsx")["hours"]

    head, first = (list(row) for row in sheet.iter_rows(max_row=2))
    found = {
        name.value: (cell.value, cell.data_type) for name, cell in zip(head[-4:], first[-4:], strict=True)
    }
    assert found == {"age": (34, "n"), "group": ("=A1", "s"), "score": (-1.5, "n"), "badge": ("007", "s")}


def test_a_further_column_of_numbers_is_numbers_for_a_study_and_a_code_stays_text(carried: Studied) -> None:
    row = Study.read(carried[1]).summary.set_index("path").loc["p1.gt3x"]

    assert (row["age"], row["score"], row["badge"]) == (34.0, -1.5, "007")
    assert row["group"] == "=A1"
    assert Study.read(carried[1]).summary["group"].dropna().tolist() == [
        text for text in pq.read_table(carried[1] / "summary.parquet")["group"].to_pylist() if text
    ]
    assert {one["group"] for one in read_table(carried[1] / "redcap_import.csv")} == {"=A1", ""}


def test_a_negative_number_of_the_list_is_written_as_it_is(carried: Studied) -> None:
    of_tables = {
        row["score"] for name in ("summary.csv", "hours.csv") for row in read_table(carried[1] / name)
    }

    assert of_tables == {"-1.5", ""}


def test_the_same_recording_again_is_reported_and_is_no_failure(carried: Studied) -> None:
    result, out = carried

    assert (result.exit_code, "the same recording again: 1" in result.stderr) == (0, True)
    assert [row["code"] for row in read_table(out / "problems.csv")] == ["E-DOUBLE"]
    assert not (out / "p1 copy").exists()


def test_a_column_that_the_tables_have_is_refused(study: Path, tmp_path: Path) -> None:
    (tmp_path / "people.csv").write_text("file,verdict\np1.gt3x,x\n")

    result = run("run", study, "-o", tmp_path / "out", "--participants", tmp_path / "people.csv")

    assert (result.exit_code, "Line 1: a column of the result tables has this name" in result.stderr) == (
        2,
        True,
    )


@pytest.mark.parametrize(
    ("header", "told"),
    [
        ("file,Error code", 'a column of the result tables has this name; rename it ("Error code")'),
        ("file,record-id", 'a column of the result tables has this name; rename it ("record-id")'),
        ("file,participant_id", 'a column of the result tables has this name; rename it ("participant_id")'),
        ("file,Âge,age", "another column has the same name, apart from capitals, accents and signs"),
    ],
)
def test_a_column_whose_name_another_one_has_in_redcap_or_bids_is_refused(
    study: Path, tmp_path: Path, header: str, told: str
) -> None:
    (tmp_path / "people.csv").write_text(f"{header}\np1.gt3x,x\n", "utf-8")

    result = run("run", study, "-o", tmp_path / "out", "--participants", tmp_path / "people.csv")

    assert (result.exit_code, told in result.stderr) == (2, True), result.stderr


def test_a_dry_run_says_what_would_be_done_and_writes_nothing(study: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"

    result = run("run", study / "p1.gt3x", "-o", out, "--dry-run")

    assert result.output.startswith("would do: ")
    assert not out.exists()


def test_a_dry_run_lists_the_pairs_of_each_subject(study: Path, tmp_path: Path) -> None:
    people = tmp_path / "people.csv"
    people.write_text("file,subject,side\np1.gt3x,S01,left\np2.gt3x,S01,right\n", "utf-8")

    result = run(
        "run",
        study / "p1.gt3x",
        study / "p2.gt3x",
        "-o",
        tmp_path / "out",
        "--participants",
        people,
        "--dry-run",
    )

    assert result.output.endswith("Pair proposed, subject S01: left p1.gt3x; right p2.gt3x\n")


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
