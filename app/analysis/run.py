"""The one pipeline from a stored file to a report, for page, API and command line."""

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from acromion.app.analysis.inspect import find_window, measure_recording, propose_shifts, read_on_stated_clock
from acromion.app.errors import BadParameter
from acromion.app.report.export.angles import encode_elevation_csv, write_elevation
from acromion.app.report.export.results import encode_results
from acromion.app.report.findings import build_findings
from acromion.app.report.products import ELEVATION, build_settings, describe_subject, write_products
from acromion.app.request import OnStage, ReportRequest, Stage
from acromion.app.store.day_file import DAY_NAME, DaySegment, write_day
from acromion.app.store.folder import NOTHING_KNOWN, KnownFiles, sync_file
from acromion.fusion.angle_files import (
    AngleFile,
    AngleFileOptions,
    holds_samples,
    read_angle_file,
    recognise_layout,
)
from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import ShiftWindow, correct_start, read_clock
from acromion.fusion.conventions import CONFIRMED, SAID_S, awaits_pose
from acromion.fusion.errors import FusionError, UnusableShift
from acromion.fusion.exposure.periods import drop_poses
from acromion.fusion.pipeline import (
    Analysis,
    analyse,
    analyse_angle_file,
    analyse_angles,
    apply_file_settings,
    check_stated_times,
)
from acromion.fusion.pose.calibrate import (
    calibrate,
    find_early_stills,
    is_worn_until_end,
    propose_poses,
    reduce_recording,
    survey,
)
from acromion.fusion.pose.rules import find_nearest_axis
from acromion.fusion.quality.time_account import propose_nonwear
from acromion.fusion.readers import holds_device_format
from acromion.fusion.recording import MICROSECONDS, Recording, Span
from acromion.fusion.sensor.model import view_segment
from acromion.fusion.sensor.self_calibration import calibrate_accelerometer
from acromion.fusion.sensor.stillness import find_still_moments, reduce_run
from acromion.fusion.settings import CarriedPose

# The day of an analysis, for the page on which a person reviews and corrects it.


def write_day_of(analysis: Analysis, path: Path) -> None:
    """Write the day of an analysis (:mod:`acromion.app.store.day_file`).

    Computed angles have no samples to reduce.
    """
    by_start = {segment.start_us: segment for segment in analysis.recording.segments}
    days = []
    for run in analysis.elevation.segments:
        angle_deg = np.where(run.valid, run.elevation_deg, np.nan).astype(np.float32)
        segment, block_s, quiet = by_start.get(run.start_us), 1.0, np.empty((0, 6), np.float32)
        if segment is not None and len(segment) and run.rate_hz:
            blocks = reduce_run(view_segment(segment))
            block_s, quiet = blocks.block_s, blocks.acc.astype(np.float32)
        days.append(DaySegment(run.start_us / MICROSECONDS, run.rate_hz, angle_deg, block_s, quiet))
    write_day(path, days, _describe_facts(analysis))


def _describe_facts(analysis: Analysis) -> dict[str, Any]:
    recording, calibration = analysis.recording, analysis.calibration
    proposed = propose_poses(recording) if calibration else ()
    not_worn = propose_nonwear(recording, analysis.exclusions) if calibration else ()
    used = calibration.windows if calibration else ()
    questions: dict[str, Any] = {"asked": []}
    if calibration is not None:  # questions for a person: which stillness was the pose, did the sensor move
        questions = {
            "asked": [[still.start_s, still.end_s] for still in calibration.proposals],
            "spread_deg": calibration.spread_deg,
            "needs_pose": calibration.needs_pose,
            "not_held": any(flag.code == Caveat.NOT_HELD for flag in analysis.quality.flags),
            "moves": [[q.kind, q.first_s, q.end_s, q.apart_deg] for q in calibration.questions],
            "unread": list(_list_unread(analysis)),
        }
    return {
        "device": recording.device,
        "start": recording.start.isoformat() if recording.start else None,
        "time_zone": recording.time_zone,
        "duration_us": recording.duration_us,
        "still": [[p.still.start_s, p.still.end_s, p.still.score, p.kind] for p in proposed],
        "not_worn": [_bound(span) for span in not_worn],
        "shifts": propose_shifts(recording) if calibration else [],
        "left_out": [[*_bound(span), span.reason] for span in analysis.exclusions],
        "calibration": [[still.start_s, still.end_s, still.score] for still in used],
        **questions,
        "nearest_axis": list(find_nearest_axis(calibration.arm_axis)) if calibration else None,
    }


def _list_unread(analysis: Analysis) -> Iterator[list[Any]]:
    """Return each stretch without a pose, with the stillnesses at its start that may be one."""
    duration_s = analysis.recording.duration_us / MICROSECONDS
    left_out = [part for part in analysis.axis_parts if part.arm_axis is None]
    parts = [part for part in left_out if awaits_pose(part.start_s, part.end_s)]
    if not parts:
        return
    blocks = reduce_recording(analysis.recording)
    correction = calibrate_accelerometer(find_still_moments(blocks))
    stretches_s, wears = survey(analysis.recording, blocks, correction)
    for part in parts:
        end_s = min(part.end_s, duration_s)
        slip_s = part.start_s - SAID_S
        wear = replace(wears[0], start_s=slip_s, end_s=end_s, worn_from_s=slip_s)
        (early,) = find_early_stills(analysis.recording, [wear], stretches_s)
        yield [slip_s, end_s, [[still.start_s, still.end_s] for still in early.stills]]


def _bound(span: Span) -> list[float]:
    return [span.start_us / MICROSECONDS, span.end_us / MICROSECONDS]


# Progress at the start of each stage, from the share of time that each stage takes on a long shift.
_BEGINS: dict[Stage, float] = {
    "reading": 0.0,
    "checking": 0.45,
    "calibrating": 0.5,
    "fusing": 0.55,
    "counting": 0.7,
    "rendering": 0.9,
}


CAPTURES = ("mvnx", "dot")
"""Layouts with computed angles, which need no fusion."""


def ignore_stage(_stage: Stage, _fraction: float) -> None:
    """Do nothing: the default listener."""


def make_report(
    recording_path: Path,
    request: ReportRequest,
    out: Path,
    on_stage: OnStage = ignore_stage,
    known: KnownFiles = NOTHING_KNOWN,
) -> None:
    """Analyse the file and write every product to the existing folder ``out``.

    ``known``: SHA-256 of the recording and of the files joined to it, if already computed, and the cache of
    decoded samples.

    Writes ``results.json``, ``elevation.parquet``, the tables of :func:`export_results` and, for each
    language, ``report.<language>.<kind>`` and the answer in five lines, ``answer.<language>.txt``; with a PDF
    also ``fhir.json``. With a cache (on a server) it also writes the day for the page. Raises
    acromion.fusion.errors.FusionError if no figure can be computed; then nothing has been written.
    """
    analysis = _analyse_file(recording_path, request, known, lambda stage: on_stage(stage, _BEGINS[stage]))
    on_stage("rendering", _BEGINS["rendering"])
    findings = build_findings(analysis)
    subject = describe_subject(request, findings)

    def write_angle() -> None:
        """Write the angles to disk while the pages are rendered."""
        write_elevation(analysis.elevation, out / ELEVATION, analysis.exclusions, analysis.recording.segments)
        sync_file(out / ELEVATION)

    with ThreadPoolExecutor(1) as writer:  # both release the interpreter lock
        written = writer.submit(write_angle)
        write_products(encode_results(findings, subject), findings, subject, request, out)
        written.result()
    if known.cache is not None:
        write_day_of(analysis, out / DAY_NAME)


def write_elevation_csv(parquet: Path, _request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Write the angles of the file ``parquet`` as ``elevation.csv.gz`` to ``out``."""
    on_stage("rendering", 0.0)
    (out / "elevation.csv.gz").write_bytes(encode_elevation_csv(parquet))


def _analyse_file(
    recording_path: Path, request: ReportRequest, known: KnownFiles, begin: Callable[[Stage], None]
) -> Analysis:
    settings = build_settings(request)
    begin("reading")
    if request.source == "angles":
        with recording_path.open("rb") as file:
            return analyse_angles(file, begin, replace(settings, diary=drop_poses(settings.diary)))
    captured = None if request.shift else _read_capture(recording_path, request)
    if captured is not None:
        return analyse_angle_file(captured, begin, settings)
    recording = _read_shift(recording_path, request, known)
    _check_slips(request, recording.duration_us)
    if request.pose_from:
        settings = replace(settings, carried=_find_carried(recording_path, request, known))
    return analyse(recording, settings, begin)


BEFORE_S = 60.0
"""How much of the time before a shift shows whether the sensor was already worn."""


def _read_shift(recording_path: Path, request: ReportRequest, known: KnownFiles) -> Recording:
    """Read the recording of a request.

    If the pose is stated as held at the start of wear, also find out whether a shift begins with it.
    """
    recording = read_on_stated_clock(recording_path, request, known)
    if not request.shift or request.pose_held != "start" or recording.start is None:
        return recording
    minute = (read_clock(recording.start, -round(ago_s * MICROSECONDS)) for ago_s in (BEFORE_S, 0.0))
    before = replace(request, shift=str(ShiftWindow(*minute)))
    try:
        is_worn = is_worn_until_end(read_on_stated_clock(recording_path, before, known))
    except UnusableShift:  # the recording begins here, or the device was off
        is_worn = False
    except FusionError:  # too little to tell
        is_worn = True
    return replace(recording, worn_before=is_worn)


def _check_slips(request: ReportRequest, duration_us: int) -> None:
    duration_s = duration_us / MICROSECONDS
    for name, times_s in (("slip_at", request.slip_times_s), ("no_slip_at", request.no_slip_times_s)):
        for time_s in times_s:
            if time_s > duration_s:
                raise BadParameter(name=name, value=f"{time_s:g}", allowed=f"0 … {duration_s:g}")


def write_time_check(recording_path: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Check the times that a person stated against the start and end of a recording.

    Writes ``check.json``: the caveats of the diary. Raises FusionError or BadParameter as the analysis would.
    """
    on_stage("reading", 0.0)
    window = find_window(request)
    captured = None if request.shift else _read_capture(recording_path, request)
    if captured is None:
        extent = measure_recording(recording_path, replace(request, shift=""))
        device, duration_us = extent.start, extent.duration_us
    else:
        device, duration_us = captured.start, round((captured.last_s - captured.first_s) * MICROSECONDS)
    start = correct_start(device, request.time_zone, request.clock_offset_s)
    if window is not None:
        if start is None:
            raise UnusableShift(why="no clock", window=request.shift)
        first_us, stop_us = window.place(start)
        first_us, stop_us = max(first_us, 0), min(stop_us, duration_us)
        if stop_us <= first_us:
            raise UnusableShift(why="no samples", window=request.shift)
        start, duration_us = read_clock(start, first_us), stop_us - first_us
    _check_slips(request, duration_us)
    flags = check_stated_times(build_settings(request), start, duration_us)
    found = [{"code": flag.code, "count": flag.count, "facts": dict(flag.facts)} for flag in flags]
    (out / "check.json").write_text(json.dumps(found), "utf-8")


def _find_carried(recording_path: Path, request: ReportRequest, known: KnownFiles) -> CarriedPose | None:
    """Return the pose of the earlier shift.

    None if no person confirmed it, if it is not answered whether the sensor slipped or was removed there, or
    if it cannot be used.
    """
    windows_s = request.pose_from_windows_s
    earlier = replace(request, shift=request.pose_from, calibration_windows_s=windows_s, diary=())
    earlier = replace(earlier, slip_times_s=(), no_slip_times_s=request.pose_from_no_slip_at_s)
    try:
        recording = _read_shift(recording_path, earlier, known)
        found = calibrate(recording, apply_file_settings(recording, build_settings(earlier))).calibration
    except FusionError:
        return None
    is_sure = found.state in CONFIRMED and not found.questions
    x, y, z = found.arm_axis.tolist()
    return CarriedPose((x, y, z), found.sigma_deg) if is_sure else None


def _read_capture(recording_path: Path, request: ReportRequest) -> AngleFile | None:
    """Read a motion capture; None for a file with samples of an inertial sensor."""
    with recording_path.open("rb") as file:
        if holds_device_format(file):
            return None
        layout = recognise_layout(file, request.file_name)
        if layout not in CAPTURES or request.joined or (layout == "dot" and holds_samples(file)):
            return None
        return read_angle_file(file, request.file_name, AngleFileOptions(request.side, request.rate_hz))
