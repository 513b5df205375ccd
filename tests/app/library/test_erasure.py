"""What backups keep of an erased recording, and whom an encrypted backup is closed to."""

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
from app.upkeep.backup import back_up, drill, restore
from tests.app import stand_ins
from tests.app.conftest import OpenBench, do_next

CANARY = "canary-5f2c71d09ab84e36c1f7a2d8e"
WORDS = {"file_name": f"{CANARY}.gt3x", "subject": CANARY, "external_id": CANARY, "note": CANARY}
PERIODS = [{"start_s": 0, "end_s": 60, "kind": "task", "label": CANARY}]


def write_canary_report(log: Path, request: Any, out: Path, on_stage: Any) -> None:
    """Stand in for the science: every file of the report holds the canary."""
    stand_ins.write_report(log, request, out, on_stage)
    (out / "canary.txt").write_text(CANARY)


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


def find_hits(folder: Path) -> list[str]:
    """Give every file of a folder that holds the canary in clear, the database and its log too."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return sorted(path.name for path in files if CANARY.encode() in path.read_bytes())


def test_a_restored_older_backup_holds_nothing_of_what_was_erased_before_the_last_one(
    settings: Settings, client: TestClient, bench: OpenBench, tmp_path: Path
) -> None:
    other = client.post("/api/v1/recordings", content=b"another", params={"subject": "S2"}).json()["id"]
    recording_id = fill_every_place(settings, client, bench)
    back_up(settings, tmp_path / "older.zip")
    client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": True})
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
    settings: Settings, client: TestClient, bench: OpenBench, tmp_path: Path, age: tuple[tuple[str], Path]
) -> None:
    fill_every_place(settings, client, bench)

    back_up(settings, tmp_path / "b.age", age[0])

    assert CANARY.encode() not in (tmp_path / "b.age").read_bytes()
    for arguments in (["verify", "b.age"], ["restore", "b.age"], ["drill", "b.age"]):
        named = [arguments[0], *(str(tmp_path / name) for name in arguments[1:])]
        refused = CliRunner().invoke(app, named)
        assert (refused.exit_code, refused.output.split()[0]) == (3, "E-BACKUP")
        assert "--identity" in refused.output


def test_a_drill_restores_an_encrypted_backup_and_reads_every_byte(
    settings: Settings, client: TestClient, bench: OpenBench, tmp_path: Path, age: tuple[tuple[str], Path]
) -> None:
    fill_every_place(settings, client, bench)
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
