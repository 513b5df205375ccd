"""Measure seven days against one day: ``python -m benchmarks.week [--keep DIR] [--runs 3]``.

Both are simulated recordings of a GT9X Link (``.gt3x``), cut into the shift from 08:00 to 16:30 of each day.
Runs alternate, each in a new process of the command line. The limits are eight times the time of one day, and
1.2 GiB. The peer is the one day: the same command and machine.
"""

import argparse
import tempfile
from pathlib import Path
from statistics import median

from acromion.fusion.simulation import simulate_shift, write_shift
from benchmarks.road import Cost, run_once

DAYS = (1, 7)
SHIFT = ("--shift", "08:00-16:30")
MOST_TIMES, MOST_GIB = 8.0, 1.2


def write_recording(folder: Path, days: int) -> Path:
    """Return the recording of so many days; write it if it is missing."""
    kept = folder / f"{days}-days.gt3x"
    if not kept.exists():
        made = write_shift(folder, simulate_shift("gt9x", 24.0 * days, seed=1), actilife_csv=False)[0]
        made.rename(kept)
    return kept


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path, help="a folder for the recordings; default: a temporary folder")
    parser.add_argument("--runs", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = asked.keep or Path(place)
        recordings = {days: write_recording(folder, days) for days in DAYS}
        costs: dict[int, list[Cost]] = {days: [] for days in DAYS}
        for number in range(asked.runs + 1):
            for days, recording in recordings.items():
                is_last = number == asked.runs
                out = Path(place) / f"out-{days}-{number}"
                cost = run_once(recording, out, "smoothed", watch_memory=is_last, options=SHIFT)
                costs[days].append(cost)
                print(f"{days} days: {cost.wall_s:.1f} s, CPU {cost.cpu_s:.1f} s", flush=True)
        for name in ("wall_s", "cpu_s"):
            day, week = (median(getattr(one, name) for one in costs[days][:-1]) for days in DAYS)
            times = f"{week / day:.1f} times (goal {MOST_TIMES})"
            print(f"{name}: one day {day:.2f}, seven days {week:.2f}: {times}")
        peak_gib = costs[DAYS[-1]][-1].peak_mib / 1024
        print(f"peak memory of seven days: {peak_gib:.2f} GiB (goal {MOST_GIB})")


if __name__ == "__main__":
    main()
