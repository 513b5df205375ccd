"""What every part of the report of one recording needs."""

from __future__ import annotations

from dataclasses import dataclass

from app.report.findings import Findings
from app.report.words.numbers import Clock
from app.report.words.subject import ReportSubject
from app.report.words.wording import Language, Words
from fusion.exposure.types import Exposure, TimeAbove


@dataclass(frozen=True, slots=True)
class Context:
    """What was found, whose it is, the clock of the recording, and the words of the report."""

    findings: Findings
    subject: ReportSubject
    clock: Clock
    words: Words

    @property
    def language(self) -> Language:
        """The language of the report."""
        return self.clock.language

    @property
    def exposure(self) -> Exposure:
        """The figures."""
        return self.findings.exposure

    def find_above(self, threshold_deg: float) -> TimeAbove:
        """Return the time above a threshold."""
        return next(t for t in self.exposure.time_above if t.threshold_deg == threshold_deg)
