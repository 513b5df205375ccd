"""The reader of another package reads its file by page, API and command line."""

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

from tests import ROOT
from tests.pages.conftest import keep_picture
from tests.pages.steps import open_home, see_end, wait_for_end
from tests.plugin import install, make_environment, read_blocks, write_armband, write_wheel
from tests.ways_in.servers import RunningServer


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of a fresh environment with the reader of the page installed."""
    folder = tmp_path_factory.mktemp("fresh")
    made = make_environment(folder / "venv")
    install(made, write_wheel(folder, read_blocks()[1], "1.2"))
    return made


@pytest.fixture(scope="module")
def armband(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_armband(tmp_path_factory.mktemp("armband"))


@pytest.fixture(scope="module")
def reading(python: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """A server of that environment."""
    folder = tmp_path_factory.mktemp("server")
    running = RunningServer(folder / "data", folder / "server.log", python=str(python))
    yield running
    running.stop()


def run_command(python: Path, armband: Path, out: Path) -> subprocess.CompletedProcess[str]:
    command = [str(python), "-m", "acromion", "run", str(armband), "-o", str(out), "--report", "html"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_all_three_ways_in_read_its_file_to_the_same_results(
    page: Page, reading: RunningServer, python: Path, armband: Path, tmp_path: Path
) -> None:
    command = run_command(python, armband, tmp_path / "out")
    open_home(page, reading)
    page.set_input_files("#files", str(armband))
    wait_for_end(page, "shift.acme")
    keep_picture(page, "plugin")
    (dropped,) = reading.client.get("/api/v1/analyses").json()["items"]
    again = reading.send(armband, again="true")["id"]

    assert command.returncode == 0, command.stderr
    assert see_end(reading, again)["state"] == "succeeded"
    by_page, by_api = (
        reading.client.get(f"/api/v1/analyses/{job}/results.json").content for job in (dropped["id"], again)
    )
    assert by_page == by_api == (tmp_path / "out" / "shift" / "results.json").read_bytes()
    results = json.loads(by_page)
    assert results["software"]["reader"] == {"name": "acme-armband", "version": "1.2"}
    assert results["recording"]["device"] == "Acme armband"
    assert results["recording"]["rate_hz"] == 100
    assert results["recording"]["start"] == "2026-03-02T08:00:00+00:00"
    report = reading.client.get(f"/api/v1/analyses/{again}/report.html").text
    assert ("Acme armband" in report, "acme-armband 1.2" in report) == (True, True)


def test_a_new_version_of_the_reader_is_a_reason_to_analyse_again(armband: Path, tmp_path: Path) -> None:
    python = make_environment(tmp_path / "venv")
    install(python, write_wheel(tmp_path, read_blocks()[1], "1.2"))
    run_command(python, armband, tmp_path / "out")
    same = run_command(python, armband, tmp_path / "out")

    install(python, write_wheel(tmp_path, read_blocks()[1], "1.3"))
    newer = run_command(python, armband, tmp_path / "out")

    results = json.loads((tmp_path / "out" / "shift" / "results.json").read_bytes())
    assert results["software"]["reader"]["version"] == "1.3"
    assert "already done" in same.stdout
    assert "already done" not in newer.stdout
