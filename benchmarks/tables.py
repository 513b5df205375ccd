"""Measure the tables of a run of 1,000 recordings: ``python -m benchmarks.tables [--recordings 1000]``.

One simulated recording of six minutes is analysed, and its result copied: two arms for each of 500 people.
The tables are then written in a new process each time: first with every pair, then with nothing changed.
Peak memory is that of the process of the run and that of its largest child process.
"""

import argparse
import shutil
import tempfile
import time
from dataclasses import replace
from datetime import UTC, datetime
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from statistics import median

import psutil

from acromion.app.batch.folder import Task
from acromion.app.batch.run import Outcome
from acromion.app.request import ReportRequest
from acromion.fusion.conventions import Side

SIDES: tuple[Side, ...] = ("left", "right")
PERIOD_S = 0.1


def write_results(out: Path, recordings: int) -> list[Outcome]:
    """Write the folders of the recordings, without markers and reports; return their outcomes."""
    from acromion.app.analysis.run import make_report  # noqa: PLC0415  not in the measured process
    from acromion.fusion.simulation import simulate_shift, write_shift  # noqa: PLC0415

    made, outcomes = {}, []
    for rank in range(recordings):
        subject, side, folder = f"S{rank // 2:03}", SIDES[rank % 2], out / f"p{rank:04}"
        request = ReportRequest(f"p{rank:04}.gt3x", subject, side, languages=("en",), pose_held="start")
        folder.mkdir()
        if side not in made:
            (out / side).mkdir()
            recording, *_ = write_shift(
                out / side, simulate_shift("gt9x", 0.1, seed=rank), actilife_csv=False
            )
            make_report(recording, replace(request, kinds=()), folder, lambda *_: None)
            made[side] = (folder, subject)
        else:
            first, named = made[side]
            results = (first / "results.json").read_text("utf-8").replace(f'"{named}"', f'"{subject}"')
            (folder / "results.json").write_text(results, "utf-8")
            shutil.copy(first / "elevation.parquet", folder)
        outcomes.append(Outcome(Task(Path(request.file_name), request, folder)))
    return outcomes


def write_once(out: Path, outcomes: list[Outcome], pipe: Connection) -> None:
    """Write the tables; send the time in s (wall, processor)."""
    from acromion.app.batch.tables import write_tables  # noqa: PLC0415  its memory is measured

    began_s = time.perf_counter()
    write_tables(out, outcomes, ReportRequest(""), datetime.now(UTC))
    pipe.send((time.perf_counter() - began_s, time.process_time()))


def measure(out: Path, outcomes: list[Outcome]) -> tuple[float, float, float, float]:
    """Return the time in s (wall, processor) and the peak memory in MB (the process, its largest child)."""
    ours, theirs = get_context("spawn").Pipe(duplex=False)
    process = get_context("spawn").Process(target=write_once, args=(out, outcomes, theirs))
    process.start()
    watched, peaks_mb = psutil.Process(process.pid), [0.0, 0.0]
    while not ours.poll(PERIOD_S):
        for place, some in enumerate(([watched], watched.children(recursive=True))):
            for one in some:
                try:
                    peaks_mb[place] = max(peaks_mb[place], one.memory_info().rss / 1e6)
                except psutil.Error:
                    continue
    wall_s, cpu_s = ours.recv()
    process.join()
    return wall_s, cpu_s, peaks_mb[0], peaks_mb[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        out = Path(place)
        outcomes = write_results(out, asked.recordings)
        first = measure(out, outcomes)
        again = [measure(out, outcomes) for _ in range(asked.runs)]
        medians = tuple(median(values) for values in zip(*again, strict=True))
    for name, (wall_s, cpu_s, peak_mb, child_mb) in (("first", first), ("again", medians)):
        shown = f"{wall_s:.1f} s, CPU {cpu_s:.1f} s, peak {peak_mb:.0f} MB, largest child {child_mb:.0f} MB"
        print(f"{name}: {shown}", flush=True)


if __name__ == "__main__":
    main()
