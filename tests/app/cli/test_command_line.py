"""The command line: one log in, one report out; message, exit code and files agree."""

import json
import shutil
from datetime import datetime
from pathlib import Path

import pytest
from pypdf import PdfReader

from acromion.app.batch.folder import plan_tasks
from acromion.app.report.inspection import describe_inspection
from acromion.app.request import ReportRequest
from tests.app.cli.typed import read_table, run


@pytest.fixture(scope="module")
def done(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run")
    assert run("run", shift_gt3x, "-o", out).exit_code == 0
    return out


def test_one_file_and_no_other_option_gives_every_product_and_the_tables_beside_it(
    done: Path, shift_gt3x: Path
) -> None:
    made = {path.name for path in (done / shift_gt3x.stem).iterdir()}
    tables = {path.name for path in done.iterdir() if path.is_file()}

    assert made >= {"results.json", "elevation.parquet", "report.html", "report.pdf"}
    assert tables == {
        *("summary.csv", "summary_fr.csv", "summary.xlsx"),
        *("days.csv", "hours.csv", "periods.csv", "tasks.csv", "postures.csv", "marks.csv", "pairs.csv"),
        *("summary.parquet", "days.parquet", "hours.parquet", "periods.parquet", "tasks.parquet"),
        *("postures.parquet", "marks.parquet", "pairs.parquet"),
        *("redcap_import.csv", "redcap_dictionary.csv", "problems.csv", "dictionary.csv", "run.json"),
        *("settings.yaml", "methods.md", "index.html", "run.lock"),
        *("datapackage.json", "ro-crate-metadata.json"),
    }
    made_at = json.loads((done / "run.json").read_text("utf-8"))["made_at"]
    assert datetime.fromisoformat(made_at).tzinfo is not None


def test_a_finished_recording_is_not_done_again_and_each_kind_of_run_says_so(
    done: Path, shift_gt3x: Path
) -> None:
    marker = done / shift_gt3x.stem / "done.json"
    before = marker.stat().st_mtime_ns

    said = {
        option: run("run", shift_gt3x, "-o", done, *option.split())
        for option in ("", "--dry-run", "--quiet", "--json-log")
    }

    assert "already done" in said[""].output
    assert said["--dry-run"].output.startswith("done already: ")
    assert said["--quiet"].output == ""
    line = json.loads(said["--json-log"].stdout)
    assert (line["file"], line["code"], line["repeated"]) == (str(shift_gt3x), None, True)
    assert marker.stat().st_mtime_ns == before


def test_the_appendix_is_added_to_a_finished_report_without_another_analysis(
    done: Path, shift_gt3x: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(done, tmp_path / "out") / shift_gt3x.stem
    figures = (folder / "results.json").stat().st_mtime_ns
    four = len(PdfReader(folder / "report.pdf").pages)

    result = run("run", shift_gt3x, "-o", folder.parent, "--appendix")

    assert (result.exit_code, four) == (0, 4)
    assert len(PdfReader(folder / "report.pdf").pages) > 4
    assert (folder / "results.json").stat().st_mtime_ns == figures
    assert "appendix: true" in (folder.parent / "settings.yaml").read_text("utf-8")


@pytest.mark.parametrize(
    ("name", "code"), [("empty.gt3x", "E-EMPTY"), ("none.gt3x", "E-FILE"), ("folder", "E-NO-RECORDING")]
)
def test_what_is_no_recording_is_refused_by_its_code(tmp_path: Path, name: str, code: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "empty.gt3x").touch()

    result = run("run", tmp_path / name, "-o", tmp_path / "out")

    assert (result.exit_code, code in result.stderr) == (3, True)
    problems = tmp_path / "out" / "problems.csv"
    assert code == "E-NO-RECORDING" or [row["code"] for row in read_table(problems)] == [code]


@pytest.mark.parametrize("name", ["...gt3x", "..gt3x", "summary.csv.gt3x", " .gt3x", "a:b.gt3x"])
def test_no_file_name_can_lead_out_of_the_folder(name: str, tmp_path: Path) -> None:
    log, out = tmp_path / name, tmp_path / "out"

    (task,) = plan_tasks([log], out, ReportRequest(""), force=False)

    assert task.folder.resolve().parent == out.resolve()
    assert task.folder.name not in {"summary.csv", "", ".", ".."}


def test_results_where_a_file_stands_is_a_problem_not_a_crash(shift_gt3x: Path, tmp_path: Path) -> None:
    blocked = tmp_path / "out"
    blocked.write_text("mine")

    result = run("run", shift_gt3x, "-o", blocked)

    assert result.exit_code == 3
    assert "E-FILE" in result.stderr
    assert blocked.read_text() == "mine"


def test_a_folder_that_is_not_ours_is_left_alone(shift_gt3x: Path, tmp_path: Path) -> None:
    theirs = tmp_path / shift_gt3x.stem / "notes.txt"
    theirs.parent.mkdir()
    theirs.write_text("mine")

    result = run("run", shift_gt3x, "-o", tmp_path)

    assert result.exit_code == 3
    assert theirs.read_text() == "mine"


@pytest.mark.parametrize(
    "wrong",
    [
        *(["--subject", code] for code in ("a\nb", "\x1b[31m", "x" * 101)),
        ["--calibration=9,3"],
        ["--axis=up"],
        ["--axis=y", "--calibration=5,15"],
        ["--slip-at=noon"],
        ["--no-slip-at=noon"],
        ["--pose-held=end"],
        ["--pose=two-point"],
        ["--report=docx"],
    ],
)
def test_a_setting_that_cannot_be_is_a_usage_error(wrong: list[str], tmp_path: Path) -> None:
    assert run("run", "x.gt3x", "-o", tmp_path, *wrong).exit_code == 2


def test_a_statement_about_watched_files_needs_a_folder_to_watch(tmp_path: Path) -> None:
    assert run("serve", "--data", tmp_path, "--pose-held", "start").exit_code == 2


def write_log(path: Path, start: str, seconds: int) -> Path:
    rows = "\n".join(
        f"{k * 10_000},{(k * 7 % 11) / 1e4},{(k * 3 % 5) / 1e4},{1 + (k % 3) / 1e4},{k % 2},{k % 3},{k % 5}"
        for k in range(seconds * 100)
    )
    names = "time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
    path.write_text(f"# device: LSM9DS1\n# start: {start}\n{names}\n{rows}\n")
    return path


def test_the_files_of_one_shift_are_joined_and_what_lies_between_is_missing(tmp_path: Path) -> None:
    morning = write_log(tmp_path / "a.csv", "2026-03-03T08:00:00", 20)
    later = write_log(tmp_path / "b.csv", "2026-03-03T08:00:50", 20)

    result = run("run", morning, later, "--join", "-o", tmp_path / "out", "--report", "html")

    results = json.loads((tmp_path / "out" / "a" / "results.json").read_text("utf-8"))
    assert result.exit_code == 0
    assert (results["time"]["recorded_s"], results["time"]["missing_s"]) == (70.0, 30.0)


def test_exposure_of_a_ready_angle_series(tmp_path: Path) -> None:
    table = tmp_path / "angles.csv"
    rows = "\n".join(f"{k / 10},{70 if k >= 300 else 10}" for k in range(400))
    table.write_text(f"time_s,elevation_deg\n{rows}\n")

    result = run("exposure", table, "-o", tmp_path / "out")

    results = json.loads((tmp_path / "out" / "angles" / "results.json").read_text("utf-8"))
    assert result.exit_code == 0
    assert [t["percent"] for t in results["exposure"]["time_above"]] == [25.0, 25.0, 0.0]
    assert results["calibration"] is None
    assert results["method"] is None


def test_inspect_tells_the_device_and_analyses_nothing(shift_gt3x: Path) -> None:
    facts = json.loads(run("inspect", shift_gt3x, "--json").stdout)

    assert facts["device"] == "gt9x"
    assert facts["calibration_proposals"]


def test_inspect_prints_when_the_sensor_may_not_have_been_worn(shift_gt3x: Path) -> None:
    facts = json.loads(run("inspect", shift_gt3x, "--json").stdout)
    facts["nonwear_proposals"] = [{"start_s": 60.0, "duration_s": 900.0}]

    assert "900 s from 60 s" in describe_inspection(facts, "en").replace("\N{NO-BREAK SPACE}", " ")


def test_simulate_writes_the_recording_and_the_truth(tmp_path: Path) -> None:
    result = run("simulate", tmp_path, "--device", "lsm9ds1", "--hours", "0.02", "--rate-hz", "100")

    assert result.exit_code == 0
    assert (tmp_path / "truth.parquet").exists()


def test_the_demo_ends_with_a_report(tmp_path: Path) -> None:
    result = run("demo", "-o", tmp_path, "--hours", "0.1")

    assert result.exit_code == 0
    assert "report.html" in result.stdout
    results = json.loads(next(tmp_path.glob("*/results.json")).read_text("utf-8"))
    assert results["calibration"]["state"] == "held_at_start"


@pytest.mark.parametrize(
    ("name", "damage"),
    [("results.json", b'{"schema'), ("elevation.parquet", b""), ("done.json", b"{"), ("report.html", b"")],
)
def test_what_is_damaged_is_made_again(
    done: Path, shift_gt3x: Path, tmp_path: Path, name: str, damage: bytes
) -> None:
    shutil.copytree(done, tmp_path, dirs_exist_ok=True)
    file = tmp_path / shift_gt3x.stem / name
    whole = file.read_bytes()
    file.write_bytes(damage)

    result = run("run", shift_gt3x, "-o", tmp_path)

    assert result.exit_code == 0
    assert file.read_bytes() == whole


def test_the_results_of_another_run_are_no_recordings(done: Path, shift_gt3x: Path, tmp_path: Path) -> None:
    shutil.copytree(done, tmp_path / "earlier")
    shutil.copy(shift_gt3x, tmp_path)

    result = run("run", tmp_path, "-o", tmp_path / "out", "--dry-run")

    assert result.stdout.count("would do") == 1
