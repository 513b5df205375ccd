"""Read a file as a request asks, and inspect it: what it is, without analysing it."""

import json
import logging
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.request import OnStage, ReportRequest
from app.store.decoded import hash_entry_key
from app.store.folder import KnownLogs, hash_file
from app.version import identify_engine
from fusion.angle_files import AngleFile, read_angle_file, recognise_layout, resample_file
from fusion.caveats import Caveat
from fusion.errors import FailedReader, FusionError
from fusion.pose.calibrate import propose_poses
from fusion.quality.time_account import find_exclusions, propose_nonwear
from fusion.readers import identify_header, join_recordings, parse_profile, read_recording
from fusion.readers.preview import MAX_GAPS, inspect_recording, preview_head
from fusion.readers.tables.profile import propose_file_profile
from fusion.recording import MICROSECONDS, Recording, find_uncovered

_FAILED = "the reader plug-in %s %s failed: %s"

logger = logging.getLogger(__name__)


def read_logs(log: Path, request: ReportRequest, known: KnownLogs) -> Recording:
    """Read the log of a request and those joined to it; or take what an earlier reading of the bytes kept."""
    paths = (log, *map(Path, request.joined))
    recordings = []
    for path, digest in zip(paths, known.digests or ("",) * len(paths), strict=True):
        asked = request if path is log else replace(request, file_name=path.name)
        if known.cache is None:
            recordings.append(read_file(path, asked, digest))
            continue
        sha256 = digest or hash_file(path)
        reading = [Path(asked.file_name).suffix, request.rate_hz, request.profile]
        key = hash_entry_key(sha256, json.dumps(reading), identify_engine())
        recording = known.cache.find(key)
        if recording is None:
            recording = read_file(path, asked, sha256)
            known.cache.keep(key, recording)
        recordings.append(recording)
    return join_recordings(recordings) if request.joined else recordings[0]


def read_file(path: Path, request: ReportRequest, sha256: str = "") -> Recording:
    """Read one file as a request asks, and log every plug-in that failed: a line, and the traceback as INFO.

    Raises fusion.errors.FusionError as :func:`fusion.readers.read_recording`; where the file is a table, its
    facts identify the header.
    """
    profile = parse_profile(request.profile) if request.profile else None
    with path.open("rb") as file:
        try:
            recording = read_recording(
                file, file_name=request.file_name, rate_hz=request.rate_hz, sha256=sha256, profile=profile
            )
        except FusionError as refusal:
            if isinstance(refusal, FailedReader):
                logger.error(_FAILED, *refusal.facts.values())
                logger.info("its traceback", exc_info=True)
            header = identify_header(file)
            refusal.facts |= {"header": header} if header else {}
            raise
    for flag in recording.flags:
        if flag.code == Caveat.READER:
            logger.error(_FAILED, *flag.facts.values())
    return recording


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
        proposal = asdict(propose_file_profile(file, request.file_name))
        header = identify_header(file)
    proposal |= {"header": header}
    (out / "columns.json").write_text(json.dumps(proposal), "utf-8")
