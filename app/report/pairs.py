"""Reports on two finished analyses: both arms of one shift, or a day compared with an earlier one.

All functions are pure. :func:`describe_pair` returns the content of ``pair.json``, :func:`build_pair` the
report; the figures over the shared time come from :mod:`acromion.fusion.comparison.arms`.
:func:`describe_comparison` returns the content of ``comparison.json`` and the API, :func:`build_comparison`
the report; both use
:func:`acromion.fusion.comparison.change.compare_days`. The report on several days shares this structure.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from typing import TYPE_CHECKING, Any, Literal

from acromion.app.errors import CannotCompare
from acromion.app.report.charts.bars import build_parts
from acromion.app.report.charts.day import build_timeline, build_two_days, shift_day
from acromion.app.report.charts.distribution import build_two_curves
from acromion.app.report.export.results import describe_level
from acromion.app.report.figures import format_figure, round_all
from acromion.app.report.findings import Findings, FinishedAnalysis
from acromion.app.report.model import Chart, Note, Pair, Report, Section, Table, VerdictLine
from acromion.app.report.single.chapters import format_accuracy, format_found, format_pose_caution
from acromion.app.report.words.numbers import (
    NONE,
    Clock,
    format_angle,
    format_angle_range,
    format_date,
    format_duration,
    format_ends,
    format_number,
    format_percent,
    format_range,
    percent_sign,
)
from acromion.app.report.words.wording import (
    LONGEST_CODE,
    Language,
    Words,
    clean_text,
    cut_text,
    fill,
    find_device_name,
    load_wording,
)
from acromion.app.request import find_code
from acromion.fusion.clocks import read_clock
from acromion.fusion.comparison.change import (
    SOURCE,
    ComparedDay,
    DayComparison,
    FigureChange,
    Reference,
    compare_days,
)
from acromion.fusion.conventions import CONFIRMED, UNHELD
from acromion.fusion.exposure.types import LEAST_RANGED_S, PartExposure
from acromion.fusion.recording import MICROSECONDS

if TYPE_CHECKING:
    from acromion.fusion.comparison.arms import PairedArms, TrunkRelative
    from acromion.fusion.comparison.levels import ComparedLevel
    from acromion.fusion.comparison.movement import ClockMatch

MAIN_LEVEL = "above_60"
"""The level that the sentences state."""


@dataclass(frozen=True, slots=True)
class PairSide:
    """One of the two analyses, with its name in the report."""

    name: str
    kept: FinishedAnalysis


OnePerson = Literal["codes", "person", "unknown", "no"]
"""Whether the recordings are from one person.

"codes": by their codes, or because they are one recording; "person": the caller states it; "unknown": nothing
states it, and no report is made; "no": the codes are of two people.
"""


def read_code(kept: FinishedAnalysis) -> str:
    """Return the code of the person; empty if none was given."""
    return find_code(clean_text(kept.subject.subject))


def identify_hours(kept: FinishedAnalysis) -> tuple[str, datetime | None]:
    """Return what two analyses of the same hours of one file share: the digest, and the start."""
    return kept.findings.recording.sha256, kept.findings.recording.start


def judge_person(every: Sequence[FinishedAnalysis], *, is_stated: bool) -> OnePerson:
    """Return whether all recordings are from one person; a person's statement counts if a code is missing."""
    codes = {read_code(kept) for kept in every}
    if len(codes - {""}) > 1:
        return "no"
    if "" not in codes or len({kept.findings.recording.sha256 for kept in every}) == 1:
        return "codes"
    return "person" if is_stated else "unknown"


def name_method(findings: Findings) -> str:
    """Return the method and its version; empty for angles from another program."""
    return f"{findings.method.name} {findings.method.version}" if findings.method else ""


def name_pose(findings: Findings) -> str:
    """Return the pose, or "axis" without one; angles with different references must not be compared."""
    return (findings.calibration.pose or "axis") if findings.calibration else ""


def has_mixed_methods(every: Iterable[FinishedAnalysis]) -> bool:
    """Return whether several methods, or versions of one, made the figures."""
    return len({name_method(kept.findings) for kept in every}) > 1


def format_person(one_person: OnePerson, language: Language) -> str:
    """Return who states that all are from one person, if a code is missing; else empty."""
    return str(load_pair_words(language)["one_person"].get(one_person, ""))


def load_pair_words(language: Language) -> Words:
    """Return the words of both reports."""
    return load_wording(language, "pairs")


def build_two_bars(
    sides: Sequence[tuple[str, float, dict[int, float]]], note: str, language: Language
) -> Chart:
    """Build one stacked bar per side, on one scale; ``note`` states the time they cover.

    ``sides``: name, analysed time in s and its share above each threshold in percent.
    """
    parts = [
        (name, PartExposure("", 0.0, 0.0, analysed_s, {}, above, None)) for name, analysed_s, above in sides
    ]
    return build_parts("bars", parts, load_pair_words(language), language, note)


def build_curves(sides: Sequence[PairSide], language: Language) -> list[Chart]:
    """Build a chart of both distributions; empty unless both have analysed time."""
    named = [(side.name, side.kept.findings.exposure) for side in sides]
    if any(exposure.histogram_s.sum() <= 0 for _, exposure in named):
        return []
    return [build_two_curves(named, load_pair_words(language)["curves"], language)]


def format_start(kept: FinishedAnalysis, language: Language) -> str:
    """Format the start date of a recording, or state that its file has no clock."""
    start = kept.findings.recording.start
    return format_date(start, language) if start else str(load_wording(language)["label"]["no_clock"])


def format_cautions(sides: Sequence[PairSide], language: Language) -> str:
    """Return which of the two has the one-sided error of the N-pose, and its effect on the difference."""
    words, entry = load_wording(language), load_pair_words(language)["pose_error"]
    posed = [side for side in sides if format_pose_caution(side.kept.findings, words)]
    if not posed:
        return ""
    shown = entry["both"] if len(posed) == len(sides) else fill(entry["one"], {"name": posed[0].name})
    return f"{shown} {entry['no_range']}"


def is_confirmed(findings: Findings) -> bool:
    """Return whether a person confirmed the pose; a strapped axis and a file with angles need none."""
    calibration = findings.calibration
    return calibration is None or calibration.state == "axis" or calibration.state in CONFIRMED


def format_unconfirmed(sides: Sequence[PairSide], effect: str, language: Language) -> str:
    """Return which poses are not confirmed and the consequence; empty if both are confirmed.

    ``effect``: key of the sentence with the consequence.
    """
    entry = load_pair_words(language)["unconfirmed"]
    shown = [
        fill(entry[calibration.state], {"name": side.name})
        for side in sides
        if (calibration := side.kept.findings.calibration) and not is_confirmed(side.kept.findings)
    ]
    return " ".join((*shown, entry[effect])) if shown else ""


def build_report(
    every: Sequence[FinishedAnalysis],
    document: Mapping[str, Any],
    words: Words,
    language: Language,
    *,
    title: str,
    version: str,
    header: tuple[Pair, ...],
    verdict: VerdictLine,
    sentences: Iterable[str],
    cautions: Iterable[str],
    figures: Iterable[Chart],
    sections: Iterable[Section],
    range_note: str = "",
    needs_pose: str = "",
    first_limit: str = "",
) -> Report:
    """Build the common parts of every report on several analyses.

    Its only date is the end of the recording that ended last. ``version`` is the software's; ``first_limit``
    replaces the first limit that the report on one recording states.
    """
    common = load_wording(language)
    limits, use, label = common["limits"], common["intended_use"], common["label"]
    accuracy = dict.fromkeys(format_accuracy(kept.findings, common) for kept in every)
    stated = (first_limit or limits["paragraphs"][0], *limits["paragraphs"][1:], *accuracy)
    recordings = [kept.findings.recording for kept in every]  # compared by the time on their clocks
    ends = [read_clock(r.start, r.duration_us) for r in recordings if r.start is not None]
    report_id = identify(document)
    footer = fill(words["footer"], {"version": version, "id": report_id})
    shown = ", ".join(fill(label["brief_fact"], {"name": pair.name, "value": pair.value}) for pair in header)
    return Report(
        language=language,
        title=title,
        subtitle=common["heading"]["subtitle"],
        header=header,
        verdict=verdict,
        sentences=tuple(sentences),
        pose_caution=" ".join(filter(None, cautions)),
        range_note=range_note,
        figures=tuple(figures),
        limits=Note(limits["title"], stated),
        intended_use=Note(use["title"], (use["text"],)),
        sections=tuple(sections),
        report_id=report_id,
        footer=footer,
        brief=fill(label["brief_two"], {"header": shown, "footer": footer}),
        made_of=max(ends, key=lambda end: end.replace(tzinfo=None), default=None),
        needs_pose=needs_pose,
        words=label,
    )


def build_sources(sides: Sequence[PairSide], language: Language) -> Section:
    """Build the table of sources."""
    words, pair_words = load_wording(language), load_pair_words(language)
    entry, unknown = pair_words["sources"], words["label"]["not_given"]
    columns = []
    for kept in (side.kept for side in sides):
        findings, subject, start = kept.findings, kept.subject, kept.findings.recording.start
        columns.append(
            (
                clean_text(subject.file_name) or unknown,
                findings.recording.sha256[:16] + "…",
                find_device_name(words, findings.recording.device),
                f"{format_date(start, language)}, {Clock(start, language).format(0)}" if start else NONE,
                format_duration(findings.time.analysed_us / MICROSECONDS, language),
                pair_words["pair"]["verdict"][findings.quality.verdict],
                name_method(findings) or NONE,
                format_pose(findings, words),
                f"Acromion {subject.software.version}",
                subject.report_id,
            )
        )
    rows = tuple(zip(entry["rows"], *columns, strict=True))
    names = (side.name for side in sides)
    table = Table(entry["caption"], (entry["column"], *names), rows, even=len(sides) > 2)
    return Section("provenance", entry["title"], tables=(table,))


def format_pose(findings: Findings, words: Words) -> str:
    """Format the pose, or how the axis was found without one."""
    calibration = findings.calibration
    if calibration is None:
        return NONE
    if calibration.pose is None or calibration.state in UNHELD:
        return format_found(findings, words)
    return str(words["pose"][calibration.pose])


def format_points(points: float | None, name: str, language: Language, *, is_signed: bool = False) -> str:
    """Format a difference or a deviation; shares are in points, whose French plural starts at 2."""
    if points is None:
        return NONE
    sign = "+" if is_signed and round(points, 1) > 0 else ""
    if not name.endswith("_percent"):
        return sign + format_figure(points, name, language)
    form = "points" if round(abs(points), 1) >= 2 else "points_under_two"
    words = load_pair_words(language)["compare"]
    return sign + fill(words[form], {"value": format_number(points, 1, language)})


def mark_rounding(before: float, after: float, change: float, name: str, mark: str) -> str:
    """Return the mark of a difference that the printed values do not give because of rounding; else empty."""

    def shown(value: float) -> float:
        return round(value, 0 if name.endswith("_per_h") and value >= 9.95 else 1)

    return mark if abs(shown(after) - shown(before) - shown(change)) > 1e-6 else ""


def format_level(reference: Reference, language: Language) -> str:
    """Format a proposed level, which has no decimals."""
    return format_number(reference.high, 0, language) + _find_sign(reference, language)


def _find_sign(reference: Reference, language: Language) -> str:
    return "°/s" if reference.unit == "dps" else percent_sign(language)


def format_standing(level: ComparedLevel, language: Language) -> str:
    """Return where a figure lies, or why nothing is compared."""
    entry = load_pair_words(language)["levels"]
    return str(entry["standing"][level.standing] if level.standing else entry["reason"][level.reason])


def lay_level(level: ComparedLevel, language: Language) -> tuple[str, ...]:
    """Return a row: figure, proposal, measured value, range, highest value with the pose, and standing."""
    reference, interval = level.reference, level.interval
    raised = interval.high_pose if interval else None
    values = (
        () if level.measured is None else (level.measured,),
        (interval.low, interval.high) if interval else (),
        () if raised is None else (raised,),
    )
    shown = ("–".join(format_number(end, 1, language) for end in ends) for ends in values)
    sign, at_most = _find_sign(reference, language), format_level(reference, language)
    return (
        load_wording(language)["reference"][reference.key]["name"],
        fill(load_pair_words(language)["levels"]["at_most"], {"value": at_most}),
        *(f"{text}{sign}" if text else NONE for text in shown),
        format_standing(level, language),
    )


def format_levels_note(language: Language, *, is_part: bool) -> str:
    """Return the meaning of the comparison, and whether a recording covers less than its shift."""
    entry = load_pair_words(language)["levels"]
    return " ".join(filter(None, (entry["note"], entry["part"] if is_part else "")))


def describe_source(kept: FinishedAnalysis) -> dict[str, object]:
    """Return the identity of an analysis for JSON."""
    recording, subject = kept.findings.recording, kept.subject
    return {
        "report_id": subject.report_id,
        "sha256": recording.sha256,
        "file_name": subject.file_name,
        "subject": subject.subject,
        "side": subject.side,
        "start": recording.start.isoformat() if recording.start else None,
        "analysed_s": kept.findings.time.analysed_us / MICROSECONDS,
        "verdict": kept.findings.quality.verdict,
    }


def identify(document: Mapping[str, Any]) -> str:
    """Return the id of a report on two: 16 hexadecimal digits of a hash of its figures."""
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:16]


def encode_document(document: Mapping[str, Any]) -> bytes:
    """Encode the figures of a report on two as JSON: the same figures give the same bytes."""
    return json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False).encode() + b"\n"


# Both arms of one shift.


PAIR_SCHEMA = "acromion.pair/1"


DISAGREE_S = 1.0
"""The shared movement contradicts the devices' clocks if it differs anywhere by more than this."""


@dataclass(frozen=True, slots=True)
class PairClock:
    """Time of a recording's first sample, seconds after the left arm's, and its source.

    ``match``: the relation found in the shared movement; with another source it is only compared.
    ``lasts_s``: length of the left arm's recording.
    """

    offset_s: float
    offset_from: Literal["clocks", "person", "signals"]
    match: ClockMatch | None = None
    lasts_s: float = 0.0

    @property
    def drift_ppm(self) -> float:
        """How much faster the clock runs than the left arm's; 0 unless it was found in the movement."""
        return self.match.drift_ppm if self.match and self.offset_from == "signals" else 0.0

    @property
    def certainty(self) -> Literal["person", "signals", "clocks", "confirmed", "doubtful"]:
        """The source; for clocks also whether the shared movement confirms or contradicts them."""
        if self.offset_from != "clocks" or self.match is None:
            return self.offset_from
        return "doubtful" if self.differs_s > DISAGREE_S else "confirmed"

    @property
    def differs_s(self) -> float:
        """How far the clocks are from the shared movement at most, drift included; 0 without a match."""
        if self.match is None or self.offset_from == "signals":
            return 0.0
        first_s = self.offset_s - self.match.offset_s
        return max(abs(first_s), abs(first_s + self.match.drift_ppm / 1e6 * self.lasts_s))

    def describe(self) -> dict[str, Any]:
        """Return offset, source, certainty, drift and the match for JSON."""
        return {
            "offset_s": self.offset_s,
            "from": self.offset_from,
            "certainty": self.certainty,
            "differs_s": self.differs_s,
            "drift_ppm": self.drift_ppm,
            "match": asdict(self.match) if self.match else None,
        }


@dataclass(frozen=True, slots=True)
class ArmPair:
    """Two arms on one clock.

    ``clock``: that of the right recording. ``trunk``: each arm relative to the trunk, with the clock
    ``trunk_clock`` and the analysis ``trunk_source``, None without one. ``one_person``: whether all of them
    are from one person.
    """

    left: FinishedAnalysis
    right: FinishedAnalysis
    clock: PairClock
    shared: PairedArms
    trunk: tuple[TrunkRelative, TrunkRelative]
    trunk_clock: PairClock | None = None
    one_person: OnePerson = "codes"
    trunk_source: FinishedAnalysis | None = None


def describe_pair(pair: ArmPair) -> dict[str, Any]:
    """Return the figures of both arms over their shared time, for JSON."""
    shared, clock = pair.shared, pair.trunk_clock
    document: dict[str, Any] = round_all(
        {
            "schema": PAIR_SCHEMA,
            "left": describe_source(pair.left),
            "right": describe_source(pair.right),
            "trunk": describe_source(pair.trunk_source) if pair.trunk_source else None,
            "one_person": pair.one_person,
            "clock": pair.clock.describe(),
            "trunk_clock": clock.describe() if clock else None,
            "shared_s": shared.shared_s,
            "arms": {
                side: {
                    "percentiles_deg": {str(p): deg for p, deg in share.percentiles_deg.items()},
                    "time_above_percent": {f"{c:g}": value for c, value in share.time_above_percent.items()},
                }
                for side, share in (("left", shared.left), ("right", shared.right))
            },
            "both_above_60_percent": shared.both_above_60_percent,
            "right_to_left": {"time_above_60": shared.ratio_above_60, "elevation_p50": shared.ratio_p50},
            "intervals": {name: [range_.low, range_.high] for name, range_ in shared.intervals.items()},
            "levels": {
                side: [describe_level(level) for level in kept.findings.compare_with_levels()]
                for side, kept in (("left", pair.left), ("right", pair.right))
            },
            "trunk_relative": {
                side: {
                    "limit": trunk.limit,
                    "shared_s": trunk.shared_s,
                    "percentiles_deg": {str(p): deg for p, deg in trunk.percentiles_deg.items()}
                    if trunk.percentiles_deg
                    else None,
                }
                for side, trunk in zip(("left", "right"), pair.trunk, strict=True)
            },
        }
    )
    return document


def build_pair(pair: ArmPair, language: Language) -> Report:
    """Build the report on both arms."""
    words, common = load_pair_words(language)["pair"], load_wording(language)
    sides = (PairSide(words["left"], pair.left), PairSide(words["right"], pair.right))
    bodies = (PairSide(words["trunk"]["name"], pair.trunk_source),) if pair.trunk_source else ()
    shared, label = pair.shared, common["label"]
    offset_s = pair.clock.offset_s
    order = "later" if offset_s > 0 else "earlier" if offset_s else "together"
    offset = format_duration(abs(offset_s), language)
    told_offset = fill(words["clock"][order], {"offset": offset})
    codes = dict.fromkeys(clean_text(side.kept.subject.subject) for side in sides)
    code = " / ".join(cut_text(code, LONGEST_CODE) for code in codes if code)
    bars = [  # over the shared time, so that the page has one value per arm
        (side.name, shared.shared_s, arm.time_above_percent)
        for side, arm in zip(sides, (shared.left, shared.right), strict=True)
    ]
    curves = (replace(chart, note=words["curves_note"]) for chart in build_curves(sides, language))
    return build_report(
        (pair.left, pair.right),
        describe_pair(pair),
        words,
        language,
        title=words["title"],
        version=pair.left.subject.software.version,
        header=(
            Pair(label["subject"], code or label["not_given"]),
            Pair(label["date"], format_start(pair.left, language)),
            Pair(words["shared"], format_duration(shared.shared_s, language)),
            Pair(words["offset"][order], offset),
        ),
        verdict=_judge_arms(sides, words, common["verdict"]),
        sentences=_format_answers(pair, words, language),
        cautions=(
            format_person(pair.one_person, language),
            f"{told_offset} {_format_clock(pair.clock, words['clock'], language)}",
            *_format_trunk_clock(pair, words["clock"], language),
            format_cautions(sides, language),
        ),
        figures=(build_two_bars(bars, words["bars_note"], language), _build_days(pair, sides, language)),
        sections=(
            _build_levels(pair, language),
            _build_figures(pair, words["table"], language),
            _build_trunk(pair, bodies, words, language),
            *(Section("spread", common["section"]["spread"], figures=(chart,)) for chart in curves),
            build_sources((*sides, *bodies), language),
        ),
        range_note=_format_ranges_note(pair, words["ranges"]),
        needs_pose=format_unconfirmed(sides, "pair", language),
        first_limit=words["limits_with_trunk"] if any(t.percentiles_deg for t in pair.trunk) else "",
    )


def _format_clock(clock: PairClock, entry: Words, language: Language) -> str:
    """Return the source of an offset, how certain it is, and whether the movement contradicts it."""
    match = clock.match
    facts = (
        {
            "margin": format_number(match.margin_s, 2, language),
            "drift": format_number(match.drift_ppm, 0, language),
            "windows": str(match.windows),
            "offset": format_number(match.offset_s, 1, language),
            "differs": format_number(clock.differs_s, 1, language),
        }
        if match
        else {}
    )
    return fill(entry[clock.certainty], facts)


def _format_trunk_clock(pair: ArmPair, entry: Words, language: Language) -> Iterator[str]:
    """Yield how the trunk's clock was found, if not by the devices' clocks alone."""
    clock = pair.trunk_clock
    if clock and (clock.match or clock.offset_from != "clocks"):
        yield fill(entry["trunk"], {"source": _format_clock(clock, entry, language)})


def _judge_arms(sides: Sequence[PairSide], words: Words, verdicts: Words) -> VerdictLine:
    """Return the worse verdict of the two, and both arms' verdicts as its reason."""
    levels = [side.kept.findings.quality.verdict for side in sides]
    worst = max(levels, key=("good", "caution", "poor").index)
    shown = dict(zip(("left", "right"), (words["verdict"][level] for level in levels), strict=True))
    reason = words["verdict_both"] if len(set(levels)) == 1 else fill(words["verdict_each"], shown)
    return VerdictLine(worst, verdicts[worst]["label"], reason)


def _format_answers(pair: ArmPair, words: Words, language: Language) -> tuple[str, ...]:
    entry, shared = words["sentence"], pair.shared
    ratio = format_number(shared.ratio_above_60, 2, language)
    figures = {
        "left": ("left_time_above_60_percent", format_percent(shared.left.time_above_percent[60], language)),
        "right": (
            "right_time_above_60_percent",
            format_percent(shared.right.time_above_percent[60], language),
        ),
        "both": ("both_above_60_percent", format_percent(shared.both_above_60_percent, language)),
        "left_90": (
            "left_time_above_90_percent",
            format_percent(shared.left.time_above_percent[90], language),
        ),
        "right_90": (
            "right_time_above_90_percent",
            format_percent(shared.right.time_above_percent[90], language),
        ),
        "left_p50": ("left_elevation_p50_deg", format_angle(shared.left.percentiles_deg[50], language)),
        "right_p50": ("right_elevation_p50_deg", format_angle(shared.right.percentiles_deg[50], language)),
        "ratio": ("right_to_left_time_above_60", "" if ratio == NONE else ratio),
    }
    facts = {"shared": format_duration(shared.shared_s, language)}
    for key, (name, value) in figures.items():
        interval = _format_interval(pair, name, language)
        pattern = entry["ranged_inside" if key == "ratio" else "ranged"]  # it is already in brackets
        facts[key] = fill(pattern, {"value": value, "range": interval}) if value and interval else value
    for side, kept in (("left", pair.left), ("right", pair.right)):
        level = next(one for one in kept.findings.compare_with_levels() if one.reference.key == MAIN_LEVEL)
        facts |= {
            f"{side}_standing": format_standing(level, language),
            "level": format_level(level.reference, language),
        }
    return tuple(fill(entry[key], facts) for key in ("above", "level", "both", "median"))


def _format_interval(pair: ArmPair, name: str, language: Language) -> str:
    interval = pair.shared.intervals.get(name)
    if name.endswith("_percent"):
        return format_range(interval, language)
    if name.endswith("_deg"):
        return format_angle_range(interval, language)
    return format_ends(interval, 2, language)


def _format_ranges_note(pair: ArmPair, entry: Words) -> str:
    """Return the meaning of the ranges, or that there are none."""
    if pair.shared.shared_s < LEAST_RANGED_S or not pair.shared.intervals:
        return str(entry["short" if pair.shared.shared_s < LEAST_RANGED_S else "none"])
    is_open = not (is_confirmed(pair.left.findings) and is_confirmed(pair.right.findings))
    return f"{entry['known']} {entry['unconfirmed']}" if is_open else str(entry["known"])


def _build_days(pair: ArmPair, sides: Sequence[PairSide], language: Language) -> Chart:
    """Draw both days one above the other, on the clock of the first."""
    entry, report_words = load_pair_words(language)["days"], load_wording(language)
    first_s = min(0.0, pair.clock.offset_s)
    begins_s = (0.0 - first_s, pair.clock.offset_s - first_s)
    lasts_s = [side.kept.findings.recording.duration_us / MICROSECONDS for side in sides]
    whole_s = max(begin + lasts for begin, lasts in zip(begins_s, lasts_s, strict=True))
    start = Clock(pair.left.findings.recording.start, language).at(first_s)
    clock = Clock(start, language, whole_s)
    days = []
    for side, begin_s in zip(sides, begins_s, strict=True):
        own = build_timeline(side.kept.findings, clock, report_words)
        days.append((side.name, shift_day(own, begin_s, whole_s, clock, entry["absent"])))
    return build_two_days(days, entry, report_words)


def _build_levels(pair: ArmPair, language: Language) -> Section:
    """Compare each arm's whole recording with the proposed levels, as its own report does."""
    words = load_wording(language)["side"]
    entry, sides = load_pair_words(language)["levels"], (("left", pair.left), ("right", pair.right))
    arms = [(words[side], kept.findings.compare_with_levels()) for side, kept in sides]
    rows = [
        (figure, arm, *cells)
        for levels in zip(*(levels for _, levels in arms), strict=True)
        for (arm, _), level in zip(arms, levels, strict=True)
        for figure, *cells in (lay_level(level, language),)
    ]
    figure, *others = entry["columns"]
    is_part = any(kept.findings.extent == "part" for _, kept in sides)
    note = format_levels_note(language, is_part=is_part)
    columns = (figure, entry["arm"], *others)
    table = Table(entry["caption"], columns, tuple(rows), note=note, even=True)
    return Section("levels", entry["title"], tables=(table,))


def _build_figures(pair: ArmPair, entry: Words, language: Language) -> Section:
    """Build the table of the shared time; a figure and its range are in one cell."""
    shared, arms, rows = pair.shared, (pair.shared.left, pair.shared.right), []
    ratios = (("above", 60, shared.ratio_above_60), ("percentile", 50, shared.ratio_p50))

    def add(row: str, key: int, figure: str, values: Sequence[str], both: str) -> None:
        ratio = next((value for name, k, value in ratios if (name, k) == (row, key)), None)
        left, right = values
        rows.append(
            (
                fill(entry[row], {"threshold": str(key), "p": str(key)}),
                tell(left, f"left_{figure}"),
                tell(right, f"right_{figure}"),
                both,
                tell(format_number(ratio, 2, language), f"right_to_left_{figure.rpartition('_')[0]}"),
            )
        )

    def tell(value: str, name: str) -> str:
        interval = _format_interval(pair, name, language)
        return fill(entry["cell"], {"value": value, "range": interval if value != NONE else ""})

    for c in shared.left.time_above_percent:
        above = tuple(format_percent(arm.time_above_percent[c], language) for arm in arms)
        both = format_percent(shared.both_above_60_percent if c == 60 else None, language)
        add("above", int(c), f"time_above_{c:g}_percent", above, tell(both, "both_above_60_percent"))
    for p in shared.left.percentiles_deg:
        angles = tuple(format_angle(arm.percentiles_deg[p], language, 1) for arm in arms)
        add("percentile", p, f"elevation_p{p}_deg", angles, NONE)
    table = Table.build(entry, rows, entry["note"])
    return Section("figures", entry["title"], tables=(table,))


def _build_trunk(pair: ArmPair, bodies: Sequence[PairSide], words: Words, language: Language) -> Section:
    """Return the arm's elevation minus the trunk's inclination, or state which data is missing.

    It has no ranges: the error of a sensor on the trunk was not measured, and that of the arm alone would
    give ranges that are too narrow. A pose of the trunk that nobody confirmed is named.
    """
    entry = words["trunk"]
    rows = tuple(
        (
            name,
            format_duration(trunk.shared_s, language),
            *(format_angle(value, language, 1) for value in trunk.percentiles_deg.values()),
        )
        for name, trunk in zip((words["left"], words["right"]), pair.trunk, strict=True)
        if trunk.percentiles_deg
    )
    if not rows:
        return Section("trunk", entry["title"], (entry["missing"],))
    paragraphs = (entry["limit"], entry["no_range"], format_unconfirmed(bodies, "trunk", language))
    shown = tuple(filter(None, paragraphs))
    return Section("trunk", entry["title"], shown, tables=(Table.build(entry, rows),))


# A day compared with an earlier one.


COMPARISON_SCHEMA = "acromion.comparison/1"
_TOLD = ("time_above_60_percent", "elevation_p50_deg")
"""Figures whose change the answer states."""
_LONGEST_OF_TWO = 16


def describe_comparison(
    before: FinishedAnalysis, after: FinishedAnalysis, *, same_subject: bool = False
) -> dict[str, Any]:
    """Return the changes, the verdicts and other differences between the two, for JSON.

    ``same_subject``: a person states that both are from one person, if a code is missing.
    """
    compared = _compare(before, after)
    document: dict[str, Any] = round_all(
        {
            "schema": COMPARISON_SCHEMA,
            "before": describe_source(before),
            "after": describe_source(after),
            "one_person": judge_person((before, after), is_stated=same_subject),
            "figures": [asdict(change) for change in compared.changes],
            "differences": list(compared.differences),
            "source": SOURCE,
        }
    )
    return document


def check_comparable(
    before: FinishedAnalysis,
    after: FinishedAnalysis,
    *,
    same_subject: bool = False,
    mixed_methods: bool = False,
) -> None:
    """Reject two people, the trunk, the same hours of one arm, one analysis twice, and mixed methods.

    The two arms of one shift are not a change either; the report of :func:`build_comparison` states this.

    ``same_subject``: a person states that both are from one person, if a code is missing. ``mixed_methods``:
    allow figures of two methods, or of two versions of one. Raises CannotCompare.
    """
    if "trunk" in {before.subject.side, after.subject.side}:
        raise CannotCompare(why="trunk")
    differences = _compare(before, after).differences
    if before.findings == after.findings:
        raise CannotCompare(why="same")
    if "subject" in differences:
        raise CannotCompare(why="subjects")
    if judge_person((before, after), is_stated=same_subject) == "unknown":
        raise CannotCompare(why="person")
    if "hours" in differences and "side" not in differences:
        raise CannotCompare(why="same hours")
    if has_mixed_methods((before, after)) and not mixed_methods:
        raise CannotCompare(why="methods")


def build_comparison(
    before: FinishedAnalysis, after: FinishedAnalysis, language: Language, *, same_subject: bool = False
) -> Report:
    """Build the report on the change between two analyses."""
    words, common, compared = load_pair_words(language), load_wording(language), _compare(before, after)
    entry, label, sides_of = words["compare"], common["label"], common["side"]
    sides = (PairSide(entry["before"], before), PairSide(entry["after"], after))
    needs_pose = format_unconfirmed(sides, "change", language)
    subjects = [kept.subject for kept in (before, after)]
    codes = dict.fromkeys(
        cut_text(clean_text(subject.subject), _LONGEST_OF_TWO) or label["not_given"] for subject in subjects
    )
    arms = dict.fromkeys(sides_of[subject.side or "unknown"] for subject in subjects)
    sentences = []
    for change in (each for name in _TOLD for each in compared.changes if each.name == name):
        facts, shown = _format_change(change, language), entry["sentence"]
        rounded = mark_rounding(change.before, change.after, change.change, change.name, entry["unrounded"])
        facts["change"] += rounded
        sentences.append(f"{fill(shown[change.name], facts)} {fill(shown[change.verdict], facts)}")
    shares = [
        (side.name, exposure.analysed_s, {int(t.threshold_deg): t.percent for t in exposure.time_above})
        for side in sides
        for exposure in (side.kept.findings.exposure,)
    ]
    table, rows = entry["table"], format_rows(compared.changes, language)
    note = (fill(table["note"], {"source": SOURCE}), format_rounding_note(rows, language))
    changes = Table.build(table, rows, " ".join(filter(None, note)))
    return build_report(
        (before, after),
        describe_comparison(before, after, same_subject=same_subject),
        entry,
        language,
        title=entry["title"],
        version=after.subject.software.version,
        header=(
            Pair(label["subject"], " → ".join(codes)),
            Pair(label["arm"], " → ".join(arms)),
            *(Pair(side.name, format_start(side.kept, language)) for side in sides),
        ),
        verdict=_judge_change(compared, entry),
        sentences=sentences,
        cautions=(
            format_person(judge_person((before, after), is_stated=same_subject), language),
            "" if needs_pose else fill(entry["caution"], {"source": SOURCE}),
            format_cautions(sides, language),
        ),
        figures=(build_two_bars(shares, words["bars"]["note"], language), *build_curves(sides, language)),
        sections=(Section("changes", table["title"], tables=(changes,)), build_sources(sides, language)),
        needs_pose=needs_pose,
    )


def _compare(before: FinishedAnalysis, after: FinishedAnalysis) -> DayComparison:
    return compare_days(_build_day(before), _build_day(after))


def _build_day(kept: FinishedAnalysis) -> ComparedDay:
    findings = kept.findings
    return ComparedDay(
        exposure=findings.exposure,
        method=name_method(findings),
        pose=name_pose(findings),
        side=kept.subject.side,
        verdict=findings.quality.verdict,
        sha256=findings.recording.sha256,
        subject=read_code(kept),
        start=findings.recording.start,
        duration_s=findings.recording.duration_us / MICROSECONDS,
        is_confirmed=is_confirmed(findings),
    )


def _judge_change(compared: DayComparison, words: Words) -> VerdictLine:
    """Return whether the two are comparable."""
    if not compared.differences:
        return VerdictLine("good", words["alike"]["label"], words["alike"]["reason"])
    for name, entry in words["no_two_days"].items():
        if name in compared.differences:
            return VerdictLine("poor", entry["label"], entry["reason"])
    differences = ", ".join(words["difference"][name] for name in compared.differences)
    level = "poor" if "poor" in compared.differences else "caution"
    entry = words["unlike"]
    return VerdictLine(level, entry["label"], fill(entry["reason"], {"differences": differences}))


def _format_change(change: FigureChange, language: Language) -> dict[str, str]:
    return {
        "before": format_figure(change.before, change.name, language),
        "after": format_figure(change.after, change.name, language),
        "change": format_points(change.change, change.name, language, is_signed=True),
        "detectable": format_points(change.detectable, change.name, language),
    }


def format_rows(changes: Iterable[FigureChange], language: Language) -> tuple[tuple[str, ...], ...]:
    """Format each change with its units: name, before, after, change, minimal detectable change, verdict.

    A star marks a change that the printed values do not give because of rounding.
    """
    entry, rows = load_pair_words(language)["compare"]["table"], []
    for change in changes:
        shown = _format_change(change, language)
        shown["change"] += mark_rounding(change.before, change.after, change.change, change.name, "*")
        rows.append((entry["figure"][change.name], *shown.values(), entry["verdict"][change.verdict]))
    return tuple(rows)


def format_rounding_note(rows: Iterable[Sequence[str]], language: Language) -> str:
    """Return the meaning of the star in the rows; empty if no row has one."""
    is_marked = any(cell.endswith("*") for row in rows for cell in row)
    return str(load_pair_words(language)["compare"]["rounded"]) if is_marked else ""
