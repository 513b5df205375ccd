"""Readers that other packages add, as their metadata names them: finding them loads none."""

from functools import cache
from importlib.metadata import EntryPoint, entry_points

GROUP = "acromion.readers"


@cache
def find_entry_points() -> tuple[EntryPoint, ...]:
    """Find the entry points of the readers that are installed, always in the same order."""
    return tuple(sorted(entry_points(group=GROUP), key=lambda one: (one.name, find_version(one), one.value)))


def find_version(entry: EntryPoint) -> str:
    """Return the version of the package that an entry point belongs to."""
    return entry.dist.version if entry.dist else ""
