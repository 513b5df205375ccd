"""One attempt at a job in a child process: its limits, messages and outcomes."""

import importlib
import json
import logging
import multiprocessing
import os
import secrets
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import wait as wait_for_futures
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from acromion.app.analysis.fork_server import (
    NotStarted,
    choose_context,
    end_child,
    report_preparing,
    start_child,
)
from acromion.app.errors import (
    AppError,
    AttemptFailed,
    Crashed,
    InternalError,
    Interrupted,
    OutOfMemory,
    OutOfTime,
    RecordedProblem,
)
from acromion.app.logs import start_logging
from acromion.app.request import OnStage, ReportRequest, Stage
from acromion.app.store.folder import (
    NOTHING_KNOWN,
    KnownFiles,
    ResultFile,
    describe_files,
    translate_disk_full,
)
from acromion.fusion.errors import Fact, FusionError

if TYPE_CHECKING:  # a child also loads this module, and does not need pydantic
    from acromion.app.report.findings import ReleaseStamp
    from acromion.app.settings import Settings

if sys.platform != "win32":
    import resource

MakeReport = Callable[[Path, ReportRequest, Path, OnStage], object]
OnProgress = Callable[[str | None, float], bool]
T = TypeVar("T")

TICK_S = 0.2
NICENESS = 5
MESSAGE_BYTES = 1 << 20

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Limits:
    """The resources of one attempt; an attempt without progress is ended after half of ``wall_s``."""

    memory_bytes: int
    wall_s: float


@dataclass(frozen=True, slots=True)
class Attempt:
    """The input of one attempt: the file, the request, and the output folder.

    ``gives_way``: run at a lower priority than the pages and uploads of the same machine.
    """

    recording_path: Path
    request: ReportRequest
    out: Path
    make_report: MakeReport
    limits: Limits
    gives_way: bool = False


@dataclass(frozen=True, slots=True)
class Finished:
    """The files are written; the caller makes them durable."""

    files: tuple[ResultFile, ...]


@dataclass(frozen=True, slots=True)
class Refused:
    """No report can be made from this file; another attempt would end in the same way."""

    code: str
    facts: Mapping[str, Fact]


@dataclass(frozen=True, slots=True)
class Died:
    """The process ended without a message (killed, crashed)."""

    exit_code: int | None


@dataclass(frozen=True, slots=True)
class Stopped:
    """The worker ended the process because its result is no longer wanted."""


@dataclass(frozen=True, slots=True)
class Unstarted:
    """No child could be started; the cause is the machine, not the file."""


Outcome = Finished | Refused | Died | Stopped | Unstarted


def load_and_call(
    module: str, function: str, recording_path: Path, request: ReportRequest, out: Path, on_stage: OnStage
) -> None:
    """Call a function of a module that only the child process loads."""
    getattr(importlib.import_module(module), function)(recording_path, request, out, on_stage)


def load_and_make_report(
    recording_path: Path,
    request: ReportRequest,
    out: Path,
    on_stage: OnStage,
    known: KnownFiles = NOTHING_KNOWN,
) -> None:
    """Make a report; the child process loads ``fusion`` only here."""
    if request.reference is not None:
        importlib.import_module("acromion.app.analysis.validate").make_validation(
            recording_path, request, out, on_stage, has_curves=known.cache is not None
        )
    else:
        importlib.import_module("acromion.app.analysis.run").make_report(
            recording_path, request, out, on_stage, known
        )


def load_and_set_again(
    results: Path,
    request: ReportRequest,
    out: Path,
    on_stage: OnStage,
    release: "ReleaseStamp | None" = None,
) -> None:
    """Write a report with another label, or with its release, from the results of a finished analysis."""
    on_stage("rendering", 0.0)
    importlib.import_module("acromion.app.report.products").set_report_again(results, request, out, release)


def load_and_measure(recording_path: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Write when a recording starts and ends; the child process loads ``fusion`` only here."""
    importlib.import_module("acromion.app.analysis.inspect").write_extent(
        recording_path, request, out, on_stage
    )


def load_and_check(recording_path: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Check the stated times of a request; the child process loads ``fusion`` only here."""
    importlib.import_module("acromion.app.analysis.run").write_time_check(
        recording_path, request, out, on_stage
    )


def choose_limits(settings: "Settings", size_bytes: int) -> Limits:
    """Choose the limits of an attempt: a large file gets more time."""
    wall_s = settings.wall_limit_s + settings.wall_limit_s_per_gb * size_bytes / 1e9
    return Limits(settings.memory_limit_bytes, wall_s)


def run_attempt(attempt: Attempt, on_progress: OnProgress) -> Outcome:
    """Make the attempt in a child process and wait for it.

    ``on_progress`` is called several times a second with the stage and the completed fraction; if it returns
    False the child is killed.
    """
    context = choose_context()
    ours, theirs = context.Pipe(duplex=False)
    level = logging.getLogger().level  # a server logs more than a command on a terminal
    child = context.Process(target=_run_child, args=(attempt, theirs, level), daemon=True)
    try:
        run_beside(partial(start_child, child), lambda: on_progress(None, 0.0))
    except NotStarted:
        ours.close()
        return Unstarted()
    finally:
        theirs.close()
    try:
        return _follow(child, ours, attempt.limits, on_progress)
    finally:
        end_child(child)
        ours.close()


def run_beside(act: Callable[[], T], on_wait: Callable[[], object]) -> T:
    """Run a blocking call in a thread; call ``on_wait`` several times a second until it ends."""
    with ThreadPoolExecutor(1, "beside") as pool:
        work = pool.submit(act)
        while wait_for_futures([work], TICK_S).not_done:
            on_wait()
        return work.result()


def run_and_wait(attempt: Attempt) -> tuple[ResultFile, ...]:
    """Make an attempt while the caller waits; return the files.

    Raises
    ------
    RecordedProblem
        With the code and facts of the refusal.
    Crashed, Interrupted
        The child died, or none could be started.
    """
    outcome = run_attempt(attempt, lambda *_: True)
    if isinstance(outcome, Finished):
        return outcome.files
    if isinstance(outcome, Refused):
        raise RecordedProblem(outcome.code, outcome.facts)
    raise Interrupted if isinstance(outcome, Unstarted) else Crashed(attempts=1)


def _follow(child: BaseProcess, pipe: Connection, limits: Limits, on_progress: OnProgress) -> Outcome:
    """Read the child's messages. They are JSON: a child that has read hostile bytes is not trusted."""
    progress: tuple[str | None, float] = (None, 0.0)
    now_s = time.monotonic()
    end_s, still_end_s = now_s + limits.wall_s, now_s + limits.wall_s / 2.0
    while time.monotonic() < min(end_s, still_end_s):
        try:
            message = json.loads(pipe.recv_bytes(MESSAGE_BYTES)) if pipe.poll(TICK_S) else {}
        except (EOFError, OSError):
            child.join(5)
            return Died(child.exitcode)
        if "files" in message:
            return Finished(tuple(ResultFile(*file) for file in message["files"]))
        if "code" in message:
            return Refused(message["code"], message["facts"])
        latest = (message["stage"], message["fraction"]) if message else progress
        if latest != progress:
            progress, still_end_s = latest, time.monotonic() + limits.wall_s / 2.0
        if not on_progress(*progress):
            return Stopped()
    return _refuse(OutOfTime(s=round(limits.wall_s if end_s <= still_end_s else limits.wall_s / 2.0)))


def _run_child(attempt: Attempt, pipe: Connection, level: int) -> None:
    """Run in the child process."""
    prepare_child(attempt.limits, level, gives_way=attempt.gives_way)

    def send_stage(stage: Stage, fraction: float) -> None:
        _send(pipe, {"stage": stage, "fraction": fraction})

    result = _make_files(attempt, report_preparing(send_stage))
    if isinstance(result, Finished):
        _send(pipe, {"files": [(file.name, file.sha256, file.size_bytes) for file in result.files]})
    else:
        _send(pipe, {"code": result.code, "facts": dict(result.facts)})
    pipe.close()


def prepare_child(limits: Limits, level: int, *, gives_way: bool) -> None:
    """Apply the limits, follow the parent's end, and log at the parent's level."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which then ends the child
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    _apply_limits(limits)
    start_logging(logging.WARNING)
    logging.getLogger("acromion").setLevel(level)  # only ours: a library's messages may contain a file name
    if gives_way and sys.platform != "win32":
        os.nice(NICENESS)


def _make_files(attempt: Attempt, on_stage: OnStage) -> Finished | Refused:
    try:
        with translate_disk_full():
            attempt.make_report(attempt.recording_path, attempt.request, attempt.out, on_stage)
            return Finished(describe_files(attempt.out))
    except Exception as error:  # noqa: BLE001 - a bug becomes a failed job
        return describe_failure(error, attempt.limits)


def describe_failure(error: Exception, limits: Limits) -> Refused:
    """Return the code and facts of an error; a bug is logged with a reference."""
    if isinstance(error, FusionError | AppError):
        return Refused(error.code, error.facts)
    if isinstance(error, MemoryError):
        return _refuse(OutOfMemory(max=round(limits.memory_bytes / 1e9, 1)))
    reference = secrets.token_hex(4)
    logger.error("analysis failed, reference %s", reference, exc_info=error)
    return _refuse(InternalError(reference=reference))


def _refuse(error: AttemptFailed) -> Refused:
    return Refused(error.code, error.facts)


def _send(pipe: Connection, message: Mapping[str, object]) -> None:
    pipe.send_bytes(json.dumps(message).encode())


def _exit_with_parent() -> None:
    """Wait for the end of the worker, then exit."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _apply_limits(limits: Limits) -> None:
    """Set limits in the operating system, in case the worker cannot enforce them."""
    if sys.platform == "win32":
        return
    cpu_s = round(limits.wall_s * (os.cpu_count() or 1)) + 1
    wanted = {resource.RLIMIT_AS: limits.memory_bytes, resource.RLIMIT_CPU: cpu_s, resource.RLIMIT_CORE: 0}
    for which, value in wanted.items():
        _, hard = resource.getrlimit(which)
        lowered = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(which, (lowered, lowered))
