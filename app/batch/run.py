"""Does the recordings of a run, each in a child process with limits; what is done is not done again."""

import errno
import hashlib
import json
import shutil
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path

from app.batch.plan import MARKER, Task
from app.errors import Crashed
from app.jobs.attempt import (
    Attempt,
    Finished,
    LoadAndMakeReport,
    Refused,
    choose_limits,
    run_attempt,
)
from app.request import ReportRequest
from app.settings import Settings
from app.version import software_revision, software_version
from fusion.errors import Fact

OnProgress = Callable[[Task, str | None, float], None]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one recording: its answer in a few lines, or the code and facts of the refusal."""

    task: Task
    answer: tuple[str, ...] = ()
    code: str | None = None
    facts: Mapping[str, Fact] = field(default_factory=dict)
    repeated: bool = False


def run_tasks(tasks: Sequence[Task], workers: int, on_progress: OnProgress) -> Iterator[Outcome]:
    """Do the tasks, so many at once; outcomes come as they are ready.

    When the caller stops asking (Ctrl-C), the analyses under way are ended and leave nothing behind.
    """
    stopping = threading.Event()

    def do(task: Task) -> Outcome:
        return do_task(task, lambda stage, fraction: _tell(task, stage, fraction, on_progress, stopping))

    with ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(do, task) for task in tasks]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            stopping.set()
            pool.shutdown(cancel_futures=True)


def _tell(
    task: Task, stage: str | None, fraction: float, on_progress: OnProgress, stopping: threading.Event
) -> bool:
    on_progress(task, stage, fraction)
    return not stopping.is_set()


def is_up_to_date(task: Task) -> bool:
    """Tell whether the report that is there is the one the task would make."""
    return _read_marker(task.folder) == _fingerprint(task)


def do_task(task: Task, go_on: Callable[[str | None, float], bool]) -> Outcome:
    """Analyse one recording into its folder; whatever happens to it is an outcome, never an exception."""
    try:
        return _do_or_repeat(task, go_on)
    except OSError as error:
        return Outcome(task, code="E-FILE", facts={"why": error.strerror or str(error)})


def _do_or_repeat(task: Task, go_on: Callable[[str | None, float], bool]) -> Outcome:
    fingerprint = _fingerprint(task)
    if not task.force and _read_marker(task.folder) == fingerprint:
        return Outcome(task, _read_answer(task), repeated=True)
    _refuse_foreign_folder(task.folder)
    staging = task.folder.with_name(f".{task.folder.name}.part")
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir(parents=True)
    try:
        return _do(task, staging, fingerprint, go_on)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _do(task: Task, staging: Path, fingerprint: str, go_on: Callable[[str | None, float], bool]) -> Outcome:
    limits = choose_limits(Settings(), task.log.stat().st_size)
    attempt = Attempt(task.log, task.request, staging, LoadAndMakeReport(), limits)
    outcome = run_attempt(attempt, go_on)
    if isinstance(outcome, Refused):
        return Outcome(task, code=outcome.code, facts=outcome.facts)
    if not isinstance(outcome, Finished):
        return Outcome(task, code=Crashed.code, facts={"attempts": 1})
    _use_plain_names(staging, task.request)
    (staging / MARKER).write_text(json.dumps({"fingerprint": fingerprint}), "utf-8")
    shutil.rmtree(task.folder, ignore_errors=True)
    staging.rename(task.folder)
    return Outcome(task, _read_answer(task))


def _use_plain_names(folder: Path, request: ReportRequest) -> None:
    """The report in the first language is ``report.html``, its answer ``answer.txt``."""
    for path in folder.glob(f"*.{request.languages[0]}.*"):
        path.rename(folder / f"{path.name.partition('.')[0]}{path.suffix}")


def _read_answer(task: Task) -> tuple[str, ...]:
    return tuple((task.folder / "answer.txt").read_text("utf-8").splitlines())


def _refuse_foreign_folder(folder: Path) -> None:
    """Only a folder that we made ourselves is replaced."""
    if folder.exists() and not (folder / MARKER).exists() and any(folder.iterdir()):
        raise FileExistsError(errno.EEXIST, "a folder of this name exists and was not made by acromion")


def _read_marker(folder: Path) -> str | None:
    """Give the fingerprint of the finished folder; None where it is not finished, or no longer whole."""
    whole = all((folder / name).exists() for name in (MARKER, "results.json", "answer.txt"))
    return str(json.loads((folder / MARKER).read_text("utf-8"))["fingerprint"]) if whole else None


def _fingerprint(task: Task) -> str:
    """Hash input, settings and engine: the same three give the same report."""
    contents = [_hash_file(path) for path in (task.log, *map(Path, task.request.joined))]
    parts = [*contents, task.request.to_json(), software_version(), software_revision()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _hash_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
