"""The chapters after the first page: hours, all figures, quality, time, method, provenance."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate
from types import MappingProxyType

from acromion.app.report.bibliography import format_bibliography
from acromion.app.report.charts.bars import build_parts, is_drawable
from acromion.app.report.charts.day import format_reason
from acromion.app.report.charts.distribution import build_spread
from acromion.app.report.export.results import SCHEMA
from acromion.app.report.figures import (
    CYCLES,
    ENTRIES,
    EPISODES,
    LESS_REST,
    PERCENTILES,
    REST_TABLE,
    SINGLE_GROUPS,
    VELOCITIES,
    VELOCITY,
    WINDOWS,
    find_unit,
    names_task,
)
from acromion.app.report.findings import CalibrationFacts, Findings, ReportSubject, StillFacts
from acromion.app.report.model import Chart, Pair, Section, Table, VerdictLine
from acromion.app.report.words.messages import describe_flag, format_columns
from acromion.app.report.words.numbers import (
    MINUTE_S,
    NARROW,
    NONE,
    Clock,
    format_angle,
    format_duration,
    format_duration_range,
    format_interval,
    format_long_duration,
    format_moment,
    format_number,
    format_percent,
    format_rate,
    format_signed,
    percent_sign,
    round_classes,
)
from acromion.app.report.words.wording import (
    Language,
    Words,
    clean_text,
    cut_text,
    fill,
    find_device_name,
    join_clauses,
)
from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import format_clock_offset
from acromion.fusion.comparison.change import STATEMENTS, Reference, compare_with_references
from acromion.fusion.conventions import CONVENTIONS, MAIN_THRESHOLD_DEG, UNHELD
from acromion.fusion.diary import POSTURES
from acromion.fusion.exposure.types import (
    LEAST_RANGED_S,
    ElevationBin,
    Exposure,
    Interval,
    PartExposure,
    TimeAbove,
)
from acromion.fusion.recording import MICROSECONDS, QualityFlag

LEAST_SHARE = 0.01
"""Minimum share of the recording (and one minute) for time without analysis outside the table."""
NOTED_WALKING_DEG = 30.0
"""A larger angle between walking and the axis is noted; walking decides nothing."""
PLACED = frozenset({Caveat.POSE_ASSUMED, Caveat.WHICH_POSE, Caveat.SLIP, Caveat.LEAN})
"""Caveats whose seconds locate the problem, not its duration."""
MOST_TIMES = 6
MOST_REASONS = 2
"""Maximum reasons on the first page; the table of data quality has all."""
SHORTEST_HOUR_S = 1.0
SHORTEST_RATED_S = 600.0
"""In less than ten minutes a rate per hour would only multiply a small count."""
MOST_FINDINGS = 6
"""Maximum findings on page 4; the appendix and the HTML report have all, with their details."""
MOST_PARTS = 14
"""Maximum hours, periods or tasks in a table of the report; the CSV has all."""
MOST_MARKS = 6
"""Maximum marks on page 2."""
MOST_LINES = 22
"""Maximum lines of hours, marks and tasks (two each) on page 2; else the appendix has the hours."""
POSTURE_NOTE_LINES = 4
MOST_BARS = 24
"""Maximum bars of hours on page 2; else the appendix has their chart."""
MAIN_FIGURE = f"time_above_{MAIN_THRESHOLD_DEG}_percent"
LONGEST_NAME = 60
"""Maximum length of a period's name in its table; results.json and periods.csv have the whole label."""


@dataclass(frozen=True, slots=True)
class Context:
    """The findings, the subject, the clock of the recording, and the words of the report."""

    findings: Findings
    subject: ReportSubject
    clock: Clock
    words: Words

    @property
    def language(self) -> Language:
        """The language of the report."""
        return self.clock.language

    @property
    def exposure(self) -> Exposure:
        """The exposure figures."""
        return self.findings.exposure

    def find_above(self, threshold_deg: float) -> TimeAbove:
        """Return the time above a threshold."""
        return next(t for t in self.exposure.time_above if t.threshold_deg == threshold_deg)


# Limits of the figures.


def build_verdict(context: Context) -> VerdictLine:
    """Return the verdict, the most serious reason in full, the others by name, and the time without analysis.

    Even a good recording states the effect of the pose on its figures.
    """
    findings, words, language = context.findings, context.words, context.language
    verdict = findings.quality.verdict
    entry = words["verdict"][verdict]
    counted = _list_counted(findings)
    is_posed = verdict == "good" and _has_pose_error(context)
    shown = [entry["posed" if is_posed else "reason"]]
    if counted:
        others = join_clauses((_format_flag(flag, language) for flag in counted[1:]), language)
        also = fill(words["heading"]["also"], {"others": others}) if others else ""
        shown = [_describe_flag(counted[0], language), also]
    shown.append(_format_not_analysed(context))
    return VerdictLine(verdict, entry["label"], " ".join(filter(None, shown)))


def format_quality(context: Context) -> str:
    """Return the names of the limits of the data, the most serious first."""
    findings, words, language = context.findings, context.words, context.language
    counted = [_format_flag(flag, language) for flag in _list_counted(findings)]
    if not counted:
        return str(words["profile"]["no_fault"])
    more = len(counted) - MOST_REASONS
    shown = join_clauses(counted[:MOST_REASONS], language)
    facts = {"reasons": shown[0].upper() + shown[1:], "more": str(more) if more > 0 else ""}
    return fill(words["profile"]["reasons"], facts)


def _list_counted(findings: Findings) -> list[QualityFlag]:
    """Return the caveats that count, the most serious first."""
    flags = {flag.code: flag for flag in reversed(findings.quality.flags)}
    return [flags[code] for code in findings.quality.reasons if code in flags]


def _describe_flag(flag: QualityFlag, language: Language) -> str:
    caveat = describe_flag(flag, language)
    return f"{caveat.title}. {caveat.detail}" if caveat.detail else caveat.title


def _format_flag(flag: QualityFlag, language: Language) -> str:
    title = describe_flag(flag, language).title
    title = title[0].lower() + title[1:]
    lasted = "" if flag.code in PLACED else _format_seconds(flag, language)
    return f"{title} ({lasted})" if lasted and lasted not in title else title


def _format_seconds(flag: QualityFlag, language: Language) -> str:
    """Return how long a finding lasted; empty if it would be printed as 0 s."""
    return format_duration(flag.seconds, language) if round(flag.seconds, 1) > 0 else ""


def _format_not_analysed(context: Context) -> str:
    """Describe the time that no figure includes, the largest part first."""
    time, words = context.findings.time, context.words
    if time.missing_us + time.excluded_us < max(LEAST_SHARE * time.recorded_us, MINUTE_S * MICROSECONDS):
        return ""
    parts = [(format_reason(reason, words), us) for reason, us in _sum_exclusions(context.findings).items()]
    if time.missing_us >= MICROSECONDS:
        missing = words["time"]["missing"]
        parts.append((missing[0].lower() + missing[1:], time.missing_us))
    parts.sort(key=lambda part: -part[1])
    shown = ", ".join(f"{name} {format_duration(us / MICROSECONDS, context.language)}" for name, us in parts)
    return fill(words["heading"]["not_analysed"], {"parts": shown})


def _sum_exclusions(findings: Findings) -> Counter[str]:
    """Return the total of the excluded stretches by reason, in microseconds."""
    totals_us: Counter[str] = Counter()
    for span in findings.exclusions:
        totals_us[span.reason] += span.duration_us
    return totals_us


def choose_ranges(findings: Findings) -> str:
    """Return the key for the meaning of the ranges.

    ``known``; ``ready`` (sampling alone, as the error of the angle is unknown); without ranges ``short``
    (little of a day) or ``none``.
    """
    exposure = findings.exposure
    if not exposure.intervals and exposure.analysed_s < LEAST_RANGED_S:
        return "short"
    if findings.method is not None and findings.calibration is not None:
        return "known"
    return "ready" if exposure.intervals else "none"


def format_accuracy(findings: Findings, words: Words) -> str:
    """Describe the known accuracy of the method."""
    return str(words["accuracy"][findings.method.name if findings.method else "ready"])


# The pose.


def format_pose_caution(findings: Findings, words: Words) -> str:
    """Return the known one-sided error of the held pose; empty if there is none."""
    calibration = findings.calibration
    if calibration is None or calibration.pose is None or calibration.state in UNHELD:
        return ""
    return str(words["pose_caution"].get(calibration.pose, ""))


def _has_pose_error(context: Context) -> bool:
    """Return whether the held pose has a known one-sided error, which is one of arms."""
    return context.subject.side != "trunk" and bool(format_pose_caution(context.findings, context.words))


def format_pose_state(context: Context) -> str:
    """Return the evidence for the pose in a line; empty for a file with angles."""
    calibration, entry, clock = context.findings.calibration, context.words["pose_state"], context.clock
    if calibration is None:
        return ""
    stills = [still for still in (calibration.still, calibration.second, *calibration.repeats) if still]
    times = (
        {
            "time": clock.format(still.start_s, with_seconds=True),
            "length": format_duration(still.duration_s, clock.language),
        }
        for still in stills
    )
    facts = {
        "times": join_clauses((fill(entry["still"], time) for time in times), clock.language),
        "n": str(len(stills)),
        "apart": format_angle(math.ceil(calibration.repeat_deg or 0.0), clock.language),
        "axis": _format_axis(calibration),
    }
    error = entry["error"] if _has_pose_error(context) else ""
    return fill(entry["line"], {"error": error, "told": fill(entry[calibration.state], facts)})


def format_needs_pose(context: Context) -> str:
    """Return the question which stillness was the pose, if they disagree; else empty."""
    calibration, entry = context.findings.calibration, context.words["calibration"]
    if calibration is None or not calibration.needs_pose:
        return ""
    every = [context.clock.format(still.start_s, with_seconds=True) for still in calibration.proposals]
    further = len(every) - MOST_TIMES
    more = [fill(entry["more"], {"n": str(further)})] if further > 0 else []
    shown = [*every[:MOST_TIMES], *more]
    facts = {
        "times": f" {entry['or']} ".join(filter(None, (", ".join(shown[:-1]), shown[-1]))),
        "apart": format_angle(calibration.spread_deg, context.language),
    }
    return fill(context.words["pose_state"]["needs"], facts)


def format_walking_note(context: Context) -> str:
    """Return the angle between walking and the axis, if it is large; else empty."""
    calibration = context.findings.calibration
    if calibration is None or calibration.state == "none":
        return ""
    if calibration.walking_apart_deg is None or calibration.walking_apart_deg <= NOTED_WALKING_DEG:
        return ""
    key = "walking_note_axis" if calibration.state == "axis" else "walking_note"
    return fill(context.words["calibration"][key], {"deg": f"{calibration.walking_apart_deg:.0f}"})


def format_found(findings: Findings, words: Words) -> str:
    """Return how the arm's axis was found; empty for a file with angles."""
    calibration = findings.calibration
    if calibration is None:
        return ""
    return fill(words["calibration"]["found_as"][calibration.state], {"axis": _format_axis(calibration)})


def _format_axis(calibration: CalibrationFacts) -> str:
    return (calibration.axis or "").replace("-", "\u2212")


# The chapters.


def build_sections(context: Context) -> tuple[Section, ...]:
    """Build the chapters in reading order, without empty ones: three pages, then the appendix."""
    words, exposure = context.words, context.exposure
    title, brackets = words["section"], _explain_brackets(context)
    day, charts_of_hours, tables_of_hours = _build_day(context, brackets)
    rises = (_tabulate_entries(context), _tabulate_velocities(context))
    spread = (_tabulate_time_above(context), _tabulate_percentiles(context), _tabulate_rest(context))
    pages = (
        day,
        Section(
            "spread",
            title["measures"],
            brackets,
            build_spread(exposure, words, context.language),
            tables=(*spread, *rises),
        ),
        Section(
            "standards",
            title["standards"],
            brackets,
            tables=(_tabulate_bins(context), _tabulate_conventions(context)),
        ),
    )
    every = [words["ranges"]["every"][choose_ranges(context.findings)]]
    if _has_pose_ranges(context):  # meaning of the ranges with the error of the pose
        every.append(f"{words['ranges']['pose']} {words['pose_caution']['ranges']}")
    more = (
        *tables_of_hours,
        _tabulate_long_stays(context),
        _tabulate_cycles(context),
        _tabulate_variation(context),
        *_tabulate_periods(context),
    )
    appendix = (
        Section("figures", title["figures"], tuple(every), charts_of_hours, tables=more),
        _build_published(context),
        _build_quality(context),
        _build_method(context),
        _build_provenance(context),
        Section("bibliography", words["bibliography"]["title"], sources=format_bibliography()),
    )
    sections = (
        *(replace(one, starts_page=True) for one in pages),
        _build_quality_in_short(context),
        _build_method_in_short(context),
        *(replace(one, in_appendix=True) for one in appendix),
    )
    shown = (replace(one, tables=tuple(table for table in one.tables if table.rows)) for one in sections)
    return tuple(one for one in shown if one.pairs or one.tables or one.figures or one.sources)


def build_trunk_sections(context: Context) -> tuple[Section, ...]:
    """Build the chapters on a recording of the trunk: data quality, time, method and file."""
    quality = context.findings.quality
    flags = tuple(flag for flag in quality.flags if flag.code != Caveat.NPOSE)  # an error of arms
    context = replace(context, findings=replace(context.findings, quality=replace(quality, flags=flags)))
    words, method = context.words, _build_method_in_short(context)
    pairs = tuple(pair for pair in method.pairs if pair.name != words["calibration"]["found"])
    method = replace(method, paragraphs=(words["trunk"]["method"],), pairs=pairs)
    appendix = (_build_quality(context), _build_provenance(context))
    return _build_quality_in_short(context), method, *(replace(one, in_appendix=True) for one in appendix)


def _explain_brackets(context: Context) -> tuple[str, ...]:
    """Explain the ranges in brackets, if any figure has one."""
    said = context.words["ranges"]
    if not any(above.interval for above in context.exposure.time_above):
        return ()
    return (said["brackets_pose" if _has_pose_ranges(context) else "brackets"],)


def _has_pose_ranges(context: Context) -> bool:
    return any(above.interval and above.interval.with_pose for above in context.exposure.time_above)


# Published values.


def _build_published(context: Context) -> Section:
    """Build the table of all references, and the findings of group studies in words.

    The note states why no reference has a measured value beside it, or why the speed has none.
    """
    words, language = context.words, context.language
    entry, comparison = words["published"], words["comparison"]
    compared, rows = compare_with_references(context.exposure, context.findings.quality.verdict), []
    for item in compared:
        said, reference = words["reference"][item.reference.key], item.reference
        measured = NONE if item.reason else _format_value(item.measured or 0.0, reference, language, 1)
        decimals = 0 if reference.high >= 10 else 1
        published = _format_value(reference.high, reference, language, decimals)
        if reference.low is None:
            published = f"≤\u00a0{published}"
        else:
            published = f"{format_number(reference.low, decimals, language)}–{published}"
        rows.append((said["name"], said["source"], published, measured))
    reasons, note = {item.reason for item in compared} - {"not computed"}, ""
    if reasons and "" not in reasons:
        note = fill(comparison["does_not_apply"], {"reason": comparison["reason"][min(reasons)]})
    elif any(item.reason == "not computed" and item.reference.key == "velocity" for item in compared):
        why = fill(comparison["does_not_apply"], {"reason": comparison["reason"]["not_computed_velocity"]})
        note = f"{words['reference']['velocity']['name']} – {why}"
    table = Table.build(entry, rows, prose=True, note=note)
    paragraphs = (*(entry["statement"][key] for key in STATEMENTS), entry["groups"], entry["breaks"])
    return Section("published", entry["title"], (" ".join(paragraphs),), tables=(table,))


def _format_value(value: float, reference: Reference, language: Language, decimals: int) -> str:
    sign = {"percent": percent_sign(language), "deg": "°", "dps": "°/s", "h": f"{NARROW}h"}[reference.unit]
    return f"{format_number(value, 0 if reference.unit == 'deg' else decimals, language)}{sign}"


# By hour and by period.


def _build_day(
    context: Context, brackets: tuple[str, ...]
) -> tuple[Section, tuple[Chart, ...], tuple[Table, ...]]:
    """Build the page of the hours and tasks, and the charts and tables of hours that it has no room for."""
    exposure, words = context.exposure, context.words
    hours = [  # without the last sample of a recording that ends on the hour: "11:00–11:00, 0 s"
        (context.clock.format_range(part.start_s, part.end_s, is_hour=True), part)
        for part in exposure.by_hour
        if part.end_s - part.start_s >= SHORTEST_HOUR_S
    ]
    is_drawn = any(is_drawable(part) for _, part in hours)
    charts = (build_parts("hours", hours, words, context.language),) if is_drawn else ()
    by_hour = (_tabulate_parts(hours, words["part"]["by_hour"], context),)
    lines = min(len(hours), MOST_PARTS) + 2 * min(len(exposure.by_task), MOST_PARTS)
    lines += min(len(exposure.by_mark), MOST_MARKS + 1)
    lines += 2 * len(exposure.by_posture) + (POSTURE_NOTE_LINES if exposure.by_posture else 0)
    later_charts = charts if len(hours) > MOST_BARS else ()
    later_tables = by_hour if lines > MOST_LINES else ()
    tables = (
        *(() if later_tables else by_hour),
        _tabulate_tasks(context),
        _tabulate_postures(context),
        _tabulate_marks(context),
        _tabulate_windows(context),
    )
    title = words["section"]["periods" if exposure.by_task else "hours"]
    page = Section("hours", title, brackets, () if later_charts else charts, tables=tables)
    return page, later_charts, later_tables


def _tabulate_tasks(context: Context) -> Table:
    """Tabulate the tasks, those with the most time above 60 deg first, and the shift without tasks."""
    words, language = context.words, context.language
    entry, rows = words["part"]["tasks"], []
    tenths, signed = _show_number(language, 1), partial(format_signed, language=language)
    lasting, spread = _show_duration(language)
    others = [(part, None) for part in context.exposure.by_task if part.analysed_s > 0 and not is_task(part)]
    for task, rank in (*rank_tasks(context.exposure.by_task), *others):
        share, ranges = task.time_above_percent.get(MAIN_THRESHOLD_DEG), task.intervals
        minutes = task.analysed_s / MINUTE_S / 100
        per_h = task.entries_above_60_per_h if task.analysed_s >= SHORTEST_RATED_S else None
        plain = {name: without_pose(interval) for name, interval in ranges.items()}
        whole = _scale(plain.get(MAIN_FIGURE), minutes)
        rows.append(
            (
                f"{rank}. {_name_task(task, words)}" if rank else _name_task(task, words),
                format_duration(task.analysed_s, language),
                format_ranged(share, ranges.get(MAIN_FIGURE), tenths, words),
                format_ranged(None if share is None else share * minutes, whole, tenths, words),
                format_ranged(
                    per_h, plain.get("entries_above_60_per_h"), partial(format_rate, language=language), words
                ),
                format_ranged(
                    task.episodes_above_60_longest_s,
                    plain.get("episodes_above_60_longest_s"),
                    lasting,
                    words,
                    spread,
                ),
                format_ranged(
                    task.recovery_neutral_slow_percent,
                    plain.get("recovery_neutral_slow_percent"),
                    tenths,
                    words,
                ),
                format_ranged(
                    task.time_above_60_less_rest_percent,
                    plain.get(LESS_REST),
                    signed,
                    words,
                    lambda ends: fill(
                        words["ranges"]["signed"], {"low": signed(ends.low), "high": signed(ends.high)}
                    ),
                ),
            )
        )
    cut = {"shown": str(MOST_PARTS), "all": str(len(rows))} if len(rows) > MOST_PARTS else {}
    return Table.build(entry, rows[:MOST_PARTS], note=fill(entry["note"], cut))


def _tabulate_marks(context: Context) -> Table:
    """Tabulate the 15 minutes before each mark, and the rest of the shift."""
    words, language, clock = context.words, context.language, context.clock
    entry, rows, every = words["part"]["marks"], [], context.exposure.by_mark
    tenths, whole = _show_number(language, 1), _show_number(language, 0)
    rate = partial(format_rate, language=language)
    for part in (*every[:-1][:MOST_MARKS], *every[-1:]):
        name = (
            entry["rest"] if part.kind == "rest" else f"{clock.format(part.end_s)} {_name_part(part, words)}"
        )
        figures: list[tuple[float | None, Show]] = [
            (part.time_above_percent.get(MAIN_THRESHOLD_DEG), tenths),
            (part.percentiles_deg.get(50), whole),
            (part.entries_above_60_per_h if part.analysed_s >= SHORTEST_RATED_S else None, rate),
        ]
        cells = (NONE if value is None else show(value) for value, show in figures)
        rows.append((name, format_duration(part.analysed_s, language), *cells))
    count = len(every) - 1
    cut = {"shown": str(MOST_MARKS), "all": str(count)} if count > MOST_MARKS else {}
    return Table.build(entry, rows, note=fill(entry["note"], cut))


def _tabulate_postures(context: Context) -> Table:
    """Tabulate the time in each posture, with the shares of upright time that Gupta et al. 2022 give.

    They refer to the time with a known posture: the other time may be upright or not.
    """
    entry, exposure, language = context.words["part"]["by_posture"], context.exposure, context.language
    named = [(entry["names"][part.kind], part) for part in exposure.by_posture if part.analysed_s]
    upright = [part for _, part in named if part.kind == "upright"]
    known_s = sum(part.analysed_s for _, part in named if part.kind in POSTURES)
    shares = (
        format_percent(part.time_above_percent[c] * part.analysed_s / known_s, language)
        for part in upright
        for c in (30, 60, 90)
    )
    known = format_percent(100.0 * known_s / exposure.analysed_s, language)
    return _tabulate_parts(named, entry, context, {"shares": ", ".join(shares), "known": known})


def is_task(part: PartExposure) -> bool:
    """Return whether a period or its pooled rows name a task whose time is analysed."""
    return names_task(part.kind, part.label, part.reason)


def rank_tasks(parts: Sequence[PartExposure]) -> list[tuple[PartExposure, int | None]]:
    """Sort the tasks by minutes above 60 deg; each has its rank if its range overlaps with no other."""

    def find_above_s(task: PartExposure) -> tuple[float, float, float]:
        interval, share = (
            task.intervals.get(MAIN_FIGURE),
            task.time_above_percent.get(MAIN_THRESHOLD_DEG, 0.0),
        )
        low, high = (interval.low, interval.high) if interval else (0.0, 100.0)
        return share * task.analysed_s, low * task.analysed_s, high * task.analysed_s

    tasks = (part for part in parts if is_task(part) and part.analysed_s > 0)
    ordered = sorted(tasks, key=lambda task: -find_above_s(task)[0])
    ends = [find_above_s(task)[1:] for task in ordered]
    ranked: list[tuple[PartExposure, int | None]] = []
    for k, task in enumerate(ordered):
        others = ends[:k] + ends[k + 1 :]
        is_apart = all(high < ends[k][0] or low > ends[k][1] for low, high in others)
        ranked.append((task, k + 1 if is_apart and others else None))
    return ranked


def _tabulate_periods(context: Context) -> tuple[Table, Table]:
    """Tabulate the tasks with their percentiles, and each row of the diary."""
    clock, words = context.clock, context.words
    tasks = [(_name_task(part, words), part) for part in context.exposure.by_task]
    periods = [
        (f"{clock.format_range(part.start_s, part.end_s)} {_name_part(part, words)}", part)
        for part in context.exposure.by_period
    ]
    return (
        _tabulate_parts(tasks, words["part"]["by_task"], context),
        _tabulate_parts(periods, words["part"]["by_period"], context),
    )


def _name_task(part: PartExposure, words: Words) -> str:
    return _name_part(part, words) + (f" ({part.periods}\u00a0×)" if part.periods > 1 else "")


def _name_part(part: PartExposure, words: Words) -> str:
    """Return the diary's label, or the kind of time."""
    return cut_text(clean_text(part.label) or words["part"]["kind"].get(part.kind, part.kind), LONGEST_NAME)


def _tabulate_parts(
    parts: Sequence[tuple[str, PartExposure]],
    entry: Words,
    context: Context,
    noted: Mapping[str, str] = MappingProxyType({}),
) -> Table:
    """Tabulate parts, each figure with its range, without units so that a row fits on one line."""
    language, words = context.language, context.words
    rows: list[tuple[str, ...]] = []
    for name, part in parts[:MOST_PARTS]:
        analysed = format_duration(part.analysed_s, language)
        if part.reason:
            analysed = fill(entry["left_out"], {"length": format_duration(part.recorded_s, language)})
        ranges = {  # the one with the error of the pose only for the main figure
            key: interval if key == MAIN_FIGURE else without_pose(interval)
            for key, interval in part.intervals.items()
        }
        whole, tenths = _show_number(language, 0), _show_number(language, 1)
        is_rated = part.analysed_s >= SHORTEST_RATED_S
        figures: list[tuple[str, float | None, Show]] = [
            *((f"elevation_p{p}_deg", part.percentiles_deg.get(p), whole) for p in (50, 90)),
            *((f"time_above_{c}_percent", part.time_above_percent.get(c), tenths) for c in (30, 60, 90)),
            (
                "entries_above_60_per_h",
                part.entries_above_60_per_h if is_rated else None,
                partial(format_rate, language=language),
            ),
        ]
        cells = (format_ranged(value, ranges.get(key), show, words) for key, value, show in figures)
        rows.append((name, analysed, *cells))
    cut = {"shown": str(MOST_PARTS), "all": str(len(parts))} if len(parts) > MOST_PARTS else {}
    return Table.build(entry, rows, note=fill(entry["note"], {**noted, **cut}))


# Quality and time.


def _build_quality_in_short(context: Context) -> Section:
    """Name the findings, without their details, and account for the time."""
    words, language = context.words, context.language
    rows = [
        (describe_flag(flag, language).title, _format_seconds(flag, language) or NONE)
        for flag in context.findings.quality.flags[:MOST_FINDINGS]
    ]
    more = len(context.findings.quality.flags) - MOST_FINDINGS
    entry = words["findings"]
    note = fill(entry["note"], {"more": str(more)}) if more > 0 else ""
    tables = (Table.build(entry, rows, note=note), _tabulate_time(context))
    return Section("quality", words["section"]["quality"], tables=tables)


def _build_quality(context: Context) -> Section:
    words, clock, rows = context.words, context.clock, []
    for flag in context.findings.quality.flags:
        places = (
            NONE if at is None else clock.format(at, with_seconds=True) for at in (flag.first_s, flag.last_s)
        )
        count = format_number(flag.count, 0, clock.language)
        lasted = _format_seconds(flag, clock.language) or NONE
        rows.append((flag.code, _describe_flag(flag, clock.language), count, lasted, *places))
    entry = words["quality"]
    flags = Table.build(entry, rows, prose=True)
    return Section("findings", words["section"]["findings"], tables=(flags, _tabulate_time_parts(context)))


def _tabulate_time(context: Context) -> Table:
    """Tabulate analysed, missing and excluded time, which add up to the recorded time to the microsecond."""
    time, entry, language = context.findings.time, context.words["time"], context.language
    amounts = [
        (entry["analysed"], time.analysed_us),
        (entry["missing"], time.missing_us),
        (entry["excluded"], time.excluded_us),
    ]
    rows = _build_time_rows(amounts, time.recorded_us, language)
    rows += _build_time_rows([(entry["recorded"], time.recorded_us)], time.recorded_us, language)
    reasons = ", ".join(
        f"{format_reason(reason, context.words)} ({format_duration(us / MICROSECONDS, language)})"
        for reason, us in _sum_exclusions(context.findings).items()
    )
    return Table.build(entry, rows, note=fill(entry["note"], {"reasons": reasons}))


def _build_time_rows(
    amounts: Sequence[tuple[str, int]], whole_us: int, language: Language
) -> list[tuple[str, ...]]:
    """Format amounts of time in microseconds: in units, in seconds, and as a share of the whole.

    The seconds are rounded at the cumulative ends, so that the printed values also add up.
    """
    ends_s = [round(end_us / MICROSECONDS, 1) for end_us in accumulate(us for _, us in amounts)]
    return [
        (
            name,
            format_long_duration(amount_us / MICROSECONDS),
            format_number(end_s - begin_s, 1, language),
            format_percent(100 * amount_us / max(whole_us, 1), language),
        )
        for (name, amount_us), begin_s, end_s in zip(amounts, (0.0, *ends_s), ends_s, strict=False)
    ]


def _tabulate_time_parts(context: Context) -> Table:
    """Tabulate each kind of time in the diary; they add up to the recorded time."""
    words, time = context.words, context.findings.time
    entry, kinds, amounts = words["time_parts"], words["part"]["kind"], []
    for part in time.parts if context.exposure.by_period else ():
        is_excluded = part.account == "excluded"
        name = format_reason(part.name, words) if is_excluded else str(kinds.get(part.name, part.name))
        amounts.append((fill(entry[part.account], {"name": name}), part.duration_us))
    rows = _build_time_rows(amounts, time.recorded_us, context.language)
    return Table.build(entry, rows, note=entry["note"])


# Method and provenance.


def _build_method_in_short(context: Context) -> Section:
    findings, words, entry = context.findings, context.words, context.words["method"]
    method, calibration, pairs = findings.method, findings.calibration, []
    if method is not None:
        pairs.append(Pair(entry["name"], f"{entry['names'].get(method.name, method.name)} {method.version}"))
    if calibration is not None:
        sigma = format_angle(calibration.sigma_deg, context.language, 1)
        pairs.append(Pair(words["calibration"]["found"], format_found(findings, words)))
        pairs.append(Pair(words["calibration"]["sigma"], sigma))
    file = clean_text(context.subject.file_name) or words["label"]["not_given"]
    pairs += [Pair(words["provenance"]["file"], file), *_describe_shift(context)]
    return Section("method", words["section"]["method"], (entry["short"],), pairs=tuple(pairs))


def _describe_shift(context: Context) -> list[Pair]:
    """Return the hours that were cut from a longer recording; none for a whole one."""
    if not context.subject.shift:
        return []
    zone = context.clock.start.tzinfo if context.clock.start else None
    shown = format_interval(context.subject.shift, context.language, zone)
    return [Pair(context.words["provenance"]["shift"], shown)]


def _build_method(context: Context) -> Section:
    findings, entry = context.findings, context.words["method"]
    title = context.words["section"]["full_method"]
    method = findings.method
    if method is None:
        ready = Pair(entry["name"], entry["ready"].get(findings.recording.device, entry["ready_angles"]))
        return Section("full-method", title, tuple(entry["paragraphs"]), pairs=(ready,))
    pairs = (
        Pair(entry["name"], f"{entry['names'].get(method.name, method.name)} ({method.name})"),
        Pair(entry["version"], method.version),
        Pair(entry["parameters"], entry["where"]),
        *(_describe_calibration(findings.calibration, context) if findings.calibration else ()),
    )
    return Section("full-method", title, tuple(entry["paragraphs"]), pairs=pairs)


def _describe_calibration(calibration: CalibrationFacts, context: Context) -> Iterable[Pair]:
    """Describe the calibration: how the axis was found, every window, and the uncertainty."""
    entry, language, score = context.words["calibration"], context.language, calibration.score

    def format_optional_angle(angle_deg: float | None) -> str:
        return "" if angle_deg is None else format_angle(angle_deg, language, 1)

    def format_time(at_s: float) -> str:
        return context.clock.format(at_s, with_seconds=True)

    def format_still(still: StillFacts | None) -> str:
        if still is None:
            return ""
        second, length = (
            format_number(still.start_s, 2, language),
            format_duration(still.duration_s, language),
        )
        return fill(entry["place"], {"time": format_time(still.start_s), "second": second, "length": length})

    bias = join_clauses((format_number(value, 3, language) for value in calibration.gyro_bias_dps), language)
    repeats = (
        fill(
            entry["repeated"],
            {"time": format_time(still.start_s), "apart": format_optional_angle(still.apart_deg)},
        )
        for still in calibration.repeats
    )
    # in state "none" walking itself determined the axis
    walking_deg = None if calibration.state == "none" else calibration.walking_apart_deg
    shown = {
        "found": format_found(context.findings, context.words),
        "sigma": format_optional_angle(calibration.sigma_deg),
        "pose": context.words["pose"][calibration.pose] if calibration.pose else "",
        "window": format_still(calibration.still),
        "second": format_still(calibration.second),
        "repeats": join_clauses(repeats, language),
        "repeat": format_optional_angle(calibration.repeat_deg),
        "slips": ", ".join(map(format_time, calibration.slip_times_s)),
        "no_slips": ", ".join(map(format_time, calibration.no_slip_times_s)),
        "walking": format_optional_angle(walking_deg),
        "score": "" if score is None else format_number(score, 2, language),
        "bias": fill(entry["bias_value"], {"values": bias}),
    }
    return (Pair(entry[name], value) for name, value in shown.items() if value)


def _build_provenance(context: Context) -> Section:
    recording, subject, words = context.findings.recording, context.subject, context.words
    entry, unknown = words["provenance"], words["label"]["not_given"]
    rate, start = format_number(recording.rate_hz, 3, context.language), unknown
    if recording.start:
        start = format_moment(recording.start, context.language, with_seconds=True)
    reading = []  # how the file was read, if not by our reader and its header, and a corrected clock
    if recording.clock_offset_s:
        reading.append(Pair(entry["clock_offset"], format_clock_offset(recording.clock_offset_s)))
    if recording.reader:
        reading.append(Pair(entry["reader"], clean_text(" ".join(recording.reader))))
    if subject.columns:
        reading.append(Pair(entry["columns"], format_columns(subject.columns, context.language)))
    pairs = (
        Pair(words["label"]["subject"], clean_text(subject.subject) or unknown),
        Pair(entry["file"], clean_text(subject.file_name) or unknown),
        *_describe_shift(context),
        Pair(entry["sha256"], recording.sha256, code=True),
        Pair(entry["device"], find_device_name(words, recording.device)),
        Pair(entry["serial"], recording.serial_hash or unknown, code=bool(recording.serial_hash)),
        Pair(entry["rate"], f"{rate}\u202fHz"),
        Pair(entry["start"], start),
        Pair(entry["zone"], clean_text(recording.time_zone or "") or unknown),
        Pair(entry["version"], f"Acromion {subject.software.version}"),
        Pair(entry["revision"], subject.software.revision, code=True),
        *reading,
        Pair(entry["schema"], SCHEMA, code=True),
        Pair(entry["report_id"], subject.report_id, code=True),
    )
    return Section("provenance", words["section"]["provenance"], pairs=pairs)


# The tables of every figure. A figure and its range are in one cell: "5.7 (4.0–8.6; pose 11.6)".

Rows = list[tuple[str, ...]]
Show = Callable[[float], str]


def format_ranged(
    value: float | None,
    interval: Interval | None,
    show: Show,
    words: Words,
    show_range: Callable[[Interval], str] | None = None,
) -> str:
    """Format a figure with its range and the upper end with the error of the pose, if they are known."""
    if value is None or not math.isfinite(value):
        return NONE
    if interval is None:
        return show(value)
    said, posed = words["ranges"], interval.high_pose
    facts = {
        "value": show(value),
        "range": show_range(interval) if show_range else f"{show(interval.low)}–{show(interval.high)}",
        "pose": show(posed) if posed is not None and posed > interval.high else "",
    }
    return fill(said["with_pose" if facts["pose"] else "cell"], facts)


def without_pose(interval: Interval | None) -> Interval | None:
    """Return the range without the error of the pose."""
    return interval and replace(interval, low_pose=None, high_pose=None)


def _show_number(language: Language, decimals: int) -> Show:
    return partial(format_number, decimals=decimals, language=language)


def _show_duration(language: Language) -> tuple[Show, Callable[[Interval], str]]:
    return partial(format_duration, language=language), partial(format_duration_range, language=language)


def _tabulate(entry: Words, rows: Iterable[tuple[str, ...]]) -> Table:
    return Table.build(entry, rows, note=entry.get("note", ""))


def _tabulate_bins(context: Context) -> Table:
    entry, language, bins = context.words["measure"]["bins"], context.language, context.exposure.bins
    shares = zip(bins, _format_classes(bins, context), strict=True)
    rows = [
        (f"{b.lower_deg:g}–{b.upper_deg:g}°", format_duration(b.duration_s, language), share)
        for b, share in shares
    ]
    return _tabulate(entry, rows)


def _tabulate_conventions(context: Context) -> Table:
    """Tabulate the classes of standards; standards with the same classes share their rows."""
    entry = context.words["measure"]["conventions"]
    names: dict[tuple[int, ...], list[str]] = {}
    for convention in CONVENTIONS:
        names.setdefault(convention.edges_deg, []).append(entry["name"][convention.key])
    rows = []
    for convention in CONVENTIONS:
        classes = context.exposure.conventions.get(convention.key, ())
        same = ", ".join(names.pop(convention.edges_deg, ()))
        for part, share in zip(classes, _format_classes(classes, context), strict=True) if same else ():
            rows.append((same, f"{part.lower_deg:g}–{part.upper_deg:g}°", share))
    return _tabulate(entry, rows)


def _format_classes(classes: Sequence[ElevationBin], context: Context) -> Iterable[str]:
    """Format the shares of all classes as whole numbers that add up, with their ranges rounded outwards."""
    for part, whole in zip(classes, round_classes([part.percent for part in classes]), strict=True):
        yield format_ranged(whole, round_outwards(part.interval), lambda value: f"{value:.0f}", context.words)


def _scale(interval: Interval | None, factor: float) -> Interval | None:
    return interval and Interval(interval.low * factor, interval.high * factor)


def round_outwards(interval: Interval | None) -> Interval | None:
    """Return the range in whole numbers that includes a share rounded up or down."""
    if interval is None:
        return None
    pose = None if interval.high_pose is None else math.ceil(interval.high_pose)
    return Interval(math.floor(interval.low), math.ceil(interval.high), interval.low_pose, pose)


def _tabulate_time_above(context: Context) -> Table:
    language, words = context.language, context.words
    rows = [
        (
            f"≥ {item.threshold_deg:g}°",
            format_duration(item.duration_s, language),
            format_ranged(item.percent, item.interval, _show_number(language, 1), words),
        )
        for item in context.exposure.time_above
    ]
    return _tabulate(words["measure"]["time_above"], rows)


def _tabulate_percentiles(context: Context) -> Table:
    exposure, show = context.exposure, _show_number(context.language, 0)
    rows = []
    for p, angle_deg in sorted(exposure.percentiles_deg.items()):
        interval = exposure.intervals.get(PERCENTILES[""].spell({"name": p}))
        rows.append((f"P{p}", format_ranged(angle_deg, interval, show, context.words)))
    return _tabulate(context.words["measure"]["percentiles"], rows)


def _tabulate_entries(context: Context) -> Table:
    """Tabulate rises and episodes above each threshold."""
    exposure, language, words = context.exposure, context.language, context.words
    episodes = {episode.threshold_deg: episode for episode in exposure.episodes}
    show_s, spread = _show_duration(language)
    rows = []
    for item in exposure.entries:
        above = {"threshold_deg": item.threshold_deg}
        per_h, median, longest, p90 = (
            exposure.intervals.get(figure.spell(above))
            for figure in (
                ENTRIES["per_hour"],
                EPISODES["median_s"],
                EPISODES["longest_s"],
                EPISODES["p90_s"],
            )
        )
        stay = episodes.get(item.threshold_deg)
        rows.append(
            (
                f"{item.threshold_deg:g}°",
                format_number(item.count, 0, language),
                format_ranged(item.per_hour, per_h, partial(format_rate, language=language), words),
                format_number(stay.count if stay else None, 0, language),
                format_ranged(stay.median_s if stay else None, median, show_s, words, spread),
                format_ranged(stay.p90_s if stay else None, p90, show_s, words, spread),
                format_ranged(stay.longest_s if stay else None, longest, show_s, words, spread),
            )
        )
    return _tabulate(words["measure"]["entries"], rows)


def _tabulate_long_stays(context: Context) -> Table:
    exposure, language, rows = context.exposure, context.language, []
    for item in exposure.episodes:
        if item.longer_s:
            per_h = exposure.intervals.get(EPISODES["per_hour"].spell(EPISODES.describe(item)))
            row = (
                f"{item.threshold_deg:g}°",
                format_ranged(item.per_hour, per_h, partial(format_rate, language=language), context.words),
                *(format_duration(total_s, language) for _, total_s in item.longer_s),
                format_number(item.censored, 0, language),
            )
            rows.append(row)
    return _tabulate(context.words["measure"]["long_stays"], rows)


def _tabulate_cycles(context: Context) -> Table:
    exposure, rows = context.exposure, []
    for c in exposure.cycles:
        name = f"{c.lower_deg:g}–{c.upper_deg:g}°" if c.upper_deg is not None else f"≥ {c.lower_deg:g}°"
        interval = exposure.intervals.get(CYCLES["count"].spell(CYCLES.describe(c)))
        show = _show_number(context.language, 0)
        rows.append((name, format_ranged(c.count, interval, show, context.words)))
    return _tabulate(context.words["measure"]["cycles"], rows)


def _tabulate_velocities(context: Context) -> Table:
    exposure, entry = context.exposure, context.words["measure"]["velocities"]
    show, rows = _show_number(context.language, 1), []
    for kind in VELOCITIES:
        velocity = exposure.velocity_dps.get(kind)
        if velocity is not None:
            cells = (
                format_ranged(value, exposure.intervals.get(name), show, context.words)
                for name, value in VELOCITY.name_values(velocity, kind).items()
            )
            rows.append((entry["kind"][kind], *cells))
    return _tabulate(entry, rows)


def _tabulate_windows(context: Context) -> Table:
    exposure, clock, language = context.exposure, context.clock, context.language
    rows: Rows = []
    for window in exposure.peak_windows:
        length = format_duration(window.length_s, language).replace("1\u202fh", "60\u202fmin")
        place = NONE
        if window.start_s is not None:
            place = clock.format_range(window.start_s, window.start_s + window.length_s)
        interval = exposure.intervals.get(WINDOWS["percent_above_60"].spell({"length_s": window.length_s}))
        share = format_ranged(window.percent_above_60, interval, _show_number(language, 1), context.words)
        rows.append((length, place, share))
    return _tabulate(context.words["measure"]["windows"], rows)


def _tabulate_rest(context: Context) -> Table:
    exposure, language, entry = context.exposure, context.language, context.words["measure"]["recovery"]
    values = {
        name: value
        for group in SINGLE_GROUPS
        if (record := getattr(exposure, group.key)) is not None
        for name, value in group.name_values(record).items()
    }
    lasting, spread = _show_duration(language)
    shows: dict[str, Show] = {
        "%": _show_number(language, 1),
        "Hz": _show_number(language, 2),
        "s": lasting,
    }
    rows = [
        (
            entry["row"][name],
            format_ranged(
                values[name],
                exposure.intervals.get(name),
                shows.get(find_unit(name), partial(format_rate, language=language)),
                context.words,
                spread if find_unit(name) == "s" else None,
            ),
        )
        for name in REST_TABLE
        if values.get(name) is not None
    ]
    return _tabulate(entry, rows)


def _tabulate_variation(context: Context) -> Table:
    entry, language = context.words["measure"]["variation"], context.language
    rows = [
        (
            entry["figure"][name],
            format_percent(item.coefficient_percent, language),
            format_number(item.spread, 1, language),
            format_number(item.last_less_first, 1, language),
        )
        for name, item in context.exposure.hour_variation.items()
    ]
    return _tabulate(entry, rows)
