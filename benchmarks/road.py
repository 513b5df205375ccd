"""The whole road on simulated shifts: how right, how fast, how much memory.

    python -m benchmarks.road [NAME ...] [--seed 1] [--keep DIR] [--runs 5]

Names: gt9x-gt3x, gt9x-csv, lsm9ds1-4h, lsm9ds1-8h; all of them where none is given. Each run is a new process
of the command line into a new folder (start-up, reading, fusion, exposure, HTML and PDF included), after one
run that fills the compiler's cache and that of Python (which an installation fills) and one whose memory is
watched. Beside it, turn by turn, runs the time of ``pandas.read_csv`` (C engine, every column) on the same
file, itself in a new process, whose start-up and import of pandas are left out.

Processor time is of the process and all its children. Memory is their proportional set size, so that what
they share by forking counts once. Truth and result are compared sample by sample where the result says it is
valid; the bins against the truth's own share of the same samples.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
import pyarrow.parquet as pq

from benchmarks.readers import header_lines
from fusion.simulation import write_recordings
from fusion.simulation.sensor import Device

POLL_S = 0.02
EDGES_DEG = (0, 20, 30, 45, 60, 80, 90, 120, 150, 180)
PANDAS = """
import os, sys, time
import pandas
began, cpu = time.perf_counter(), time.process_time()
pandas.read_csv(sys.argv[1], skiprows=int(sys.argv[2]), engine="c")
print(time.perf_counter() - began, time.process_time() - cpu)
"""


@dataclass(frozen=True, slots=True)
class Road:
    """A recording to analyse, and what it may cost: seconds, times ``pandas.read_csv``, or memory."""

    device: Device
    hours: float
    ending: str
    most_s: float | None = None
    most_times: float | None = None
    most_mib: float | None = None


ROADS = {
    "gt9x-gt3x": Road("gt9x", 8.0, ".gt3x", most_s=2.0),
    "gt9x-csv": Road("gt9x", 8.0, ".csv", most_times=1.6),
    "lsm9ds1-4h": Road("lsm9ds1", 4.0, ".csv", most_times=1.0),
    "lsm9ds1-8h": Road("lsm9ds1", 8.0, ".csv", most_mib=700.0),
}


@dataclass(frozen=True, slots=True)
class Cost:
    """Wall time, processor time and peak memory of a run, its children included."""

    wall_s: float
    cpu_s: float
    peak_mib: float = 0.0


def run_once(log: Path, out: Path, method: str, *, watch_memory: bool = False) -> Cost:
    """Run the command line on one recording, and watch it and all its children (Linux).

    Looking at memory holds up the process that is looked at: it has a run of its own.
    """
    command = [sys.executable, "-m", "app", "run", str(log), "-o", str(out), "--method", method]
    began = time.perf_counter()
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, start_new_session=True, env=keep_bytecode(out.parent)
    )
    cpu_ticks: dict[str, int] = {}
    peak_kib = 0
    while process.poll() is None:
        seen = list(list_processes(process.pid))
        cpu_ticks.update(seen)
        if watch_memory:
            peak_kib = max(peak_kib, sum(measure_memory_kib(pid) for pid, _ in seen))
        time.sleep(POLL_S)
    wall_s = time.perf_counter() - began
    if process.returncode:
        raise SystemExit(f"{log.name}: exit status {process.returncode}")
    cpu_s = sum(cpu_ticks.values()) / os.sysconf("SC_CLK_TCK")
    return Cost(wall_s, cpu_s, peak_kib / 1024)


def keep_bytecode(folder: Path) -> dict[str, str]:
    """Let Python keep what it compiles, in a folder of ours, whatever the environment says."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return {**environment, "PYTHONPYCACHEPREFIX": str(folder / "bytecode")}


def list_processes(session: int) -> Iterator[tuple[str, int]]:
    """Give process number and processor ticks of each process of a session."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            if int(fields[3]) == session:
                yield folder.name, int(fields[11]) + int(fields[12])
        except OSError:
            continue


def measure_memory_kib(pid: str) -> int:
    """Give the proportional set size of a process; 0 for one that has gone."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("Pss:")), 0)


def run_pandas(log: Path) -> Cost:
    """Read the table with pandas in a new process; the time of the call alone."""
    command = [sys.executable, "-c", PANDAS, str(log), str(header_lines(log))]
    answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    return Cost(float(answer[0]), float(answer[1]))


def compare_with_truth(folder: Path, truth: Path) -> tuple[float, float, list[float]]:
    """Give RMSE and bias of elevation in degrees, and the error of each bin in percentage points."""
    got = pq.read_table(folder / "elevation.parquet")
    true = pq.read_table(truth)
    valid = got["valid"].to_numpy()
    angle = got["elevation_deg"].to_numpy()[valid].astype(float)
    true_angle = np.interp(
        got["time_s"].to_numpy()[valid], true["time_s"].to_numpy(), true["elevation_deg"].to_numpy()
    )
    share = np.histogram(true_angle, EDGES_DEG)[0] / true_angle.size * 100
    results = json.loads((folder / "results.json").read_text("utf-8"))
    errors = [b["percent"] - s for b, s in zip(results["exposure"]["bins"], share, strict=True)]
    difference = angle - true_angle
    return float(np.sqrt(np.mean(difference**2))), float(difference.mean()), errors


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", choices=[*ROADS, []], metavar="NAME")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default="smoothed")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--keep", type=Path, default=None)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        for name in arguments.names or ROADS:
            road = ROADS[name]
            made = simulate(road, arguments.keep or Path(temporary), arguments.seed)
            report(road, made, Path(temporary) / name, arguments)


def simulate(road: Road, folder: Path, seed: int) -> Path:
    """Give the folder of the simulated recordings, made if it is not there."""
    made = folder / f"{road.device}_{road.hours:g}h_{seed}"
    if not made.exists():
        began = time.perf_counter()
        write_recordings(made, road.device, road.hours, seed)
        print(f"{road.device}: simulated {road.hours:g} h in {time.perf_counter() - began:.1f} s")
    return made


def report(road: Road, made: Path, out: Path, arguments: argparse.Namespace) -> None:
    """Run ours and theirs in turn, compare, print."""
    log = next(path for path in sorted(made.iterdir()) if path.suffix == road.ending)
    method = arguments.method
    run_once(log, out / "first", method)
    watched = run_once(log, out / "watched", method, watch_memory=True)
    ours: list[Cost] = []
    theirs: list[Cost] = []
    for turn in range(arguments.runs):
        ours.append(run_once(log, out / str(turn), method))
        if road.ending == ".csv":
            theirs.append(run_pandas(log))
    print(f"{log.name}, {log.stat().st_size / 1e6:.0f} MB, {road.hours:g} h, {method}")
    print(f"  run: {tell(ours)}, peak {watched.peak_mib:.0f} MiB")
    if theirs:
        times = median(cost.wall_s for cost in ours) / median(cost.wall_s for cost in theirs)
        print(f"  pandas.read_csv: {tell(theirs)}: run takes {times:.2f} x")
    print(f"  goal: {tell_goal(road)}")
    rmse_deg, bias_deg, errors = compare_with_truth(next((out / "first").glob("*/")), made / "truth.parquet")
    print(f"  elevation RMSE {rmse_deg:.3f} deg, bias {bias_deg:+.3f} deg")
    print("  bins, percentage points: " + " ".join(f"{e:+.2f}" for e in errors))


def tell(costs: Sequence[Cost]) -> str:
    """Give the median wall time with its range, and the median processor time."""
    walls_s = sorted(cost.wall_s for cost in costs)
    cpu_s = median(cost.cpu_s for cost in costs)
    return f"wall {median(walls_s):.2f} s ({walls_s[0]:.2f} to {walls_s[-1]:.2f}), cpu {cpu_s:.2f} s"


def tell_goal(road: Road) -> str:
    """Say what is asked of a recording."""
    asked = (
        (road.most_s, "wall <= {} s"),
        (road.most_times, "<= {} x pandas.read_csv"),
        (road.most_mib, "peak <= {} MiB"),
    )
    return ", ".join(words.format(value) for value, words in asked if value is not None)


if __name__ == "__main__":
    main()
