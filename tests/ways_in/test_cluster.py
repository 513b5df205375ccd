"""Workers on many machines: PostgreSQL, a bucket and Procrastinate, each real."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from sqlalchemy import text

from acromion.app.library.database.connect import connect
from acromion.app.library.jobs import JobStore
from acromion.app.library.rows import JobState
from acromion.app.queue.cluster import install
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage, open_storage
from tests import ROOT
from tests.postgres import PostgresServer
from tests.swift import SwiftServer
from tests.ways_in.servers import wait_for

StartWorker = Callable[..., subprocess.Popen[bytes]]


@pytest.fixture
def settings(
    tmp_path: Path, postgres: PostgresServer, swift: SwiftServer, monkeypatch: pytest.MonkeyPatch
) -> Settings:
    """Settings that every machine shares, but for its folder."""
    postgres.empty()
    for name, value in swift.environment.items():
        monkeypatch.setenv(name, value)
    return Settings(
        data_dir=tmp_path / "web",
        database_url=postgres.url,
        object_store=swift.make_bucket(),
        engine="procrastinate",
        lease_s=2.0,
    )


@pytest.fixture
def storage(settings: Settings) -> Storage:
    opened = open_storage(settings)
    opened.prepare()
    return opened


@pytest.fixture
def store(settings: Settings) -> Iterator[JobStore]:
    opened = JobStore(settings)
    install(settings.database_url)
    yield opened
    opened.close()


@pytest.fixture
def start_worker(settings: Settings, tmp_path: Path) -> Iterator[StartWorker]:
    """Start workers, each with a folder of its own and the first machine's key, as on another machine."""
    started: list[subprocess.Popen[bytes]] = []

    def start(stand_in: str) -> subprocess.Popen[bytes]:
        folder = tmp_path / f"worker{len(started)}"
        folder.mkdir()
        command = [sys.executable, "-m", "tests.ways_in.cluster_worker", str(folder), stand_in]
        environment = os.environ | settings.as_environment()
        started.append(subprocess.Popen(command, cwd=ROOT, env=environment))
        return started[-1]

    yield start
    for worker in started:
        worker.kill()
        worker.wait()


def queue_job(store: JobStore, storage: Storage) -> str:
    upload = storage.open_upload(100)
    upload.write(b"recording")
    return store.add(upload.keep(), ReportRequest("shift.gt3x")).id


def count_wake_ups(settings: Settings) -> int:
    engine = connect(settings.database_url)
    with engine.connect() as connection:
        number = connection.execute(text("SELECT count(*) FROM procrastinate_jobs")).scalar_one()
    engine.dispose()
    return int(number)


def test_a_row_and_its_wake_up_are_committed_together_and_rows_of_before_are_woken(
    settings: Settings, store: JobStore, storage: Storage
) -> None:
    queue_job(store, storage)
    counts = [count_wake_ups(settings)]
    with store._engine.connect() as connection, connection.begin() as change:
        connection.execute(text("UPDATE analyses SET state = 'queued'"))
        change.rollback()
    counts.append(count_wake_ups(settings))
    with store._engine.begin() as connection:
        connection.execute(text("DELETE FROM procrastinate_jobs"))  # as before the engine was chosen

    install(settings.database_url)

    assert [*counts, count_wake_ups(settings)] == [1, 1, 1]


def test_a_lost_wake_up_is_made_good_while_a_worker_lives(
    store: JobStore, storage: Storage, start_worker: StartWorker
) -> None:
    first = queue_job(store, storage)
    start_worker("write_report")
    wait_for(lambda: store.get(first).is_over)
    with store._engine.begin() as connection:
        connection.execute(text("ALTER TABLE analyses DISABLE TRIGGER acromion_wake"))
    second = queue_job(store, storage)

    with store._engine.begin() as connection:
        connection.execute(text("ALTER TABLE analyses ENABLE TRIGGER acromion_wake"))

    wait_for(lambda: store.get(second).is_over)


def test_two_workers_do_every_job_once(store: JobStore, storage: Storage, start_worker: StartWorker) -> None:
    jobs = [queue_job(store, storage) for _ in range(6)]

    for _ in range(2):
        start_worker("write_report")
    wait_for(lambda: all(store.get(job).is_over for job in jobs))

    assert {store.get(job).state for job in jobs} == {JobState.SUCCEEDED}
    assert [store.get(job).attempts for job in jobs] == [1] * 6
    token = store.get(jobs[0]).token
    assert token is not None
    assert storage.fetch(f"analyses/{jobs[0]}/{token}/report.en.pdf").path.read_bytes() == b"%PDF-en"


def test_the_job_of_a_killed_worker_is_done_by_another(
    store: JobStore, storage: Storage, start_worker: StartWorker
) -> None:
    job = queue_job(store, storage)
    doomed = start_worker("write_slowly")
    wait_for(lambda: store.get(job).stage == "fusing")
    start_worker("write_report")

    doomed.kill()

    wait_for(lambda: store.get(job).is_over)
    done = store.get(job)
    assert (done.state, done.attempts, done.interruptions) == (JobState.SUCCEEDED, 1, 1)


def test_a_worker_asked_to_stop_puts_its_job_back_and_ends_well(
    store: JobStore, storage: Storage, start_worker: StartWorker
) -> None:
    job = queue_job(store, storage)
    worker = start_worker("write_slowly")
    wait_for(lambda: store.get(job).stage == "fusing")

    worker.terminate()

    assert worker.wait(15) == 0
    assert (store.get(job).state, store.get(job).attempts) == (JobState.QUEUED, 0)


def test_workers_go_on_after_a_restart_of_the_database(
    store: JobStore, storage: Storage, start_worker: StartWorker, postgres: PostgresServer
) -> None:
    first = queue_job(store, storage)
    start_worker("write_report")
    wait_for(lambda: store.get(first).is_over)

    postgres.stop("immediate")
    postgres.start()
    second = queue_job(store, storage)

    wait_for(lambda: store.get(second).is_over)
    assert store.get(second).state is JobState.SUCCEEDED
