"""Words of people are sealed in the rows: nobody reads them there, and a destroyed key takes them along."""

import sqlite3

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import insert, text

from app.jobs.database.seal_rows import seal_rows
from app.jobs.database.sealed_text import find_sealer
from app.jobs.database.tables import recordings
from app.jobs.library.listing import Library, LibraryFilter
from app.jobs.recordings import Description, RecordingFilter, RecordingStore
from app.jobs.store import JobStore
from app.jobs.webhooks import EVENTS, WebhookStore
from app.request import ReportRequest
from app.settings import Settings
from app.storage.store import StoredRecording
from tests.app.conftest import AddJob, on_both_set_ups

CANARY = "c4n4ry-0123456789abcdef01234567"


def find_everywhere(store: JobStore, words: str) -> list[str]:
    """Give the columns in which words stand open."""
    found = []
    with store.engine.connect() as connection:
        for table in recordings.metadata.sorted_tables:
            rows = connection.execute(text(f'SELECT * FROM "{table.name}"')).mappings().all()
            for row in rows:
                found += [f"{table.name}.{name}" for name, value in row.items() if words in str(value)]
    return found


@on_both_set_ups
def test_neither_address_nor_secret_of_a_webhook_stands_open_in_the_rows(store: JobStore) -> None:
    hook = WebhookStore(store.engine, store.reader).add(f"https://{CANARY}.example", EVENTS)

    assert find_everywhere(store, CANARY) == []
    assert find_everywhere(store, hook.secret) == []


@pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)
def test_a_webhook_of_an_earlier_release_is_read_and_sealed_in_time(store: JobStore) -> None:
    with store.engine.begin() as connection:
        connection.execute(
            text(
                "INSERT INTO webhooks (id, url, events, secret, created_at)"
                f" VALUES ('wh_1', 'https://{CANARY}.example', '[]', 'whsec_{CANARY}', '2026')"
            )
        )
    (before,) = WebhookStore(store.engine, store.reader).find_all()

    assert seal_rows(store.engine, 10) == 1

    assert find_everywhere(store, CANARY) == []
    assert WebhookStore(store.engine, store.reader).find_all() == (before,)
    assert (before.url, before.secret) == (f"https://{CANARY}.example", f"whsec_{CANARY}")


@pytest.fixture
def kept(store: JobStore) -> RecordingStore:
    return RecordingStore(store.engine, store.reader)


def add(kept: RecordingStore, number: int, about: Description) -> str:
    row = kept.add(StoredRecording(f"rec_{number:016x}", f"{number:064x}", 1), about)
    return row.id


@on_both_set_ups
def test_no_word_of_a_recording_stands_open_in_the_rows(client: TestClient, store: JobStore) -> None:
    about = {"file_name": f"{CANARY}.csv", "subject": CANARY, "external_id": CANARY, "study": CANARY}
    analysis = client.put("/api/v1/analyze", content=b"x", params=about).json()
    client.patch(f"/api/v1/recordings/{analysis['recording_id']}", json={"note": CANARY}).raise_for_status()

    assert find_everywhere(store, CANARY) == []


def test_an_upload_under_way_has_no_open_words(client: TestClient, store: JobStore) -> None:
    headers = {"Upload-Length": "5", "Tus-Resumable": "1.0.0", "Upload-Metadata": "filename YzRuNHJ5LWZpbGU="}
    client.post("/api/v1/uploads", headers=headers).raise_for_status()

    assert find_everywhere(store, "YzRuNHJ5") == []


@on_both_set_ups
def test_words_come_back_as_they_were(kept: RecordingStore) -> None:
    about = Description("Équipe.gt3x", "S012", "left", "visit-7", "after lunch")

    recording_id = add(kept, 1, about)

    assert kept.get(recording_id).about == about


@on_both_set_ups
def test_a_destroyed_key_takes_the_words_along(kept: RecordingStore, store: JobStore) -> None:
    recording_id = add(kept, 1, Description("shift.gt3x", "S012"))

    find_sealer(store.engine).destroy([recording_id])

    assert kept.get(recording_id).about.subject == ""


def test_words_that_are_no_label_are_not_stored(store: JobStore) -> None:
    with pytest.raises(Exception, match="as a Label"), store.engine.begin() as connection:
        connection.execute(insert(recordings).values(id="rec_1", file_name="shift.gt3x"))


@on_both_set_ups
@pytest.mark.parametrize(
    ("wanted", "found"),
    [
        (RecordingFilter(subject="S01"), ["rec_0000000000000001"]),
        (RecordingFilter(external_id="v2"), ["rec_0000000000000002"]),
        (RecordingFilter(subject="S02", external_id="v1"), []),
    ],
)
def test_sealed_words_are_found(kept: RecordingStore, wanted: RecordingFilter, found: list[str]) -> None:
    add(kept, 1, Description("a.gt3x", "S01", external_id="v1"))
    add(kept, 2, Description("b.gt3x", "S02", external_id="v2"))

    assert [row.id for row in kept.find_page(wanted, 10)] == found


@on_both_set_ups
def test_a_changed_word_is_found_at_once(kept: RecordingStore) -> None:
    add(kept, 1, Description("a.gt3x", "S01"))
    (row,) = kept.find_page(RecordingFilter(subject="S01"), 10)

    kept.describe(row, Description("a.gt3x", "S09"))

    assert [len(kept.find_page(RecordingFilter(subject=name), 10)) for name in ("S01", "S09")] == [0, 1]


@on_both_set_ups
def test_the_list_is_sorted_by_sealed_words(store: JobStore, add_job: AddJob) -> None:
    for content, subject in ((b"1", "b"), (b"2", ""), (b"3", "A")):
        add_job(content, subject=subject)

    page = Library(store.reader).find_page(LibraryFilter(order="subject"), 10)

    assert [entry.job.request.subject for entry in page] == ["A", "b", ""]


@on_both_set_ups
def test_the_list_is_sorted_the_other_way_with_the_unnamed_last(store: JobStore, add_job: AddJob) -> None:
    for content, subject in ((b"1", "b"), (b"2", ""), (b"3", "A")):
        add_job(content, subject=subject)

    page = Library(store.reader).find_page(LibraryFilter(order="subject", is_reversed=True), 10)

    assert [entry.job.request.subject for entry in page] == ["b", "A", ""]


@pytest.fixture
def older(store: JobStore, settings: Settings) -> JobStore:
    """A store with a row of an earlier release, whose words stand open."""
    file = settings.database_url.removeprefix("sqlite:///")
    request = ReportRequest(f"{CANARY}.csv", CANARY).to_json()
    with sqlite3.connect(file) as connection:
        connection.execute(
            "INSERT INTO recordings (id, sha256, size_bytes, file_name, state, created_at, subject) "
            "VALUES ('rec_1', 'a', 1, ?, 'stored', '2026', ?)",
            (f"{CANARY}.csv", CANARY),
        )
        connection.execute(
            "INSERT INTO analyses (id, recording_id, request, way_in, state, progress, attempts, beats, "
            "created_at) VALUES ('an_1', 'rec_1', ?, 'api', 'failed', 0, 0, 0, '2026-03-02T07:00:00+00:00')",
            (request,),
        )
    connection.close()
    return store


def test_words_of_an_earlier_release_are_read(older: JobStore) -> None:
    assert older.get("an_1").request.subject == CANARY


def test_words_of_an_earlier_release_are_sealed_in_time(older: JobStore) -> None:
    assert seal_rows(older.engine, 10) == 2

    assert find_everywhere(older, CANARY) == []


def test_sealing_comes_to_an_end(older: JobStore) -> None:
    seal_rows(older.engine, 10)

    assert seal_rows(older.engine, 10) == 0


def test_sealed_words_of_an_earlier_release_are_read(older: JobStore) -> None:
    seal_rows(older.engine, 10)

    assert older.get("an_1").file_name == f"{CANARY}.csv"


@on_both_set_ups
def test_sealed_words_are_searched_and_sorted_at_once(store: JobStore, add_job: AddJob) -> None:
    for content, name in ((b"1", "arm_b.gt3x"), (b"2", "arm_a.gt3x"), (b"3", "other.gt3x")):
        add_job(content, file_name=name)

    page = Library(store.reader).find_page(LibraryFilter(text="arm_", order="name"), 10)

    assert [entry.job.file_name for entry in page] == ["arm_a.gt3x", "arm_b.gt3x"]


@on_both_set_ups
def test_a_recording_that_takes_the_place_of_an_erased_one_is_found(kept: RecordingStore) -> None:
    first, second = (add(kept, number, Description("a.gt3x", "S01")) for number in (1, 2))
    kept.keep_inspection(first, {})
    assert len(kept.find_page(RecordingFilter(subject="S01"), 10)) == 2

    kept.end_purge(first)
    add(kept, 3, Description("c.gt3x", "S03"))
    kept.keep_inspection(second, {})

    assert len(kept.find_page(RecordingFilter(subject="S03"), 10)) == 1
