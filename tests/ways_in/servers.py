"""Start the real thing: the server with its workers, as the command line does."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2

from tests import ROOT

PATIENCE_S = 120.0


class RunningServer:
    """``acromion serve`` on a free port, with one worker or more."""

    def __init__(
        self, data: Path, log: Path, workers: int = 1, *, python: str = sys.executable, **settings: str
    ) -> None:
        command = [python, "-m", "acromion", "serve", "--port", "0", "--data", str(data), "-j", str(workers)]
        environment = os.environ | {"ACROMION_MIN_FREE_BYTES": "0"} | settings
        self.data, self._log = data, log
        with log.open("ab") as file:
            file.truncate(0)
            self.process = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=file, stderr=file)
        self.address = wait_for(self._find_address)
        self.client = httpx2.Client(base_url=self.address, timeout=PATIENCE_S)

    def _find_address(self) -> str | None:
        assert self.process.poll() is None, self._log.read_text()
        found = re.search(r"Acromion is at (https?://\S+)", self._log.read_text())
        return found[1] if found else None

    def send(self, recording: Path, **wishes: str) -> dict[str, Any]:
        """Upload a recording; gives the analysis as it was acknowledged."""
        wishes = {"file_name": recording.name} | wishes
        answer = self.client.post("/api/v1/analyze", content=recording.read_bytes(), params=wishes)
        assert answer.status_code == 202, answer.text
        view: dict[str, Any] = answer.json()
        return view

    def see(self, analysis_id: str, wait: float = 0) -> dict[str, Any]:
        """Ask for an analysis."""
        answer = self.client.get(f"/api/v1/analyses/{analysis_id}", params={"wait": wait})
        view: dict[str, Any] = answer.json()
        return view

    def find_workers(self) -> list[int]:
        """Return the process numbers of the workers that live."""
        return [
            pid for pid in list_children(self.process.pid) if "acromion.app.queue.worker" in read_command(pid)
        ]

    def kill(self) -> None:
        """End the server at once, without any chance to tidy up."""
        self.process.kill()
        self.process.wait()
        self.client.close()

    def stop(self) -> int:
        """Ask the server to end; gives its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        self.client.close()
        return self.process.wait(PATIENCE_S)


def list_children(parent: int) -> list[int]:
    """Return the processes whose parent this is."""
    stats = {int(path.parent.name): read_stat(path) for path in Path("/proc").glob("[0-9]*/stat")}
    return [pid for pid, fields in stats.items() if fields[1:2] == [str(parent)]]


def read_stat(path: Path) -> list[str]:
    """Return the fields after the process's name; none when it has just ended."""
    try:
        return path.read_text().rpartition(")")[2].split()
    except OSError:
        return []


def read_command(pid: int) -> str:
    """Return the command line of a process."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def is_alive(pid: int) -> bool:
    """Return whether a process runs (a zombie does not)."""
    return read_stat(Path(f"/proc/{pid}/stat"))[:1] not in ([], ["Z"])


def wait_for(find: Callable[[], Any], patience_s: float = PATIENCE_S) -> Any:
    """Ask again and again until there is an answer."""
    end_s = time.monotonic() + patience_s
    while time.monotonic() < end_s:
        if found := find():
            return found
        time.sleep(0.02)
    raise TimeoutError
