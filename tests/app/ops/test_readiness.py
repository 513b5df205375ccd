"""``/readyz``: 200 while uploads are taken; else 503, and the body names what is wrong."""

import os
import shutil
import sqlite3
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import pytest
from fastapi.testclient import TestClient

from acromion.app.errors import StoreAway
from acromion.app.main import create_app
from acromion.app.services import Readiness
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage
from tests.app.conftest import on_both_set_ups
from tests.postgres import PostgresServer

GOOD = {"folder": "ok", "disk": "ok", "database": "ok", "store": "ok", "queue": "ok"}


@dataclass
class StrangeStore:
    """The server's store, with another way of answering."""

    storage: Storage
    answer: Any

    def __getattr__(self, name: str) -> object:
        return self.answer if name == "prepare" else getattr(self.storage, name)


def ask(settings: Settings, **changes: object) -> tuple[int, dict[str, Any]]:
    with TestClient(create_app(settings.model_copy(update=changes)), base_url="http://localhost") as caller:
        answer = caller.get("/readyz")
    return answer.status_code, answer.json()


def ask_with_store(settings: Settings, prepare: Any) -> tuple[int, dict[str, Any]]:
    application = create_app(settings)
    services = application.state.services
    strange = cast("Storage", StrangeStore(services.storage, prepare))
    readiness = Readiness(services.store, strange, settings)
    object.__setattr__(services, "readiness", readiness)
    with TestClient(application, base_url="http://localhost") as caller:
        answer = caller.get("/readyz")
    return answer.status_code, answer.json()


def say_away() -> None:
    raise StoreAway


@on_both_set_ups
def test_a_server_that_takes_uploads_is_ready(settings: Settings) -> None:
    status, body = ask(settings)

    assert (status, body["status"], body["checks"]) == (200, "ok", GOOD)
    assert body["analyses"]["queued"] == 0


def test_readiness_tells_the_state_of_the_queue(client: TestClient) -> None:
    client.post("/api/v1/analyze", content=b"x")

    assert client.get("/readyz").json()["analyses"]["queued"] == 1


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [({"min_free_bytes": 1 << 60}, {"disk": "E-DISK"}), ({"max_queued": 0}, {"queue": "E-BUSY"})],
)
def test_too_little_room_and_a_full_queue_are_not_ready(
    settings: Settings, changes: dict[str, int], wrong: dict[str, str]
) -> None:
    status, body = ask(settings, **changes)

    assert (status, body) == (503, {"status": "unready", "checks": GOOD | wrong})


@pytest.mark.parametrize("hangs", [False, True], ids=["away", "hangs"])
def test_a_store_that_is_away_or_hangs_is_not_ready_and_holds_nobody(settings: Settings, hangs: bool) -> None:
    back = threading.Event()

    status, body = ask_with_store(settings, back.wait if hangs else say_away)

    back.set()
    assert (status, body["checks"]) == (503, GOOD | {"store": "E-STORE"})


def test_a_database_locked_for_writing_is_not_ready_until_it_is_free(
    client: TestClient, settings: Settings
) -> None:
    holder = sqlite3.connect(settings.data_dir / "acromion.sqlite3", isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")

    locked = client.get("/readyz")
    holder.close()
    while client.get("/readyz").status_code != 200:
        time.sleep(0.1)

    assert (locked.status_code, locked.json()["checks"]) == (503, GOOD | {"database": "E-DATABASE-LOCKED"})


@pytest.mark.parametrize("database", ["postgresql"], indirect=True)
def test_postgresql_away_is_not_ready(client: TestClient, postgres: PostgresServer) -> None:
    postgres.stop()
    try:
        answer = client.get("/readyz")
    finally:
        postgres.start()

    assert answer.status_code == 503
    assert answer.json()["checks"]["database"] == "E-DATABASE"


@pytest.fixture
def read_only_recordings(settings: Settings) -> Iterator[Path]:
    """The folder of the recordings, which cannot be written."""
    folder = settings.data_dir / "recordings"
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("no root to mount a folder with")
    folder.mkdir(parents=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "tmpfs", str(folder)], check=True)
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_folder_that_cannot_be_written_is_not_ready(settings: Settings, read_only_recordings: Path) -> None:
    status, body = ask(settings)

    assert (status, body["checks"]) == (503, GOOD | {"folder": "E-FOLDER-READ-ONLY"})
