"""Reliability of the figures: excluded time, the use of time, the verdict.

Importing the package only loads the values, so a report can be written without the compiler.
"""

from dataclasses import dataclass
from typing import Literal

from acromion.fusion.recording import QualityFlag

Verdict = Literal["good", "caution", "poor"]


@dataclass(frozen=True, slots=True)
class TimePart:
    """The time of one kind in the recording: the work, a kind of task, a reason for exclusion.

    ``account``: the sum it belongs to.
    ``name``: the kind or the reason.
    ``duration_us``: microseconds.
    """

    account: Literal["analysed", "excluded", "missing"]
    name: str
    duration_us: int


@dataclass(frozen=True, slots=True)
class TimeAccount:
    """Every microsecond of the recording: analysed + missing + excluded = recorded, exactly.

    ``recorded_us``, ``analysed_us``, ``missing_us``, ``excluded_us``: microseconds.
    ``parts``: the three sums in detail; they add up to the same.
    ``shift_us``: length of the shift as the diary states it; None if it does not.
    """

    recorded_us: int
    analysed_us: int
    missing_us: int
    excluded_us: int
    parts: tuple[TimePart, ...] = ()
    shift_us: int | None = None


@dataclass(frozen=True, slots=True)
class Quality:
    """Reliability of the figures.

    ``verdict``: "good", "caution" or "poor".
    ``reasons``: codes of the flags that count towards it.
    ``flags``: all caveats, the most serious first.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    flags: tuple[QualityFlag, ...]
