"""Inspect a file: what it is, without analysing it."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from app.analysis.reading import read_file
from app.request import OnStage, ReportRequest
from fusion.angle_files import AngleFile, read_angle_file, recognise_layout, resample_file
from fusion.pose.calibrate import propose_poses
from fusion.quality.time_account import find_exclusions, propose_nonwear
from fusion.readers import identify_header
from fusion.readers.preview import MAX_GAPS, inspect_recording, preview_head
from fusion.readers.source import open_source, unpack
from fusion.readers.tables.profile import propose_profile
from fusion.recording import MICROSECONDS, find_uncovered

MOST_ROUNDING_US = 2


def inspect_file(
    path: Path, rate_hz: float | None = None, profile: str = "", file_name: str = ""
) -> dict[str, Any]:
    """Read the file and describe what it holds, with proposals for the calibration window.

    ``profile``: JSON of a column profile, "" for none. ``file_name``: "" takes the path's own.

    Raises fusion.errors.FusionError if it is not a recording.
    """
    name = file_name or path.name
    with path.open("rb") as file:
        if recognise_layout(file, name) == "mvnx":
            return {"file": name} | _inspect_capture(read_angle_file(file, name))
    recording = read_file(path, ReportRequest(name, rate_hz=rate_hz, profile=profile))
    proposals = [
        {
            "start_s": round(p.still.start_s, 3),
            "duration_s": round(p.still.duration_s, 3),
            "score": round(p.still.score, 3),
            "kind": p.kind,
        }
        for p in propose_poses(recording)
    ]
    understood: dict[str, Any] = inspect_recording(recording, find_exclusions(recording))
    nonwear = [
        {"start_s": span.start_us / MICROSECONDS, "duration_s": span.duration_us / MICROSECONDS}
        for span in propose_nonwear(recording)
    ]
    proposed = {"calibration_proposals": proposals, "nonwear_proposals": nonwear}
    return {"file": name} | understood | proposed


def _inspect_capture(capture: AngleFile) -> dict[str, Any]:
    """Describe a motion capture under the names of a recording; it holds angles, and no samples."""
    recording, angles = resample_file(capture, np.zeros(len(capture.time_s)))
    runs = [
        (run.start_us, run.start_us + round(len(run) / run.rate_hz * MICROSECONDS)) for run in angles.segments
    ]
    gaps = [
        {"start_s": start_us / MICROSECONDS, "length_s": (end_us - start_us) / MICROSECONDS}
        for start_us, end_us in find_uncovered(runs, 0, recording.duration_us, MOST_ROUNDING_US)
    ]
    missing_s = sum(gap["length_s"] for gap in gaps)
    described: dict[str, Any] = inspect_recording(recording)
    return described | {
        "present_s": described["recorded_s"] - missing_s,
        "missing_s": missing_s,
        "gap_count": len(gaps),
        "gaps": gaps[:MAX_GAPS],
        "calibration_proposals": [],
        "nonwear_proposals": [],
    }


def write_inspection(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Inspect the file for somebody who waits in another process: ``inspection.json`` in ``out``."""
    on_stage("reading", 0.0)
    found = inspect_file(log, request.rate_hz, request.profile, request.file_name)
    (out / "inspection.json").write_text(json.dumps(found), "utf-8")


def write_preview(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Inspect the first bytes of a file that is still on its way."""
    on_stage("reading", 0.0)
    facts = preview_head(log.read_bytes(), request.file_name, request.rate_hz)
    start = facts.start.isoformat() if facts.start else None
    found = {"file": request.file_name, **asdict(facts), "start": start}
    (out / "inspection.json").write_text(json.dumps(found), "utf-8")


def write_column_proposal(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Write ``columns.json``: a table's header and its identity, its first rows, and what they may be.

    Raises fusion.errors.FusionError if it is no table of numbers.
    """
    on_stage("reading", 0.0)
    with log.open("rb") as file:
        head = unpack(open_source(file, request.file_name, is_hashed=False)).head
        header = identify_header(file)
    proposal = asdict(propose_profile(head)) | {"header": header}
    (out / "columns.json").write_text(json.dumps(proposal), "utf-8")
