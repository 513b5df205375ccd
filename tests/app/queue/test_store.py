"""The job rows: who may change what, and when."""

import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import delete, text, update
from sqlalchemy.exc import IntegrityError

from acromion.app.errors import NotHere, StoreMismatch
from acromion.app.http.pages.views import USUAL_S_PER_MB, estimate_left_s
from acromion.app.library.audit_log import acting
from acromion.app.library.claims import WayIn
from acromion.app.library.database.tables import analyses, recordings
from acromion.app.library.jobs import JobFilter, JobStore
from acromion.app.library.listing import AnalysisDuration, Library
from acromion.app.library.rows import TRANSITIONS, Job, JobState
from acromion.app.queue.worker import run_next
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.folder import ResultFile, Storage
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenWorker, on_both_databases
from tests.app.stand_ins import write_report

FILES = (ResultFile("results.json", "0" * 64, 2),)


def claim(store: JobStore) -> tuple[Job, str]:
    job = store.claim()
    assert job is not None
    assert job.token is not None
    return job, job.token


def bring_to(store: JobStore, job_id: str, state: JobState) -> str:
    """Bring a queued job into a state; return the token of the attempt, if there was one."""
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


def test_a_cancelled_analysis_is_queued_again(store: JobStore, add_job: AddJob) -> None:
    job = add_job()
    store.cancel(job.id)

    again = store.retry(job.id)

    assert (again.id == job.id, again.state) == (False, JobState.QUEUED)


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


# What tokens ask for takes turns by token; what a person drops on the page goes first.


def ask(store: JobStore, storage: Storage, who: str, number: int, way_in: WayIn = "api") -> None:
    upload = storage.open_upload(1_000_000)
    upload.write(f"{who} {number}".encode())
    with acting(who):
        store.add(upload.keep(), ReportRequest(f"{who}-{number}.gt3x"), way_in)


def read_order(store: JobStore, open_worker: OpenWorker, count: int) -> list[str]:
    """Do the jobs one by one; return whose each was."""
    worker = open_worker(write_report)
    for _ in range(count):
        assert run_next(worker)
    jobs = sorted(store.find_page(JobFilter(), count), key=lambda job: str(job.ended_at))
    return [job.file_name.partition("-")[0] for job in jobs]


@on_both_databases
def test_a_token_that_sends_much_does_not_hold_up_another(
    store: JobStore, storage: Storage, open_worker: OpenWorker
) -> None:
    for number in range(4):
        ask(store, storage, "tok_many", number)
    for number in range(2):
        ask(store, storage, "tok_few", number)

    order = read_order(store, open_worker, 6)

    assert order == ["tok_many", "tok_few", "tok_many", "tok_few", "tok_many", "tok_many"]


def test_a_drop_on_the_page_goes_before_every_token(
    store: JobStore, storage: Storage, open_worker: OpenWorker
) -> None:
    for number in range(3):
        ask(store, storage, "tok_many", number)
    ask(store, storage, "per_clara", 0, "web")

    assert read_order(store, open_worker, 4)[0] == "per_clara"


@on_both_databases
def test_who_timed_out_twice_in_an_hour_waits_for_all_others(
    store: JobStore, storage: Storage, open_worker: OpenWorker
) -> None:
    for number in range(3):
        ask(store, storage, "tok_slow", number)
    for _ in range(2):
        job = store.claim()
        assert job is not None
        store.fail(job.id, str(job.token), "E-TIMEOUT", {"s": 300})
    ask(store, storage, "tok_other", 0)

    assert read_order(store, open_worker, 2)[-2:] == ["tok_other", "tok_slow"]


# The time left of an analysis, by those before it: what is judged, what is not, where it is told.


NOW = datetime(2026, 3, 2, 8, 0, 10, tzinfo=UTC)
BEGAN = NOW - timedelta(seconds=4)


@pytest.fixture
def running(add_job: AddJob) -> Job:
    """An analysis of a file of 100 bytes, begun 4 s ago."""
    return replace(add_job(), file_name="day.GT3X", size_bytes=100, state=JobState.RUNNING, started_at=BEGAN)


def test_the_time_left_comes_from_files_of_the_kind_scaled_by_size(running: Job) -> None:
    took = [
        AnalysisDuration("a.gt3x", 50, 3.0),
        AnalysisDuration("b.gt3x", 100, 10.0),
        AnalysisDuration("c.gt3x", 200, 13.0),
        AnalysisDuration("a.csv", 100, 100.0),  # another kind
    ]

    # any file takes 3 s: 3 + 0 x 2, 10 and 3 + 10 / 2 s; the middle one, less the 4 s that have passed
    assert estimate_left_s(running, took, NOW) == 4.0


def test_an_analysis_that_takes_longer_than_others_has_no_time_left(running: Job) -> None:
    assert estimate_left_s(running, [AnalysisDuration("a.gt3x", 100, 3.0)], NOW) == 0.0


def test_the_first_file_of_a_kind_has_the_usual_time(running: Job) -> None:
    large = replace(running, size_bytes=100_000_000)

    assert estimate_left_s(large, [], NOW) == 3.0 + 100 * USUAL_S_PER_MB[".gt3x"] - 4.0


def test_the_preparation_after_installation_comes_on_top(running: Job) -> None:
    preparing = replace(running, stage="preparing", progress=0.4)

    # 6 of 10 s of preparation, and then all of the 10 s that the file takes
    assert estimate_left_s(preparing, [AnalysisDuration("a.gt3x", 100, 10.0)], NOW) == 16.0


def test_only_what_runs_has_time_left(running: Job) -> None:
    waiting = replace(running, state=JobState.QUEUED, started_at=None)

    assert estimate_left_s(waiting, [AnalysisDuration("a.gt3x", 100, 10.0)], NOW) is None


def test_finished_analyses_are_what_time_is_judged_by(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker
) -> None:
    add_job(b"1")
    run_next(open_worker(stand_ins.write_report))
    add_job(b"2")

    (took,) = Library(store.reader).find_durations()

    assert took.size_bytes == 1
    assert took.took_s >= 0


def test_the_list_tells_about_how_long_it_still_takes(
    client: TestClient, store: JobStore, add_job: AddJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_job(b"123")
    store.claim()
    monkeypatch.setattr(Library, "find_durations", lambda _: (AnalysisDuration("a.gt3x", 3, 3600.0),))

    assert re.search(r"about (1\s+h|59\s+min.{0,8}) left", client.get("/").text)
