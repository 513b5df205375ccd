"""Several web servers on one database: one keeps house for all, so that no term passes twice as fast."""

import asyncio
import threading
from collections.abc import Iterator

import pytest
from sqlalchemy import Engine, text
from sqlalchemy.exc import OperationalError

from app.api.analyses import run_to_end
from app.jobs.database.connect import open_database
from app.jobs.leader import Keeper

on_postgresql = pytest.mark.parametrize("database", ["postgresql"], indirect=True)


@pytest.fixture
def engine(database: str) -> Iterator[Engine]:
    opened = open_database(database)
    yield opened
    opened.dispose()


@pytest.fixture
def keepers(engine: Engine, database: str) -> Iterator[tuple[Keeper, Keeper]]:
    """Two servers, each with connections of its own."""
    other = open_database(database)
    pair = Keeper(engine), Keeper(other)
    yield pair
    for keeper in pair:
        keeper.close()
    other.dispose()


@on_postgresql
def test_one_of_two_servers_keeps_house(keepers: tuple[Keeper, Keeper]) -> None:
    one, other = keepers

    assert [one.holds_office(), other.holds_office(), one.holds_office()] == [True, False, True]


@on_postgresql
def test_the_other_takes_over_when_the_first_ends(keepers: tuple[Keeper, Keeper]) -> None:
    one, other = keepers
    one.holds_office()

    one.close()

    assert other.holds_office()


@on_postgresql
def test_a_keeper_whose_connection_is_cut_has_lost_the_office(keepers: tuple[Keeper, Keeper]) -> None:
    one, other = keepers
    one.holds_office()
    cut = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid()"
    with other.engine.connect() as connection:
        connection.execute(text(cut + " AND datname = current_database()"))

    with pytest.raises(OperationalError):
        one.holds_office()
    assert [other.holds_office(), one.holds_office()] == [True, False]


def test_where_one_server_is_all_there_can_be_it_keeps_house(engine: Engine) -> None:
    assert Keeper(engine).holds_office()


def test_what_keeps_house_is_waited_for_when_the_server_ends() -> None:
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

    asyncio.run(cut_short())
