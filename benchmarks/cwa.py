"""A day of an AX6 as a `.cwa`: what ours and other readers make of it, and how long they take.

    CWA_PEERS_PYTHON=/path/to/python python -m benchmarks.cwa [--hours 8]

The day is simulated; `tests/fusion/cwa_builder.py`, which shares nothing with the reader, puts its readings
into blocks. The stamps scatter by a millisecond. CWA_PEERS_PYTHON is an interpreter that has some of
cwa-reader-rs, scikit-digital-health, openmovement (with numpy < 2) and actipy (with Java); without it ours is
read alone. Each reading is a process of its own, three rounds in turn, on one core; seconds are of the
processor, children with them, after a reading of a small file. "readings" are the largest differences from
what was written, "times" from when it was sampled.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from fusion.simulation import simulate_shift
from tests.fusion.cwa_builder import START_US, block, header

ROUNDS = 3
SCATTER_US = 1000.0
COUNTS_PER_G, COUNTS_PER_DPS = 2048.0, 32_768 / 2000
OURS = """
from fusion.readers import read_recording
def read(path):
    with open(path, "rb") as file:
        recording = read_recording(file, sha256="-")
    times = [s.start_s + np.arange(len(s)) / s.rate_hz for s in recording.segments]
    start_s = (recording.start - datetime(1970, 1, 1)).total_seconds()
    acc, gyr = (np.concatenate([getattr(s, n) for s in recording.segments]) for n in ("acc_g", "gyr_dps"))
    return start_s + np.concatenate(times), acc, gyr
"""
PEERS = {
    "cwa-reader-rs": """
from cwa_reader_rs import read_cwa_file
def read(path):
    df = read_cwa_file(path, include_temperature=False, include_light=False, include_battery=False)
    columns = [df[[f"{n}_{a}" for a in "xyz"]].to_numpy() for n in ("acc", "gyro")]
    return df.index.as_unit("ns").astype("int64").to_numpy() / 1e9, *columns
""",
    "scikit-digital-health": """
from skdh.io import ReadCwa
def read(path):
    found = ReadCwa().predict(file=path)
    return found["time"], found["accel"], found["gyro"]
""",
    "openmovement": """
from openmovement.load import CwaData
def read(path):
    with CwaData(path, include_light=False, include_temperature=False) as file:
        values = file.get_sample_values()
    return values[:, 0], values[:, 1:4], values[:, 4:7]
""",
    "actipy": """
import actipy
def read(path):
    df, _ = actipy.read_device(path, None, False, False, None, verbose=False)
    columns = [df[[f"{n}{a}" for a in "xyz"]].to_numpy() for n in ("", "gyro_")]
    return df.index.as_unit("ns").astype("int64").to_numpy() / 1e9, *columns
""",
}
HARNESS = """
import json, os, sys
from datetime import datetime
import numpy as np
{program}
read(sys.argv[2])
before = os.times()
found = read(sys.argv[1])
after = os.times()
np.savez(sys.argv[3], *found)
print("\\n" + json.dumps(sum(after[:4]) - sum(before[:4])))
"""


def write_day(path: Path, hours: float) -> None:
    """Write the readings of a simulated day in blocks of 40, and beside them what was written and when."""
    shift = simulate_shift("gt9x", hours, seed=1)
    day = shift.in_arrays()
    table = np.concatenate([day.gyr_dps * COUNTS_PER_DPS, day.acc_g * COUNTS_PER_G], axis=1)
    counts = np.clip(np.rint(table), -32_768, 32_767).astype(np.int16)
    scatter_us = np.random.default_rng(2).normal(0.0, SCATTER_US, len(counts) // 40 + 1)
    with path.open("wb") as file:
        file.write(header())
        for number, first in enumerate(range(0, len(counts), 40)):
            at_us = START_US + 1e6 * first / day.rate_hz + scatter_us[number]
            file.write(block(number, round(at_us), counts[first : first + 40]))
    at_s = START_US / 1e6 + np.arange(len(counts)) / day.rate_hz
    np.savez(path.with_suffix(".npz"), at_s, counts[:, 3:] / COUNTS_PER_G, counts[:, :3] / COUNTS_PER_DPS)


def run(python: str, program: str, path: Path, small: Path, out: Path) -> float | None:
    """Seconds of one reading; None where it cannot be done."""
    command = [python, "-c", HARNESS.format(program=program), str(path), str(small), str(out)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode:
        print("   ", *ended.stderr.splitlines()[-1:])
        return None
    return float(json.loads(ended.stdout.splitlines()[-1]))


def compare(out: Path, written: Path) -> str:
    """Say how far readings and times are from what was written."""
    found, true = np.load(out), np.load(written)
    rows, n = len(found["arr_0"]), min(len(found["arr_0"]), len(true["arr_0"]))
    at, acc, gyr = (float(np.nanmax(np.abs(found[name][:n] - true[name][:n]))) for name in true.files)
    extra = rows - len(true["arr_0"])
    return f"{extra:+d} rows, readings {acc:.1e} g, {gyr:.1e} deg/s, times {1000 * at:.1f} ms"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--hours", type=float, default=8.0)
    hours = parser.parse_args().hours
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    peers = os.environ.get("CWA_PEERS_PYTHON")
    programs = {"acromion": (sys.executable, OURS)}
    programs |= {name: (peers, program) for name, program in PEERS.items()} if peers else {}
    with tempfile.TemporaryDirectory() as folder:
        path, small = Path(folder, "day.cwa"), Path(folder, "small.cwa")
        write_day(path, hours)
        write_day(small, 0.02)
        print(f"{hours:g} h, {path.stat().st_size / 1e6:.1f} MB, medians of {ROUNDS}")
        rounds = [
            {name: run(*how, path, small, Path(folder, f"{name}.npz")) for name, how in programs.items()}
            for _ in range(ROUNDS)
        ]
        for name in programs:
            seconds = [taken for one in rounds if (taken := one[name]) is not None]
            if seconds:
                told = compare(Path(folder, f"{name}.npz"), path.with_suffix(".npz"))
                print(f"  {name:22s} {statistics.median(seconds):7.3f} s   {told}")


if __name__ == "__main__":
    main()
