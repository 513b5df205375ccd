"""Analyses the recordings of a run, each in a child process with limits; finished ones are not repeated."""

import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from app.batch.folder import (
    Marker,
    find_changes,
    find_last_version,
    has_report,
    is_up_to_date,
    make_marker,
    open_staging,
    read_digest,
    read_marker,
    refuse_foreign_folder,
    replace_folder,
    restore_earlier,
    switch_language,
    use_plain_names,
    write_marker,
)
from app.batch.plan import MARKER, Task
from app.errors import UNREADABLE_PATH, Crashed, Interrupted
from app.jobs.children.attempt import (
    Attempt,
    Finished,
    MakeReport,
    Refused,
    Unstarted,
    choose_limits,
    load_and_make_report,
    load_and_render_again,
    run_attempt,
)
from app.request import ReportRequest
from app.storage.store import KnownLogs
from fusion.errors import Fact

# How many recordings this machine analyses at once.


NEED_BYTES = 1_200_000_000
"""One analysis of 14.4 million samples, as measured by ``benchmarks/road.py``, with a margin."""


@dataclass(frozen=True, slots=True)
class Capacity:
    """The cores we may use and the memory that is free."""

    cores: int
    free_bytes: int


def measure_capacity() -> Capacity:
    """Ask the system; the cores are those this process may run on."""
    import psutil  # noqa: PLC0415  of no use to a run of one recording

    allowed = getattr(os, "sched_getaffinity", None)
    cores = len(allowed(0)) if allowed else os.cpu_count() or 1
    return Capacity(cores, psutil.virtual_memory().available)


def choose_workers(recordings: int, capacity: Capacity) -> int:
    """Leave one core to the person at the machine and take no more than fits into memory; at least one."""
    return max(1, min(recordings, capacity.cores - 1, capacity.free_bytes // NEED_BYTES))


OnProgress = Callable[[Task, str | None, float], None]
GoOn = Callable[[str | None, float], bool]
"""Takes the stage and how far it is; False ends the analysis."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one recording: its answer in a few lines, or the code and facts of the refusal.

    ``version`` is that of its report; ``changes`` name what is different from the version before, if this is
    a new one.
    """

    task: Task
    answer: tuple[str, ...] = ()
    code: str | None = None
    facts: Mapping[str, Fact] = field(default_factory=dict)
    repeated: bool = False
    version: int = 1
    changes: tuple[str, ...] = ()


def run_tasks(tasks: Sequence[Task], workers: int, on_progress: OnProgress) -> Iterator[Outcome]:
    """Run the tasks, ``workers`` at once; outcomes come as they are ready, those of an earlier run first.

    When the caller stops asking (Ctrl-C), the analyses under way are ended and leave nothing behind.
    """
    stopping = threading.Event()

    def do(task: Task) -> Outcome:
        def go_on(stage: str | None, fraction: float) -> bool:
            on_progress(task, stage, fraction)
            return not stopping.is_set()

        return do_task(task, go_on)

    with ThreadPoolExecutor(workers) as pool:
        begun = sorted(tasks, key=lambda task: not (task.folder / MARKER).exists())
        futures = [pool.submit(do, task) for task in begun]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            stopping.set()
            pool.shutdown(cancel_futures=True)


def do_task(task: Task, go_on: GoOn) -> Outcome:
    """Analyse one recording into its folder; whatever happens to it is an outcome, never an exception."""
    try:
        restore_earlier(task.folder)
        before = read_marker(task.folder)
        asked = make_marker(task) if before else None
        if before is None or asked is None or before.fingerprint != asked.fingerprint or task.force:
            return _do(task, before, asked, go_on)
        if not has_report(task.folder, before, task.request):
            return _rewrite(task, before, go_on)
        switch_language(task.folder, before, asked.language)
        return Outcome(task, _read_answer(task), repeated=True, version=before.version)
    except OSError as error:
        return Outcome(task, code=UNREADABLE_PATH, facts={"why": error.strerror or str(error)})


def find_done(task: Task) -> Outcome | None:
    """Give what an earlier run made of the same bytes by the same settings; None where it is not whole."""
    try:
        if task.force or not is_up_to_date(task):
            return None
        before = read_marker(task.folder)
        if before is None or not has_report(task.folder, before, task.request):
            return None
        switch_language(task.folder, before, task.request.languages[0])
        return Outcome(task, _read_answer(task), repeated=True, version=before.version)
    except OSError:
        return None


def _do(task: Task, before: Marker | None, asked: Marker | None, go_on: GoOn) -> Outcome:
    """Analyse; other settings than before make the next version, the same (``--force``) are the same report.

    ``asked`` is None if nothing was made before: then the log is hashed while it is read.
    """
    refuse_foreign_folder(task.folder)
    version, changes = find_last_version(task.folder) + 1, tuple[str, ...]()
    if before is not None and asked is not None:
        version, changes = before.version, before.changes
        if before.fingerprint != asked.fingerprint:
            version, changes = version + 1, find_changes(before, asked)
    request = replace(task.request, version=version, changes=changes)
    with open_staging(task.folder) as staging:
        known = KnownLogs(tuple(asked.input.split()) if asked else ())
        outcome = _attempt(task, request, staging, partial(load_and_make_report, known=known), go_on)
        if outcome.code:
            return outcome
        marker = asked or make_marker(task, read_digest(staging, task))
        use_plain_names(staging, marker.language)
        write_marker(staging, replace(marker, version=version, changes=changes))
        replace_folder(task.folder, staging)
    return replace(outcome, answer=_read_answer(task), version=version, changes=changes)


def _rewrite(task: Task, before: Marker, go_on: GoOn) -> Outcome:
    """Write the finished analysis in another language or form, or for another paper; nothing is analysed."""
    language = task.request.languages[0]
    with open_staging(task.folder) as staging:
        outcome = _attempt(task, task.request, staging, load_and_render_again(task.folder), go_on)
        if outcome.code:
            return outcome
        if language == before.language:
            use_plain_names(staging, language)
        for path in (*staging.glob("report.*"), *staging.glob("answer.*")):
            path.replace(task.folder / path.name)
        if "pdf" in task.request.kinds:
            before = replace(before, papers={**before.papers, language: task.request.paper})
            write_marker(task.folder, before)
        switch_language(task.folder, before, language)
    return replace(outcome, answer=_read_answer(task), repeated=True, version=before.version)


def _attempt(task: Task, request: ReportRequest, staging: Path, make: MakeReport, go_on: GoOn) -> Outcome:
    from app.settings import Settings  # noqa: PLC0415  with pydantic, while the science is loaded elsewhere

    limits = choose_limits(Settings(), task.log.stat().st_size)
    outcome = run_attempt(Attempt(task.log, request, staging, make, limits), go_on)
    if isinstance(outcome, Refused):
        return Outcome(task, code=outcome.code, facts=outcome.facts)
    if isinstance(outcome, Unstarted):
        return Outcome(task, code=Interrupted.code)
    if not isinstance(outcome, Finished):
        return Outcome(task, code=Crashed.code, facts={"attempts": 1})
    return Outcome(task)


def _read_answer(task: Task) -> tuple[str, ...]:
    return tuple((task.folder / "answer.txt").read_text("utf-8").splitlines())
