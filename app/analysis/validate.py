"""Compare a recording with a reference: how well they agree."""

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acromion.app.analysis.inspect import read_file
from acromion.app.analysis.run import ignore_stage
from acromion.app.errors import UNREADABLE_PATH, StudyProblem
from acromion.app.formats import ENDINGS
from acromion.app.report.agreement import (
    ComparisonSubject,
    build_agreement,
    build_study,
    build_study_json,
    build_validation,
    encode_agreement_table,
    encode_cells,
    encode_entries,
    encode_sentences,
    encode_validation,
)
from acromion.app.report.export.tables import Row, encode_table
from acromion.app.report.findings import Software
from acromion.app.report.render.html import render_html
from acromion.app.report.render.pdf import render_pdf
from acromion.app.report.words.messages import describe_problem
from acromion.app.request import OnStage, Reference, ReportRequest
from acromion.app.store.day_file import OWN_CURVE, REFERENCE_CURVE, DaySegment, write_day
from acromion.app.version import software_version, source_revision
from acromion.fusion.angle_files import AngleFileOptions, read_angle_file, recognise_layout
from acromion.fusion.comparison.agreement import (
    AgreementEntry,
    Comparison,
    ComparisonSettings,
    Side,
    compare_sides,
    summarise_agreement_study,
    take_angle_file,
    take_recording,
)
from acromion.fusion.comparison.alignment import ClockSettings
from acromion.fusion.diary import read_tasks
from acromion.fusion.errors import FusionError, NoReference, UnknownFormat, UnusableStudy
from acromion.fusion.pipeline import fuse_recording
from acromion.fusion.recording import MICROSECONDS
from acromion.fusion.settings import AnalysisSettings

NO_QUIET = np.empty((0, 6), np.float32)
ANGLES_ONLY = ("mvnx", "parquet")
"""Layouts that never contain samples of an inertial sensor."""


def make_validation(
    recording_path: Path,
    request: ReportRequest,
    out: Path,
    on_stage: OnStage = ignore_stage,
    *,
    has_curves: bool = False,
) -> None:
    """Compare the recording with the request's reference and write every product to the folder ``out``.

    ``has_curves``: also write both angles (:mod:`acromion.app.store.day_file`) and the Bland-Altman plot for
    the page.

    Raises acromion.fusion.errors.FusionError if the two cannot be compared; then nothing has been written.
    """
    comparison = compare_files(recording_path, request, on_stage)
    on_stage("rendering", 0.9)
    subject = describe_comparison(comparison, request)
    validation = build_validation(comparison, subject)
    encoded = write_comparison(validation, out)
    for language in request.languages:
        report = build_agreement(comparison, subject, validation, language)
        (out / f"answer.{language}.txt").write_bytes(encode_sentences(validation, language))
        (out / f"validation.{language}.html").write_bytes(render_html(report))
        document = render_pdf(report, {"validation.json": encoded}, request.paper)
        (out / f"validation.{language}.pdf").write_bytes(document)
        if has_curves:
            (out / f"plot.{language}.svg").write_text(report.figures[0].narrow, "utf-8")
    if has_curves:
        runs = comparison.pairs.runs  # row by row, on the recording's clock
        first_s = runs[0].start_s
        facts = {"start": None, "duration_us": round((runs[-1].end_s - first_s) * MICROSECONDS)}
        for name, angle in ((OWN_CURVE, "ours_deg"), (REFERENCE_CURVE, "reference_deg")):
            angles_deg = [getattr(run, angle).astype(np.float32) for run in runs]
            segments = [
                DaySegment(run.start_s - first_s, run.rate_hz, angle_deg, 1.0, NO_QUIET)
                for run, angle_deg in zip(runs, angles_deg, strict=True)
            ]
            write_day(out / name, segments, facts)


def write_comparison(validation: Mapping[str, Any], out: Path) -> bytes:
    """Write ``validation.json`` and ``validation.csv``; return the bytes of the first."""
    encoded = encode_validation(validation)
    (out / "validation.json").write_bytes(encoded)
    (out / "validation.csv").write_bytes(encode_agreement_table(validation))
    return encoded


def compare_files(
    recording_path: Path, request: ReportRequest, on_stage: OnStage = ignore_stage
) -> Comparison:
    """Read both files, fuse samples if needed, and compare."""
    reference = request.reference
    if reference is None:
        raise ValueError("no reference")
    on_stage("reading", 0.0)
    ours = read_side(recording_path, request, on_stage)
    options = AngleFileOptions(request.side, reference.rate_hz)
    with Path(reference.path).open("rb") as file:
        other = read_angle_file(file, reference.file_name, options)
    on_stage("counting", 0.7)
    clock = ClockSettings(reference.offset_s, reference.drift_ppm)
    return compare_sides(ours, other, ComparisonSettings(clock, reference.tasks))


def read_side(recording_path: Path, request: ReportRequest, on_stage: OnStage = ignore_stage) -> Side:
    """Read one side of the comparison: a recording, which is fused, or else a file with angles."""
    with recording_path.open("rb") as file:
        layout = recognise_layout(file, request.file_name)
        if layout not in ANGLES_ONLY:
            settings = AnalysisSettings(
                request.method, request.pose, request.calibration_windows_s, pose_held=request.pose_held
            )
            try:
                recording = read_file(recording_path, request)
                on_stage("fusing", 0.5)
                return take_recording(fuse_recording(recording, settings))
            except UnknownFormat:
                if not layout:
                    raise
        angles = read_angle_file(file, request.file_name, AngleFileOptions(request.side, request.rate_hz))
    return take_angle_file(angles, next(iter(request.calibration_windows_s), None))


def describe_comparison(comparison: Comparison, request: ReportRequest) -> ComparisonSubject:
    """Build the subject of a validation: who and what was compared, by which software."""
    is_fused = comparison.ours.calibration_s is not None and comparison.ours.device not in {"angles", "mvn"}
    return ComparisonSubject(
        file_name=request.file_name,
        reference_name=request.reference.file_name if request.reference else "",
        subject=request.subject,
        side=request.side,
        method=request.method if is_fused else "",
        pose=request.pose if is_fused else "",
        software=Software(software_version(), source_revision()),
    )


# A folder of people, tasks and devices: every recording is compared with the reference in its folder.
#
#     STUDY/
#       P01/                      a person; the name is the subject code
#         reference.mvnx          what all recordings here are compared with: any file named reference.*
#         gt9x.gt3x               recordings; any name
#         lsm9ds1.csv
#         tasks.csv               name,start_s,end_s[,paper_task][,clock]; gt9x.tasks.csv for one alone
#       P02/
#         task-1/                 or one folder for each task, with its own reference; task-N is the paper's
#           reference.csv
#           gt9x.gt3x
#
# A recording that cannot be compared becomes a problem with its place; the rest goes on.


RECORDINGS = tuple(ending for ending in ENDINGS if ending not in {".zip", ".bin"})
_PAPER_TASK = re.compile(r"task[-_ ]?0*(10|[1-9])(?!\d)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class StudyFile:
    """One recording of a study: its reference, its person, and the task of its folder."""

    recording_path: Path
    reference: Path
    person: str
    task: str
    paper_task: int | None

    def name(self, study: Path) -> str:
        """Return its path within the study."""
        return self.recording_path.relative_to(study).as_posix()


def find_study_files(study: Path, out: Path) -> tuple[StudyFile, ...]:
    """Find the recordings that have a reference in their folder, in a stable order.

    :func:`find_recordings_without_reference` returns the others. Raises UnusableStudy if no recording has a
    reference.
    """
    references = sorted(
        path for path in study.rglob("reference.*") if path.is_file() and not _is_in(path, out)
    )
    files = []
    for reference in references:
        places = reference.parent.relative_to(study).parts
        person, task = (places[0] if places else study.name), " / ".join(places[1:])
        found = _PAPER_TASK.match(places[-1]) if places[1:] else None
        files += [
            StudyFile(recording_path, reference, person, task, int(found[1]) if found else None)
            for recording_path in sorted(reference.parent.iterdir())
            if recording_path.is_file() and _is_recording(recording_path)
        ]
    if not files:
        raise UnusableStudy(why="study-empty")
    return tuple(files)


def find_recordings_without_reference(study: Path, out: Path) -> tuple[StudyProblem, ...]:
    """Return the recordings of people without a reference in their folder, in a stable order."""
    return tuple(
        describe_failure(path.relative_to(study).as_posix(), NoReference())
        for path in sorted(study.glob("*/**/*"))
        if path.is_file()
        and _is_recording(path)
        and not _is_in(path, out)
        and not any(near.is_file() for near in path.parent.glob("reference.*"))
    )


def _is_in(path: Path, folder: Path) -> bool:
    return folder.resolve() in path.resolve().parents


def _is_recording(path: Path) -> bool:
    name = path.name.lower()
    set_aside = (
        name.startswith(("reference.", "truth.")) or name == "tasks.csv" or name.endswith(".tasks.csv")
    )
    return name.endswith(RECORDINGS) and not set_aside


def build_request(file: StudyFile, request: ReportRequest) -> ReportRequest:
    """Return the request for one recording of the study.

    Raises UnusableTasks if its list of tasks cannot be read.
    """
    names = (f"{file.recording_path.name.partition('.')[0]}.tasks.csv", "tasks.csv")
    lists = (path for path in map(file.recording_path.with_name, names) if path.is_file())
    tasks = next((read_tasks(path.read_bytes()) for path in lists), ())
    return ReportRequest(
        file.recording_path.name,
        file.person,
        request.side,
        request.method,
        request.pose,
        languages=request.languages,
        pose_held=request.pose_held,
        reference=Reference(str(file.reference), file.reference.name, tasks=tasks),
    )


def describe_failure(name: str, error: FusionError | OSError) -> StudyProblem:
    """Convert an exception to a problem of the study."""
    if isinstance(error, FusionError):
        return StudyProblem(name, error.code, error.facts)
    return StudyProblem(name, UNREADABLE_PATH, {"why": error.strerror or ""})


# The study: compare every recording, then build the table over people.


WHOLE = "all"
"""Name of the task if none is stated."""


def make_study(
    study: Path, request: ReportRequest, out: Path, on_file: Callable[[str], None]
) -> tuple[StudyProblem, ...]:
    """Compare every recording of the study, and write the table over people to the existing folder ``out``.

    Returns the recordings that could not be compared. Writes ``study.json``, ``table.csv`` (task by device),
    ``comparisons.csv`` (person by task by device), ``problems.csv``, ``study.<language>.html`` and ``.pdf``.
    Each comparison has a separate folder with ``validation.json`` and ``validation.csv``.

    Raises UnusableStudy if no recording has a reference, or none could be compared.
    """
    entries: list[AgreementEntry] = []
    problems = list(find_recordings_without_reference(study, out))
    for file in find_study_files(study, out):
        on_file(file.name(study))
        try:
            entries += _compare(file, request, out / file.name(study))
        except (FusionError, OSError) as error:
            problems.append(describe_failure(file.name(study), error))
    rows: list[Row] = []
    for problem in problems:
        words = describe_problem(problem.code, problem.facts, request.languages[0])
        texts = {"title": words.title, "detail": words.detail, "fix": words.fix}
        rows.append({"file": problem.name, "code": problem.code, **texts})
    (out / "problems.csv").write_bytes(encode_table(("file", "code", "title", "detail", "fix"), rows))
    if not entries:
        raise UnusableStudy(why="study-failed")
    _write_study(entries, problems, request, out)
    return tuple(problems)


def _compare(file: StudyFile, request: ReportRequest, folder: Path) -> list[AgreementEntry]:
    asked = build_request(file, request)
    comparison = compare_files(file.recording_path, asked)
    subject = describe_comparison(comparison, asked)
    folder.mkdir(parents=True, exist_ok=True)
    write_comparison(build_validation(comparison, subject), folder)
    device = comparison.ours.device
    if not comparison.tasks:
        name = file.task or WHOLE
        return [AgreementEntry(file.person, device, name, file.paper_task, comparison.overall)]
    return [
        AgreementEntry(file.person, device, task.name, task.paper_task, task.agreement)
        for task in comparison.tasks
        if task.agreement.count
    ]


def _write_study(
    entries: list[AgreementEntry], problems: list[StudyProblem], request: ReportRequest, out: Path
) -> None:
    cells = summarise_agreement_study(entries)
    software = Software(software_version(), source_revision())
    encoded = build_study_json(entries, cells, problems, request.method, software)
    (out / "study.json").write_bytes(encoded)
    (out / "table.csv").write_bytes(encode_cells(cells))
    (out / "comparisons.csv").write_bytes(encode_entries(entries))
    report_id = json.loads(encoded)["id"]
    for language in request.languages:
        described = [(p.name, p.code, describe_problem(p.code, p.facts, language)) for p in problems]
        failed = [(name, f"{problem.title}. {problem.detail}", code) for name, code, problem in described]
        report = build_study(entries, cells, failed, software, report_id, language)
        (out / f"study.{language}.html").write_bytes(render_html(report))
        document = render_pdf(report, {"study.json": encoded}, request.paper)
        (out / f"study.{language}.pdf").write_bytes(document)
