"""The same file gives the same bytes by the command line and by the API (the browser: tests/pages)."""

import subprocess
import sys
from pathlib import Path

from tests import ROOT
from tests.ways_in.conftest import StartServer
from tests.ways_in.servers import RunningServer

PRODUCTS = ("results.json", "elevation.parquet", "summary.csv", "report.html?lang=en", "report.pdf?lang=en")


def run_command(recording: Path, out: Path) -> Path:
    """Analyse by the command line; gives the recording's folder."""
    command = [sys.executable, "-m", "acromion", "run", str(recording), "-o", str(out)]
    subprocess.run([*command, "--side", "right", "--subject", "S012"], cwd=ROOT, check=True)
    return out / recording.stem


def fetch(server: RunningServer, analysis_id: str, name: str) -> bytes:
    return server.client.get(f"/api/v1/analyses/{analysis_id}/{name}").content


def test_command_line_and_api_give_the_same_bytes(
    start_server: StartServer, recording: Path, tmp_path: Path
) -> None:
    server = start_server()
    job = server.send(recording, side="right", subject="S012")

    by_command = run_command(recording, tmp_path / "out")

    assert server.see(job["id"], wait=60)["state"] == "succeeded"
    for product in PRODUCTS:
        written = (by_command / product.partition("?")[0]).read_bytes()
        assert fetch(server, job["id"], product) == written, product
