"""``PUT /api/v1/uploads/{id}/tail``: the last bytes, sent ahead, tell when a recording ends."""

import os
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from starlette.requests import Request

from app.api.library.uploads import store_tail
from app.errors import NotHere
from app.jobs.store import JobStore
from app.main import create_app
from app.services import find_services
from app.settings import Settings
from app.storage.incoming import Incoming
from app.storage.open import open_storage
from fusion.simulation import simulate_shift, write_shift
from tests.app.test_api_uploads import TUS, URL, announce, append, files_of

OCTETS = {"content-type": "application/octet-stream"}


@pytest.fixture(scope="module")
def gt3x(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """36 s that begin at 07:00, in some 80 kB."""
    folder = tmp_path_factory.mktemp("tail")
    return write_shift(folder, simulate_shift("gt9x", 0.01, 4), actilife_csv=False)[0].read_bytes()


def send_tail(client: TestClient, address: str, tail: bytes) -> int:
    return client.put(f"{address}/tail", content=tail, headers=OCTETS).status_code


def list_incoming(settings: Settings) -> list[str]:
    return sorted(path.name for path in (settings.data_dir / "incoming").iterdir())


def test_the_end_is_told_before_the_upload_is_whole(client: TestClient, gt3x: bytes) -> None:
    address = announce(client, len(gt3x) + 400_000, filename="shift.gt3x")
    append(client, address, 0, gt3x[:40_000])
    before = client.get(f"{address}/inspection").json()

    assert send_tail(client, address, gt3x[-2000:]) == 204

    after = client.get(f"{address}/inspection").json()
    assert (before["start"][:16], before["end"]) == ("2026-03-02T07:00", None)
    assert (after["start"][:16], after["end"][:16]) == ("2026-03-02T07:00", "2026-03-02T07:00")
    assert after["end"] > after["start"]
    assert client.get(address).json()["links"]["tail"] == f"{address}/tail"


def test_a_whole_upload_tells_its_end_without_a_tail(client: TestClient, gt3x: bytes) -> None:
    address = announce(client, len(gt3x), filename="shift.gt3x")
    append(client, address, 0, gt3x)

    found = client.get(f"{address}/inspection").json()

    assert found["end"] > found["start"]


def test_where_head_and_tail_meet_no_byte_is_read_twice(client: TestClient, gt3x: bytes) -> None:
    address = announce(client, len(gt3x), filename="shift.gt3x")
    append(client, address, 0, gt3x[:40_000])
    send_tail(client, address, gt3x[-65_536:])

    found = client.get(f"{address}/inspection").json()

    append(client, address, 40_000, gt3x[40_000:])
    assert client.get(f"{address}/inspection").json() == found


def test_a_tail_is_no_part_of_the_recording_and_gone_with_the_upload(
    client: TestClient, settings: Settings
) -> None:
    address = announce(client, 4)
    send_tail(client, address, b"other bytes")
    kept = list_incoming(settings)

    append(client, address, 0, b"0123")

    assert kept == [address.rpartition("/")[2] + ".tail"]
    (stored,) = [path for path in files_of(settings) if path.suffix != ".json"]
    assert open_storage(settings).read_part(f"recordings/{stored.name}", 0, 100) == b"0123"


def test_a_terminated_upload_leaves_no_tail(client: TestClient, settings: Settings) -> None:
    address = announce(client, 4)
    send_tail(client, address, b"3")

    client.delete(address, headers=TUS)

    assert list_incoming(settings) == []


def test_a_tail_that_comes_after_the_end_is_not_kept(client: TestClient, settings: Settings) -> None:
    address = announce(client, 4)
    append(client, address, 0, b"0123")

    assert send_tail(client, address, b"3") == 204
    assert list_incoming(settings) == []


def test_a_tail_that_is_written_while_its_upload_is_given_up_is_not_kept(
    client: TestClient, settings: Settings
) -> None:
    services = find_services(Request({"type": "http", "app": client.app}))

    with pytest.raises(NotHere):
        store_tail(services, "up_gone", b"3")

    assert list_incoming(settings) == []


def test_more_than_64_kib_is_no_tail(client: TestClient, settings: Settings) -> None:
    address = announce(client, 200_000)

    assert send_tail(client, address, bytes(65_536)) == 204
    assert send_tail(client, address, bytes(65_537)) == 413


def test_the_tail_of_an_unknown_upload_is_not_found(client: TestClient, settings: Settings) -> None:
    assert send_tail(client, f"{URL}/up_none", b"3") == 404
    assert list_incoming(settings) == []


def test_a_tail_of_another_kind_is_refused(client: TestClient) -> None:
    answer = client.put(f"{announce(client, 4)}/tail", content=b"3", headers={"content-type": "text/plain"})

    assert (answer.status_code, answer.json()["code"]) == (415, "E-MEDIA")


def test_tails_of_uploads_under_way_outlast_a_restart_and_others_do_not(
    store: JobStore, settings: Settings
) -> None:
    with TestClient(create_app(settings), base_url="http://127.0.0.1") as before:
        address = announce(before, 4)
        send_tail(before, address, b"3")
    name = address.rpartition("/")[2] + ".tail"
    gone = f"up_{'0' * 28}"
    for ending in ("tail", "0a1b"):
        stale = settings.data_dir / "incoming" / f"{gone}.{ending}"
        stale.write_bytes(b"3")
        os.utime(stale, (0, 0))

    with TestClient(create_app(settings), base_url="http://127.0.0.1"):
        kept = list_incoming(settings)

    assert kept == [name]


def test_a_tail_is_replaced_whole(tmp_path: Path) -> None:
    incoming = Incoming(tmp_path / "incoming")
    incoming.prepare()
    incoming.keep_tail("up_1", b"first")

    incoming.keep_tail("up_1", b"second")

    assert incoming.read_tail("up_1") == b"second"
    assert [path.name for path in incoming.folder.iterdir()] == ["up_1.tail"]
