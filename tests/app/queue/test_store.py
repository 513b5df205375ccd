"""The job rows: who may change what, and when."""

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from sqlalchemy import create_engine, delete, text, update
from sqlalchemy.exc import IntegrityError

from app.errors import NotHere, StoreMismatch
from app.jobs.database.tables import analyses, recordings
from app.jobs.job import TRANSITIONS, Job, JobState
from app.jobs.store import JobStore
from app.settings import Settings
from app.storage.store import ResultFile
from tests.app.conftest import AddJob

pytestmark = pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)

FILES = (ResultFile("results.json", "0" * 64, 2),)


def claim(store: JobStore) -> tuple[Job, str]:
    job = store.claim()
    assert job is not None
    assert job.token is not None
    return job, job.token


def bring_to(store: JobStore, job_id: str, state: JobState) -> str:
    """Bring a queued job into a state; gives the token of the attempt, if there was one."""
    if state in (JobState.QUEUED, JobState.CANCELLED):
        if state is JobState.CANCELLED:
            store.cancel(job_id)
        return "none"
    _, token = claim(store)
    if state is JobState.SUCCEEDED:
        store.finish(job_id, token, FILES)
    elif state is JobState.FAILED:
        store.fail(job_id, token, "E-SHORT", {"s": 4.0})
    return token


def test_a_new_job_waits_and_knows_its_recording(add_job: AddJob) -> None:
    job = add_job(b"four", file_name="Équipe 1.gt3x")

    assert job.state is JobState.QUEUED
    assert (job.file_name, job.size_bytes, job.attempts) == ("Équipe 1.gt3x", 4, 0)


def test_the_oldest_job_is_claimed_first(store: JobStore, add_job: AddJob) -> None:
    first, second = add_job(), add_job()

    assert [claim(store)[0].id, claim(store)[0].id] == [first.id, second.id]


def test_nothing_is_claimed_when_nothing_waits(store: JobStore) -> None:
    assert store.claim() is None


def test_twenty_claims_at_once_give_every_job_to_one_claimer(store: JobStore, add_job: AddJob) -> None:
    jobs = [add_job() for _ in range(10)]

    with ThreadPoolExecutor(20) as pool:
        claimed = list(pool.map(lambda _: store.claim(), range(20)))

    assert sorted(job.id for job in claimed if job) == sorted(job.id for job in jobs)


def test_a_claimed_job_counts_the_attempt(store: JobStore, add_job: AddJob) -> None:
    add_job()

    assert claim(store)[0].attempts == 1


def test_progress_is_seen_by_everybody(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    _, token = claim(store)

    store.renew(job.id, token, "fusing", 0.6)

    assert (store.get(job.id).stage, store.get(job.id).progress) == ("fusing", 0.6)


def test_a_finished_job_has_its_files(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    _, token = claim(store)

    assert store.finish(job.id, token, FILES)
    assert store.get(job.id).state is JobState.SUCCEEDED
    assert store.find_file(job.id, "results.json") == FILES[0]


def test_an_attempt_that_no_longer_counts_publishes_nothing(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    _, lost = claim(store)
    store.release(job.id, lost)
    claim(store)

    assert not store.finish(job.id, lost, FILES)
    assert store.find_file(job.id, "results.json") is None
    assert store.get(job.id).state is JobState.RUNNING


def test_a_failed_job_says_why(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    _, token = claim(store)

    store.fail(job.id, token, "E-SHORT", {"s": 4.0})

    assert store.get(job.id).problem_code == "E-SHORT"
    assert store.get(job.id).problem_facts == {"s": 4.0}


def test_an_orderly_release_does_not_count_as_a_death(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    _, token = claim(store)

    store.release(job.id, token, forgiven=True)

    assert (store.get(job.id).state, store.get(job.id).attempts) == (JobState.QUEUED, 0)


def test_a_cancelled_job_is_no_longer_its_workers(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    _, token = claim(store)

    store.cancel(job.id)

    assert not store.renew(job.id, token, "fusing", 0.5)


def move_lease(store: JobStore, by_s: float) -> None:
    """Move the end of every lease, as a clock does that is moved the other way, or a computer that sleeps."""
    store.run(update(analyses).values(lease_until_s=analyses.c.lease_until_s + by_s))


def test_a_lease_that_lasts_is_left_alone(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    claim(store)

    assert store.return_expired() == ()
    assert store.get(job.id).state is JobState.RUNNING


def test_a_job_whose_lease_ran_out_twice_waits_again_and_counts_an_interruption(
    store: JobStore, add_job: AddJob
) -> None:
    job = add_job()
    _, token = claim(store)

    move_lease(store, -60.0)
    assert store.return_expired() == ()
    move_lease(store, -60.0)
    assert store.return_expired() == ((job.id, token),)

    back = store.get(job.id)
    assert (back.state, back.attempts, back.interruptions) == (JobState.QUEUED, 0, 1)
    assert (back.stage, back.progress) == (None, 0.0)


@pytest.mark.parametrize("hours", [-8, 1, -1], ids=["a laptop slept", "clock put back", "clock put forward"])
def test_a_living_worker_keeps_its_job_when_the_time_jumps(
    store: JobStore, add_job: AddJob, hours: int
) -> None:
    job = add_job()
    _, token = claim(store)

    for _ in range(3):
        move_lease(store, 3600.0 * hours)
        assert store.return_expired() == ()
        assert store.renew(job.id, token, "fusing", 0.5)

    assert store.get(job.id).interruptions == 0


@pytest.mark.parametrize("hours", [1, -1])
def test_the_job_of_a_dead_worker_comes_back_whatever_the_clock_does(
    store: JobStore, add_job: AddJob, hours: int
) -> None:
    job = add_job()
    claim(store)

    move_lease(store, 3600.0 * hours)
    store.return_expired()
    move_lease(store, -60.0)
    store.return_expired()

    assert store.get(job.id).state is JobState.QUEUED


def test_a_worker_that_lost_its_job_changes_nothing_any_more(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    _, lost = claim(store)
    for _ in range(2):
        move_lease(store, -60.0)
        store.return_expired()
    claim(store)

    assert not store.renew(job.id, lost, "fusing", 0.5)
    assert not store.finish(job.id, lost, FILES)
    assert not store.fail(job.id, lost, "E-SHORT", {})
    assert not store.release(job.id, lost)
    assert not store.interrupt(job.id, lost)
    assert store.get(job.id).state is JobState.RUNNING


def test_a_job_that_is_not_there_is_refused(store: JobStore) -> None:
    with pytest.raises(NotHere):
        store.get("an_none")


@pytest.mark.parametrize(("source", "target"), tuple(itertools.product(JobState, JobState)))
def test_a_state_follows_another_only_where_the_table_says_so(
    store: JobStore, add_job: AddJob, source: JobState, target: JobState
) -> None:
    job = add_job()
    token = bring_to(store, job.id, source)
    moves: dict[JobState, Callable[[], object]] = {
        JobState.QUEUED: lambda: store.release(job.id, token),
        JobState.RUNNING: store.claim,
        JobState.SUCCEEDED: lambda: store.finish(job.id, token, FILES),
        JobState.FAILED: lambda: store.fail(job.id, token, "E-SHORT", {}),
        JobState.CANCELLED: lambda: store.cancel(job.id),
    }

    moves[target]()

    expected = target if target in TRANSITIONS[source] else source
    assert store.get(job.id).state is expected


def test_a_commit_is_durable_through_a_power_cut(store: JobStore) -> None:
    asked = {
        "sqlite": ("PRAGMA journal_mode", "PRAGMA synchronous"),
        "postgresql": ("SHOW synchronous_commit",),
    }
    durable = {"sqlite": ["wal", 2], "postgresql": ["on"]}  # 2 is FULL

    with store._engine.connect() as connection:
        modes = [connection.execute(text(query)).scalar() for query in asked[connection.dialect.name]]

    assert modes == durable[store._engine.dialect.name]


def test_rows_cannot_lose_their_recording(store: JobStore, add_job: AddJob) -> None:
    add_job()

    with pytest.raises(IntegrityError), store._engine.begin() as connection:
        connection.execute(delete(recordings))


def test_two_stores_may_open_a_new_database_at_once(settings: Settings) -> None:
    settings.data_dir.mkdir(exist_ok=True)

    with ThreadPoolExecutor(4) as pool:
        stores = list(pool.map(lambda _: JobStore(settings), range(4)))

    assert [one.find_newest() for one in stores] == [(), (), (), ()]
    for one in stores:
        one.close()


def test_the_rows_outlive_the_store(settings: Settings, add_job: AddJob, tmp_path: Path) -> None:
    job = add_job()

    engine = create_engine(settings.database_url)
    with engine.connect() as connection:
        assert connection.execute(text("SELECT id FROM analyses")).scalar() == job.id
    engine.dispose()


def test_a_published_attempt_is_known_as_that_when_asked_again(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    _, token = claim(store)
    store.finish(job.id, token, FILES)

    assert not store.finish(job.id, token, FILES)
    assert store.is_published(job.id, token)
    assert not store.is_published(job.id, "another")


def test_a_database_keeps_to_the_store_it_was_first_used_with(store: JobStore) -> None:
    store.check_belongs("folder-1")
    store.check_belongs("folder-1")

    with pytest.raises(StoreMismatch) as refusal:
        store.check_belongs("folder-2")

    assert refusal.value.facts == {"found": "folder-2", "needed": "folder-1"}
