"""A list of recordings in, a folder of reports and one table out; what is done is not done again."""

import errno
import hashlib
import json
import shutil
import sys
import traceback
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from app.report.index import IndexRow, render_index
from app.report.messages import describe_problem
from app.report.summary import (
    PERIOD_COLUMNS,
    Cell,
    Row,
    encode_dictionary,
    encode_summary,
    encode_table,
    list_periods,
    summarise_failure,
    summarise_results,
)
from app.report.wording import load_wording
from app.version import software_revision, software_version
from app.workflow import ReportRequest, make_report
from fusion.errors import Fact, FusionError

SUFFIXES = (".gt3x", ".csv", ".csv.gz", ".dat", ".txt")
_MARKER = "done.json"
_PROBLEM_COLUMNS = ["file", "code", "title", "detail", "fix"]


@dataclass(frozen=True, slots=True)
class Task:
    """One recording to do: where it is, what is asked of it, where its products go."""

    log: Path
    request: ReportRequest
    folder: Path
    force: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one recording: its sentences, or the code and facts of the refusal."""

    task: Task
    sentences: tuple[str, ...] = ()
    code: str | None = None
    facts: tuple[tuple[str, Fact], ...] = ()
    repeated: bool = False


def find_recordings(paths: Iterable[Path]) -> list[Path]:
    """List the recordings named, and those inside the folders named, each once, in a stable order."""
    found: dict[Path, None] = {}
    for path in paths:
        inside = sorted(p for p in path.rglob("*") if _looks_like_log(p)) if path.is_dir() else [path]
        found.update(dict.fromkeys(inside))
    return list(found)


def _looks_like_log(path: Path) -> bool:
    return path.is_file() and path.name.lower().endswith(SUFFIXES)


def plan_tasks(logs: Iterable[Path], out: Path, request: ReportRequest, *, force: bool) -> list[Task]:
    """Give each recording a folder named after its stem; equal stems get a number."""
    taken: set[str] = set()
    tasks = []
    for log in logs:
        name = _free_name(log.name.removesuffix(".gz").rsplit(".", 1)[0] or "recording", taken)
        tasks.append(Task(log, replace(request, file_name=log.name), out / name, force))
    return tasks


def _free_name(stem: str, taken: set[str]) -> str:
    name, number = stem, 2
    while name.casefold() in taken:
        name, number = f"{stem}-{number}", number + 1
    taken.add(name.casefold())
    return name


def run_tasks(tasks: list[Task], workers: int) -> Iterator[Outcome]:
    """Do the tasks, in this process when one worker is enough; outcomes come as they are ready."""
    if workers <= 1 or len(tasks) <= 1:
        yield from map(do_task, tasks)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        for future in as_completed([pool.submit(do_task, task) for task in tasks]):
            yield future.result()


def do_task(task: Task) -> Outcome:
    """Analyse one recording into its folder; a refusal or a bug is an outcome, never an exception."""
    try:
        return _do_or_repeat(task)
    except FusionError as refusal:
        return Outcome(task, code=refusal.code, facts=tuple(refusal.facts.items()))
    except OSError as error:
        return Outcome(task, code="E-FILE", facts=(("why", error.strerror or str(error)),))
    except Exception:  # noqa: BLE001  one bug must not stop the other recordings
        traceback.print_exc(file=sys.stderr)
        return Outcome(task, code="E-INTERNAL")


def _do_or_repeat(task: Task) -> Outcome:
    fingerprint = _fingerprint(task)
    marker = task.folder / _MARKER
    if not task.force and marker.exists():
        earlier = json.loads(marker.read_text("utf-8"))
        if earlier["fingerprint"] == fingerprint:
            return Outcome(task, tuple(earlier["sentences"]), repeated=True)
    return _do(task, fingerprint)


def _do(task: Task, fingerprint: str) -> Outcome:
    _refuse_foreign_folder(task.folder)
    staging = task.folder.with_name(f".{task.folder.name}.part")
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir(parents=True)
    try:
        sentences = make_report(task.log, task.request, staging)
        _use_plain_names(staging, task.request)
        marker = {"fingerprint": fingerprint, "sentences": sentences}
        (staging / _MARKER).write_text(json.dumps(marker, ensure_ascii=False), "utf-8")
        shutil.rmtree(task.folder, ignore_errors=True)
        staging.rename(task.folder)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return Outcome(task, sentences)


def _refuse_foreign_folder(folder: Path) -> None:
    """Only a folder that we made ourselves is replaced."""
    if folder.exists() and not (folder / _MARKER).exists() and any(folder.iterdir()):
        raise FileExistsError(errno.EEXIST, "a folder of this name exists and was not made by acromion")


def _use_plain_names(folder: Path, request: ReportRequest) -> None:
    """With one language there is one report: ``report.html``, not ``report.en.html``."""
    for language in request.languages[:1]:
        for path in folder.glob(f"report.{language}.*"):
            path.rename(folder / f"report{path.suffix}")


def _fingerprint(task: Task) -> str:
    """Hash input, settings and engine: the same three give the same report."""
    with task.log.open("rb") as file:
        content = hashlib.file_digest(file, "sha256").hexdigest()
    parts = [content, task.request.to_json(), software_version(), software_revision()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def write_tables(out: Path, outcomes: list[Outcome], request: ReportRequest) -> None:
    """Write what stands beside the recordings' folders: summary, problems, periods, dictionary, run."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "summary.csv").write_bytes(encode_summary([_summarise(outcome) for outcome in outcomes]))
    (out / "problems.csv").write_bytes(encode_table(_PROBLEM_COLUMNS, _list_problems(outcomes, request)))
    (out / "periods.csv").write_bytes(encode_table(PERIOD_COLUMNS, _list_periods(outcomes)))
    (out / "dictionary.csv").write_bytes(encode_dictionary())
    (out / "index.html").write_bytes(_render_index(outcomes, request))
    run = {
        "software": {"version": software_version(), "revision": software_revision()},
        "settings": asdict(replace(request, file_name="")),
        "recordings": [_record(outcome) for outcome in outcomes],
    }
    (out / "run.json").write_text(json.dumps(run, indent=1, ensure_ascii=False) + "\n", "utf-8")


def _record(outcome: Outcome) -> dict[str, str | None]:
    return {"file": outcome.task.log.name, "folder": outcome.task.folder.name, "code": outcome.code}


def _summarise(outcome: Outcome) -> Row:
    if outcome.code:
        return summarise_failure(outcome.task.log.name, outcome.task.request.subject, outcome.code)
    return summarise_results(_read_results(outcome))


def _read_results(outcome: Outcome) -> dict[str, Any]:
    results: dict[str, Any] = json.loads((outcome.task.folder / "results.json").read_text("utf-8"))
    return results


def _list_periods(outcomes: list[Outcome]) -> list[Row]:
    good = (outcome for outcome in outcomes if not outcome.code)
    return [row for outcome in good for row in list_periods(_read_results(outcome))]


def _render_index(outcomes: list[Outcome], request: ReportRequest) -> bytes:
    rows = [_show_row(outcome, request) for outcome in outcomes]
    return render_index(rows, request.method, request.languages[0])


def _show_row(outcome: Outcome, request: ReportRequest) -> IndexRow:
    name, language = outcome.task.log.name, request.languages[0]
    if outcome.code:
        problem = describe_problem(outcome.code, dict(outcome.facts), language)
        return IndexRow(name, None, None, None, f"{outcome.code}. {problem.title}. {problem.fix}")
    row = _summarise(outcome)
    verdict = load_wording(language)["verdict"][row["verdict"]]["label"]
    folder = outcome.task.folder.name
    return IndexRow(name, folder, _number(row["analysed_s"]), _number(row["time_above_60_percent"]), verdict)


def _number(cell: Cell) -> float | None:
    return float(cell) if isinstance(cell, int | float) else None


def _list_problems(outcomes: list[Outcome], request: ReportRequest) -> list[Row]:
    rows: list[Row] = []
    for outcome in outcomes:
        if outcome.code:
            problem = describe_problem(outcome.code, dict(outcome.facts), request.languages[0])
            rows.append(
                {
                    "file": outcome.task.log.name,
                    "code": outcome.code,
                    "title": problem.title,
                    "detail": problem.detail,
                    "fix": problem.fix,
                }
            )
    return rows
