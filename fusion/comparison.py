"""One day beside another: is the difference larger than days differ anyway? EXPOSURE.md section 0, finding 3.

MDC95 = 1.96 sqrt(2 / k) SD_BD, with k days on each side and the between-day standard deviation SD_BD of
Wahlström et al. 2010 (hairdressers, right arm, four days): 2.0 percentage points for time above 60 deg,
3.4 deg for the median. Another kind of work may vary more or less; that is said with the verdict.
"""

from dataclasses import dataclass, replace
from math import sqrt
from typing import Literal

from fusion.exposure.types import Exposure

Verdict = Literal["larger", "not larger", "unknown", "no two days"]
Difference = Literal["recording", "subject", "method", "pose", "side", "metric filter", "short", "poor"]
NO_TWO_DAYS: tuple[Difference, ...] = ("recording", "subject", "side")
"""What makes two recordings no two days of one arm of one person, the gravest first: no change is judged."""

SOURCE = "Wahlström et al. 2010"
BETWEEN_DAY_SD = {"time_above_60_percent": 2.0, "elevation_p50_deg": 3.4}
WHOLE_DAY_S = 4 * 3600.0


@dataclass(frozen=True, slots=True)
class ComparedDay:
    """What must be alike for two days to be compared."""

    exposure: Exposure
    method: str
    pose: str
    side: str | None
    verdict: str
    sha256: str = ""
    """Of the recording; empty where it is not known."""
    subject: str = ""
    """Code of the person; empty where none was given."""


@dataclass(frozen=True, slots=True)
class FigureChange:
    """A figure of the later side less that of the earlier, and the least change that days do not make.

    ``verdict`` is a key for the wording: ``larger`` (than the day-to-day variation), ``not larger``, or
    ``unknown`` where no between-day variation was published for the figure; ``no two days`` where the two are
    one recording, of two people, or two arms: then there is no change to be judged.
    """

    name: str
    before: float
    after: float
    change: float
    detectable: float | None
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class DayComparison:
    """The changes, and what the two sides differ in besides the work: with any of it, read with care."""

    changes: tuple[FigureChange, ...]
    differences: tuple[Difference, ...]


def find_detectable_change(between_day_sd: float, days: int = 1) -> float:
    """Give MDC95 for the mean of ``days`` days against that of as many others."""
    if days < 1:
        raise ValueError(days)
    return 1.96 * sqrt(2.0 / days) * between_day_sd


def compare_days(before: ComparedDay, after: ComparedDay) -> DayComparison:
    """Compare one day with another; of one recording, two people or two arms, no change is judged."""
    first, second = _list_figures(before.exposure), _list_figures(after.exposure)
    changes = tuple(_compare(name, first[name], second[name]) for name in first if name in second)
    differences = _find_differences(before, after)
    if set(NO_TWO_DAYS) & set(differences):
        changes = tuple(replace(change, detectable=None, verdict="no two days") for change in changes)
    return DayComparison(changes, differences)


def _list_figures(exposure: Exposure) -> dict[str, float]:
    above = {f"time_above_{item.threshold_deg:g}_percent": item.percent for item in exposure.time_above}
    percentiles = {f"elevation_p{p}_deg": exposure.percentiles_deg[p] for p in (10, 50, 90, 99)}
    entries = {f"entries_above_{item.threshold_deg:g}_per_h": item.per_hour for item in exposure.entries}
    return {**above, **percentiles, **entries}


def _compare(name: str, before: float, after: float) -> FigureChange:
    change = after - before
    if name not in BETWEEN_DAY_SD:
        return FigureChange(name, before, after, change, None, "unknown")
    detectable = find_detectable_change(BETWEEN_DAY_SD[name])
    verdict: Verdict = "larger" if abs(change) > detectable else "not larger"
    return FigureChange(name, before, after, change, detectable, verdict)


def _find_differences(before: ComparedDay, after: ComparedDay) -> tuple[Difference, ...]:
    unlike: dict[Difference, bool] = {
        "recording": before.sha256 == after.sha256 != "",
        "subject": "" not in {before.subject, after.subject} and before.subject != after.subject,
        "method": before.method != after.method,
        "pose": before.pose != after.pose,
        "side": before.side != after.side,
        "metric filter": before.exposure.metric_filter_hz != after.exposure.metric_filter_hz,
        "short": min(before.exposure.analysed_s, after.exposure.analysed_s) < WHOLE_DAY_S,
        "poor": "poor" in {before.verdict, after.verdict},
    }
    return tuple(name for name, differs in unlike.items() if differs)
