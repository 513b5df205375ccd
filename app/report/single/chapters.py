"""The chapters after the first page: hours, all figures, quality, time, method, provenance."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

from app.report.bibliography import format_bibliography
from app.report.charts.bars import build_parts, is_drawable
from app.report.charts.day import format_reason
from app.report.charts.distribution import build_spread
from app.report.export.results import SCHEMA
from app.report.figures import (
    CYCLES,
    ENTRIES,
    EPISODES,
    PERCENTILES,
    REST_TABLE,
    SINGLE_GROUPS,
    VELOCITIES,
    VELOCITY,
    WINDOWS,
    format_figure,
    format_figure_range,
)
from app.report.findings import CalibrationFacts, Findings, ReportSubject, StillFacts
from app.report.model import Pair, Section, Table, VerdictLine
from app.report.words.messages import describe_flag, format_columns
from app.report.words.numbers import (
    MINUTE_S,
    NARROW,
    NONE,
    Clock,
    format_angle,
    format_angle_range,
    format_duration,
    format_ends,
    format_long_duration,
    format_number,
    format_percent,
    format_range,
    format_rate,
    percent_sign,
)
from app.report.words.wording import (
    Language,
    Words,
    clean_text,
    cut_text,
    fill,
    find_device_name,
    join_clauses,
)
from fusion.caveats import Caveat
from fusion.comparison.change import STATEMENTS, Reference, compare_with_references
from fusion.conventions import CONVENTIONS, UNHELD
from fusion.exposure.types import LEAST_RANGED_S, ElevationBin, Exposure, PartExposure, TimeAbove
from fusion.recording import MICROSECONDS, QualityFlag

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
MOST_PARTS = 14
"""Maximum hours, periods or tasks in a table of the report; the CSV has all."""
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
    is_posed = verdict == "good" and format_pose_caution(findings, words)
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
    lasted = format_duration(flag.seconds, language) if flag.seconds and flag.code not in PLACED else ""
    return f"{title} ({lasted})" if lasted and lasted not in title else title


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
    return fill(entry["line"], {"told": fill(entry[calibration.state], facts)})


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
    """Build the chapters in reading order, without empty ones."""
    words, exposure = context.words, context.exposure
    ranges, title = [words["ranges"]["every"][choose_ranges(context.findings)]], words["section"]
    if _has_pose_ranges(context):  # meaning of the ranges with the error of the pose
        ranges.append(f"{words['ranges']['pose']} {words['pose_caution']['ranges']}")
    sections = (
        _build_parts(context),
        Section("spread", title["spread"], figures=build_spread(exposure, words, context.language)),
        Section("figures", title["figures"], tuple(ranges), tables=build_measures(context)),
        _build_published(context),
        _build_quality(context),
        _build_method(context),
        _build_provenance(context),
        Section("bibliography", words["bibliography"]["title"], sources=format_bibliography()),
    )
    return tuple(one for one in sections if one.pairs or one.tables or one.figures or one.sources)


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


def _build_parts(context: Context) -> Section:
    exposure, clock, words = context.exposure, context.clock, context.words
    hours = [  # without the last sample of a recording that ends on the hour: "11:00–11:00, 0 s"
        (_format_hour(part, context), part)
        for part in exposure.by_hour
        if part.end_s - part.start_s >= SHORTEST_HOUR_S
    ]
    periods = [
        (f"{clock.format(part.start_s)}–{clock.format(part.end_s)} {_name_part(part, words)}", part)
        for part in exposure.by_period
    ]
    figures, tables = [], []
    for key, parts in (("hours", hours), ("periods", periods)):
        if parts:
            tables.append(_tabulate_parts(parts, words["part"][f"by_{key[:-1]}"], context))
        if any(is_drawable(part) for _, part in parts):
            figures.append(build_parts(key, parts, words, clock.language))
    if any(part.periods > 1 for part in exposure.by_task):
        tasks = [  # the ranges of a task with one period are already below the period
            (f"{_name_part(part, words)} ({part.periods}\u00a0×)", part)
            if part.periods > 1
            else (_name_part(part, words), replace(part, intervals={}))
            for part in exposure.by_task
        ]
        tables.append(_tabulate_parts(tasks, words["part"]["by_task"], context))
    title = words["section"]["periods" if periods else "hours"]
    notes = (words["part"]["pose_note"],) if tables and _has_pose_ranges(context) else ()
    return Section("hours", title, notes, figures=tuple(figures), tables=tuple(tables))


def _format_hour(part: PartExposure, context: Context) -> str:
    first, last = (context.clock.format_tick(edge_s) for edge_s in (part.start_s, part.end_s))
    return f"{first}–{last if last != first else context.clock.format(part.end_s, with_seconds=True)}"


def _name_part(part: PartExposure, words: Words) -> str:
    """Return the diary's label, or the kind of time."""
    return cut_text(clean_text(part.label) or words["part"]["kind"].get(part.kind, part.kind), LONGEST_NAME)


def _tabulate_parts(parts: Sequence[tuple[str, PartExposure]], entry: Words, context: Context) -> Table:
    """Tabulate parts, each with its ranges below, without units so that they fit on one line."""
    language, range_name = context.language, context.words["measure"]["percentiles"]["range"]
    rows: list[tuple[str, ...]] = []
    for name, part in parts[:MOST_PARTS]:
        analysed = format_duration(part.analysed_s, language)
        if part.reason:
            analysed = fill(entry["left_out"], {"length": format_duration(part.recorded_s, language)})
        is_rated = part.analysed_s >= SHORTEST_RATED_S
        rows.append(
            (
                name,
                analysed,
                *(format_angle(part.percentiles_deg.get(p), language) for p in (10, 50, 90)),
                *(format_percent(part.percent_above.get(c), language) for c in (30, 60, 90)),
                format_rate(part.entries_above_60_per_h, language) if is_rated else NONE,
            )
        )
        if part.intervals:
            angles = (part.intervals.get(f"elevation_p{p}_deg") for p in (10, 50, 90))
            shares = (part.intervals.get(f"time_above_{c}_percent") for c in (30, 60, 90))
            rate = part.intervals.get("entries_above_60_per_h") if is_rated else None
            cells = (
                *(format_angle_range(angle, language).removesuffix("°") for angle in angles),
                *(format_ends(share, 1, language) for share in shares),
                format_ends(rate, 0, language),
            )
            rows.append((range_name, "", *cells))
    cut = {"shown": str(MOST_PARTS), "all": str(len(parts))} if len(parts) > MOST_PARTS else {}
    return Table.build(entry, rows, note=fill(entry["note"], cut))


# Quality and time.


def _build_quality(context: Context) -> Section:
    words, clock, rows = context.words, context.clock, []
    for flag in context.findings.quality.flags:
        places = (
            NONE if at is None else clock.format(at, with_seconds=True) for at in (flag.first_s, flag.last_s)
        )
        count = format_number(flag.count, 0, clock.language)
        lasted = format_duration(flag.seconds, clock.language) if flag.seconds else NONE
        rows.append((flag.code, _describe_flag(flag, clock.language), count, lasted, *places))
    entry = words["quality"]
    flags = Table.build(entry, rows, prose=True)
    tables = (flags, _tabulate_time(context), _tabulate_time_parts(context))
    return Section("quality", words["section"]["quality"], tables=tuple(t for t in tables if t.rows))


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


def _build_method(context: Context) -> Section:
    findings, entry, title = context.findings, context.words["method"], context.words["section"]["method"]
    method = findings.method
    if method is None:
        ready = Pair(entry["name"], entry["ready"].get(findings.recording.device, entry["ready_angles"]))
        return Section("method", title, tuple(entry["paragraphs"]), pairs=(ready,))
    pairs = (
        Pair(entry["name"], f"{entry['names'].get(method.name, method.name)} ({method.name})"),
        Pair(entry["version"], method.version),
        Pair(entry["parameters"], entry["where"]),
        *(_describe_calibration(findings.calibration, context) if findings.calibration else ()),
    )
    return Section("method", title, tuple(entry["paragraphs"]), pairs=pairs)


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
    rate = format_number(recording.rate_hz, 3, context.language)
    reading = []  # how the file was read, if not by our reader and its header
    if recording.reader:
        reading.append(Pair(entry["reader"], clean_text(" ".join(recording.reader))))
    if subject.columns:
        reading.append(Pair(entry["columns"], format_columns(subject.columns, context.language)))
    pairs = (
        Pair(words["label"]["subject"], clean_text(subject.subject) or unknown),
        Pair(entry["file"], clean_text(subject.file_name) or unknown),
        Pair(entry["sha256"], recording.sha256, code=True),
        Pair(entry["device"], find_device_name(words, recording.device)),
        Pair(entry["serial"], recording.serial_hash or unknown, code=bool(recording.serial_hash)),
        Pair(entry["rate"], f"{rate}\u202fHz"),
        Pair(entry["start"], recording.start.isoformat(sep=" ") if recording.start else unknown),
        Pair(entry["zone"], clean_text(recording.time_zone or "") or unknown),
        Pair(entry["version"], f"Acromion {subject.software.version}"),
        Pair(entry["revision"], subject.software.revision, code=True),
        *reading,
        Pair(entry["schema"], SCHEMA, code=True),
        Pair(entry["report_id"], subject.report_id, code=True),
    )
    return Section("provenance", words["section"]["provenance"], pairs=pairs)


# The tables of every figure.

Rows = list[tuple[str, ...]]


def build_measures(context: Context) -> tuple[Table, ...]:
    """Build the tables of all figures, without empty ones."""
    exposure, language, entry = context.exposure, context.language, context.words["measure"]
    bins = [(f"{b.lower_deg:g}–{b.upper_deg:g}°", *_format_share(b, language)) for b in exposure.bins]
    above = [(f"≥ {t.threshold_deg:g}°", *_format_share(t, language)) for t in exposure.time_above]
    tables = (
        _tabulate(entry["bins"], bins),
        _tabulate(entry["time_above"], above),
        _tabulate(entry["cycles"], _list_cycles(exposure, language)),
        _tabulate(entry["windows"], _list_windows(context)),
        _tabulate_percentiles(exposure, entry["percentiles"], language),
        _tabulate(entry["entries"], _list_entries(exposure, entry["percentiles"], language)),
        _tabulate(entry["long_stays"], _list_long_stays(exposure, language), droppable=_LAST),
        _tabulate(entry["velocities"], _list_velocities(exposure, entry, language)),
        _tabulate(
            entry["recovery"], _list_rest(exposure, entry["recovery"]["row"], language), droppable=_LAST
        ),
        _tabulate(
            entry["variation"],
            _list_variation(exposure, entry["variation"]["figure"], language),
            droppable=_LAST,
        ),
        _tabulate(entry["conventions"], _list_conventions(exposure, entry["conventions"]["name"], language)),
    )
    return tuple(table for table in tables if table.rows)


_FROM_THIRD, _LAST = slice(2, None), slice(-1, None)


def _tabulate(entry: Words, rows: Sequence[tuple[str, ...]], droppable: slice = _FROM_THIRD) -> Table:
    """Build a table without those ``droppable`` columns that are empty (no interval in any row)."""
    columns = tuple(entry["columns"])
    places = range(len(columns))
    empty = [i for i in places[droppable] if all(row[i] == NONE for row in rows)]
    kept = [i for i in places if i not in empty]
    return Table(
        fill(entry["caption"], {}),
        tuple(columns[i] for i in kept),
        tuple(tuple(row[i] for i in kept) for row in rows),
        note=entry.get("note", ""),
    )


def _format_share(item: ElevationBin | TimeAbove, language: Language) -> tuple[str, str, str, str]:
    """Format time, share, its range, and the range with the error of the pose."""
    posed = item.interval.with_pose if item.interval else None
    known, pose = (format_range(interval, language) or NONE for interval in (item.interval, posed))
    return format_duration(item.duration_s, language), format_percent(item.percent, language), known, pose


def _tabulate_percentiles(exposure: Exposure, said: Words, language: Language) -> Table:
    """Tabulate the percentiles in one row for comparison, with their ranges below."""
    ranks = sorted(exposure.percentiles_deg)
    if not ranks:
        return Table("", (), ())
    intervals = [exposure.intervals.get(PERCENTILES[""].spell({"name": p})) for p in ranks]
    posed = [interval.with_pose if interval else None for interval in intervals]
    rows = [(said["row"], *(format_angle(exposure.percentiles_deg[p], language, 1) for p in ranks))]
    for name, ranges in (("range", intervals), ("pose", posed)):
        if any(ranges):
            rows.append((said[name], *(format_angle_range(i, language) or NONE for i in ranges)))
    columns = (said["column"], *(f"P{p}" for p in ranks))
    return Table(said["caption"], columns, tuple(rows), note=said["note"])


def _list_entries(exposure: Exposure, said: Words, language: Language) -> Rows:
    episodes, rows = {e.threshold_deg: e for e in exposure.episodes}, []
    for item in exposure.entries:
        stay = episodes.get(item.threshold_deg)
        row = (
            f"{item.threshold_deg:g}°",
            format_number(item.count, 0, language),
            format_rate(item.per_hour, language),
            format_number(stay.count if stay else None, 0, language),
            format_duration(stay.median_s if stay else None, language),
            format_duration(stay.longest_s if stay else None, language),
            format_number(stay.censored if stay else None, 0, language),
        )
        above = {"threshold_deg": item.threshold_deg}
        per_h = ENTRIES["per_hour"].spell(above)
        median, longest = (EPISODES[key].spell(above) for key in ("median_s", "longest_s"))
        rows += [row, *_list_ranges(exposure, ("", per_h, "", median, longest, ""), said, language)]
        interval = exposure.intervals.get(per_h)
        posed = interval.with_pose if interval else None
        if posed:  # the range of the rate with the error of the pose
            ends = "–".join(format_rate(end, language) for end in (posed.low, posed.high))
            rows.append((said["pose"], "", ends, "", "", "", ""))
    return rows


def _list_ranges(exposure: Exposure, names: Sequence[str], said: Words, language: Language) -> Rows:
    """Return the row of ranges below a row of figures, in its units; none if no range is known."""
    intervals = [exposure.intervals.get(name) for name in names]
    if not any(intervals):
        return []
    cells = (
        "–".join(_format_end(end, name, language) for end in (interval.low, interval.high))
        if interval
        else ""
        for name, interval in zip(names, intervals, strict=True)
    )
    return [(said["range"], *cells)]


def _format_end(value: float, name: str, language: Language) -> str:
    if name.endswith("_per_h"):
        return format_rate(value, language)
    if name.endswith("_s"):
        return format_duration(value, language)
    return format_number(value, 0 if value >= 99.95 else 1, language)  # keeps a wide range on one line


def _list_cycles(exposure: Exposure, language: Language) -> Rows:
    rows: Rows = []
    for c in exposure.cycles:
        name = f"{c.lower_deg:g}–{c.upper_deg:g}°" if c.upper_deg is not None else f"≥ {c.lower_deg:g}°"
        interval = exposure.intervals.get(CYCLES["count"].spell(CYCLES.describe(c)))
        shown = format_ends(interval, 1, language) or NONE
        rows.append((name, format_number(c.count, 1, language), shown))
    return rows


def _list_velocities(exposure: Exposure, entry: Words, language: Language) -> Rows:
    rows: Rows = []
    for kind in VELOCITIES:
        velocity = exposure.velocity_dps.get(kind)
        if velocity is not None:
            values = VELOCITY.name_values(velocity, kind)
            shown = (format_number(value, 1, language) for value in values.values())
            rows.append((entry["velocities"]["kind"][kind], *shown))
            rows += _list_ranges(exposure, list(values), entry["percentiles"], language)
    return rows


def _list_windows(context: Context) -> Rows:
    exposure, clock, language = context.exposure, context.clock, context.language
    rows: Rows = []
    for window in exposure.peak_windows:
        length = format_duration(window.length_s, language).replace("1\u202fh", "60\u202fmin")
        place, share = NONE, format_percent(window.percent_above_60, language)
        if window.start_s is not None:
            place = "–".join(clock.format(window.start_s + at_s) for at_s in (0, window.length_s))
        interval = exposure.intervals.get(WINDOWS["percent_above_60"].spell({"length_s": window.length_s}))
        rows.append((length, place, f"{share} ({format_range(interval, language)})" if interval else share))
    return rows


def _list_long_stays(exposure: Exposure, language: Language) -> Rows:
    rows: Rows = []
    for item in exposure.episodes:
        if item.longer_s:
            stays = EPISODES.describe(item)
            rates = _format_range(exposure, EPISODES["per_hour"].spell(stays), language)
            lengths = _format_range(exposure, EPISODES["p90_s"].spell(stays), language)
            row = (
                f"{item.threshold_deg:g}°",
                format_rate(item.per_hour, language) + (f" ({rates})" if rates else ""),
                format_duration(item.p90_s, language) + (f" ({lengths})" if lengths else ""),
                *(format_duration(total_s, language) for _, total_s in item.longer_s),
            )
            rows.append(row)
    return rows


def _list_rest(exposure: Exposure, names: Words, language: Language) -> Rows:
    values = {
        name: value
        for group in SINGLE_GROUPS
        if (record := getattr(exposure, group.key)) is not None
        for name, value in group.name_values(record).items()
    }
    return [
        (
            names[name],
            format_figure(values[name], name, language),
            _format_range(exposure, name, language) or NONE,
        )
        for name in REST_TABLE
        if values.get(name) is not None
    ]


def _format_range(exposure: Exposure, name: str, language: Language) -> str:
    interval = exposure.intervals.get(name)
    return format_figure_range(interval, name, language) if interval else ""


def _list_conventions(exposure: Exposure, names: Words, language: Language) -> Rows:
    return [
        (
            names[convention.key],
            f"{part.lower_deg:g}–{part.upper_deg:g}°",
            *_format_share(part, language)[1:],
        )
        for convention in CONVENTIONS
        for part in exposure.conventions.get(convention.key, ())
    ]


def _list_variation(exposure: Exposure, names: Words, language: Language) -> Rows:
    return [
        (
            names[name],
            format_percent(item.coefficient_percent, language),
            format_number(item.spread, 1, language),
            format_number(item.last_less_first, 1, language),
        )
        for name, item in exposure.hour_variation.items()
    ]
