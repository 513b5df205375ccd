"""How much the arm was raised: time in bins, percentiles, repetitions, episodes, peaks, speeds.

The values are loaded with the package; what computes them only when first asked for, so that a report can be
written without the compiler.
"""

import importlib
from typing import TYPE_CHECKING

from fusion.exposure.types import (
    Cycles,
    ElevationBin,
    Entries,
    Episodes,
    Eva,
    EvaSummary,
    Exposure,
    Frequency,
    HourVariation,
    Interval,
    MinuteProfile,
    PartExposure,
    PeakWindow,
    Recovery,
    TimeAbove,
    Velocity,
)

if TYPE_CHECKING:
    from fusion.exposure.parts import DayDivision as DayDivision
    from fusion.exposure.parts import snap_periods as snap_periods
    from fusion.exposure.summary import summarise_exposure as summarise_exposure
    from fusion.exposure.summary import withhold_short as withhold_short

_HOMES = {
    "DayDivision": "fusion.exposure.parts",
    "snap_periods": "fusion.exposure.parts",
    "summarise_exposure": "fusion.exposure.summary",
    "withhold_short": "fusion.exposure.summary",
}

__all__ = [
    "Cycles",
    "DayDivision",
    "ElevationBin",
    "Entries",
    "Episodes",
    "Eva",
    "EvaSummary",
    "Exposure",
    "Frequency",
    "HourVariation",
    "Interval",
    "MinuteProfile",
    "PartExposure",
    "PeakWindow",
    "Recovery",
    "TimeAbove",
    "Velocity",
    "snap_periods",
    "summarise_exposure",
    "withhold_short",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'fusion.exposure' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)
