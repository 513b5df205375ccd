"""Where the time went and how far the numbers can be trusted, as frozen values."""

from dataclasses import dataclass
from typing import Literal

from fusion.recording import QualityFlag

Verdict = Literal["good", "caution", "poor"]


@dataclass(frozen=True, slots=True)
class TimePart:
    """What one kind of time adds to the recording: the work, a kind of task, a reason for leaving out."""

    account: Literal["analysed", "excluded", "missing"]
    name: str
    duration_us: int


@dataclass(frozen=True, slots=True)
class TimeAccount:
    """Every microsecond of the recording: analysed + missing + excluded = recorded, exactly.

    ``parts`` names them one by one and adds up to the same.
    """

    recorded_us: int
    analysed_us: int
    missing_us: int
    excluded_us: int
    parts: tuple[TimePart, ...] = ()


@dataclass(frozen=True, slots=True)
class Quality:
    """The verdict, the codes of the flags that count in it, and all flags; the gravest first."""

    verdict: Verdict
    reasons: tuple[str, ...]
    flags: tuple[QualityFlag, ...]
