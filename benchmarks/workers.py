"""What 200 workers ask of one PostgreSQL: ``python -m benchmarks.workers [--workers 200] [--seconds 30]``.

Each simulated worker holds an analysis, beats every 3 s, claims the next every 10 s and looks after the dead
every 5 s, by the code of the real ones; nothing is analysed. Twice: all look after all, as until 2026-11,
and one does so for all. Prints queries and rows a second, and the processor time of the database.
"""

import argparse
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import psutil
from procrastinate.sql import queries
from sqlalchemy import event, text

from app.jobs.job import Claimer
from app.jobs.processes.cluster import QUEUE, REVIVE_S, install, revive_if_leading
from app.jobs.processes.leader import REVIVAL, Leader
from app.jobs.processes.lease import LeaseWatch
from app.jobs.worker import Bench, open_bench, reclaim_abandoned
from app.request import ReportRequest
from app.settings import Settings
from tests.postgres import PostgresServer

CLAIM_S, START_S = 10.0, 5.0


class EveryoneLeads(Leader):
    """What there was before: each worker looks after all."""

    def is_leader(self) -> bool:
        """Lead, whoever else does."""
        return True


@dataclass(frozen=True, slots=True)
class Asked:
    """What the database was asked in a second, and what it took of one core."""

    queries: float
    rows: float
    processor_percent: float


class SimulatedWorker:
    """One worker on a computer of its own: its rounds by its own clock."""

    def __init__(
        self, settings: Settings, number: int, *, all_lead: bool, count: Callable[..., None]
    ) -> None:
        bench = open_bench(settings)
        event.listen(bench.store.engine, "after_cursor_execute", count)
        me = Claimer(f"computer {number}", 1, "")
        watch = LeaseWatch(me, settings.lease_s)
        self._bench: Bench = replace(bench, watch=watch, revives=all_lead)
        self._leader = (EveryoneLeads if all_lead else Leader)(bench.store.engine, REVIVAL, 60.0)
        self._claimed = bench.store.claim(me)
        self._first_s = number

    def run(self, stopping: threading.Event, workers: int) -> None:
        """Keep the rounds of a worker; the workers of a cluster are spread evenly."""
        rounds = (
            (self._bench.settings.heartbeat_s, self._beat),
            (REVIVE_S, self._revive),
            (CLAIM_S, self._claim),
        )
        begin_s = time.monotonic()
        due = [begin_s + START_S + every_s * self._first_s / workers for every_s, _ in rounds]
        while not stopping.wait(max(0.0, min(due) - time.monotonic())):
            which = due.index(min(due))
            every_s, do = rounds[which]
            do()
            due[which] += every_s
        self._leader.close()
        self._bench.store.close()

    def _beat(self) -> None:
        assert self._claimed is not None
        self._bench.store.beat(self._claimed.id, str(self._claimed.token), "fusing", 0.5)

    def _revive(self) -> None:
        if revive_if_leading(self._bench, self._leader):
            with self._bench.store.engine.connect() as connection:
                asked = {"queue": QUEUE, "task_name": None, "seconds_since_heartbeat": 30.0}
                connection.connection.cursor().execute(queries["select_stalled_jobs_by_heartbeat"], asked)
                connection.execute(text("SELECT 1"))  # counted for the one above

    def _claim(self) -> None:
        if self._bench.revives:
            reclaim_abandoned(self._bench)
        self._bench.store.claim(self._bench.watch.me)


def measure(server: PostgresServer, workers: int, seconds: float, *, all_lead: bool) -> Asked:
    """Let the workers run and count what they ask."""
    server.empty()
    counts: Counter[str] = Counter()

    def count(_connection: Any, cursor: Any, *_rest: Any) -> None:
        counts["queries"] += 1
        counts["rows"] += max(0, cursor.rowcount)

    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(data_dir=Path(folder), database_url=server.url)
        queue(settings, workers)
        every = [SimulatedWorker(settings, k, all_lead=all_lead, count=count) for k in range(workers)]
        stopping = threading.Event()
        threads = [threading.Thread(target=one.run, args=(stopping, workers)) for one in every]
        for thread in threads:
            thread.start()
        time.sleep(2 * START_S)
        before, spent_s, began_s = Counter(counts), read_processor_s(server), time.monotonic()
        time.sleep(seconds)
        took_s = time.monotonic() - began_s
        counts -= before
        spent_s = read_processor_s(server) - spent_s
        stopping.set()
        for thread in threads:
            thread.join()
    return Asked(counts["queries"] / took_s, counts["rows"] / took_s, 100 * spent_s / took_s)


def queue(settings: Settings, number: int) -> None:
    """Queue an analysis for each worker."""
    bench = open_bench(settings)
    install(settings.database_url)
    for _ in range(number):
        upload = bench.storage.open_upload(100)
        upload.write(b"recording")
        bench.store.add(upload.keep(), ReportRequest("shift.gt3x"))
    bench.store.close()


def read_processor_s(server: PostgresServer) -> float:
    """Sum what all processes of the database took so far."""
    pid = int((server.folder / "cluster" / "postmaster.pid").read_text().split()[0])
    family = psutil.Process(pid).children()
    times = [process.cpu_times() for process in family]
    return sum(one.user + one.system for one in times)


def main() -> None:
    parser = argparse.ArgumentParser(description="What many workers ask of one PostgreSQL.")
    parser.add_argument("--workers", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=30.0)
    arguments = parser.parse_args()
    server = PostgresServer(connections=3 * arguments.workers + 20)
    print("| workers | who looks after the dead | queries/s | rows/s | of one core |")
    print("|---:|---|---:|---:|---:|")
    try:
        for count in (arguments.workers // 4, arguments.workers):
            for name, all_lead in (("every worker", True), ("the leader", False)):
                asked = measure(server, count, arguments.seconds, all_lead=all_lead)
                figures = f"{asked.queries:.0f} | {asked.rows:.0f} | {asked.processor_percent:.1f} %"
                print(f"| {count} | {name} | {figures} |", flush=True)
    finally:
        server.remove()


if __name__ == "__main__":
    main()
