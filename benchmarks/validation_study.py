"""Simulate the paper's study: five people, ten tasks, both devices, through ``acromion validate``.

    python -m benchmarks.validation_study DIR [people]

DIR/study is what a laboratory would have: the recordings as the devices write them, the lists of tasks, and
an MVNX for each person. Its clock starts some seconds earlier and runs at another rate. The comparison goes
to DIR/result-METHOD. The MVNX contains the simulated truth: the errors are those of sensors and fusion alone.
With five people, the tables also go to ``docs/reference/validation-study.md``.
"""

import csv
import sys
from pathlib import Path

import numpy as np
import typer

from acromion.app.cli import app
from acromion.fusion.simulation import SimulatedShift, write_shift
from acromion.fusion.simulation.sensor import Device
from tests.simulated_mvnx import write_mvnx
from tests.simulated_shifts import play_shift
from tests.simulated_tasks import LOWERING_S, TITLES, simulate_session

DEVICES: tuple[Device, ...] = ("gt9x", "lsm9ds1")
MVN_RATE_HZ = 60.0
METHODS = ("smoothed", "published")
PAPER_PEOPLE = 5
PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "validation-study.md"
TEXT = """Made from the code: `python -m benchmarks.validation_study DIR`

# The paper's study, simulated

Five simulated people do the ten tasks of Boyer et al. with both devices. The reference is an MVNX of the
exact angle that starts 5 to 25 s earlier, with a clock off by 10 to 50 ppm. Each cell is the mean over people
[standard deviation] (the paper's figure). The simulated arm is rigid and hangs plumb in the pose. The figures
therefore leave out skin and muscle, the error of the pose, and the reference's own error.
"""
HELD_TASKS, RAISING_S = (2, 5), 1.5
"""Tasks with the arm held level: raising and lowering are excluded; the paper's table has NA for r."""


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
    """Write every repetition; for a held task, only the time between raising and lowering the arm."""
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


def main(folder: Path, people: int = PAPER_PEOPLE) -> None:
    write_study(folder / "study", people)
    parts = [TEXT]
    for method in METHODS:
        out = folder / f"result-{method}"
        command = ["validate", str(folder / "study"), "-o", str(out), "--method", method]
        typer.echo("acromion " + " ".join(command))
        app(command, standalone_mode=False)
        parts.append(f"\n## {method}\n\n{draw_study(out)}")
    if people == PAPER_PEOPLE:
        PAGE.write_text("".join(parts), "utf-8")


def draw_study(result: Path) -> str:
    """Return a study's ``table.csv`` in Markdown: a row for each task, three figures for each device."""
    figures = {
        "r": (3, "r"),
        "rmse_deg": (2, "RMSE deg"),
        "mean_absolute_error_deg": (2, "mean abs. error deg"),
    }
    names = {"gt9x": "GT9X", "lsm9ds1": "LSM9DS1"}
    with (result / "table.csv").open(encoding="utf-8-sig", newline="") as file:
        rows = {(row["task"], row["device"]): row for row in csv.DictReader(file)}
    columns = [(figure, device) for figure in figures for device in DEVICES]
    lines = [
        "| task | " + " | ".join(f"{figures[one][1]}, {names[device]}" for one, device in columns) + " |"
    ]
    lines.append("|---" * (len(columns) + 1) + "|")
    for task in dict.fromkeys(task for task, _ in rows):
        cells = [_draw_cell(rows[task, device], figure, figures[figure][0]) for figure, device in columns]
        lines.append("| " + " | ".join([task, *cells]) + " |")
    return "\n".join(lines) + "\n"


def _draw_cell(row: dict[str, str], figure: str, decimals: int) -> str:
    mean, spread, paper = (row[name] for name in (f"{figure}_mean", f"{figure}_sd", f"paper_{figure}"))
    own = f"{float(mean):.{decimals}f} [{float(spread):.{decimals}f}]" if mean else "NA"
    return f"{own} ({float(paper):.{decimals}f})" if paper else f"{own} (NA)"


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
