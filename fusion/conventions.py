"""Names of the user's options, and the elevation classes of standards and methods."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

MethodName = Literal["smoothed", "published", "live"]
METHOD_VERSION = "6"
"""The version of every method; it increases with each change that alters a result."""
Pose = Literal["n-pose", "side-lean", "two-point"]
NPOSE_ERROR_DEG = 15
"""The n-pose takes the arm along the body as 0 deg, so a raised arm may read too low by up to this."""
Side = Literal["left", "right", "trunk"]
"""Where the sensor was worn; a recording of the trunk has no figures of an arm."""
ArmAxis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
"""The sensor axis that was strapped along the upper arm, towards the shoulder."""
MAIN_THRESHOLD_DEG = 60
"""The arm counts as raised above this angle, if a figure uses a single threshold."""
ARM_AXES: tuple[ArmAxis, ...] = get_args(ArmAxis)

CalibrationState = Literal["given", "held_at_start", "repeated", "carried", "assumed", "axis", "none"]
"""How the arm axis was determined.

- "given": a person entered the time of the pose.
- "repeated": several poses that agree.
- "held_at_start": a person stated that the pose was held at the start of wear, and a still period starts
  there.
- "carried": the pose of an earlier shift of the recording; a person stated that the sensor was not removed.
- "assumed": the first still period of wear, not confirmed by a person.
- "axis": the sensor axis that was strapped along the arm.
- "none": no still period was found; the axis comes from walking or from the stillest moment.
"""
CONFIRMED: frozenset[CalibrationState] = frozenset({"given", "held_at_start", "repeated", "carried"})
UNHELD: frozenset[CalibrationState] = frozenset({"axis", "none"})
"""States without a calibration pose."""
PoseHeld = Literal["start", "no"]
"""A statement for all recordings about when the pose was held: at the start of wear.

"no": not stated, even if a file header, a column profile or the settings of a run state it.
"""


def is_npose(pose: Pose, state: CalibrationState) -> bool:
    """Return whether the reference was the arm along the body, so that a raised arm may read too low.

    Without a pose the answer is no: for an axis from walking or from a still moment this error is unknown.
    """
    return pose == "n-pose" and state not in UNHELD


FEWEST_PEOPLE = 5
"""The smallest group that may be reported; figures of fewer people could identify one of them."""
SAID_S = 60.0
"""Uncertainty of a slip time that a person states: this much on both sides is left out."""


def awaits_pose(start_s: float, end_s: float) -> bool:
    """Return whether a stretch without a pose is longer than the margin around the slip itself."""
    return start_s > 0.0 and end_s - start_s > 2.0 * SAID_S + 1.0


AXIS_HINT = "x, y, z, -x, -y, -z"


def parse_arm_axis(text: str) -> ArmAxis:
    """Parse ``y``, ``+y`` or ``-y``; a space before the letter is a plus sign decoded from a URL.

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
    """The elevation classes of one standard or method; its edges are also edges of the stored bins.

    The classes describe posture only. Whether a standard accepts a posture also depends on frequency,
    support, load and duration.
    """

    key: str
    edges_deg: tuple[int, ...]
    source: str
    evidence: Literal["read", "second-hand"]
    """Whether the limits were read in the source itself or in a text that quotes it."""


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


# The length of a day that counts.


HOUR_S = 3600.0
WHOLE_DAY_S = 4 * 3600.0
"""Least analysed time for a comparison with a value for a whole working day (A15)."""
LONGEST_DAY_S = 86_400.0


def judge_length(
    duration_s: float, analysed_s: float, least_s: float = WHOLE_DAY_S
) -> Literal["short", "long"] | None:
    """Return why a recording does not count as a day; None if it counts."""
    if duration_s > LONGEST_DAY_S:
        return "long"
    return "short" if analysed_s < least_s else None


FORMULA_START = "(^|[;,\t\r\n\u007c])([\"' ]*)"
"""The start of a cell, or of a cell in another dialect, with its quotation marks: a regular expression."""
FORMULA_SIGN = "(?=[=+\\-@\t\r\x00\uff1d\uff0b\uff0d\uff20])"
"""Before a sign that a spreadsheet reads as a formula; the wide forms are on Asian keyboards."""
