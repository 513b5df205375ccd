"""The road of a study: every comparison by the one road, then the table over people."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from app.agreement_workflow import compare_files, describe_comparison, write_comparison
from app.report.agreement_json import build_validation
from app.report.html import render_html
from app.report.messages import describe_problem
from app.report.pdf import render_pdf
from app.report.study_content import StudyFacts, build_study
from app.report.study_tables import build_study_json, encode_cells, encode_entries
from app.report.subject import Software
from app.report.tables import Row, encode_table
from app.request import ReportRequest
from app.study import StudyFile, StudyProblem, ask, describe_failure, find_lonely_recordings, find_study_files
from app.version import software_revision, software_version
from app.workflow import ignore_stage
from fusion.agreement import Comparison, StudyEntry, summarise_study
from fusion.errors import FusionError, UnusableStudy

WHOLE = "all"
"""The name of the task where nothing says what was done."""


@dataclass(frozen=True, slots=True)
class StudyOutcome:
    """What came of a study."""

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
        No recording beside a reference, or none that could be compared.
    """
    entries: list[StudyEntry] = []
    problems = list(find_lonely_recordings(study, out))
    compared = 0
    for file in find_study_files(study, out):
        on_file(file.name(study))
        try:
            entries += _compare(file, ask(file, request), out / file.name(study))
            compared += 1
        except (FusionError, OSError) as error:
            problems.append(describe_failure(file.name(study), error))
    _write_problems(problems, request, out)
    if not entries:
        raise UnusableStudy(why="study-failed")
    _write_study(entries, problems, request, out)
    return StudyOutcome(compared, tuple(problems))


def _compare(file: StudyFile, request: ReportRequest, folder: Path) -> list[StudyEntry]:
    if request.reference is None:
        raise ValueError("no reference")
    comparison = compare_files(file.log, request, request.reference, ignore_stage)
    subject = describe_comparison(comparison, request, request.reference)
    folder.mkdir(parents=True, exist_ok=True)
    write_comparison(build_validation(comparison, subject), folder)
    return _list_entries(file, comparison)


def _list_entries(file: StudyFile, comparison: Comparison) -> list[StudyEntry]:
    device = comparison.ours.device
    if not comparison.tasks:
        name = file.task or WHOLE
        return [StudyEntry(file.person, device, name, file.paper_task, comparison.overall)]
    return [
        StudyEntry(file.person, device, task.name, task.paper_task, task.agreement)
        for task in comparison.tasks
        if task.agreement.count
    ]


def _write_study(
    entries: list[StudyEntry], problems: list[StudyProblem], request: ReportRequest, out: Path
) -> None:
    cells = summarise_study(entries)
    software = Software(software_version(), software_revision())
    encoded = build_study_json(entries, cells, problems, request.method, software)
    (out / "study.json").write_bytes(encoded)
    (out / "table.csv").write_bytes(encode_cells(cells))
    (out / "comparisons.csv").write_bytes(encode_entries(entries))
    facts = StudyFacts(request.method, request.pose, software, json.loads(encoded)["id"])
    for language in request.languages:
        told = [(p.name, p.code, describe_problem(p.code, p.facts, language)) for p in problems]
        failed = [(name, f"{problem.title}. {problem.detail}", code) for name, code, problem in told]
        report = build_study(entries, cells, failed, facts, language)
        (out / f"study.{language}.html").write_bytes(render_html(report))
        document = render_pdf(report, {"study.json": encoded}, request.paper)
        (out / f"study.{language}.pdf").write_bytes(document)


def _write_problems(problems: list[StudyProblem], request: ReportRequest, out: Path) -> None:
    rows: list[Row] = []
    for problem in problems:
        told = describe_problem(problem.code, problem.facts, request.languages[0])
        rows.append(
            {
                "file": problem.name,
                "code": problem.code,
                "title": told.title,
                "detail": told.detail,
                "fix": told.fix,
            }
        )
    (out / "problems.csv").write_bytes(encode_table(("file", "code", "title", "detail", "fix"), rows))
