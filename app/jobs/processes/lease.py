"""Leases and heartbeats: whether the holder of a job, or a worker, still lives.

A lease is observed, not stamped: the holder increments a counter, and a worker that sees it stand still for
the length of the lease, by its own monotonic clock, may take the job. No clock is compared with another, so
that a stepped clock expires nothing. A holder on the same computer is looked up among its processes, without
waiting.

A worker also sends a heartbeat through a pipe to its pool, which replaces a silent worker. Both sides count
their own running time in ticks: a computer that sleeps, or a server stopped together with its workers, makes
no worker silent. A worker whose loop stands still while its threads live (a disk or a network that never
answers) ends itself.
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

BEAT_S = 1.0
STANDSTILL_S = 3600.0
"""Far longer than the longest step of a worker, the copy of a large recording from a bucket."""
START_TIMES = 5

_BOOT = Path("/proc/sys/kernel/random/boot_id")

logger = logging.getLogger(__name__)


class ClaimHeartbeat:
    """Shows that the holder of a claim lives, from the claim to the publication, in a thread of its own.

    Fetching a large recording from a bucket, or putting the results there, may last longer than a lease; a
    holder that sent heartbeats only while the analysis runs would be taken for dead meanwhile.
    """

    def __init__(self, store: JobStore, claim: tuple[str, str], heartbeat_s: float) -> None:
        self._store, self._claim, self._heartbeat_s = store, claim, heartbeat_s
        self._progress: tuple[str | None, float] = (None, 0.0)
        self._writing = threading.Lock()

    @contextmanager
    def running(self) -> Iterator["ClaimHeartbeat"]:
        """Send heartbeats until the end of the block."""
        ended = threading.Event()
        thread = threading.Thread(target=self._beat_until, args=(ended,), name="heartbeat", daemon=True)
        thread.start()
        try:
            yield self
        finally:
            ended.set()
            thread.join()

    def report(self, stage: str | None, fraction: float) -> bool:
        """Record how far the analysis is; False when the claim is no longer ours.

        While the database is away nobody can take the job: the attempt continues, and its end is guarded.
        """
        try:
            return self._write_or_check((stage, fraction))
        except OperationalError:
            logger.warning("%s: no heartbeat, the database does not answer", self._claim[0])
            return True

    def _write_or_check(self, progress: tuple[str | None, float]) -> bool:
        with self._writing:
            if progress == self._progress:
                return self._store.owns(*self._claim)
            self._progress = progress
            return self._store.beat(*self._claim, *progress)

    def _beat_until(self, ended: threading.Event) -> None:
        while not ended.wait(self._heartbeat_s):
            try:
                with self._writing:
                    self._store.beat(*self._claim, *self._progress)
            except OperationalError:
                logger.warning("%s: no heartbeat, the database does not answer", self._claim[0])


class WorkerHeartbeat:
    """Writes into the pipe of the pool while the loop of this worker makes steps."""

    def __init__(self, descriptor: int | None = None, standstill_s: float = STANDSTILL_S) -> None:
        self._descriptor = descriptor
        self._most_beats = round(standstill_s / BEAT_S)
        self._beats_since_step = 0
        self._ended = threading.Event()

    def start(self) -> None:
        """Start the heartbeat, in a thread of its own."""
        if self._descriptor is not None:
            os.set_inheritable(self._descriptor, False)  # noqa: FBT003 - os names no argument
            os.set_blocking(self._descriptor, False)
        threading.Thread(target=self._beat_until_ended, name="worker-heartbeat", daemon=True).start()

    def stop(self) -> None:
        """End the heartbeat."""
        self._ended.set()

    def step(self) -> None:
        """Record that the loop makes progress."""
        self._beats_since_step = 0

    def _beat_until_ended(self) -> None:
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

    Time in which the pool itself does not run is no silence. Until its first heartbeat a worker loads its
    program, and may take ``START_TIMES`` as long.
    """

    most_ticks: int
    _ticks: int = 0
    _beaten: bool = False

    def is_too_long(self, *, heard: bool) -> bool:
        """Count one tick, with or without a heartbeat (``heard``); tell whether the silence is too long."""
        self._beaten = self._beaten or heard
        self._ticks = 0 if heard else self._ticks + 1
        return self._ticks > self.most_ticks * (1 if self._beaten else START_TIMES)


def read_heartbeat(descriptor: int) -> bool:
    """Read the pipe of a worker; tell whether a heartbeat came since the last call."""
    try:
        return bool(os.read(descriptor, 1 << 16))
    except BlockingIOError:
        return False


def identify_self() -> Claimer:
    """Identify this process."""
    return Claimer(_identify_place(), os.getpid(), _find_start(os.getpid()) or "")


def _identify_place() -> str:
    """Identify the computer, its boot and its process namespace (two containers may share a name)."""
    if not _BOOT.exists():
        return socket.gethostname()
    namespace = Path("/proc/self/ns/pid").readlink()
    return f"{socket.gethostname()} {_BOOT.read_text().strip()} {namespace}"


def _find_start(pid: int) -> str | None:
    """Find when a process started, in the kernel's ticks; None when it is dead or cannot be looked up."""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    state, start = after_name[0], after_name[19]
    return None if state in "ZX" else start


@dataclass(slots=True)
class LeaseWatch:
    """When one worker last saw the counters of the others change, by its monotonic clock."""

    me: Claimer
    lease_s: float
    _seen: dict[tuple[str, str, int], float] = field(default_factory=dict)

    def find_abandoned(self, claims: tuple[Claim, ...]) -> tuple[Claim, ...]:
        """Find the claims whose holder is dead, or whose counter stands still for the length of the lease."""
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
