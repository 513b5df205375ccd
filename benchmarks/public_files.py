"""Inspect folders of public recordings, and write each outcome to ``benchmarks/public_files.csv``.

python -m benchmarks.public_files FOLDER [FOLDER ...]

A folder contains one folder for each source (`OWNER+NAME` of a repository), with its recordings and a file
`LICENCE` of one line. `answers.json` beside them contains a person's answers to what the files leave out:
rate, sensor, units. ``docs/reference/formats.md`` shows the outcome as a table.
"""

import csv
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from acromion.fusion.devices import find_device_name
from acromion.fusion.errors import FusionError
from acromion.fusion.readers import ColumnProfile, propose_profile, read_recording
from acromion.fusion.readers.source import HEAD_BYTES
from acromion.fusion.readers.tables.columns import parse_column_name
from acromion.fusion.recording import Recording

LICENCE, ANSWERS = "LICENCE", "answers.json"
FOUND = Path(__file__).with_suffix(".csv")
COLUMNS = ("source", "licence", "file", "read", "device", "units", "changed")
LONGEST_NAME = 40
LEFT_ASIDE = {LICENCE, ANSWERS}
OTHER_SUFFIXES = {".md", ".pdf", ".json", ".npz", ".bvh"}


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome for one file: the columns of the table after its name."""

    read: str
    device: str = ""
    units: str = ""
    changed: str = ""


def find_files(folder: Path) -> Iterator[Path]:
    """Yield the recordings of a source, in order."""
    for path in sorted(folder.iterdir()):
        is_licence = path.name in LEFT_ASIDE or path.name.upper().startswith("LICENSE")
        if path.is_file() and not is_licence and path.suffix.lower() not in OTHER_SUFFIXES:
            yield path


def inspect(path: Path, answers: dict[str, Any]) -> Outcome:
    """Read a file; if ``answers`` has an answer for it, read it again with the answer."""
    try:
        return describe(read_recording(path))
    except FusionError as refusal:
        asked, first = str(refusal.code), describe_refusal(refusal)
    answer = answers.get(f"{path.parent.name}/{path.name}", {})
    if not answer:
        return first
    try:
        read = describe(
            read_recording(path, rate_hz=answer.get("rate_hz"), profile=answer_columns(path, answer))
        )
    except FusionError as refusal:
        second = describe_refusal(refusal)
        return Outcome(f"{asked}, then {second.read}")
    units = "asked" if "acceleration_unit" in answer else read.units
    return Outcome(f"asked ({asked}), then yes", read.device, units, read.changed)


def answer_columns(path: Path, answer: dict[str, Any]) -> ColumnProfile | None:
    """Return the columns as the page proposes them, with the sensor and the units of the answer."""
    stated = {name: value for name, value in answer.items() if name != "rate_hz"}
    if not stated or "sensor" in stated:
        return ColumnProfile(**stated) if stated else None
    proposed = propose_profile(path.read_bytes()[:HEAD_BYTES]).profile
    return replace(proposed, **stated) if proposed else None


def describe_refusal(refusal: FusionError) -> Outcome:
    """Return the code, with the facts that name the cause."""
    facts = ", ".join(
        f"{name} {value}" for name, value in refusal.facts.items() if name in {"kind", "g", "dps"}
    )
    return Outcome(f"{refusal.code}{f' ({facts})' if facts else ''}")


def describe(recording: Recording) -> Outcome:
    """Return the device, the source of each unit, and the changes to the samples."""
    device = find_device_name(recording.device) or recording.device
    sources = [find_source(recording, name) for name in ("acceleration", "angular rate")]
    units = ", ".join(dict.fromkeys(sources))
    changes = [
        f"{flag.facts['what']} {flag.facts.get('factor', '')}".strip()
        for flag in recording.flags
        if flag.code == "W-UNITS" and flag.facts.get("what") not in find_unstated(recording)
    ]
    return Outcome("yes", device, units, "; ".join(changes) or "no")


def find_unstated(recording: Recording) -> set[str]:
    """Return the sensors without a stated unit; determining their unit changes no correct value."""
    names = {"acceleration": "acceleration_unit", "angular rate": "angular_rate_unit"}
    return {name for name, key in names.items() if not recording.understood.get(key, "-")}


def find_source(recording: Recording, sensor: str) -> str:
    """Return the source of a sensor's unit: header, device, or motion (rest and turns)."""
    if sensor not in find_unstated(recording):
        channel = "acc" if sensor == "acceleration" else "gyr"
        columns = map(parse_column_name, recording.understood.get("columns", "").split(", "))
        is_named = any(column.channel == channel and column.unit for column in columns)
        return "header" if is_named else "device"
    found = [flag for flag in recording.flags if flag.code == "W-UNITS" and flag.facts.get("what") == sensor]
    return str(found[0].facts["evidence"]) if found else "motion"


def main() -> None:
    """Write the outcomes."""
    with FOUND.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        for root in map(Path, sys.argv[1:]):
            table.writerows(inspect_folder(root))


def inspect_folder(root: Path) -> Iterator[list[str]]:
    """Return the row of each recording of a folder of sources."""
    answers = json.loads((root / ANSWERS).read_text()) if (root / ANSWERS).exists() else {}
    for folder in sorted(path for path in root.iterdir() if path.is_dir()):
        licence = (folder / LICENCE).read_text().strip() if (folder / LICENCE).exists() else "shared"
        for path in find_files(folder):
            found = inspect(path, answers)
            name = path.name.split("__")[-1][-LONGEST_NAME:]
            source = folder.name.replace("+", "/")
            yield [source, licence, name, found.read, found.device, found.units, found.changed]


if __name__ == "__main__":
    main()
