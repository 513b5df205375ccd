"""The examples of ``docs/api.md`` are run, as they stand there, against a running server."""

import csv
import io
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from acromion.app.main import create_app
from acromion.app.settings import Settings
from tests import ROOT
from tests.ways_in.servers import RunningServer

PAGE = (ROOT / "docs" / "api.md").read_text("utf-8")
BLOCKS = re.findall(r"```(sh|python|r)\n(.*?)```", PAGE, re.DOTALL)
EXAMPLES = {kind: "\n".join(body for of, body in BLOCKS if of == kind) for kind in ("sh", "python", "r")}


@pytest.fixture(scope="module")
def example_folder(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a recording, and in a file the address of a server that asks who comes."""
    folder = tmp_path_factory.mktemp("examples")
    (folder / "shift.gt3x").write_bytes(recording.read_bytes())
    server = RunningServer(folder / "data", folder / "server.log", ACROMION_NO_SECRET="0")
    (folder / "address").write_text(server.address.rstrip("/"))
    yield folder
    server.stop()


def run(command: list[str], folder: Path) -> str:
    secret = (folder / "data" / "secret").read_text()
    environment = os.environ | {"ACROMION": (folder / "address").read_text(), "SECRET": secret}
    ended = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return ended.stdout


def test_the_six_calls_with_curl_end_with_the_table_of_a_batch(example_folder: Path) -> None:
    run(["sh", "-e", "-c", EXAMPLES["sh"]], example_folder)

    analysis = json.loads((example_folder / "analysis.json").read_text())
    assert (analysis["file_name"], analysis["settings"]["subject"]) == ("shift.gt3x", "S012")
    results = json.loads((example_folder / "results.json").read_text())
    assert results["exposure"]["time_above"]
    assert (example_folder / "report.pdf").read_bytes().startswith(b"%PDF")
    (row,) = csv.DictReader(io.StringIO((example_folder / "summary.csv").read_text("utf-8-sig")))
    assert (row["subject"], row["error_code"]) == ("S013", "")


def test_the_example_in_python_prints_the_time_above_60_degrees(example_folder: Path) -> None:
    printed = run([sys.executable, "-c", EXAMPLES["python"]], example_folder)

    assert "'threshold_deg': 60" in printed


@pytest.mark.slow
def test_the_example_in_r_prints_the_time_above_60_degrees(example_folder: Path) -> None:
    if shutil.which("Rscript") is None:
        pytest.skip("R is absent")

    assert "[1]" in run(["Rscript", "-e", EXAMPLES["r"]], example_folder)


def test_every_address_of_the_page_exists(tmp_path: Path) -> None:
    known = create_app(Settings(data_dir=tmp_path)).openapi()["paths"]
    patterns = [re.sub(r"\{[^}]+\}", "[^/]+", path.removeprefix("/api/v1")) + "$" for path in known]

    asked = re.findall(r"(?:GET|PUT|POST|PATCH|DELETE) (/[\w/{}.-]+)", PAGE)

    assert asked
    assert [path for path in asked if not any(re.match(pattern, path) for pattern in patterns)] == []
