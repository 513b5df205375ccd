"""What an earlier release stored in clear is sealed while the server runs, on both set-ups."""

import hashlib
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from starlette.requests import Request

from app.jobs.job import Job
from app.jobs.store import JobStore
from app.services import Services, find_services
from app.settings import Settings
from app.storage.sealing import SealedStorage
from app.storage.store import format_result_name
from app.upkeep.seal_earlier import EarlierFiles
from app.upkeep.verify import find_faults, find_kept
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenBench, do_next, on_both_set_ups


@pytest.fixture(autouse=True)
def quiet_house(monkeypatch: pytest.MonkeyPatch) -> None:
    """The server's own rounds would seal while a test still puts things in clear."""
    monkeypatch.setattr("app.api.housekeeping.LOOK_S", 3600.0)


@pytest.fixture
def services(client: TestClient) -> Services:
    return find_services(Request({"type": "http", "app": client.app}))


@pytest.fixture
def earlier(services: Services) -> EarlierFiles:
    return EarlierFiles(services.settings, services.store, services.storage, services.side_files)


@pytest.fixture
def finished(
    services: Services, store: JobStore, storage: SealedStorage, add_job: AddJob, bench: OpenBench
) -> Job:
    """An analysis as an earlier release left it: no key, and every byte in clear."""
    job = add_job(b"the recording")
    do_next(bench(stand_ins.write_report))
    services.side_files.write_all()
    for file in find_kept(services.settings):
        put_in_clear(storage, file.name)
    side = f"recordings/{job.recording_id}.json"
    storage.inner.write_small(side, storage.read_small(side) or b"")
    storage.keys.destroy(job.recording_id)
    return store.get(job.id)


def put_in_clear(storage: SealedStorage, name: str) -> None:
    path = storage.fetch(name).path
    storage.put(path, name)
    storage.release(path)


def seal_all(earlier: EarlierFiles) -> None:
    while earlier.seal_next():
        pass


def list_clear(storage: SealedStorage, settings: Settings) -> list[str]:
    names = [file.name for file in find_kept(settings) if not storage.is_sealed(file.name)]
    sides = [name for name in storage.find_recordings() if name.endswith(".json")]
    return names + [name for name in sides if not storage.is_small_sealed(f"recordings/{name}")]


@on_both_set_ups
def test_every_file_is_sealed_and_holds_the_bytes_of_its_row(
    finished: Job, earlier: EarlierFiles, storage: SealedStorage, settings: Settings
) -> None:
    assert len(list_clear(storage, settings)) == 1 + len(find_kept(settings))

    seal_all(earlier)

    assert list_clear(storage, settings) == []
    assert list(find_faults(settings, find_kept(settings))) == []


def test_it_is_read_all_the_time(
    finished: Job, earlier: EarlierFiles, client: TestClient, storage: SealedStorage
) -> None:
    before = client.get(f"/api/v1/analyses/{finished.id}/results.json").content
    seal_all(earlier)

    assert client.get(f"/api/v1/analyses/{finished.id}/results.json").content == before


def test_a_damaged_file_stays_as_it_is_and_is_named(
    finished: Job, earlier: EarlierFiles, storage: SealedStorage, settings: Settings, tmp_path: Path
) -> None:
    (tmp_path / "other").write_bytes(b"the Recording")
    storage.put(tmp_path / "other", f"recordings/{finished.recording_id}")

    seal_all(earlier)

    assert storage.inner.read_small(f"recordings/{finished.recording_id}") == b"the Recording"
    faults = [fault.finding for fault in find_faults(settings, find_kept(settings))]
    assert faults == ["damaged"]


def test_what_is_erased_meanwhile_does_not_come_back(
    finished: Job, earlier: EarlierFiles, client: TestClient, storage: SealedStorage
) -> None:
    assert earlier.seal_next() in (True, False)
    client.delete(f"/api/v1/recordings/{finished.recording_id}", params={"purge": True})

    seal_all(earlier)

    assert list(storage.find_names()) == []
    assert storage.keys.find(finished.recording_id) is None


def test_an_analysis_of_a_recording_in_clear_is_sealed(
    finished: Job, client: TestClient, store: JobStore, storage: SealedStorage, bench: OpenBench
) -> None:
    wish = {"recording_ids": [finished.recording_id], "settings": {"lang": "fr"}}
    again = client.post("/api/v1/analyses", json=wish).json()
    assert do_next(bench(stand_ins.write_report))

    token = str(store.get(again["items"][0]["id"]).token)
    name = format_result_name(again["items"][0]["id"], token, "results.json")
    assert storage.is_sealed(name)
    assert storage.hash(name)[0] == hashlib.sha256(stand_ins.RESULTS).hexdigest()
