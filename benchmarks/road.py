"""Measure the whole analysis on simulated shifts: accuracy, speed, memory.

    python -m benchmarks.road [NAME ...] [--seed 1] [--keep DIR] [--runs 5]
    python -m benchmarks.road --lines [--keep DIR] [--runs 3]

Names: gt9x-gt3x, gt9x-csv, lsm9ds1-4h, lsm9ds1-8h, lsm9ds1-24h; by default all but the last. Each run is a
new process of the command line with a new folder (start-up, reading, fusion, exposure, HTML and PDF
included). The first run has no compiled kernels, as after an installation; the memory of one run is measured.
In alternation, ``pandas.read_csv`` (C engine, every column) reads the same file in a new process; start-up
and import of pandas are not timed. The last run has three recordings, one at a time, to measure the cost of
each further one. ``--lines`` instead prints a row for 1, 2, 4, 8 and 24 h of each format, and how many
recordings of 8 h two cores analyse in an hour.

Processor time is of the process and all its children. Memory is the anonymous part of their proportional set
size: memory shared by forking counts once, mapped files do not count. Truth and result are compared for each
sample that the result marks as valid; the bins are compared with the truth's share of the same samples.
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

from acromion.fusion.angle_files.elevation_parquet import read_rows
from acromion.fusion.simulation import write_recordings
from acromion.fusion.simulation.sensor import Device
from benchmarks.readers import header_lines

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
class Case:
    """A recording to analyse, and its limits: seconds, multiples of ``pandas.read_csv``, or memory."""

    device: Device
    hours: float
    ending: str
    most_first_s: float | None = None
    most_s: float | None = None
    most_cpu_s: float | None = None
    most_times: float | None = None
    most_cpu_times: float | None = None
    most_mib: float | None = None
    most_further_cpu_s: float | None = None


CASES = {
    "gt9x-gt3x": Case(
        "gt9x", 8.0, ".gt3x", most_first_s=12.0, most_s=1.8, most_cpu_s=2.5, most_further_cpu_s=1.5
    ),
    "gt9x-csv": Case("gt9x", 8.0, ".csv", most_times=3.0, most_cpu_times=1.8, most_mib=350.0),
    "lsm9ds1-4h": Case("lsm9ds1", 4.0, ".csv", most_times=2.4, most_cpu_times=1.8, most_mib=400.0),
    "lsm9ds1-8h": Case("lsm9ds1", 8.0, ".csv", most_times=1.8, most_cpu_times=1.4, most_mib=500.0),
    "lsm9ds1-24h": Case("lsm9ds1", 24.0, ".csv", most_mib=600.0),
}
USUAL = tuple(name for name in CASES if name != "lsm9ds1-24h")
FURTHER = 2
FORMATS: tuple[tuple[Device, str], ...] = (("gt9x", ".gt3x"), ("gt9x", ".csv"), ("lsm9ds1", ".csv"))
HOURS = (1.0, 2.0, 4.0, 8.0, 24.0)
BATCH = 16


@dataclass(frozen=True, slots=True)
class Cost:
    """Wall time, processor time and peak memory of a run, including its children."""

    wall_s: float
    cpu_s: float
    peak_mib: float = 0.0


def run_once(
    log: Path,
    out: Path,
    method: str,
    *,
    watch_memory: bool = False,
    kernels: Path | None = None,
    at_once: int = 1,
    options: Sequence[str] = (),
) -> Cost:
    """Run the command line on one recording or a folder, and monitor it and all its children (Linux).

    Measuring memory slows the process, so it has a separate run. ``kernels``: the folder of compiled code,
    empty after an installation; by default that of the user. ``options``: further options of the command.
    """
    asked = ["-o", str(out), "--method", method, "-j", str(at_once), *options]
    command = [sys.executable, "-m", "acromion", "run", str(log), *asked]
    environment = build_environment()
    if kernels is not None:
        environment["NUMBA_CACHE_DIR"] = str(kernels)
    began = time.perf_counter()
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        env=environment,
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


def build_environment() -> dict[str, str]:
    """Return the environment without the variable that stops Python from storing bytecode."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def list_processes(session: int) -> Iterator[tuple[str, int]]:
    """Yield process number and processor ticks of each process of a session."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            if int(fields[3]) == session:
                yield folder.name, int(fields[11]) + int(fields[12])
        except OSError:
            continue


def measure_memory_kib(pid: str) -> int:
    """Return the anonymous part of a process's proportional set size; 0 if it has ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("Pss_Anon:")), 0)


def run_pandas(log: Path) -> Cost:
    """Read the table with pandas in a new process; return the time of the call alone."""
    command = [sys.executable, "-c", PANDAS, str(log), str(header_lines(log))]
    answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    return Cost(float(answer[0]), float(answer[1]))


def compare_with_truth(folder: Path, truth: Path) -> tuple[float, float, list[float]]:
    """Return RMSE and bias of elevation in degrees, and the error of each bin in percentage points."""
    got, true = read_rows(folder / "elevation.parquet"), read_rows(truth)
    angle = got.elevation_deg[got.valid].astype(float)
    true_angle = np.interp(got.time_s[got.valid], true.time_s, true.elevation_deg)
    share = np.histogram(true_angle, EDGES_DEG)[0] / true_angle.size * 100
    results = json.loads((folder / "results.json").read_text("utf-8"))
    errors = [b["percent"] - s for b, s in zip(results["exposure"]["bins"], share, strict=True)]
    difference = angle - true_angle
    return float(np.sqrt(np.mean(difference**2))), float(difference.mean()), errors


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", choices=[*CASES, []], metavar="NAME")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default="smoothed")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--keep", type=Path, default=None)
    parser.add_argument("--lines", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        if arguments.lines:
            report_lines(Path(temporary), arguments)
            return
        for name in arguments.names or USUAL:
            case = CASES[name]
            made = simulate(case, arguments.keep or Path(temporary), arguments.seed)
            report(case, made, Path(temporary) / name, arguments)


def report_lines(out: Path, arguments: argparse.Namespace) -> None:
    """Print the cost of each length of each format, then the recordings of 8 h per hour."""
    folder, method = arguments.keep or out, arguments.method
    for device, ending in FORMATS:
        for hours in HOURS:
            case = Case(device, hours, ending)
            log = find_log(case, simulate(case, folder, arguments.seed))
            place = out / f"{device}{ending}{hours:g}"
            watched = run_once(log, place / "watched", method, watch_memory=True)
            costs = [run_once(log, place / str(turn), method) for turn in range(arguments.runs)]
            print(
                f"{device} {ending} {hours:g} h: {format_costs(costs)}, peak {watched.peak_mib:.0f} MiB",
                flush=True,
            )
        eight = Case(device, 8.0, ending)
        log = find_log(eight, simulate(eight, folder, arguments.seed))
        wall_s = run_batch(log, out / f"batch{device}{ending}", method, BATCH, at_once=2).wall_s
        print(f"{device} {ending}: {BATCH / wall_s * 3600:.0f} recordings of 8 h an hour", flush=True)


def find_log(case: Case, made: Path) -> Path:
    """Return the recording of the wanted format among the simulated files."""
    return next(path for path in sorted(made.iterdir()) if path.suffix == case.ending)


def run_batch(log: Path, out: Path, method: str, count: int, *, at_once: int = 1) -> Cost:
    """Analyse a folder that contains one recording ``count`` times."""
    folder = out / "batch"
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        (folder / f"{number}{log.suffix}").symlink_to(log)
    return run_once(folder, out / "results", method, at_once=at_once)


def simulate(case: Case, folder: Path, seed: int) -> Path:
    """Return the folder of the simulated recordings; create it if needed."""
    made = folder / f"{case.device}_{case.hours:g}h_{seed}"
    if not made.exists():
        began = time.perf_counter()
        write_recordings(made, case.device, case.hours, seed)
        print(f"{case.device}: simulated {case.hours:g} h in {time.perf_counter() - began:.1f} s")
    return made


def report(case: Case, made: Path, out: Path, arguments: argparse.Namespace) -> None:
    """Run ours and pandas in alternation, compare, print."""
    log, method = find_log(case, made), arguments.method
    first = run_once(log, out / "first", method, kernels=out / "kernels")
    run_once(log, out / "warm", method)
    watched = run_once(log, out / "watched", method, watch_memory=True)
    ours: list[Cost] = []
    theirs: list[Cost] = []
    for turn in range(arguments.runs):
        ours.append(run_once(log, out / str(turn), method))
        if case.ending == ".csv":
            theirs.append(run_pandas(log))
    print(f"{log.name}, {log.stat().st_size / 1e6:.0f} MB, {case.hours:g} h, {method}")
    print(f"  first run after installation: wall {first.wall_s:.1f} s, cpu {first.cpu_s:.1f} s")
    print(f"  run: {format_costs(ours)}, peak {watched.peak_mib:.0f} MiB")
    if theirs:
        wall, cpu = (
            median(getattr(cost, of) for cost in ours) / median(getattr(cost, of) for cost in theirs)
            for of in ("wall_s", "cpu_s")
        )
        print(f"  pandas.read_csv: {format_costs(theirs)}: run takes {wall:.2f} x (cpu {cpu:.2f} x)")
    if case.most_further_cpu_s is not None:
        further_s = measure_further(log, out, method, median(cost.cpu_s for cost in ours), arguments.runs)
        print(f"  each further recording of a batch: cpu {further_s:.2f} s")
    print(f"  goal: {format_goal(case)}")
    results = next((out / "warm").glob("*/"))
    print(f"  elevation.parquet: {(results / 'elevation.parquet').stat().st_size / 1e6:.2f} MB")
    rmse_deg, bias_deg, errors = compare_with_truth(results, made / "truth.parquet")
    print(f"  elevation RMSE {rmse_deg:.3f} deg, bias {bias_deg:+.3f} deg")
    print("  bins, percentage points: " + " ".join(f"{e:+.2f}" for e in errors))


def measure_further(log: Path, out: Path, method: str, one_cpu_s: float, runs: int) -> float:
    """Return the processor time of each further recording of a run."""
    costs = [run_batch(log, out / f"batch-{turn}", method, FURTHER + 1).cpu_s for turn in range(runs)]
    return (median(costs) - one_cpu_s) / FURTHER


def format_costs(costs: Sequence[Cost]) -> str:
    """Return the median wall time with its range, and the median processor time."""
    walls_s = sorted(cost.wall_s for cost in costs)
    cpu_s = median(cost.cpu_s for cost in costs)
    return f"wall {median(walls_s):.2f} s ({walls_s[0]:.2f} to {walls_s[-1]:.2f}), cpu {cpu_s:.2f} s"


def format_goal(case: Case) -> str:
    """Return the limits of a recording as text."""
    asked = (
        (case.most_first_s, "first run <= {} s"),
        (case.most_s, "wall <= {} s"),
        (case.most_cpu_s, "cpu <= {} s"),
        (case.most_times, "<= {} x pandas.read_csv"),
        (case.most_cpu_times, "cpu <= {} x"),
        (case.most_mib, "peak <= {} MiB"),
        (case.most_further_cpu_s, "each further cpu <= {} s"),
    )
    return ", ".join(words.format(value) for value, words in asked if value is not None)


if __name__ == "__main__":
    main()
