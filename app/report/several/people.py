"""Group finished analyses by person, arm and side of a change; reject invalid combinations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from statistics import fmean
from typing import Literal, get_args

from acromion.app.errors import CannotProfile
from acromion.app.report.findings import FinishedAnalysis
from acromion.app.report.pairs import (
    OnePerson,
    has_mixed_methods,
    identify_hours,
    judge_person,
    name_pose,
    read_code,
)
from acromion.app.report.words.wording import clean_text
from acromion.fusion.clocks import read_clock
from acromion.fusion.comparison.days import ClockBand
from acromion.fusion.conventions import FEWEST_PEOPLE, HOUR_S, WHOLE_DAY_S, Side, judge_length
from acromion.fusion.exposure.types import Interval
from acromion.fusion.recording import MICROSECONDS

Stage = Literal["all", "before", "after"]
LeftOut = Literal["short", "long"]
Difference = Literal[
    "method", "pose", "sensor", "metric filter", "side", "date", "order", "clock", "short", "long", "poor"
]
PoseEnds = tuple[float, float]
"""``low_pose`` and ``high_pose``, as in :class:`acromion.fusion.exposure.types.Interval`."""
_ORDER: tuple[Side | None, ...] = (*get_args(Side), None)


@dataclass(frozen=True, slots=True)
class MeasuredDay:
    """One finished analysis. ``place`` is its location, from which it can be read again.

    ``least_hours``: the least analysed time of a day that counts. A day of poor quality also counts, and the
    report names it.
    """

    kept: FinishedAnalysis
    stage: Stage = "all"
    place: str = ""
    least_hours: float = WHOLE_DAY_S / HOUR_S

    @property
    def subject(self) -> str:
        """Code of the person; empty if none was given."""
        return read_code(self.kept)

    @property
    def job(self) -> str:
        """Job of the person on this day, by its code of ISCO-08 or else its title; empty if not stated."""
        whose = self.kept.subject
        return clean_text(whose.isco_code) or clean_text(whose.job_title).casefold()

    @property
    def start(self) -> datetime | None:
        """Start by its clock; a time zone is dropped because days are compared by the time on the clock."""
        start = self.kept.findings.recording.start
        return start.replace(tzinfo=None) if start else None

    @property
    def end(self) -> datetime | None:
        """End by its clock."""
        start, duration_us = self.kept.findings.recording.start, self.kept.findings.recording.duration_us
        return read_clock(start, duration_us).replace(tzinfo=None) if start else None

    @property
    def left_out(self) -> LeftOut | None:
        """Why it does not count as a day; None if it counts."""
        findings = self.kept.findings
        recorded_s = findings.recording.duration_us / MICROSECONDS
        return judge_length(recorded_s, findings.exposure.analysed_s, self.least_hours * HOUR_S)

    def list_figures(self) -> dict[str, float | None]:
        """Return the figures for comparing days."""
        exposure = self.kept.findings.exposure
        rises = next(e for e in exposure.entries if e.threshold_deg == 60)
        return {
            **{f"time_above_{item.threshold_deg:g}_percent": item.percent for item in exposure.time_above},
            "entries_above_60_per_h": rises.per_hour,
            "elevation_p50_deg": exposure.percentiles_deg[50],
        }

    def find_interval(self, name: str) -> Interval | None:
        """Return the range of one of these figures on this day; None if unknown."""
        exposure = self.kept.findings.exposure
        above = {f"time_above_{item.threshold_deg:g}_percent": item.interval for item in exposure.time_above}
        return above[name] if name in above else exposure.intervals.get(name)


@dataclass(frozen=True, slots=True)
class ArmDays:
    """The days of one arm of one person, on one side of a change, in order of time.

    ``bands``: the days overlaid by the clock (:func:`acromion.fusion.comparison.days.overlay_days`).
    """

    subject: str
    side: Side | None
    stage: Stage
    days: tuple[MeasuredDay, ...]
    bands: tuple[ClockBand, ...] = ()

    @property
    def counted(self) -> tuple[MeasuredDay, ...]:
        """Days that count in means and spread."""
        return tuple(day for day in self.days if day.left_out is None)

    def list_values(self, name: str) -> list[float]:
        """Return a figure of every day that counts."""
        values = (day.list_figures()[name] for day in self.counted)
        return [value for value in values if value is not None]

    def find_pose_ends(self, name: str) -> PoseEnds | None:
        """Return the mean ends of the range with the pose's error over the days that count.

        The error is the same every day, so that more days do not reduce it. None unless every day has both
        ends.
        """
        intervals = [day.find_interval(name) for day in self.counted]
        ends = [(i.low_pose, i.high_pose) for i in intervals if i is not None]
        known = [(low, high) for low, high in ends if low is not None and high is not None]
        if not known or len(known) < len(intervals):
            return None
        return fmean(low for low, _ in known), fmean(high for _, high in known)


@dataclass(frozen=True, slots=True)
class StudiedDays:
    """All days, and their differences other than the work."""

    arms: tuple[ArmDays, ...]
    one_person: OnePerson
    differences: tuple[Difference, ...]

    @property
    def days(self) -> tuple[MeasuredDay, ...]:
        """All days."""
        return tuple(day for arm in self.arms for day in arm.days)

    @property
    def least_hours(self) -> float:
        """The least analysed time of a day that counts."""
        return self.arms[0].days[0].least_hours

    @property
    def people(self) -> tuple[str, ...]:
        """The codes; a single empty one if none was given."""
        return tuple(dict.fromkeys(arm.subject for arm in self.arms))

    @property
    def is_group(self) -> bool:
        """Whether they are from several people; then only figures of five or more people are shown."""
        return self.one_person == "no"

    def find_arms(self, side: Side | None, stage: Stage) -> tuple[ArmDays, ...]:
        """Return the days of each person for one arm, on one side of the change."""
        return tuple(arm for arm in self.arms if (arm.side, arm.stage) == (side, stage))

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Sides of the change; only "all" without a change."""
        return tuple(dict.fromkeys(arm.stage for arm in self.arms))

    @property
    def sides(self) -> tuple[Side | None, ...]:
        """The measured arms."""
        return tuple(side for side in _ORDER if any(arm.side == side for arm in self.arms))


def group_days(
    days: Sequence[MeasuredDay], *, same_subject: bool = False, mixed_methods: bool = False
) -> StudiedDays:
    """Group days by person, arm and side of the change.

    Parameters
    ----------
    days
        In any order.
    same_subject
        A person states that all are from one person, if a code is missing.
    mixed_methods
        Allow figures of several methods, or of several versions of one.

    Raises CannotProfile for a single recording; one given twice; the same hours of one arm twice; recordings
    without a code beside several codes, or not stated to be from one person; fewer than five people per arm
    in a group; several methods without permission.
    """
    if len(days) < 2:
        raise CannotProfile(why="one")
    seen: dict[tuple[str, datetime | None], MeasuredDay] = {}
    for day in days:
        first = seen.setdefault(identify_hours(day.kept), day)
        if first is not day:
            raise CannotProfile(why="same", name=_name(first), other=_name(day))
    one_person = judge_person([day.kept for day in days], is_stated=same_subject)
    nobody = next((day for day in days if not day.subject), None)
    if nobody and one_person in ("unknown", "no"):  # in a group every code is required
        raise CannotProfile(why="person" if one_person == "unknown" else "codes", name=_name(nobody))
    if has_mixed_methods(day.kept for day in days) and not mixed_methods:
        raise CannotProfile(why="methods")
    code = max(day.subject for day in days)  # the only code, which also replaces a missing one
    arms = _split_arms(days, code if one_person != "no" else "")
    people = Counter((arm.side, arm.stage) for arm in arms if arm.counted)
    if one_person == "no" and max(people.values(), default=0) < FEWEST_PEOPLE:
        raise CannotProfile(why="few")
    for arm in arms:
        _check_hours([day for other in arms if _is_same_arm(arm, other) for day in other.days])
    return StudiedDays(arms, one_person, _find_differences(arms))


def _check_hours(days: Sequence[MeasuredDay]) -> None:
    placed = sorted((day.start, day.end, _name(day)) for day in days if day.start and day.end)
    for (_, end, first), (start, _, second) in pairwise(placed):
        if start < end:
            raise CannotProfile(why="hours", name=first, other=second)


def _name(day: MeasuredDay) -> str:
    return clean_text(day.kept.subject.file_name)


def _is_same_arm(one: ArmDays, other: ArmDays) -> bool:
    return (one.subject, one.side) == (other.subject, other.side)


def _split_arms(days: Sequence[MeasuredDay], code: str) -> tuple[ArmDays, ...]:
    """Split by person, arm and side of the change, each in order of time; ``code`` replaces a missing one."""
    stages: tuple[Stage, ...] = ("all", "before", "after")
    split: dict[tuple[str, Side | None, Stage], list[MeasuredDay]] = {}
    for day in days:
        split.setdefault((day.subject or code, day.kept.subject.side, day.stage), []).append(day)
    ordered = sorted(split, key=lambda key: (key[0], _ORDER.index(key[1]), stages.index(key[2])))
    return tuple(ArmDays(*key, tuple(sorted(split[key], key=_place_in_time))) for key in ordered)


def _place_in_time(day: MeasuredDay) -> tuple[bool, datetime, str]:
    return day.start is None, day.start or datetime.min, day.kept.findings.recording.sha256  # noqa: DTZ901


def _find_differences(arms: Sequence[ArmDays]) -> tuple[Difference, ...]:
    """Return what differs between days but should be alike, the most serious first."""
    days = [day for arm in arms for day in arm.days]
    every = [day.kept.findings for day in days]
    dates = ([day.start.date() for day in arm.counted if day.start] for arm in arms)
    unlike: dict[Difference, bool] = {
        "method": has_mixed_methods(day.kept for day in days),
        "pose": len({name_pose(findings) for findings in every}) > 1,
        "sensor": len({findings.recording.device for findings in every}) > 1,
        "metric filter": len({findings.exposure.metric_filter_hz for findings in every}) > 1,
        "side": len({day.kept.subject.side is None for day in days}) > 1,
        "date": any(len(set(one)) < len(one) for one in dates),
        "order": any(_is_out_of_order(arm, arms) for arm in arms if arm.stage == "after"),
        "clock": any(day.start is None for day in days),
        "short": any(day.left_out == "short" for day in days),
        "long": any(day.left_out == "long" for day in days),
        "poor": any(findings.quality.verdict == "poor" for findings in every),
    }
    return tuple(name for name, holds in unlike.items() if holds)


def _is_out_of_order(after: ArmDays, arms: Sequence[ArmDays]) -> bool:
    """Return whether a day after the change is earlier than one before it."""
    before = [
        day.start
        for arm in arms
        if arm.stage == "before" and _is_same_arm(arm, after)
        for day in arm.days
        if day.start
    ]
    return any(day.start < max(before) for day in after.days if day.start) if before else False
