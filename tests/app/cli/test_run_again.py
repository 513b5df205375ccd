"""``acromion run --again``: a results folder repeats its run."""

import json
import re
import shutil
from pathlib import Path

import pytest

from acromion.app.store.folder import hash_file
from tests.app.cli.typed import copy_gt3x, read_table, run

FIGURES = ("subject", "side", "age", "time_above_60_percent", "analysed_s", "calibration_state", "error_code")


@pytest.fixture(scope="module")
def study(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a study: two recordings, one that is none, a list with a diary, and their results."""
    folder = tmp_path_factory.mktemp("again")
    for name in ("p1", "p2"):
        copy_gt3x(shift_gt3x, folder / "data" / f"{name}.gt3x")
    (folder / "data" / "empty.gt3x").touch()
    (folder / "p1_diary.csv").write_text("start_s,end_s,kind,label\n60,120,break,\n")
    (folder / "people.csv").write_text("file,subject,side,diary,age\np1.gt3x,S01,left,p1_diary.csv,34\n")
    options = ("--participants", folder / "people.csv", "--pose-held", "start", "--report", "html")
    run("run", folder / "data", "-o", folder / "out", "-j", "1", *options)
    for name in ("people.csv", "p1_diary.csv"):
        (folder / name).unlink()  # the results folder suffices
    return folder


def list_figures(out: Path) -> list[list[str]]:
    return [[row[name] for name in FIGURES] for row in read_table(out / "summary.csv")]


def test_the_list_and_the_diaries_are_kept_in_the_results(study: Path) -> None:
    kept = study / "out" / "inputs"

    assert (kept / "participants.csv").read_text().startswith("file,subject,side,diary,age\n")
    assert (kept / "diaries" / "p1_diary.csv").read_text().endswith("60,120,break,\n")


def test_the_settings_of_each_recording_are_kept_without_the_path_of_this_computer(study: Path) -> None:
    content = (study / "out" / "inputs" / "recordings.json").read_text()
    first = json.loads(content)["recordings"][1]

    assert (first["path"], first["request"]["pose_held"], len(first["request"]["diary"])) == (
        "p1.gt3x",
        "start",
        1,
    )
    assert first["files"][0]["place"] == "../data/p1.gt3x"
    assert str(study) not in content


def test_a_run_is_repeated_from_its_results_into_another_folder(study: Path, tmp_path: Path) -> None:
    result = run("run", "--again", study / "out", "-o", tmp_path / "out", "-j", "1")

    assert result.exit_code == 1, result.stderr  # as the run, of which one recording failed
    assert list_figures(tmp_path / "out") == list_figures(study / "out")
    assert (tmp_path / "out" / "inputs" / "participants.csv").exists()


def test_a_run_repeated_into_its_own_folder_analyses_nothing_that_is_up_to_date(study: Path) -> None:
    before = list_figures(study / "out")

    result = run("run", "--again", study / "out", "-j", "1")

    assert "already done before: 2" in result.stderr
    assert list_figures(study / "out") == before


def test_recordings_that_moved_or_changed_are_refused_all_at_once(study: Path, tmp_path: Path) -> None:
    shutil.copytree(study, tmp_path / "study")
    data = tmp_path / "study" / "data"
    (data / "p1.gt3x").rename(tmp_path / "p1.gt3x")
    copy_gt3x(data / "p2.gt3x", data / "copy.gt3x").replace(data / "p2.gt3x")

    result = run("run", "--again", tmp_path / "study" / "out")

    assert (result.exit_code, "E-AGAIN" in result.stderr) == (2, True)
    assert "p1.gt3x: the recording is no longer there" in result.stderr
    assert "p2.gt3x: the bytes of the recording have changed" in result.stderr


def test_moved_recordings_are_found_by_their_bytes_in_a_folder_that_is_named(
    study: Path, tmp_path: Path
) -> None:
    shutil.copytree(study / "out", tmp_path / "out")
    for name, other in (("p1", "renamed"), ("p2", "p2"), ("empty", "empty")):
        (tmp_path / "archive").mkdir(exist_ok=True)
        shutil.copy(study / "data" / f"{name}.gt3x", tmp_path / "archive" / f"{other}.gt3x")

    result = run("run", "--again", tmp_path / "out", tmp_path / "archive", "--dry-run")

    assert result.exit_code == 0, result.stderr
    assert (
        f"done already: {tmp_path / 'archive' / 'renamed.gt3x'} -> {tmp_path / 'out' / 'p1'}" in result.stdout
    )


def test_a_changed_recording_in_a_named_folder_is_told_from_one_that_is_not_there(
    study: Path, tmp_path: Path
) -> None:
    shutil.copytree(study / "data", tmp_path / "data")
    (tmp_path / "data" / "p1.gt3x").unlink()
    with (tmp_path / "data" / "p2.gt3x").open("ab") as file:
        file.write(b"more")

    result = run("run", "--again", study / "out", tmp_path / "data", "-o", tmp_path / "out")

    assert "p1.gt3x: the recording is no longer there" in result.stderr
    assert "p2.gt3x: the bytes of the recording have changed" in result.stderr


def test_a_file_of_postures_of_the_list_is_kept_and_is_no_recording(study: Path, tmp_path: Path) -> None:
    shutil.copy(study / "data" / "p1.gt3x", tmp_path / "p1.gt3x")
    (tmp_path / "thigh.csv").write_text("datetime,activity\n2026-03-02 07:01:00,sit\n")
    (tmp_path / "people.csv").write_text("file,posture\np1.gt3x,thigh.csv\n")
    out = tmp_path / "out"

    run("run", tmp_path, "-o", out, "--participants", tmp_path / "people.csv", "--report", "html")

    assert [row["path"] for row in read_table(out / "summary.csv")] == ["p1.gt3x"]
    assert (out / "inputs" / "diaries" / "thigh.csv").exists()


def test_settings_beside_again_are_refused(study: Path) -> None:
    result = run("run", "--again", study / "out", "--method", "live", "--no-slip-at", "5")

    assert result.exit_code == 2
    assert {"--method", "--no-slip-at"} <= set(re.findall(r"--[a-z-]+", result.stderr))


def test_a_folder_without_inputs_is_refused(tmp_path: Path) -> None:
    result = run("run", "--again", tmp_path)

    assert (result.exit_code, "E-AGAIN" in result.stderr) == (2, True)


@pytest.fixture
def sites(shift_gt3x: Path, tmp_path: Path) -> Path:
    """Two sites with a recording of the same name; only one has a diary."""
    for site in ("siteA", "siteB"):
        copy_gt3x(shift_gt3x, tmp_path / "data" / site / "p1.gt3x")
    (tmp_path / "pause.csv").write_text("start_s,end_s,kind,label\n60,120,break,\n")
    rows = "siteA/p1.gt3x,S01,left,pause.csv\nsiteB/p1.gt3x,S02,right,\n"
    (tmp_path / "people.csv").write_text(f"file,subject,side,diary\n{rows}")
    options = ("--participants", tmp_path / "people.csv", "--report", "html", "-j", "1")
    run("run", tmp_path / "data", "-o", tmp_path / "out", *options)
    return tmp_path


def test_recordings_of_one_name_in_two_folders_stay_apart(sites: Path) -> None:
    columns = ("path", "folder", "subject", "side", "analysed_s")
    rows = [[row[name] for name in columns] for row in read_table(sites / "out" / "summary.csv")]

    run("run", "--again", sites / "out", "-o", sites / "other", "-j", "1")

    assert len({row[4] for row in rows}) == 2
    assert [[row[name] for name in columns] for row in read_table(sites / "other" / "summary.csv")] == rows


def test_a_changed_recording_in_a_folder_is_refused_by_its_bytes(sites: Path) -> None:
    path = sites / "data" / "siteB" / "p1.gt3x"
    path.write_bytes(path.read_bytes()[:-1] + b"\xff")

    result = run("run", "--again", sites / "out", "-o", sites / "other", "-j", "1")

    assert (result.exit_code, "E-AGAIN" in result.stderr) == (2, True)
    assert "siteB/p1.gt3x" in result.stderr
    assert not (sites / "other").exists()


def forget_analyses(sites: Path) -> None:
    """Leave the results as an interrupted run does, and move the recordings."""
    for marker in (sites / "out").rglob("done.json"):
        marker.unlink()
    (sites / "data").rename(sites / "moved")


def test_recordings_that_were_not_analysed_are_found_by_their_folders(sites: Path) -> None:
    digests = {site: hash_file(sites / "data" / site / "p1.gt3x") for site in ("siteA", "siteB")}
    forget_analyses(sites)

    run("run", "--again", sites / "out", sites / "moved", "-o", sites / "other", "-j", "1")

    rows = {row["path"]: row["sha256"] for row in read_table(sites / "other" / "summary.csv")}
    assert rows == {f"{site}/p1.gt3x": digest for site, digest in digests.items()}


def test_a_recording_that_two_files_may_be_is_refused(sites: Path) -> None:
    forget_analyses(sites)
    for site, name in (("siteA", "one"), ("siteB", "two")):
        (sites / "moved" / site).rename(sites / "moved" / name)

    result = run("run", "--again", sites / "out", sites / "moved", "-o", sites / "other", "-j", "1")

    assert result.exit_code == 2
    assert "several files have its name and size" in result.stderr
    assert not (sites / "other").exists()


@pytest.mark.parametrize(
    "change",
    [
        {"folder": "../escaped"},
        {"folder": "/tmp/escaped"},
        {"folder": None},
        {"files": []},
        {"request": {"side": "middle"}},
    ],
    ids=["above", "absolute", "no folder", "no file", "no request"],
)
def test_a_changed_record_of_a_run_is_refused(study: Path, tmp_path: Path, change: dict[str, object]) -> None:
    kept = tmp_path / "kept" / "inputs"
    kept.mkdir(parents=True)
    record = json.loads((study / "out" / "inputs" / "recordings.json").read_text())
    record["recordings"][1] |= change
    (kept / "recordings.json").write_text(json.dumps(record))

    result = run("run", "--again", tmp_path / "kept", study / "data", "-o", tmp_path / "out")

    assert (result.exit_code, "E-AGAIN" in result.stderr) == (2, True)
    assert not (tmp_path / "escaped").exists()


def test_a_link_among_the_inputs_is_not_copied(study: Path, tmp_path: Path) -> None:
    shutil.copytree(study / "out", tmp_path / "kept")
    (tmp_path / "secret.csv").write_text("secret")
    (tmp_path / "kept" / "inputs" / "diaries" / "link.csv").symlink_to(tmp_path / "secret.csv")

    run("run", "--again", tmp_path / "kept", study / "data", "-o", tmp_path / "out", "-j", "1")

    copied = [path.name for path in (tmp_path / "out" / "inputs" / "diaries").iterdir()]
    assert copied == ["p1_diary.csv"]
