"""How much the arm was raised: time in bins, percentiles, repetitions, episodes, peaks, speeds."""

from fusion.exposure.by_period import DayDivision, snap_periods
from fusion.exposure.metric_filter import CORNER_HZ, LOWEST_RATE_HZ
from fusion.exposure.summary import summarise_exposure
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

__all__ = [
    "CORNER_HZ",
    "LOWEST_RATE_HZ",
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
]
