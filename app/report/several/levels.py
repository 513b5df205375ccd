"""The proposed levels beside the mean of several days, of one arm or of the people of a group."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf
from statistics import fmean
from typing import Any

from acromion.app.report.export.results import describe_level
from acromion.app.report.findings import Findings
from acromion.app.report.several.people import ArmDays, Stage, StudiedDays
from acromion.fusion.comparison.change import Reason, Reference
from acromion.fusion.comparison.days import describe_days
from acromion.fusion.comparison.levels import ComparedLevel, can_be_below, compare_with_level
from acromion.fusion.conventions import Side
from acromion.fusion.exposure.types import Interval

_ENDS = ("low", "high", "low_pose", "high_pose")


@dataclass(frozen=True, slots=True)
class MeanLevel:
    """A proposed level with a mean of days, and how many of the measured ``days`` read above it.

    The range of ``mean`` is widened to the mean range of single days, because the error of the angle is the
    same every day; None if a day has no range.
    """

    mean: ComparedLevel
    days_above: int
    days: int


def compare_arms(arms: Sequence[ArmDays]) -> tuple[MeanLevel, ...]:
    """Compare the days of one arm, or of one arm of several people, each person once; empty without days."""
    people = [[day.kept.findings for day in arm.counted] for arm in arms if arm.counted]
    compared = [[findings.compare_with_levels() for findings in person] for person in people]
    every = [findings for person in people for findings in person]
    return tuple(
        _compare([list(person) for person in levels], every)
        for levels in zip(*(zip(*person, strict=True) for person in compared), strict=True)
    )


def compare_group(studied: StudiedDays, side: Side | None, stage: Stage) -> tuple[MeanLevel, ...]:
    """Compare one arm of a group on one side of the change."""
    return compare_arms([arm for arm in studied.arms if (arm.side, arm.stage) == (side, stage)])


def _compare(people: list[list[ComparedLevel]], every: Sequence[Findings]) -> MeanLevel:
    days = [level for person in people for level in person]
    reference = days[0].reference
    reason: Reason = next((level.reason for level in days if level.reason), "")
    known = [[level.measured for level in person if level.measured is not None] for person in people]
    values = [value for person in known for value in person]
    above = sum(value > reference.high for value in values)
    if len(values) < len(days):  # a mean of other days would be another mean
        return MeanLevel(ComparedLevel(reference, None, None, None, "not computed"), above, len(values))
    means = values if len(people) == 1 else [fmean(person) for person in known]
    spread = describe_days(means, 100.0 if reference.unit == "percent" else inf)
    interval, standing = _find_range(people, spread.mean_range), None
    if not reason:
        is_complete = all(_is_complete(findings, reference) for findings in every)
        standing = compare_with_level(spread.mean, interval, reference.high, can_be_below=is_complete)
    mean = ComparedLevel(reference, spread.mean, interval, standing, reason)
    return MeanLevel(mean, above, len(days))


def _is_complete(findings: Findings, reference: Reference) -> bool:
    state = findings.calibration.state if findings.calibration else None
    return can_be_below(reference, findings.exposure, state)


def _find_range(people: list[list[ComparedLevel]], spread: Interval | None) -> Interval | None:
    """Return the mean ends of the days, each person once, at least as wide as the range of the mean."""
    intervals = [[level.interval for level in person if level.interval] for person in people]
    if any(len(known) < len(person) for known, person in zip(intervals, people, strict=True)):
        return None

    def average(end: str) -> float | None:
        ends = [[getattr(interval, end) for interval in person] for person in intervals]
        return None if any(None in person for person in ends) else fmean(map(fmean, ends))

    low, high, low_pose, high_pose = map(average, _ENDS)
    if low is None or high is None:
        return None
    if spread is not None:
        low, high = min(low, spread.low), max(high, spread.high)
    return Interval(low, high, low_pose, high_pose)


def describe_levels(levels: Sequence[MeanLevel]) -> Iterator[dict[str, Any]]:
    """Return each level for JSON."""
    for level in levels:
        yield {**describe_level(level.mean), "days_above": level.days_above, "days": level.days}
