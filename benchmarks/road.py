"""The whole road on a simulated shift: how right, how fast, how much memory.

    python -m benchmarks.road [--device gt9x] [--hours 8] [--seed 1] [--keep DIR] [--runs 3]

Each run is a new process of the command line (start-up, reading, fusion, exposure, HTML and PDF included),
after one run that fills the compiler's cache. Truth and result are compared sample by sample where the result
says it is valid; the bins against the truth's own share of the same samples.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
import pyarrow.parquet as pq

from fusion.simulation import write_recordings

POLL_S = 0.02
EDGES_DEG = (0, 20, 30, 45, 60, 80, 90, 120, 150, 180)


@dataclass(frozen=True, slots=True)
class Cost:
    """Wall time, processor time and peak memory of a run, its children included."""

    wall_s: float
    cpu_s: float
    peak_mib: float


def run_once(log: Path, out: Path, method: str) -> Cost:
    """Run the command line on one recording, and watch it and all its children (Linux)."""
    command = [sys.executable, "-m", "app", "run", str(log), "-o", str(out), "--force", "--method", method]
    began = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)
    cpu_ticks: dict[str, int] = {}
    peak_kib = 0
    while process.poll() is None:
        seen = list(list_processes(process.pid))
        cpu_ticks.update({pid: ticks for pid, ticks, _ in seen})
        peak_kib = max(peak_kib, sum(kib for _, _, kib in seen))
        time.sleep(POLL_S)
    wall_s = time.perf_counter() - began
    if process.returncode:
        raise SystemExit(f"{log.name}: exit status {process.returncode}")
    cpu_s = sum(cpu_ticks.values()) / os.sysconf("SC_CLK_TCK")
    return Cost(wall_s, cpu_s, peak_kib / 1024)


def list_processes(session: int) -> Iterator[tuple[str, int, int]]:
    """Give process number, processor ticks and memory of each process of a session.

    Memory is the proportional set size in KiB: what processes share by forking counts once in their sum.
    """
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            if int(fields[3]) == session:
                pss = next(x for x in (folder / "smaps_rollup").read_text().splitlines() if x[:4] == "Pss:")
                yield folder.name, int(fields[11]) + int(fields[12]), int(pss.split()[1])
        except OSError:
            continue


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
    parser.add_argument("--device", choices=("gt9x", "lsm9ds1"), nargs="*", default=("gt9x", "lsm9ds1"))
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default="smoothed")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--keep", type=Path, default=None)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        for device in arguments.device:
            folder = (arguments.keep or Path(temporary)) / f"{device}_{arguments.hours:g}h_{arguments.seed}"
            report(device, folder, arguments)


def report(device: str, folder: Path, arguments: argparse.Namespace) -> None:
    """Simulate once, run, compare, print."""
    if not folder.exists():
        began = time.perf_counter()
        write_recordings(folder, device, arguments.hours, arguments.seed)  # type: ignore[arg-type]
        print(f"{device}: simulated {arguments.hours:g} h in {time.perf_counter() - began:.1f} s")
    log = next(p for p in sorted(folder.iterdir()) if p.suffix == (".gt3x" if device == "gt9x" else ".csv"))
    out = folder / "out"
    costs = [run_once(log, out, arguments.method) for _ in range(arguments.runs + 1)][1:]
    rmse_deg, bias_deg, errors = compare_with_truth(out / log.stem, folder / "truth.parquet")
    print(
        f"{device} {log.name} {log.stat().st_size / 1e6:.0f} MB, {arguments.method}: "
        f"wall {median(c.wall_s for c in costs):.2f} s, cpu {median(c.cpu_s for c in costs):.2f} s, "
        f"peak {max(c.peak_mib for c in costs):.0f} MiB"
    )
    print(f"  elevation RMSE {rmse_deg:.3f} deg, bias {bias_deg:+.3f} deg")
    print("  bins, percentage points: " + " ".join(f"{e:+.2f}" for e in errors))


if __name__ == "__main__":
    main()
