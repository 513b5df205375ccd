"""kill -9: an acknowledged recording is never lost, and its report is made."""

import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from app.jobs.job import JobState
from app.jobs.store import JobStore
from app.jobs.worker import open_bench, run_next
from app.request import ReportRequest
from app.settings import Settings
from app.storage.open import open_storage
from tests import ROOT
from tests.app.stand_ins import write_report
from tests.ways_in.conftest import StartServer
from tests.ways_in.servers import is_alive, wait_for

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks up processes in /proc")


def queue_job(settings: Settings) -> tuple[JobStore, str]:
    storage, store = open_storage(settings), JobStore(settings)
    storage.prepare()
    upload = storage.open_upload(100)
    upload.write(b"recording")
    return store, store.add(upload.keep(), ReportRequest("shift.gt3x")).id


def start_slow_worker(settings: Settings) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "tests.ways_in.slow_worker", str(settings.data_dir)]
    return subprocess.Popen(command, cwd=ROOT)


def test_the_job_of_a_killed_worker_is_finished_by_another_and_its_child_ends(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    store, job_id = queue_job(settings)
    slow = start_slow_worker(settings)
    wait_for(lambda: store.get(job_id).stage == "fusing")
    child = int((tmp_path / "child.pid").read_text())

    slow.kill()
    slow.wait()
    bench = open_bench(settings, write_report)
    wait_for(lambda: run_next(bench))

    finished = store.get(job_id)
    assert (finished.state, finished.attempts, finished.interruptions) == (JobState.SUCCEEDED, 1, 1)
    wait_for(lambda: not is_alive(child), patience_s=5)
    bench.store.close()
    store.close()


def test_a_worker_asked_to_stop_puts_its_job_back_and_ends_well(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    store, job_id = queue_job(settings)
    slow = start_slow_worker(settings)
    wait_for(lambda: store.get(job_id).stage == "fusing")

    slow.terminate()

    assert slow.wait(10) == 0
    assert (store.get(job_id).state, store.get(job_id).attempts) == (JobState.QUEUED, 0)
    assert store.get(job_id).interruptions == 0
    store.close()


def test_a_stop_of_child_and_worker_at_once_counts_as_nothing(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    store, job_id = queue_job(settings)
    slow = start_slow_worker(settings)
    wait_for(lambda: store.get(job_id).stage == "fusing")

    slow.send_signal(signal.SIGSTOP)  # so that it finds both when it runs again
    os.kill(int((tmp_path / "child.pid").read_text()), signal.SIGTERM)
    slow.terminate()
    slow.send_signal(signal.SIGCONT)

    assert slow.wait(60) == 0
    back = store.get(job_id)
    assert (back.state, back.attempts, back.interruptions) == (JobState.QUEUED, 0, 0)
    store.close()


def test_a_kill_of_everything_that_begins_with_the_child_is_no_death_of_the_file(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    store, job_id = queue_job(settings)
    slow = start_slow_worker(settings)
    wait_for(lambda: store.get(job_id).stage == "fusing")

    slow.send_signal(signal.SIGSTOP)
    os.kill(int((tmp_path / "child.pid").read_text()), signal.SIGKILL)
    slow.kill()
    slow.wait()
    bench = open_bench(settings, write_report)
    wait_for(lambda: run_next(bench))

    done = store.get(job_id)
    assert (done.state, done.attempts, done.interruptions) == (JobState.SUCCEEDED, 1, 1)
    bench.store.close()
    store.close()


def test_a_worker_killed_in_the_middle_is_replaced_and_the_report_is_made(
    start_server: StartServer, recording: Path
) -> None:
    server = start_server()
    job = server.send(recording)
    wait_for(lambda: server.see(job["id"])["state"] == "running")
    (worker,) = server.find_workers()

    os.kill(worker, signal.SIGKILL)

    wait_for(lambda: server.see(job["id"])["state"] == "succeeded")
    ended = server.see(job["id"])
    assert (ended["attempts"], ended["interruptions"]) == (1, 1)


def test_a_computer_that_slept_in_the_middle_of_a_job_loses_none(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, lease_s=0.5)
    store, job_id = queue_job(settings)
    slow = start_slow_worker(settings)
    wait_for(lambda: store.get(job_id).stage == "fusing")

    slow.send_signal(signal.SIGSTOP)
    time.sleep(2.0)
    store.return_expired()  # an idle worker that wakes first
    slow.send_signal(signal.SIGCONT)
    time.sleep(1.5)
    store.return_expired()

    assert (store.get(job_id).state, store.get(job_id).interruptions) == (JobState.RUNNING, 0)
    slow.terminate()
    slow.wait(10)
    store.close()


def test_a_server_killed_after_202_loses_nothing_and_finishes_after_restart(
    start_server: StartServer, recording: Path, tmp_path: Path
) -> None:
    server = start_server()
    jobs = [server.send(recording, subject=f"S{number}") for number in range(3)]

    server.kill()
    server = start_server()

    assert [server.see(job["id"], wait=60)["state"] for job in jobs] == ["succeeded"] * 3
    sent = hashlib.sha256(recording.read_bytes()).hexdigest()
    storage = open_storage(Settings(data_dir=tmp_path / "data"))
    assert [storage.hash(f"recordings/{job['recording_id']}")[0] for job in jobs] == [sent] * 3


def test_what_a_killed_server_left_half_done_is_swept_at_the_next_start(
    start_server: StartServer, tmp_path: Path
) -> None:
    start_server().kill()
    half = tmp_path / "data" / "uploads" / "rec_0123456789abcdef.part"
    half.write_bytes(b"half")
    os.utime(half, (0, 0))

    start_server()

    wait_for(lambda: not half.exists())


def test_a_server_asked_to_stop_ends_with_its_workers(start_server: StartServer) -> None:
    server = start_server()
    workers = wait_for(server.find_workers)

    assert server.stop() == 0
    assert [pid for pid in workers if is_alive(pid)] == []
