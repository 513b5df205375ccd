"""What sealing costs: this revision against an earlier one in its own folder, in turn.

    python -m benchmarks.sealing --before ../main --rounds 5

Both serve as ``acromion serve`` does, each with a data folder of its own on the same disk. 300 MB are sent by
a raw POST and by tus (one PATCH), and a simulated shift of 8 hours is analysed. Each round does one of each
for both, the order turned round every time; medians are compared, of the time and of what all processes
computed meanwhile, which a busy machine disturbs less.
"""

import argparse
import contextlib
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import httpx2
import psutil

from fusion.simulation import simulate_shift, write_shift

UPLOAD_BYTES = 300_000_000
PATIENCE_S = 900.0


@dataclass
class Server:
    """The server of one revision."""

    name: str
    source: Path
    data: Path
    seconds: dict[str, list[float]] = field(default_factory=dict)

    def start(self) -> None:
        """Start, and wait until it listens."""
        log = self.data.with_suffix(".log")
        command = [sys.executable, "-m", "app", "serve", "--port", "0", "-j", "1", "--data", str(self.data)]
        with log.open("wb") as file:
            environment = os.environ | {"ACROMION_MIN_FREE_BYTES": "0"}
            self.process = subprocess.Popen(
                command, cwd=self.source, env=environment, stdout=file, stderr=file
            )
        while not (found := re.search(r"Acromion is at (\S+)", log.read_text())):
            assert self.process.poll() is None, log.read_text()
            time.sleep(0.05)
        self.client = httpx2.Client(base_url=found[1], timeout=PATIENCE_S)

    def stop(self) -> None:
        """End it."""
        self.client.close()
        self.process.terminate()
        self.process.wait()

    def post(self, content: bytes) -> None:
        """Send a recording in one request."""
        answer = self._time("POST 300 MB", lambda: self.client.post("/api/v1/recordings", content=content))
        self._drop(answer.json()["id"])

    def patch(self, content: bytes) -> None:
        """Send a recording by tus, in one piece."""
        head = {"tus-resumable": "1.0.0", "upload-length": str(len(content))}
        address = self.client.post("/api/v1/uploads", headers=head).headers["location"]
        more = {
            "tus-resumable": "1.0.0",
            "upload-offset": "0",
            "content-type": "application/offset+octet-stream",
        }
        answer = self._time("tus 300 MB", lambda: self.client.patch(address, content=content, headers=more))
        self._drop(answer.headers["acromion-recording"])

    def analyse(self, shift: bytes) -> None:
        """Have a shift analysed, from the request to the report."""
        kept = self.client.post(
            "/api/v1/recordings", content=shift, params={"file_name": "shift.gt3x"}
        ).json()
        begun_s, spent_s = time.perf_counter(), self._measure_cpu_s()
        asked = self.client.post("/api/v1/analyses", json={"recording_ids": [kept["id"]]}).json()["items"][0]
        while (view := self.client.get(f"/api/v1/analyses/{asked['id']}").json())["state"] in (
            "queued",
            "running",
        ):
            time.sleep(0.02)
        assert view["state"] == "succeeded", view
        self.seconds.setdefault("8 h analysis", []).append(time.perf_counter() - begun_s)
        self.seconds.setdefault("8 h analysis, CPU", []).append(self._measure_cpu_s() - spent_s)
        self._drop(kept["id"])

    def _time(self, what: str, act) -> httpx2.Response:  # type: ignore[no-untyped-def]
        begun_s, spent_s = time.perf_counter(), self._measure_cpu_s()
        answer: httpx2.Response = act()
        assert answer.status_code in (201, 204), answer.text
        self.seconds.setdefault(what, []).append(time.perf_counter() - begun_s)
        self.seconds.setdefault(f"{what}, CPU", []).append(self._measure_cpu_s() - spent_s)
        return answer

    def _measure_cpu_s(self) -> float:
        """Add up what the server, its workers and their children that have ended have used."""
        server = psutil.Process(self.process.pid)
        found = 0.0
        for process in (server, *server.children(recursive=True)):
            with contextlib.suppress(psutil.NoSuchProcess):
                found += sum(process.cpu_times()[:4])
        return found

    def _drop(self, recording_id: str) -> None:
        self.client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": True})


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure what sealing costs.")
    parser.add_argument("--before", type=Path, required=True, help="folder of the earlier revision")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--hours", type=float, default=8.0)
    asked = parser.parse_args()
    content = os.urandom(UPLOAD_BYTES)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        made = write_shift(folder / "shift", simulate_shift("gt9x", asked.hours, 1), actilife_csv=False)
        shift = made[0].read_bytes()
        here = Path(__file__).resolve().parents[1]
        servers = [
            Server("before", asked.before.resolve(), folder / "before"),
            Server("sealed", here, folder / "sealed"),
        ]
        for server in servers:
            server.start()
        try:
            for number in range(-1, asked.rounds):  # the first is not counted
                for server in servers if number % 2 else servers[::-1]:
                    server.post(content)
                    server.patch(content)
                    server.analyse(shift)
                    if number < 0:
                        server.seconds.clear()
        finally:
            for server in servers:
                server.stop()
    before, sealed = servers
    for what, seconds in before.seconds.items():
        old_s, new_s = statistics.median(seconds), statistics.median(sealed.seconds[what])
        times = f"before {old_s:.2f} s, sealed {new_s:.2f} s"
        print(f"{what}: {times}, {new_s / old_s:.2f} times ({asked.rounds} rounds)")
        print("   ", [round(one, 2) for one in seconds], [round(one, 2) for one in sealed.seconds[what]])


if __name__ == "__main__":
    main()
