"""Measure speed and memory of reading recordings on one core, compared with table readers.

    python -m benchmarks.readers shift_seed1.gt3x shift_seed1-IMU.csv shift_seed1.csv

Every reading is a separate process, limited to one core (affinity, and one thread for readers with threads),
and warmed up on the first megabyte (imports and compilation are not timed). The readers alternate, so other
load on the machine affects all of them equally. Prints medians of three rounds.

The peers only get the needed columns, and leave timestamps as text. Our reader also finds the gaps and checks
the physics and the sensors' faults. "with SHA-256" also computes the file's digest, which the peers do not.
For `.gt3x`, pygt3x reads the primary accelerometer of the same file, if PYGT3X_PYTHON names an interpreter
that has it.

Time in the kernel (copying the file from its cache, clearing new memory) is included and also printed
separately: on a virtual machine it depends on the host, not on the reader.

Peak: VmHWM of /proc, minus the resident memory before the reading; then minus the decoded samples (float32).
"""

import io
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

ROUNDS = 3
WARM_BYTES = 1 << 20
TIME_AND_MOTION = {True: (0, 1, 2, 3, 5, 6, 7), False: (0, 1, 2, 3, 4, 5, 6)}
"""Columns needed of an ActiLife export, and of our layout for the LSM9DS1."""
PYGT3X = """
import sys, time
from pygt3x.reader import FileReader
started = time.process_time()
with FileReader(sys.argv[1]) as reader:
    rows = len(reader.to_pandas())
print(time.process_time() - started, rows)
"""

Content = Path | io.BytesIO


def is_actilife(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(12) == b"-" * 12


def header_lines(path: Path) -> int:
    with path.open("rb") as file:
        head = file.read(4096).split(b"\n")
    return 10 if is_actilife(path) else sum(line.startswith(b"#") for line in head)


def needed_columns(path: Path) -> list[str]:
    with path.open() as file:
        names = [file.readline() for _ in range(header_lines(path) + 1)][-1].rstrip().split(",")
    return [names[k] for k in TIME_AND_MOTION[is_actilife(path)]]


def read_ours(_: Path, content: Content, sha256: str = "") -> int:
    from acromion.fusion.readers import read_recording  # noqa: PLC0415 (each process loads one reader only)

    if isinstance(content, io.BytesIO):
        recording = read_recording(content, sha256=sha256)
    else:
        with content.open("rb") as file:
            recording = read_recording(file, sha256=sha256)
    return sum(len(segment) for segment in recording.segments)


def read_without_digest(path: Path, content: Content) -> int:
    return read_ours(path, content, "0" * 64)


def read_pandas(path: Path, content: Content) -> int:
    import pandas as pd  # noqa: PLC0415

    skipped = header_lines(path)
    return len(pd.read_csv(content, skiprows=skipped, usecols=needed_columns(path), engine="c"))


def read_pyarrow(path: Path, content: Content) -> int:
    import pyarrow as pa  # noqa: PLC0415
    from pyarrow import csv  # noqa: PLC0415

    pa.set_cpu_count(1)
    names = needed_columns(path)
    types = {names[0]: pa.string()} if is_actilife(path) else {}
    table = csv.read_csv(
        content,
        read_options=csv.ReadOptions(use_threads=False, skip_rows=header_lines(path)),
        convert_options=csv.ConvertOptions(include_columns=names, column_types=types),
    )
    return int(table.num_rows)


def read_polars(path: Path, content: Content) -> int:
    import polars as pl  # noqa: PLC0415

    return len(pl.read_csv(content, skip_lines=header_lines(path), columns=needed_columns(path)))


def count_newlines(_: Path, content: Content) -> int:
    with content if isinstance(content, io.BytesIO) else content.open("rb") as file:
        return sum(chunk.count(b"\n") for chunk in iter(lambda: file.read(4 << 20), b""))


READERS: dict[str, Callable[[Path, Content], int]] = {
    "acromion": read_without_digest,
    "acromion with SHA-256": read_ours,
    "pandas C": read_pandas,
    "pyarrow": read_pyarrow,
    "polars": read_polars,
    "newline count": count_newlines,
}
OURS = ("acromion", "acromion with SHA-256")


def memory_mib(field: str) -> float:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(field + ":"):
            return int(line.split()[1]) / 1024
    return float("nan")


def warm_up(name: str, path: Path) -> None:
    if path.suffix != ".csv":
        READERS[name](path, path)
        return
    with path.open("rb") as file:
        head = file.read(WARM_BYTES)
    READERS[name](path, io.BytesIO(head[: head.rfind(b"\n") + 1]))


def run_one(name: str, path: Path) -> None:
    """Print seconds and memory of one reading."""
    first = time.perf_counter()
    warm_up(name, path)
    first = time.perf_counter() - first
    before_mib = memory_mib("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # reset the high-water mark
    started = os.times()
    rows = READERS[name](path, path)
    ended = os.times()
    kernel = ended.system - started.system
    seconds = ended.user - started.user + kernel
    peak_mib = memory_mib("VmHWM") - before_mib
    print(
        json.dumps(
            {"seconds": seconds, "kernel_s": kernel, "rows": rows, "peak_mib": peak_mib, "first_s": first}
        )
    )


def measure(name: str, path: Path) -> dict[str, float]:
    environment = {**os.environ, "POLARS_MAX_THREADS": "1", "OMP_NUM_THREADS": "1", "ARROW_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "benchmarks.readers", "--one", name, str(path)]
    answer = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    found: dict[str, float] = json.loads(answer.stdout)
    return found


def measure_pygt3x(path: Path) -> dict[str, float]:
    command = [os.environ["PYGT3X_PYTHON"], "-c", PYGT3X, str(path)]
    answer = subprocess.run(command, check=True, capture_output=True, text=True)
    seconds, rows = answer.stdout.split()[-2:]
    return {
        "seconds": float(seconds),
        "rows": float(rows),
        "kernel_s": float("nan"),
        "peak_mib": float("nan"),
    }


def compare(path: Path) -> None:
    names = [*READERS] if path.suffix == ".csv" else [*OURS]
    rounds: dict[str, list[dict[str, float]]] = {name: [] for name in names}
    if path.suffix == ".gt3x" and "PYGT3X_PYTHON" in os.environ:
        rounds["pygt3x, primary"] = []
    for _ in range(ROUNDS):
        for name, found in rounds.items():
            found.append(measure(name, path) if name in READERS else measure_pygt3x(path))
    medians = {name: statistics.median(one["seconds"] for one in found) for name, found in rounds.items()}
    print(f"{path.name}, {path.stat().st_size / 1e6:.0f} MB, medians of {ROUNDS} rounds, one core")
    for name, found in rounds.items():
        peak_mib = max(one["peak_mib"] for one in found)
        print(
            f"  {name:22s} {medians[name]:7.3f} s   {medians[name] / medians['acromion']:5.2f} x ours"
            f"   {statistics.median(one['kernel_s'] for one in found):6.3f} s of it in the kernel"
            f"   {int(found[0]['rows']):9d} rows   peak {peak_mib:6.0f} MiB"
        )
    for name in OURS:
        samples_mib = rounds[name][0]["rows"] * 24 / 2**20
        above = max(one["peak_mib"] for one in rounds[name]) - samples_mib
        print(f"  {name}: peak {above:.0f} MiB above the {samples_mib:.0f} MiB of samples")
    if "newline count" in medians:
        fastest = min(medians[name] for name in ("pandas C", "pyarrow", "polars"))
        for name in OURS:
            print(
                f"  {name}: {fastest / medians[name]:.2f} x faster than the fastest peer, "
                f"{medians[name] / medians['newline count']:.2f} x the newline count"
            )


def main() -> None:
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    if len(sys.argv) == 4 and sys.argv[1] == "--one":
        run_one(sys.argv[2], Path(sys.argv[3]))
        return
    for path in map(Path, sys.argv[1:]):
        compare(path)


if __name__ == "__main__":
    main()
