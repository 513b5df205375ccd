"""A data folder with its database, and an application over it."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import uvicorn
from fastapi.testclient import TestClient

from acromion.app.analysis.attempt import MakeReport
from acromion.app.http.pages import rendering
from acromion.app.library.jobs import JobStore
from acromion.app.library.rows import Job
from acromion.app.main import configure_server, create_app
from acromion.app.ops import verify
from acromion.app.queue import worker
from acromion.app.queue.worker import WorkerContext, open_worker_context, run_next
from acromion.app.request import ReportRequest
from acromion.app.services import Services
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage, open_storage
from acromion.fusion.simulation import simulate_shift, write_shift
from tests.postgres import PostgresServer
from tests.swift import SwiftServer

AddJob = Callable[..., Job]
OpenWorker = Callable[..., WorkerContext]

on_both_set_ups = pytest.mark.parametrize(
    ("database", "objects"),
    [("sqlite", "folder"), ("postgresql", "s3")],
    ids=["embedded", "distributed"],
    indirect=True,
)

on_both_databases = pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)


def services_of(client: TestClient) -> Services:
    """Return the services of a server."""
    services: Services = client.app.state.services  # type: ignore[attr-defined]
    return services


@contextmanager
def serving(settings: Settings, **changes: object) -> Iterator[TestClient]:
    """Start and stop a server of other settings."""
    application = create_app(settings.model_copy(update=changes))
    with TestClient(application, base_url="http://localhost:8080", follow_redirects=False) as client:
        yield client


def do_next(worker: WorkerContext) -> bool:
    """Do the next job beside a running server: a worker passes over a row that the server is writing."""
    for _ in range(200):
        if run_next(worker):
            return True
        time.sleep(0.05)
    return False


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorten the pauses before a worker or a verification tries again: nobody is there to come back."""
    monkeypatch.setattr(worker, "TROUBLE_S", 0.2)
    monkeypatch.setattr(worker, "DEATH_GRACE_S", 0.05)
    monkeypatch.setattr(verify, "RECHECK_PAUSE_S", 0.01)
    monkeypatch.setattr(rendering, "SET_S", 0.0)


@pytest.fixture
def database(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty database: SQLite or, for tests parametrised so, PostgreSQL."""
    if getattr(request, "param", "sqlite") == "sqlite":
        return f"sqlite:///{tmp_path / 'data' / 'acromion.sqlite3'}"
    server: PostgresServer = request.getfixturevalue("postgres")
    server.empty()
    return server.url


@pytest.fixture
def objects(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Where recordings go: the folder or, for tests parametrised so, a bucket of a real S3 server."""
    if getattr(request, "param", "folder") == "folder":
        return ""
    server: SwiftServer = request.getfixturevalue("swift")
    for name, value in server.environment.items():
        monkeypatch.setenv(name, value)
    return server.make_bucket()


@pytest.fixture
def settings(tmp_path: Path, database: str, objects: str) -> Settings:
    """Settings of a folder of the test's own, on a disk that may be small."""
    return Settings(
        data_dir=tmp_path / "data",
        database_url=database,
        object_store=objects,
        min_free_bytes=0,
        max_upload_bytes=1_000_000,
    )


@pytest.fixture
def patience_s() -> float:
    """How long the server of :func:`address` waits for a head or a body."""
    return 1.0


@pytest.fixture
def address(settings: Settings, patience_s: float) -> Iterator[tuple[str, int]]:
    """Host and port of a server of little patience, over a real socket."""
    hasty = settings.model_copy(update={"header_patience_s": patience_s, "body_patience_s": patience_s})
    server = uvicorn.Server(configure_server(create_app(hasty), hasty))
    listener = socket.create_server(("127.0.0.1", 0))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
    thread.start()
    yield listener.getsockname()
    server.should_exit = True
    thread.join()
    listener.close()


@pytest.fixture
def storage(settings: Settings) -> Storage:
    """The folder or the bucket, prepared."""
    kept = open_storage(settings)
    kept.prepare()
    return kept


@pytest.fixture
def store(settings: Settings) -> Iterator[JobStore]:
    """A real database."""
    opened = JobStore(settings)
    yield opened
    opened.close()


@pytest.fixture
def add_job(store: JobStore, storage: Storage) -> AddJob:
    """Store a recording and queue its analysis."""

    def add(content: bytes = b"recording", file_name: str = "shift.gt3x", subject: str = "") -> Job:
        upload = storage.open_upload(1_000_000)
        upload.write(content)
        return store.add(upload.keep(), ReportRequest(file_name, subject))

    return add


@pytest.fixture
def open_worker(settings: Settings) -> Iterator[OpenWorker]:
    """Open workers of the folder with a stand-in for the analysis."""
    opened: list[WorkerContext] = []

    def make(make_report: MakeReport | None, **changes: object) -> WorkerContext:
        opened.append(open_worker_context(settings.model_copy(update=changes), make_report))
        return opened[-1]

    yield make
    for one in opened:
        one.store.close()


@pytest.fixture(scope="session")
def small_gt3x(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """One minute of a GT9X Link, well below the limit of the tests' server."""
    folder = tmp_path_factory.mktemp("minute")
    return write_shift(folder, simulate_shift("gt9x", 1 / 60, seed=1), actilife_csv=False)[0].read_bytes()


@pytest.fixture
def client(settings: Settings) -> Iterator[TestClient]:
    """The application, called as on this computer; bugs are answered, not raised."""
    application = create_app(settings)
    with TestClient(
        application, base_url="http://localhost:8080", raise_server_exceptions=False, follow_redirects=False
    ) as caller:
        yield caller
