"""How much the arm was raised: time in bins, percentiles, repetitions, episodes, peaks, speeds."""

from fusion.exposure.metric_filter import CORNER_HZ, LOWEST_RATE_HZ
from fusion.exposure.summary import summarise_exposure
from fusion.exposure.types import (
    Cycles,
    ElevationBin,
    Entries,
    Episodes,
    Eva,
    Exposure,
    Interval,
    MinuteProfile,
    PartExposure,
    PeakWindow,
    TimeAbove,
    Velocity,
)

__all__ = [
    "CORNER_HZ",
    "LOWEST_RATE_HZ",
    "Cycles",
    "ElevationBin",
    "Entries",
    "Episodes",
    "Eva",
    "Exposure",
    "Interval",
    "MinuteProfile",
    "PartExposure",
    "PeakWindow",
    "TimeAbove",
    "Velocity",
    "summarise_exposure",
]
