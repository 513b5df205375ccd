"""A folder of people, tasks and devices: every recording is compared with the reference beside it.

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

What cannot be compared is a problem, told with its place, and the rest goes on.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from app.formats import ENDINGS
from app.request import Reference, ReportRequest
from fusion.errors import Fact, FusionError, NoReference, UnusableStudy
from fusion.task_windows import TaskWindow, read_tasks

RECORDINGS = tuple(ending for ending in ENDINGS if ending not in {".zip", ".bin"})
_PAPER_TASK = re.compile(r"task[-_ ]?0*(10|[1-9])(?!\d)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class StudyFile:
    """One recording of a study, the reference beside it, whose it is, and the task its folder stands for."""

    log: Path
    reference: Path
    person: str
    task: str
    paper_task: int | None

    def name(self, study: Path) -> str:
        """Give its place within the study."""
        return self.log.relative_to(study).as_posix()


@dataclass(frozen=True, slots=True)
class StudyProblem:
    """What could not be compared, and why."""

    name: str
    code: str
    facts: Mapping[str, Fact] = field(default_factory=dict)


def find_study_files(study: Path, out: Path) -> tuple[StudyFile, ...]:
    """List the recordings that have a reference beside them, in a stable order.

    Those that have none: :func:`find_lonely_recordings`.

    Raises
    ------
    UnusableStudy
        There is none.
    """
    references = sorted(
        path for path in study.rglob("reference.*") if path.is_file() and not _is_in(path, out)
    )
    files = tuple(file for reference in references for file in _list_folder(study, reference))
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


def _list_folder(study: Path, reference: Path) -> Iterator[StudyFile]:
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


def ask(file: StudyFile, request: ReportRequest) -> ReportRequest:
    """Give the request for one recording of the study.

    Raises
    ------
    UnusableTasks
        Its list of tasks cannot be read.
    """
    reference = Reference(str(file.reference), file.reference.name, tasks=_find_tasks(file))
    values: dict[str, Any] = {"file_name": file.log.name, "subject": file.person, "reference": reference}
    return ReportRequest(
        side=request.side, method=request.method, pose=request.pose, languages=request.languages, **values
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
    return StudyProblem(name, "E-FILE", {"why": error.strerror or ""})
