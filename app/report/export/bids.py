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
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pcsv
import pyarrow.parquet as pq

from app.report.export.tables import guard_text
from app.report.figures import Results
from app.request import find_code
from app.version import software_version

TRACKING = "acromion"
TASK = "work"
_BIDS_VERSION = "1.10.0"
_LATENCY, _ELEVATION, _VALID = "latency", "elevation", "valid"


@dataclass(frozen=True, slots=True)
class Angles:
    """One finished analysis: its results and its ``elevation.parquet``."""

    results: Results
    parquet: Path


@dataclass(frozen=True, slots=True)
class _Run:
    """One analysis, its subject, and the prefix of its file names."""

    angles: Angles
    subject: str
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
    participants = [(f"sub-{subject}", code) for subject, code in codes.items()]
    yield "participants.tsv", _encode_rows(("participant_id", "code"), participants)
    yield "participants.json", _encode_json({"code": {"Description": "Subject code as it was given"}})
    for subject in codes:
        scans = [  # start of each recording, by the clock of the device
            (f"motion/{run.stem}_motion.tsv", (run.angles.results["recording"]["start"] or "n/a")[:19])
            for run in runs
            if run.subject == subject
        ]
        yield f"sub-{subject}/sub-{subject}_scans.tsv", _encode_rows(("filename", "acq_time"), scans)
    for run in runs:
        stem = f"sub-{run.subject}/motion/{run.stem}"
        yield f"{stem}_motion.json", _encode_json(_describe_motion(run.angles))
        yield f"{stem}_channels.tsv", _encode_channels(run.angles.results)
        yield f"{stem}_motion.tsv", _encode_motion(run.angles.parquet)


def _place(every: Sequence[Angles]) -> Iterator[_Run]:
    """Return each analysis with its subject, and a number among those of the same arm, in order of time.

    Codes are reduced to letters and digits; codes that then become equal are numbered. Recordings without a
    code count as different people.
    """
    coded = []
    for angles in every:
        recording = angles.results["recording"]
        code = find_code(recording["subject"]) or f"r{recording['sha256'][:12]}"
        coded.append((code, recording["start"] or "", recording["sha256"], angles))
    labels: dict[str, str] = {}
    counts: Counter[tuple[str, str | None]] = Counter()
    for code, _, _, angles in sorted(coded, key=lambda one: one[:3]):
        if code not in labels:
            plain = re.sub(r"[^A-Za-z0-9]", "", code) or "subject"
            numbered = (f"{plain}x{number}" for number in count(2))
            labels[code] = next(label for label in chain([plain], numbered) if label not in labels.values())
        subject, side = labels[code], angles.results["recording"]["side"]
        counts[subject, side] += 1
        arm, number = f"_acq-{side}" if side else "", f"{counts[subject, side]:02d}"
        yield _Run(angles, subject, f"sub-{subject}_task-{TASK}_tracksys-{TRACKING}{arm}_run-{number}")


_README = """# Upper-arm elevation

The angle between the upper arm and gravity (0 deg hanging, 90 deg level, 180 deg overhead), estimated by
Acromion from a motion sensor on the upper arm. Each recording is one run; `acq` is the arm.

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
    point = f"{side}_upper_arm" if side else "upper_arm"
    columns = ("name", "component", "type", "tracked_point", "units", "description")
    rows = (
        (_LATENCY, "n/a", "LATENCY", "n/a", "s", "Time from the first sample"),
        (_ELEVATION, "n/a", "ORNT", point, "deg", "Angle between the upper arm and gravity"),
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
    lines = [names, *([guard_text(cell) for cell in row] for row in rows)]
    return "".join("\t".join(line) + "\n" for line in lines).encode()


def _encode_json(value: Any) -> bytes:
    return (json.dumps(value, ensure_ascii=False, indent=1) + "\n").encode()
