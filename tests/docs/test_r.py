"""The script for R, as a person runs it beside a finished run and a server."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import ROOT
from tests.app.cli.typed import read_table, run
from tests.ways_in.servers import RunningServer

SCRIPT = ROOT / "docs" / "code" / "acromion.R"

pytestmark = pytest.mark.slow


@pytest.fixture
def server(tmp_path: Path) -> Iterator[RunningServer]:
    running = RunningServer(tmp_path / "data", tmp_path / "server.log", ACROMION_NO_SECRET="0")
    yield running
    running.stop()


@pytest.fixture(scope="module")
def done(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of a recording of subject 007 and of a file that is none."""
    folder = tmp_path_factory.mktemp("run")
    shutil.copy(shift_gt3x, folder / "shift.gt3x")
    (folder / "broken.gt3x").write_bytes(b"PK\x03\x04")
    assert run("run", folder, "-o", folder / "out", "--subject", "007").exit_code == 1
    return folder


def start_r(*words: str | Path, **variables: str) -> "subprocess.CompletedProcess[str]":
    if shutil.which("Rscript") is None:
        pytest.skip("R is absent")
    command, environment = ["Rscript", *map(str, words)], os.environ | variables
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def ask_r(*words: str | Path, **variables: str) -> str:
    ended = start_r(*words, **variables)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def test_the_tables_keep_codes_as_text_and_failed_recordings_out_of_the_means(done: Path) -> None:
    told = "cat(nrow(all), all$subject[1], nrow(usable(all)))"
    code = f'source("{SCRIPT}"); all <- read_table("{done / "out"}"); {told}'

    rows = read_table(done / "out" / "summary.csv")
    good = [row for row in rows if not row["error_code"] and row["verdict"] != "poor"]
    assert ask_r("-e", code) == f"{len(rows)} 007 {len(good)}"


def test_the_ranges_are_those_of_the_results() -> None:
    results = ROOT / "templates" / "example" / "results.json"
    told = 'cat(sprintf("%.3f", unlist(tabulate_time_above(results)[2, c("percent", "low", "high")])))'
    code = f'source("{SCRIPT}"); results <- jsonlite::read_json("{results}"); {told}'

    above = json.loads(results.read_text("utf-8"))["exposure"]["time_above"][1]
    assert ask_r("-e", code) == " ".join(f"{above[name]:.3f}" for name in ("percent", "low", "high"))


def test_the_script_prints_the_figures_that_the_server_has(done: Path, server: RunningServer) -> None:
    words = (SCRIPT, done / "out", done / "shift.gt3x", server.address.rstrip("/"))

    printed = ask_r(*words, ACROMION_SECRET=(server.data / "secret").read_text("utf-8"))

    results = json.loads(next((done / "out").glob("shift*/results.json")).read_text("utf-8"))
    shares = [row["percent"] for row in results["exposure"]["time_above"]]
    lines = [line.split() for line in printed.splitlines()[-3:]]
    assert [line[1] for line in lines] == ["30", "60", "90"]
    assert [float(line[2]) for line in lines] == pytest.approx(shares, abs=1e-4)


def test_a_server_refuses_the_script_without_the_secret(done: Path, server: RunningServer) -> None:
    words = (SCRIPT, done / "out", done / "shift.gt3x", server.address.rstrip("/"))

    ended = start_r(*words, ACROMION_SECRET="")

    assert ended.returncode != 0
    assert "401" in ended.stderr
