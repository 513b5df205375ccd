"""Rows that another transaction holds: only a database with row locks has them."""

import pytest
from sqlalchemy import update

from app.jobs.database.tables import recordings
from app.jobs.job import JobState
from app.jobs.store import JobStore
from app.jobs.worker import run_next
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
