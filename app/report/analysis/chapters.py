"""The chapters after the first page: hours, all figures, quality, time, method, provenance."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import accumulate

from app.report.analysis.tables import build_measures
from app.report.bibliography import format_bibliography
from app.report.charts.bars import build_parts, is_drawable
from app.report.charts.day import format_reason
from app.report.charts.distribution import build_spread
from app.report.export.results import SCHEMA
from app.report.findings import CalibrationFacts, Findings, StillFacts
from app.report.model import Pair, Section, Table, VerdictLine
from app.report.words.columns import format_columns
from app.report.words.messages import describe_flag
from app.report.words.numbers import (
    MINUTE_S,
    NARROW,
    NONE,
    Clock,
    format_angle,
    format_angle_range,
    format_duration,
    format_long_duration,
    format_number,
    format_percent,
    format_rate,
    percent_sign,
)
from app.report.words.subject import ReportSubject, clean_text, cut_text
from app.report.words.wording import Language, Words, fill, find_device_name, join_clauses
from fusion.caveats import Caveat
from fusion.comparison import STATEMENTS, Compared, Reference, compare_with_references
from fusion.conventions import UNHELD
from fusion.exposure.types import LEAST_RANGED_S, Exposure, Interval, PartExposure
from fusion.recording import MICROSECONDS, QualityFlag

# ------------------------------------------------------------------ published values


def build_published(findings: Findings, words: Words, language: Language) -> Section:
    """Give all references as a table, and what studies of groups found in words."""
    entry = words["published"]
    compared = compare_with_references(findings.exposure, findings.quality.verdict)
    rows = []
    for item in compared:
        said, reference = words["reference"][item.reference.key], item.reference
        measured = NONE if item.reason else _format_value(item.measured or 0.0, reference, language, 1)
        rows.append((said["name"], said["source"], _format_published(reference, language), measured))
    note = _format_why(compared, words)
    table = Table(entry["caption"], tuple(entry["columns"]), tuple(rows), prose=True, note=note)
    paragraphs = (*(entry["statement"][key] for key in STATEMENTS), entry["groups"])
    return Section("published", entry["title"], (" ".join(paragraphs),), tables=(table,))


def _format_published(reference: Reference, language: Language) -> str:
    decimals = 0 if reference.high >= 10 else 1
    high = _format_value(reference.high, reference, language, decimals)
    if reference.low is None:
        return f"≤\u00a0{high}"
    return f"{format_number(reference.low, decimals, language)}–{high}"


def _format_value(value: float, reference: Reference, language: Language, decimals: int) -> str:
    sign = {"percent": percent_sign(language), "deg": "°", "dps": "°/s", "h": f"{NARROW}h"}[reference.unit]
    return f"{format_number(value, 0 if reference.unit == 'deg' else decimals, language)}{sign}"


def _format_why(compared: tuple[Compared, ...], words: Words) -> str:
    """Give the reason why no reference has a measured value beside it, or why the speed has none."""
    reasons, told = {item.reason for item in compared} - {"not computed"}, words["comparison"]
    if reasons and "" not in reasons:
        return fill(told["does_not_apply"], {"reason": told["reason"][min(reasons)]})
    if any(item.reason == "not computed" and item.reference.key == "velocity" for item in compared):
        name, why = words["reference"]["velocity"]["name"], told["reason"]["not_computed_velocity"]
        return f"{name} – {fill(told['does_not_apply'], {'reason': why})}"
    return ""


# ------------------------------------------------------------------ what limits the figures


LEAST_SHARE = 0.01
"""Of the recording: less that was not analysed, and less than a minute, is left to the table."""


NOTED_WALKING_DEG = 30.0
"""Walking decides nothing; a note says if it lies further than this from the axis."""
PLACED = frozenset({Caveat.POSE_ASSUMED, Caveat.WHICH_POSE, Caveat.SLIP, Caveat.LEAN})
"""Caveats whose seconds say where to look, not how much of the recording they concern."""
MOST_TIMES = 6
MOST_REASONS = 2
"""That the first page names; the table of data quality holds all."""


def build_verdict(findings: Findings, words: Words, language: Language) -> VerdictLine:
    """Give the verdict, the gravest reason in full, every other by its name, and what was not analysed.

    A sound recording never hides what the pose does to its figures.
    """
    entry = words["verdict"][findings.quality.verdict]
    is_posed = findings.quality.verdict == "good" and format_pose_caution(findings, words)
    reasons = _format_reasons(findings, words, language) or entry["posed" if is_posed else "reason"]
    told = (reasons, _format_not_analysed(findings, words, language))
    return VerdictLine(findings.quality.verdict, entry["label"], " ".join(filter(None, told)))


def format_pose_caution(findings: Findings, words: Words) -> str:
    """Give the known one-sided error of the pose that was held; empty where there is none."""
    calibration = findings.calibration
    if calibration is None or calibration.pose is None or calibration.state in UNHELD:
        return ""
    return str(words["pose_caution"].get(calibration.pose, ""))


def format_pose_state(findings: Findings, clock: Clock, words: Words) -> str:
    """Return how the pose is known, in a line; empty for ready angles."""
    calibration, entry = findings.calibration, words["pose_state"]
    if calibration is None:
        return ""
    stills = [still for still in (calibration.still, calibration.second, *calibration.repeats) if still]
    times = [
        {
            "time": clock.format(still.start_s, with_seconds=True),
            "length": format_duration(still.duration_s, clock.language),
        }
        for still in stills
    ]
    facts = {
        "times": join_clauses((fill(entry["still"], time) for time in times), clock.language),
        "n": str(len(stills)),
        "apart": format_angle(math.ceil(calibration.repeat_deg or 0.0), clock.language),
        "axis": _format_axis(calibration),
    }
    return fill(entry["line"], {"told": fill(entry[calibration.state], facts)})


def format_needs_pose(findings: Findings, clock: Clock, words: Words) -> str:
    """Ask which stillness was the pose if they disagree; else empty."""
    calibration = findings.calibration
    if calibration is None or not calibration.needs_pose:
        return ""
    every = [clock.format(still.start_s, with_seconds=True) for still in calibration.proposals]
    further = len(every) - MOST_TIMES
    more = [fill(words["calibration"]["more"], {"n": str(further)})] if further > 0 else []
    told = [*every[:MOST_TIMES], *more]
    facts = {
        "times": f" {words['calibration']['or']} ".join(filter(None, (", ".join(told[:-1]), told[-1]))),
        "apart": format_angle(calibration.spread_deg, clock.language),
    }
    return fill(words["pose_state"]["needs"], facts)


def format_walking_note(findings: Findings, words: Words) -> str:
    """Return how far walking lies from the axis, if that is far; else empty."""
    calibration = findings.calibration
    if calibration is None or calibration.state == "none":
        return ""
    if calibration.walking_apart_deg is None or calibration.walking_apart_deg <= NOTED_WALKING_DEG:
        return ""
    key = "walking_note_axis" if calibration.state == "axis" else "walking_note"
    return fill(words["calibration"][key], {"deg": f"{calibration.walking_apart_deg:.0f}"})


def format_accuracy(findings: Findings, words: Words) -> str:
    """Describe the known accuracy of the method."""
    return str(words["accuracy"][findings.method.name if findings.method else "ready"])


def choose_ranges(findings: Findings) -> str:
    """Give the key of what the ranges hold: ``known``, or ``ready`` (sampling alone, as the error of the
    angle is not known). Where there are none: ``short`` (little of a day), else ``none``.
    """
    exposure = findings.exposure
    if not exposure.intervals and exposure.analysed_s < LEAST_RANGED_S:
        return "short"
    if findings.method is not None and findings.calibration is not None:
        return "known"
    return "ready" if exposure.intervals else "none"


def format_quality(findings: Findings, words: Words, language: Language) -> str:
    """Give what limits the data by name alone, the gravest first."""
    flags = {flag.code: flag for flag in reversed(findings.quality.flags)}
    counted = [_format_flag(flags[code], language) for code in findings.quality.reasons if code in flags]
    if not counted:
        return str(words["profile"]["no_fault_posed" if format_pose_caution(findings, words) else "no_fault"])
    more = len(counted) - MOST_REASONS
    told = join_clauses(counted[:MOST_REASONS], language)
    facts = {"reasons": told[0].upper() + told[1:], "more": str(more) if more > 0 else ""}
    return fill(words["profile"]["reasons"], facts)


def _format_reasons(findings: Findings, words: Words, language: Language) -> str:
    """Give the gravest caveat in full and the others that count by name."""
    flags = {flag.code: flag for flag in reversed(findings.quality.flags)}
    counted = [flags[code] for code in findings.quality.reasons if code in flags]
    if not counted:
        return ""
    caveat = describe_flag(counted[0], language)
    told = f"{caveat.title}. {caveat.detail}" if caveat.detail else caveat.title
    others = join_clauses((_format_flag(flag, language) for flag in counted[1:]), language)
    return f"{told} {fill(words['heading']['also'], {'others': others})}" if others else told


def _format_flag(flag: QualityFlag, language: Language) -> str:
    title = describe_flag(flag, language).title
    title = title[0].lower() + title[1:]
    lasted = format_duration(flag.seconds, language) if flag.seconds and flag.code not in PLACED else ""
    return f"{title} ({lasted})" if lasted and lasted not in title else title


def _format_not_analysed(findings: Findings, words: Words, language: Language) -> str:
    """Describe the time that no figure includes, the largest part first."""
    time = findings.time
    away_us = time.missing_us + time.excluded_us
    if away_us < max(LEAST_SHARE * time.recorded_us, MINUTE_S * MICROSECONDS):
        return ""
    parts = [(format_reason(reason, words), us) for reason, us in _sum_exclusions(findings).items()]
    if time.missing_us >= MICROSECONDS:
        missing = words["time"]["missing"]
        parts.append((missing[0].lower() + missing[1:], time.missing_us))
    parts.sort(key=lambda part: -part[1])
    told = ", ".join(f"{name} {format_duration(us / MICROSECONDS, language)}" for name, us in parts)
    return fill(words["heading"]["not_analysed"], {"parts": told})


def _sum_exclusions(findings: Findings) -> dict[str, int]:
    """Add up the excluded stretches by their reason, microseconds."""
    totals_us: dict[str, int] = {}
    for span in findings.exclusions:
        totals_us[span.reason] = totals_us.get(span.reason, 0) + span.duration_us
    return totals_us


SHORTEST_HOUR_S = 1.0
SHORTEST_RATED_S = 600.0
"""In less than ten minutes of an hour or a period a rate per hour would only be a small count multiplied."""
MOST_PARTS = 14
"""Hours, periods or tasks in a table of the report; the CSV holds all."""
LONGEST_NAME = 60
"""Of a period in its table; results.json and periods.csv hold the whole label."""


def build_sections(
    findings: Findings, subject: ReportSubject, clock: Clock, words: Words
) -> tuple[Section, ...]:
    """Build the chapters in reading order; an empty one is left out."""
    ranges = [words["ranges"]["every"][choose_ranges(findings)]]
    if has_pose_ranges(findings.exposure):  # what the ranges with the error of the pose are
        ranges.append(f"{words['ranges']['pose']} {words['pose_caution']['ranges']}")
    sections = (
        _build_parts(findings, clock, words),
        Section(
            "spread",
            words["section"]["spread"],
            figures=build_spread(findings.exposure, words, clock.language),
        ),
        Section(
            "figures",
            words["section"]["figures"],
            paragraphs=tuple(ranges),
            tables=build_measures(findings.exposure, clock, words),
        ),
        build_published(findings, words, clock.language),
        _build_quality(findings, clock, words),
        _build_method(findings, clock, words),
        _build_provenance(findings, subject, clock, words),
        Section("bibliography", words["bibliography"]["title"], sources=format_bibliography()),
    )
    return tuple(
        section
        for section in sections
        if section.pairs or section.tables or section.figures or section.sources
    )


def has_pose_ranges(exposure: Exposure) -> bool:
    """Whether ranges hold the error of the N-pose, too."""
    return any(above.interval and above.interval.with_pose for above in exposure.time_above)


# ------------------------------------------------------------------ by hour and by period


def _build_parts(findings: Findings, clock: Clock, words: Words) -> Section:
    exposure = findings.exposure
    hours = [  # without the last sample of a recording that ends on the hour: "11:00–11:00, 0 s"
        (_format_hour(part, clock), part)
        for part in exposure.by_hour
        if part.end_s - part.start_s >= SHORTEST_HOUR_S
    ]
    periods = [
        (f"{clock.format(part.start_s)}–{clock.format(part.end_s)} {_name_part(part, words)}", part)
        for part in exposure.by_period
    ]
    groups = [
        (key, parts, caption)
        for key, parts, caption in (("hours", hours, "by_hour"), ("periods", periods, "by_period"))
        if parts
    ]
    range_name = words["measure"]["percentiles"]["range"]
    tables = [
        _tabulate_parts(parts, words["part"][caption], range_name, clock) for _, parts, caption in groups
    ]
    if any(part.periods > 1 for part in exposure.by_task):
        tasks = [  # the ranges of a task of one period stand under the period already
            (f"{_name_part(part, words)} ({part.periods}\u00a0×)", part)
            if part.periods > 1
            else (_name_part(part, words), replace(part, intervals={}))
            for part in exposure.by_task
        ]
        tables.append(_tabulate_parts(tasks, words["part"]["by_task"], range_name, clock))
    figures = [
        build_parts(key, parts, words, clock.language)
        for key, parts, _ in groups
        if any(is_drawable(part) for _, part in parts)
    ]
    title = words["section"]["periods" if periods else "hours"]
    notes = (words["part"]["pose_note"],) if tables and has_pose_ranges(exposure) else ()
    return Section("hours", title, notes, figures=tuple(figures), tables=tuple(tables))


def _format_hour(part: PartExposure, clock: Clock) -> str:
    first, last = clock.format_tick(part.start_s), clock.format_tick(part.end_s)
    return f"{first}–{last if last != first else clock.format(part.end_s, with_seconds=True)}"


def _name_part(part: PartExposure, words: Words) -> str:
    """Return the diary's label, else what kind of time it is."""
    return cut_text(clean_text(part.label) or words["part"]["kind"].get(part.kind, part.kind), LONGEST_NAME)


def _tabulate_parts(
    parts: list[tuple[str, PartExposure]], entry: Words, range_name: str, clock: Clock
) -> Table:
    language = clock.language
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
        rows += _build_part_ranges(part, range_name, language)
    cut = {"shown": str(MOST_PARTS), "all": str(len(parts))} if len(parts) > MOST_PARTS else {}
    return Table(entry["caption"], tuple(entry["columns"]), tuple(rows), note=fill(entry["note"], cut))


def _build_part_ranges(part: PartExposure, range_name: str, language: Language) -> list[tuple[str, ...]]:
    """Give the row of ranges under a part, if any is known; without units, so that it stays on its line."""
    if not part.intervals:
        return []
    angles = (part.intervals.get(f"elevation_p{p}_deg") for p in (10, 50, 90))
    shares = (part.intervals.get(f"time_above_{c}_percent") for c in (30, 60, 90))
    rated = part.analysed_s >= SHORTEST_RATED_S
    rate = part.intervals.get("entries_above_60_per_h") if rated else None
    cells = (
        *(format_angle_range(angle, language).removesuffix("°") for angle in angles),
        *(_format_ends(share, 1, language) for share in shares),
        _format_ends(rate, 0, language),
    )
    return [(range_name, "", *cells)]


def _format_ends(interval: Interval | None, decimals: int, language: Language) -> str:
    if interval is None:
        return ""
    return "–".join(format_number(end, decimals, language) for end in (interval.low, interval.high))


# ------------------------------------------------------------------ quality and time


def _build_quality(findings: Findings, clock: Clock, words: Words) -> Section:
    tables = [
        _tabulate_flags(findings.quality.flags, clock, words),
        _tabulate_time(findings, clock, words),
        _tabulate_time_parts(findings, clock, words),
    ]
    return Section("quality", words["section"]["quality"], tables=tuple(t for t in tables if t.rows))


def _tabulate_flags(flags: Iterable[QualityFlag], clock: Clock, words: Words) -> Table:
    rows = []
    for flag in flags:
        caveat = describe_flag(flag, clock.language)
        told = f"{caveat.title}. {caveat.detail}" if caveat.detail else caveat.title
        places = (
            NONE if at is None else clock.format(at, with_seconds=True) for at in (flag.first_s, flag.last_s)
        )
        count = format_number(flag.count, 0, clock.language)
        lasted = format_duration(flag.seconds, clock.language) if flag.seconds else NONE
        rows.append((flag.code, told, count, lasted, *places))
    entry = words["quality"]
    return Table(entry["caption"], tuple(entry["columns"]), tuple(rows), prose=True)


def _tabulate_time(findings: Findings, clock: Clock, words: Words) -> Table:
    """Tabulate analysed, missing and excluded time, which add up to the recorded time to the microsecond."""
    time, entry = findings.time, words["time"]
    amounts = [
        (entry["analysed"], time.analysed_us),
        (entry["missing"], time.missing_us),
        (entry["excluded"], time.excluded_us),
    ]
    rows = _build_time_rows(amounts, time.recorded_us, clock.language)
    rows += _build_time_rows([(entry["recorded"], time.recorded_us)], time.recorded_us, clock.language)
    reasons = ", ".join(
        f"{format_reason(reason, words)} ({format_duration(us / MICROSECONDS, clock.language)})"
        for reason, us in _sum_exclusions(findings).items()
    )
    note = fill(entry["note"], {"reasons": reasons})
    return Table(entry["caption"], tuple(entry["columns"]), tuple(rows), note=note)


def _build_time_rows(
    amounts: Sequence[tuple[str, int]], whole_us: int, language: Language
) -> list[tuple[str, ...]]:
    """Write amounts of time, microseconds: in units, in seconds, and as a share of the whole.

    The seconds are rounded where the amounts meet, so that what is printed adds up too.
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


def _tabulate_time_parts(findings: Findings, clock: Clock, words: Words) -> Table:
    """Tabulate each kind of time in the diary; all add up to the recorded time."""
    entry = words["time_parts"]
    amounts = []
    for part in findings.time.parts if findings.exposure.by_period else ():
        kind = words["part"]["kind"].get(part.name, part.name)
        name = format_reason(part.name, words) if part.account == "excluded" else str(kind)
        amounts.append((fill(entry[part.account], {"name": name}), part.duration_us))
    rows = _build_time_rows(amounts, findings.time.recorded_us, clock.language)
    return Table(entry["caption"], tuple(entry["columns"]), tuple(rows), note=entry["note"])


# ------------------------------------------------------------------ method and provenance


def _build_method(findings: Findings, clock: Clock, words: Words) -> Section:
    method, entry = findings.method, words["method"]
    if method is None:
        ready = Pair(entry["name"], entry["ready"].get(findings.recording.device, entry["ready_angles"]))
        return Section("method", words["section"]["method"], tuple(entry["paragraphs"]), pairs=(ready,))
    told = entry["names"].get(method.name, method.name)
    pairs = (
        Pair(entry["name"], f"{told} ({method.name})"),
        Pair(entry["version"], method.version),
        Pair(entry["parameters"], entry["where"]),
        *_describe_calibration(findings, clock, words),
    )
    return Section("method", words["section"]["method"], tuple(entry["paragraphs"]), pairs=pairs)


def _describe_calibration(findings: Findings, clock: Clock, words: Words) -> tuple[Pair, ...]:
    """Describe what tied the sensor to the arm: how the axis was found, every window, how sure it is."""
    calibration, entry = findings.calibration, words["calibration"]
    if calibration is None:
        return ()
    language, score = clock.language, calibration.score
    bias = join_clauses((format_number(value, 3, language) for value in calibration.gyro_bias_dps), language)
    repeats = (
        fill(
            entry["repeated"],
            {
                "time": clock.format(still.start_s, with_seconds=True),
                "apart": _format_angle_of(still.apart_deg, language),
            },
        )
        for still in calibration.repeats
    )
    walking_deg = None if calibration.state == "none" else calibration.walking_apart_deg  # gave the axis
    slips, no_slips = (
        ", ".join(clock.format(time_s, with_seconds=True) for time_s in times_s)
        for times_s in (calibration.slip_times_s, calibration.no_slip_times_s)
    )
    pairs = (
        (entry["found"], format_found(findings, words)),
        (entry["sigma"], _format_angle_of(calibration.sigma_deg, language)),
        (entry["pose"], words["pose"][calibration.pose] if calibration.pose else ""),
        (entry["window"], _format_still(calibration.still, clock, words)),
        (entry["second"], _format_still(calibration.second, clock, words)),
        (entry["repeats"], join_clauses(repeats, language)),
        (entry["repeat"], _format_angle_of(calibration.repeat_deg, language)),
        (entry["slips"], slips),
        (entry["no_slips"], no_slips),
        (entry["walking"], _format_angle_of(walking_deg, language)),
        (entry["score"], "" if score is None else format_number(score, 2, language)),
        (entry["bias"], fill(entry["bias_value"], {"values": bias})),
    )
    return tuple(Pair(name, value) for name, value in pairs if value)


def format_found(findings: Findings, words: Words) -> str:
    """Say how the arm's axis was found."""
    calibration = findings.calibration
    if calibration is None:
        return ""
    found = words["calibration"]["found_as"][calibration.state]
    return fill(found, {"axis": _format_axis(calibration)})


def _format_axis(calibration: CalibrationFacts) -> str:
    return (calibration.axis or "").replace("-", "\u2212")


def _format_angle_of(angle_deg: float | None, language: Language) -> str:
    return "" if angle_deg is None else format_angle(angle_deg, language, 1)


def _format_still(still: StillFacts | None, clock: Clock, words: Words) -> str:
    if still is None:
        return ""
    facts = {
        "time": clock.format(still.start_s, with_seconds=True),
        "second": format_number(still.start_s, 2, clock.language),
        "length": format_duration(still.duration_s, clock.language),
    }
    return fill(words["calibration"]["place"], facts)


def _build_provenance(findings: Findings, subject: ReportSubject, clock: Clock, words: Words) -> Section:
    recording, entry = findings.recording, words["provenance"]
    unknown = words["label"]["not_given"]
    start = recording.start.isoformat(sep=" ") if recording.start else unknown
    rate = format_number(findings.recording.rate_hz, 3, clock.language)
    reading = []  # how the file was read, unless by a reader of our own and its header
    if recording.reader:
        reading.append(Pair(entry["reader"], clean_text(" ".join(recording.reader))))
    if subject.columns:
        reading.append(Pair(entry["columns"], format_columns(subject.columns, clock.language)))
    pairs = (
        Pair(words["label"]["subject"], clean_text(subject.subject) or unknown),
        Pair(entry["file"], clean_text(subject.file_name) or unknown),
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
