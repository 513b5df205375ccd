"""Several days of a person, and of a group: overlaid by the clock, with the spread between them."""

from fusion.days.overlay import ClockBand, lay_on_clock, overlay_days
from fusion.days.spread import (
    LEAST_OWN_DAYS,
    DayMean,
    GroupChange,
    GroupSpread,
    Telling,
    Trend,
    compare_people,
    describe_days,
    describe_group,
    find_detectable_between,
    find_telling,
    find_trend,
    pool_deviation,
)

__all__ = [
    "LEAST_OWN_DAYS",
    "ClockBand",
    "DayMean",
    "GroupChange",
    "GroupSpread",
    "Telling",
    "Trend",
    "compare_people",
    "describe_days",
    "describe_group",
    "find_detectable_between",
    "find_telling",
    "find_trend",
    "lay_on_clock",
    "overlay_days",
    "pool_deviation",
]
