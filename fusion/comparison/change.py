"""Compare two days, and a day with published values.

Is the difference between two days larger than the variation between days of unchanged work?

MDC95 = 1.96 sqrt(2 / k) SD_BD, with k days on each side and the between-day standard deviation SD_BD of
Wahlström et al. 2010 (hairdressers, right arm, four days): 2.0 percentage points for time above 60 deg, 3.4
deg for the median. Other work may vary more or less; the report states this with the verdict.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from math import sqrt
from typing import Literal, get_args

import numpy as np

from acromion.fusion.clocks import measure_us
from acromion.fusion.conventions import HOUR_S, WHOLE_DAY_S
from acromion.fusion.exposure.types import Exposure
from acromion.fusion.recording import MICROSECONDS

# Published values as data: value, source, scope, and how well it is confirmed.
#
# ``acromion.fusion.conventions`` has the elevation classes of the standards. Unverified values are excluded:
# :data:`NOT_SHIPPED` lists them with the reason. No value is turned into a score or into a person's risk.


Status = Literal["proposal", "guidance", "context"]
Reason = Literal["", "short", "poor", "not computed"]


@dataclass(frozen=True, slots=True)
class Reference:
    """One published value.

    ``low`` and ``high`` are limits of the proposed or observed range, in ``unit``. ``status``: a proposal of
    researchers, non-binding guidance, or context (measured values of others).
    """

    key: str
    unit: Literal["percent", "dps", "deg", "h"]
    low: float | None
    high: float
    status: Status
    source: str


@dataclass(frozen=True, slots=True)
class Compared:
    """A reference with the measured figure; ``reason``: why the two cannot be compared."""

    reference: Reference
    measured: float | None
    reason: Reason


LEWIS = "Lewis et al. 2026, Ann Work Expo Health 70(3):wxag027, 124 older workers, 3 days each"
ARVIDSSON = "Arvidsson et al. 2021, Ann Work Expo Health 65:741"
REFERENCES = (
    Reference("above_30", "percent", None, 50.0, "proposal", ARVIDSSON),
    Reference("above_60", "percent", None, 10.0, "proposal", ARVIDSSON),
    Reference("velocity", "dps", None, 60.0, "proposal", ARVIDSSON),
    Reference("p99", "deg", 49.0, 124.0, "context", "Hansson et al. 2010, 43 types of work"),
    Reference("above_90_hours", "h", 2.0, 4.0, "guidance", "WISHA, Washington State, repealed 2003"),
    Reference("above_60_others", "percent", 4.4, 7.9, "context", LEWIS),
    Reference("above_90_others", "percent", 1.0, 2.8, "context", LEWIS),
)  # fmt: skip
"""In the order of the report; the first four are on its first page. ``velocity`` comes from accelerometers
and is only compared with ``generalised_accelerometer``: a fused speed is two to four times lower (Fan et al.
2021).
"""


STATEMENTS = {
    "svendsen": "Svendsen et al. 2004",
    "dalboge": "Dalboge et al. 2022",
    "seidler": "Seidler et al. 2020, meta-analysis",
    "waersted": "Waersted et al. 2020, review of 34 studies",
    "nfa": "Palm et al. 2018, 197 workers of 12 occupations",
    "gupta": "Gupta et al. 2022, 937 workers measured and followed for four years",
}
"""Findings of studies of groups: quoted in words, without a figure, and never turned into a person's risk."""

NOT_SHIPPED = {
    "Dalboge 2017, background speed 27 deg/s": "read in a table that quotes it, without the kind of speed",
    "ISO 11226, holding times": "not read in the standard",
    "EN 1005-4, footnotes": "not read in the standard",
    "ISO 11228-3 and OCRA, 80 deg": "not read in the standard",
    "RAMP II, hand at shoulder height": "the height of the hand, which this angle does not show",
}
"""Values that were considered and excluded, with the reason."""

DAYS_ABOVE = {"above_30": (8.0, 24.6), "above_60": (6.3, 22.7)}
"""Share of days above the proposal in percent, lowest and highest of the four trades of :data:`LEWIS`.

Context for several days, never for one.
"""


def compare_with_references(exposure: Exposure, verdict: str) -> tuple[Compared, ...]:
    """Compare each reference with its figure, or return the reason why it does not apply.

    Every reference applies to a working day. None is compared if less than 4 h were analysed or if the
    quality is poor.
    """
    reason = find_left_out_reason(verdict, is_short=exposure.analysed_s < WHOLE_DAY_S)
    measured = [find_measured(reference.key, exposure) for reference in REFERENCES]
    return tuple(
        Compared(reference, value, "not computed" if value is None else reason)
        for reference, value in zip(REFERENCES, measured, strict=True)
    )


def find_left_out_reason(verdict: str, *, is_short: bool) -> Reason:
    """Return why a recording is not compared with values for a working day; empty if it is."""
    return "short" if is_short else "poor" if verdict == "poor" else ""


def find_measured(key: str, exposure: Exposure) -> float | None:
    """Return the figure that was measured in the same way as the reference; None if there is none."""
    above = {int(item.threshold_deg): item.percent for item in exposure.time_above}
    velocity = exposure.velocity_dps.get("generalised_accelerometer")
    seconds = {int(item.threshold_deg): item.duration_s for item in exposure.time_above}
    return {
        "above_90_hours": seconds[90] / HOUR_S if 90 in seconds else None,
        "above_60_others": above.get(60),
        "above_90_others": above.get(90),
        "above_30": above.get(30),
        "above_60": above.get(60),
        "velocity": velocity.p50_dps if velocity else None,
        "p99": exposure.elevation_p99_deg,
    }[key]


Verdict = Literal["larger", "not larger", "unknown", "no two days", "unconfirmed pose"]
Difference = Literal[
    "recording",
    "hours",
    "subject",
    "order",
    "unconfirmed pose",
    "method",
    "pose",
    "side",
    "metric filter",
    "short",
    "poor",
]
NO_TWO_DAYS: tuple[Difference, ...] = ("recording", "hours", "subject", "side")
"""Reasons why two recordings are not two days of one arm of one person, most serious first; no change is
judged then.
"""

SOURCE = "Wahlström et al. 2010"
BETWEEN_DAY_SD = {"time_above_60_percent": 2.0, "elevation_p50_deg": 3.4}


@dataclass(frozen=True, slots=True)
class ComparedDay:
    """One day, with the properties that must be equal to compare two days.

    ``exposure``: its figures.
    ``method``, ``pose``, ``side``, ``verdict``: of its analysis; ``side`` is None if not stated.
    ``sha256``: of the recording; empty if unknown.
    ``subject``: code of the person; empty if not stated.
    ``start``, ``duration_s``: start by its clock, None without a clock, and duration.
    ``is_confirmed``: whether a person confirmed the calibration pose, or none is needed.
    """

    exposure: Exposure
    method: str
    pose: str
    side: str | None
    verdict: str
    sha256: str = ""
    subject: str = ""
    start: datetime | None = None
    duration_s: float = 0.0
    is_confirmed: bool = True


@dataclass(frozen=True, slots=True)
class FigureChange:
    """The later day's figure minus the earlier day's, and the smallest change beyond the variation of days.

    ``verdict`` is a key of the text: ``larger`` (than the day-to-day variation), ``not larger``, or
    ``unknown`` if no between-day variation was published for the figure. ``no two days``: the two are one
    recording, the same hours, two people, or two arms. ``unconfirmed pose``: a calibration pose is not
    confirmed. In the last two cases no change is judged.
    """

    name: str
    before: float
    after: float
    change: float
    detectable: float | None
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class DayComparison:
    """The changes, and other differences between the two days; with any of them, interpret with care."""

    changes: tuple[FigureChange, ...]
    differences: tuple[Difference, ...]


TWO_SIDED = 1.96
DETECTED = TWO_SIDED + 0.84
"""Standard errors that a planned change must exceed: 5 % two-sided, detected with 80 % power."""


def find_detectable_change(between_day_sd: float, days: int = 1, errors: float = TWO_SIDED) -> float:
    """Return the change between two means of ``days`` days that exceeds ``errors`` standard errors.

    With the default, this is MDC95.
    """
    if days < 1:
        raise ValueError(days)
    return errors * sqrt(2.0 / days) * between_day_sd


def find_planned_change(between_day_sd: float, days: int) -> float:
    """Return the change that ``days`` days before and after it detect with 80 % power."""
    return find_detectable_change(between_day_sd, days, DETECTED)


def compare_days(before: ComparedDay, after: ComparedDay) -> DayComparison:
    """Compare two days; a difference in NO_TWO_DAYS or an unconfirmed pose prevents a verdict."""
    first, second = _list_figures(before.exposure), _list_figures(after.exposure)
    differences = _find_differences(before, after)
    changes = []
    for name in (name for name in first if name in second):
        change = second[name] - first[name]
        detectable: float | None = None
        verdict: Verdict = "unknown"
        if set(NO_TWO_DAYS) & set(differences):
            verdict = "no two days"
        elif "unconfirmed pose" in differences:
            verdict = "unconfirmed pose"
        elif name in BETWEEN_DAY_SD:
            detectable = find_detectable_change(BETWEEN_DAY_SD[name])
            verdict = "larger" if abs(change) > detectable else "not larger"
        changes.append(FigureChange(name, first[name], second[name], change, detectable, verdict))
    return DayComparison(tuple(changes), differences)


def _list_figures(exposure: Exposure) -> dict[str, float]:
    figures = exposure.figures
    above = (f"time_above_{item.threshold_deg:g}_percent" for item in exposure.time_above)
    entries = (f"entries_above_{item.threshold_deg:g}_per_h" for item in exposure.entries)
    named = (*above, *(f"elevation_p{p}_deg" for p in (10, 50, 90, 99)), *entries)
    return {name: value for name in named if (value := figures[name]) is not None}


def _find_differences(before: ComparedDay, after: ComparedDay) -> tuple[Difference, ...]:
    first, second, later_s = before.start, after.start, None
    if first is not None and second is not None:
        later_s = measure_us(first, second) / MICROSECONDS
    same = before.sha256 == after.sha256 != ""
    overlaps = later_s is not None and -after.duration_s < later_s < before.duration_s
    unlike: dict[Difference, bool] = {
        "recording": same,
        "subject": "" not in {before.subject, after.subject} and before.subject != after.subject,
        "hours": overlaps and not same,
        "order": later_s is not None and later_s < 0.0 and not overlaps,
        "unconfirmed pose": not (before.is_confirmed and after.is_confirmed),
        "method": before.method != after.method,
        "pose": before.pose != after.pose,
        "side": before.side != after.side,
        "metric filter": before.exposure.metric_filter_hz != after.exposure.metric_filter_hz,
        "short": min(before.exposure.analysed_s, after.exposure.analysed_s) < WHOLE_DAY_S,
        "poor": "poor" in {before.verdict, after.verdict},
    }
    return tuple(name for name in get_args(Difference) if unlike[name])


# Table 1 of the source paper, for comparison with your own figures.

QUASI_STATIC = (2, 5, 7)
"""Tasks in which elevation hardly changes, so that the paper reports no r."""


@dataclass(frozen=True, slots=True)
class TaskFigures:
    """Correlation, root mean square error and mean absolute error."""

    r: float
    rmse_deg: float
    absolute_deg: float

    @staticmethod
    def mean(found: Sequence["TaskFigures"]) -> "TaskFigures":
        """Return the mean of each statistic, as the paper does over people."""
        r, rmse, absolute = np.mean([(a.r, a.rmse_deg, a.absolute_deg) for a in found], axis=0)
        return TaskFigures(float(r), float(rmse), float(absolute))


TABLE_1: Mapping[str, Mapping[int, TaskFigures]] = {
    "gt9x": {
        1: TaskFigures(0.986, 4.47, 3.61),
        2: TaskFigures(np.nan, 2.20, 1.86),
        3: TaskFigures(0.964, 9.95, 7.73),
        4: TaskFigures(0.998, 3.05, 2.48),
        5: TaskFigures(np.nan, 2.13, 1.87),
        6: TaskFigures(0.982, 7.44, 5.47),
        7: TaskFigures(np.nan, 3.74, 3.18),
        8: TaskFigures(0.996, 3.37, 2.78),
        9: TaskFigures(0.995, 3.88, 3.25),
        10: TaskFigures(0.894, 11.25, 8.00),
    },
    "lsm9ds1": {
        1: TaskFigures(0.998, 2.91, 2.47),
        2: TaskFigures(np.nan, 1.66, 1.23),
        3: TaskFigures(0.973, 9.25, 7.18),
        4: TaskFigures(0.998, 2.37, 1.75),
        5: TaskFigures(np.nan, 1.87, 1.59),
        6: TaskFigures(0.988, 6.23, 4.50),
        7: TaskFigures(np.nan, 2.91, 2.33),
        8: TaskFigures(0.993, 3.62, 2.93),
        9: TaskFigures(0.995, 3.70, 3.12),
        10: TaskFigures(0.900, 11.24, 7.50),
    },
}
"""Boyer, Frasie, Bouyer, Roy, Poitras, Campeau-Lecours: mean of five adults against Xsens MVN."""
