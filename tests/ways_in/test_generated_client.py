"""A Python client made from the OpenAPI document by openapi-python-client, and used."""

import importlib
import os
import subprocess
import sys
import venv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.ways_in.conftest import StartServer
from tests.ways_in.servers import RunningServer, wait_for

pytestmark = pytest.mark.slow


@pytest.fixture(scope="session")
def generator(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """openapi-python-client in an environment of its own: it wants another typer than we do."""
    installed = os.environ.get("ACROMION_CLIENT_GENERATOR")
    if installed:
        return Path(installed)
    folder = tmp_path_factory.mktemp("generator")
    venv.create(folder, with_pip=True)
    command = [str(folder / "bin" / "pip"), "install", "--quiet", "openapi-python-client>=0.26"]
    subprocess.run(command, check=True)
    return folder / "bin" / "openapi-python-client"


@pytest.fixture
def server(start_server: StartServer, generator: Path, tmp_path: Path) -> Iterator[RunningServer]:
    """A running server whose generated client can be imported."""
    running = start_server()
    document = tmp_path / "openapi.json"
    document.write_bytes(running.client.get("/api/v1/openapi.json").content)
    command = [str(generator), "generate", "--path", str(document), "--meta", "none", "--output-path"]
    told = subprocess.run(
        [*command, str(tmp_path / "acromion_client")], capture_output=True, text=True, check=True
    )
    assert "Unable to parse" not in told.stdout, told.stdout
    sys.path.insert(0, str(tmp_path))
    yield running
    sys.path.remove(str(tmp_path))


def find_ended(analysis: Any) -> Any:
    """Return the analysis once it is over."""
    return analysis if analysis.state in ("succeeded", "failed", "cancelled") else None


def test_the_generated_client_stores_analyses_and_reads_a_recording(
    server: RunningServer, recording: Path
) -> None:
    kept = server.client.post("/api/v1/recordings", content=recording.read_bytes()).json()["id"]
    made = importlib.import_module("acromion_client").Client(base_url=server.address.rstrip("/"))
    models = importlib.import_module("acromion_client.models")
    create = importlib.import_module("acromion_client.api.analyses.create_analyses").sync
    get = importlib.import_module("acromion_client.api.analyses.get_analysis").sync
    settings = models.AnalysisSettings(side=models.AnalysisSettingsSideType0.RIGHT)
    wish = models.AnalysisWish(recording_ids=[kept], settings=settings)

    with made as client:
        started = create(client=client, body=wish)
        ended = wait_for(lambda: find_ended(get(started.id, client=client, wait=20)), patience_s=180)

    assert ended.state == "succeeded"
    assert ended.settings.additional_properties["side"] == "right"
