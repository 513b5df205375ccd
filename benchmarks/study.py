"""Make the study of a paper from simulated raw files, and recompute its table apart.

    python -m benchmarks.study FOLDER [PEOPLE] [RATE_HZ]

Each person (40 by default) wears one of two devices on the right arm on two days, and every second person
also on the left arm; people have one of two jobs. One file in twenty is cut short, one is stored twice, and
one in twenty people withdraws after a first run. `acromion run`, `docs/code/paper.py` and, if R is installed,
`docs/code/paper.R` then make table, figure and methods. Every number of the table is computed again from the
angle files by other code: scipy's filter, and the formulas of the books.

Days have just over four hours, the least that counts, at a low rate (25 Hz), to save time.
"""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from scipy import signal, stats

from acromion.fusion.recording import Float64Array
from acromion.fusion.simulation import simulate_shift, write_shift
from acromion.fusion.simulation.sensor import Device

ROOT = Path(__file__).resolve().parents[1]
CODE = ROOT / "docs" / "code"
HOURS = 4.1
DEVICES: tuple[Device, ...] = ("lsm9ds1", "gt9x")
JOBS = (("Painter", "7131"), ("Carpenter", "7115"))
NUMBER = re.compile(r"\d+\.\d+|\d+")
COLUMNS = ("file", "subject", "side", "calibration", "job", "isco")


@dataclass(frozen=True, slots=True)
class Worn:
    """A recording of the study: its file, and what the list of participants states."""

    path: Path
    subject: str
    side: str
    calibration: str
    job: str
    isco: str


def simulate_study(
    folder: Path, people: int, rate_hz: float, sides: tuple[str, ...] = ("right", "left")
) -> list[Worn]:
    """Write the recordings and the list of participants; some are damaged and doubled."""
    made = list(_simulate(folder, people, rate_hz, sides))
    for rank, one in enumerate(made[::20]):  # of unequal lengths, else they would be doubles
        one.path.write_bytes(one.path.read_bytes()[: 60 + rank])
    for one in made[1::20]:
        shutil.copy(one.path, one.path.with_name(f"copy_of_{one.path.name}"))
    with (folder / "people.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        rows.writerows(
            [one.path.name, one.subject, one.side, one.calibration, one.job, one.isco] for one in made
        )
    return made


def _simulate(folder: Path, people: int, rate_hz: float, sides: tuple[str, ...]) -> Iterator[Worn]:
    for person in range(people):
        device, job = DEVICES[person % 2], JOBS[person // 2 % 2]
        for day in range(2):
            for side in sides[: 1 + person % 2]:
                seed = 1 + 4 * person + 2 * day + (side == "left")
                shift = simulate_shift(device, HOURS, seed, rate_hz)
                shift = replace(shift, start=shift.start + timedelta(days=day))
                written = write_shift(folder / "parts", shift, actilife_csv=False)[0]
                name = f"P{person + 1:02d}_day{day + 1}_{side}{written.suffix}"
                start_s, end_s = shift.calibration_s
                path = written.replace(folder / name)
                yield Worn(path, f"P{person + 1:02d}", side, f"{start_s:.0f}-{end_s:.0f}", *job)
    shutil.rmtree(folder / "parts")


def call(*words: str | Path, cwd: Path) -> str:
    """Run a program in a folder; return its output. Exit code 1 means that recordings failed."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"}
    command = [str(word) for word in words]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    if done.returncode > 1:
        raise RuntimeError(done.stderr)
    return done.stdout


def analyse_study(data: Path, out: Path) -> None:
    """Run the analysis as a person types it."""
    options = ("--participants", data / "people.csv", "--report", "html")
    call(sys.executable, "-m", "acromion", "run", data, "-o", out, *options, cwd=data)


def write_paper(out: Path) -> str:
    """Run the script of a researcher beside the results; return its output."""
    return call(sys.executable, CODE / "paper.py", out, cwd=out.parent)


def compare_tables(folder: Path) -> list[tuple[str, str, str, float, float]]:
    """Return every number of the table: job, figure, column, as printed, and computed apart."""
    with (folder / "table.csv").open(encoding="utf-8") as file:
        printed = {(row["job"], row["figure"]): row for row in csv.DictReader(file)}
    apart = recompute(folder / "out")
    if printed.keys() != apart.keys():
        raise ValueError(f"rows of the table {[*printed]}, computed apart {[*apart]}")
    return [
        (*key, column, float(shown), number)
        for key, columns in apart.items()
        for column, numbers in columns.items()
        for shown, number in zip(NUMBER.findall(printed[key][column]), numbers, strict=True)
    ]


def recompute(out: Path) -> dict[tuple[str, str], dict[str, list[float]]]:
    """Compute the columns of the table from the angle files of the recordings of the last run."""
    people: dict[tuple[str, str], dict[str, list[float]]] = {}
    for one in json.loads((out / "run.json").read_bytes())["recordings"]:
        if one["code"] or one["side"] != "right" or not one["subject"]:
            continue
        results = json.loads((out / one["folder"] / "results.json").read_bytes())
        if results["quality"]["verdict"] == "poor" or results["time"]["analysed_s"] < 4 * 3600:
            continue
        job = results["recording"]["job_title"]
        for figure, value in _measure(out / one["folder"] / "elevation.parquet").items():
            people.setdefault((job, figure), {}).setdefault(one["subject"], []).append(value)
    return {key: _split(list(values.values())) for key, values in people.items()}


def _measure(path: Path) -> dict[str, float]:
    """Return the figures of one angle file; a step of more than one and a half periods begins a new run."""
    table = pq.read_table(path)
    time_s = table["time_us"].to_numpy() / 1e6
    angle_deg = table["elevation_cdeg"].to_numpy() / 100.0
    period_s = float(np.median(np.diff(time_s)))
    cuts = np.flatnonzero(np.diff(time_s) > 1.5 * period_s) + 1
    sections = signal.butter(2, 5.0, fs=1.0 / period_s, output="sos")
    runs = [run for run in np.split(angle_deg, cuts) if len(run)]
    filtered = np.concatenate([signal.sosfiltfilt(sections, run) if len(run) > 30 else run for run in runs])
    counted = filtered[table["analysed"].to_numpy()]
    shares = {f"Time above {c}°, %": float(100.0 * np.mean(counted >= c)) for c in (30, 60, 90)}
    return shares | {"Median elevation, °": float(np.median(counted))}


def _split(series: list[list[float]]) -> dict[str, list[float]]:
    """Return the columns of the table by one-way analysis of variance, with their ranges."""
    means: Float64Array = np.array([np.mean(values) for values in series])
    sizes: Float64Array = np.array([len(values) for values in series], float)
    every = np.concatenate(series)
    others, rest = len(series) - 1, len(every) - len(series)
    columns = {"people": [float(len(series))], "days": [float(len(every))], "mean": [float(means.mean())]}
    columns |= {"sd_between": [], "sd_within": []}
    tails = np.array([0.975, 0.025])
    if others:
        half = float(stats.t.ppf(0.975, others)) * float(np.std(means, ddof=1)) / len(series) ** 0.5
        columns["mean"] += [max(columns["mean"][0] - half, 0.0), columns["mean"][0] + half]
    if rest:
        squares = sum(float(np.var(values)) * len(values) for values in series)
        columns["sd_within"] = [
            (squares / rest) ** 0.5,
            *np.sqrt(squares / stats.chi2.ppf(tails, rest)).tolist(),
        ]
    if rest and others:
        within = squares / rest
        between = float(np.sum(sizes * (means - every.mean()) ** 2)) / others
        typical = (len(every) - float(np.sum(sizes**2)) / len(every)) / others
        columns["sd_between"] = [max((between - within) / typical, 0.0) ** 0.5]
        mean_days = float(stats.hmean(sizes))
        above = mean_days * np.var(means, ddof=1) - stats.f.ppf(tails, others, rest) * within
        ends = np.sqrt(np.maximum(above, 0.0) * others / (mean_days * stats.chi2.ppf(tails, others))).tolist()
        columns["sd_between"] += ends if ends[1] > 0.0 else []
    return columns


def main() -> None:
    folder = Path(sys.argv[1])
    people, rate_hz = (float(word) for word in (*sys.argv[2:4], "40", "25")[:2])
    data, out = folder / "data", folder / "out"
    made = simulate_study(data, int(people), rate_hz)
    analyse_study(data, out)
    for one in [one for one in made if int(one.subject[1:]) % 20 == 2]:
        one.path.unlink(missing_ok=True)  # withdrawn
        (data / f"copy_of_{one.path.name}").unlink(missing_ok=True)
    analyse_study(data, out)
    print(write_paper(out))
    if shutil.which("Rscript"):
        print(call("Rscript", CODE / "paper.R", out, cwd=folder))
    compared = compare_tables(folder)
    largest = max(compared, key=lambda one: abs(one[3] - one[4]))
    print(f"{len(compared)} numbers computed apart; the largest difference: {largest}")


if __name__ == "__main__":
    main()
