"""Whether the holder of a job still lives.

A lease is watched, not stamped: the holder raises a counter, and whoever sees it stand still for the lease's
length by his own monotonic clock may take the job. No clock is compared with another, so a stepped clock
expires nothing. A holder on the same computer is looked up among its processes, which takes no waiting.
"""

import os
import socket
import time
from dataclasses import dataclass, field
from pathlib import Path

from app.jobs.job import Claim, Claimer

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
