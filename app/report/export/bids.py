"""Angles of finished analyses as a Motion-BIDS dataset: the derivative form, one folder per subject.

Subjects are codes in letters and digits, as BIDS requires; the dataset contains no file name and no serial
number. Each row of ``elevation.parquet`` is a row of ``_motion.tsv``: seconds from the first sample
(``latency``), the angle (``n/a`` if none was measured) and whether the figures count it. Gaps are not filled:
they are steps in ``latency``. Format: BIDS 1.10, motion.
"""

import io
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, count
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pcsv
import pyarrow.parquet as pq

from acromion.app.report.export.tables import Cell, name_variables, type_further
from acromion.app.report.figures import Results
from acromion.app.request import find_code
from acromion.app.version import software_version

TRACKING = "acromion"
TASK = "work"
_BIDS_VERSION = "1.10.0"
_LATENCY, _ELEVATION, _VALID = "latency", "elevation", "valid"


@dataclass(frozen=True, slots=True)
class Angles:
    """One finished analysis: its results, its ``elevation.parquet``, and its further cells.

    ``further``: cells of the list of participants by header, which become columns.
    """

    results: Results
    parquet: Path
    further: Mapping[str, str] = field(default_factory=dict, hash=False)


@dataclass(frozen=True, slots=True)
class _Run:
    """One analysis, its subject, its day (``ses-01``), and the prefix of its file names."""

    angles: Angles
    subject: str
    session: str
    stem: str


def list_bids(every: Sequence[Angles]) -> Iterator[tuple[str, bytes]]:
    """Return the files of the dataset by path; the same analyses give the same bytes."""
    runs = list(_place(every))
    dataset = {
        "Name": "Upper-arm elevation",
        "BIDSVersion": _BIDS_VERSION,
        "DatasetType": "derivative",
        "GeneratedBy": [{"Name": "Acromion", "Version": software_version()}],
    }
    yield "dataset_description.json", _encode_json(dataset)
    yield "README.md", _README.encode()
    codes = {run.subject: run.angles.results["recording"]["subject"] or "n/a" for run in runs}
    columns, cells = type_further({run.stem: _name_cells(run.angles) for run in runs})
    names = [column.name for column in columns]
    carried = {stem: tuple(_write_cell(row.get(name)) for name in names) for stem, row in cells.items()}
    described = {name: {"Description": "From the list of participants, as given"} for name in names}
    participants = [
        (f"sub-{subject}", code, *_find_common(carried[run.stem] for run in runs if run.subject == subject))
        for subject, code in codes.items()
    ]
    yield "participants.tsv", _encode_rows(("participant_id", "code", *names), participants)
    code = {"Description": "Subject code as it was given"}
    yield "participants.json", _encode_json({"code": code, **described})
    for subject in codes:
        own = [run for run in runs if run.subject == subject]
        sessions = dict.fromkeys(run.session for run in own)
        yield (
            f"sub-{subject}/sub-{subject}_sessions.tsv",
            _encode_rows(("session_id",), [(name,) for name in sessions]),
        )
        for name in sessions:
            scans = []
            for run in own:
                if run.session == name:  # the start is by the clock of the device
                    start = (run.angles.results["recording"]["start"] or "n/a")[:19]
                    scans.append((f"motion/{run.stem}_motion.tsv", start, *carried[run.stem]))
            stem = f"sub-{subject}/{name}/sub-{subject}_{name}_scans"
            yield f"{stem}.tsv", _encode_rows(("filename", "acq_time", *names), scans)
            if described:
                yield f"{stem}.json", _encode_json(described)
    for run in runs:
        stem = f"sub-{run.subject}/{run.session}/motion/{run.stem}"
        yield f"{stem}_motion.json", _encode_json(_describe_motion(run.angles))
        yield f"{stem}_channels.tsv", _encode_channels(run.angles.results)
        yield f"{stem}_motion.tsv", _encode_motion(run.angles.parquet)


def _name_cells(angles: Angles) -> dict[str, str]:
    """Return the further cells by the names of their columns, each on one line."""
    return {
        name: " ".join(angles.further[header].split())
        for name, header in name_variables(angles.further).items()
    }


def _write_cell(value: Cell) -> str:
    return "n/a" if value is None else str(value)


def _find_common(rows: Iterable[Sequence[str]]) -> tuple[str, ...]:
    """Return the cell of each column that all rows share; "n/a" for a column in which they differ."""
    return tuple(cells[0] if len(set(cells)) == 1 else "n/a" for cells in zip(*rows, strict=True))


def _place(every: Sequence[Angles]) -> Iterator[_Run]:
    """Return each analysis with its subject, its day, and a number among those of one arm on this day.

    Days are numbered for each subject in order of time; recordings without a clock follow, each as a day.
    Codes are reduced to letters and digits; codes that then become equal are numbered. Recordings without a
    code count as different people.
    """
    coded = []
    for angles in every:
        recording = angles.results["recording"]
        code = find_code(recording["subject"]) or f"r{recording['sha256'][:12]}"
        start = recording["start"] or ""
        coded.append((code, not start, start[:10] or recording["sha256"], start, recording["sha256"], angles))
    labels: dict[str, str] = {}
    days: dict[str, list[str]] = {}
    counts: Counter[tuple[str, str, str | None]] = Counter()
    for code, _, day, _, _, angles in sorted(coded, key=lambda one: one[:5]):
        if code not in labels:
            plain = re.sub(r"[^A-Za-z0-9]", "", code) or "subject"
            numbered = (f"{plain}x{number}" for number in count(2))
            labels[code] = next(label for label in chain([plain], numbered) if label not in labels.values())
        subject, side = labels[code], angles.results["recording"]["side"]
        if day not in days.setdefault(subject, []):
            days[subject].append(day)
        session = f"ses-{days[subject].index(day) + 1:02d}"
        counts[subject, session, side] += 1
        arm, number = f"_acq-{side}" if side else "", f"{counts[subject, session, side]:02d}"
        stem = f"sub-{subject}_{session}_task-{TASK}_tracksys-{TRACKING}{arm}_run-{number}"
        yield _Run(angles, subject, session, stem)


_README = """# Upper-arm elevation

The angle between the upper arm and gravity (0 deg hanging, 90 deg level, 180 deg overhead), estimated by
Acromion from a motion sensor on the upper arm. `ses` is the day, `acq` the arm; each recording is one run.
With `acq-trunk` the sensor was on the trunk, and the angle is its inclination.

Columns of each `_motion.tsv`, in order: seconds from the first sample, elevation in degrees (`n/a`: not
measured), 1 if the figures count the row and 0 if they do not. Missing time is a step in the first column.
"""


def _describe_motion(angles: Angles) -> dict[str, Any]:
    recording, method = angles.results["recording"], angles.results["method"]
    time_us = pq.read_table(angles.parquet, columns=["time_us"])["time_us"].combine_chunks()
    rate_hz = 1.0
    if len(time_us) > 1:  # from the most common step between two rows
        steps = pc.subtract(time_us.slice(1), time_us.slice(0, len(time_us) - 1))
        rate_hz = round(1e6 / pc.quantile(steps, 0.5, interpolation="nearest")[0].as_py(), 6)
    return {
        "TaskName": TASK,
        "TaskDescription": "Work, as recorded over a shift",
        "SamplingFrequency": rate_hz,
        "SamplingFrequencyEffective": rate_hz,
        "TrackingSystemName": TRACKING,
        "DeviceSerialNumber": recording["serial_hash"] or "n/a",
        "ManufacturersModelName": recording["device"],
        "SoftwareVersions": software_version(),
        "RecordingType": "discontinuous" if angles.results["time"]["missing_s"] else "continuous",
        "RecordingDuration": angles.results["time"]["recorded_s"],
        "MotionChannelCount": 3,
        "ORNTChannelCount": 1,
        "LATENCYChannelCount": 1,
        "MISCChannelCount": 1,
        "TrackedPointsCount": 1,
        "MissingValues": "n/a if no sample was measured; missing time is a step in latency",
        "ElevationMethod": f"{method['name']} {method['version']}" if method else "n/a",
        "SampleCount": len(time_us),
    }


def _encode_channels(results: Results) -> bytes:
    side = results["recording"]["side"]
    body = "trunk" if side == "trunk" else "upper arm"
    point = f"{side}_upper_arm" if side in {"left", "right"} else body.replace(" ", "_")
    columns = ("name", "component", "type", "tracked_point", "units", "description")
    rows = (
        (_LATENCY, "n/a", "LATENCY", "n/a", "s", "Time from the first sample"),
        (_ELEVATION, "n/a", "ORNT", point, "deg", f"Angle between the {body} and gravity"),
        (_VALID, "n/a", "MISC", point, "n/a", "1: the figures count the row; 0: they do not"),
    )
    return _encode_rows(columns, rows)


def _encode_motion(parquet: Path) -> bytes:
    """Encode the rows without a header, as BIDS requires."""
    table = pq.read_table(parquet)
    angle_deg = pc.cast(pc.divide(pc.cast(table["elevation_cdeg"], pa.float64()), 100.0), pa.string())
    columns = [
        pc.divide(pc.cast(table["time_us"], pa.float64()), 1e6),
        pc.fill_null(angle_deg, "n/a"),
        pc.cast(table["analysed" if "analysed" in table.column_names else "valid"], pa.int8()),
    ]
    body = io.BytesIO()
    options = pcsv.WriteOptions(include_header=False, delimiter="\t", quoting_style="none")
    pcsv.write_csv(pa.Table.from_arrays(columns, [_LATENCY, _ELEVATION, _VALID]), body, options)
    return body.getvalue()


def _encode_rows(names: Sequence[str], rows: Iterable[Sequence[str]]) -> bytes:
    return "".join("\t".join(line) + "\n" for line in (names, *rows)).encode()


def _encode_json(value: Any) -> bytes:
    return (json.dumps(value, ensure_ascii=False, indent=1) + "\n").encode()
