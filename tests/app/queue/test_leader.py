"""Several processes on one database: one leads, for all the others."""

import asyncio
import threading
from collections.abc import Iterator

import pytest
from sqlalchemy import Engine, text, update
from sqlalchemy.exc import OperationalError

from app.api.library.analyses import run_to_end
from app.jobs.cluster import install, revive_if_leading
from app.jobs.database.connect import open_database
from app.jobs.database.tables import analyses
from app.jobs.job import JobState
from app.jobs.leader import REVIVAL, Leader
from app.jobs.store import JobStore
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenBench
from tests.loops import run_coroutine
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
    store: JobStore, add_job: AddJob, bench: OpenBench, leaders: tuple[Leader, Leader]
) -> None:
    install(store.engine.url.render_as_string(hide_password=False))
    job, workshop, (one, other) = add_job(), bench(stand_ins.write_report), leaders
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
