"""Published values and conventions as data: value, source, what it applies to, and how far it is confirmed.

EXPOSURE.md A1 and A10. A value that its brief marks unverified (the holding times of ISO 11226, the
footnotes of EN 1005-4, the 80 deg of ISO 11228-3) is not here: it is not shipped as a limit. Nothing here is
turned into a score or into anyone's risk.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from fusion.exposure.types import ElevationBin, Exposure  # a report must not wait for the compiler

Status = Literal["proposal", "guidance", "context"]
Reason = Literal["", "short", "poor", "not computed"]

WHOLE_DAY_S = 4 * 3600.0
"""Least analysed time that is compared with a value for a whole working day (A15)."""


@dataclass(frozen=True, slots=True)
class Reference:
    """One published value.

    ``low`` and ``high`` bound what was proposed or seen, in ``unit``; ``status`` says what they are: a
    proposal of researchers, guidance without force, or context (what others were measured to do).
    """

    key: str
    unit: Literal["percent", "dps", "deg", "h"]
    low: float | None
    high: float
    status: Status
    source: str


@dataclass(frozen=True, slots=True)
class Compared:
    """A reference beside the measured figure; ``reason`` says why the two cannot be compared."""

    reference: Reference
    measured: float | None
    reason: Reason


ARVIDSSON = "Arvidsson et al. 2021, Ann Work Expo Health 65:741"
REFERENCES = (
    Reference("above_30", "percent", None, 50.0, "proposal", ARVIDSSON),
    Reference("above_60", "percent", None, 10.0, "proposal", ARVIDSSON),
    Reference("velocity", "dps", None, 60.0, "proposal", ARVIDSSON),
    Reference("p99", "deg", 49.0, 124.0, "context", "Hansson et al. 2010, 43 types of work"),
)  # fmt: skip
"""In the order of the report. ``velocity`` was made from accelerometers and is set beside
``generalised_accelerometer`` alone: a fused speed reads two to four times lower (Fan et al. 2021)."""


def compare_with_references(exposure: Exposure, verdict: str) -> tuple[Compared, ...]:
    """Set each reference beside its figure, or say why it does not apply.

    All are for a working day: not with less than 4 h analysed, and not when the quality is poor.
    """
    reason: Reason = "poor" if verdict == "poor" else ""
    if exposure.analysed_s < WHOLE_DAY_S:
        reason = "short"
    return tuple(_compare(reference, exposure, reason) for reference in REFERENCES)


def _compare(reference: Reference, exposure: Exposure, reason: Reason) -> Compared:
    measured = find_measured(reference.key, exposure)
    return Compared(reference, measured, "not computed" if measured is None else reason)


def find_measured(key: str, exposure: Exposure) -> float | None:
    """Give the only figure that was measured as the reference was."""
    above = {int(item.threshold_deg): item.percent for item in exposure.time_above}
    velocity = exposure.velocity_dps.get("generalised_accelerometer")
    return {
        "above_30": above.get(30),
        "above_60": above.get(60),
        "velocity": velocity.p50_dps if velocity else None,
        "p99": exposure.elevation_p99_deg,
    }[key]


@dataclass(frozen=True, slots=True)
class Convention:
    """How a standard or method cuts elevation into classes; its edges are edges of the stored bins."""

    key: str
    edges_deg: tuple[float, ...]
    source: str
    evidence: Literal["read", "second-hand"]
    """Whether the cut-offs were read in the source itself or in a text that quotes it."""


CONVENTIONS = (
    Convention("iso_11226", (0, 20, 60, 180), "ISO 11226:2000, upper arm", "second-hand"),
    Convention("en_1005_4", (0, 20, 60, 180), "EN 1005-4:2005+A1:2008, upper arm", "second-hand"),
    Convention("rula_reba", (0, 20, 45, 90, 180), "RULA (1993), REBA (2000)", "second-hand"),
    Convention("nfa", (0, 30, 60, 90, 120, 150, 180), "Acti4/Motus (NFA Denmark)", "read"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class ConventionClass:
    """Time within one class of a convention."""

    lower_deg: float
    upper_deg: float
    duration_s: float
    percent: float


def divide_by_convention(bins: Sequence[ElevationBin], convention: Convention) -> tuple[ConventionClass, ...]:
    """Add the stored bins up to the classes of a convention, exactly.

    The classes are posture alone: whether a standard accepts them also depends on frequency, support, load
    and duration, which its own text rules.
    """
    return tuple(
        ConventionClass(
            lower,
            upper,
            sum(part.duration_s for part in bins if lower <= part.lower_deg and part.upper_deg <= upper),
            sum(part.percent for part in bins if lower <= part.lower_deg and part.upper_deg <= upper),
        )
        for lower, upper in zip(convention.edges_deg, convention.edges_deg[1:], strict=False)
    )
