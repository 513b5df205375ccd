"""One server for the tests of a file that change nothing, and a finished analysis that they read."""

from collections.abc import Iterator

import pytest
from fastapi.testclient import TestClient

from acromion.app.main import create_app
from acromion.app.queue.worker import open_worker_context, run_next
from acromion.app.settings import Settings
from tests.app import stand_ins


@pytest.fixture(scope="module")
def shared_settings(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """Return the settings of the shared server, which are those of the other tests."""
    data = tmp_path_factory.mktemp("shared") / "data"
    return Settings(data_dir=data, min_free_bytes=0, max_upload_bytes=1_000_000)


@pytest.fixture(scope="module")
def shared_server(shared_settings: Settings) -> Iterator[TestClient]:
    with TestClient(
        create_app(shared_settings),
        base_url="http://localhost:8080",
        raise_server_exceptions=False,
        follow_redirects=False,
    ) as caller:
        yield caller


@pytest.fixture
def shared(shared_server: TestClient) -> TestClient:
    """Return a client, without cookies, of the server that all tests of the file share."""
    shared_server.cookies.clear()
    return shared_server


@pytest.fixture(scope="module")
def finished(shared_server: TestClient, shared_settings: Settings) -> str:
    """Return the address of a finished analysis of the shared server."""
    wishes = {"file_name": "Équipe 1.gt3x", "lang": "fr"}
    sent = shared_server.post("/api/v1/analyze", content=b"<b>recording", params=wishes)
    worker = open_worker_context(shared_settings, stand_ins.write_report)
    assert run_next(worker)
    worker.store.close()
    return sent.headers["location"]
