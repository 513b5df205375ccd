"""Erase a recording, and nothing of it is left: a canary through every field and file, on both set-ups.

The database's own labels are not sealed yet (they are deleted with their rows, and SQLite overwrites them):
:data:`LABELS` lists them. What is proved of them is that they are gone after an erasure, not that a stolen
copy of the database is closed.
"""

import sqlite3
import zipfile
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from typer.testing import CliRunner

from app.cli import app
from app.jobs.database.tables import metadata
from app.jobs.job import JobState
from app.jobs.store import JobStore
from app.jobs.trail import TrailFault, check_chain
from app.main import create_app
from app.settings import Settings
from app.storage.keys import open_keys
from app.storage.open import open_storage
from app.storage.sealing import SealedStorage
from app.upkeep.backup import back_up, restore
from app.upkeep.drill import drill
from app.upkeep.envelope import Recipients
from app.upkeep.key_backup import back_up_keys, read_key_backup
from tests.app import stand_ins
from tests.app.conftest import OpenBench, do_next, on_both_set_ups

CANARY = "canary-5f2c71d09ab84e36c1f7a2d8e"
LABELS = {
    "recordings": {"file_name", "subject", "external_id", "note", "tags", "diary", "inspection"},
    "analyses": {"request"},
    "uploads": {"description", "metadata"},
    "batches": {"name"},
}
"""The columns that hold a person's words in clear until the recording is erased: not sealed yet."""
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


def find_hits_in_bucket(storage: SealedStorage) -> list[str]:
    names = (*storage.find_names(), *(f"recordings/{name}" for name in storage.find_recordings()))
    return [name for name in names if CANARY.encode() in (storage.inner.read_small(name) or b"")]


@on_both_set_ups
def test_no_file_of_a_dump_holds_the_canary_in_clear(
    served: Settings, client: TestClient, bench: OpenBench, storage: SealedStorage
) -> None:
    """Whoever copies folder and bucket, but not the keys: the database's labels are the rest of the work."""
    fill_every_place(served, client, bench)
    begin_upload(client)

    assert {name for name in find_hits(served.data_dir) if not name.startswith("acromion.sqlite3")} == set()
    assert find_hits_in_bucket(storage) == []


@on_both_set_ups
def test_only_the_labels_known_of_the_database_are_in_clear(
    served: Settings, client: TestClient, bench: OpenBench, store: JobStore
) -> None:
    fill_every_place(served, client, bench)
    begin_upload(client)

    found: dict[str, set[str]] = {}
    with store.reader.connect() as connection:
        for table in metadata.sorted_tables:
            for row in connection.execute(select(table)):
                hits = {name for name, value in row._asdict().items() if CANARY in str(value)}
                if hits:
                    found.setdefault(table.name, set()).update(hits)
    assert {table for table in found if not found[table] <= LABELS.get(table, set())} == set()


@on_both_set_ups
def test_after_an_erasure_the_canary_is_nowhere(
    served: Settings, client: TestClient, bench: OpenBench, storage: SealedStorage
) -> None:
    recording_id = fill_every_place(served, client, bench)
    address = begin_upload(client)

    assert client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": True}).status_code == 204
    assert client.delete(address, headers={"tus-resumable": "1.0.0"}).status_code == 204

    assert find_hits(served.data_dir) == []
    assert find_hits_in_bucket(storage) == []
    assert open_keys(served).find(recording_id) is None
    assert recording_id in open_keys(served).find_erased()


def test_a_copy_of_the_disk_from_before_the_erasure_opens_no_more_with_the_present_keys(
    served: Settings, client: TestClient, bench: OpenBench, storage: SealedStorage
) -> None:
    recording_id = fill_every_place(served, client, bench)
    copied = (served.data_dir / "recordings" / recording_id).read_bytes()

    client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": True})
    (served.data_dir / "recordings" / recording_id).write_bytes(copied)

    with pytest.raises(Exception, match="E-KEY-GONE"):
        storage.read_part(f"recordings/{recording_id}", 0, 10)


def prove_trail(settings: Settings) -> tuple[TrailFault, ...]:
    with closing(JobStore(settings)) as store:
        return check_chain(store.reader)[1]


@on_both_set_ups
def test_a_restored_older_backup_with_the_present_keys_holds_nothing_of_what_was_erased(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path
) -> None:
    other = client.post("/api/v1/recordings", content=b"another", params={"subject": "S2"}).json()["id"]
    recording_id = fill_every_place(served, client, bench)
    back_up(served, tmp_path / "older.zip")
    client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": True})
    back_up_keys(served, tmp_path / "present.jsonl", Recipients())

    new = Settings(data_dir=tmp_path / "new", database_url=f"sqlite:///{tmp_path / 'new' / 'a.sqlite3'}")
    restored = restore(new, tmp_path / "older.zip", read_key_backup(tmp_path / "present.jsonl"))

    assert restored.faults == ()
    assert find_hits(new.data_dir) == []
    assert prove_trail(new) == ()
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
    back_up_keys(served, tmp_path / "present.jsonl", Recipients())
    new = Settings(data_dir=tmp_path / "new", database_url=f"sqlite:///{tmp_path / 'new' / 'a.sqlite3'}")

    restore(new, tmp_path / "older.zip", read_key_backup(tmp_path / "present.jsonl"))

    rows = sqlite3.connect(new.data_dir / "a.sqlite3")
    assert rows.execute("SELECT count(*) FROM recordings").fetchone() == (0,)
    assert rows.execute("SELECT count(*) FROM analyses").fetchone() == (0,)
    rows.close()


# --- backups and their keys -----------------------------------------------------------------------------


@pytest.fixture
def age(tmp_path: Path) -> tuple[Recipients, Path]:
    """A recipient, and the file of its identity."""
    x25519 = pytest.importorskip("pyrage").x25519
    identity = x25519.Identity.generate()
    (tmp_path / "identity.txt").write_text(f"# created by a test\n{identity}\n")
    return Recipients((str(identity.to_public()),)), tmp_path / "identity.txt"


def test_a_backup_holds_no_key_and_no_file_in_clear(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path
) -> None:
    fill_every_place(served, client, bench)
    back_up(served, tmp_path / "b.zip")
    keys = open_keys(served)

    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    files = {name for name in content if name.startswith("files/")}
    assert files
    assert [name for name in files if CANARY.encode() in content[name]] == []
    every_byte = b"".join(content.values())
    assert [name for name, wrapped in keys.export() if wrapped in every_byte] == []
    assert keys.organisation.secret not in every_byte


def test_an_encrypted_backup_is_closed_to_everybody_else(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path, age: tuple[Recipients, Path]
) -> None:
    fill_every_place(served, client, bench)

    back_up(served, tmp_path / "b.age", age[0])
    back_up_keys(served, tmp_path / "k.age", age[0])

    assert CANARY.encode() not in (tmp_path / "b.age").read_bytes()
    for arguments in (["verify", "b.age"], ["restore", "b.age"], ["drill", "b.age", "k.age"]):
        named = [arguments[0], *(str(tmp_path / name) for name in arguments[1:])]
        refused = CliRunner().invoke(app, named)
        assert (refused.exit_code, refused.output.split()[0]) == (3, "E-BACKUP")
        assert "--identity" in refused.output


def test_a_drill_restores_an_encrypted_backup_and_reads_every_byte(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path, age: tuple[Recipients, Path]
) -> None:
    fill_every_place(served, client, bench)
    copied = back_up(served, tmp_path / "b.age", age[0])
    back_up_keys(served, tmp_path / "k.age", age[0])

    done = drill(tmp_path / "b.age", tmp_path / "k.age", age[1])

    assert (done.files, done.faults) == (copied.promised, ())
    assert done.minutes < 10
    assert sorted(path.name for path in tmp_path.iterdir() if "drill" in path.name) == []


def test_a_drill_without_the_keys_fails_and_says_what_is_needed(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path
) -> None:
    fill_every_place(served, client, bench)
    back_up(served, tmp_path / "b.zip")

    done = CliRunner().invoke(app, ["drill", str(tmp_path / "b.zip"), "--lang", "fr"])

    assert (done.exit_code, done.output.split()[0]) == (3, "E-KEYS-NEEDED")
    assert "--keys" in done.output


def test_a_restore_without_keys_changes_nothing(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path
) -> None:
    fill_every_place(served, client, bench)
    back_up(served, tmp_path / "b.zip")

    done = CliRunner().invoke(app, ["restore", str(tmp_path / "b.zip"), "--data", str(tmp_path / "new")])

    assert (done.exit_code, done.output.split()[0]) == (3, "E-KEYS-NEEDED")
    assert not (tmp_path / "new").exists()


def test_a_restore_without_keys_counts_recordings_and_says_how_to_give_the_keys(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path
) -> None:
    fill_every_place(served, client, bench)
    client.post("/api/v1/recordings", content=b"another", params={"file_name": "other.gt3x"})
    back_up(served, tmp_path / "b.zip")

    done = CliRunner().invoke(app, ["restore", str(tmp_path / "b.zip"), "--data", str(tmp_path / "new")])

    assert "2 recordings are sealed" in " ".join(done.output.split())
    assert "--keys KEYS" in done.output


def test_a_backup_of_keys_that_another_key_wrapped_is_refused_with_the_file_that_is_missing(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path
) -> None:
    fill_every_place(served, client, bench)
    back_up(served, tmp_path / "b.zip")
    held_apart = served.model_copy(update={"key_file": served.data_dir / "organisation.key"})
    back_up_keys(held_apart, tmp_path / "k.jsonl", Recipients())

    typed = ["restore", str(tmp_path / "b.zip"), "--keys", str(tmp_path / "k.jsonl")]
    done = CliRunner().invoke(app, [*typed, "--data", str(tmp_path / "new")])

    assert (done.exit_code, done.output.split()[0]) == (3, "E-KEY-FILE")
    assert str(tmp_path / "new" / "organisation.key") in " ".join(done.output.split())
    assert "ACROMION_KEY_FILE" in done.output
    assert not (tmp_path / "new").exists()


def test_the_keys_of_another_place_are_refused_and_leave_nothing_behind(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path
) -> None:
    fill_every_place(served, client, bench)
    back_up(served, tmp_path / "b.zip")
    elsewhere = Settings(data_dir=tmp_path / "elsewhere", database_url=f"sqlite:///{tmp_path}/e.sqlite3")
    back_up_keys(elsewhere, tmp_path / "k.jsonl", Recipients())

    typed = ["restore", str(tmp_path / "b.zip"), "--keys", str(tmp_path / "k.jsonl")]
    done = CliRunner().invoke(app, [*typed, "--data", str(tmp_path / "new")])

    assert (done.exit_code, done.output.split()[0]) == (3, "E-KEYS-NEEDED")
    assert not (tmp_path / "new").exists()


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


def test_an_older_backup_of_the_keys_does_not_bring_an_erased_key_back(
    served: Settings, client: TestClient, bench: OpenBench, tmp_path: Path
) -> None:
    recording_id = fill_every_place(served, client, bench)
    back_up_keys(served, tmp_path / "older.jsonl", Recipients())
    client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": True})
    keys, older = open_keys(served), read_key_backup(tmp_path / "older.jsonl")

    assert recording_id in older.wrapped
    assert keys.import_wrapped(older.wrapped, older.organisation) == 0
    assert keys.find(recording_id) is None
