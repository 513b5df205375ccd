"""After a purge no word of a recording is left: in no table, in no file of the data folder, in no object."""

import base64
import logging
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from app.api.housekeeping import grow_older
from app.jobs.database.tables import metadata
from app.jobs.store import JobStore
from app.jobs.webhooks import EVENTS, WebhookStore
from app.services import Services
from app.settings import Settings
from app.storage.decoded import DecodedCache, hash_entry_key
from app.storage.server_secret import ServerSecret
from app.storage.store import Storage
from tests.app import stand_ins
from tests.app.conftest import OpenBench, do_next, on_both_set_ups, services_of
from tests.factories import hold

CANARY = "canary-5f2c71d09ab84e36c1f7a2d8e"
WORDS = {"file_name": f"{CANARY}.gt3x", "subject": CANARY, "external_id": CANARY, "note": CANARY}
PERIODS = [{"start_s": 0, "end_s": 60, "kind": "task", "label": CANARY}]


@pytest.fixture
def services(client: TestClient) -> Services:
    return services_of(client)


@pytest.fixture
def purged(
    client: TestClient,
    store: JobStore,
    bench: OpenBench,
    small_gt3x: bytes,
    caplog: pytest.LogCaptureFixture,
    tmp_path: Path,
) -> set[str]:
    """Make every kind of row and file that hold a person's words and purge all; give the recordings' ids."""
    caplog.set_level(logging.INFO)
    assert len(CANARY) == 32
    WebhookStore(store.engine, store.reader).add("https://nobody.invalid/", EVENTS, ServerSecret(tmp_path))
    post(client, "recordings", json={"subject": CANARY})
    send_by_tus(client, b"PATIENT " + CANARY.encode())
    analyse_in_every_way(client, bench, small_gt3x)
    ids = {kept["id"] for kept in client.get("/api/v1/recordings").json()["items"]}
    assert len(ids) == 3
    for recording_id in ids:
        client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": True})
    return ids


def post(client: TestClient, place: str, **more: Any) -> dict[str, Any]:
    answer: dict[str, Any] = client.post(f"/api/v1/{place}", **more).json()
    return answer


def send_by_tus(client: TestClient, content: bytes) -> None:
    metadata_words = {"filename": WORDS["file_name"], **WORDS}
    said = ",".join(
        f"{name} {base64.b64encode(word.encode()).decode()}" for name, word in metadata_words.items()
    )
    headers = {
        "tus-resumable": "1.0.0",
        "upload-length": str(len(content)),
        "upload-metadata": said,
        "content-type": "application/offset+octet-stream",
    }
    address = client.post("/api/v1/uploads", content=content[:20], headers=headers).headers["location"]
    client.get(f"{address}/inspection")
    more = {name: headers[name] for name in ("tus-resumable", "content-type")} | {"upload-offset": "20"}
    assert client.patch(address, content=content[20:], headers=more).status_code == 204


def analyse_in_every_way(client: TestClient, bench: OpenBench, small_gt3x: bytes) -> None:
    kept = post(client, "recordings", content=small_gt3x, params=WORDS)
    own = f"/api/v1/recordings/{kept['id']}"
    assert client.put(f"{own}/periods", json=PERIODS).status_code == 200
    assert client.get(f"{own}/inspection").status_code == 200
    settings = {"subject": CANARY, "reason": CANARY, "periods": PERIODS}
    wish = {"recording_ids": [kept["id"]], "settings": settings}
    assert "id" in post(client, "analyses", json=wish)
    assert do_next(bench(stand_ins.write_report))
    french = {"recording_ids": [kept["id"]], "settings": settings | {"lang": "fr"}}
    again = post(client, "analyses", json=french)
    assert do_next(bench(stand_ins.refuse))
    retried = post(client, f"analyses/{again['id']}/retry")
    assert post(client, f"analyses/{retried['id']}/cancel")["state"] == "cancelled"
    assert post(client, "batches", json={"name": CANARY, "items": [{"recording_id": kept["id"]}]})["id"]
    named = f"{CANARY}.gt3x"
    files = {"recording": (named, small_gt3x), "reference": (named, b"time_s,elevation_deg\n0,1\n")}
    assert post(client, "validations", files=files, data={"subject": CANARY})["id"]


@on_both_set_ups
def test_no_table_no_file_no_object_and_no_line_of_the_log_holds_a_word_of_what_was_purged(
    purged: set[str], store: JobStore, settings: Settings, storage: Storage, caplog: pytest.LogCaptureFixture
) -> None:
    with store.reader.connect() as connection:
        rows = {table.name: connection.execute(select(table)).all() for table in metadata.sorted_tables}
    files = [path for path in settings.data_dir.rglob("*") if path.is_file()]
    ours = [record for record in caplog.get_records("setup") if not record.name.startswith("httpx")]
    written = "\n".join(logging.Formatter().format(record) for record in ours)

    assert {name for name, found in rows.items() if CANARY in str(found)} == set()
    assert rows["recordings"] == rows["analyses"] == rows["batches"] == []
    assert [row.recording_id for row in rows["uploads"]] == ["purged"]
    assert rows["deliveries"] != []
    assert list(storage.find_names()) == []
    assert purged <= storage.find_erased()
    assert [path for path in files if CANARY.encode() in path.read_bytes()] == []
    assert "attempt 1: finished" in written
    assert CANARY not in written


def keep_samples(settings: Settings, recording_id: str) -> Path:
    """Keep the samples of a recording as a worker does; gives the folder."""
    cache = DecodedCache(settings.data_dir / "cache", 1 << 20, recording_id)
    cache.keep(hash_entry_key("", "", ""), hold((0, 1)).recording)
    return cache.folder


def test_a_purge_removes_the_decoded_samples(client: TestClient, settings: Settings) -> None:
    kept = client.post("/api/v1/recordings", content=b"x").json()
    folder = keep_samples(settings, kept["id"])
    assert len(list(folder.iterdir())) == 1

    client.delete(f"/api/v1/recordings/{kept['id']}", params={"purge": True})

    assert list(folder.iterdir()) == []


def test_decoded_samples_of_the_same_bytes_in_another_recording_stay(
    client: TestClient, settings: Settings
) -> None:
    names = ({"file_name": name} for name in ("a.csv", "b.csv"))
    first, second = (client.post("/api/v1/recordings", content=b"x", params=name).json() for name in names)
    folder = keep_samples(settings, second["id"])

    client.delete(f"/api/v1/recordings/{first['id']}", params={"purge": True})

    assert len(list(folder.iterdir())) == 1


def test_samples_that_were_written_after_their_recording_was_purged_go_too(
    services: Services, settings: Settings
) -> None:
    folder = keep_samples(settings, "rec_of_nobody")

    grow_older(services, 60.0)

    assert list(folder.iterdir()) == []


def test_a_start_removes_what_a_crash_left_of_a_look(services: Services) -> None:
    left = services.inspector.folder / "look_abc"
    left.mkdir()
    (left / "head").write_bytes(CANARY.encode())
    stranger = services.inspector.folder / "notes.txt"
    stranger.touch()

    services.inspector.sweep()

    assert list(services.inspector.folder.iterdir()) == [stranger]


def test_an_error_of_the_database_does_not_repeat_what_was_to_be_written(
    store: JobStore, tmp_path: Path
) -> None:
    with store.engine.begin() as connection:
        connection.exec_driver_sql("DROP TABLE webhooks")
    with pytest.raises(Exception, match="no such table") as failure:
        WebhookStore(store.engine, store.reader).add(f"https://{CANARY}/", EVENTS, ServerSecret(tmp_path))

    assert CANARY not in str(failure.value)
