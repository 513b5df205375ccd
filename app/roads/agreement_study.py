"""A folder of people, tasks and devices: every recording is compared with the reference in its folder.

    STUDY/
      P01/                      a person; the name is the subject code
        reference.mvnx          what all recordings here are compared with: any file named reference.*
        gt9x.gt3x               recordings; any name
        lsm9ds1.csv
        tasks.csv               name,start_s,end_s[,paper_task][,clock]; gt9x.tasks.csv for one alone
      P02/
        task-1/                 or one folder for each task, with its own reference; task-N is the paper's
          reference.csv
          gt9x.gt3x

A recording that cannot be compared becomes a problem with its place; the rest goes on.
"""

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.errors import UNREADABLE_PATH, StudyProblem
from app.formats import ENDINGS
from app.report.agreement.export import build_study_json, build_validation, encode_cells, encode_entries
from app.report.agreement.report import StudyFacts, build_study
from app.report.export.csv import Row, encode_table
from app.report.render.html import render_html
from app.report.render.pdf import render_pdf
from app.report.words.messages import describe_problem
from app.report.words.subject import Software
from app.request import Reference, ReportRequest
from app.roads.analyse import ignore_stage
from app.roads.validate import compare_files, describe_comparison, write_comparison
from app.version import software_revision, software_version
from fusion.agreement import AgreementEntry, Comparison, summarise_agreement_study
from fusion.errors import FusionError, NoReference, UnusableStudy
from fusion.task_windows import TaskWindow, read_tasks

RECORDINGS = tuple(ending for ending in ENDINGS if ending not in {".zip", ".bin"})
_PAPER_TASK = re.compile(r"task[-_ ]?0*(10|[1-9])(?!\d)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class StudyFile:
    """One recording of a study: its reference, its person, and the task that its folder stands for."""

    log: Path
    reference: Path
    person: str
    task: str
    paper_task: int | None

    def name(self, study: Path) -> str:
        """Give its place within the study."""
        return self.log.relative_to(study).as_posix()


def find_study_files(study: Path, out: Path) -> tuple[StudyFile, ...]:
    """Find the recordings that have a reference in their folder, in a stable order.

    Those that have none: :func:`find_lonely_recordings`.

    Raises
    ------
    UnusableStudy
        There is none.
    """
    references = sorted(
        path for path in study.rglob("reference.*") if path.is_file() and not _is_in(path, out)
    )
    files = tuple(file for reference in references for file in _find_in_folder(study, reference))
    if not files:
        raise UnusableStudy(why="study-empty")
    return files


def find_lonely_recordings(study: Path, out: Path) -> tuple[StudyProblem, ...]:
    """List the recordings of people without a reference in their folder, in a stable order."""
    return tuple(
        describe_failure(path.relative_to(study).as_posix(), NoReference())
        for path in sorted(study.glob("*/**/*"))
        if path.is_file() and _is_recording(path) and not _is_in(path, out) and not _has_reference(path)
    )


def _has_reference(log: Path) -> bool:
    return any(path.is_file() for path in log.parent.glob("reference.*"))


def _is_in(path: Path, folder: Path) -> bool:
    return folder.resolve() in path.resolve().parents


def _find_in_folder(study: Path, reference: Path) -> Iterator[StudyFile]:
    places = reference.parent.relative_to(study).parts
    person, task = (places[0] if places else study.name), " / ".join(places[1:])
    found = _PAPER_TASK.match(places[-1]) if places[1:] else None
    for log in sorted(reference.parent.iterdir()):
        if log.is_file() and _is_recording(log):
            yield StudyFile(log, reference, person, task, int(found[1]) if found else None)


def _is_recording(path: Path) -> bool:
    name = path.name.lower()
    set_aside = (
        name.startswith(("reference.", "truth.")) or name == "tasks.csv" or name.endswith(".tasks.csv")
    )
    return name.endswith(RECORDINGS) and not set_aside


def build_request(file: StudyFile, request: ReportRequest) -> ReportRequest:
    """Give the request for one recording of the study.

    Raises
    ------
    UnusableTasks
        Its list of tasks cannot be read.
    """
    reference = Reference(str(file.reference), file.reference.name, tasks=_find_tasks(file))
    values: dict[str, Any] = {"file_name": file.log.name, "subject": file.person, "reference": reference}
    return ReportRequest(
        side=request.side,
        method=request.method,
        pose=request.pose,
        languages=request.languages,
        pose_held=request.pose_held,
        **values,
    )


def _find_tasks(file: StudyFile) -> tuple[TaskWindow, ...]:
    stem = file.log.name.partition(".")[0]
    for name in (f"{stem}.tasks.csv", "tasks.csv"):
        path = file.log.with_name(name)
        if path.is_file():
            return read_tasks(path.read_bytes())
    return ()


def describe_failure(name: str, error: FusionError | OSError) -> StudyProblem:
    """Turn an exception into a problem of the study."""
    if isinstance(error, FusionError):
        return StudyProblem(name, error.code, error.facts)
    return StudyProblem(name, UNREADABLE_PATH, {"why": error.strerror or ""})


# Every recording is compared as :mod:`app.roads.validate` does it; then the table over people is made.


WHOLE = "all"
"""Name of the task where nothing states one."""


@dataclass(frozen=True, slots=True)
class StudyOutcome:
    """Outcome of a study: how many recordings were compared, and which were not."""

    compared: int
    problems: tuple[StudyProblem, ...]


def make_study(
    study: Path, request: ReportRequest, out: Path, on_file: Callable[[str], None]
) -> StudyOutcome:
    """Compare every recording of the study, and write the table over people into the existing folder ``out``.

    Writes ``study.json``, ``table.csv`` (task by device), ``comparisons.csv`` (person by task by device),
    ``problems.csv``, ``study.<language>.html`` and ``.pdf``, and each comparison's ``validation.json`` and
    ``validation.csv`` in a folder of its own.

    Raises
    ------
    UnusableStudy
        No recording with a reference, or none that could be compared.
    """
    entries: list[AgreementEntry] = []
    problems = list(find_lonely_recordings(study, out))
    compared = 0
    for file in find_study_files(study, out):
        on_file(file.name(study))
        try:
            entries += _compare(file, build_request(file, request), out / file.name(study))
            compared += 1
        except (FusionError, OSError) as error:
            problems.append(describe_failure(file.name(study), error))
    _write_problems(problems, request, out)
    if not entries:
        raise UnusableStudy(why="study-failed")
    _write_study(entries, problems, request, out)
    return StudyOutcome(compared, tuple(problems))


def _compare(file: StudyFile, request: ReportRequest, folder: Path) -> list[AgreementEntry]:
    if request.reference is None:
        raise ValueError("no reference")
    comparison = compare_files(file.log, request, request.reference, ignore_stage)
    subject = describe_comparison(comparison, request, request.reference)
    folder.mkdir(parents=True, exist_ok=True)
    write_comparison(build_validation(comparison, subject), folder)
    return _build_entries(file, comparison)


def _build_entries(file: StudyFile, comparison: Comparison) -> list[AgreementEntry]:
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
    software = Software(software_version(), software_revision())
    encoded = build_study_json(entries, cells, problems, request.method, software)
    (out / "study.json").write_bytes(encoded)
    (out / "table.csv").write_bytes(encode_cells(cells))
    (out / "comparisons.csv").write_bytes(encode_entries(entries))
    facts = StudyFacts(request.method, request.pose, software, json.loads(encoded)["id"])
    for language in request.languages:
        described = [(p.name, p.code, describe_problem(p.code, p.facts, language)) for p in problems]
        failed = [(name, f"{problem.title}. {problem.detail}", code) for name, code, problem in described]
        report = build_study(entries, cells, failed, facts, language)
        (out / f"study.{language}.html").write_bytes(render_html(report))
        document = render_pdf(report, {"study.json": encoded}, request.paper)
        (out / f"study.{language}.pdf").write_bytes(document)


def _write_problems(problems: list[StudyProblem], request: ReportRequest, out: Path) -> None:
    rows: list[Row] = []
    for problem in problems:
        words = describe_problem(problem.code, problem.facts, request.languages[0])
        rows.append(
            {
                "file": problem.name,
                "code": problem.code,
                "title": words.title,
                "detail": words.detail,
                "fix": words.fix,
            }
        )
    (out / "problems.csv").write_bytes(encode_table(("file", "code", "title", "detail", "fix"), rows))
