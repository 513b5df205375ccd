"""Rows that another transaction holds: only a database with row locks has them."""

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from sqlalchemy import update

from app.jobs.database.connect import lock_tables, one_request_at_a_time
from app.jobs.database.tables import recordings
from app.jobs.job import Job, JobState
from app.jobs.recordings import Description, RecordingStore, insert_recording
from app.jobs.results import find_or_add
from app.jobs.store import JobStore
from app.jobs.worker import run_next
from app.storage.store import Storage, StoredRecording
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenBench

pytestmark = pytest.mark.parametrize("database", ["postgresql"], indirect=True)


def test_a_job_whose_recording_is_being_written_waits_for_the_next_turn(
    store: JobStore, add_job: AddJob, bench: OpenBench
) -> None:
    job, at_work = add_job(), bench(stand_ins.write_report)
    with store.engine.begin() as connection:
        connection.execute(update(recordings).values(side_revision=0))
        passed_over = not run_next(at_work)

    run_next(at_work)

    assert passed_over
    assert store.get(job.id).state is JobState.SUCCEEDED


def test_the_same_upload_waits_for_the_one_that_is_being_stored_and_is_its_row(store: JobStore) -> None:
    first, second = (StoredRecording(f"rec_{n}", "ab" * 32, 3) for n in (1, 2))
    recordings_of = RecordingStore(store.engine, store.reader)
    with ThreadPoolExecutor(1) as other:
        with store.engine.begin() as connection:
            lock_tables(connection)
            insert_recording(connection, first, Description("shift.csv"))
            waiting = other.submit(recordings_of.add, second, Description("shift.csv"))
            time.sleep(0.3)

        assert waiting.result().id == first.id


def test_an_analysis_that_two_servers_are_asked_for_at_once_is_made_once(
    store: JobStore, storage: Storage, add_job: AddJob
) -> None:
    done = add_job()
    asked = replace(done.request, side="left")
    own = (done.recording_id, done.sha256)

    def add() -> Job:
        return store.add_analysis(own, asked)

    with ThreadPoolExecutor(1) as other:
        with one_request_at_a_time(store.engine):  # the other server's
            waiting = other.submit(find_or_add, store, storage, own, asked, "api", add)
            time.sleep(0.3)
            made = add()

        assert waiting.result() == (made, True)
