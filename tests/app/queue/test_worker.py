"""The worker: one job from claim to report, and what it does when something dies."""

import os
import signal
import sys
import threading
import time
from dataclasses import replace
from multiprocessing import forkserver
from typing import cast

import pytest
from sqlalchemy import select, update

from acromion.app.analysis import attempt
from acromion.app.analysis import fork_server as forking
from acromion.app.analysis.attempt import NICENESS, MakeReport, choose_limits
from acromion.app.analysis.fork_server import NotStarted, end_fork_server, warm_up_and_wait
from acromion.app.library.database.tables import analyses
from acromion.app.library.jobs import JobStore
from acromion.app.library.recordings import RecordingStore
from acromion.app.library.rows import JobState
from acromion.app.queue import pool, worker
from acromion.app.queue.worker import Lease, return_expired, run_next
from acromion.app.request import Reference
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenWorker, on_both_set_ups


class SlowRoad:
    """A store whose one way takes as long as two renewals of whoever holds the job."""

    def __init__(self, storage: Storage, store: JobStore, way: str) -> None:
        self._storage, self._store, self._way = storage, store, way
        self.leases: list[float] = []

    def __getattr__(self, name: str) -> object:
        if name == self._way and not self.leases:
            self._watch_leases()
        return getattr(self._storage, name)

    def _watch_leases(self) -> None:
        end_s = time.monotonic() + 20
        while len(self.leases) < 3 and time.monotonic() < end_s:
            with self._store.reader.connect() as connection:
                until_s = connection.execute(select(analyses.c.lease_until_s)).scalar_one()
            if until_s not in self.leases:
                self.leases.append(until_s)
            time.sleep(0.02)


def die_while_running(store: JobStore) -> None:
    """Take the next job, and be gone for so long that the lease ran out twice."""
    assert store.claim() is not None
    store.run(update(analyses).values(lease_until_s=0.0, is_lease_missed=1))


def find_fork_server() -> int:
    pid = getattr(forkserver._forkserver, "_forkserver_pid", None)
    assert pid is not None
    return int(pid)


@on_both_set_ups
def test_a_job_becomes_a_report_of_the_attempt_that_counts(
    store: JobStore, storage: Storage, add_job: AddJob, open_worker: OpenWorker
) -> None:
    job = add_job()

    assert run_next(open_worker(stand_ins.write_report))

    done = store.get(job.id)
    assert done.state is JobState.SUCCEEDED
    assert store.find_file(job.id, "report.fr.pdf") is not None
    name = f"analyses/{job.id}/{done.token}/results.json"
    assert storage.fetch(name).path.read_bytes() == stand_ins.RESULTS
    assert not run_next(open_worker(stand_ins.write_report))


@pytest.mark.parametrize(
    ("make", "limits", "code", "facts"),
    [
        (stand_ins.write_niceness, {}, "E-SHORT", {"recorded_s": os.nice(0) + NICENESS, "min_s": 0}),
        (stand_ins.take_all_memory, {}, "E-MEMORY", None),
        (stand_ins.never_end, {"wall_limit_s": 4.0}, "E-TIMEOUT", {"s": 4}),  # although it makes progress
        (stand_ins.stand_still, {"wall_limit_s": 4.0}, "E-TIMEOUT", {"s": 2}),  # half of its time
    ],
)
def test_an_attempt_that_cannot_become_a_report_ends_with_its_code(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker, make: MakeReport,
    limits: dict[str, float], code: str, facts: dict[str, object] | None,
) -> None:  # fmt: skip
    job = add_job()

    run_next(open_worker(make, **limits))

    failed = store.get(job.id)
    assert (failed.state, failed.problem_code) == (JobState.FAILED, code)
    assert facts is None or failed.problem_facts == facts


def test_a_bug_ends_the_job_with_a_reference_and_leaves_no_file(
    store: JobStore, storage: Storage, add_job: AddJob, open_worker: OpenWorker
) -> None:
    job = add_job()

    run_next(open_worker(stand_ins.fail_by_bug))

    failed = store.get(job.id)
    assert (failed.problem_code, list(failed.problem_facts)) == ("E-INTERNAL", ["reference"])
    assert [path for path in storage.root.glob("analyses/**/*") if path.is_file()] == []


def test_a_killed_attempt_is_tried_again(store: JobStore, add_job: AddJob, open_worker: OpenWorker) -> None:
    job = add_job()

    run_next(open_worker(stand_ins.be_killed))
    run_next(open_worker(stand_ins.write_report))

    assert (store.get(job.id).state, store.get(job.id).attempts) == (JobState.SUCCEEDED, 2)


def test_three_deaths_fail_the_job_and_the_queue_goes_on(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker
) -> None:
    deadly = add_job()
    killer = open_worker(stand_ins.be_killed)
    for _ in range(3):
        run_next(killer)
    next_job = add_job()

    run_next(open_worker(stand_ins.write_report))

    assert store.get(deadly.id).problem_code == "E-CRASHED"
    assert store.get(next_job.id).state is JobState.SUCCEEDED


def test_five_ends_of_the_worker_set_the_job_aside_without_blame_and_the_queue_goes_on(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker
) -> None:
    job, living = add_job(), open_worker(stand_ins.write_report)
    for times in range(1, 6):
        die_while_running(store)
        return_expired(living)
        held = store.get(job.id)
        state = JobState.QUEUED if times < 5 else JobState.FAILED
        assert (held.state, held.attempts, held.interruptions) == (state, 0, times)
    next_job = add_job()

    run_next(living)

    assert (held.problem_code, held.problem_facts) == ("E-INTERRUPTED", {"times": 5})
    assert store.get(next_job.id).state is JobState.SUCCEEDED
    again = store.retry(job.id)
    assert (again.state, again.attempts, again.interruptions) == (JobState.QUEUED, 0, 0)


def test_ends_of_the_worker_do_not_bring_a_job_nearer_to_its_last_death(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker
) -> None:
    job, killer = add_job(), open_worker(stand_ins.be_killed)
    for _ in range(2):
        run_next(killer)
        die_while_running(store)
        return_expired(killer)

    run_next(open_worker(stand_ins.write_report))

    done = store.get(job.id)
    assert (done.state, done.attempts, done.interruptions) == (JobState.SUCCEEDED, 3, 2)


def test_a_computer_that_starts_no_child_is_an_interruption(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start_none(child: object) -> None:
        raise NotStarted

    job = add_job()
    monkeypatch.setattr(attempt, "start_child", start_none)
    monkeypatch.setattr(worker, "TROUBLE_S", 0)

    run_next(open_worker(stand_ins.write_report))

    back = store.get(job.id)
    assert (back.state, back.attempts, back.interruptions) == (JobState.QUEUED, 0, 1)


def test_an_analysis_outlasts_the_death_of_the_fork_server(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker
) -> None:
    job = add_job()
    thread = threading.Thread(target=run_next, args=(open_worker(stand_ins.write_in_a_second),))
    thread.start()
    wait_for_stage(store, job.id)

    end_fork_server()
    thread.join()

    done = store.get(job.id)
    assert (done.state, done.attempts, done.interruptions) == (JobState.SUCCEEDED, 1, 0)


@pytest.mark.skipif(sys.platform != "linux", reason="stops a process")
def test_a_fork_server_that_does_not_answer_is_replaced(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def end_and_wait_longer() -> None:
        monkeypatch.setattr(forking, "START_TICKS", 180)
        end_fork_server()

    job = add_job()
    warm_up_and_wait()
    hanging = find_fork_server()
    os.kill(hanging, signal.SIGSTOP)
    monkeypatch.setattr(forking, "START_TICKS", 1)
    monkeypatch.setattr(forking, "end_fork_server", end_and_wait_longer)  # another may take long to load

    run_next(open_worker(stand_ins.write_report))

    done = store.get(job.id)
    assert (done.state, done.attempts, done.interruptions) == (JobState.SUCCEEDED, 1, 0)
    assert find_fork_server() != hanging


@pytest.mark.skipif(sys.platform != "linux", reason="stops a process")
def test_a_fork_server_that_reports_no_end_holds_no_worker(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = add_job()
    monkeypatch.setattr(forking, "TICK_S", 0.1)
    monkeypatch.setattr(forking, "START_TICKS", 1800)
    monkeypatch.setattr(forking, "END_TICKS", 2)
    thread = threading.Thread(target=run_next, args=(open_worker(stand_ins.write_in_a_second),))
    thread.start()
    wait_for_stage(store, job.id)

    os.kill(find_fork_server(), signal.SIGSTOP)
    thread.join()

    assert store.get(job.id).state is JobState.SUCCEEDED


def test_a_cancelled_job_stops_within_two_seconds(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker
) -> None:
    job = add_job()
    worker = threading.Thread(target=run_next, args=(open_worker(stand_ins.write_slowly),))
    worker.start()
    wait_for_stage(store, job.id)

    store.cancel(job.id)
    worker.join(2)

    assert not worker.is_alive()
    assert store.get(job.id).state is JobState.CANCELLED


@on_both_set_ups
@pytest.mark.parametrize("way", ["trashed", "purged", "being purged"])
def test_nothing_is_left_of_an_attempt_whose_recording_is_deleted_while_its_files_are_kept(
    store: JobStore,
    storage: Storage,
    add_job: AddJob,
    open_worker: OpenWorker,
    monkeypatch: pytest.MonkeyPatch,
    way: str,
) -> None:
    job, rows = add_job(), RecordingStore(store.engine, store.reader)
    keep = type(storage).keep_attempt

    def keep_late(self: Storage, analysis_id: str, token: str) -> None:
        if way == "trashed":
            rows.trash(job.recording_id)
        else:
            rows.begin_purge(job.recording_id)
        if way == "purged":
            rows.end_purge(job.recording_id)
        keep(self, analysis_id, token)

    monkeypatch.setattr(type(storage), "keep_attempt", keep_late)

    assert run_next(open_worker(stand_ins.write_report))

    assert [name for name in storage.find_names() if name.startswith("analyses/")] == []


def test_a_stopped_worker_puts_its_job_back(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker
) -> None:
    job, slow = add_job(), open_worker(stand_ins.write_slowly)
    worker = threading.Thread(target=run_next, args=(slow,))
    worker.start()
    wait_for_stage(store, job.id)

    slow.stopping.set()
    worker.join(2)

    assert (store.get(job.id).state, store.get(job.id).attempts) == (JobState.QUEUED, 0)


def test_a_damaged_recording_gives_no_report(
    store: JobStore, storage: Storage, add_job: AddJob, open_worker: OpenWorker
) -> None:
    job = add_job()
    storage.drop_recording(job.recording_id)

    run_next(open_worker(stand_ins.write_report))

    assert store.get(job.id).problem_code == "E-STORE-DAMAGED"


def test_a_comparison_whose_reference_is_gone_ends_and_the_worker_goes_on(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker
) -> None:
    plain = add_job()
    asked = replace(plain.request, reference=Reference("rec_gone", "reference.csv"))
    job = store.add_analysis((plain.recording_id, plain.sha256), asked)
    at_work = open_worker(stand_ins.write_report)

    assert run_next(at_work)
    assert run_next(at_work)

    assert store.get(job.id).problem_code == "E-STORE-DAMAGED"


def wait_for_stage(store: JobStore, job_id: str) -> None:
    end_s = time.monotonic() + 20
    while store.get(job_id).stage is None and time.monotonic() < end_s:
        time.sleep(0.05)


@pytest.mark.parametrize("way", ["fetch", "keep_attempt"])
def test_a_holder_renews_its_lease_while_the_store_is_slow(
    store: JobStore, storage: Storage, add_job: AddJob, open_worker: OpenWorker, way: str
) -> None:
    job = add_job()
    road = SlowRoad(storage, store, way)

    run_next(replace(open_worker(stand_ins.write_report), storage=cast("Storage", road)))

    assert len(road.leases) == 3
    assert store.get(job.id).state is JobState.SUCCEEDED


def test_a_worker_whose_store_never_answers_ends_itself(
    store: JobStore, add_job: AddJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = threading.Event()

    def end(code: int) -> None:
        ended.set()
        raise SystemExit(code)

    add_job()
    claimed = store.claim()
    assert claimed is not None
    monkeypatch.setattr(os, "_exit", end)

    with pytest.raises(SystemExit):
        Lease(store, claimed.id, str(claimed.token)).keep_during(lambda: ended.wait(60), limit_s=0.0)


def test_the_time_of_an_analysis_grows_with_the_size_of_the_file(settings: Settings) -> None:
    assert choose_limits(settings, 60_000).wall_s == pytest.approx(300.18)
    assert choose_limits(settings, 2_000_000_000).wall_s == 6300.0


def test_a_job_that_finds_the_disk_full_goes_back_until_it_does_too_often(
    store: JobStore, settings: Settings, add_job: AddJob, open_worker: OpenWorker
) -> None:
    job, other = add_job(), add_job(b"another")
    full = open_worker(stand_ins.find_no_room, max_put_backs=1)

    run_next(full)
    held = store.get(job.id)
    assert (held.state, held.attempts, held.put_backs) == (JobState.QUEUED, 0, 1)
    assert (held.problem_code, held.problem_facts) == ("E-DISK", {"tries": 1})
    assert not list((settings.data_dir / "analyses").glob("*/*"))
    run_next(full)
    failed = store.get(job.id)
    assert (failed.state, failed.problem_code) == (JobState.FAILED, "E-DISK")
    assert failed.problem_facts == {"tries": 2}

    run_next(full)
    run_next(open_worker(stand_ins.write_report))  # there is room again
    done = store.get(other.id)
    assert (done.state, done.problem_code) == (JobState.SUCCEEDED, None)


@pytest.mark.skipif(sys.platform != "linux", reason="stops a process")
def test_a_worker_that_a_signal_has_stopped_is_replaced(
    settings: Settings, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(pool, "CHECK_S", 0.1)
    monkeypatch.setattr(pool, "LONGEST_STOPPED_S", 0.3)
    workers = pool.WorkerPool(settings.model_copy(update={"workers": 1}))
    workers.start()
    (stopped,) = workers._workers
    os.kill(stopped.pid, signal.SIGSTOP)
    try:
        end_s = time.monotonic() + 10.0
        while workers._workers == [stopped] and time.monotonic() < end_s:
            time.sleep(0.1)
        (living,) = workers._workers
        assert (stopped.returncode, living.poll()) == (-signal.SIGKILL, None)
    finally:
        workers.stop()
    assert f"worker {stopped.pid} is stopped; killing it" in caplog.text
