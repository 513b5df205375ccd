"""What lasts ends with the login, within five seconds: an open stream of events, a live session."""

import re
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import httpx2
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from acromion.app.accounts.accounts import AccountStore, Person
from acromion.app.settings import Settings
from tests.ways_in.servers import RunningServer

MOST_S = 5.0


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lasting") / "data"


@pytest.fixture(scope="module")
def server(data: Path) -> Iterator[RunningServer]:
    """A real server without workers: what is asked for waits, so that its events go on."""
    data.parent.mkdir(exist_ok=True)
    running = RunningServer(data, data.parent / "log", workers=0, ACROMION_NO_SECRET="0")
    yield running
    running.stop()


@pytest.fixture
def accounts(data: Path) -> Iterator[AccountStore]:
    opened = AccountStore(Settings(data_dir=data))
    yield opened
    opened.database.close()


@pytest.fixture
def person(accounts: AccountStore, server: RunningServer) -> Person:
    found = accounts.find_person("clara") or accounts.add_person("clara", "Clara", ["clinician"])
    accounts.resume_person(found.id)
    return found


Begin = Callable[[], dict[str, str]]


@pytest.fixture(params=["session", "token"])
def header(
    request: pytest.FixtureRequest, server: RunningServer, accounts: AccountStore, person: Person
) -> dict[str, str]:
    """What a request brings: a session's cookie or a token."""
    if request.param == "session":
        port = urlsplit(server.address).port
        return {"cookie": f"acromion_session_{port}={accounts.begin_session(person.id)}"}
    token = accounts.add_token(person.id, "script", ["read", "upload"], time.time() + 3600)
    return {"authorization": f"Bearer {token}"}


def wait_until_open(server: RunningServer, header: dict[str, str]) -> None:
    """The server looks once a second whether there are accounts."""
    for _ in range(1000):
        if httpx2.get(f"{server.address}api/v1/version", headers=header).status_code == 200:
            return
        time.sleep(0.1)
    pytest.fail("nobody is let in")


def test_a_stream_of_events_ends_with_its_person(
    server: RunningServer, accounts: AccountStore, person: Person, header: dict[str, str]
) -> None:
    wait_until_open(server, header)
    sent = httpx2.post(
        f"{server.address}api/v1/analyze",
        params={"file_name": "waiting.csv"},
        content=b"nobody reads this",
        headers=header,
    )
    address = f"{server.address}api/v1/analyses/{sent.json()['id']}/events"

    with httpx2.stream("GET", address, headers=header, timeout=120) as events:
        assert events.status_code == 200
        pieces = events.iter_raw()
        next(pieces)
        accounts.end_person(person.id)
        began_s = time.monotonic()
        with suppress(httpx2.RemoteProtocolError):
            deque(pieces)

    assert time.monotonic() - began_s < MOST_S


def test_a_live_session_ends_with_its_person(
    server: RunningServer, accounts: AccountStore, person: Person, header: dict[str, str]
) -> None:
    wait_until_open(server, header)
    address = re.sub("^http", "ws", server.address) + "api/v1/live"

    with connect(address, additional_headers=header) as session:
        accounts.end_person(person.id)
        began_s = time.monotonic()
        with suppress(ConnectionClosed):
            deque(session)

    assert time.monotonic() - began_s < MOST_S
