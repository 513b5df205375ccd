"""What a correction says of its recording counts once it has a report."""

from dataclasses import replace

import pytest

from app.errors import NotHere
from app.jobs.batches import BatchStore
from app.jobs.job import Job, JobState
from app.jobs.listing import Library, LibraryFilter
from app.jobs.queue import WayIn
from app.jobs.recordings import RecordingStore, StoredRow
from app.jobs.store import JobStore
from app.request import ReportRequest
from fusion.diary import DiaryEntry
from tests.app.conftest import AddJob
from tests.app.library.test_report_versions import fail_next, finish_next

BREAK = (DiaryEntry("07:00:00", "07:03:00", "break"),)


@pytest.fixture
def recordings(store: JobStore) -> RecordingStore:
    return RecordingStore(store.engine, store.reader)


@pytest.fixture
def first(store: JobStore, add_job: AddJob) -> Job:
    """A recording of S1 that has a report."""
    job = add_job(subject="S1")
    finish_next(store)
    return job


def correct(store: JobStore, job: Job, way_in: WayIn = "web") -> ReportRequest:
    wish = replace(job.request, subject="S2", side="left", diary=BREAK)
    return store.add_analysis((job.recording_id, job.sha256), wish, way_in).request


def tell(row: StoredRow) -> tuple[object, ...]:
    return row.about.subject, row.about.side, row.diary


def test_a_correction_describes_its_recording_once_it_has_a_report(
    store: JobStore, recordings: RecordingStore, first: Job
) -> None:
    correct(store, first)
    before = recordings.get(first.recording_id)

    finish_next(store)

    assert tell(before) == ("S1", None, ())
    after = recordings.get(first.recording_id)
    assert tell(after) == ("S2", "left", BREAK)
    assert after.version == before.version + 1


def test_a_correction_that_failed_leaves_the_recording_as_it_was(
    store: JobStore, recordings: RecordingStore, first: Job
) -> None:
    correct(store, first)

    fail_next(store)

    assert tell(recordings.get(first.recording_id)) == ("S1", None, ())


def test_what_was_said_of_the_recording_meanwhile_stays(
    store: JobStore, recordings: RecordingStore, first: Job
) -> None:
    row = recordings.get(first.recording_id)
    recordings.describe(row, replace(row.about, subject="S3"))
    correct(store, first)

    finish_next(store)

    assert tell(recordings.get(first.recording_id)) == ("S3", "left", BREAK)


def test_settings_of_a_script_are_for_its_analysis_alone(
    store: JobStore, recordings: RecordingStore, first: Job
) -> None:
    correct(store, first, "api")

    finish_next(store)

    assert tell(recordings.get(first.recording_id)) == ("S1", None, ())


def test_an_attempt_that_failed_is_withdrawn_and_needs_no_attention_any_more(
    store: JobStore, first: Job
) -> None:
    correct(store, first)
    fail_next(store)
    library = Library(store.reader)
    (entry,) = library.find_page(LibraryFilter(group="attention"), 10)
    assert entry.attempt is not None

    kept = store.withdraw(entry.attempt.id)

    assert kept.id == first.id
    assert library.find_page(LibraryFilter(group="attention"), 10) == ()
    (entry,) = library.find_page(LibraryFilter(), 10)
    assert (entry.job.id, entry.attempt) == (first.id, None)


def test_without_a_report_there_is_nothing_to_withdraw_to(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    fail_next(store)

    with pytest.raises(NotHere):
        store.withdraw(job.id)


def test_in_its_batch_what_was_withdrawn_still_counts_as_failed(store: JobStore, first: Job) -> None:
    batches = BatchStore(store.engine, store.reader)
    row = RecordingStore(store.engine, store.reader).get(first.recording_id)
    batch = batches.add("spring", [(row, replace(first.request, diary=BREAK))])
    fail_next(store)
    (failed,) = batches.find_jobs(batch.id)

    store.withdraw(failed.id)

    assert batches.get(batch.id).counts[JobState.FAILED] == 1
    assert [job.id for job in batches.find_jobs(batch.id)] == [failed.id]
