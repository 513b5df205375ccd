"""Versions of a recording's report, numbered as they are asked for."""

from collections.abc import Callable
from dataclasses import replace
from threading import Thread
from typing import Any

import pytest
from sqlalchemy import text

from acromion.app.errors import NotHere, StaleVersion
from acromion.app.library.batches import BatchStore
from acromion.app.library.claims import WayIn, enqueue_all
from acromion.app.library.jobs import JobStore
from acromion.app.library.listing import HeadlineFigures, Library, LibraryFilter
from acromion.app.library.recordings import RecordingStore, StoredRow
from acromion.app.library.rows import Job, JobState
from acromion.app.library.versions import identify_work
from acromion.app.request import ReportRequest
from acromion.app.store.folder import ResultFile
from acromion.fusion.diary import DiaryEntry
from tests.app.conftest import AddJob
from tests.ways_in.servers import wait_for

MOVED = ReportRequest("shift.gt3x", calibration_windows_s=((3.0, 9.0),))


def again(store: JobStore, job: Job, request: ReportRequest) -> ReportRequest:
    """Ask for another analysis of the same recording."""
    return store.add_analysis((job.recording_id, job.sha256), request).request


def fail_next(store: JobStore, code: str = "E-CALIB") -> Job:
    """Let the job that waits fail; returns it."""
    job = store.claim()
    assert job is not None
    assert store.fail(job.id, str(job.token), code, {})
    return store.get(job.id)


def finish_next(store: JobStore, figures: HeadlineFigures | None = None) -> Job:
    """Let the job that waits end well; returns it."""
    job = store.claim()
    assert job is not None
    assert store.finish(job.id, str(job.token), [ResultFile("results.json", "0" * 64, 2)], figures)
    return store.get(job.id)


def test_other_settings_make_the_next_version_which_names_them(store: JobStore, add_job: AddJob) -> None:
    first = add_job()

    second = store.add_analysis((first.recording_id, first.sha256), MOVED)
    third = again(store, first, replace(MOVED, side="left", method="published"))

    versions = [first.request, second.request, third, add_job(b"another").request]
    assert [(request.version, request.changes) for request in versions] == [
        (1, ()),
        (2, ("calibration_windows_s",)),
        (3, ("side", "method")),
        (1, ()),
    ]
    assert [job.id for job in store.find_same(first.sha256, MOVED)] == [second.id]


def test_the_same_settings_again_are_the_same_version(store: JobStore, add_job: AddJob) -> None:
    first = add_job()
    again(store, first, MOVED)

    assert again(store, first, first.request).version == 1
    assert again(store, first, MOVED).version == 2


def test_a_reason_is_kept_and_changes_no_figure(store: JobStore, add_job: AddJob) -> None:
    first = add_job()

    told = again(store, first, replace(MOVED, reason="the arm was moving"))

    assert told.reason == "the arm was moving"
    assert identify_work(first.sha256, told) == identify_work(first.sha256, MOVED)


def test_what_failed_in_between_leaves_no_gap_and_is_compared_with_by_nobody(
    store: JobStore, add_job: AddJob
) -> None:
    first = add_job()
    finish_next(store)
    again(store, first, replace(MOVED, side="left"))
    again(store, first, replace(MOVED, side="left", pose="side-lean"))

    fail_next(store)
    begun = store.claim()

    assert begun is not None
    assert begun.request.version == 2
    assert set(begun.request.changes) == {"side", "pose", "calibration_windows_s"}


def test_two_of_one_recording_are_made_one_after_the_other(store: JobStore, add_job: AddJob) -> None:
    first = add_job()
    again(store, first, MOVED)
    other = add_job(b"another recording")

    begun = [store.claim() for _ in range(3)]

    assert [job.id if job else None for job in begun] == [first.id, other.id, None]


def test_the_same_correction_again_is_made_once(store: JobStore, add_job: AddJob) -> None:
    first = add_job()
    finish_next(store)

    corrected = [store.correct(store.get(first.id), MOVED) for _ in range(2)]

    assert corrected[0].id == corrected[1].id
    assert len(store.find_newest()) == 2


def test_a_correction_of_a_version_that_is_not_the_current_one_is_refused(
    store: JobStore, add_job: AddJob
) -> None:
    first = add_job()
    finish_next(store)
    corrected = store.correct(store.get(first.id), MOVED)

    with pytest.raises(StaleVersion):
        store.correct(store.get(first.id), replace(MOVED, side="left"))
    assert corrected.request.version == 2
    assert len(store.find_newest()) == 2


def test_a_correction_back_to_an_earlier_version_is_the_current_one(store: JobStore, add_job: AddJob) -> None:
    first = add_job()
    finish_next(store)
    second = store.correct(store.get(first.id), MOVED)
    finish_next(store)

    back = store.correct(store.get(second.id), first.request)

    assert (back.request.version, back.id != first.id) == (1, True)


def test_what_failed_leaves_its_version_to_the_next_and_the_one_before_it_to_be_corrected(
    store: JobStore, add_job: AddJob
) -> None:
    first = add_job()
    finish_next(store)
    failed = store.correct(store.get(first.id), MOVED)
    fail_next(store)

    again = store.correct(store.get(first.id), replace(MOVED, side="left")).request

    assert (again.version, again.changes) == (2, ("side", "calibration_windows_s"))
    with pytest.raises(StaleVersion):
        store.correct(store.get(failed.id), replace(MOVED, side="right"))


# What a correction says of its recording counts once it has a report.


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


@pytest.mark.parametrize(
    ("way_in", "end", "told"),
    [
        ("web", finish_next, ("S2", "left", BREAK)),
        ("web", fail_next, ("S1", None, ())),
        ("api", finish_next, ("S1", None, ())),  # settings of a script are for its analysis alone
    ],
    ids=["finished", "failed", "script"],
)
def test_a_correction_describes_its_recording_once_it_has_a_report(
    store: JobStore,
    recordings: RecordingStore,
    first: Job,
    *,
    way_in: WayIn,
    end: Callable[[JobStore], object],
    told: tuple[object, ...],
) -> None:
    correct(store, first, way_in)
    before = recordings.get(first.recording_id)

    end(store)

    after = recordings.get(first.recording_id)
    assert (tell(before), tell(after)) == (("S1", None, ()), told)
    assert after.version == before.version + (told[0] == "S2")


def test_what_was_said_of_the_recording_meanwhile_stays(
    store: JobStore, recordings: RecordingStore, first: Job
) -> None:
    row = recordings.get(first.recording_id)
    recordings.describe(row, replace(row.about, subject="S3"))
    correct(store, first)

    finish_next(store)

    assert tell(recordings.get(first.recording_id)) == ("S3", "left", BREAK)


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


@pytest.mark.parametrize("database", ["postgresql"], indirect=True)
def test_a_batch_that_is_retried_twice_at_once_is_queued_once(
    store: JobStore, add_job: AddJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    batches, job = BatchStore(store.engine, store.reader), add_job()
    row = RecordingStore(store.engine, store.reader).get(job.recording_id)
    batch = batches.add("spring", [(row, job.request)])
    fail_next(store)
    counts = list[int]()
    second = Thread(target=lambda: counts.append(batches.retry_failed(batch.id)))
    waiting = text("SELECT count(*) FROM pg_stat_activity WHERE wait_event_type = 'Lock'")

    def is_second_waiting() -> bool:
        with store.reader.connect() as connection:
            return bool(connection.execute(waiting).scalar_one())

    def enqueue_while_the_second_waits(*rest: Any) -> Any:
        if second.ident is None:
            second.start()
            wait_for(is_second_waiting)
        return enqueue_all(*rest)

    monkeypatch.setattr("acromion.app.library.batches.enqueue_all", enqueue_while_the_second_waits)
    counts.append(batches.retry_failed(batch.id))
    second.join()

    assert sorted(counts) == [0, 1]
    assert batches.get(batch.id).counts[JobState.QUEUED] == 1
