"""Measure the capacity of one server: ``python -m benchmarks.load [--megabytes 300] [--uploads 16]``.

Starts the real server with two workers on a free port of this machine, and measures: simultaneous uploads,
none of which may fail; eight at once until the last is acknowledged; the 99th percentile of the API while two
analyses and four uploads run continuously; the memory of the web process. The cache of decoded recordings is
off, so every analysis reads its file. Clients run on the same machine, each upload in a separate process, so
that threads of one client do not wait for each other.
"""

import argparse
import hashlib
import http.client
import multiprocessing
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from functools import partial
from multiprocessing.synchronize import Event
from pathlib import Path
from urllib.parse import urlsplit

import httpx2

from acromion.fusion.simulation import simulate_shift, write_shift
from tests.ways_in.servers import RunningServer

PIECE_BYTES = 1 << 20
PROBES, PROBE_PAUSE_S, SETTLED_S = 200, 0.02, 5.0
SPAWN = multiprocessing.get_context("spawn")


def make_body(size_bytes: int, number: int) -> Iterator[bytes]:
    """Yield that many bytes, different for each upload; rejected right after storing (not a recording)."""
    piece = hashlib.sha256(str(number).encode()).digest() * (PIECE_BYTES // 32)
    for _ in range(size_bytes // PIECE_BYTES):
        yield piece


def upload(address: str, size_bytes: int, number: int) -> int:
    """Upload once; return the status."""
    with closing(http.client.HTTPConnection(urlsplit(address).netloc, timeout=600)) as client:
        headers = {"Content-Length": str(size_bytes // PIECE_BYTES * PIECE_BYTES)}
        client.request("POST", "/api/v1/analyze", make_body(size_bytes, number), headers)
        return client.getresponse().status


def upload_at_once(address: str, size_bytes: int, numbers: range) -> tuple[float, int]:
    """Upload several at once; return the seconds until the last is acknowledged, and how many failed."""
    with ProcessPoolExecutor(len(numbers), SPAWN) as pool:
        list(
            pool.map(time.sleep, [PROBE_PAUSE_S] * len(numbers))
        )  # every client is ready before the clock starts
        started_s = time.monotonic()
        statuses = list(pool.map(partial(upload, address, size_bytes), numbers))
        return time.monotonic() - started_s, sum(status != 202 for status in statuses)


def wait_for_quiet(address: str) -> None:
    """Wait until no analysis is queued or running, and all data is on the disk."""
    with httpx2.Client(base_url=address, timeout=60) as client:
        while any(
            client.get("/api/v1/analyses", params={"state": state}).json()["items"]
            for state in ("queued", "running")
        ):
            time.sleep(SETTLED_S / 5)
    os.sync()


def probe(address: str) -> float:
    """Request the list of analyses many times; return the 99th percentile in milliseconds."""
    times_s = []
    with httpx2.Client(base_url=address, timeout=60) as client:
        for _ in range(PROBES):
            started_s = time.monotonic()
            client.get("/api/v1/analyses", params={"limit": 20}).raise_for_status()
            times_s.append(time.monotonic() - started_s)
            time.sleep(PROBE_PAUSE_S)
    return 1000 * statistics.quantiles(times_s, n=100)[98]


def probe_under_load(address: str, shift: Path, size_bytes: int) -> float:
    """Do the same while two analyses and four uploads run."""
    stopping = SPAWN.Event()
    loads: list[Callable[[], object]] = [partial(upload, address, size_bytes, 0)] * 4
    loads += [partial(analyse_once, address, shift, side) for side in ("left", "right")]
    clients = [SPAWN.Process(target=_repeat, args=(stopping, load)) for load in loads]
    for client in clients:
        client.start()
    time.sleep(SETTLED_S)
    result_ms = probe(address)
    stopping.set()
    for client in clients:
        client.join()
    if any(client.exitcode for client in clients):
        raise SystemExit("a client failed under load")
    return result_ms


def analyse_once(address: str, shift: Path, side: str) -> None:
    """Analyse a shift again, and wait for the end."""
    params = {"side": side, "again": "true", "file_name": shift.name}
    with httpx2.Client(base_url=address, timeout=600) as client:
        analysis = client.post("/api/v1/analyze", params=params, content=shift.read_bytes()).json()
        while (state := analysis["state"]) in ("queued", "running"):
            analysis = client.get(analysis["links"]["self"], params={"wait": 10}).json()
    if state != "succeeded":
        raise SystemExit(f"{analysis['id']}: {state}")


def _repeat(stopping: Event, load: Callable[[], object]) -> None:
    while not stopping.is_set():
        load()


def read_peak_mb(pid: int) -> float:
    """Return the peak resident memory of a process."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) * 1024 / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description="Load one server.")
    parser.add_argument("--megabytes", type=int, default=300)
    parser.add_argument("--uploads", type=int, default=16)
    parser.add_argument("--hours", type=float, default=8.0, help="length of the analysed shifts")
    wished = parser.parse_args()
    size_bytes = wished.megabytes * 1_000_000
    with tempfile.TemporaryDirectory() as folder:
        shift = write_shift(Path(folder), simulate_shift("gt9x", wished.hours, seed=1), actilife_csv=False)[0]
        settings = {"ACROMION_MAX_CACHE_BYTES": "0"}
        server = RunningServer(Path(folder) / "data", Path(folder) / "log", workers=2, **settings)
        try:
            _report(server, shift, size_bytes, wished.uploads)
        finally:
            server.stop()


def _report(server: RunningServer, shift: Path, size_bytes: int, uploads: int) -> None:
    idle_ms = probe(server.address)
    all_s, failed = upload_at_once(server.address, size_bytes, range(uploads))
    wait_for_quiet(server.address)
    eight_s, failed_of_eight = upload_at_once(server.address, size_bytes, range(uploads, uploads + 8))
    wait_for_quiet(server.address)
    loaded_ms = probe_under_load(server.address, shift, size_bytes)
    megabytes = size_bytes // 1_000_000
    print(f"| {uploads} x {megabytes} MB at once, failed | {failed} | 0 |")
    print(f"| {uploads} x {megabytes} MB at once, s | {all_s:.1f} | |")
    print(f"| 8 x {megabytes} MB acknowledged, s ({failed_of_eight} failed) | {eight_s:.1f} | 6 |")
    print(f"| API p99 idle, ms | {idle_ms:.0f} | |")
    print(f"| API p99 with 2 analyses and 4 uploads, ms | {loaded_ms:.0f} | 75 |")
    print(f"| web process, peak MB | {read_peak_mb(server.process.pid):.0f} | 120 |")


if __name__ == "__main__":
    main()
