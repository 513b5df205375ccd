"""The kernels are compiled once after an installation: beside the first analysis, and people are told.

The fork server starts a process that compiles from the end of an analysis (:mod:`fusion.prepare`), while the
first analysis compiles what it comes to. Until both have met, every stage is told as "preparing".
"""

import importlib
import os
import threading
from pathlib import Path

from app.request import OnStage, Stage

TICK_S = 0.5
LOCK = "preparing.lock"


def prepare_beside() -> None:
    """Compile in a process of its own where that is still to be done, and return at once.

    The process is the grandchild of a fork, so that nobody waits for it; it outlives this one. Call this
    before any thread has begun, with :mod:`fusion.numba_kernels` loaded.
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
            for stream in range(3):  # keep no output open whose end somebody may wait for
                os.dup2(nothing, stream)
            folder: Path = importlib.import_module("fusion.numba_kernels").make_kernel_folder()
            if _take_turn(folder):
                importlib.import_module("fusion.prepare").prepare()
    finally:
        os._exit(0)


def _measure_progress() -> float:
    progress: float = importlib.import_module("fusion.numba_kernels").measure_progress()
    return progress


def _take_turn(folder: Path) -> bool:
    """Hold the lock on preparing a folder until this process ends; False where another holds it."""
    fcntl = importlib.import_module("fcntl")
    turn = os.open(folder / LOCK, os.O_CREAT | os.O_RDWR, 0o600)
    try:
        fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def tell_preparing(on_stage: OnStage) -> OnStage:
    """Return a listener that tells "preparing" and how far it is, for as long as kernels are compiled."""
    return on_stage if _measure_progress() >= 1.0 else _Preparing(on_stage)


class _Preparing:
    """Tells "preparing" in place of each stage before the last, several times a second."""

    def __init__(self, on_stage: OnStage) -> None:
        self._on_stage = on_stage
        self._lock = threading.Lock()
        self._stage: tuple[Stage, float] | None = None
        self._over = False
        threading.Thread(target=self._tick, daemon=True).start()

    def __call__(self, stage: Stage, fraction: float) -> None:
        with self._lock:
            self._stage = (stage, fraction)
            self._tell()

    def _tick(self) -> None:
        pause = threading.Event()
        while not pause.wait(TICK_S):
            with self._lock:
                if self._over:
                    return
                self._tell()

    def _tell(self) -> None:
        if self._stage is None:
            return
        progress = _measure_progress()
        self._over = self._over or progress >= 1.0 or self._stage[0] == "rendering"
        if self._over:
            self._on_stage(*self._stage)
        else:
            self._on_stage("preparing", progress)
