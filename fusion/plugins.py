"""Find readers of other packages by package metadata, without loading them."""

from functools import cache
from importlib.metadata import EntryPoint, entry_points

GROUP = "acromion.readers"


@cache
def find_entry_points() -> tuple[EntryPoint, ...]:
    """Return the entry points of the installed readers, always in the same order."""
    return tuple(sorted(entry_points(group=GROUP), key=lambda one: (one.name, find_version(one), one.value)))


def find_version(entry: EntryPoint) -> str:
    """Return the version of the package that an entry point belongs to."""
    return entry.dist.version if entry.dist else ""
