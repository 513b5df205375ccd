"""The first page: the Arm Elevation Profile, always with the same layout (docs/profile.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil

from acromion.app.report.charts.day import WORST_WINDOW_S, Block, build_day
from acromion.app.report.charts.profile import (
    TileScale,
    UncertaintyBar,
    UncertaintyChart,
    draw_tile,
    draw_uncertainty,
)
from acromion.app.report.figures import RECOVERY, format_figure
from acromion.app.report.model import Drawing, Pair, Profile, Table, Tile
from acromion.app.report.single.chapters import (
    Context,
    choose_ranges,
    format_pose_caution,
    format_quality,
    is_task,
    rank_tasks,
)
from acromion.app.report.words.numbers import (
    NONE,
    format_duration,
    format_duration_range,
    format_number,
    format_percent,
    format_range,
    percent_sign,
)
from acromion.app.report.words.wording import Language, Words, clean_text, cut_text, fill, join_clauses
from acromion.fusion.caveats import Caveat
from acromion.fusion.comparison.change import (
    BETWEEN_DAY_SD,
    REFERENCES,
    find_left_out_reason,
    find_planned_change,
)
from acromion.fusion.comparison.levels import ComparedLevel, combine_days, compare_with_level
from acromion.fusion.conventions import MAIN_THRESHOLD_DEG, SAID_S, UNHELD, awaits_pose
from acromion.fusion.exposure.types import Interval, PartExposure

SHOWN_TASKS = 3
MOST_STEPS = 3
LONGEST_NAME = 28
DAYS = (1, 2, 3, 5)
WORTHWHILE_SHARE = 0.5
"""Share of the time above 60 deg: the planned change that the days can detect (docs/profile.md)."""
ENDS = {30: 100.0, 60: 40.0, 90: 20.0}
"""Ends of the scales in percent; extended for larger values."""
END_DPS = 120.0
REST = ("recovery_neutral_slow_percent", "recovery_longest_without_s")
BUSY = "entries_above_60_busy_minutes_percent"
UNMEASURED = ("trunk", "supported", "force", "seated")
"""Not shown by the angle; a diary may state when the arm was supported, or the person seated."""


def build_profile(context: Context) -> Profile:
    """Build the first page."""
    entry, subject = context.words["profile"], context.subject
    tasks = rank_tasks(context.exposure.by_task)[:SHOWN_TASKS]
    blocks = _lay_out_blocks(tasks, context)
    versions = {"version": str(subject.version), "earlier": str(subject.version - 1)}
    amended = fill(context.words["heading"]["amended_short"], versions) if subject.version > 1 else ""
    stated = {part.kind for part in (*context.exposure.by_period, *context.exposure.by_posture)}
    missing = ", ".join(entry["unmeasured"][key] for key in UNMEASURED if key not in stated)
    levels = context.findings.compare_with_levels()
    return Profile(
        quality=format_quality(context),
        not_measured=fill(entry["not_measured"], {"list": missing}),
        tiles=(*(_build_share(threshold, context) for threshold in (30, 60, 90)), _build_velocity(context)),
        strip=build_day(context.findings, blocks, context.clock, context.words),
        tasks=_tabulate_tasks(tasks, context) if tasks else _tabulate_quarter_hours(context),
        rest_title=entry["rest"]["title"],
        rest=_list_rest(context),
        sure=_build_uncertainty(context),
        next_title=entry["next"]["title"],
        next_steps=_list_next_steps(blocks if tasks else (), context),
        not_a_diagnosis=entry["not_a_diagnosis"],
        proposals=entry["proposals"] if any(level.standing for level in levels) else "",
        amendment=amended,
    )


# Tiles.


def _build_share(threshold: int, context: Context) -> Tile:
    above, language = context.find_above(threshold), context.language
    entry = context.words["profile"]
    level = _find_level(f"above_{threshold}", context)
    if level is not None:
        limits, told = _list_limits(level), _format_standing(level, context)
    else:
        reference = next(one for one in REFERENCES if one.key == f"above_{threshold}_others")
        left_out = find_left_out_reason(
            context.findings.quality.verdict, is_short=context.findings.extent == "short"
        )
        limits = () if left_out else tuple(v for v in (reference.low, reference.high) if v is not None)
        told = str(entry["standing"][left_out or "others"])
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
        "standing": told,
    }
    return _build_tile(scale, facts, context)


def _build_velocity(context: Context) -> Tile:
    """Build the tile of the median velocity, which is computed as in the study with the proposal."""
    entry, language = context.words["profile"], context.language
    level = _find_level("velocity", context)
    assert level is not None
    limits = _list_limits(level)
    measured, interval = level.measured or 0.0, level.interval
    end = _extend(END_DPS, measured, interval)
    scale = TileScale(
        key="tile-velocity",
        words=(entry["velocity"], ""),
        end=end,
        end_label=_format_speed(end, language),
        measured=measured,
        interval=(interval.low, interval.high) if interval else None,
        published=limits,
        published_label=_format_speed(limits[0], language) if limits else "",
    )
    facts = {
        "value": NONE if level.measured is None else _format_speed(level.measured, language),
        "duration": entry["accelerometer"] if level.measured is not None else "",
        "range": f"{format_number(interval.low, 0, language)}–{_format_speed(interval.high, language)}"
        if interval
        else "",
        "pose": "",
        "standing": _format_standing(level, context),
    }
    return _build_tile(scale, facts, context)


def _find_level(key: str, context: Context) -> ComparedLevel | None:
    return next((one for one in context.findings.compare_with_levels() if one.reference.key == key), None)


def _list_limits(level: ComparedLevel) -> tuple[float, ...]:
    """Return the proposal, if the figure is compared with it."""
    return () if level.reason else (level.reference.high,)


def _format_speed(speed_dps: float, language: Language) -> str:
    return f"{format_number(speed_dps, 0, language)}°/s"


def _format_standing(level: ComparedLevel, context: Context) -> str:
    """Return whether the figure is below or above its level, or why it is not compared."""
    entry, value = context.words["profile"]["standing"], level.reference.high
    shown = _format_speed(value, context.language)
    if level.reference.unit == "percent":
        shown = _format_published((value,), context.language)
    key = (level.standing or level.reason).replace(" ", "_")
    return fill(entry[key], {"level": shown})


def _build_tile(scale: TileScale, facts: Mapping[str, str], context: Context) -> Tile:
    entry, name = context.words["profile"], scale.words[0]
    calibration = context.findings.calibration  # the velocity does not depend on the pose
    needs_pose = calibration is not None and calibration.needs_pose and scale.key != "tile-velocity"
    shown = {
        "needed": context.words["pose_state"]["needed"] if needs_pose else "",
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
    """Return the end of a scale that must include a figure: the usual one, or the next ten."""
    ends = (interval.high, interval.high_pose or 0.0) if interval else ()
    largest = max(1.1 * value, *ends, 0.0)
    return end if largest <= end else 10.0 * ceil(largest / 10.0)


def _format_published(values: Sequence[float], language: Language) -> str:
    """Format a published value, or a range of two, with its published digits."""
    shown = "–".join(format_number(v, 0 if v >= 10 else 1, language) for v in values)
    return shown + percent_sign(language) if shown else ""


def _list_rest(context: Context) -> tuple[Pair, ...]:
    """List time arm down and still, the longest time without it, and minutes with two or more rises."""
    exposure, entry, language = context.exposure, context.words["profile"]["rest"], context.language
    values = RECOVERY.name_values(exposure.recovery) if exposure.recovery else {}
    busy = next(e for e in exposure.entries if e.threshold_deg == MAIN_THRESHOLD_DEG).busy_minutes_percent
    pairs = []
    for name, value in (*((name, values.get(name)) for name in REST), (BUSY, busy)):
        if value is not None:
            interval = exposure.intervals.get(name)
            ends = format_range if name.endswith("_percent") else format_duration_range
            shown = f" ({ends(interval, language)})" if interval else ""
            pairs.append(Pair(entry[name], format_figure(value, name, language) + shown))
    return tuple(pairs)


# Tasks.


def _find_above_s(part: PartExposure) -> float:
    return part.time_above_percent.get(MAIN_THRESHOLD_DEG, 0.0) / 100 * part.analysed_s


def _name(part: PartExposure, words: Words) -> str:
    return cut_text(clean_text(part.label) or words["part"]["kind"].get(part.kind, part.kind), LONGEST_NAME)


def _lay_out_blocks(tasks: Sequence[tuple[PartExposure, int | None]], context: Context) -> tuple[Block, ...]:
    """Return the periods below the timeline: the tasks, else the quarter hours with the most exposure."""
    if not tasks:
        return tuple(
            Block(window.start_s, window.start_s + window.length_s, "", rank)
            for rank, window in enumerate(context.exposure.quarter_hours, 1)
            if window.start_s is not None
        )
    ranks = {(task.kind, task.label): rank or 0 for task, rank in tasks}
    return tuple(
        Block(part.start_s, part.end_s, _name(part, context.words), ranks.get((part.kind, part.label)))
        for part in context.exposure.by_period
        if is_task(part)
    )


def _tabulate_tasks(tasks: Sequence[tuple[PartExposure, int | None]], context: Context) -> Table:
    entry, language = context.words["profile"]["tasks"], context.language
    rows = tuple(
        (
            f"{rank}  {_name(task, context.words)}" if rank else _name(task, context.words),
            format_duration(_find_above_s(task), language),
            format_percent(task.time_above_percent.get(MAIN_THRESHOLD_DEG), language),
        )
        for task, rank in tasks
    )
    return Table(entry["title"], tuple(entry["columns"]), rows)


def _tabulate_quarter_hours(context: Context) -> Table | None:
    entry, rows = context.words["profile"]["quarter_hours"], []
    for rank, window in enumerate(context.exposure.quarter_hours, 1):
        start_s = window.start_s or 0.0
        times = context.clock.format_range(start_s, start_s + window.length_s)
        rows.append((f"{rank}  {times}", format_percent(window.percent_above_60, context.language), ""))
    return Table(entry["title"], tuple(entry["columns"]), tuple(rows)) if rows else None


# Uncertainty.


def _build_uncertainty(context: Context) -> Drawing:
    """Draw the combined range of the time above 60 deg over its parts; if none is known, state the reason."""
    findings, language, entry = context.findings, context.language, context.words["profile"]["sure"]
    above = findings.find_above_60()
    interval, days = above.interval, combine_days(above.percent, above.interval)
    is_short = findings.extent == "short"
    is_poor = findings.quality.verdict == "poor"  # then no range is one to rely on
    combined = None if is_short or is_poor else days.combined
    between = None if is_short else days.between

    def build_bar(name: str, spread: Interval | None, *, is_combined: bool = False) -> UncertaintyBar:
        span = (spread.low, spread.high) if spread else None
        shown = format_range(spread, language) or entry["unknown"]
        return UncertaintyBar(entry[name], shown, span, is_combined=is_combined)

    doubts = [
        *([build_bar("combined", combined, is_combined=True)] if combined else []),
        build_bar("angle" if findings.calibration else "sampling", interval),
        *_find_pose_uncertainty(above.percent, interval, context),
        build_bar("days", between),
    ]
    spans = [doubt.span for doubt in doubts if doubt.span]
    if not spans:
        line = context.words["profile"]["tile"]
        named = [{"name": doubt.name.capitalize(), "parts": doubt.shown} for doubt in doubts if doubt.is_pose]
        pose = [fill(line, one) for one in named]
        return Drawing(entry["title"], "", "", " ".join((entry["none"][choose_ranges(findings)], *pose)))
    end = min(_extend(ENDS[60], max(above.percent, *(high / 1.1 for _, high in spans)), interval), 100.0)
    shown = join_clauses((f"{doubt.name}, {doubt.shown}" for doubt in doubts), language)
    facts = {"value": format_percent(above.percent, language), "list": shown}
    words = (entry["title"], fill(entry["alternative"], facts))
    level = _find_level("above_60", context)
    assert level is not None
    limits = _list_limits(level)
    chart = UncertaintyChart(
        words,
        above.percent,
        end,
        _format_published((end,), language),
        doubts,
        limits[0] if limits else None,
        _format_published(limits, language),
    )
    wider = compare_with_level(above.percent, combined, level.reference.high)
    is_wider = level.standing in {"below", "above"} and wider == "cannot tell"
    told = fill(entry["note"], {"days": entry["hairdressers"] if between else ""})
    note = " ".join(filter(None, (told, entry["this_day"] if is_wider else "")))
    return Drawing(*words, draw_uncertainty(chart), note)


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
    is_short, is_poor = findings.extent == "short", findings.quality.verdict == "poor"
    is_upside = any(flag.code == Caveat.UPSIDE for flag in findings.quality.flags)
    steps = (
        _format_pose_step(context, entry),
        *(fill(entry[each.kind], clock.format_span(each.start_s, each.end_s)) for each in questions),
        *(fill(entry["pose_after"], {"time": clock.format(at_s)}) for at_s in after_s),
        "" if context.subject.side else entry["side"],
        entry["short"] if is_short else "",
        entry["upside" if is_upside else "poor"] if is_poor and not is_short else "",
        _format_look_at(blocks, context, entry) if is_known and not is_poor else "",
        entry["lean"] if is_known and format_pose_caution(findings, context.words) else "",
        _format_days(context, entry) if is_known and not is_short and not is_poor else "",
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
    """Return the fewest days before and after a planned change that detect half the time above 60 deg."""
    sd, percent = BETWEEN_DAY_SD["time_above_60_percent"], context.find_above(MAIN_THRESHOLD_DEG).percent
    enough = (k for k in DAYS if find_planned_change(sd, k) <= WORTHWHILE_SHARE * percent)
    days = next(enough, DAYS[-1])
    points = format_number(find_planned_change(sd, days), 1, context.language)
    return fill(entry["days"], {"days": str(days), "points": points})
