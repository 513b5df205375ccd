"""What a person may choose, as words; and how standards and methods cut elevation into classes."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

MethodName = Literal["smoothed", "published", "live"]
METHOD_VERSION = "6"
"""Of every method; it goes up with each change that moves a figure."""
Pose = Literal["n-pose", "side-lean", "two-point"]
NPOSE_ERROR_DEG = 15
"""With the arm along the body as the reference, a raised arm may read too low by so much."""
Side = Literal["left", "right"]
ArmAxis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
"""The sensor's axis that was strapped along the upper arm, towards the shoulder."""
MAIN_THRESHOLD_DEG = 60
"""Above it the arm counts as raised, wherever one threshold stands for all."""
ARM_AXES: tuple[ArmAxis, ...] = get_args(ArmAxis)

CalibrationState = Literal["given", "held_at_start", "repeated", "assumed", "axis", "none"]
"""How the arm's axis is known.

- "given": a person gave the time of the pose; "repeated": of several poses that agree.
- "held_at_start": a person stated that the pose was held at the start of wear, and a stillness begins there.
- "assumed": the first stillness of wear, which nobody confirmed.
- "axis": the sensor's axis that was strapped along the arm.
- "none": no stillness to assume: how the arm hung in walking, or the stillest moment.
"""
CONFIRMED: frozenset[CalibrationState] = frozenset({"given", "held_at_start", "repeated"})
UNHELD: frozenset[CalibrationState] = frozenset({"axis", "none"})
"""Without a pose."""
PoseHeld = Literal["start", "no"]
"""When the pose was held, as a person states for all recordings alike: at the start of wear.

"no": not stated, though a file's header, a column profile or the settings of a run state it.
"""


def is_npose(pose: Pose, state: CalibrationState) -> bool:
    """Return whether the arm was held along the body, so that a raised arm may read too low.

    A strapped axis has no pose; the error of an axis from walking or a stillest moment is not known.
    """
    return pose == "n-pose" and state not in UNHELD


FEWEST_PEOPLE = 5
"""Fewer people make no group: its figures would be those of single people."""
SAID_S = 60.0
"""How exactly a person knows when the sensor slipped: so much on both sides is left out."""


def awaits_pose(start_s: float, end_s: float) -> bool:
    """Return whether a stretch that no pose reads is more than what is left out around a slip itself."""
    return start_s > 0.0 and end_s - start_s > 2.0 * SAID_S + 1.0


AXIS_HINT = "x, y, z, -x, -y, -z"


def parse_arm_axis(text: str) -> ArmAxis:
    """Read ``y``, ``+y`` or ``-y``; a URL's blank before the letter is the plus sign it stood for.

    Raises ValueError.
    """
    found = text.strip().lower()
    found = found if found.startswith(("+", "-")) else f"+{found}"
    if found in ARM_AXES:
        return found
    raise ValueError(AXIS_HINT)


def check_choice(name: str, value: object, allowed: Sequence[object]) -> None:
    """Raise ValueError with the allowed values if ``value`` is not one of them."""
    if value not in allowed:
        raise ValueError(f"{name}={value!r}; allowed: {', '.join(map(repr, allowed))}")


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


SIDECAR = re.compile(r"(?:^|/)(?:__MACOSX/|\.[^./]|~\$|(?:desktop\.ini|thumbs\.db)$)", re.IGNORECASE)


def is_sidecar(path: str) -> bool:
    """Return whether a path with `/` is a file that macOS, Windows or Office puts beside others."""
    return bool(SIDECAR.search(path))
