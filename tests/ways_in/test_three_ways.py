"""The same file gives the same bytes by the command line and by the API (the browser: tests/pages)."""

import io
import subprocess
import sys
from pathlib import Path

from pypdf import PdfReader

from tests.ways_in.conftest import StartServer
from tests.ways_in.servers import ROOT, RunningServer

PRODUCTS = ("results.json", "elevation.parquet", "summary.csv", "report.html?lang=en", "report.pdf?lang=en")


def run_command(recording: Path, out: Path) -> Path:
    """Analyse by the command line; gives the recording's folder."""
    command = [sys.executable, "-m", "app", "run", str(recording), "-o", str(out)]
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


def test_another_paper_is_another_pdf_of_the_same_version(start_server: StartServer, recording: Path) -> None:
    server = start_server()
    first = server.send(recording)["id"]
    server.see(first, wait=60)

    again = server.send(recording, paper="letter")["id"]

    seen = server.see(again, wait=60)
    pages = [PdfReader(io.BytesIO(fetch(server, job, "report.pdf"))).pages[0] for job in (first, again)]
    assert seen["settings"]["paper"] == "letter"
    assert [(round(page.mediabox.width), round(page.mediabox.height)) for page in pages] == [
        (595, 842),
        (612, 792),
    ]
    assert fetch(server, first, "results.json") == fetch(server, again, "results.json")


def test_a_file_that_is_no_recording_is_refused_alike_by_both(
    start_server: StartServer, tmp_path: Path
) -> None:
    notes = tmp_path / "notes.csv"
    notes.write_text("Dear diary,\ntoday I lifted boxes.\n")
    server = start_server()
    job = server.send(notes)
    command = [sys.executable, "-m", "app", "run", str(notes), "-o", str(tmp_path / "out")]

    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)

    problem = server.see(job["id"], wait=60)["problem"]
    assert ended.returncode == 3
    assert problem["code"] in ended.stderr
    assert problem["fix"] in ended.stderr
