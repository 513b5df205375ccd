"""How many recordings this machine does at once."""

import os
from dataclasses import dataclass

import psutil

NEED_BYTES = 1_200_000_000
"""One analysis of 14.4 million samples, as measured by ``benchmarks/road.py``, with a margin."""


@dataclass(frozen=True, slots=True)
class Capacity:
    """The cores we may use and the memory that is free."""

    cores: int
    free_bytes: int


def measure_capacity() -> Capacity:
    """Ask the system; the cores are those this process may run on."""
    allowed = getattr(os, "sched_getaffinity", None)
    cores = len(allowed(0)) if allowed else os.cpu_count() or 1
    return Capacity(cores, psutil.virtual_memory().available)


def choose_workers(recordings: int, capacity: Capacity) -> int:
    """Leave one core to the person at the machine and take no more than fits into memory; at least one."""
    return max(1, min(recordings, capacity.cores - 1, capacity.free_bytes // NEED_BYTES))
