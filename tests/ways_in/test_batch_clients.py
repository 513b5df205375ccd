"""The clients of ``docs/code`` that analyse a folder on a server, and the body of a batch in the page."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import ROOT
from tests.app.cli.typed import read_table
from tests.ways_in.servers import RunningServer

CODE = ROOT / "docs" / "code"
PYTHON = (sys.executable, str(CODE / "batch.py"))
R = ("Rscript", str(CODE / "batch.R"))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder = tmp_path_factory.mktemp("server")
    running = RunningServer(folder / "data", folder / "server.log", ACROMION_NO_SECRET="0")
    yield running
    running.stop()


@pytest.fixture
def folder(recording: Path, tmp_path: Path) -> Path:
    """Two recordings, one of which is none."""
    (tmp_path / "007.gt3x").write_bytes(recording.read_bytes())
    (tmp_path / "S02.gt3x").write_bytes(b"PK\x03\x04")
    return tmp_path


def run(
    client: tuple[str, ...], folder: Path, server: RunningServer, secret: str
) -> "subprocess.CompletedProcess[str]":
    command = [*client, str(folder), server.address.rstrip("/")]
    environment = os.environ | {"ACROMION_SECRET": secret}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


@pytest.mark.parametrize("client", [PYTHON, pytest.param(R, marks=pytest.mark.slow)], ids=["Python", "R"])
def test_a_client_of_forty_lines_turns_a_folder_into_tables(
    client: tuple[str, ...], folder: Path, server: RunningServer
) -> None:
    if shutil.which(client[0]) is None:
        pytest.skip("R is absent")

    ended = run(client, folder, server, (server.data / "secret").read_text("utf-8"))

    assert ended.returncode == 0, ended.stderr
    rows = read_table(folder / "summary.csv")
    assert [(row["subject"], row["calibration_state"] != "", row["error_code"] != "") for row in rows] == [
        ("007", True, False),
        ("S02", False, True),
    ]
    assert [row["file_name"] for row in read_table(folder / "problems.csv")] == ["S02.gt3x"]
    assert len(Path(client[1]).read_text("utf-8").splitlines()) <= 40


@pytest.mark.parametrize("client", [PYTHON, pytest.param(R, marks=pytest.mark.slow)], ids=["Python", "R"])
def test_a_client_without_the_secret_is_refused(
    client: tuple[str, ...], folder: Path, server: RunningServer
) -> None:
    if shutil.which(client[0]) is None:
        pytest.skip("R is absent")

    ended = run(client, folder, server, "")

    assert ended.returncode != 0
    assert "401" in ended.stderr


def test_the_body_of_a_batch_in_the_page_is_one_that_the_server_takes(
    folder: Path, server: RunningServer
) -> None:
    (text,) = re.findall(r"```json\n(.*?)```", (ROOT / "docs" / "api.md").read_text("utf-8"), re.DOTALL)
    who = {"Authorization": f"Bearer {(server.data / 'secret').read_text('utf-8')}"}
    body = json.loads(text)
    for k, item in enumerate(body["items"]):
        stored = server.client.post("/api/v1/recordings", content=bytes([k]), headers=who)
        item["recording_id"] = stored.json()["id"]

    batch = server.client.post("/api/v1/batches", json=body, headers=who)

    assert batch.status_code == 202, batch.text
    listed = server.client.get("/api/v1/batches", headers=who).json()["items"]
    assert batch.json()["id"] in [one["id"] for one in listed]
