"""How standards and methods cut elevation into classes (EXPOSURE.md A1), as data."""

from dataclasses import dataclass
from typing import Literal

# What a person may choose. Kept apart from what it does, so that asking costs nothing.


MethodName = Literal["smoothed", "published", "live"]
Pose = Literal["n-pose", "side-lean", "two-point"]
Side = Literal["left", "right"]


@dataclass(frozen=True, slots=True)
class Convention:
    """The classes of one standard or method; its edges are edges of the stored bins.

    The classes are posture alone: whether a standard accepts them also depends on frequency, support, load
    and duration, which its own text rules.
    """

    key: str
    edges_deg: tuple[int, ...]
    source: str
    evidence: Literal["read", "second-hand"]
    """Whether the cut-offs were read in the source itself or in a text that quotes it."""


CONVENTIONS = (
    Convention("iso_11226", (0, 20, 60, 180), "ISO 11226:2000, upper arm", "second-hand"),
    Convention("en_1005_4", (0, 20, 60, 180), "EN 1005-4:2005+A1:2008, upper arm", "second-hand"),
    Convention("rula_reba", (0, 20, 45, 90, 180), "RULA (1993), REBA (2000)", "second-hand"),
    Convention("nfa", (0, 30, 60, 90, 120, 150, 180), "Acti4/Motus (NFA Denmark)", "read"),
)  # fmt: skip
