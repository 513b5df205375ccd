"""Whether the holder of a job still lives.

A lease is watched, not stamped: the holder raises a counter, and whoever sees it stand still for the lease's
length by his own monotonic clock may take the job. No clock is compared with another, so a stepped clock
expires nothing. A holder on the same computer is looked up among its processes, which takes no waiting.
"""

import logging
import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy.exc import OperationalError

from app.jobs.job import Claim, Claimer
from app.jobs.store import JobStore

# The beats of one claim, from its taking to its publication.


logger = logging.getLogger(__name__)


class Heart:
    """Says that the holder of a claim lives, in a thread of its own.

    A large recording may take longer to come from a bucket, or the results to go there, than a lease lasts;
    a holder who beat only while the analysis runs would be taken for dead meanwhile.
    """

    def __init__(self, store: JobStore, claim: tuple[str, str], heartbeat_s: float) -> None:
        self._store, self._claim, self._heartbeat_s = store, claim, heartbeat_s
        self._news: tuple[str | None, float] = (None, 0.0)
        self._writing = threading.Lock()

    @contextmanager
    def beating(self) -> Iterator["Heart"]:
        """Beat until the end of the block."""
        ended = threading.Event()
        thread = threading.Thread(target=self._beat_until, args=(ended,), name="heart", daemon=True)
        thread.start()
        try:
            yield self
        finally:
            ended.set()
            thread.join()

    def tell(self, stage: str | None, fraction: float) -> bool:
        """Write down how far the analysis is; False when the claim is no longer ours.

        While the database is away nobody can take the job: we go on, and the end is guarded anyway.
        """
        try:
            return self._write_or_look((stage, fraction))
        except OperationalError:
            logger.warning("%s: no heartbeat, the database does not answer", self._claim[0])
            return True

    def _write_or_look(self, news: tuple[str | None, float]) -> bool:
        with self._writing:
            if news == self._news:
                return self._store.owns(*self._claim)
            self._news = news
            return self._store.beat(*self._claim, *news)

    def _beat_until(self, ended: threading.Event) -> None:
        while not ended.wait(self._heartbeat_s):
            try:
                with self._writing:
                    self._store.beat(*self._claim, *self._news)
            except OperationalError:
                logger.warning("%s: no heartbeat, the database does not answer", self._claim[0])


# The pulse of a worker process: how a hanging worker is found.
#
# A worker beats into a pipe, and its pool replaces one that is silent. Both sides count their own running
# time in ticks, so that a computer that sleeps, or a server stopped together with its workers, makes nobody
# silent. A worker whose loop stands still while its threads live (a disk or a network that never answers)
# ends itself.


BEAT_S = 1.0
STANDSTILL_S = 3600.0
"""Far longer than the longest step of a worker, the copy of a large recording from a bucket."""

START_TIMES = 5


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


_BOOT = Path("/proc/sys/kernel/random/boot_id")


def identify_self() -> Claimer:
    """Say which process this is."""
    return Claimer(_identify_place(), os.getpid(), _find_start(os.getpid()) or "")


def _identify_place() -> str:
    """Name the computer, its boot and its process namespace (two containers may share a name)."""
    if not _BOOT.exists():
        return socket.gethostname()
    namespace = Path("/proc/self/ns/pid").readlink()
    return f"{socket.gethostname()} {_BOOT.read_text().strip()} {namespace}"


def _find_start(pid: int) -> str | None:
    """When a process started, in the kernel's ticks; None when it is dead or cannot be looked up."""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    state, start = after_name[0], after_name[19]
    return None if state in "ZX" else start


@dataclass(slots=True)
class LeaseWatch:
    """What one worker has seen of the others' leases."""

    me: Claimer
    lease_s: float
    _seen: dict[tuple[str, str, int], float] = field(default_factory=dict)

    def find_abandoned(self, claims: tuple[Claim, ...]) -> tuple[Claim, ...]:
        """Give the claims whose holder is dead, or has not beaten for the length of the lease."""
        now_s = time.monotonic()
        keys = {claim: (claim.analysis_id, claim.token, claim.beats) for claim in claims}
        self._seen = {key: self._seen.get(key, now_s) for key in keys.values()}
        return tuple(
            claim
            for claim in claims
            if self._is_dead(claim.claimer) or now_s - self._seen[keys[claim]] > self.lease_s
        )

    def _is_dead(self, claimer: Claimer) -> bool:
        if claimer.place != self.me.place or not claimer.started:
            return False
        return _find_start(claimer.pid) != claimer.started
