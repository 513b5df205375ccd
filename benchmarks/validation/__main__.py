"""Write docs/reference/validation.md, whole or one section at a time.

    python -m benchmarks.validation --date 2026-11-21 [--only broad stress] [--details FILE] [--output FILE]

Sections: stated, sway, pose_error, soft_tissue, gait, tasks, broad, stress, shifts, speed, invariance,
good_sensors. With ``--only`` the other sections stay unchanged. ``--details`` writes the tables that the
document omits. The days of `stated` are stored in ``--logs`` and not run twice. Needs the `bench` extra (vqf,
ahrs, imufusion). All sections except speed are deterministic.
"""

import argparse
import platform
from collections.abc import Callable, Mapping
from functools import partial
from importlib.metadata import version
from pathlib import Path

from acromion.app.version import software_version, source_revision
from benchmarks.validation.document import (
    Section,
    assemble,
    find_sections,
    render_details,
    render_section,
)
from benchmarks.validation.gait import compare_gaits
from benchmarks.validation.good_sensors import compare_good_sensors
from benchmarks.validation.invariance import compare_changes
from benchmarks.validation.pose_error import compare_pose_error
from benchmarks.validation.recorded import compare_on_broad, stress
from benchmarks.validation.shifts import compare_on_shifts
from benchmarks.validation.soft_tissue import compare_soft_tissue
from benchmarks.validation.speed import compare_speed
from benchmarks.validation.stated import compare_on_stated
from benchmarks.validation.sway import compare_sway
from benchmarks.validation.tasks import compare_on_tasks

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data"
PACKAGES = ("numpy", "scipy", "numba", "vqf", "ahrs", "imufusion")
SECTIONS = (
    "stated",
    "sway",
    "pose_error",
    "soft_tissue",
    "gait",
    "tasks",
    "broad",
    "stress",
    "shifts",
    "speed",
    "invariance",
    "good_sensors",
)
PREFACE = """\
Made from the code: `python -m benchmarks.validation`

# Tables of the validation

Every figure compares the software with a reference: recorded human motion with a simulated sensor, a
simulated person, or optical motion capture (BROAD). No data come from a sensor worn by a real person beside a
reference for the upper arm. `smoothed` is the default for an uploaded recording, `published` is the algorithm
of Boyer, Frasie, Bouyer, Roy, Poitras and Campeau-Lecours, `live` uses past samples only.
[Validation](../validation.md) sums up the results, the limits and the goals that are missed. `--details FILE`
writes further tables."""


def main() -> None:
    arguments = _read_arguments()
    makers = _list_makers(arguments)
    output: Path = arguments.output
    sections = find_sections(output.read_text("utf-8"), tuple(makers)) if output.exists() else {}
    for name in arguments.only or makers:
        print(f"{name} ...", flush=True)
        section = makers[name]()
        sections[name] = render_section(name, section, _describe_makers(arguments.date))
        ordered = {known: sections[known] for known in makers if known in sections}
        output.write_text(assemble(PREFACE, ordered), "utf-8")
        if arguments.details:
            with arguments.details.open("a", encoding="utf-8") as details:
                details.write(render_details(section) + "\n\n")


def _read_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.validation")
    parser.add_argument("--only", nargs="+", choices=SECTIONS)
    parser.add_argument("--date", default="", help="printed with the sections created now")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "reference" / "validation.md")
    parser.add_argument("--details", type=Path)
    parser.add_argument("--logs", type=Path, help="folder to store the days of `stated`")
    parser.add_argument("--seeds-stated", type=int, default=4, help="days for each scenario, kind and device")
    parser.add_argument("--seeds", type=int, default=10, help="simulated shifts for each device")
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--long-hours", type=float, default=8.0)
    return parser.parse_args()


def _list_makers(arguments: argparse.Namespace) -> Mapping[str, Callable[[], Section]]:
    seeds = tuple(range(1, arguments.seeds + 1))
    logs, data = arguments.logs, arguments.data
    return {
        "stated": partial(compare_on_stated, data, arguments.seeds_stated, logs and logs / "stated.jsonl"),
        "sway": partial(compare_sway, data),
        "pose_error": partial(compare_pose_error, data, arguments.seeds_stated),
        "soft_tissue": partial(compare_soft_tissue, data / "skin_motion"),
        "gait": partial(compare_gaits, data / "real_motion"),
        "tasks": compare_on_tasks,
        "broad": partial(compare_on_broad, data / "broad"),
        "stress": partial(stress, data / "broad"),
        "shifts": partial(compare_on_shifts, seeds, arguments.hours, arguments.long_hours),
        "speed": compare_speed,
        "invariance": compare_changes,
        "good_sensors": partial(compare_good_sensors, data),
    }


def _describe_makers(date: str) -> str:
    """Return the versions of the software; sections may have been made at different times."""
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    own = f"acromion {software_version()}, revision {source_revision()}"
    return f"{own}, Python {platform.python_version()}, {packages}" + (f", on {date}" if date else "")


if __name__ == "__main__":
    main()
