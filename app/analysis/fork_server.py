"""The fork server: it loads ``fusion`` once and starts every child process.

The module is small, so that the command line can start the fork server before it has loaded itself.

The fork server itself may be killed or hang. A running child does not need it: the child continues, and its
result counts. A process that waits too long for the fork server (to start a child or report its end) kills it
and starts another.
"""

from __future__ import annotations

import gc
import importlib
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import forkserver
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the command line starts the fork server before it loads anything else
    from acromion.app.request import OnStage, Stage

MODULES = (
    "acromion.app.analysis.attempt",
    "acromion.app.analysis.run",
    "acromion.app.analysis.inspect",
    "acromion.app.live.child",
)


def load() -> None:
    """Load what every child needs, including the compiler part that reads cached compiled code.

    The garbage collector is off during loading, because loaded modules are never freed and collections would
    take a sixth of the loading time. The loaded objects are then frozen: the collectors of the children do
    not visit them, and their memory stays shared.
    """
    gc.disable()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # numpy's matrices here are small; threads wait busily
    for name in MODULES:
        importlib.import_module(name)
    importlib.import_module("acromion.fusion.numba_kernels").make_ready()
    gc.freeze()
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    gc.enable()
    prepare_beside()


OBJECTS_BETWEEN_COLLECTIONS = 50_000
"""A child lives for seconds: with Python's 700 it would run hundreds of collections."""

PRELOAD = "acromion.app.analysis.preloaded"
"""The module that the fork server loads first."""

TICK_S = 1.0
START_TICKS, START_TRIES = 180, 3
"""Loading ``fusion`` takes seconds, and minutes on a very busy machine."""
END_TICKS = 10

logger = logging.getLogger(__name__)


class NotStarted(Exception):
    """No child could be started; the cause is the machine, never a file."""


def choose_context() -> Any:
    """Return the fork server's context if available; it has ``fusion`` but none of our threads."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([PRELOAD])
    return context


def warm_up() -> None:
    """Start the fork server, which imports ``fusion``, so that the first job need not wait."""
    if choose_context().get_start_method() == "forkserver":
        forkserver.ensure_running()


def warm_up_and_wait() -> None:
    """Start the fork server and wait until it has imported ``fusion``, so that no claimed job waits."""
    child = choose_context().Process(target=int, daemon=True)
    with suppress(NotStarted):
        start_child(child)
        end_child(child)


def start_child(child: BaseProcess) -> None:
    """Start a child, with a new fork server if the current one is dead or hangs. Raises NotStarted."""
    for _ in range(START_TRIES):
        try:
            with _killing_hung_server():
                child.start()
                return
        except (EOFError, OSError) as error:
            logger.warning("no child was started: %s", error or type(error).__name__)
            end_fork_server()
    raise NotStarted


def end_child(child: BaseProcess) -> None:
    """Kill a child and wait until its end is reported; kill a fork server that does not report it."""
    child.kill()
    for _ in range(END_TICKS):
        child.join(TICK_S)
        if child.exitcode is not None:
            return
    logger.error("the end of child %s is not reported; killing the fork server", child.pid)
    end_fork_server()
    child.join(TICK_S)


def end_fork_server() -> None:
    """Kill the fork server if there is one; the next child starts a new one."""
    pid = getattr(forkserver._forkserver, "_forkserver_pid", None)  # noqa: SLF001 - it has no public name
    if pid is not None:
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(pid, signal.SIGKILL)
            os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)  # certainly dead; multiprocessing collects it


@contextmanager
def _killing_hung_server() -> Iterator[None]:
    """Kill the fork server if the block takes too long, counted in ticks while this process runs."""
    done = threading.Event()

    def watch() -> None:
        for _ in range(START_TICKS):
            if done.wait(TICK_S):
                return
        logger.error("the fork server does not respond; killing it")
        end_fork_server()

    threading.Thread(target=watch, name="start-watch", daemon=True).start()
    try:
        yield
    finally:
        done.set()


# The kernels are compiled once after installation, beside the first analysis; people see its progress. The
# fork server starts a process that compiles in reverse order of use (:mod:`acromion.fusion.prepare`), while
# the first analysis compiles the kernels it needs. Until all are compiled, every stage is reported as
# "preparing".


REPORT_PERIOD_S = 0.5
LOCK = "preparing.lock"


def prepare_beside() -> None:
    """Compile in a separate process if needed, and return at once.

    The process is the grandchild of a fork, so that no process waits for it; it outlives this one. Call this
    before any thread has started, with :mod:`acromion.fusion.numba_kernels` loaded.
    """
    if not hasattr(os, "fork") or _measure_progress() >= 1.0:
        return
    child = os.fork()
    if child:
        os.waitpid(child, 0)
        return
    try:
        if os.fork() == 0:
            os.setsid()
            nothing = os.open(os.devnull, os.O_RDWR)
            for stream in range(3):  # close inherited output: a reader may wait for its end
                os.dup2(nothing, stream)
            folder: Path = importlib.import_module("acromion.fusion.numba_kernels").make_kernel_folder()
            if _lock_preparation(folder):
                importlib.import_module("acromion.fusion.prepare").prepare()
    finally:
        os._exit(0)


def _measure_progress() -> float:
    progress: float = importlib.import_module("acromion.fusion.numba_kernels").measure_progress()
    return progress


def _lock_preparation(folder: Path) -> bool:
    """Lock the preparation of a folder until this process ends; return False if another process has it."""
    fcntl = importlib.import_module("fcntl")
    turn = os.open(folder / LOCK, os.O_CREAT | os.O_RDWR, 0o600)
    try:
        fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def report_preparing(on_stage: OnStage) -> OnStage:
    """Return a listener that reports "preparing" and its progress while kernels are being compiled."""
    return on_stage if _measure_progress() >= 1.0 else _Preparing(on_stage)


class _Preparing:
    """Reports "preparing" in place of every stage except the last, several times a second."""

    def __init__(self, on_stage: OnStage) -> None:
        self._on_stage = on_stage
        self._lock = threading.Lock()
        self._stage: tuple[Stage, float] | None = None
        self._over = False
        threading.Thread(target=self._tick, daemon=True).start()

    def __call__(self, stage: Stage, fraction: float) -> None:
        with self._lock:
            self._stage = (stage, fraction)
            self._report()

    def _tick(self) -> None:
        pause = threading.Event()
        while not pause.wait(REPORT_PERIOD_S):
            with self._lock:
                if self._over:
                    return
                self._report()

    def _report(self) -> None:
        if self._stage is None:
            return
        progress = _measure_progress()
        self._over = self._over or progress >= 1.0 or self._stage[0] == "rendering"
        if self._over:
            self._on_stage(*self._stage)
        else:
            self._on_stage("preparing", progress)
