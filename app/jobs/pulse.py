"""The pulse of a worker process: how a hanging worker is found.

A worker beats into a pipe, and its pool replaces one that is silent. Both sides count their own running time
in ticks, so that a computer that sleeps, or a server stopped together with its workers, makes nobody silent.
A worker whose loop stands still while its threads live (a disk or a network that never answers) ends itself.
"""

import logging
import os
import threading
from contextlib import suppress
from dataclasses import dataclass

BEAT_S = 1.0
STANDSTILL_S = 3600.0
"""Far longer than the longest step of a worker, the copy of a large recording from a bucket."""

START_TIMES = 5

logger = logging.getLogger(__name__)


class Pulse:
    """Beats while the loop of this worker goes on."""

    def __init__(self, descriptor: int | None = None, standstill_s: float = STANDSTILL_S) -> None:
        self._descriptor = descriptor
        self._most_beats = round(standstill_s / BEAT_S)
        self._beats_since_step = 0
        self._ended = threading.Event()

    def start(self) -> None:
        """Begin to beat, in a thread of its own."""
        if self._descriptor is not None:
            os.set_inheritable(self._descriptor, False)  # noqa: FBT003 - os names no argument
            os.set_blocking(self._descriptor, False)
        threading.Thread(target=self._beat_for_ever, name="pulse", daemon=True).start()

    def stop(self) -> None:
        """Beat no more."""
        self._ended.set()

    def step(self) -> None:
        """Report that the loop goes on."""
        self._beats_since_step = 0

    def _beat_for_ever(self) -> None:
        while self._beats_since_step < self._most_beats:
            if self._descriptor is not None:
                with suppress(OSError):  # the pool is gone, or has not read for hours
                    os.write(self._descriptor, b".")
            if self._ended.wait(BEAT_S):
                return
            self._beats_since_step += 1
        logger.critical("the worker has stood still for %.0f s and ends itself", self._most_beats * BEAT_S)
        os._exit(1)


@dataclass(slots=True)
class SilenceCount:
    """How long a worker has been silent, in ticks of the pool.

    Time in which the pool itself did not run is no silence. Until its first beat a worker loads its program,
    and may take ``START_TIMES`` as long.
    """

    most_ticks: int
    _ticks: int = 0
    _beaten: bool = False

    def is_too_long(self, *, heard: bool) -> bool:
        """Count one tick, in which the worker was heard or not; tell whether its silence is too long."""
        self._beaten = self._beaten or heard
        self._ticks = 0 if heard else self._ticks + 1
        return self._ticks > self.most_ticks * (1 if self._beaten else START_TIMES)


def read_pulse(descriptor: int) -> bool:
    """Tell whether a worker has beaten since the last look."""
    try:
        return bool(os.read(descriptor, 1 << 16))
    except BlockingIOError:
        return False
