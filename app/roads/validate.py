"""The road of a validation: from a recording and a reference to how far they agree."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from app.report.agreement.export import (
    ComparisonSubject,
    build_validation,
    encode_agreement_table,
    encode_validation,
)
from app.report.agreement.report import build_agreement
from app.report.agreement.tables import tell_agreement
from app.report.render.html import render_html
from app.report.render.pdf import render_pdf
from app.report.words.subject import Software
from app.request import OnStage, Reference, ReportRequest
from app.roads.analyse import ignore_stage
from app.roads.reading import read_file
from app.storage.day_file import OWN_CURVE, REFERENCE_CURVE, DaySegment, write_day
from app.version import software_revision, software_version
from fusion.agreement import (
    ClockSettings,
    Comparison,
    ComparisonSettings,
    Side,
    compare_sides,
    take_angle_file,
    take_recording,
)
from fusion.agreement.pairs import PairedRun
from fusion.angle_files import AngleFileOptions, read_angle_file, recognise_layout
from fusion.errors import UnknownFormat
from fusion.pipeline import fuse_recording
from fusion.recording import MICROSECONDS, Float64Array
from fusion.settings import AnalysisSettings

CURVES: dict[str, Callable[[PairedRun], Float64Array]] = {
    OWN_CURVE: lambda run: run.ours_deg,
    REFERENCE_CURVE: lambda run: run.reference_deg,
}
NO_QUIET = np.empty((0, 6), np.float32)
ANGLES_ONLY = ("mvnx", "parquet")
"""Layouts that never hold samples of an inertial sensor."""


def make_validation(
    log: Path,
    request: ReportRequest,
    out: Path,
    on_stage: OnStage = ignore_stage,
    *,
    has_curves: bool = False,
) -> None:
    """Compare the recording with the request's reference and write every product into the folder ``out``.

    ``has_curves``: for the page, write both angles (:mod:`app.storage.day_file`) and the plot of
    Bland and Altman, too.

    Raises
    ------
    fusion.errors.FusionError
        When the two cannot be compared; then nothing has been written.
    """
    if request.reference is None:
        raise ValueError("no reference")
    comparison = compare_files(log, request, request.reference, on_stage)
    on_stage("rendering", 0.9)
    subject = describe_comparison(comparison, request, request.reference)
    validation = build_validation(comparison, subject)
    encoded = write_comparison(validation, out)
    for language in request.languages:
        report = build_agreement(comparison, subject, validation, language)
        (out / f"answer.{language}.txt").write_bytes(tell_agreement(validation, language))
        (out / f"validation.{language}.html").write_bytes(render_html(report))
        document = render_pdf(report, {"validation.json": encoded}, request.paper)
        (out / f"validation.{language}.pdf").write_bytes(document)
        if has_curves:
            (out / f"plot.{language}.svg").write_text(report.figures[0].narrow, "utf-8")
    if has_curves:
        _write_curves(comparison.pairs.runs, out)


def _write_curves(runs: Sequence[PairedRun], out: Path) -> None:
    """Write what was compared, row by row, on the recording's clock."""
    first_s = runs[0].start_s
    facts = {"start": None, "duration_us": round((runs[-1].end_s - first_s) * MICROSECONDS)}
    for name, values in CURVES.items():
        segments = [
            DaySegment(run.start_s - first_s, run.rate_hz, values(run).astype(np.float32), 1.0, NO_QUIET)
            for run in runs
        ]
        write_day(out / name, segments, facts)


def write_comparison(validation: Mapping[str, Any], out: Path) -> bytes:
    """Write ``validation.json`` and ``validation.csv``; gives the former's bytes."""
    encoded = encode_validation(validation)
    (out / "validation.json").write_bytes(encoded)
    (out / "validation.csv").write_bytes(encode_agreement_table(validation))
    return encoded


def compare_files(log: Path, request: ReportRequest, reference: Reference, on_stage: OnStage) -> Comparison:
    """Read both files, fuse what is to be fused, and compare."""
    on_stage("reading", 0.0)
    ours = read_side(log, request, on_stage)
    options = AngleFileOptions(request.side, reference.rate_hz)
    with Path(reference.path).open("rb") as file:
        other = read_angle_file(file, reference.file_name, options)
    on_stage("counting", 0.7)
    clock = ClockSettings(reference.offset_s, reference.drift_ppm)
    return compare_sides(ours, other, ComparisonSettings(clock, reference.tasks))


def read_side(log: Path, request: ReportRequest, on_stage: OnStage = ignore_stage) -> Side:
    """Read one side of the comparison: a recording, which is fused, or else a file with its angle."""
    with log.open("rb") as file:
        layout = recognise_layout(file, request.file_name)
        if layout not in ANGLES_ONLY:
            try:
                return _fuse(log, request, on_stage)
            except UnknownFormat:
                if not layout:
                    raise
        angles = read_angle_file(file, request.file_name, AngleFileOptions(request.side, request.rate_hz))
    return take_angle_file(angles, next(iter(request.calibration_windows_s), None))


def _fuse(log: Path, request: ReportRequest, on_stage: OnStage) -> Side:
    recording = read_file(log, request)
    on_stage("fusing", 0.5)
    settings = AnalysisSettings(
        request.method, request.pose, request.calibration_windows_s, pose_held=request.pose_held
    )
    return take_recording(fuse_recording(recording, settings))


def describe_comparison(
    comparison: Comparison, request: ReportRequest, reference: Reference
) -> ComparisonSubject:
    """Build the subject of a validation: who and what was compared, by which software."""
    is_fused = comparison.ours.calibration_s is not None and comparison.ours.device not in {"angles", "mvn"}
    return ComparisonSubject(
        file_name=request.file_name,
        reference_name=reference.file_name,
        subject=request.subject,
        side=request.side,
        method=request.method if is_fused else "",
        pose=request.pose if is_fused else "",
        software=Software(software_version(), software_revision()),
    )
