"""Worker processes that the server keeps alive."""

import logging
import os
import subprocess
import sys
import threading
from pathlib import Path

from app.settings import Settings

CHECK_S = 0.5
STOP_S = 10.0
SLOWEST_RESTART_S = 30.0

logger = logging.getLogger(__name__)


class WorkerPool:
    """Starts the workers, starts another where one has died, stops them all at the end."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._workers: list[subprocess.Popen[bytes]] = []
        self._stopping = threading.Event()
        self._keeper = threading.Thread(target=self._keep, name="worker-keeper", daemon=True)

    def start(self) -> None:
        """Start the workers and the thread that looks after them."""
        self._workers = [self._start_one() for _ in range(self._settings.workers)]
        self._keeper.start()

    def stop(self) -> None:
        """Ask every worker to put its job back and end; end those that do not."""
        self._stopping.set()
        self._keeper.join()
        for worker in self._workers:
            worker.terminate()
        for worker in self._workers:
            try:
                worker.wait(STOP_S)
            except subprocess.TimeoutExpired:
                worker.kill()
                worker.wait()

    def _keep(self) -> None:
        pause_s = CHECK_S
        while not self._stopping.wait(pause_s):
            dead = [place for place, worker in enumerate(self._workers) if worker.poll() is not None]
            for place in dead:
                logger.warning(
                    "worker %d ended with %s", self._workers[place].pid, self._workers[place].poll()
                )
                self._workers[place] = self._start_one()
            pause_s = min(2 * pause_s, SLOWEST_RESTART_S) if dead else CHECK_S

    def _start_one(self) -> subprocess.Popen[bytes]:
        """Start a worker that finds this very code, whatever folder we were called from."""
        command = [sys.executable, "-P", "-m", "app.jobs.worker"]
        arguments = ["--data", str(self._settings.data_dir), "--parent", str(os.getpid())]
        code = str(Path(__file__).resolve().parents[2])
        path = os.pathsep.join(filter(None, [code, os.environ.get("PYTHONPATH")]))
        environment = os.environ | self._settings.as_environment() | {"PYTHONPATH": path}
        return subprocess.Popen(  # noqa: S603 - our own program
            [*command, *arguments], env=environment, start_new_session=True
        )
