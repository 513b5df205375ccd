"""Units of acceleration and angular rate, by the words that people and loggers write for them."""

import math
from typing import Literal

UnitSource = Literal["", "header", "stated"]
"""What states both units: a known device's header, or column names or a person; "" if nothing does."""

STANDARD_GRAVITY = 9.80665
DEG_PER_RAD = math.degrees(1.0)
METRE_WORDS = ("m/s2", "ms2", "mps2", "m/s/s", "mss", "m/sec2", "ms-2", "m.s-2", "meters/s2")
ACC_UNITS_G = {
    **dict.fromkeys(("g", "gs", "gn"), 1.0),
    "mg": 1e-3,
    **dict.fromkeys(METRE_WORDS, 1 / STANDARD_GRAVITY),
    **dict.fromkeys(("cm/s2", "gal"), 1e-2 / STANDARD_GRAVITY),
    "mm/s2": 1e-3 / STANDARD_GRAVITY,
}
DEGREE_WORDS = (
    *("dps", "deg/s", "degs", "deg/sec", "degrees/s", "degrees/sec", "degps", "degs-1", "degpersec"),
    *("deg.s-1", "degres/s", "degre/s", "degres/sec"),
)
GYR_UNITS_DPS = {
    **dict.fromkeys(DEGREE_WORDS, 1.0),
    **dict.fromkeys(("mdps", "mdeg/s"), 1e-3),
    **dict.fromkeys(("rad/s", "rads", "rps", "rad/sec", "radps", "rads-1"), DEG_PER_RAD),
}


def name_unit_source(acc_unit: str | None, gyr_unit: str | None, *, is_known: bool = False) -> UnitSource:
    """Return "header" if a known device states both units, "stated" if names or a person do, else ""."""
    if not (acc_scale_g(acc_unit) and gyr_scale_dps(gyr_unit)):
        return ""
    return "header" if is_known else "stated"


def acc_scale_g(unit: str | None) -> float | None:
    """Factor to g; None where the unit is unknown or raw counts."""
    return ACC_UNITS_G.get(unit) if unit else None


def gyr_scale_dps(unit: str | None) -> float | None:
    """Factor to deg/s; None where the unit is unknown or raw counts."""
    return GYR_UNITS_DPS.get(unit) if unit else None
