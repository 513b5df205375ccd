"""Compare a day with a proposed level, and combine the uncertainties of its time above 60 deg.

The comparison is about the measured time. The combined range is about other days of the same work: the range
of the day (with the error of the pose) and the published variation between days, added as squares on each
side of the measured value.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot
from typing import Literal

from acromion.fusion.comparison.change import (
    BETWEEN_DAY_SD,
    REFERENCES,
    Reason,
    Reference,
    find_left_out_reason,
    find_measured,
)
from acromion.fusion.conventions import MAIN_THRESHOLD_DEG, WHOLE_DAY_S, CalibrationState
from acromion.fusion.exposure.types import Exposure, Interval
from acromion.fusion.quality import TimeAccount, Verdict
from acromion.fusion.recording import MICROSECONDS, Span

Standing = Literal["below", "above", "cannot tell"]
Extent = Literal["short", "part", "day", "unknown"]

SHIFT_SHARE = 0.95
"""Share of the stated shift that must be analysed, or a break, for a whole day."""


def compare_with_level(
    measured: float, interval: Interval | None, level: float, *, can_be_below: bool = True
) -> Standing:
    """Return where a figure lies: "cannot tell" if any bound of its range, the pose's included, crosses.

    Bounds are rounded to one decimal, as printed; a bound that equals the level crosses it.
    """
    if interval is None:
        return "cannot tell"
    posed = interval.with_pose or interval
    ends = [round(end, 1) for end in (measured, interval.low, interval.high, posed.low, posed.high)]
    if min(ends) > level:
        return "above"
    return "below" if max(ends) < level and can_be_below else "cannot tell"


def can_be_below(reference: Reference, exposure: Exposure, state: CalibrationState | None) -> bool:
    """Return whether the range of a figure is complete; only then the figure may read "below".

    It is not for ready angle series (``state`` is None), whose error is unknown. A share also needs a range
    for an assumed pose; the accelerometer-based velocity does not depend on the pose.
    """
    if state is None or reference.key == "velocity":
        return state is not None
    main = next((t.interval for t in exposure.time_above if t.threshold_deg == MAIN_THRESHOLD_DEG), None)
    return state != "assumed" or (main is not None and main.with_pose is not None)


def find_extent(time: TimeAccount, exclusions: Sequence[Span]) -> Extent:
    """Return how much of a day was analysed: "short" is under 4 h, "part" less than the stated shift.

    Breaks belong to the shift. "unknown": nobody stated the shift.
    """
    if time.analysed_us < WHOLE_DAY_S * MICROSECONDS:
        return "short"
    if time.shift_us is None:
        return "unknown"
    breaks_us = sum(span.duration_us for span in exclusions if span.reason == "break")
    return "day" if time.analysed_us + breaks_us >= SHIFT_SHARE * time.shift_us else "part"


@dataclass(frozen=True, slots=True)
class ComparedLevel:
    """A proposed level with the measured figure, its range, and where it lies.

    ``standing`` is None if nothing is compared; ``reason`` states why.
    """

    reference: Reference
    measured: float | None
    interval: Interval | None
    standing: Standing | None
    reason: Reason


def compare_with_levels(
    exposure: Exposure, verdict: Verdict, extent: Extent, state: CalibrationState | None
) -> tuple[ComparedLevel, ...]:
    """Compare the day with each proposal: time above 30 and 60 deg, and the median velocity."""
    above = {f"above_{item.threshold_deg:g}": item.interval for item in exposure.time_above}
    ranges = above | {"velocity": exposure.intervals.get("generalised_accelerometer_velocity_p50_dps")}
    left_out = find_left_out_reason(verdict, is_short=extent == "short")
    compared = []
    for reference in (one for one in REFERENCES if one.status == "proposal"):
        measured, interval = find_measured(reference.key, exposure), ranges.get(reference.key)
        reason = "not computed" if measured is None else left_out
        standing = None
        if measured is not None and not reason:
            is_complete = can_be_below(reference, exposure, state)
            standing = compare_with_level(measured, interval, reference.high, can_be_below=is_complete)
        compared.append(ComparedLevel(reference, measured, interval, standing, reason))
    return tuple(compared)


@dataclass(frozen=True, slots=True)
class OtherDays:
    """Ranges of the time above 60 deg on other days of the same work, in percent.

    ``between``: the published variation between days alone; ``combined``: with the range of the day.
    """

    between: Interval
    combined: Interval | None


def combine_days(measured: float, interval: Interval | None) -> OtherDays:
    """Return the range of other days of the same work, within 0 to 100 %."""

    def add(below: float, above: float) -> Interval:
        return Interval(max(measured - below, 0.0), min(measured + above, 100.0))

    days = 1.96 * BETWEEN_DAY_SD["time_above_60_percent"]
    if interval is None:
        return OtherDays(add(days, days), None)
    whole = interval.with_pose or interval
    below, above = max(measured - whole.low, 0.0), max(whole.high - measured, 0.0)
    return OtherDays(add(days, days), add(hypot(below, days), hypot(above, days)))
