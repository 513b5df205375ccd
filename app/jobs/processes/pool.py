"""The pool of worker processes that the server keeps alive."""

import logging
import os
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from app.jobs.processes.lease import SilenceCount, read_heartbeat
from app.settings import Settings

CHECK_S = 0.5
STOP_S = 10.0
SLOWEST_RESTART_S = 30.0
_NOT_THEIRS = "ACROMION_OIDC_"
"""Settings that hold how people log in: a process that reads strangers' files is not told."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Worker:
    """One process, the pipe of its heartbeat (none on Windows), and how long it has been silent."""

    process: subprocess.Popen[bytes]
    heartbeat_fd: int | None
    silence: SilenceCount

    def must_be_replaced(self) -> bool:
        """Tell whether the process has ended, or is silent for too long; to be called once a tick."""
        if self.process.poll() is not None:
            logger.warning("worker %d ended with %s", self.process.pid, self.process.returncode)
            return True
        if self.heartbeat_fd is None or not self.silence.is_too_long(heard=read_heartbeat(self.heartbeat_fd)):
            return False
        logger.error("worker %d does not come back; another takes its place", self.process.pid)
        return True

    def end(self) -> None:
        """Kill the process, and close its pipe."""
        self.process.kill()
        with suppress(subprocess.TimeoutExpired):  # a process that waits for a dead disk
            self.process.wait(STOP_S)
        if self.heartbeat_fd is not None:
            os.close(self.heartbeat_fd)


class WorkerPool:
    """Starts the workers, replaces one that has died or hangs, stops them all at the end."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._workers: list[Worker] = []
        self._stopping = threading.Event()
        self._supervisor = threading.Thread(target=self._supervise, name="worker-supervisor", daemon=True)

    def start(self) -> None:
        """Start the workers and the thread that supervises them."""
        self._workers = [self._start_one() for _ in range(self._settings.workers)]
        self._supervisor.start()

    def stop(self) -> None:
        """Ask every worker to put its job back and end; end those that do not."""
        self._stopping.set()
        self._supervisor.join()
        for worker in self._workers:
            worker.process.terminate()
        for worker in self._workers:
            with suppress(subprocess.TimeoutExpired):
                worker.process.wait(STOP_S)
            worker.end()

    def _supervise(self) -> None:
        pause_s = CHECK_S
        while not self._stopping.wait(pause_s):
            lost = [place for place, worker in enumerate(self._workers) if worker.must_be_replaced()]
            for place in lost:
                self._workers[place].end()
                self._workers[place] = self._start_one()
            pause_s = min(2 * pause_s, SLOWEST_RESTART_S) if lost else CHECK_S

    def _start_one(self) -> Worker:
        """Start a worker that runs this very code, whatever the working folder."""
        command = [sys.executable, "-P", "-m", "app.jobs.worker"]
        arguments = ["--data", str(self._settings.data_dir), "--parent", str(os.getpid())]
        code = str(Path(__file__).resolve().parents[3])
        path = os.pathsep.join(filter(None, [code, os.environ.get("PYTHONPATH")]))
        passed = {name: value for name, value in os.environ.items() if not name.startswith(_NOT_THEIRS)}
        environment = passed | self._settings.as_environment() | {"PYTHONPATH": path}
        silence = SilenceCount(round(self._settings.worker_silence_s / CHECK_S))
        if sys.platform == "win32":
            process = subprocess.Popen([*command, *arguments], env=environment, start_new_session=True)  # noqa: S603 - our own program
            return Worker(process, None, silence)
        ours, theirs = os.pipe()
        os.set_blocking(ours, False)
        try:
            process = subprocess.Popen(  # noqa: S603 - our own program
                [*command, *arguments, "--heartbeat", str(theirs)],
                env=environment,
                start_new_session=True,
                pass_fds=(theirs,),
            )
        finally:
            os.close(theirs)
        return Worker(process, ours, silence)
