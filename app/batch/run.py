"""Run the analyses of a batch, each in a child process with limits; finished ones are not repeated."""

import hashlib
import json
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from acromion.app.analysis.attempt import (
    Attempt,
    Finished,
    MakeReport,
    Refused,
    Unstarted,
    choose_limits,
    load_and_make_report,
    load_and_set_again,
    run_attempt,
)
from acromion.app.batch.folder import (
    MARKER,
    SHARDS,
    Marker,
    Task,
    build_marker,
    check_own_folder,
    compute_fingerprint,
    describe_paper,
    find_changes,
    get_last_version,
    has_report,
    is_up_to_date,
    open_staging,
    read_marker,
    replace_folder,
    restore_earlier,
    switch_language,
    use_plain_names,
    write_marker,
)
from acromion.app.errors import UNREADABLE_PATH, Crashed, Interrupted
from acromion.app.request import ReportRequest
from acromion.app.store.folder import KnownFiles, hash_file, write_durably
from acromion.fusion.errors import DOUBLE_RECORDING, Fact

# The number of recordings analysed in parallel.


NEED_BYTES = 1_200_000_000
"""Memory of one analysis of 14.4 million samples, as measured by ``benchmarks/road.py``, with a margin."""


@dataclass(frozen=True, slots=True)
class Capacity:
    """The available cores and free memory."""

    cores: int
    free_bytes: int


def measure_capacity() -> Capacity:
    """Return the cores that this process may use, and the free memory."""
    import psutil  # noqa: PLC0415  not needed for a single recording

    allowed = getattr(os, "sched_getaffinity", None)
    cores = len(allowed(0)) if allowed else os.cpu_count() or 1
    return Capacity(cores, psutil.virtual_memory().available)


def choose_workers(recordings: int, capacity: Capacity) -> int:
    """Return the number of workers that fits into memory and leaves one core free; at least one."""
    return max(1, min(recordings, capacity.cores - 1, capacity.free_bytes // NEED_BYTES))


OnProgress = Callable[[Task, str | None, float], None]
GoOn = Callable[[str | None, float], bool]
"""Receives the stage and its progress; return False to stop the analysis."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of one recording: its answer in a few lines, or the code and facts of the refusal.

    ``version`` is that of its report; ``changes`` are the differences from the previous version.
    """

    task: Task
    answer: tuple[str, ...] = ()
    code: str | None = None
    facts: Mapping[str, Fact] = field(default_factory=dict)
    repeated: bool = False
    version: int = 1
    changes: tuple[str, ...] = ()


def find_sha256(outcome: Outcome) -> str:
    """Return the hash of a recording without results; "" if it was not reached or cannot be opened."""
    if outcome.code == Interrupted.code:
        return ""
    try:
        return outcome.task.sha256 or hash_file(outcome.task.log)
    except OSError:
        return ""


def run_tasks(tasks: Sequence[Task], workers: int, on_progress: OnProgress) -> Iterator[Outcome]:
    """Run the tasks, ``workers`` at once; yield outcomes when ready, finished recordings first.

    If the caller stops early (Ctrl-C), running analyses are stopped without leaving files.
    """
    stopping = threading.Event()

    def do(task: Task) -> Outcome:
        def go_on(stage: str | None, fraction: float) -> bool:
            on_progress(task, stage, fraction)
            return not stopping.is_set()

        return run_task(task, go_on)

    with ThreadPoolExecutor(workers) as pool:
        begun = sorted(tasks, key=lambda task: not (task.folder / MARKER).exists())
        futures = [pool.submit(do, task) for task in begun]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            stopping.set()
            pool.shutdown(cancel_futures=True)


def run_task(task: Task, go_on: GoOn) -> Outcome:
    """Analyse one recording into its folder; every error becomes an outcome."""
    if refused := _find_refusal(task):
        return refused
    try:
        restore_earlier(task.folder)
        before = read_marker(task.folder)
        asked = build_marker(task) if before else None
        if before is None or asked is None or before.fingerprint != asked.fingerprint or task.force:
            return _do(task, before, asked, go_on)
        if not has_report(task.folder, before, task.request):
            return _rewrite(task, before, go_on)
        return _reuse(task, before)
    except OSError as error:
        return Outcome(task, code=UNREADABLE_PATH, facts={"why": error.strerror or str(error)})


def find_finished(task: Task) -> Outcome | None:
    """Return the result of an earlier run with the same bytes and settings; None if there is none."""
    if refused := _find_refusal(task):
        return refused
    try:
        if task.force or not is_up_to_date(task):
            return None
        before = read_marker(task.folder)
        if before is None or not has_report(task.folder, before, task.request):
            return None
        return _reuse(task, before)
    except OSError:
        return None


def _find_refusal(task: Task) -> Outcome | None:
    """Return the outcome of a task that is not analysed: it is a double, or has no such shift."""
    if task.code:
        return Outcome(task, code=task.code, facts=task.facts)
    if not task.double_of:
        return None
    is_export = task.name.lower().endswith(".csv") and task.double_of.lower().endswith(".gt3x")
    why = "own export" if is_export else "same bytes"
    return Outcome(task, code=DOUBLE_RECORDING, facts={"why": why, "first": task.double_of})


def _reuse(task: Task, before: Marker) -> Outcome:
    switch_language(task.folder, before, task.request.languages[0])
    return Outcome(task, _read_answer(task), repeated=True, version=before.version)


def _do(task: Task, before: Marker | None, asked: Marker | None, go_on: GoOn) -> Outcome:
    """Analyse a recording; changed settings make a new version, unchanged settings (``--force``) do not.

    ``asked`` is None if there is no earlier report; the recording is then hashed while it is read.
    """
    check_own_folder(task.folder)
    version, changes = get_last_version(task.folder) + 1, tuple[str, ...]()
    if before is not None and asked is not None:
        version, changes = before.version, before.changes
        if before.fingerprint != asked.fingerprint:
            version, changes = version + 1, find_changes(before, asked)
    request = replace(task.request, version=version, changes=changes)
    with open_staging(task.folder) as staging:
        digests = asked.input.split() if asked else filter(None, [task.sha256])
        known = KnownFiles(tuple(digests))
        outcome = _attempt(task, request, staging, partial(load_and_make_report, known=known), go_on)
        if outcome.code:
            return outcome
        marker = asked
        if marker is None:  # the reader has computed the SHA-256
            results = json.loads((staging / "results.json").read_bytes())
            marker = build_marker(task, "" if task.request.joined else results["recording"]["sha256"])
        use_plain_names(staging, marker.language)
        write_marker(staging, replace(marker, version=version, changes=changes))
        replace_folder(task.folder, staging)
    return replace(outcome, answer=_read_answer(task), version=version, changes=changes)


def _rewrite(task: Task, before: Marker, go_on: GoOn) -> Outcome:
    """Render a finished analysis in another language, format or paper size without analysing it again."""
    language = task.request.languages[0]
    request = replace(task.request, version=before.version, changes=before.changes)
    with open_staging(task.folder) as staging:
        outcome = _attempt(task, request, staging, load_and_set_again, go_on, task.folder / "results.json")
        if outcome.code:
            return outcome
        if language == before.language:
            use_plain_names(staging, language)
        for path in (*staging.glob("report.*"), *staging.glob("answer.*")):
            path.replace(task.folder / path.name)
        if "pdf" in task.request.kinds:
            before = replace(before, papers={**before.papers, language: describe_paper(task.request)})
            write_marker(task.folder, before)
        switch_language(task.folder, before, language)
    return replace(outcome, answer=_read_answer(task), repeated=True, version=before.version)


def _attempt(
    task: Task,
    request: ReportRequest,
    staging: Path,
    make: MakeReport,
    go_on: GoOn,
    results: Path | None = None,
) -> Outcome:
    """Make an attempt from the recording, or from the results of a finished analysis."""
    from acromion.app.settings import Settings  # noqa: PLC0415  loads pydantic while numpy is loaded elsewhere

    limits = choose_limits(Settings(), task.log.stat().st_size)
    outcome = run_attempt(Attempt(results or task.log, request, staging, make, limits), go_on)
    if isinstance(outcome, Refused):
        return Outcome(task, code=outcome.code, facts=outcome.facts)
    if isinstance(outcome, Unstarted):
        return Outcome(task, code=Interrupted.code)
    if not isinstance(outcome, Finished):
        return Outcome(task, code=Crashed.code, facts={"attempts": 1})
    return Outcome(task)


def _read_answer(task: Task) -> tuple[str, ...]:
    return tuple((task.folder / "answer.txt").read_text("utf-8").splitlines())


# Sharding: one run as several processes.


SHARD_HINT = "K/N, 1 <= K <= N"
_PLAN = "plan.json"


@dataclass(frozen=True, slots=True)
class Shard:
    """The K-th of N slices; K counts from 1."""

    number: int
    count: int

    def select(self, tasks: Sequence[Task]) -> list[Task]:
        """Return every N-th task in path order; the sizes of the slices differ by at most one recording."""
        ordered = sorted(tasks, key=lambda task: (task.name, task.place))
        return ordered[self.number - 1 :: self.count]

    @property
    def stem(self) -> str:
        """The name of its file of failures, without ".json"."""
        return f"{self.number}-of-{self.count}"

    def __str__(self) -> str:
        """Format the shard as typed: K/N."""
        return f"{self.number}/{self.count}"


def parse_shard(text: str) -> Shard:
    """Parse ``K/N``. Raises ValueError."""
    number, count = (int(part) for part in text.split("/"))
    if not 1 <= number <= count:
        raise ValueError(SHARD_HINT)
    return Shard(number, count)


class ShardRecord:
    """The files of one slice for ``acromion collect``, in ``shards/`` of the results.

    ``plan.json`` lists every recording with its folder and request; every process writes the same content.
    ``K-of-N.json`` has the failures of one slice, which have no folder. Neither contains a path of this
    computer.
    """

    def __init__(self, out: Path, shard: Shard, tasks: Sequence[Task], request: ReportRequest) -> None:
        recordings = [
            {
                "path": task.name,
                "folder": task.place,
                "request": replace(task.request, joined=()).to_json(),
                "further": dict(task.further),
                "double_of": task.double_of,
            }
            for task in tasks
        ]
        self._folder, self._shard = out / SHARDS, shard
        self._content = _encode({"request": request.to_json(), "recordings": recordings})
        self._plan_sha256 = hashlib.sha256(self._content).hexdigest()

    def begin(self) -> None:
        """Write the plan; clear the failures of this slice, and of runs with another number of slices."""
        self._folder.mkdir(parents=True, exist_ok=True)
        plan = self._folder / _PLAN
        if not plan.exists() or plan.read_bytes() != self._content:
            write_durably(plan, self._content)
        for path in self._folder.glob("*-of-*.json"):
            if not path.name.endswith(f"-of-{self._shard.count}.json"):
                path.unlink(missing_ok=True)
        self.write(())

    def write(self, outcomes: Sequence[Outcome]) -> None:
        """Write the failures of this slice."""
        problems = {
            one.task.name: {"code": one.code, "facts": dict(one.facts), "sha256": find_sha256(one)}
            for one in outcomes
            if one.code
        }
        body = _encode({"plan": self._plan_sha256, "problems": problems})
        write_durably(self._folder / f"{self._shard.stem}.json", body)


@dataclass(frozen=True, slots=True)
class Collected:
    """The results of all slices.

    ``undone``: slices ("K/N") with recordings that are not analysed yet. ``differing``: slices that ran with
    other files or options than the last started slice.
    """

    outcomes: list[Outcome]
    request: ReportRequest
    undone: tuple[str, ...]
    differing: tuple[str, ...]


def collect_outcomes(out: Path) -> Collected:
    """Return the outcome of every recording of the plan, in order, and the settings of the run.

    A recording with neither a report nor a failure counts as not done, because a killed process writes
    nothing.

    Raises OSError, ValueError, KeyError or TypeError if no process with ``--shard`` has run, or its plan
    cannot be read.
    """
    content = (out / SHARDS / _PLAN).read_bytes()
    plan, plan_sha256 = json.loads(content), hashlib.sha256(content).hexdigest()
    records = {path.stem: json.loads(path.read_bytes()) for path in (out / SHARDS).glob("*-of-*.json")}
    others = {stem for stem, record in records.items() if record["plan"] != plan_sha256}
    problems: dict[str, Mapping[str, Any]] = {}
    for stem in records.keys() - others:  # failures of other plans do not count
        problems |= records[stem]["problems"]
    outcomes = [_find_outcome(out, entry, problems.get(entry["path"])) for entry in plan["recordings"]]
    undone = {outcome.task.name for outcome in outcomes if outcome.code == Interrupted.code}
    tasks = [outcome.task for outcome in outcomes]
    count = max(int(stem.split("-of-")[1]) for stem in records)
    shards = [Shard(number, count) for number in range(1, count + 1)]
    return Collected(
        outcomes,
        ReportRequest.from_json(plan["request"]),
        tuple(str(one) for one in shards if any(task.name in undone for task in one.select(tasks))),
        tuple(str(one) for one in shards if one.stem in others),
    )


def _encode(value: Any) -> bytes:
    return (json.dumps(value, ensure_ascii=False, indent=1) + "\n").encode()


def _find_outcome(out: Path, entry: Mapping[str, Any], problem: Mapping[str, Any] | None) -> Outcome:
    """Return the outcome of one recording: its failure, its report, or not done."""
    request = ReportRequest.from_json(entry["request"])
    known = {name: entry[name] for name in ("path", "further", "double_of")}
    task = Task(Path(entry["path"]), request, out / entry["folder"], out=out, **known)
    if problem is not None:
        task = replace(task, sha256=problem.get("sha256", ""))
        return Outcome(task, code=problem["code"], facts=problem["facts"])
    marker = read_marker(task.folder)
    is_current = marker is not None and marker.fingerprint == compute_fingerprint(marker.input, request)
    if marker is None or not is_current or not has_report(task.folder, marker, request):
        return Outcome(task, code=Interrupted.code)
    return Outcome(task, version=marker.version)
