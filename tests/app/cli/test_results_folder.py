"""The results folder follows the last run, and one run at a time writes into it."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import Result

from tests import ROOT
from tests.app.cli.typed import copy_gt3x, read_table, run

OPTIONS = ("--report", "html", "-j", "2", "--subject", "S01", "--side", "left")
HOLD = """
import sys
from pathlib import Path
from acromion.app.batch.folder import hold_results
with hold_results(Path(sys.argv[1]), is_shared=sys.argv[2] == "shard"):
    print("held", flush=True)
    sys.stdin.read()
"""
Withdrawn = tuple[Path, Result]


@pytest.fixture(scope="module")
def withdrawn(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Withdrawn:
    """The results of three recordings, one of which was then withdrawn; and what the second run printed."""
    folder = tmp_path_factory.mktemp("withdrawn")
    for name in "abc":
        copy_gt3x(shift_gt3x, folder / "data" / f"{name}.gt3x")
    run("run", folder / "data", "-o", folder / "out", *OPTIONS)
    (folder / "data" / "b.gt3x").unlink()
    return folder / "out", run("run", folder / "data", "-o", folder / "out", *OPTIONS)


def test_a_withdrawn_recording_is_in_no_table(withdrawn: Withdrawn) -> None:
    rows = read_table(withdrawn[0] / "summary.csv")

    assert [row["file_name"] for row in rows] == ["a.gt3x", "c.gt3x"]


def test_a_withdrawn_recording_is_not_exported(withdrawn: Withdrawn, tmp_path: Path) -> None:
    run("export", withdrawn[0], "-o", tmp_path / "bids")

    assert len(list((tmp_path / "bids").rglob("*_motion.tsv"))) == 2


def test_a_withdrawn_recording_is_not_a_day_of_the_profile(withdrawn: Withdrawn, tmp_path: Path) -> None:
    result = run("profile", withdrawn[0], "-o", tmp_path, "--report", "html")

    assert "a.gt3x" in result.output  # the two left are of the same hours, which is refused with both names
    assert "b.gt3x" not in result.output


def test_the_folder_of_a_withdrawn_recording_is_named_and_kept(withdrawn: Withdrawn) -> None:
    out, result = withdrawn

    assert "and not deleted: b." in result.stderr
    assert (out / "b" / "report.html").exists()


def test_a_recording_that_fails_now_is_not_exported_with_its_earlier_figures(
    shift_gt3x: Path, tmp_path: Path
) -> None:
    log = copy_gt3x(shift_gt3x, tmp_path / "a.gt3x")
    run("run", log, "-o", tmp_path / "out", *OPTIONS)
    log.write_bytes(b"")
    run("run", log, "-o", tmp_path / "out", *OPTIONS)

    result = run("export", tmp_path / "out", "-o", tmp_path / "bids")

    assert (result.exit_code, "E-NO-RESULTS" in result.stderr) == (3, True)


@pytest.fixture
def holder(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator["subprocess.Popen[bytes]"]:
    """Another process that holds the results folder ``tmp_path / "out"`` as a run or as a shard."""
    typed = [sys.executable, "-c", HOLD, str(tmp_path / "out"), request.param]
    with subprocess.Popen(typed, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout
        assert process.stdout.readline() == b"held\n"
        yield process
        process.kill()


@pytest.mark.parametrize("holder", ["run"], indirect=True)
def test_a_second_run_into_one_folder_is_refused_and_told_which_process_writes(
    holder: "subprocess.Popen[bytes]", shift_gt3x: Path, tmp_path: Path
) -> None:
    result = run("run", shift_gt3x, "-o", tmp_path / "out", *OPTIONS)

    assert (result.exit_code, f"process {holder.pid} on " in result.stderr) == (3, True)
    assert not (tmp_path / "out" / "summary.csv").exists()


@pytest.mark.parametrize("holder", ["run"], indirect=True)
def test_a_run_that_was_killed_keeps_nobody_out(holder: "subprocess.Popen[bytes]", tmp_path: Path) -> None:
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    (tmp_path / "a.gt3x").touch()

    result = run("run", tmp_path / "a.gt3x", "-o", tmp_path / "out", *OPTIONS)

    assert "E-EMPTY" in result.stderr


@pytest.mark.parametrize(
    ("holder", "shard", "code"),
    [("shard", ("--shard", "1/2"), "E-EMPTY"), ("run", ("--shard", "1/2"), "E-RESULTS-IN-USE"),
     ("shard", (), "E-RESULTS-IN-USE")],
    indirect=["holder"],
)  # fmt: skip
def test_shards_run_side_by_side_and_not_beside_a_whole_run(
    holder: "subprocess.Popen[bytes]", tmp_path: Path, shard: tuple[str, ...], code: str
) -> None:
    (tmp_path / "a.gt3x").touch()

    result = run("run", tmp_path / "a.gt3x", "-o", tmp_path / "out", *OPTIONS, *shard)

    assert (holder.poll(), code in result.stderr) == (None, True)


def test_a_folder_that_holds_the_results_of_two_runs_gives_the_last_of_each(
    withdrawn: Withdrawn, tmp_path: Path
) -> None:
    for name in ("one", "two"):
        (tmp_path / name).symlink_to(withdrawn[0])

    result = run("export", tmp_path, "-o", tmp_path / "bids")

    assert len(list((tmp_path / "bids").rglob("*_motion.tsv"))) == 4, result.output
    assert json.loads((withdrawn[0] / "run.json").read_bytes())["recordings"][0]["folder"] == "a"
