"""The first page: the Arm Elevation Profile, always with the same layout (docs/profile.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil

from app.report.charts.day import WORST_WINDOW_S, Block, build_day
from app.report.charts.profile import TileScale, UncertaintyBar, UncertaintyChart, draw_tile, draw_uncertainty
from app.report.model import Drawing, Profile, Table, Tile
from app.report.single.chapters import Context, choose_ranges, format_pose_caution, format_quality
from app.report.words.numbers import (
    NONE,
    format_duration,
    format_number,
    format_percent,
    format_range,
    format_rate,
    percent_sign,
)
from app.report.words.wording import Language, Words, clean_text, cut_text, fill, join_clauses
from fusion.caveats import Caveat
from fusion.comparison.change import BETWEEN_DAY_SD, REFERENCES, WHOLE_DAY_S, find_detectable_change
from fusion.conventions import MAIN_THRESHOLD_DEG, SAID_S, UNHELD, awaits_pose
from fusion.exposure.types import Interval, PartExposure
from fusion.recording import MICROSECONDS

SHOWN_TASKS = 3
MOST_STEPS = 5
LONGEST_NAME = 32
TASK_KINDS = frozenset({"task", "seated", "supported"})
"""Kinds of period that name a task; work counts only with a name in the diary."""
DAYS = (1, 2, 3, 5)
WORTHWHILE_SHARE = 0.5
"""Share of the time above 60 deg: the change that the requested days can detect (docs/profile.md)."""
PUBLISHED = {30: "above_30", 60: "above_60", 90: "above_90_others"}
ENDS = {30: 100.0, 60: 40.0, 90: 20.0}
"""Ends of the scales in percent; extended for larger values."""
END_PER_H = 120.0


def build_profile(context: Context) -> Profile:
    """Build the first page."""
    entry, subject = context.words["profile"], context.subject
    named = [part for part in context.exposure.by_task if _is_task(part) and part.analysed_s > 0]
    tasks = sorted(named, key=lambda part: -_find_above_s(part))[:SHOWN_TASKS]
    blocks = _lay_out_blocks(tasks, context)
    versions = {"version": str(subject.version), "earlier": str(subject.version - 1)}
    amended = fill(context.words["heading"]["amended_short"], versions) if subject.version > 1 else ""
    return Profile(
        quality=format_quality(context),
        tiles=(*(_build_share(threshold, context) for threshold in (30, 60, 90)), _build_rises(context)),
        strip=build_day(context.findings, blocks, context.clock, context.words),
        tasks=_tabulate_tasks(tasks, context) if tasks else _tabulate_quarter_hours(context),
        sure=_build_uncertainty(context),
        next_title=entry["next"]["title"],
        next_steps=_list_next_steps(blocks if tasks else (), context),
        not_a_diagnosis=entry["not_a_diagnosis"],
        amendment=amended,
    )


def _is_whole_day(context: Context) -> bool:
    return context.exposure.analysed_s >= WHOLE_DAY_S


# Tiles.


def _build_share(threshold: int, context: Context) -> Tile:
    findings, language, entry = context.findings, context.language, context.words["profile"]
    above, reason = context.find_above(threshold), ""  # why no published value is shown
    if findings.time.analysed_us < WHOLE_DAY_S * MICROSECONDS:
        reason = "short"
    elif findings.quality.verdict == "poor":
        reason = "poor"
    reference = next(reference for reference in REFERENCES if reference.key == PUBLISHED[threshold])
    limits = () if reason else tuple(v for v in (reference.low, reference.high) if v is not None)
    pose = _find_pose_part(above.percent, above.interval)
    end = min(_extend(ENDS[threshold], above.percent, above.interval), 100.0)
    scale = TileScale(
        key=f"tile-{threshold}",
        words=(fill(entry["above"], {"threshold": str(threshold)}), ""),
        end=end,
        end_label=_format_published((end,), language),
        measured=above.percent,
        interval=(above.interval.low, above.interval.high) if above.interval else None,
        pose=pose,
        published=limits,
        published_label=_format_published(limits, language),
    )
    facts = {
        "value": format_percent(above.percent, language),
        "duration": format_duration(above.duration_s, language),
        "range": format_range(above.interval, language),
        "pose": format_percent(pose[1], language) if pose else "",
        "published": str(entry["published"][reason or f"above_{threshold}"]),
    }
    return _build_tile(scale, facts, context)


def _build_rises(context: Context) -> Tile:
    """Build the tile of the rises, without a published value because none was counted in the same way."""
    exposure, language, entry = context.exposure, context.language, context.words["profile"]
    entries = next(e for e in exposure.entries if e.threshold_deg == MAIN_THRESHOLD_DEG)
    interval = exposure.intervals.get(f"entries_above_{MAIN_THRESHOLD_DEG}_per_h")
    ends = (interval.low, interval.high) if interval else None
    per_hour = entries.per_hour
    pose = _find_pose_part(per_hour, interval) if per_hour is not None else None
    end = _extend(END_PER_H, per_hour or 0.0, interval)
    scale = TileScale(
        key="tile-rises",
        words=(entry["rises"], ""),
        end=end,
        end_label=format_number(end, 0, language),
        measured=per_hour or 0.0,
        interval=ends,
        pose=pose,
    )
    facts = {
        "value": format_rate(per_hour, language),
        "duration": fill(entry["count"], {"count": format_number(entries.count, 0, language)}),
        "range": "–".join(format_rate(end, language) for end in ends or ()),
        "pose": format_rate(pose[1], language) if pose else "",
        "published": entry["published"]["none"],
    }
    return _build_tile(scale, facts, context)


def _build_tile(scale: TileScale, facts: Mapping[str, str], context: Context) -> Tile:
    entry, name = context.words["profile"], scale.words[0]
    calibration = context.findings.calibration
    shown = {
        "needed": context.words["pose_state"]["needed"] if calibration and calibration.needs_pose else "",
        **facts,
        "range": fill(entry["range"][choose_ranges(context.findings)], facts) if facts["range"] else "",
        "pose": fill(entry["with_pose"], {"high": facts["pose"]}) if facts["pose"] else "",
    }
    parts = ", ".join(part for part in (*shown.values(), scale.published_label) if part)
    alternative = fill(entry["tile"], {"name": name, "parts": parts})
    drawn = draw_tile(replace(scale, words=(name, alternative))) if facts["value"] != NONE else ""
    return Tile(name=name, scale=drawn, alternative=alternative, **shown)


def _find_pose_part(value: float, interval: Interval | None) -> tuple[float, float] | None:
    """Return the addition by the one-sided error of the pose above the range; None if there is none."""
    if interval is None or interval.high_pose is None or interval.high_pose <= max(interval.high, value):
        return None
    return interval.high, interval.high_pose


def _extend(end: float, value: float, interval: Interval | None) -> float:
    ends = (interval.high, interval.high_pose or 0.0) if interval else ()
    return _extend_scale(end, max(1.1 * value, *ends, 0.0))


def _extend_scale(end: float, largest: float) -> float:
    """Return the end of a scale that must include ``largest``: the usual one, or the next ten."""
    return end if largest <= end else 10.0 * ceil(largest / 10.0)


def _format_published(values: Sequence[float], language: Language) -> str:
    """Format a published value, or a range of two, with its published digits."""
    shown = "–".join(format_number(v, 0 if v >= 10 else 1, language) for v in values)
    return shown + percent_sign(language) if shown else ""


# Tasks.


def _is_task(part: PartExposure) -> bool:
    return not part.reason and (part.kind in TASK_KINDS or (part.kind == "work" and bool(part.label)))


def _find_above_s(part: PartExposure) -> float:
    return part.percent_above.get(MAIN_THRESHOLD_DEG, 0.0) / 100 * part.analysed_s


def _name(part: PartExposure, words: Words) -> str:
    return cut_text(clean_text(part.label) or words["part"]["kind"].get(part.kind, part.kind), LONGEST_NAME)


def _lay_out_blocks(tasks: Sequence[PartExposure], context: Context) -> tuple[Block, ...]:
    """Return the periods below the timeline: the tasks, else the quarter hours with the most exposure."""
    if not tasks:
        return tuple(
            Block(window.start_s, window.start_s + window.length_s, "", rank)
            for rank, window in enumerate(context.exposure.quarter_hours, 1)
            if window.start_s is not None
        )
    ranks = {(task.kind, task.label): rank for rank, task in enumerate(tasks, 1)}
    return tuple(
        Block(part.start_s, part.end_s, _name(part, context.words), ranks.get((part.kind, part.label)))
        for part in context.exposure.by_period
        if _is_task(part)
    )


def _tabulate_tasks(tasks: Sequence[PartExposure], context: Context) -> Table:
    entry, language = context.words["profile"]["tasks"], context.language
    rows = tuple(
        (
            f"{rank}  {_name(task, context.words)}",
            format_duration(_find_above_s(task), language),
            format_percent(task.percent_above.get(MAIN_THRESHOLD_DEG), language),
        )
        for rank, task in enumerate(tasks, 1)
    )
    return Table(entry["title"], tuple(entry["columns"]), rows)


def _tabulate_quarter_hours(context: Context) -> Table | None:
    entry, rows = context.words["profile"]["quarter_hours"], []
    for rank, window in enumerate(context.exposure.quarter_hours, 1):
        start_s = window.start_s or 0.0
        times = "–".join(context.clock.format(at_s) for at_s in (start_s, start_s + window.length_s))
        rows.append((f"{rank}  {times}", format_percent(window.percent_above_60, context.language), ""))
    return Table(entry["title"], tuple(entry["columns"]), tuple(rows)) if rows else None


# Uncertainty.


def _build_uncertainty(context: Context) -> Drawing:
    """Draw the uncertainties of the time above 60 deg side by side; if none is known, state the reason."""
    findings, language, entry = context.findings, context.language, context.words["profile"]["sure"]
    above, days = context.find_above(MAIN_THRESHOLD_DEG), None
    interval, told_days = above.interval, entry["unknown"]
    if _is_whole_day(context):  # the range of a day around the person's mean
        spread = 1.96 * BETWEEN_DAY_SD["time_above_60_percent"]
        days = max(above.percent - spread, 0.0), min(above.percent + spread, 100.0)
        told_days = format_range(Interval(*days), language)
    doubts = [
        UncertaintyBar(
            entry["sensor" if findings.calibration else "sampling"],
            format_range(interval, language) or entry["unknown"],
            (interval.low, interval.high) if interval else None,
        ),
        *_find_pose_uncertainty(above.percent, interval, context),
        UncertaintyBar(entry["days"], told_days, days),
    ]
    spans = [doubt.span for doubt in doubts if doubt.span]
    if not spans:
        line = context.words["profile"]["tile"]
        named = [{"name": doubt.name.capitalize(), "parts": doubt.shown} for doubt in doubts if doubt.is_pose]
        pose = [fill(line, one) for one in named]
        return Drawing(entry["title"], "", "", " ".join((entry["none"][choose_ranges(findings)], *pose)))
    largest = max(high for _, high in spans)
    end = min(_extend_scale(20.0, max(1.1 * above.percent, 1.05 * largest)), 100.0)
    shown = join_clauses((f"{doubt.name}, {doubt.shown}" for doubt in doubts), language)
    facts = {"value": format_percent(above.percent, language), "list": shown}
    words = (entry["title"], fill(entry["alternative"], facts))
    drawn = draw_uncertainty(
        UncertaintyChart(words, above.percent, end, _format_published((end,), language), doubts)
    )
    return Drawing(*words, drawn, entry["note"])


def _find_pose_uncertainty(value: float, interval: Interval | None, context: Context) -> list[UncertaintyBar]:
    """Return the uncertainty of the held pose, as a range if the figure has one."""
    calibration, entry = context.findings.calibration, context.words["profile"]["sure"]
    if calibration is None or calibration.pose is None or calibration.state in UNHELD:
        return []
    part = _find_pose_part(value, interval)
    if part:
        shown = fill(entry["up_to"], {"high": format_percent(part[1], context.language)})
        return [UncertaintyBar(entry["pose"], shown, (value, part[1]), is_pose=True)]
    shown = entry["of_pose"].get(calibration.pose, "")
    is_one_sided = bool(format_pose_caution(context.findings, context.words))
    return [UncertaintyBar(entry["pose"], shown, None, is_pose=is_one_sided)] if shown else []


# Next steps.


def _list_next_steps(blocks: Sequence[Block], context: Context) -> tuple[str, ...]:
    """Return the next steps whose rules in docs/profile.md apply."""
    findings, clock, entry = context.findings, context.clock, context.words["profile"]["next"]
    is_known = findings.calibration is None or not findings.calibration.needs_pose
    questions = findings.calibration.questions if findings.calibration else ()
    after_s = [  # a pose after each slip that a person stated, if none was given
        start_s - SAID_S
        for flag in findings.quality.flags
        for start_s, end_s in (flag.spans_s if flag.code == Caveat.REMOUNT else ())
        if awaits_pose(start_s, end_s)
    ]
    is_whole = _is_whole_day(context)
    steps = (
        _format_pose_step(context, entry),
        *(fill(entry[each.kind], clock.format_span(each.start_s, each.end_s)) for each in questions),
        *(fill(entry["pose_after"], {"time": clock.format(at_s)}) for at_s in after_s),
        entry["poor"] if findings.quality.verdict == "poor" and is_whole else "",
        "" if is_whole else entry["short"],
        _format_look_at(blocks, context, entry) if is_known else "",
        entry["lean"] if is_known and format_pose_caution(findings, context.words) else "",
        _format_days(context, entry) if is_known and is_whole else "",
        entry["other_arm"].get(context.subject.side or "unknown", ""),
    )
    return tuple(step for step in steps if step)[:MOST_STEPS]


def _format_pose_step(context: Context, entry: Words) -> str:
    """Return the request for missing information on the pose; empty if it was confirmed or an axis given."""
    calibration = context.findings.calibration
    if calibration is None or calibration.state not in {"assumed", "none"}:
        return ""
    if calibration.state == "none" or calibration.still is None:
        return str(entry["no_pose"])
    if any(flag.code == Caveat.NOT_HELD for flag in context.findings.quality.flags):
        return str(entry["not_held"])
    time = context.clock.format(calibration.still.start_s, with_seconds=True)
    return str(entry["which_pose"]) if calibration.needs_pose else fill(entry["confirm_pose"], {"time": time})


def _format_look_at(blocks: Sequence[Block], context: Context, entry: Words) -> str:
    """Return a pointer to the task and time of the 15 minutes with the most time above 60 deg."""
    windows = context.exposure.peak_windows
    start_s = next((w.start_s for w in windows if w.length_s == WORST_WINDOW_S and w.percent_above_60), None)
    if start_s is None:
        return ""
    end_s = start_s + WORST_WINDOW_S
    shared_s = {block: min(block.end_s, end_s) - max(block.start_s, start_s) for block in blocks}
    longest = max(shared_s, key=lambda block: shared_s[block], default=None)
    name = longest.label if longest and shared_s[longest] > 0 else ""
    facts = {"task": name, "time": context.clock.format(start_s)}
    return fill(entry["look_at_task" if name else "look_at"], facts)


def _format_days(context: Context, entry: Words) -> str:
    """Return the fewest days on each side that can detect a change of half the time above 60 deg."""
    sd, percent = BETWEEN_DAY_SD["time_above_60_percent"], context.find_above(MAIN_THRESHOLD_DEG).percent
    enough = (k for k in DAYS if find_detectable_change(sd, k) <= WORTHWHILE_SHARE * percent)
    days = next(enough, DAYS[-1])
    points = format_number(find_detectable_change(sd, days), 1, context.language)
    facts = {"more": str(days - 1), "days": str(days), "points": points}
    return fill(entry["one_day" if days == 1 else "days"], facts)
