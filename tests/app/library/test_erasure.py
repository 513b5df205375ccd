"""Erase a recording, and nothing of it is left: a canary through every field and file, on both set-ups."""

import sqlite3
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from app.cli import app
from app.jobs.job import JobState
from app.main import create_app
from app.settings import Settings
from app.storage.open import open_storage
from app.storage.store import Storage
from app.upkeep.backup import back_up, drill, restore
from tests.app import stand_ins
from tests.app.conftest import OpenBench, do_next, on_both_set_ups

CANARY = "canary-5f2c71d09ab84e36c1f7a2d8e"
WORDS = {"file_name": f"{CANARY}.gt3x", "subject": CANARY, "external_id": CANARY, "note": CANARY}
PERIODS = [{"start_s": 0, "end_s": 60, "kind": "task", "label": CANARY}]


def write_canary_report(log: Path, request: Any, out: Path, on_stage: Any) -> None:
    """Stand in for the science: every file of the report holds the canary."""
    stand_ins.write_report(log, request, out, on_stage)
    (out / "canary.txt").write_text(CANARY)


@pytest.fixture
def served(settings: Settings) -> Settings:
    assert len(CANARY) == 32
    return settings


def fill_every_place(settings: Settings, client: TestClient, bench: OpenBench) -> str:
    """Store the canary as bytes, words, periods and a report, in a kept response too; gives the recording."""
    content = b"recording " + CANARY.encode()
    kept = client.post("/api/v1/recordings", content=content, params=WORDS).json()
    own = f"/api/v1/recordings/{kept['id']}"
    assert client.put(f"{own}/periods", json=PERIODS).status_code == 200
    wish = {"recording_ids": [kept["id"]], "settings": {"subject": CANARY, "reason": CANARY}}
    asked = client.post("/api/v1/analyses", json=wish).json()
    assert do_next(bench(write_canary_report))
    shown = client.get(f"/api/v1/analyses/{asked['items'][0]['id']}").json()
    assert shown["state"] == JobState.SUCCEEDED
    assert client.get(own).json()["subject"] == CANARY
    return str(kept["id"])


def begin_upload(client: TestClient) -> str:
    """Send a part of a file; return the address."""
    headers = {
        "tus-resumable": "1.0.0",
        "upload-length": "4000",
        "content-type": "application/offset+octet-stream",
    }
    return client.post("/api/v1/uploads", content=CANARY * 3, headers=headers).headers["location"]


def find_hits(folder: Path) -> list[str]:
    """Give every file of a folder that holds the canary in clear, the database and its log too."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return sorted(path.name for path in files if CANARY.encode() in path.read_bytes())


def find_hits_in_bucket(storage: Storage) -> list[str]:
    names = (*storage.find_names(), *(f"recordings/{name}" for name in storage.find_recordings()))
    return [name for name in names if CANARY.encode() in (storage.read_small(name) or b"")]


@on_both_set_ups
def test_after_an_erasure_the_canary_is_nowhere(
    served: Settings, client: TestClient, bench: OpenBench, storage: Storage
) -> None:
    recording_id = fill_every_place(served, client, bench)
    address = begin_upload(client)

    assert client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": True}).status_code == 200
    assert client.delete(address, headers={"tus-resumable": "1.0.0"}).status_code == 204

    assert find_hits(served.data_dir) == []
    assert find_hits_in_bucket(storage) == []
    assert recording_id in storage.find_erased()


@on_both_set_ups
def test_a_restored_older_backup_holds_nothing_of_what_was_erased_before_the_last_one(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path
) -> None:
    other = client.post("/api/v1/recordings", content=b"another", params={"subject": "S2"}).json()["id"]
    recording_id = fill_every_place(served, client, bench)
    back_up(served, tmp_path / "older.zip")
    client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": True})
    back_up(served, tmp_path / "newer.zip")

    new = Settings(data_dir=tmp_path / "new", database_url=f"sqlite:///{tmp_path / 'new' / 'a.sqlite3'}")
    restored = restore(new, tmp_path / "older.zip")

    assert (restored.faults, restored.erased) == ((), 1)
    assert find_hits(new.data_dir) == []
    with TestClient(create_app(new), base_url="http://localhost:8080") as again:
        assert again.get(f"/api/v1/recordings/{recording_id}").status_code == 404
        assert again.get(f"/api/v1/recordings/{other}").json()["subject"] == "S2"
        assert find_hits(new.data_dir) == []
    assert open_storage(new).read_part(f"recordings/{other}", 0, 10) == b"another"


def test_the_restored_database_never_held_a_row_of_what_was_erased(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path
) -> None:
    recording_id = fill_every_place(served, client, bench)
    back_up(served, tmp_path / "older.zip")
    client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": True})
    back_up(served, tmp_path / "newer.zip")
    new = Settings(data_dir=tmp_path / "new", database_url=f"sqlite:///{tmp_path / 'new' / 'a.sqlite3'}")

    restore(new, tmp_path / "older.zip")

    rows = sqlite3.connect(new.data_dir / "a.sqlite3")
    assert rows.execute("SELECT count(*) FROM recordings").fetchone() == (0,)
    assert rows.execute("SELECT count(*) FROM analyses").fetchone() == (0,)
    rows.close()


# --- encrypted backups -----------------------------------------------------------------------------


@pytest.fixture
def age(tmp_path: Path) -> tuple[tuple[str], Path]:
    """A recipient, and the file of its identity."""
    x25519 = pytest.importorskip("pyrage").x25519
    identity = x25519.Identity.generate()
    (tmp_path / "identity.txt").write_text(f"# created by a test\n{identity}\n")
    return (str(identity.to_public()),), tmp_path / "identity.txt"


def test_an_encrypted_backup_is_closed_to_everybody_else(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path, age: tuple[tuple[str], Path]
) -> None:
    fill_every_place(served, client, bench)

    back_up(served, tmp_path / "b.age", age[0])

    assert CANARY.encode() not in (tmp_path / "b.age").read_bytes()
    for arguments in (["verify", "b.age"], ["restore", "b.age"], ["drill", "b.age"]):
        named = [arguments[0], *(str(tmp_path / name) for name in arguments[1:])]
        refused = CliRunner().invoke(app, named)
        assert (refused.exit_code, refused.output.split()[0]) == (3, "E-BACKUP")
        assert "--identity" in refused.output


def test_a_drill_restores_an_encrypted_backup_and_reads_every_byte(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path, age: tuple[tuple[str], Path]
) -> None:
    fill_every_place(served, client, bench)
    copied = back_up(served, tmp_path / "b.age", age[0])

    done = drill(tmp_path / "b.age", age[1])

    assert (done.files, done.faults) == (copied.promised, ())
    assert done.minutes < 10
    assert sorted(path.name for path in tmp_path.iterdir() if "drill" in path.name) == []


@pytest.mark.parametrize("recipient", ["age1nobody", "somebody@example.org", ""])
def test_what_is_no_recipient_is_refused_before_anything_is_written(
    served: Settings, client: TestClient, tmp_path: Path, recipient: str
) -> None:
    done = CliRunner().invoke(
        app, ["backup", str(tmp_path / "b.age"), "--recipient", recipient, "--data", str(served.data_dir)]
    )

    assert (done.exit_code, done.output.split()[0]) == (3, "E-BACKUP")
    assert sorted(path.name for path in tmp_path.iterdir() if path.name.startswith("b.")) == []


def test_a_backup_that_is_not_encrypted_says_so(served: Settings, client: TestClient, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["backup", str(tmp_path / "b.zip"), "--data", str(served.data_dir)])

    assert "Not encrypted" in done.output
