"""Simulate the paper's study: five people, ten tasks, both devices, through ``acromion validate``.

    python -m benchmarks.validation_study DIR [people]

Writes DIR/study: the files of a laboratory, with recordings as the devices write them, task lists, and an
MVNX for each person whose clock started some seconds earlier and has another rate. Compares it into
DIR/result-METHOD. The MVNX contains the simulated truth, so the errors are those of sensors and fusion alone.
"""

import csv
import sys
from pathlib import Path

import numpy as np
import typer

from app.cli import app
from fusion.simulation import SimulatedShift, write_shift
from fusion.simulation.sensor import Device
from tests.simulated_mvnx import write_mvnx
from tests.simulated_shifts import play_shift
from tests.simulated_tasks import LOWERING_S, TITLES, simulate_session

DEVICES: tuple[Device, ...] = ("gt9x", "lsm9ds1")
MVN_RATE_HZ = 60.0
HELD_TASKS, RAISING_S = (2, 5), 1.5
"""Tasks with the arm held level: raising and lowering are excluded, because the paper's table has NA for
r.
"""


def write_study(folder: Path, people: int) -> None:
    """Write one folder for each person."""
    for person in range(1, people + 1):
        own = folder / f"P{person:02d}"
        own.mkdir(parents=True, exist_ok=True)
        for device in DEVICES:
            shift = simulate_session(person, device, seated=True)
            paths = write_shift(own / "written", shift, actilife_csv=False)
            paths[0].rename(own / f"{device}{paths[0].suffix}")
        for left in (own / "written").iterdir():
            left.unlink()
        (own / "written").rmdir()
        write_tasks(own / "tasks.csv", shift)
        write_reference(own / "reference.mvnx", shift, person)


def write_tasks(path: Path, shift: SimulatedShift) -> None:
    """Write every repetition; one of a held task from when the arm is up until it is lowered."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("name", "start_s", "end_s", "paper_task"))
        for entry in shift.plan:
            if entry.name.startswith("repetition"):
                number = int(entry.name.split()[1])
                held = number in HELD_TASKS
                start_s = entry.start_s + (RAISING_S if held else 0.0)
                end_s = entry.end_s + (0.0 if held else LOWERING_S)
                writer.writerow((f"{number} {TITLES[number]}", f"{start_s:.3f}", f"{end_s:.3f}", number))


def write_reference(path: Path, shift: SimulatedShift, person: int) -> None:
    """Write the truth as MVN: started 5 to 25 s earlier, with a clock error of 10 to 50 ppm."""
    arrays = play_shift(shift)
    offset_s, drift_ppm = 5.0 * person, 10.0 * person * (-1) ** person
    last_s = len(arrays.elevation_deg) / arrays.rate_hz - 0.5
    time_s = np.arange(int((offset_s + last_s) * MVN_RATE_HZ)) / MVN_RATE_HZ
    recording_s = (time_s - offset_s) / (1.0 + drift_ppm / 1e6)
    own_s = np.arange(len(arrays.elevation_deg)) / arrays.rate_hz
    write_mvnx(path, np.interp(recording_s, own_s, arrays.elevation_deg), MVN_RATE_HZ)


def main(folder: Path, people: int = 5) -> None:
    write_study(folder / "study", people)
    for method in ("smoothed", "published"):
        out = folder / f"result-{method}"
        command = ["validate", str(folder / "study"), "-o", str(out), "--method", method]
        typer.echo("acromion " + " ".join(command))
        app(command, standalone_mode=False)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
