"""kill -9: an acknowledged recording is never lost, and its report is made."""

import hashlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from acromion.app.library.jobs import JobStore
from acromion.app.library.rows import Job, JobState
from acromion.app.queue.worker import open_worker_context, run_next
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.folder import open_storage
from tests import ROOT
from tests.app.stand_ins import write_report
from tests.ways_in.conftest import StartServer
from tests.ways_in.servers import is_alive, wait_for

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks up processes in /proc")


@dataclass
class Slow:
    """A worker process in the middle of a long analysis."""

    settings: Settings
    store: JobStore
    job_id: str
    process: subprocess.Popen[bytes]

    @property
    def job(self) -> Job:
        return self.store.get(self.job_id)

    @property
    def child(self) -> int:
        return int((self.settings.data_dir / "child.pid").read_text())

    def finish(self) -> tuple[JobState, int, int]:
        """Have another worker do what it left; return what became of it."""
        worker = open_worker_context(self.settings, write_report)
        wait_for(lambda: run_next(worker))
        worker.store.close()
        return self.job.state, self.job.attempts, self.job.interruptions


@pytest.fixture
def slow(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Slow]:
    settings = Settings(data_dir=tmp_path, lease_s=getattr(request, "param", Settings().lease_s))
    storage, store = open_storage(settings), JobStore(settings)
    storage.prepare()
    upload = storage.open_upload(100)
    upload.write(b"recording")
    job_id = store.add(upload.keep(), ReportRequest("shift.gt3x")).id
    command = [sys.executable, "-m", "tests.ways_in.slow_worker", str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT) as process:
        wait_for(lambda: store.get(job_id).stage == "fusing")
        yield Slow(settings, store, job_id, process)
        process.kill()
    store.close()


def test_the_job_of_a_killed_worker_is_finished_by_another_and_its_child_ends(slow: Slow) -> None:
    child = slow.child

    slow.process.kill()
    slow.process.wait()

    assert slow.finish() == (JobState.SUCCEEDED, 1, 1)
    wait_for(lambda: not is_alive(child), patience_s=5)


@pytest.mark.parametrize("ends_child", [False, True])
def test_a_worker_asked_to_stop_puts_its_job_back_and_ends_well_even_if_its_child_is_stopped_too(
    slow: Slow, ends_child: bool
) -> None:
    if ends_child:
        slow.process.send_signal(signal.SIGSTOP)  # so that it finds both when it runs again
        os.kill(slow.child, signal.SIGTERM)
    slow.process.terminate()
    slow.process.send_signal(signal.SIGCONT)

    assert slow.process.wait(60) == 0
    assert (slow.job.state, slow.job.attempts, slow.job.interruptions) == (JobState.QUEUED, 0, 0)


def test_a_kill_of_everything_that_begins_with_the_child_is_no_death_of_the_file(slow: Slow) -> None:
    slow.process.send_signal(signal.SIGSTOP)
    os.kill(slow.child, signal.SIGKILL)
    slow.process.kill()
    slow.process.wait()

    assert slow.finish() == (JobState.SUCCEEDED, 1, 1)


@pytest.mark.parametrize("slow", [0.5], indirect=True, ids=["lease of 0.5 s"])
def test_a_computer_that_slept_in_the_middle_of_a_job_loses_none(slow: Slow) -> None:
    slow.process.send_signal(signal.SIGSTOP)
    time.sleep(2.0)
    slow.store.return_expired()  # an idle worker that wakes first
    slow.process.send_signal(signal.SIGCONT)
    time.sleep(1.5)
    slow.store.return_expired()

    assert (slow.job.state, slow.job.interruptions) == (JobState.RUNNING, 0)
    slow.process.terminate()
    slow.process.wait(10)


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


def test_a_server_killed_after_202_loses_nothing_and_finishes_and_sweeps_after_restart(
    start_server: StartServer, recording: Path, tmp_path: Path
) -> None:
    server = start_server()
    jobs = [server.send(recording, subject=f"S{number}") for number in range(3)]
    server.kill()
    half = tmp_path / "data" / "uploads" / "rec_0123456789abcdef.part"
    half.write_bytes(b"half")
    os.utime(half, (0, 0))

    server = start_server()

    assert [server.see(job["id"], wait=60)["state"] for job in jobs] == ["succeeded"] * 3
    sent = hashlib.sha256(recording.read_bytes()).hexdigest()
    storage = open_storage(Settings(data_dir=tmp_path / "data"))
    assert [storage.hash(f"recordings/{job['recording_id']}")[0] for job in jobs] == [sent] * 3
    wait_for(lambda: not half.exists())

    workers = wait_for(server.find_workers)
    assert server.stop() == 0
    assert [pid for pid in workers if is_alive(pid)] == []
