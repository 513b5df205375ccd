"""Measure the cost of a shift and plan for many: ``python -m benchmarks.cost [--hours 8]``.

Measures the second analysis of a process (processor, memory, bytes, objects, reported stages) and prints a
plan (docs/it/many-machines.md): machines and money for 1,000, 100,000 and 10 million shifts a day. The plan
is arithmetic; its assumptions are in :class:`Prices` and :class:`Plan`.
"""

import argparse
import math
import resource
import tempfile
import time
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from acromion.app.analysis.run import make_report
from acromion.app.request import ReportRequest
from acromion.fusion.simulation import simulate_shift, write_shift

DAY_S, MONTH_H, DAYS_KEPT = 86_400.0, 730.0, 30
ONE_MACHINE = 1_000
"""One machine of four cores, with SQLite and a folder, handles this many shifts a day."""
PART_BYTES = 8 << 20


@dataclass(frozen=True, slots=True)
class Cost:
    """The measured cost of one shift."""

    cpu_s: float
    peak_bytes: int
    recording_bytes: int
    result_bytes: int
    results: int
    stages: int

    @property
    def puts(self) -> int:
        """Write requests to the bucket: parts of the recording, begin and end of the upload, results."""
        return math.ceil(self.recording_bytes / PART_BYTES) + 2 + self.results

    @property
    def moved_bytes(self) -> int:
        """The recording goes to the web server, the bucket and the worker; the results go to the bucket."""
        return 3 * self.recording_bytes + self.result_bytes

    @property
    def commits(self) -> float:
        """Upload, claim, publication; each stage; heartbeats; Procrastinate's fetch, finish, drop."""
        return 3 + self.stages + self.cpu_s / 3 + 3


@dataclass(frozen=True, slots=True)
class Prices:
    """In dollars; assumptions, to be replaced by your own."""

    core_h: float = 0.04
    stored_gb_month: float = 0.023
    million_puts: float = 5.0
    million_gets: float = 0.4


@dataclass(frozen=True, slots=True)
class Plan:
    """Assumptions of the plan, besides the measured costs."""

    shifts_a_day: int
    peak: float = 4.0
    spare_cpu: float = 1.5
    web_bytes_s: float = 1e9
    web_cores: int = 4
    commits_core_s: float = 500.0

    def per_s(self, each: float) -> float:
        """Return a cost per shift as a rate at the peak."""
        return each * self.shifts_a_day / DAY_S * self.peak

    def count_cores(self, cost: Cost) -> dict[str, int]:
        """Return the cores of workers, web servers and database at the peak."""
        if self.shifts_a_day <= ONE_MACHINE:
            return {"worker": 2, "web": 2, "database": 0}
        webs = math.ceil(self.per_s(cost.recording_bytes) / self.web_bytes_s)
        return {
            "worker": math.ceil(self.per_s(cost.cpu_s * self.spare_cpu)),
            "web": self.web_cores * max(webs, 2),
            "database": 2 * math.ceil(self.per_s(cost.commits) / self.commits_core_s),
        }


def simulate(folder: Path, hours: float) -> None:
    """Write the shift in a separate process, so that its memory is not counted as the analysis's."""
    write_shift(folder, simulate_shift("gt9x", hours, seed=1), actilife_csv=False)


def measure(hours: float) -> Cost:
    """Analyse a simulated shift twice in this process; return the cost of the second."""
    stages: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        writer = get_context("spawn").Process(target=simulate, args=(folder, hours))
        writer.start()
        writer.join()
        (log,) = folder.glob("*.gt3x")
        wish = ReportRequest(log.name, languages=("en", "fr"))
        for turn in ("first", "second"):
            out = folder / turn
            out.mkdir()
            stages.clear()
            began_s = time.process_time()
            make_report(log, wish, out, lambda stage, _: stages.append(stage))
            cpu_s = time.process_time() - began_s
        sizes = [path.stat().st_size for path in out.iterdir()]
        peak_bytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        return Cost(cpu_s, peak_bytes, log.stat().st_size, sum(sizes), len(sizes), len(stages))


def list_cost(cost: Cost) -> list[str]:
    """Return the measured cost as table rows."""
    return [
        f"| processor | {cost.cpu_s:.1f} CPU s |",
        f"| memory, peak of the process | {cost.peak_bytes / 1e6:.0f} MB |",
        f"| recording stored | {cost.recording_bytes / 1e6:.0f} MB |",
        f"| results stored | {cost.result_bytes / 1e6:.1f} MB in {cost.results} files |",
        f"| moved: client, web, bucket, worker; results | {cost.moved_bytes / 1e6:.0f} MB |",
        f"| requests that write to the bucket | {cost.puts} |",
        f"| commits in the database | {cost.commits:.0f} |",
    ]


def write_plan(cost: Cost, plan: Plan, prices: Prices) -> str:
    """Return the row of a plan: peak rates, cores, bytes after a month and a year, dollars per month."""
    cores = plan.count_cores(cost)
    recordings_bytes = DAYS_KEPT * cost.recording_bytes
    month_bytes, year_bytes = (
        plan.shifts_a_day * (recordings_bytes + days * cost.result_bytes) for days in (30, 365)
    )
    shifts_month = plan.shifts_a_day * 30
    asked = shifts_month * (cost.puts * prices.million_puts + 2 * prices.million_gets) / 1e6
    stored = [kept / 1e9 * prices.stored_gb_month for kept in (month_bytes, year_bytes)]
    machines = sum(cores.values()) * MONTH_H * prices.core_h
    cells = [
        f"{plan.shifts_a_day:,}",
        f"{cores['worker']} / {cores['web']} / {cores['database']}",
        f"{plan.per_s(cost.recording_bytes) / 1e9:.3g} GB/s",
        f"{plan.per_s(cost.moved_bytes) / 1e9:.3g} GB/s",
        f"{plan.per_s(cost.commits):,.1f}",
        f"{month_bytes / 1e12:,.1f} / {year_bytes / 1e12:,.1f} TB",
        f"{machines:,.0f}",
        f"{stored[0]:,.0f} / {stored[1]:,.0f}",
        f"{asked:,.0f}",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the cost of a shift.")
    parser.add_argument("--hours", type=float, default=8.0)
    cost = measure(parser.parse_args().hours)
    print("\n".join(list_cost(cost)))
    for shifts in (1_000, 100_000, 10_000_000):
        print(write_plan(cost, Plan(shifts), Prices()))


if __name__ == "__main__":
    main()
