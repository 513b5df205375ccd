"""No digest in the rows confirms a guessed word to somebody who holds them without the organisation's key."""

import hashlib
import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import text
from typer.testing import CliRunner

from app.cli import app
from app.jobs.batches import BatchStore
from app.jobs.database.tables import metadata
from app.jobs.library.mappings import MappingStore
from app.jobs.library.studies import identify_earlier_study
from app.jobs.store import JobStore
from app.jobs.versions import identify_work
from app.jobs.worker import run_next
from app.main import create_app
from app.request import ReportRequest
from app.settings import Settings
from app.storage.open import open_storage
from app.storage.sealing import SealedStorage
from app.upkeep.backup import back_up, restore
from app.upkeep.envelope import Recipients
from app.upkeep.key_backup import back_up_keys, read_key_backup
from fusion.readers import identify_header
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenBench, find_study, on_both_set_ups
from tests.app.test_lost_database import find_key_backup, lose_database

on_both_databases = pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)

STUDY, BYTES = "Packing line", b"one"
ASKED = {"file_name": "nadia.csv", "subject": "W-17", "study": STUDY}
QUERY = b"file_name=nadia.csv&subject=W-17&study=Packing%20line"
HEADER, COLUMNS = "0123456789abcdef", {"acceleration": [2, 3, 4], "angular_rate": [5, 6, 7]}
TABLE = "time,S012_acc_x,S012_acc_y,S012_acc_z,S012_gyr_x,S012_gyr_y,S012_gyr_z\n" + "".join(
    f"{k / 100},0.0,0.0,1.0,0.{k % 7},0.0,0.0\n" for k in range(300)
)
TASK = {"start": "2026-03-02T09:00:00", "end": "2026-03-02T09:15:00", "kind": "task", "label": "shelf"}


def sha256(*parts: bytes) -> str:
    return hashlib.sha256(b"".join(parts)).hexdigest()


@contextmanager
def serving(settings: Settings) -> Iterator[TestClient]:
    with TestClient(create_app(settings), base_url="http://localhost:8080") as client:
        yield client


def send(client: TestClient) -> str:
    """Send the recording; gives the id of its analysis."""
    answer = client.post(f"/api/v1/analyze?{QUERY.decode()}", content=BYTES)
    assert answer.status_code == 202, answer.text
    return str(answer.json()["id"])


def dump(store: JobStore) -> str:
    """Give every row of every table as text, as it stands there."""
    with store.engine.connect() as connection:
        every = {
            name: [list(row) for row in connection.execute(text(f'SELECT * FROM "{name}"'))]
            for name in metadata.tables
        }
    return json.dumps(every, default=lambda content: bytes(content).decode("latin-1"))


def list_plain(store: JobStore) -> dict[str, str]:
    """Give the plain digests of what was asked, as an earlier release kept them."""
    works = {f"work of {job.id}": identify_work(job.sha256, job.request) for job in store.find_newest()}
    return works | {"study": identify_earlier_study(STUDY)}


def find_plain(store: JobStore, rows: str) -> list[str]:
    return [what for what, digest in list_plain(store).items() if digest in rows]


@on_both_set_ups
def test_no_plain_digest_of_words_stands_in_any_row(client: TestClient, store: JobStore) -> None:
    analysis = store.get(send(client))
    client.put(f"/api/v1/recordings/{analysis.recording_id}/periods", json=[TASK]).raise_for_status()
    asked = {"recording_ids": [analysis.recording_id], "study": STUDY}
    client.post("/api/v1/analyses", json=asked).raise_for_status()

    assert len(store.find_newest()) == 2
    assert any(job.request.diary for job in store.find_newest())
    assert find_plain(store, dump(store)) == []


@on_both_databases
def test_no_plain_digest_of_the_names_of_columns_stands_in_any_row(
    client: TestClient, store: JobStore, add_job: AddJob, bench: OpenBench
) -> None:
    header = identify_header(io.BytesIO(TABLE.encode()))
    job = add_job(f"{header}\n".encode())
    assert run_next(bench(stand_ins.read_by_columns))
    mappings = MappingStore(store.engine, store.reader)
    waiting = mappings.count_waiting(header)
    kept = mappings.put(header, "ours", json.dumps(COLUMNS), is_confirmed=False)
    client.patch(f"/api/v1/columns/{kept.header}", json={"is_confirmed": True}).raise_for_status()
    mappings.drop(header)
    mappings.put(header, "ours", json.dumps(COLUMNS), is_confirmed=True)

    assert (len(header), waiting, store.get(job.id).problem_facts["header"]) == (16, 1, header)
    assert header not in dump(store)


@on_both_databases
def test_columns_are_found_by_the_id_that_is_given_out_and_by_that_of_a_file(
    client: TestClient, store: JobStore
) -> None:
    MappingStore(store.engine, store.reader).put(HEADER, "ours", json.dumps(COLUMNS), is_confirmed=True)

    (given,) = client.get("/api/v1/columns").json()["items"]

    assert HEADER not in given["header"]
    assert client.get(f"/api/v1/columns/{given['header']}").json() == given
    assert client.get(f"/api/v1/columns/{HEADER}").json() == given


def test_a_header_whose_columns_no_line_names_is_known_by_its_id(store: JobStore) -> None:
    mappings = MappingStore(store.engine, store.reader)

    kept = mappings.put(f"-{HEADER}", "ours", json.dumps(COLUMNS), is_confirmed=False)

    assert kept.header.startswith("-~k1~")
    assert not mappings.change(kept.header, is_confirmed=1).is_confirmed


@on_both_databases
def test_the_key_of_a_study_is_not_named_by_a_digest_of_its_name(
    client: TestClient, store: JobStore, storage: SealedStorage
) -> None:
    send(client)

    names = storage.keys.wrapped.read_all().keys()

    assert find_study(store, STUDY) in names
    assert identify_earlier_study(STUDY) not in names


@on_both_databases
def test_two_workers_give_a_study_one_id(store: JobStore, settings: Settings) -> None:
    other = JobStore(settings)

    assert find_study(store, STUDY) == find_study(other, STUDY)
    other.close()


def test_two_organisations_give_a_name_two_ids(store: JobStore, settings: Settings) -> None:
    other = JobStore(settings.for_organisation("org_0123456789abcdef"))

    assert find_study(store, STUDY) != find_study(other, STUDY)
    other.close()


def test_the_same_again_is_found_by_its_keyed_digest(store: JobStore, add_job: AddJob) -> None:
    job = add_job(BYTES)

    (found,) = store.find_same(job.sha256, job.request)

    assert found.id == job.id
    assert store.find_same(job.sha256, ReportRequest("shift.gt3x", "W-18")) == ()


# Copies that come back.


def recover(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lose the database, and recover it from the side files."""
    lose_database(settings)
    for name, value in settings.as_environment().items():
        monkeypatch.setenv(name, value)
    keys = find_key_backup(settings)
    result = CliRunner().invoke(app, ["recover", *(("--keys", str(keys)) if keys.exists() else ())])
    assert result.exit_code == 0, result.output


def ask_for_two(client: TestClient) -> list[str]:
    """Send two recordings into the study; gives their analyses."""
    sent = [
        client.put("/api/v1/analyze", params=ASKED | {"subject": subject}, content=subject.encode())
        for subject in ("W-17", "W-18")
    ]
    return [answer.json()["id"] for answer in sent]


@on_both_set_ups
def test_a_recovered_study_is_one_that_goes_on(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    with serving(settings) as client:
        before = ask_for_two(client)
    recover(settings, monkeypatch)
    with serving(settings) as client:
        third = client.put("/api/v1/analyze", params=ASKED, content=b"third").json()["id"]

    store = JobStore(settings)
    held = BatchStore(store.engine, store.reader)
    (study,) = held.find_newest(10)
    assert (study.id, study.name) == (find_study(store, STUDY), STUDY)
    assert [job.id for job in held.find_jobs(study.id)] == [*before, third]
    assert study.item_count == 3
    store.close()


@on_both_databases
def test_after_a_recovery_the_same_request_is_answered_by_the_same_analysis(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    with serving(settings) as client:
        before = ask_for_two(client)
    recover(settings, monkeypatch)
    with serving(settings) as client:
        assert ask_for_two(client) == before


def test_another_installation_finds_what_a_backup_brought(
    store: JobStore, add_job: AddJob, settings: Settings, tmp_path: Path
) -> None:
    job = add_job(BYTES)
    study_id = store.join_study(STUDY, job.id)

    moved = move(settings, tmp_path)

    assert [same.id for same in moved.find_same(job.sha256, job.request)] == [job.id]
    assert moved.join_study(STUDY, job.id) == study_id
    moved.close()


def move(settings: Settings, tmp_path: Path) -> JobStore:
    """Restore a backup with its keys into a folder that has an organisation's key."""
    back_up(settings, tmp_path / "b.zip")
    back_up_keys(settings, tmp_path / "keys.jsonl", Recipients())
    place = Settings(data_dir=tmp_path / "new", min_free_bytes=0)
    open_storage(place).keys.check()
    restore(place, tmp_path / "b.zip", read_key_backup(tmp_path / "keys.jsonl"))
    return JobStore(place)
