"""What stands behind the first page: hours, all figures, quality, time, method, provenance."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from app.report.charts import build_parts, is_drawable
from app.report.clock import Clock
from app.report.day import name_reason
from app.report.findings import Findings, StillFacts
from app.report.limits import choose_ranges
from app.report.measures import list_measures
from app.report.messages import describe_flag
from app.report.numbers import (
    NONE,
    SHORTEST_RATED_S,
    format_angle,
    format_angle_range,
    format_duration,
    format_exact,
    format_long_duration,
    format_number,
    format_percent,
    format_plain,
    format_rate,
)
from app.report.parts import Pair, Section, Table
from app.report.published import build_published
from app.report.results import SCHEMA, identify_report
from app.report.spread import build_spread
from app.report.subject import ReportSubject, clean_text, cut_text
from app.report.wording import Language, Words, fill
from fusion.exposure.types import Interval, PartExposure
from fusion.quality.types import TimePart
from fusion.recording import MICROSECONDS, QualityFlag

LONGEST_NAME = 60
"""Of a period in its table; results.json and periods.csv hold the whole label."""


def build_sections(
    findings: Findings, subject: ReportSubject, clock: Clock, words: Words
) -> tuple[Section, ...]:
    """Build the chapters in reading order; an empty one is left out."""
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
            paragraphs=(words["ranges"]["every"][choose_ranges(findings)],),
            tables=list_measures(findings.exposure, clock, words),
        ),
        build_published(findings, words, clock.language),
        _build_quality(findings, clock, words),
        _build_method(findings, clock, words),
        _build_provenance(findings, subject, clock, words),
    )
    return tuple(section for section in sections if section.pairs or section.tables or section.figures)


# ------------------------------------------------------------------ by hour and by period


def _build_parts(findings: Findings, clock: Clock, words: Words) -> Section:
    exposure = findings.exposure
    hours = [(_name_hour(part, clock), part) for part in exposure.by_hour]
    periods = [(_name_period(part, clock, words), part) for part in exposure.by_period]
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
        tasks = [(_name_task(part, words), _drop_told_ranges(part)) for part in exposure.by_task]
        tables.append(_tabulate_parts(tasks, words["part"]["by_task"], range_name, clock))
    figures = [
        build_parts(key, parts, words, clock.language)
        for key, parts, _ in groups
        if any(is_drawable(part) for _, part in parts)
    ]
    title = words["section"]["periods" if periods else "hours"]
    return Section("hours", title, figures=tuple(figures), tables=tuple(tables))


def _drop_told_ranges(part: PartExposure) -> PartExposure:
    """A task of one period has the period's ranges, which stand under that already."""
    return part if part.periods > 1 else replace(part, intervals={})


def _name_hour(part: PartExposure, clock: Clock) -> str:
    first, last = clock.label_tick(part.start_s), clock.label_tick(part.end_s)
    return f"{first}–{last if last != first else clock.tell(part.end_s, with_seconds=True)}"


def _name_period(part: PartExposure, clock: Clock, words: Words) -> str:
    """Give its times and the diary's label, else what kind of time it is."""
    name = clean_text(part.label) or words["part"]["kind"].get(part.kind, part.kind)
    return f"{clock.tell(part.start_s)}–{clock.tell(part.end_s)} {cut_text(name, LONGEST_NAME)}"


def _name_task(part: PartExposure, words: Words) -> str:
    """Give the diary's label and how many of its rows are pooled."""
    name = clean_text(part.label) or words["part"]["kind"].get(part.kind, part.kind)
    told = cut_text(name, LONGEST_NAME)
    return told if part.periods == 1 else f"{told} ({part.periods}\u00a0×)"


def _tabulate_parts(
    parts: list[tuple[str, PartExposure]], entry: Words, range_name: str, clock: Clock
) -> Table:
    language = clock.language
    rows: list[tuple[str, ...]] = []
    for name, part in parts:
        rows += [_tell_part(name, part, entry, language), *_tell_part_ranges(part, range_name, language)]
    return Table(entry["caption"], tuple(entry["columns"]), tuple(rows), note=entry["note"])


def _tell_part(name: str, part: PartExposure, entry: Words, language: Language) -> tuple[str, ...]:
    rated = part.analysed_s >= SHORTEST_RATED_S
    return (
        name,
        _tell_analysed(part, entry, language),
        *(format_angle(part.percentiles_deg.get(p), language) for p in (10, 50, 90)),
        *(format_percent(part.percent_above.get(c), language) for c in (30, 60, 90)),
        format_rate(part.entries_above_60_per_h, language) if rated else NONE,
    )


def _tell_part_ranges(part: PartExposure, range_name: str, language: Language) -> list[tuple[str, ...]]:
    """Give the row of ranges under a part, if any is known; without units, so that it stays on its line."""
    if not part.intervals:
        return []
    angles = (part.intervals.get(f"elevation_p{p}_deg") for p in (10, 50, 90))
    shares = (part.intervals.get(f"time_above_{c}_percent") for c in (30, 60, 90))
    rated = part.analysed_s >= SHORTEST_RATED_S
    rate = part.intervals.get("entries_above_60_per_h") if rated else None
    cells = (
        *(format_angle_range(angle, language).removesuffix("°") for angle in angles),
        *(_tell_ends(share, 1, language) for share in shares),
        _tell_ends(rate, 0, language),
    )
    return [(range_name, "", *cells)]


def _tell_ends(interval: Interval | None, decimals: int, language: Language) -> str:
    if interval is None:
        return ""
    return "–".join(format_number(end, decimals, language) for end in (interval.low, interval.high))


def _tell_analysed(part: PartExposure, entry: Words, language: Language) -> str:
    if not part.reason:
        return format_duration(part.analysed_s, language)
    return fill(entry["left_out"], {"length": format_duration(part.recorded_s, language)})


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
        places = (_tell_place(at, clock) for at in (flag.first_s, flag.last_s))
        count = format_number(flag.count, 0, clock.language)
        lasted = format_duration(flag.seconds, clock.language) if flag.seconds else NONE
        rows.append((flag.code, told, count, lasted, *places))
    entry = words["quality"]
    return Table(entry["caption"], tuple(entry["columns"]), tuple(rows), prose=True)


def _tell_place(seconds: float | None, clock: Clock) -> str:
    return NONE if seconds is None else clock.tell(seconds, with_seconds=True)


def _tabulate_time(findings: Findings, clock: Clock, words: Words) -> Table:
    """Show that analysed, missing and excluded add up to what was recorded, to the microsecond."""
    time, entry = findings.time, words["time"]
    amounts = [
        (entry["analysed"], time.analysed_us),
        (entry["missing"], time.missing_us),
        (entry["excluded"], time.excluded_us),
        (entry["recorded"], time.recorded_us),
    ]
    rows = [
        (
            name,
            format_long_duration(amount_us / MICROSECONDS),
            format_exact(amount_us / MICROSECONDS, clock.language),
            format_percent(100 * amount_us / max(time.recorded_us, 1), clock.language),
        )
        for name, amount_us in amounts
    ]
    note = fill(entry["note"], {"reasons": _tell_reasons(findings, clock, words)})
    return Table(entry["caption"], tuple(entry["columns"]), tuple(rows), note=note)


def _tabulate_time_parts(findings: Findings, clock: Clock, words: Words) -> Table:
    """Show what the diary made of the day: each kind of time, adding up to what was recorded."""
    entry, whole_us = words["time_parts"], max(findings.time.recorded_us, 1)
    rows = tuple(
        (
            fill(entry[part.account], {"name": _name_time(part, words)}),
            format_long_duration(part.duration_us / MICROSECONDS),
            format_exact(part.duration_us / MICROSECONDS, clock.language),
            format_percent(100 * part.duration_us / whole_us, clock.language),
        )
        for part in (findings.time.parts if findings.exposure.by_period else ())
    )
    return Table(entry["caption"], tuple(entry["columns"]), rows, note=entry["note"])


def _name_time(part: TimePart, words: Words) -> str:
    if part.account == "excluded":
        return name_reason(part.name, words)
    return str(words["part"]["kind"].get(part.name, part.name))


def _tell_reasons(findings: Findings, clock: Clock, words: Words) -> str:
    """Name each reason for leaving time out and how long its stretches lasted."""
    totals: dict[str, int] = {}
    for span in findings.exclusions:
        totals[span.reason] = totals.get(span.reason, 0) + span.duration_us
    told = (
        f"{name_reason(reason, words)} ({format_duration(us / MICROSECONDS, clock.language)})"
        for reason, us in totals.items()
    )
    return ", ".join(told)


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
        *_describe_calibration(findings, clock, words),
    )
    rows = tuple((name, format_plain(value, clock.language)) for name, value in method.parameters.items())
    table = Table(entry["parameters"], tuple(entry["columns"]), rows)
    return Section(
        "method",
        words["section"]["method"],
        tuple(entry["paragraphs"]),
        pairs=pairs,
        tables=(table,) if rows else (),
    )


def _describe_calibration(findings: Findings, clock: Clock, words: Words) -> tuple[Pair, ...]:
    calibration, entry = findings.calibration, words["calibration"]
    if calibration is None:
        return ()
    bias = (f"{format_number(value, 3, clock.language)}" for value in calibration.still.gyro_bias_dps)
    score = format_number(calibration.still.score, 2, clock.language)
    chosen = "asked" if findings.settings.calibration_windows_s else "proposed"
    pairs = [
        Pair(entry["pose"], words["pose"][calibration.pose]),
        Pair(entry["window"], _tell_still(calibration.still, clock, words)),
        Pair(entry["chosen"], entry[chosen]),
        Pair(entry["score"], score),
        Pair(entry["bias"], fill(entry["bias_value"], {"values": " ; ".join(bias)})),
    ]
    if calibration.second is not None:
        pairs.insert(2, Pair(entry["second"], _tell_still(calibration.second, clock, words)))
    return tuple(pairs)


def _tell_still(still: StillFacts, clock: Clock, words: Words) -> str:
    facts = {
        "time": clock.tell(still.start_s, with_seconds=True),
        "second": format_number(still.start_s, 2, clock.language),
        "length": format_duration(still.duration_s, clock.language),
    }
    return fill(words["calibration"]["place"], facts)


def _build_provenance(findings: Findings, subject: ReportSubject, clock: Clock, words: Words) -> Section:
    recording, entry = findings.recording, words["provenance"]
    unknown = words["label"]["not_given"]
    start = recording.start.isoformat(sep=" ") if recording.start else unknown
    rate = format_number(findings.recording.rate_hz, 3, clock.language)
    pairs = (
        Pair(words["label"]["subject"], clean_text(subject.subject) or unknown),
        Pair(entry["file"], clean_text(subject.file_name) or unknown),
        Pair(entry["sha256"], recording.sha256, code=True),
        Pair(entry["device"], words["device"].get(recording.device, words["device"]["other"])),
        Pair(entry["serial"], recording.serial_hash or unknown, code=bool(recording.serial_hash)),
        Pair(entry["rate"], f"{rate}\u202fHz"),
        Pair(entry["start"], start),
        Pair(entry["zone"], clean_text(recording.time_zone or "") or unknown),
        Pair(entry["version"], f"Acromion {subject.software.version}"),
        Pair(entry["revision"], subject.software.revision, code=True),
        Pair(entry["schema"], SCHEMA, code=True),
        Pair(entry["report_id"], identify_report(findings, subject), code=True),
    )
    return Section("provenance", words["section"]["provenance"], pairs=pairs)
