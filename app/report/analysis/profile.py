"""The first page: the Arm Elevation Profile, laid out the same everywhere (docs/profile.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from app.report.analysis.chapters import choose_ranges, format_pose_caution, format_quality
from app.report.analysis.norms import LIMITS, extend_scale, find_reason
from app.report.charts.day import WORST_WINDOW_S, Block, build_day
from app.report.charts.profile import Doubt, Sureness, TileScale, draw_sureness, draw_tile
from app.report.findings import Findings
from app.report.model import Drawing, Profile, Table, Tile
from app.report.words.numbers import (
    NONE,
    Clock,
    format_duration,
    format_number,
    format_percent,
    format_range,
    format_rate,
    percent_sign,
)
from app.report.words.subject import ReportSubject, clean_text, cut_text
from app.report.words.wording import Language, Words, fill, join_clauses
from fusion.caveats import Caveat
from fusion.comparison import BETWEEN_DAY_SD, WHOLE_DAY_S, find_detectable_change
from fusion.conventions import MAIN_THRESHOLD_DEG, SAID_S, UNHELD, awaits_pose
from fusion.exposure.types import Interval, PartExposure

SHOWN_TASKS = 3
MOST_STEPS = 5
LONGEST_NAME = 32
TASK_KINDS = frozenset({"task", "seated", "supported"})
"""Kinds of a period that name what was done; work counts where the diary gives it a name."""
DAYS = (1, 2, 3, 5)
WORTHWHILE_SHARE = 0.5
"""Of the time above 60 deg: the change that the days asked for can tell (docs/profile.md)."""
PUBLISHED = {30: "above_30", 60: "above_60", 90: "above_90_others"}
ENDS = {30: 100.0, 60: 40.0, 90: 20.0}
"""Ends of the scales, percent; further where a value needs it."""
END_PER_H = 120.0


@dataclass(frozen=True, slots=True)
class _Page:
    """What every part of the page needs."""

    findings: Findings
    clock: Clock
    words: Words

    @property
    def entry(self) -> Words:
        words: Words = self.words["profile"]
        return words

    @property
    def language(self) -> Language:
        return self.clock.language


def build_profile(findings: Findings, subject: ReportSubject, clock: Clock, words: Words) -> Profile:
    """Build the first page."""
    page = _Page(findings, clock, words)
    tasks = _rank_tasks(findings)
    blocks = _lay_out_blocks(findings, tasks, page)
    versions = {"version": str(subject.version), "earlier": str(subject.version - 1)}
    return Profile(
        quality=format_quality(findings, words, clock.language),
        tiles=(*(_build_share(threshold, page) for threshold in (30, 60, 90)), _build_rises(page)),
        strip=build_day(findings, blocks, clock, words),
        tasks=_tabulate_tasks(tasks, page) if tasks else _tabulate_quarter_hours(page),
        sure=_build_sureness(page),
        next_title=page.entry["next"]["title"],
        next_steps=_list_next_steps(blocks if tasks else (), subject, page),
        not_a_diagnosis=page.entry["not_a_diagnosis"],
        amendment=fill(words["heading"]["amended_short"], versions) if subject.version > 1 else "",
    )


# ------------------------------------------------------------------ tiles


def _build_share(threshold: int, page: _Page) -> Tile:
    above = next(t for t in page.findings.exposure.time_above if t.threshold_deg == threshold)
    reason, reference = find_reason(page.findings), LIMITS[PUBLISHED[threshold]]
    published = () if reason else tuple(v for v in (reference.low, reference.high) if v is not None)
    pose = _find_pose_part(above.percent, above.interval)
    end = _extend(ENDS[threshold], above.percent, above.interval)
    return _build_tile(
        TileScale(
            key=f"tile-{threshold}",
            words=(fill(page.entry["above"], {"threshold": str(threshold)}), ""),
            end=min(end, 100.0),
            end_label=_format_published((min(end, 100.0),), page.language),
            measured=above.percent,
            interval=(above.interval.low, above.interval.high) if above.interval else None,
            pose=pose,
            published=published,
            published_label=_format_published(published, page.language),
        ),
        {
            "value": format_percent(above.percent, page.language),
            "duration": format_duration(above.duration_s, page.language),
            "range": format_range(above.interval, page.language),
            "pose": format_percent(pose[1], page.language) if pose else "",
            "published": str(page.entry["published"][reason or f"above_{threshold}"]),
        },
        page,
    )


def _build_rises(page: _Page) -> Tile:
    """Build the tile of the rises; no published value was counted as they are, so that none stands there."""
    exposure = page.findings.exposure
    entries = next(e for e in exposure.entries if e.threshold_deg == MAIN_THRESHOLD_DEG)
    interval = exposure.intervals.get(f"entries_above_{MAIN_THRESHOLD_DEG}_per_h")
    per_hour, language = entries.per_hour, page.language
    pose = _find_pose_part(per_hour, interval) if per_hour is not None else None
    end = _extend(END_PER_H, per_hour or 0.0, interval)
    low, high = (
        (format_rate(end, language) for end in (interval.low, interval.high)) if interval else ("", "")
    )
    return _build_tile(
        TileScale(
            key="tile-rises",
            words=(page.entry["rises"], ""),
            end=end,
            end_label=format_number(end, 0, language),
            measured=per_hour or 0.0,
            interval=(interval.low, interval.high) if interval else None,
            pose=pose,
        ),
        {
            "value": format_rate(per_hour, language),
            "duration": fill(page.entry["count"], {"count": format_number(entries.count, 0, language)}),
            "range": f"{low}–{high}" if interval else "",
            "pose": format_rate(pose[1], language) if pose else "",
            "published": page.entry["published"]["none"],
        },
        page,
    )


def _build_tile(scale: TileScale, facts: Mapping[str, str], page: _Page) -> Tile:
    """Build a tile from its written facts: value, duration, range, pose, published."""
    entry, name = page.entry, scale.words[0]
    calibration = page.findings.calibration
    told = {
        "needed": page.words["pose_state"]["needed"] if calibration and calibration.needs_pose else "",
        **facts,
        "range": fill(entry["range"][choose_ranges(page.findings)], facts) if facts["range"] else "",
        "pose": fill(entry["with_pose"], {"high": facts["pose"]}) if facts["pose"] else "",
    }
    parts = ", ".join(part for part in (*told.values(), scale.published_label) if part)
    alternative = fill(entry["tile"], {"name": name, "parts": parts})
    drawn = draw_tile(replace(scale, words=(name, alternative))) if facts["value"] != NONE else ""
    return Tile(name=name, scale=drawn, alternative=alternative, **told)


def _find_pose_part(value: float, interval: Interval | None) -> tuple[float, float] | None:
    """Give what the one-sided error of the pose adds above the range, where the figure carries it."""
    if interval is None or interval.high_pose is None or interval.high_pose <= max(interval.high, value):
        return None
    return interval.high, interval.high_pose


def _extend(end: float, value: float, interval: Interval | None) -> float:
    ends = (interval.high, interval.high_pose or 0.0) if interval else ()
    return extend_scale(end, max(1.1 * value, *ends, 0.0))


def _format_published(values: Sequence[float], language: Language) -> str:
    """Write a published value, or a range of two, with the digits it was published with."""
    told = "–".join(format_number(v, 0 if v >= 10 else 1, language) for v in values)
    return told + percent_sign(language) if told else ""


# ------------------------------------------------------------------ tasks


def _rank_tasks(findings: Findings) -> list[PartExposure]:
    """Give the tasks of the diary with the most time above 60 deg, the most first."""
    named = [part for part in findings.exposure.by_task if _is_task(part) and part.analysed_s > 0]
    return sorted(named, key=lambda part: -_find_above_s(part))[:SHOWN_TASKS]


def _is_task(part: PartExposure) -> bool:
    return not part.reason and (part.kind in TASK_KINDS or (part.kind == "work" and bool(part.label)))


def _find_above_s(part: PartExposure) -> float:
    return part.percent_above.get(MAIN_THRESHOLD_DEG, 0.0) / 100 * part.analysed_s


def _name(part: PartExposure, page: _Page) -> str:
    name = clean_text(part.label) or page.words["part"]["kind"].get(part.kind, part.kind)
    return cut_text(name, LONGEST_NAME)


def _lay_out_blocks(findings: Findings, tasks: Sequence[PartExposure], page: _Page) -> tuple[Block, ...]:
    """Give the periods under the timeline: the tasks, or else the quarter hours with the most time above."""
    if not tasks:
        return tuple(
            Block(window.start_s, window.start_s + window.length_s, "", rank)
            for rank, window in enumerate(findings.exposure.quarter_hours, 1)
            if window.start_s is not None
        )
    ranks = {(task.kind, task.label): rank for rank, task in enumerate(tasks, 1)}
    return tuple(
        Block(part.start_s, part.end_s, _name(part, page), ranks.get((part.kind, part.label)))
        for part in findings.exposure.by_period
        if _is_task(part)
    )


def _tabulate_tasks(tasks: Sequence[PartExposure], page: _Page) -> Table:
    rows = tuple(
        (
            f"{rank}  {_name(task, page)}",
            format_duration(_find_above_s(task), page.language),
            format_percent(task.percent_above.get(MAIN_THRESHOLD_DEG), page.language),
        )
        for rank, task in enumerate(tasks, 1)
    )
    return Table(page.entry["tasks"]["title"], tuple(page.entry["tasks"]["columns"]), rows)


def _tabulate_quarter_hours(page: _Page) -> Table | None:
    rows = []
    for rank, window in enumerate(page.findings.exposure.quarter_hours, 1):
        start_s = window.start_s or 0.0
        times = "–".join(page.clock.format(at_s) for at_s in (start_s, start_s + window.length_s))
        rows.append((f"{rank}  {times}", format_percent(window.percent_above_60, page.language), ""))
    entry = page.entry["quarter_hours"]
    return Table(entry["title"], tuple(entry["columns"]), tuple(rows)) if rows else None


# ------------------------------------------------------------------ how sure


def _build_sureness(page: _Page) -> Drawing:
    """Set the doubts about the time above 60 deg side by side; where none is known, say why."""
    findings, entry = page.findings, page.entry["sure"]
    above = next(t for t in findings.exposure.time_above if t.threshold_deg == MAIN_THRESHOLD_DEG)
    interval = above.interval
    doubts = [
        Doubt(
            entry["sensor" if findings.calibration else "sampling"],
            format_range(interval, page.language) or entry["unknown"],
            (interval.low, interval.high) if interval else None,
        ),
        *_find_pose_doubts(above.percent, interval, page),
    ]
    if _is_whole_day(findings):  # the range of a day about the person's own mean
        spread = 1.96 * BETWEEN_DAY_SD["time_above_60_percent"]
        low, high = max(above.percent - spread, 0.0), min(above.percent + spread, 100.0)
        told = format_range(Interval(low, high), page.language)
        doubts.append(Doubt(entry["days"], told, (low, high)))
    else:
        doubts.append(Doubt(entry["days"], entry["unknown"], None))
    if not any(doubt.span for doubt in doubts):
        pose = [f"{doubt.name.capitalize()}: {doubt.told}." for doubt in doubts if doubt.is_pose]
        return Drawing(entry["title"], "", "", " ".join((entry["none"][choose_ranges(findings)], *pose)))
    largest = max(doubt.span[1] for doubt in doubts if doubt.span)
    end = min(extend_scale(20.0, max(1.1 * above.percent, 1.05 * largest)), 100.0)
    told = join_clauses((f"{doubt.name}, {doubt.told}" for doubt in doubts), page.language)
    alternative = fill(
        entry["alternative"], {"value": format_percent(above.percent, page.language), "list": told}
    )
    shown = Sureness(
        (entry["title"], alternative), above.percent, end, _format_published((end,), page.language), doubts
    )
    return Drawing(entry["title"], alternative, draw_sureness(shown), entry["note"])


def _find_pose_doubts(value: float, interval: Interval | None, page: _Page) -> list[Doubt]:
    """Give the doubt of the pose that was held, as a range where the figure carries one."""
    calibration, entry = page.findings.calibration, page.entry["sure"]
    if calibration is None or calibration.pose is None or calibration.state in UNHELD:
        return []
    part = _find_pose_part(value, interval)
    if part:
        told = fill(entry["up_to"], {"high": format_percent(part[1], page.language)})
        return [Doubt(entry["pose"], told, (value, part[1]), is_pose=True)]
    told = entry["of_pose"].get(calibration.pose, "")
    is_one_sided = bool(format_pose_caution(page.findings, page.words))
    return [Doubt(entry["pose"], told, None, is_pose=is_one_sided)] if told else []


def _is_whole_day(findings: Findings) -> bool:
    return findings.exposure.analysed_s >= WHOLE_DAY_S


# ------------------------------------------------------------------ what next


def _list_next_steps(blocks: Sequence[Block], subject: ReportSubject, page: _Page) -> tuple[str, ...]:
    """Give what to do next, each by its rule in docs/profile.md; a rule that does not hold gives nothing."""
    findings, entry = page.findings, page.entry["next"]
    is_known = findings.calibration is None or not findings.calibration.needs_pose
    questions = findings.calibration.questions if findings.calibration else ()
    after_s = [  # a pose held after each slip that a person stated, if none was named
        start_s - SAID_S
        for flag in findings.quality.flags
        for start_s, end_s in (flag.spans_s if flag.code == Caveat.REMOUNT else ())
        if awaits_pose(start_s, end_s)
    ]
    steps = (
        _format_pose_step(page),
        *(fill(entry[each.kind], page.clock.format_span(each.start_s, each.end_s)) for each in questions),
        *(fill(entry["pose_after"], {"time": page.clock.format(at_s)}) for at_s in after_s),
        entry["poor"] if findings.quality.verdict == "poor" and _is_whole_day(findings) else "",
        "" if _is_whole_day(findings) else entry["short"],
        _format_look_at(blocks, page) if is_known else "",
        entry["lean"] if is_known and format_pose_caution(findings, page.words) else "",
        _format_days(page) if is_known else "",
        entry["other_arm"].get(subject.side or "unknown", ""),
    )
    return tuple(step for step in steps if step)[:MOST_STEPS]


def _format_pose_step(page: _Page) -> str:
    """Ask for what is missing of the pose; nothing if a person confirmed it or named the axis."""
    calibration, entry = page.findings.calibration, page.entry["next"]
    if calibration is None or calibration.state not in {"assumed", "none"}:
        return ""
    if calibration.state == "none" or calibration.still is None:
        return str(entry["no_pose"])
    if any(flag.code == Caveat.NOT_HELD for flag in page.findings.quality.flags):
        return str(entry["not_held"])
    time = page.clock.format(calibration.still.start_s, with_seconds=True)
    return str(entry["which_pose"]) if calibration.needs_pose else fill(entry["confirm_pose"], {"time": time})


def _format_look_at(blocks: Sequence[Block], page: _Page) -> str:
    """Point to the task in which the 15 minutes with the most time above 60 deg lie, and when they begin."""
    windows = page.findings.exposure.peak_windows
    start_s = next((w.start_s for w in windows if w.length_s == WORST_WINDOW_S and w.percent_above_60), None)
    if start_s is None:
        return ""
    end_s = start_s + WORST_WINDOW_S
    shared_s = {block: min(block.end_s, end_s) - max(block.start_s, start_s) for block in blocks}
    longest = max(shared_s, key=lambda block: shared_s[block], default=None)
    name = longest.label if longest and shared_s[longest] > 0 else ""
    key = "look_at_task" if name else "look_at"
    return fill(page.entry["next"][key], {"task": name, "time": page.clock.format(start_s)})


def _format_days(page: _Page) -> str:
    """Give the fewest days on each side that can tell a change of half the time above 60 deg."""
    if not _is_whole_day(page.findings):
        return ""
    exposure, sd = page.findings.exposure, BETWEEN_DAY_SD["time_above_60_percent"]
    percent = next(t.percent for t in exposure.time_above if t.threshold_deg == MAIN_THRESHOLD_DEG)
    enough = (k for k in DAYS if find_detectable_change(sd, k) <= WORTHWHILE_SHARE * percent)
    days = next(enough, DAYS[-1])
    facts = {
        "more": str(days - 1),
        "days": str(days),
        "points": format_number(find_detectable_change(sd, days), 1, page.language),
    }
    return fill(page.entry["next"]["one_day" if days == 1 else "days"], facts)
