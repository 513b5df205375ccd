"""The clients that people use: ``tuspy`` and ``tus-js-client`` bring whole recordings, also in two goes."""

import hashlib
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from tusclient.client import TusClient

from tests import ROOT
from tests.ways_in.conftest import StartServer
from tests.ways_in.servers import RunningServer


def sha256_at(server: RunningServer, address: str) -> str:
    """Return the hash of the recording that an upload became."""
    upload = server.client.get(address).json()
    recording = server.client.get(upload["links"]["recording"]).json()
    assert recording["file_name"] == "shift.gt3x"
    return str(recording["sha256"])


def test_tuspy_brings_a_recording_in_two_goes_between_which_the_server_was_killed(
    start_server: StartServer, recording: Path
) -> None:
    server = start_server()
    with recording.open("rb") as file:
        first = TusClient(f"{server.address}api/v1/uploads").uploader(
            file_stream=file, chunk_size=100_000, metadata={"filename": "shift.gt3x"}, upload_checksum=True
        )
        first.upload_chunk()  # type: ignore[no-untyped-call]
        place = str(first.url).removeprefix(server.address)
        server.kill()

        again = start_server()
        client = TusClient(f"{again.address}api/v1/uploads")
        rest = {"url": f"{again.address}{place}", "chunk_size": 100_000, "upload_checksum": True}
        client.uploader(file_stream=file, **rest).upload()

    assert first.offset == 100_000
    assert sha256_at(again, f"/{place}") == hashlib.sha256(recording.read_bytes()).hexdigest()


def find_tus_js_client(folder: Path) -> Path:
    """Return the folder whose ``node_modules`` holds tus-js-client, installed now where it is absent."""
    installed = os.environ.get("ACROMION_NODE_FOLDER")
    if installed:
        return Path(installed)
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("node and npm are absent")
    subprocess.run([npm, "install", "--silent", "--prefix", folder, "tus-js-client@4"], check=True)
    return folder


@pytest.mark.slow
def test_tus_js_client_brings_a_recording_in_two_goes(
    start_server: StartServer, recording: Path, tmp_path: Path
) -> None:
    folder = find_tus_js_client(tmp_path)
    server = start_server()
    script = ROOT / "tests" / "ways_in" / "upload.mjs"

    ended = subprocess.run(
        ["node", script, f"{server.address}api/v1/uploads", recording, folder],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )

    assert sha256_at(server, ended.stdout.strip()) == hashlib.sha256(recording.read_bytes()).hexdigest()
