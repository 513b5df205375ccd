"""A bad file, how it is made, and its expected outcome."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

Content = bytes | str
Make = Content | Callable[[], Content]


@dataclass(frozen=True, slots=True)
class BadFile:
    """A bad file and its outcome: a refusal, or a report with these warnings and times; with these facts."""

    row: str
    name: str
    content: Make
    code: str | None = None
    warnings: frozenset[str] = frozenset()
    analysed_s: float = 60.0
    missing_s: float = 0.0
    excluded_s: float = 0.0
    facts: frozenset[str] = frozenset()

    def make(self) -> bytes:
        """Return the bytes of the file."""
        made = self.content() if callable(self.content) else self.content
        return made.encode() if isinstance(made, str) else made


def refused(row: str, content: Make, told: str, name: str = "shift.csv") -> BadFile:
    """``told``: the code, then the facts that the refusal must state, as in ``"E-TIME, why=reversed"``."""
    code, *facts = told.split(", ")
    return BadFile(row, name, content, code, facts=frozenset(facts))


def read(
    row: str,
    content: Make,
    told: str = "",
    times_s: tuple[float, float, float] = (60.0, 0.0, 0.0),
    name: str = "shift.csv",
) -> BadFile:
    """``told``: the warnings, each with the facts that it must state, as in ``"W-DST step_s=3600 W-GAP"``.

    ``times_s``: analysed, missing, excluded.
    """
    warnings, facts = list[str](), set[str]()
    for word in told.split():
        if "=" in word:
            facts.add(f"{warnings[-1]} {word}")
        else:
            warnings.append(word)
    return BadFile(row, name, content, None, frozenset(warnings), *times_s, frozenset(facts))


read_gt3x, refused_gt3x = partial(read, name="shift.gt3x"), partial(refused, name="shift.gt3x")
