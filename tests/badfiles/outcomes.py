"""A bad file, how it is made, and what must become of it."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class BadFile:
    """A bad file and its outcome: a refusal, or a report with these warnings and times."""

    row: str
    name: str
    make: Callable[[], bytes]
    code: str | None = None
    warnings: frozenset[str] = frozenset()
    analysed_s: float = 60.0
    missing_s: float = 0.0
    excluded_s: float = 0.0


def refused(row: str, name: str, make: Callable[[], bytes], code: str) -> BadFile:
    return BadFile(row, name, make, code)


def read(  # the times in the order in which they are printed
    row: str,
    name: str,
    make: Callable[[], bytes],
    warnings: str = "",
    times_s: tuple[float, float, float] = (60.0, 0.0, 0.0),
) -> BadFile:
    return BadFile(row, name, make, None, frozenset(warnings.split()), *times_s)


def given(content: bytes | str) -> Callable[[], bytes]:
    return lambda: content.encode() if isinstance(content, str) else content
