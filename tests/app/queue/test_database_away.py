"""PostgreSQL goes away and comes back: nothing is acknowledged meanwhile, and nothing is lost."""

import threading
import time

import pytest
from fastapi.testclient import TestClient

from app.jobs.job import JobState
from app.jobs.store import JobStore
from app.jobs.worker import run_next
from app.main import create_app
from app.settings import Settings
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenBench
from tests.postgres import PostgresServer

pytestmark = pytest.mark.parametrize("database", ["postgresql"], indirect=True)


def test_an_upload_while_the_database_is_away_is_answered_503_and_is_swept_at_the_next_start(
    client: TestClient, settings: Settings, postgres: PostgresServer
) -> None:
    postgres.stop()
    try:
        answer = client.post("/api/v1/analyze", content=b"recording")
    finally:
        postgres.start()

    assert (answer.status_code, answer.json()["code"]) == (503, "E-DATABASE")
    assert answer.headers["retry-after"] == "5"
    client.__exit__()
    with TestClient(create_app(settings)):
        assert list((settings.data_dir / "recordings").iterdir()) == []


def test_the_server_goes_on_when_the_database_is_back(client: TestClient, postgres: PostgresServer) -> None:
    client.post("/api/v1/analyze", content=b"one recording")

    postgres.stop("immediate")
    postgres.start()

    assert client.post("/api/v1/analyze", content=b"another").status_code == 202
    assert len(client.get("/api/v1/analyses").json()["items"]) == 2


def test_an_analysis_outlasts_a_restart_of_the_database(
    store: JobStore, add_job: AddJob, bench: OpenBench, postgres: PostgresServer
) -> None:
    job = add_job()
    worker = threading.Thread(target=run_next, args=(bench(stand_ins.write_in_a_second),))
    worker.start()
    while store.get(job.id).stage is None:
        time.sleep(0.02)

    postgres.stop("immediate")
    time.sleep(1.5)
    postgres.start()
    worker.join(20)

    assert (store.get(job.id).state, store.get(job.id).attempts) == (JobState.SUCCEEDED, 1)
