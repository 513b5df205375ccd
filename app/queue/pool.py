"""The pool of worker processes that the server keeps running."""

import logging
import os
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

from acromion.app.settings import Settings
from acromion.app.version import find_import_folder

CHECK_S = 0.5
STOP_S = 10.0
SLOWEST_RESTART_S = 30.0
LONGEST_STOPPED_S = 30.0
"""A worker stopped by a signal (SIGSTOP) for this long is killed and replaced."""
_NOT_THEIRS = "ACROMION_OIDC_"
"""Sign-in settings: a process that reads strangers' files does not receive them."""

logger = logging.getLogger(__name__)


class WorkerPool:
    """Starts the workers, replaces dead ones, and stops them all at the end."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._workers: list[subprocess.Popen[bytes]] = []
        self._stopping = threading.Event()
        self._supervisor = threading.Thread(target=self._supervise, name="worker-supervisor", daemon=True)

    def start(self) -> None:
        """Start the workers and the thread that supervises them."""
        self._workers = [self._start_one() for _ in range(self._settings.workers)]
        self._supervisor.start()

    def stop(self) -> None:
        """Ask every worker to put back its job and stop; kill the others."""
        self._stopping.set()
        self._supervisor.join()
        for worker in self._workers:
            worker.terminate()
        for worker in self._workers:
            with suppress(subprocess.TimeoutExpired):
                worker.wait(STOP_S)
            worker.kill()
            with suppress(
                subprocess.TimeoutExpired
            ):  # a process that waits for a disk that no longer responds
                worker.wait(STOP_S)

    def _supervise(self) -> None:
        pause_s = CHECK_S
        stopped_s: dict[int, float] = {}
        while not self._stopping.wait(pause_s):
            stopped = {worker.pid for worker in self._workers if _is_stopped(worker.pid)}
            stopped_s = {pid: stopped_s.get(pid, 0.0) + pause_s for pid in stopped}
            for worker in self._workers:
                if stopped_s.get(worker.pid, 0.0) >= LONGEST_STOPPED_S:
                    logger.warning("worker %d is stopped; killing it", worker.pid)
                    worker.kill()
            lost = [place for place, worker in enumerate(self._workers) if worker.poll() is not None]
            for place in lost:
                worker = self._workers[place]
                logger.warning("worker %d ended with %s", worker.pid, worker.returncode)
                self._workers[place] = self._start_one()
            pause_s = min(2 * pause_s, SLOWEST_RESTART_S) if lost else CHECK_S

    def _start_one(self) -> subprocess.Popen[bytes]:
        """Start a worker that runs this very code, from any working folder."""
        command = [sys.executable, "-P", "-m", "acromion.app.queue.worker"]
        arguments = ["--data", str(self._settings.data_dir), "--parent", str(os.getpid())]
        path = os.pathsep.join(filter(None, [find_import_folder(), os.environ.get("PYTHONPATH")]))
        passed = {name: value for name, value in os.environ.items() if not name.startswith(_NOT_THEIRS)}
        environment = passed | self._settings.as_environment() | {"PYTHONPATH": path}
        return subprocess.Popen([*command, *arguments], env=environment, start_new_session=True)  # noqa: S603 - our own program


def _is_stopped(pid: int) -> bool:
    """Return whether a signal has stopped a process; False if the system does not tell (only Linux does)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].startswith("T")
    except OSError:
        return False
