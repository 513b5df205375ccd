"""The job rows: who may change what, and when."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest
from sqlalchemy import delete, text, update
from sqlalchemy.exc import IntegrityError

from app.errors import NotHere, StoreMismatch
from app.jobs.database.tables import analyses, recordings
from app.jobs.job import TRANSITIONS, Job, JobState
from app.jobs.store import JobStore
from app.settings import Settings
from app.storage.store import ResultFile
from tests.app.conftest import AddJob, on_both_databases

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


def test_the_oldest_job_is_claimed_first_and_its_attempt_and_progress_are_seen(
    store: JobStore, add_job: AddJob
) -> None:
    first, second = add_job(), add_job()
    job, token = claim(store)

    store.renew(job.id, token, "fusing", 0.6)

    seen = store.get(first.id)
    assert (job.id, seen.attempts, seen.stage, seen.progress) == (first.id, 1, "fusing", 0.6)
    assert claim(store)[0].id == second.id
    assert store.claim() is None
    with pytest.raises(NotHere):
        store.get("an_none")


@on_both_databases
def test_twenty_claims_at_once_give_every_job_to_one_claimer(store: JobStore, add_job: AddJob) -> None:
    jobs = [add_job() for _ in range(10)]

    with ThreadPoolExecutor(20) as pool:
        claimed = list(pool.map(lambda _: store.claim(), range(20)))

    assert sorted(job.id for job in claimed if job) == sorted(job.id for job in jobs)


@on_both_databases
def test_a_finished_job_has_its_files_and_is_published_once(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    _, token = claim(store)

    assert store.finish(job.id, token, FILES)
    assert store.get(job.id).state is JobState.SUCCEEDED
    assert store.find_file(job.id, "results.json") == FILES[0]
    assert not store.finish(job.id, token, FILES)
    assert store.is_published(job.id, token)
    assert not store.is_published(job.id, "another")


def lose(store: JobStore, job_id: str, token: str, way: str) -> None:
    """Let a worker lose its job, which another one claims unless it was cancelled."""
    if way == "cancelled":
        store.cancel(job_id)
    elif way == "released":
        store.release(job_id, token)
        claim(store)
    else:
        for _ in range(2):
            move_lease(store, -60.0)
            store.return_expired()
        claim(store)


@on_both_databases
@pytest.mark.parametrize("way", ["cancelled", "released", "lease ran out"])
def test_a_worker_that_lost_its_job_changes_nothing_any_more(
    store: JobStore, add_job: AddJob, way: str
) -> None:
    job = add_job()
    _, lost = claim(store)
    lose(store, job.id, lost, way)
    state = store.get(job.id).state

    assert not store.renew(job.id, lost, "fusing", 0.5)
    assert not store.finish(job.id, lost, FILES)
    assert not store.fail(job.id, lost, "E-SHORT", {})
    assert not store.release(job.id, lost)
    assert not store.interrupt(job.id, lost)
    assert store.find_file(job.id, "results.json") is None
    assert store.get(job.id).state is state


@on_both_databases
def test_an_orderly_release_does_not_count_as_a_death(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    _, token = claim(store)

    store.release(job.id, token, forgiven=True)

    assert (store.get(job.id).state, store.get(job.id).attempts) == (JobState.QUEUED, 0)


def move_lease(store: JobStore, by_s: float) -> None:
    """Move the end of every lease, as a clock does that is moved the other way, or a computer that sleeps."""
    store.run(update(analyses).values(lease_until_s=analyses.c.lease_until_s + by_s))


@on_both_databases
@pytest.mark.parametrize(
    "first_s", [-60.0, 3600.0, -3600.0], ids=["dead", "clock put back", "clock put forward"]
)
def test_a_job_whose_lease_ran_out_twice_waits_again_and_counts_an_interruption(
    store: JobStore, add_job: AddJob, first_s: float
) -> None:
    job = add_job()
    _, token = claim(store)

    assert store.return_expired() == ()  # a lease that lasts is left alone
    move_lease(store, first_s)
    assert store.return_expired() == ()
    assert store.get(job.id).state is JobState.RUNNING
    move_lease(store, -60.0)
    assert store.return_expired() == ((job.id, token),)

    back = store.get(job.id)
    assert (back.state, back.attempts, back.interruptions) == (JobState.QUEUED, 0, 1)
    assert (back.stage, back.progress) == (None, 0.0)


@on_both_databases
def test_a_living_worker_keeps_its_job_when_the_time_jumps(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    _, token = claim(store)

    for hours in (-8, 1, -1):  # a laptop slept, the clock was put back, put forward
        for _ in range(3):
            move_lease(store, 3600.0 * hours)
            assert store.return_expired() == ()
            assert store.renew(job.id, token, "fusing", 0.5)

    assert store.get(job.id).interruptions == 0


@on_both_databases
@pytest.mark.parametrize("source", tuple(JobState))
def test_a_state_follows_another_only_where_the_table_says_so(
    store: JobStore, add_job: AddJob, source: JobState
) -> None:
    for target in JobState:
        job = add_job()
        token = bring_to(store, job.id, source)
        moves: dict[JobState, Callable[[], object]] = {
            JobState.QUEUED: partial(store.release, job.id, token),
            JobState.RUNNING: store.claim,
            JobState.SUCCEEDED: partial(store.finish, job.id, token, FILES),
            JobState.FAILED: partial(store.fail, job.id, token, "E-SHORT", {}),
            JobState.CANCELLED: partial(store.cancel, job.id),
        }

        moves[target]()

        expected = target if target in TRANSITIONS[source] else source
        assert store.get(job.id).state is expected, target
        store.cancel(job.id)  # nothing waits when the next job is claimed


@on_both_databases
def test_a_commit_is_durable_through_a_power_cut(store: JobStore) -> None:
    asked = {
        "sqlite": ("PRAGMA journal_mode", "PRAGMA synchronous"),
        "postgresql": ("SHOW synchronous_commit",),
    }
    durable = {"sqlite": ["wal", 2], "postgresql": ["on"]}  # 2 is FULL

    with store._engine.connect() as connection:
        modes = [connection.execute(text(query)).scalar() for query in asked[connection.dialect.name]]

    assert modes == durable[store._engine.dialect.name]


@on_both_databases
def test_rows_cannot_lose_their_recording(store: JobStore, add_job: AddJob) -> None:
    add_job()

    with pytest.raises(IntegrityError), store._engine.begin() as connection:
        connection.execute(delete(recordings))


@on_both_databases
def test_two_stores_may_open_a_new_database_at_once(settings: Settings) -> None:
    settings.data_dir.mkdir(exist_ok=True)

    with ThreadPoolExecutor(4) as pool:
        stores = list(pool.map(lambda _: JobStore(settings), range(4)))

    assert [one.find_newest() for one in stores] == [(), (), (), ()]
    for one in stores:
        one.close()


def test_a_database_keeps_to_the_store_it_was_first_used_with(store: JobStore) -> None:
    store.check_belongs("folder-1")
    store.check_belongs("folder-1")

    with pytest.raises(StoreMismatch) as refusal:
        store.check_belongs("folder-2")

    assert refusal.value.facts == {"found": "folder-2", "needed": "folder-1"}
