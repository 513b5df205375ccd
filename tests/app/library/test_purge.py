"""After a purge no word of a recording is left: in no table, in no file of the data folder, in no object."""

import base64
import logging
import sqlite3
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from typer.testing import CliRunner

from acromion.app.cli import app
from acromion.app.http.api.housekeeping import apply_retention
from acromion.app.library.database.tables import metadata
from acromion.app.library.jobs import JobStore
from acromion.app.library.recordings import RecordingStore
from acromion.app.library.rows import JobState
from acromion.app.library.side_files import SideWriter
from acromion.app.library.webhooks import EVENTS, WebhookStore
from acromion.app.main import create_app
from acromion.app.ops.backup import back_up, drill, restore
from acromion.app.services import Services
from acromion.app.settings import Settings
from acromion.app.store.decoded import DecodedCache, hash_entry_key
from acromion.app.store.folder import Storage, open_storage
from acromion.app.store.server_secret import ServerSecret
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenWorker, do_next, on_both_set_ups, services_of
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
    open_worker: OpenWorker,
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
    analyse_in_every_way(client, open_worker, small_gt3x)
    ids = {kept["id"] for kept in client.get("/api/v1/recordings").json()["items"]}
    assert len(ids) == 3
    for recording_id in ids:
        client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": "now"})
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


def analyse_in_every_way(client: TestClient, open_worker: OpenWorker, small_gt3x: bytes) -> None:
    kept = post(client, "recordings", content=small_gt3x, params=WORDS)
    own = f"/api/v1/recordings/{kept['id']}"
    assert client.put(f"{own}/periods", json=PERIODS).status_code == 200
    assert client.get(f"{own}/inspection").status_code == 200
    settings = {"subject": CANARY, "reason": CANARY, "periods": PERIODS}
    wish = {"recording_ids": [kept["id"]], "settings": settings}
    assert "id" in post(client, "analyses", json=wish)
    assert do_next(open_worker(stand_ins.write_report))
    french = {"recording_ids": [kept["id"]], "settings": settings | {"lang": "fr"}}
    again = post(client, "analyses", json=french)
    assert do_next(open_worker(stand_ins.refuse))
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
    """Keep the samples of a recording as a worker does; return the folder."""
    cache = DecodedCache(settings.data_dir / "cache", 1 << 20, recording_id)
    cache.keep(hash_entry_key("", "", ""), hold((0, 1)).recording)
    return cache.folder


def test_a_purge_removes_the_decoded_samples(client: TestClient, settings: Settings) -> None:
    kept = client.post("/api/v1/recordings", content=b"x").json()
    folder = keep_samples(settings, kept["id"])
    assert len(list(folder.iterdir())) == 1

    client.delete(f"/api/v1/recordings/{kept['id']}", params={"purge": "now"})

    assert list(folder.iterdir()) == []


def test_decoded_samples_of_the_same_bytes_in_another_recording_stay(
    client: TestClient, settings: Settings
) -> None:
    names = ({"file_name": name} for name in ("a.csv", "b.csv"))
    first, second = (client.post("/api/v1/recordings", content=b"x", params=name).json() for name in names)
    folder = keep_samples(settings, second["id"])

    client.delete(f"/api/v1/recordings/{first['id']}", params={"purge": "now"})

    assert len(list(folder.iterdir())) == 1


def test_samples_that_were_written_after_their_recording_was_purged_go_too(
    services: Services, settings: Settings
) -> None:
    folder = keep_samples(settings, "rec_of_nobody")

    apply_retention(services, 60.0)

    assert list(folder.iterdir()) == []


def test_a_start_removes_what_a_crash_left_of_a_look(services: Services) -> None:
    left = services.inspector.folder / "look_abc"
    left.mkdir()
    (left / "head").write_bytes(CANARY.encode())
    stranger = services.inspector.folder / "notes.txt"
    stranger.touch()

    services.inspector.sweep()

    assert list(services.inspector.folder.iterdir()) == [stranger]


def test_a_purge_waits_for_the_side_file_that_is_being_written_and_removes_it(
    store: JobStore, storage: Storage, add_job: AddJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    job, rows = add_job(subject=CANARY), RecordingStore(store.engine, store.reader)

    def purge() -> None:
        rows.begin_purge(job.recording_id)
        storage.drop_recording(job.recording_id)

    with ThreadPoolExecutor(1) as other:
        begun = []

        def write_late(self: Storage, name: str, content: bytes) -> None:
            begun.append(other.submit(purge))
            time.sleep(0.3)
            write(self, name, content)

        write = Storage.write_small
        monkeypatch.setattr(Storage, "write_small", write_late)
        SideWriter(store.engine, store.reader, storage).write(job.recording_id)
        begun[0].result()
    rows.end_purge(job.recording_id)

    assert list(storage.find_names()) == []


def test_a_side_file_that_was_written_while_another_server_purged_is_removed(
    store: JobStore, storage: Storage, add_job: AddJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = add_job(subject=CANARY)

    def write_late(self: Storage, name: str, content: bytes) -> None:
        store.mark_purging(job.recording_id)
        storage.drop_recording(job.recording_id)
        write(self, name, content)

    write = Storage.write_small
    monkeypatch.setattr(Storage, "write_small", write_late)
    SideWriter(store.engine, store.reader, storage).write(job.recording_id)

    assert list(storage.find_names()) == []
    assert storage.find_erased() == {job.recording_id}


def test_the_log_of_the_database_is_emptied_even_if_another_process_is_just_writing_it_back(
    store: JobStore, settings: Settings, add_job: AddJob
) -> None:
    job, rows = add_job(subject=CANARY), RecordingStore(store.engine, store.reader)
    rows.begin_purge(job.recording_id)
    database = settings.data_dir / "acromion.sqlite3"
    hold_checkpoints = (
        "import fcntl, sys, time; file = open(sys.argv[1], 'r+b'); "
        "fcntl.lockf(file, fcntl.LOCK_EX, 1, 121); print(flush=True); time.sleep(0.5)"  # sqlite.org/walformat
    )
    with subprocess.Popen(
        [sys.executable, "-c", hold_checkpoints, f"{database}-shm"], stdout=subprocess.PIPE
    ) as peer:
        assert peer.stdout is not None
        peer.stdout.readline()

        rows.end_purge(job.recording_id)

    assert CANARY.encode() not in database.with_name(f"{database.name}-wal").read_bytes()


# Backups: what they keep of an erased recording, and whom an encrypted one is closed to.


def write_canary_report(log: Path, request: Any, out: Path, on_stage: Any) -> None:
    """Stand in for the science: every file of the report holds the canary."""
    stand_ins.write_report(log, request, out, on_stage)
    (out / "canary.txt").write_text(CANARY)


def fill_every_place(settings: Settings, client: TestClient, open_worker: OpenWorker) -> str:
    """Store the canary as bytes, words, periods and a report, also in a kept response; return its id."""
    content = b"recording " + CANARY.encode()
    kept = client.post("/api/v1/recordings", content=content, params=WORDS).json()
    own = f"/api/v1/recordings/{kept['id']}"
    assert client.put(f"{own}/periods", json=PERIODS).status_code == 200
    wish = {"recording_ids": [kept["id"]], "settings": {"subject": CANARY, "reason": CANARY}}
    asked = client.post("/api/v1/analyses", json=wish).json()
    assert do_next(open_worker(write_canary_report))
    shown = client.get(f"/api/v1/analyses/{asked['items'][0]['id']}").json()
    assert shown["state"] == JobState.SUCCEEDED
    assert client.get(own).json()["subject"] == CANARY
    return str(kept["id"])


def find_hits(folder: Path) -> list[str]:
    """Return every file of a folder that holds the canary in clear, the database and its log too."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return sorted(path.name for path in files if CANARY.encode() in path.read_bytes())


def test_a_restored_older_backup_holds_nothing_of_what_was_erased_before_the_last_one(
    settings: Settings, client: TestClient, open_worker: OpenWorker, tmp_path: Path
) -> None:
    other = client.post("/api/v1/recordings", content=b"another", params={"subject": "S2"}).json()["id"]
    recording_id = fill_every_place(settings, client, open_worker)
    back_up(settings, tmp_path / "older.zip")
    client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": "now"})
    back_up(settings, tmp_path / "newer.zip")

    new = Settings(data_dir=tmp_path / "new", database_url=f"sqlite:///{tmp_path / 'new' / 'a.sqlite3'}")
    restored = restore(new, tmp_path / "older.zip")

    assert (restored.faults, restored.erased) == ((), 1)
    assert find_hits(new.data_dir) == []
    rows = sqlite3.connect(new.data_dir / "a.sqlite3")  # which never held a row of it
    assert rows.execute("SELECT id FROM recordings").fetchall() == [(other,)]
    assert rows.execute("SELECT count(*) FROM analyses").fetchone() == (0,)
    rows.close()
    with TestClient(create_app(new), base_url="http://localhost:8080") as again:
        assert again.get(f"/api/v1/recordings/{recording_id}").status_code == 404
        assert again.get(f"/api/v1/recordings/{other}").json()["subject"] == "S2"
        assert find_hits(new.data_dir) == []
    assert open_storage(new).read_part(f"recordings/{other}", 0, 10) == b"another"


# --- encrypted backups -----------------------------------------------------------------------------


@pytest.fixture
def age(tmp_path: Path) -> tuple[tuple[str], Path]:
    """A recipient, and the file of its identity."""
    x25519 = pytest.importorskip("pyrage").x25519
    identity = x25519.Identity.generate()
    (tmp_path / "identity.txt").write_text(f"# created by a test\n{identity}\n")
    return (str(identity.to_public()),), tmp_path / "identity.txt"


def test_an_encrypted_backup_is_closed_to_everybody_else(
    settings: Settings,
    client: TestClient,
    open_worker: OpenWorker,
    tmp_path: Path,
    age: tuple[tuple[str], Path],
) -> None:
    fill_every_place(settings, client, open_worker)

    back_up(settings, tmp_path / "b.age", age[0])

    assert CANARY.encode() not in (tmp_path / "b.age").read_bytes()
    for arguments in (["verify", "b.age"], ["restore", "b.age"], ["drill", "b.age"]):
        named = [arguments[0], *(str(tmp_path / name) for name in arguments[1:])]
        refused = CliRunner().invoke(app, named)
        assert (refused.exit_code, refused.output.split()[0]) == (3, "E-BACKUP")
        assert "--identity" in refused.output


def test_a_drill_restores_an_encrypted_backup_and_reads_every_byte(
    settings: Settings,
    client: TestClient,
    open_worker: OpenWorker,
    tmp_path: Path,
    age: tuple[tuple[str], Path],
) -> None:
    fill_every_place(settings, client, open_worker)
    copied = back_up(settings, tmp_path / "b.age", age[0])

    done = drill(tmp_path / "b.age", age[1])

    assert (done.files, done.faults) == (copied.promised, ())
    assert done.minutes < 10
    assert sorted(path.name for path in tmp_path.iterdir() if "drill" in path.name) == []


@pytest.mark.parametrize("recipient", ["age1nobody", "somebody@example.org", ""])
def test_what_is_no_recipient_is_refused_before_anything_is_written(
    settings: Settings, client: TestClient, tmp_path: Path, recipient: str
) -> None:
    done = CliRunner().invoke(
        app, ["backup", str(tmp_path / "b.age"), "--recipient", recipient, "--data", str(settings.data_dir)]
    )

    assert (done.exit_code, done.output.split()[0]) == (3, "E-BACKUP")
    assert sorted(path.name for path in tmp_path.iterdir() if path.name.startswith("b.")) == []


def test_a_backup_that_is_not_encrypted_says_so(
    settings: Settings, client: TestClient, tmp_path: Path
) -> None:
    done = CliRunner().invoke(app, ["backup", str(tmp_path / "b.zip"), "--data", str(settings.data_dir)])

    assert "Not encrypted" in done.output
