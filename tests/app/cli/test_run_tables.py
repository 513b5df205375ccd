"""The tables of a run: every row says which recording it is about, also after a run that was cut."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import openpyxl
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from acromion.app.batch.folder import open_staging, plan_tasks
from acromion.app.batch.run import run_task
from acromion.app.cli import app
from acromion.app.request import ReportRequest
from tests.app.cli.typed import copy_gt3x, read_table

# a shell that starts tests in the background lets them ignore Ctrl-C, and so what they start
START = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from acromion.app.cli import main
main()"""


Cut = tuple[int, Path]


@pytest.fixture(scope="module")
def twins(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a folder with four recordings of one name, one of them empty."""
    folder = tmp_path_factory.mktemp("twins")
    for place in ("p1", "p2", "p3/week 2"):
        (folder / place).mkdir(parents=True)
        copy_gt3x(shift_gt3x, folder / place / "arm.gt3x")
    (folder / "p4").mkdir()
    (folder / "p4" / "arm.gt3x").touch()
    (folder / "people.csv").write_text("file,subject,side\np4/arm.gt3x,S04,left\n")
    options = ["--participants", str(folder / "people.csv"), "--report", "html", "-j", "2"]
    CliRunner().invoke(app, ["run", str(folder), "-o", str(folder / "out"), *options])
    return folder / "out"


def test_recordings_of_one_name_are_told_apart_in_the_summary(twins: Path) -> None:
    rows = read_table(twins / "summary.csv")

    assert [(row["path"], row["folder"]) for row in rows] == [
        ("p1/arm.gt3x", "p1/arm"),
        ("p2/arm.gt3x", "p2/arm"),
        ("p3/week 2/arm.gt3x", "p3/week 2/arm"),
        ("p4/arm.gt3x", ""),
    ]


def test_a_failed_recording_keeps_the_person_and_the_arm_in_summary_and_problems(twins: Path) -> None:
    failed = read_table(twins / "summary.csv")[3]
    (row,) = read_table(twins / "problems.csv")

    assert (failed["subject"], failed["side"], failed["error_code"]) == ("S04", "left", "E-EMPTY")
    assert (row["path"], row["subject"], row["side"]) == ("p4/arm.gt3x", "S04", "left")


def test_hours_workbook_and_page_say_which_recording(twins: Path) -> None:
    hours = read_table(twins / "hours.csv")
    book = openpyxl.load_workbook(twins / "summary.xlsx")

    assert {row["path"] for row in hours} == {"p1/arm.gt3x", "p2/arm.gt3x", "p3/week 2/arm.gt3x"}
    for sheet in ("summary", "bins", "hours", "warnings"):
        head, *rows = book[sheet].values
        assert "p2/arm.gt3x" in [row[head.index("path")] for row in rows], sheet
    assert '<a href="p2/arm/report.html">p2/arm.gt3x</a>' in (twins / "index.html").read_text("utf-8")


def cut_run(folder: Path, *options: str, by: signal.Signals = signal.SIGINT) -> int:
    """Run over a folder, one at a time, and cut it after the first recording; gives the exit code."""
    words = ["run", str(folder), "-o", str(folder / "out"), "-j", "1", "--json-log", *options]
    command = [sys.executable, "-c", START, *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as run:
        assert run.stdout is not None
        run.stdout.readline()
        run.send_signal(by)
        run.stdout.read()
    return run.returncode


@pytest.fixture(scope="module")
def cut(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Cut:
    """A run of ten that got Ctrl-C after the first: its exit code and its results.

    How many more it finishes before the signal reaches it depends on the machine.
    """
    folder = tmp_path_factory.mktemp("cut")
    for name in "abcdefghij":
        copy_gt3x(shift_gt3x, folder / f"{name}.gt3x")
    return cut_run(folder), folder / "out"


def test_a_run_that_was_cut_leaves_the_summary_so_far_and_nothing_half_made(cut: Cut) -> None:
    rows = read_table(cut[1] / "summary.csv")
    codes = [row["error_code"] for row in rows]
    done = codes.count("")

    assert cut[0] == 130
    assert done > 0
    assert codes == [""] * done + ["E-INTERRUPTED"] * (10 - done)
    folders = sorted(path.name for path in cut[1].iterdir() if path.is_dir() and path.name != "inputs")
    assert folders == [row["file_name"][0] for row in rows[:done]]


def test_what_an_earlier_run_has_done_stays_in_the_tables_of_one_that_was_cut(
    shift_gt3x: Path, tmp_path: Path
) -> None:
    for name in ("b", "c"):
        copy_gt3x(shift_gt3x, tmp_path / f"{name}.gt3x")
    CliRunner().invoke(app, ["run", str(tmp_path), "-o", str(tmp_path / "out"), "--report", "html"])
    for name in "adefghij":
        copy_gt3x(shift_gt3x, tmp_path / f"{name}.gt3x")

    code = cut_run(tmp_path, "--report", "html", by=signal.SIGTERM)

    codes = {row["file_name"]: row["error_code"] for row in read_table(tmp_path / "out" / "summary.csv")}
    assert (code, len(codes), codes["j.gt3x"]) == (130, 10, "E-INTERRUPTED")
    assert (codes["b.gt3x"], codes["c.gt3x"]) == ("", "")


def test_a_name_that_is_not_utf_8_stops_no_run(shift_gt3x: Path, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    copy_gt3x(shift_gt3x, tmp_path / "in" / os.fsdecode(b"caf\xe9.gt3x"))
    copy_gt3x(shift_gt3x, tmp_path / "in" / "plain.gt3x")

    run = CliRunner().invoke(app, ["run", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--json-log"])

    rows = [(row["file_name"], row["path"]) for row in read_table(tmp_path / "out" / "summary.csv")]
    assert run.exit_code == 0
    assert rows == [("caf.gt3x", "caf\N{REPLACEMENT CHARACTER}.gt3x"), ("plain.gt3x", "plain.gt3x")]


def test_two_runs_never_mix_one_report(shift_gt3x: Path, tmp_path: Path) -> None:
    task = plan_tasks([shift_gt3x], tmp_path, ReportRequest(shift_gt3x.name), force=False)[0]

    with open_staging(task.folder) as staging:
        (staging / "results.json").write_text("{}")
        other = run_task(task, lambda *_: True)
        kept = (staging / "results.json").exists()

    assert (other.code, other.facts["why"]) == ("E-FILE", "another run is making the same report")
    assert kept


def test_parquet_workbook_and_redcap_have_the_rows_of_the_run(twins: Path) -> None:
    tasks, hours = (pq.read_table(twins / f"{name}.parquet") for name in ("tasks", "hours"))
    book = openpyxl.load_workbook(twins / "summary.xlsx")

    assert hours.column("path").to_pylist() == [row["path"] for row in read_table(twins / "hours.csv")]
    assert tasks.num_rows == 0  # no diary
    assert book["summary"].max_row == 1 + 4  # the failed recording has a row
    assert [row["path"] for row in read_table(twins / "problems.csv")] == ["p4/arm.gt3x"]
    assert book.sheetnames[:2] == ["summary", "days"]
    assert len(read_table(twins / "redcap_import.csv")) == 3
