"""``profile.json`` and its tables: every figure of several days, without language."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import inf
from statistics import fmean
from typing import Any

from acromion.app.report.export.tables import encode_table, split_offset
from acromion.app.report.figures import round_all
from acromion.app.report.pairs import describe_source, name_method
from acromion.app.report.several.levels import compare_arms, compare_group, describe_levels
from acromion.app.report.several.people import ArmDays, MeasuredDay, PoseEnds, Stage, StudiedDays
from acromion.app.report.words.wording import clean_text
from acromion.fusion.comparison.change import BETWEEN_DAY_SD, SOURCE
from acromion.fusion.comparison.days import (
    LEAST_DAYS,
    LEAST_OWN_DAYS,
    PERCENTS,
    ClockBand,
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
from acromion.fusion.conventions import FEWEST_PEOPLE, HOUR_S, Side
from acromion.fusion.exposure.types import Interval

SCHEMA = "acromion.profile/1"
MAIN = "time_above_60_percent"
FIGURES = (
    "time_above_30_percent",
    MAIN,
    "time_above_90_percent",
    "entries_above_60_per_h",
    "elevation_p50_deg",
)


def describe_profile(studied: StudiedDays) -> dict[str, Any]:
    """Return every day, mean, spread, overlay and change for JSON; a group shows no single people."""
    document: dict[str, Any] = round_all(
        {
            "schema": SCHEMA,
            "one_person": studied.one_person,
            "differences": list(studied.differences),
            "arms": [] if studied.is_group else [_describe_arm(arm) for arm in studied.arms],
            "group": [
                {
                    "side": side,
                    "stage": stage,
                    "figures": {
                        name: _spell(spread) | _spell_pose(find_group_pose(studied, name, side, stage))
                        for name, spread in figures.items()
                    },
                    "levels": list(describe_levels(compare_group(studied, side, stage))),
                }
                for side, stage, figures in list_groups(studied)
            ],
            "jobs": [
                {
                    "side": side,
                    "stage": stage,
                    "job_title": job.title or None,
                    "isco_code": job.isco_code or None,
                    "figures": {name: _spell(spread) for name, spread in figures.items()},
                }
                for side, stage, job, figures in list_jobs(studied)
            ],
            "change": [{"side": side, "figures": changes} for side, changes in list_changes(studied)],
            "rules": {
                "fewest_people": FEWEST_PEOPLE,
                "whole_day_s": studied.least_hours * HOUR_S,
                "overlay_least_days": LEAST_DAYS,
                "own_deviation_least_days": LEAST_OWN_DAYS,
            },
            "source": SOURCE,
        }
    )
    return document


def _describe_arm(arm: ArmDays) -> dict[str, Any]:
    telling, trend = estimate_days_needed(arm), compute_trend(arm)
    return {
        "subject": arm.subject,
        "side": arm.side,
        "stage": arm.stage,
        "days": [_describe_day(day) for day in arm.days],
        "figures": {
            name: _spell(figure) | _spell_pose(arm.find_pose_ends(name))
            for name, figure in describe_arm(arm).items()
        },
        "levels": list(describe_levels(compare_arms([arm]))),
        "telling": _spell(telling) if telling else None,
        "trend": _spell(trend) if trend else None,
        "overlay": [_describe_band(band) for band in arm.bands],
    }


def _describe_day(day: MeasuredDay) -> dict[str, Any]:
    findings, ranges = day.kept.findings, {name: day.find_interval(name) for name in FIGURES}
    return {
        **describe_source(day.kept),
        "device": findings.recording.device,
        "method": name_method(findings) or None,
        "pose": findings.calibration.pose if findings.calibration else None,
        "left_out": day.left_out,
        "job_title": day.kept.subject.job_title,
        "isco_code": day.kept.subject.isco_code,
        "figures": day.list_figures(),
        "ranges": {name: asdict(interval) if interval else None for name, interval in ranges.items()},
    }


def _describe_band(band: ClockBand) -> dict[str, Any]:
    angles: Mapping[int, float] = band.percentiles_deg or {}
    hours, rest = divmod(round(band.start_s), 3600)
    clock = f"{hours:02d}:{rest // 60:02d}"
    return {"clock": clock, "days": band.days, **{f"p{p}_deg": angles.get(p) for p in PERCENTS}}


def _spell(figure: DayMean | GroupSpread | GroupChange | Telling | Trend) -> dict[str, Any]:
    spelled = {name: getattr(figure, name) for name in type(figure).__slots__}
    return {
        name: [value.low, value.high] if isinstance(value, Interval) else value
        for name, value in spelled.items()
    }


def _spell_pose(ends: PoseEnds | None) -> dict[str, float | None]:
    return dict(zip(("low_pose", "high_pose"), ends or (None, None), strict=True))


# Also used by the report.


def describe_arm(arm: ArmDays) -> dict[str, DayMean]:
    """Return the days of an arm by figure; empty if no day counts."""
    every = {name: arm.list_values(name) for name in FIGURES}
    return {name: describe_days(values, _find_most(name)) for name, values in every.items() if values}


def _find_most(name: str) -> float:
    return 100.0 if name.endswith("_percent") else 180.0 if name.endswith("_deg") else inf


def estimate_days_needed(arm: ArmDays) -> Telling | None:
    """Return how many days can detect a change of half the time above 60 deg; None if no day counts."""
    values = arm.list_values(MAIN)
    return find_telling(describe_days(values), BETWEEN_DAY_SD[MAIN]) if values else None


def compute_trend(arm: ArmDays) -> Trend | None:
    """Compare the time above 60 deg of every dated day with the first; None on a side of a change."""
    dated = [day.list_figures()[MAIN] for day in arm.counted if day.start]
    values = [value for value in dated if value is not None]
    return find_trend(values, BETWEEN_DAY_SD[MAIN]) if arm.stage == "all" else None


def list_groups(studied: StudiedDays) -> Iterator[tuple[Side | None, Stage, dict[str, GroupSpread]]]:
    """Return the spread of each arm and side of the change, between and within five people or more."""
    if not studied.is_group:
        return
    for side in studied.sides:
        for stage in studied.stages:
            known = describe_arms(studied.find_arms(side, stage))
            if known:
                yield side, stage, known


def describe_arms(arms: Sequence[ArmDays]) -> dict[str, GroupSpread]:
    """Return the spread of each figure over one arm each of five people or more; empty for fewer."""
    figures = {name: _collect(arms, name) for name in FIGURES}
    return {
        name: describe_group(people, _find_most(name))
        for name, people in figures.items()
        if len(people) >= FEWEST_PEOPLE
    }


@dataclass(frozen=True, slots=True)
class Job:
    """A job in a group; both fields are empty for the other jobs and the days without one."""

    title: str = ""
    isco_code: str = ""


def list_jobs(
    studied: StudiedDays,
) -> Iterator[tuple[Side | None, Stage, Job, dict[str, GroupSpread]]]:
    """Return the spread of each arm and side of the change by job, between and within five people or more.

    Jobs of fewer than five people are pooled with the days without a job. While the pool has fewer than five
    people, the smallest other job joins it, because the group minus all jobs would describe the pool. Without
    a job of five people there is nothing to return.
    """
    for side, stage, _ in list_groups(studied):
        arms = studied.find_arms(side, stage)
        shown = [
            [replace(arm, days=tuple(day for day in arm.days if day.job in jobs)) for arm in arms]
            for jobs in _split_jobs(arms)
        ]
        spreads = [describe_arms(of_job) for of_job in shown if any(arm.counted for arm in of_job)]
        names = [name for name in FIGURES if all(name in spread for spread in spreads)]
        for of_job, spread in zip(shown, spreads, strict=False):  # only the last, pooled ones may be empty
            job = Job() if of_job is shown[-1] else _name_job(of_job)
            yield side, stage, job, {name: spread[name] for name in names}


def _split_jobs(arms: Sequence[ArmDays]) -> list[frozenset[str]]:
    """Return the jobs to show in alphabetical order; the pooled jobs come last."""
    people: dict[str, set[str]] = {}
    for arm in arms:
        for day in arm.counted:
            people.setdefault(day.job, set()).add(arm.subject)
    alone = sorted((job for job in people if job), key=lambda job: (len(people[job]), job))
    pooled, others = {""}, set(people.get("", ()))
    while alone and (len(people[alone[0]]) < FEWEST_PEOPLE or 0 < len(others) < FEWEST_PEOPLE):
        others |= people[alone[0]]
        pooled.add(alone.pop(0))
    return [*(frozenset({job}) for job in sorted(alone)), frozenset(pooled)] if alone else []


def _name_job(arms: Sequence[ArmDays]) -> Job:
    """Return the code of a job with the title that most of its days have."""
    whose = [day.kept.subject for arm in arms for day in arm.counted]
    ((title, _),) = Counter(sorted(clean_text(one.job_title) for one in whose)).most_common(1)
    return Job(title, clean_text(whose[0].isco_code))


def find_group_pose(studied: StudiedDays, name: str, side: Side | None, stage: Stage) -> PoseEnds | None:
    """Return the mean over people of the ends of the range with the pose's error, each person once."""
    arms = [arm for arm in studied.find_arms(side, stage) if arm.counted]
    ends = [ends for arm in arms if (ends := arm.find_pose_ends(name))]
    if not ends or len(ends) < len(arms):
        return None
    return fmean(low for low, _ in ends), fmean(high for _, high in ends)


def list_changes(studied: StudiedDays) -> Iterator[tuple[Side | None, dict[str, dict[str, Any]]]]:
    """Return the change of each arm, after minus before, by figure; none without a change."""
    if "after" not in studied.stages:
        return
    for side in studied.sides:
        changes = {name: _find_change(studied, name, side) for name in FIGURES}
        known = {name: change for name, change in changes.items() if change}
        if known:
            yield side, known


def _collect(arms: Sequence[ArmDays], name: str) -> dict[str, list[float]]:
    """Return the figure of each person's days that count; people without any are omitted."""
    values = {arm.subject: arm.list_values(name) for arm in arms}
    return {subject: days for subject, days in values.items() if days}


def _find_change(studied: StudiedDays, name: str, side: Side | None) -> dict[str, Any] | None:
    """Compare before and after: one person by the days, a group by the range of its change."""
    before, after = (_collect(studied.find_arms(side, stage), name) for stage in ("before", "after"))
    change, detectable, verdict = compare_people(before, after), None, "unknown"
    if change is None or (studied.is_group and change.people < FEWEST_PEOPLE):
        return None
    if change.people == 1:  # the minimal detectable change between days, by this person's deviation if known
        code, sd = next(code for code in before if code in after), BETWEEN_DAY_SD.get(name)
        pooled = pool_deviation([before[code], after[code]])
        if pooled and pooled[1] >= LEAST_OWN_DAYS - 1:
            sd = pooled[0]
        if sd is not None:
            detectable = find_detectable_between(sd, len(before[code]), len(after[code]))
    if change.change_range is not None:
        holds_none = change.change_range.low <= 0.0 <= change.change_range.high
        verdict = "not larger" if holds_none else "larger"
    elif detectable is not None:
        verdict = "larger" if abs(change.change) > detectable else "not larger"
    return {**_spell(change), "detectable": detectable, "verdict": verdict}


# Tables.


_DAY_COLUMNS = (
    *("subject", "side", "stage", "start", "file_name", "sha256", "report_id", "device", "method", "pose"),
    *("verdict", "analysed_s", "left_out"),
    *FIGURES,
    *("utc_offset", "job_title", "isco_code"),
)
_OVERLAY_COLUMNS = ("subject", "side", "stage", "clock", "days", *(f"p{p}_deg" for p in PERCENTS))


def encode_day_table(studied: StudiedDays) -> bytes:
    """Encode ``profile.csv``: a row for each day; its start is local time, its offset from UTC is apart."""
    rows = (
        round_all(
            {**shown, **shown["figures"], "subject": arm.subject, "stage": arm.stage}
            | dict(zip(("start", "utc_offset"), split_offset(shown["start"]), strict=True))
        )
        for arm in studied.arms
        for shown in map(_describe_day, arm.days)
    )
    return encode_table(_DAY_COLUMNS, rows)


def encode_overlay_table(studied: StudiedDays) -> bytes:
    """Encode ``overlay.csv``: a row for each quarter hour of each arm; empty if there are too few days."""
    rows = (
        round_all({"subject": arm.subject, "side": arm.side, "stage": arm.stage, **_describe_band(band)})
        for arm in studied.arms
        for band in arm.bands
    )
    return encode_table(_OVERLAY_COLUMNS, rows)
