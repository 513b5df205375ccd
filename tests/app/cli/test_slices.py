"""A study done by three processes, two of which are killed and started again."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests import ROOT
from tests.app.cli.typed import copy_gt3x, read_table, run

SLICES = 3
KILLED = {2: "b", 3: "p3/arm"}
"""Slices, and the folder at which each is killed."""
OPTIONS = ("--report", "html", "-j", "1", "--quiet")
PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def study(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six recordings, three of one name; two are none."""
    folder = tmp_path_factory.mktemp("sliced")
    for place in ("p1", "p2", "p3"):
        (folder / place).mkdir()
        copy_gt3x(shift_gt3x, folder / place / "arm.gt3x")
    (folder / "p2" / "arm.gt3x").write_bytes(b"")
    for name in "ab":
        copy_gt3x(shift_gt3x, folder / f"{name}.gt3x")
    (folder / "broken.gt3x").write_bytes(b"no recording")
    (folder / "people.csv").write_text("file,subject,side\na.gt3x,S01,left\np3/arm.gt3x,S02,right\n")
    return folder


def list_arguments(study: Path, out: Path) -> tuple[str | Path, ...]:
    return ("run", study, "-o", out, "--participants", study / "people.csv", *OPTIONS)


def start(study: Path, out: Path, number: int) -> "subprocess.Popen[bytes]":
    typed = (*list_arguments(study, out), "--shard", f"{number}/{SLICES}")
    return subprocess.Popen(
        [sys.executable, "-m", "acromion", *map(str, typed)], cwd=ROOT, stderr=subprocess.DEVNULL
    )


def get_staging(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.part")


@pytest.fixture(scope="module")
def sliced(study: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three processes write into one folder; two of them die at work: their products are there in part."""
    out = tmp_path_factory.mktemp("sliced") / "out"
    processes = {number: start(study, out, number) for number in range(1, SLICES + 1)}
    try:
        end_s, alive = time.monotonic() + PATIENCE_S, dict(KILLED)
        while alive:
            for number in [one for one, folder in alive.items() if get_staging(out / folder).exists()]:
                processes[number].kill()
                assert processes[number].wait() == -signal.SIGKILL
                del alive[number]
            assert all(processes[number].poll() is None for number in alive)
            assert time.monotonic() < end_s
            time.sleep(0.01)
        for process in processes.values():
            process.wait(PATIENCE_S)
    finally:
        for process in processes.values():
            process.kill()
            process.wait()
    return out


def test_what_a_killed_process_had_not_done_is_not_done(sliced: Path) -> None:
    result = run("collect", sliced)
    codes = {row["path"]: row["error_code"] for row in read_table(sliced / "summary.csv")}

    assert result.exit_code == 130
    assert "Slices with recordings still to do: 2/3, 3/3." in result.stderr
    assert codes["b.gt3x"] == "E-INTERRUPTED"
    assert codes["a.gt3x"] == ""


def test_tables_of_several_processes_are_those_of_one_to_the_byte(
    sliced: Path, study: Path, tmp_path: Path
) -> None:
    for number in KILLED:
        start(study, sliced, number).wait(PATIENCE_S)
    collected = run("collect", sliced)
    alone = run(*list_arguments(study, tmp_path / "out"))

    assert collected.exit_code == alone.exit_code == 1
    assert read_tables(sliced) == read_tables(tmp_path / "out")


def read_tables(out: Path) -> dict[str, bytes]:
    """Read every table, without the moment at which they were made."""
    made_at = json.loads((out / "run.json").read_bytes())["made_at"].encode()
    tables = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    return {name: content.replace(made_at, b"then") for name, content in tables.items()}


def test_no_process_leaves_anything_half_made(sliced: Path) -> None:
    assert not list(sliced.rglob(".*"))


def test_a_slice_or_a_folder_that_is_none_is_a_usage_error_and_one_without_recordings_is_not(
    shift_gt3x: Path, tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()
    collected = run("collect", tmp_path / "empty")
    asked = ("run", shift_gt3x, "-o", tmp_path / "out", "--shard")

    assert (collected.exit_code, "E-NO-SHARDS" in collected.stderr) == (2, True)
    assert run(*asked, "9/8").exit_code == 2
    assert not (tmp_path / "out").exists()
    assert run(*asked, "2/2").exit_code == 0


def test_a_slice_with_a_failure_says_that_collect_lists_it(tmp_path: Path) -> None:
    (tmp_path / "broken.gt3x").write_bytes(b"no recording")

    result = run("run", tmp_path, "-o", tmp_path / "out", "--shard", "1/1")

    assert "failed: 1, listed in problems.csv after acromion collect." in " ".join(result.stderr.split())
    assert not (tmp_path / "out" / "problems.csv").exists()


def test_a_slice_that_ran_with_other_options_is_named(shift_gt3x: Path, tmp_path: Path) -> None:
    for name in "ab":
        copy_gt3x(shift_gt3x, tmp_path / f"{name}.gt3x")
    for number, method in ((1, "published"), (2, "smoothed")):
        options = ("--report", "html", "--method", method, "--shard", f"{number}/2")
        run("run", tmp_path, "-o", tmp_path / "out", *options)

    result = run("collect", tmp_path / "out")

    assert result.exit_code == 130
    assert "Slices run with other files or options than the slice started last: 1/2." in result.stderr
    assert "The same command goes on" not in result.stderr
