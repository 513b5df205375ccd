"""Read the file of a request and describe it without an analysis."""

import json
import logging
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from acromion.app.request import BY_DIARY, OnStage, ReportRequest
from acromion.app.store.decoded import hash_entry_key
from acromion.app.store.folder import NOTHING_KNOWN, KnownFiles, hash_file
from acromion.app.version import identify_engine
from acromion.fusion.angle_files import AngleFile, read_angle_file, recognise_layout, resample_file
from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import ShiftWindow, correct_start, move_window, parse_interval
from acromion.fusion.errors import FailedReader, FusionError, UnusableShift
from acromion.fusion.exposure.periods import read_checked_diary
from acromion.fusion.pose.calibrate import propose_poses
from acromion.fusion.quality.time_account import find_exclusions, propose_nonwear
from acromion.fusion.readers import (
    identify_header,
    join_recordings,
    measure_extent,
    parse_profile,
    read_recording,
)
from acromion.fusion.readers.preview import MAX_GAPS, inspect_recording, preview_head
from acromion.fusion.readers.tables.profile import propose_file_profile
from acromion.fusion.readers.time.clock import set_clock
from acromion.fusion.readers.time.window import cut_recording
from acromion.fusion.recording import (
    MICROSECONDS,
    Extent,
    Recording,
    find_missing,
    find_uncovered,
    measure_samples,
)
from acromion.fusion.shifts import propose

_FAILED = "the reader plug-in %s %s failed: %s"

logger = logging.getLogger(__name__)


def read_joined(recording_path: Path, request: ReportRequest, known: KnownFiles) -> Recording:
    """Read the recording of a request and the files joined to it, from the cache if possible."""
    paths = (recording_path, *map(Path, request.joined))
    window, recordings = find_window(request), []
    request = replace(request, shift="") if request.joined else request  # cut once they are joined
    for path, digest in zip(paths, known.digests or ("",) * len(paths), strict=True):
        asked = request if path is recording_path else replace(request, file_name=path.name)
        if known.cache is None:
            recordings.append(read_file(path, asked, digest))
            continue
        sha256 = digest or hash_file(path)
        reading = [Path(asked.file_name).suffix, request.rate_hz, request.profile]
        reading += [asked.shift] if asked.shift else []
        key = hash_entry_key(sha256, json.dumps(reading), identify_engine())
        recording = known.cache.find(key)
        if recording is None:
            recording = read_file(path, asked, sha256)
            known.cache.keep(key, recording)
        recordings.append(recording)
    if not request.joined:
        return recordings[0]
    joined = join_recordings(recordings)
    return cut_recording(joined, window) if window else joined


def read_on_stated_clock(recording_path: Path, request: ReportRequest, known: KnownFiles) -> Recording:
    """Read the recording of a request; the window of a shift is on the clock that a person states."""
    window = find_window(request)
    if window is None or not (request.time_zone or request.clock_offset_s):
        return read_joined(recording_path, request, known)
    device = measure_recording(recording_path, replace(request, shift="")).start
    stated = correct_start(device, request.time_zone, request.clock_offset_s)
    if device is None or stated is None:
        raise UnusableShift(why="no clock", window=request.shift)
    on_device = replace(request, shift=str(move_window(window, stated, device)))
    try:
        recording = read_joined(recording_path, on_device, known)
    except UnusableShift as refusal:  # name the hours by the stated clock
        raise UnusableShift(**refusal.facts | {"window": request.shift}) from None
    return set_clock(recording, request.time_zone, request.clock_offset_s, device)


def find_window(request: ReportRequest) -> ShiftWindow | None:
    """Return the window of the shift of a request; None for a whole recording.

    Raises UnusableShift: it is not an interval, because the recording had no clock to cut it by.
    """
    try:
        return parse_interval(request.shift) if request.shift else None
    except ValueError:
        why = "no days" if request.shift == BY_DIARY else "no clock"
        raise UnusableShift(why=why, window=request.shift) from None


def read_file(path: Path, request: ReportRequest, sha256: str = "") -> Recording:
    """Read the file of a request; log every failed plug-in on one line, with its traceback at INFO level.

    Raises acromion.fusion.errors.FusionError as :func:`acromion.fusion.readers.read_recording`; for a table
    its facts identify the header.
    """
    profile = parse_profile(request.profile) if request.profile else None
    window = find_window(request)
    with path.open("rb") as file:
        try:
            recording = read_recording(
                file,
                file_name=request.file_name,
                rate_hz=request.rate_hz,
                sha256=sha256,
                profile=profile,
                window=window,
            )
        except FusionError as refusal:
            if isinstance(refusal, FailedReader):
                logger.error(_FAILED, *refusal.facts.values())
                logger.info("traceback of the plug-in", exc_info=True)
            header = identify_header(file)
            refusal.facts |= {"header": header} if header else {}
            raise
    for flag in recording.flags:
        if flag.code == Caveat.READER:
            logger.error(_FAILED, *flag.facts.values())
    return recording


MOST_ROUNDING_US = 2
DAY_US = 86_400 * MICROSECONDS


def inspect_file(
    path: Path,
    rate_hz: float | None = None,
    profile: str = "",
    file_name: str = "",
    *,
    time_zone: str = "",
    clock_offset_s: float = 0.0,
) -> dict[str, Any]:
    """Read the file and describe its content, with proposed calibration windows.

    ``profile``: JSON of a column profile, "" for none. ``file_name``: "" uses the name in the path. Clock
    times are by the stated zone and correction.

    Raises acromion.fusion.errors.FusionError if the file is not a recording, or the stated clock cannot be
    right.
    """
    name = file_name or path.name
    with path.open("rb") as file:
        if recognise_layout(file, name) == "mvnx":
            return {"file": name} | _inspect_capture(read_angle_file(file, name))
    recording = read_file(path, ReportRequest(name, rate_hz=rate_hz, profile=profile))
    recording = set_clock(recording, time_zone, clock_offset_s)
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
    return {"file": name} | understood | proposed | {"shift_proposals": propose_shifts(recording)}


def propose_shifts(recording: Recording) -> list[str]:
    """Return the stretches of wear of a recording of over a day, as intervals; a person confirms them."""
    if recording.start is None or recording.duration_us <= DAY_US:
        return []
    off = (
        *propose_nonwear(recording),
        *recording.excluded,
        *find_missing(recording.segments, recording.duration_us),
    )
    return [str(window) for window in propose(off, recording.start, recording.duration_us)]


def _inspect_capture(capture: AngleFile) -> dict[str, Any]:
    """Describe a motion capture with the keys of a recording; it contains angles but no samples."""
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
        "shift_proposals": [],
    }


def write_inspection(recording_path: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Inspect the file for a waiting process: write ``inspection.json`` to ``out``."""
    on_stage("reading", 0.0)
    found = inspect_file(recording_path, request.rate_hz, request.profile, request.file_name)
    (out / "inspection.json").write_text(json.dumps(found), "utf-8")


def write_extent(recording_path: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Write ``extent.json``: the extent of a recording and the zone of its clock, to find its shifts."""
    on_stage("reading", 0.0)
    extent = measure_recording(recording_path, request)
    found = asdict(extent) | {"start": extent.start.isoformat() if extent.start else ""}
    found |= {"time_zone": getattr(extent.start and extent.start.tzinfo, "key", "")}
    (out / "extent.json").write_text(json.dumps(found), "utf-8")


def measure_recording(recording_path: Path, request: ReportRequest) -> Extent:
    """Return when a recording has samples, by the device's clock; without a digest if files are joined."""
    if request.joined:
        joined = measure_samples(read_joined(recording_path, request, NOTHING_KNOWN))
        return replace(joined, sha256="")
    profile = parse_profile(request.profile) if request.profile else None
    with recording_path.open("rb") as file:
        return measure_extent(file, file_name=request.file_name, rate_hz=request.rate_hz, profile=profile)


def write_diary(diary: Path, _request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Write ``diary.json``: the rows of a diary file. Raises acromion.fusion.errors.UnusableDiary."""
    on_stage("reading", 0.0)
    rows = [asdict(entry) for entry in read_checked_diary(diary.read_bytes())]
    (out / "diary.json").write_text(json.dumps(rows), "utf-8")


def write_preview(recording_path: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Inspect the first bytes of a file that is still being uploaded."""
    on_stage("reading", 0.0)
    facts = preview_head(recording_path.read_bytes(), request.file_name, request.rate_hz)
    start = facts.start.isoformat() if facts.start else None
    found = {"file": request.file_name, **asdict(facts), "start": start}
    (out / "inspection.json").write_text(json.dumps(found), "utf-8")


def write_column_proposal(recording_path: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Write ``columns.json``: a table's header and its identity, first rows and proposed columns.

    Raises acromion.fusion.errors.FusionError if the file is not a table of numbers.
    """
    on_stage("reading", 0.0)
    with recording_path.open("rb") as file:
        proposal = asdict(propose_file_profile(file, request.file_name))
        header = identify_header(file)
    proposal |= {"header": header}
    (out / "columns.json").write_text(json.dumps(proposal), "utf-8")
