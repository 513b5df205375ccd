"""The fork server: it loads the science once, and starts every child process.

The module is small, so that the command line can start the fork server before it has loaded itself.

The fork server may itself be killed, or hang. A running child does not need it: the child continues, and its
result counts. A process that waits in vain for the fork server (to start a child, to report its end) ends it
and starts another.
"""

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
from typing import Any

MODULES = ("app.analysis.attempt", "app.analysis.run", "app.analysis.inspect")


def load() -> None:
    """Load what every child needs, and the part of the compiler that reads the cache of compiled code.

    The garbage collector is off meanwhile: nothing that is loaded here is ever freed, and the collections
    take a sixth of the time. Frozen objects are not visited in the children either, so that the memory
    shared with them stays shared.
    """
    gc.disable()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # numpy's matrices here are small; threads wait busily
    for name in MODULES:
        importlib.import_module(name)
    importlib.import_module("fusion.numba_kernels").make_ready()
    gc.freeze()
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    gc.enable()
    importlib.import_module("app.analysis.preparing").prepare_beside()


OBJECTS_BETWEEN_COLLECTIONS = 50_000
"""A child lives for seconds: Python's 700 would have it look for waste hundreds of times."""

PRELOAD = "app.analysis.preloaded"
"""The module that the fork server loads first."""

TICK_S = 1.0
START_TICKS, START_TRIES = 180, 3
"""Loading the science takes seconds, and minutes on a very busy machine."""
END_TICKS = 10

logger = logging.getLogger(__name__)


class NotStarted(Exception):
    """No child could be started: the machine is at fault, never a file."""


def choose_context() -> Any:
    """Choose the fork server where there is one: it has imported the science, and has no threads of ours."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([PRELOAD])
    return context


def warm_up() -> None:
    """Start the fork server, which imports the science, so that the first job need not wait for it."""
    if choose_context().get_start_method() == "forkserver":
        forkserver.ensure_running()


def warm_up_and_wait() -> None:
    """Start the fork server and wait until it has imported the science, so that no claimed job waits."""
    child = choose_context().Process(target=int, daemon=True)
    with suppress(NotStarted):
        start_child(child)
        end_child(child)


def start_child(child: BaseProcess) -> None:
    """Start a child, by a new fork server where the first is dead or does not answer. Raises NotStarted."""
    for _ in range(START_TRIES):
        try:
            with _ending_hung_server():
                child.start()
                return
        except (EOFError, OSError) as error:
            logger.warning("no child was started: %s", error or type(error).__name__)
            end_fork_server()
    raise NotStarted


def end_child(child: BaseProcess) -> None:
    """Kill a child, and wait until its end is reported; a fork server that does not report it is ended."""
    child.kill()
    for _ in range(END_TICKS):
        child.join(TICK_S)
        if child.exitcode is not None:
            return
    logger.error("the end of child %s is not reported; the fork server is ended", child.pid)
    end_fork_server()
    child.join(TICK_S)


def end_fork_server() -> None:
    """Kill the fork server if there is one; the next child starts a new one."""
    pid = getattr(forkserver._forkserver, "_forkserver_pid", None)  # noqa: SLF001 - it has no public name
    if pid is not None:
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(pid, signal.SIGKILL)
            os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)  # dead for sure; multiprocessing collects it


@contextmanager
def _ending_hung_server() -> Iterator[None]:
    """End the fork server when the block takes too long, in ticks of our own running time."""
    done = threading.Event()

    def watch() -> None:
        for _ in range(START_TICKS):
            if done.wait(TICK_S):
                return
        logger.error("the fork server does not answer and is ended")
        end_fork_server()

    threading.Thread(target=watch, name="start-watch", daemon=True).start()
    try:
        yield
    finally:
        done.set()
