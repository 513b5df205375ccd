"""Compare the throughput of two workers with one: ``python -m benchmarks.machines [--jobs 8] [--hours 1]``.

A real PostgreSQL wakes the workers (Procrastinate). Each is pinned to a separate core, as on a machine with
one core. The cache of decoded recordings is off, so each analysis reads its file. Prints the throughput of
one and of two, and their ratio (goal: 1.8).
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from acromion.app.library.jobs import JobStore
from acromion.app.queue.cluster import install
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.folder import open_storage
from acromion.fusion.simulation import simulate_shift, write_shift
from tests.postgres import PostgresServer

PATIENCE_S, READY_S = 1800.0, 15.0


def queue(settings: Settings, shift: Path, number: int) -> list[str]:
    """Store and queue the same shift several times."""
    storage, store = open_storage(settings), JobStore(settings)
    storage.prepare()
    install(settings.database_url)
    jobs = []
    for _ in range(number):
        upload = storage.open_upload(1 << 32)
        upload.write(shift.read_bytes())
        jobs.append(store.add(upload.keep(), ReportRequest(shift.name)).id)
    store.close()
    return jobs


def start_worker(settings: Settings, core: int) -> subprocess.Popen[bytes]:
    """Start a worker on one core, with one thread for the mathematics."""
    command = [sys.executable, "-m", "acromion.app.queue.worker", "--data", str(settings.data_dir)]
    environment = os.environ | settings.as_environment() | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    worker = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
    os.sched_setaffinity(worker.pid, {core})
    return worker


def wait_for_all(store: JobStore, names: list[str]) -> None:
    """Wait until every analysis is over."""
    end_s = time.monotonic() + PATIENCE_S
    while not all(store.get(name).is_over for name in names) and time.monotonic() < end_s:
        time.sleep(0.2)


def measure(settings: Settings, shift: Path, cores: list[int], jobs: int) -> float:
    """Return the analyses per second, from the first start to the last end."""
    store = JobStore(settings)
    workers = [start_worker(settings, core) for core in cores]
    try:
        time.sleep(READY_S)
        wait_for_all(store, queue(settings, shift, len(cores)))  # loads the analysis code, compiles
        names = queue(settings, shift, jobs)
        wait_for_all(store, names)
        done = [store.get(name) for name in names]
    finally:
        store.close()
        for worker in workers:
            worker.terminate()
            worker.wait()
    begun = min(job.started_at for job in done if job.started_at)
    ended = max(job.ended_at for job in done if job.ended_at)
    return jobs / (ended - begun).total_seconds()


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare one worker with two.")
    parser.add_argument("--jobs", type=int, default=8)
    parser.add_argument("--hours", type=float, default=8.0)
    wished = parser.parse_args()
    cores = sorted(os.sched_getaffinity(0))[:2]
    server = PostgresServer()
    try:
        with tempfile.TemporaryDirectory() as folder:
            shift = write_shift(
                Path(folder), simulate_shift("gt9x", wished.hours, seed=1), actilife_csv=False
            )[0]
            rates = []
            for used in (cores[:1], cores):
                server.empty()
                data = Path(folder) / f"data{len(used)}"
                settings = Settings(
                    data_dir=data, database_url=server.url, engine="procrastinate", max_cache_bytes=0
                )
                rates.append(measure(settings, shift, used, wished.jobs))
    finally:
        server.remove()
    print(f"one worker {rates[0]:.3f}/s, two {rates[1]:.3f}/s, ratio {rates[1] / rates[0]:.2f} (goal 1.8)")


if __name__ == "__main__":
    main()
