"""How fast and how lean recordings are read, beside the general-purpose table readers, in one run.

    python -m benchmarks.readers shift_seed1.gt3x shift_seed1-IMU.csv shift_seed1.csv

Each reader runs in a process of its own (so that peaks do not mix), three times; the median is printed. Ours
does more than the others: it also hashes the file, finds the holes and checks the physics.
"""

import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

ROUNDS = 3


def read_ours(path: Path) -> None:
    from fusion.readers import read_recording  # noqa: PLC0415 (each process loads one reader only)

    with path.open("rb") as file:
        read_recording(file)


def read_pandas(path: Path) -> None:
    import pandas as pd  # noqa: PLC0415

    pd.read_csv(path, comment="#", skiprows=_header_lines(path), engine="c")


def read_polars(path: Path) -> None:
    import polars as pl  # noqa: PLC0415

    pl.read_csv(path, comment_prefix="#", skip_rows=_header_lines(path))


def count_newlines(path: Path) -> None:
    with path.open("rb") as file:
        sum(chunk.count(b"\n") for chunk in iter(lambda: file.read(4 << 20), b""))


def _header_lines(path: Path) -> int:
    with path.open("rb") as file:
        return 10 if file.read(12) == b"-" * 12 else 0


READERS: dict[str, Callable[[Path], None]] = {
    "acromion": read_ours,
    "pandas C": read_pandas,
    "polars": read_polars,
    "newline count": count_newlines,
}


def run_one(name: str, path: Path) -> None:
    """Print the median seconds of wall clock and processor, and the peak in MiB."""
    walls, processors = [], []
    for _ in range(ROUNDS):
        wall, processor = time.perf_counter(), time.process_time()
        READERS[name](path)
        walls.append(time.perf_counter() - wall)
        processors.append(time.process_time() - processor)
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{name:14s} {statistics.median(walls):8.2f} s wall {statistics.median(processors):8.2f} s cpu "
        f"{peak_mib:8.0f} MiB peak"
    )


def main() -> None:
    if len(sys.argv) == 4 and sys.argv[1] == "--one":
        run_one(sys.argv[2], Path(sys.argv[3]))
        return
    for path in map(Path, sys.argv[1:]):
        print(f"{path.name}, {path.stat().st_size / 1e6:.0f} MB", flush=True)
        for name in READERS if path.suffix == ".csv" else ("acromion",):
            subprocess.run([sys.executable, "-m", "benchmarks.readers", "--one", name, str(path)], check=True)


if __name__ == "__main__":
    main()
