"""Drafts of a recording's page: each person has separate ones, until they are sent, old or deleted."""

from datetime import UTC, datetime, timedelta

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import update

from acromion.app.library.database.tables import drafts
from acromion.app.library.drafts import DraftStore
from acromion.app.library.jobs import JobStore
from acromion.app.library.recordings import RecordingStore
from acromion.app.library.rows import Job
from tests.app.conftest import AddJob, on_both_databases

FORM = "conclusion:rec_1"


@pytest.fixture
def own(store: JobStore) -> DraftStore:
    return DraftStore(store.engine, store.reader)


@pytest.fixture
def job(add_job: AddJob) -> Job:
    return add_job()


@on_both_databases
def test_a_later_draft_replaces_the_earlier_one(own: DraftStore, job: Job) -> None:
    for text in ("Overhead", "Overhead work"):
        own.put("anna", FORM, job.recording_id, text)

    found = own.find("anna", FORM)
    assert found is not None
    assert found.text == "Overhead work"


def test_nobody_else_has_the_draft(own: DraftStore, job: Job) -> None:
    own.put("anna", FORM, job.recording_id, "Overhead")

    assert own.find("clara", FORM) is None


def test_a_draft_of_more_than_two_weeks_is_gone(own: DraftStore, store: JobStore, job: Job) -> None:
    own.put("anna", FORM, job.recording_id, "Overhead")
    old = (datetime.now(UTC) - timedelta(days=15)).isoformat(timespec="microseconds")
    store.run(update(drafts).values(at=old))

    assert own.find("anna", FORM) is None


@on_both_databases
def test_a_draft_is_deleted_with_its_recording(own: DraftStore, store: JobStore, job: Job) -> None:
    own.put("anna", FORM, job.recording_id, "Overhead")
    kept = RecordingStore(store.engine, store.reader)
    kept.trash(job.recording_id)
    kept.begin_purge(job.recording_id)
    kept.end_purge(job.recording_id)

    assert own.find("anna", FORM) is None


def test_a_draft_over_http_is_saved_read_and_deleted(client: TestClient) -> None:
    made = client.put("/api/v1/analyze", params={"file_name": "1.csv"}, content=b"1").json()
    address = f"/drafts/correction/{made['id']}"

    empty = client.get(address).status_code
    saved = client.put(address, content="side=left").status_code
    text = client.get(address).json()["text"]
    deleted = client.delete(address).status_code

    assert (empty, saved, text, deleted) == (204, 204, "side=left", 204)
    assert client.get(address).status_code == 204


@pytest.mark.parametrize("place", ["rec_0123456789abcdef", "an_0123456789abcdef"])
def test_a_draft_needs_its_recording(client: TestClient, place: str) -> None:
    assert client.put(f"/drafts/conclusion/{place}", content="x").status_code == 404
