"""Several servers on one PostgreSQL: one leads, rows are locked, the database goes away and comes back."""

import asyncio
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import Engine, text, update
from sqlalchemy.exc import OperationalError

from acromion.app.http.api.library.analyses import run_to_end
from acromion.app.library.database.connect import lock_requests, lock_tables, open_database
from acromion.app.library.database.tables import analyses, recordings
from acromion.app.library.jobs import JobStore
from acromion.app.library.recordings import Description, RecordingStore, insert_recording
from acromion.app.library.results import find_or_add
from acromion.app.library.rows import Job, JobState
from acromion.app.main import create_app
from acromion.app.queue.cluster import install, revive_if_leading
from acromion.app.queue.leader import REVIVAL, Leader
from acromion.app.queue.worker import run_next
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage, StoredRecording
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenWorker
from tests.loops import run_coroutine
from tests.postgres import PostgresServer
from tests.ways_in.servers import wait_for

on_postgresql = pytest.mark.parametrize("database", ["postgresql"], indirect=True)


@pytest.fixture
def engine(database: str) -> Iterator[Engine]:
    opened = open_database(database)
    yield opened
    opened.dispose()


@pytest.fixture
def leaders(engine: Engine, database: str) -> Iterator[tuple[Leader, Leader]]:
    """Two servers, each with connections of its own."""
    other = open_database(database)
    pair = Leader(engine), Leader(other)
    yield pair
    for leader in pair:
        leader.close()
    other.dispose()


@on_postgresql
def test_one_of_two_servers_leads(leaders: tuple[Leader, Leader]) -> None:
    one, other = leaders

    assert [one.is_leader(), other.is_leader(), one.is_leader()] == [True, False, True]


@on_postgresql
def test_the_other_takes_over_when_the_first_ends(leaders: tuple[Leader, Leader]) -> None:
    one, other = leaders
    one.is_leader()

    one.close()

    assert other.is_leader()


@on_postgresql
def test_a_leader_whose_connection_is_cut_leads_no_more(leaders: tuple[Leader, Leader]) -> None:
    one, other = leaders
    one.is_leader()
    cut = "SELECT pg_terminate_backend(pid, 60000) FROM pg_stat_activity WHERE pid <> pg_backend_pid()"
    with other.engine.connect() as connection:
        connection.execute(text(cut + " AND datname = current_database()"))

    with pytest.raises(OperationalError):
        one.is_leader()
    assert [other.is_leader(), one.is_leader()] == [True, False]


@on_postgresql
def test_a_leader_that_stands_still_leads_no_more(engine: Engine, leaders: tuple[Leader, Leader]) -> None:
    silent, other = Leader(engine, REVIVAL, silence_s=0.2), Leader(leaders[1].engine, REVIVAL, silence_s=60)
    assert silent.is_leader()

    wait_for(other.is_leader)

    with pytest.raises(OperationalError):
        silent.is_leader()
    other.close()


@on_postgresql
def test_upkeep_and_revival_have_a_leader_each(leaders: tuple[Leader, Leader]) -> None:
    one, other = leaders[0], Leader(leaders[1].engine, REVIVAL)

    assert [one.is_leader(), other.is_leader()] == [True, True]
    other.close()


@on_postgresql
def test_only_the_leader_puts_back_what_a_dead_worker_held(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker, leaders: tuple[Leader, Leader]
) -> None:
    install(store.engine.url.render_as_string(hide_password=False))
    job, workshop, (one, other) = add_job(), open_worker(stand_ins.write_report), leaders
    store.claim()
    store.run(update(analyses).values(lease_until_s=0.0, is_lease_missed=1))
    assert one.is_leader()

    assert not revive_if_leading(workshop, other)
    assert store.get(job.id).state is JobState.RUNNING
    assert revive_if_leading(workshop, one)
    assert store.get(job.id).state is JobState.QUEUED


def test_where_there_can_be_only_one_server_it_leads(engine: Engine) -> None:
    assert Leader(engine).is_leader()


def test_upkeep_is_waited_for_when_the_server_ends() -> None:
    began, may_end, ended = threading.Event(), threading.Event(), threading.Event()

    def work() -> None:
        began.set()
        may_end.wait(60)
        ended.set()

    async def cut_short() -> None:
        task = asyncio.create_task(run_to_end(work))
        await asyncio.to_thread(began.wait, 60)
        task.cancel()
        asyncio.get_running_loop().call_later(0.05, may_end.set)
        with pytest.raises(asyncio.CancelledError):
            await task
        assert ended.is_set()

    run_coroutine(cut_short())


# Rows that another transaction holds.


@on_postgresql
def test_a_job_whose_recording_is_being_written_waits_for_the_next_turn(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker
) -> None:
    job, at_work = add_job(), open_worker(stand_ins.write_report)
    with store.engine.begin() as connection:
        connection.execute(update(recordings).values(side_revision=0))
        passed_over = not run_next(at_work)

    run_next(at_work)

    assert passed_over
    assert store.get(job.id).state is JobState.SUCCEEDED


@on_postgresql
def test_the_same_upload_waits_for_the_one_that_is_being_stored_and_is_its_row(store: JobStore) -> None:
    first, second = (StoredRecording(f"rec_{n}", "ab" * 32, 3) for n in (1, 2))
    recordings_of = RecordingStore(store.engine, store.reader)
    with ThreadPoolExecutor(1) as other:
        with store.engine.begin() as connection:
            lock_tables(connection)
            insert_recording(connection, first, Description("shift.csv"))
            waiting = other.submit(recordings_of.add, second, Description("shift.csv"))
            time.sleep(0.3)

        assert waiting.result().id == first.id


@on_postgresql
def test_an_analysis_that_two_servers_are_asked_for_at_once_is_made_once(
    store: JobStore, storage: Storage, add_job: AddJob
) -> None:
    done = add_job()
    asked = replace(done.request, side="left")
    own = (done.recording_id, done.sha256)

    def add() -> Job:
        return store.add_analysis(own, asked)

    with ThreadPoolExecutor(1) as other:
        with lock_requests(store.engine):  # the other server's
            waiting = other.submit(find_or_add, store, storage, own, asked, "api", add)
            time.sleep(0.3)
            made = add()

        assert waiting.result() == (made, True)


# PostgreSQL goes away and comes back: nothing is acknowledged meanwhile, and nothing is lost.


@on_postgresql
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


@on_postgresql
def test_the_server_goes_on_when_the_database_is_back(client: TestClient, postgres: PostgresServer) -> None:
    client.post("/api/v1/analyze", content=b"one recording")

    postgres.stop("immediate")
    postgres.start()

    assert client.post("/api/v1/analyze", content=b"another").status_code == 202
    assert len(client.get("/api/v1/analyses").json()["items"]) == 2


@on_postgresql
def test_an_analysis_outlasts_a_restart_of_the_database(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker, postgres: PostgresServer
) -> None:
    job = add_job()
    worker = threading.Thread(target=run_next, args=(open_worker(stand_ins.write_in_a_second),))
    worker.start()
    while store.get(job.id).stage is None:
        time.sleep(0.02)

    postgres.stop("immediate")
    time.sleep(1.5)
    postgres.start()
    worker.join(20)

    assert (store.get(job.id).state, store.get(job.id).attempts) == (JobState.SUCCEEDED, 1)
