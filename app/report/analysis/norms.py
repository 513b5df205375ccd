"""When a figure is set beside a published value, and the scale both stand on."""

from math import ceil

from app.report.findings import Findings
from fusion.comparison import REFERENCES, WHOLE_DAY_S
from fusion.recording import MICROSECONDS

LIMITS = {reference.key: reference for reference in REFERENCES}


def find_reason(findings: Findings) -> str:
    """Give the reason why no figure can be compared; empty where they can."""
    if findings.time.analysed_us < WHOLE_DAY_S * MICROSECONDS:
        return "short"
    return "poor" if findings.quality.verdict == "poor" else ""


def extend_scale(end: float, largest: float) -> float:
    """Give the end of a scale that must hold ``largest``: the usual one, or the next ten."""
    return end if largest <= end else 10.0 * ceil(largest / 10.0)
