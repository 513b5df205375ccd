"""Damage each format many times, with seeds, and print the outcomes.

    python -m benchmarks.fuzz --count 10000 [--format "LSM9DS1 CSV"] [--keep FOLDER]

Exits with 1 if an exception other than a FusionError was raised, or if a second was not accounted for. The
file that caused it is stored.
"""

import argparse
import collections
import sys
import time
import traceback
from pathlib import Path
from random import Random

from benchmarks.fuzz.outcome import damage, read_damaged
from benchmarks.fuzz.seeds import SEEDS


def place_of(error: BaseException) -> str:
    last = [frame for frame in traceback.extract_tb(error.__traceback__) if "fusion" in frame.filename]
    where = f"{Path(last[-1].filename).name}:{last[-1].lineno}" if last else "-"
    return f"{type(error).__name__} {where} {str(error)[:80]}"


def fuzz(name: str, count: int, folder: Path | None) -> int:
    """Print the outcomes of a format; return the number of faults."""
    outcomes: collections.Counter[str] = collections.Counter()
    faults: collections.Counter[str] = collections.Counter()
    slowest_s, started = 0.0, time.perf_counter()
    for seed in range(count):
        before = time.perf_counter()
        try:
            outcomes[read_damaged(name, Random(seed))] += 1
        except Exception as error:  # noqa: BLE001 (any exception is a finding)
            fault = place_of(error)
            if folder is not None and fault not in faults:
                (folder / f"{name.replace(' ', '-')}-{seed}.bin").write_bytes(damage(name, Random(seed)))
            faults[fault] += 1
        slowest_s = max(slowest_s, time.perf_counter() - before)
    seconds = time.perf_counter() - started
    print(f"{name}: {count} files, {sum(faults.values())} faults, {seconds:.0f} s, slowest {slowest_s:.2f} s")
    print("   ", ", ".join(f"{code} {n}" for code, n in outcomes.most_common()))
    for fault, n in faults.most_common():
        print(f"    FAULT x{n}: {fault}", flush=True)
    return sum(faults.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--format", choices=[*SEEDS], action="append")
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    faults = sum(fuzz(name, options.count, options.keep) for name in options.format or SEEDS)
    peak = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")]
    print("peak memory of the process:", *peak)
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
