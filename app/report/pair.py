"""The report of both arms of one shift, and of each arm relative to the trunk.

Pure. :func:`describe_pair` is what ``pair.json`` gives, :func:`build_pair` the report for people; the figures
over the shared time come from :mod:`fusion.arms`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from app.report.charts.day import build_timeline, build_two_days, shift_day
from app.report.figures import round_all
from app.report.findings import Kept
from app.report.model import Chart, Pair, Report, Section, Table, VerdictLine
from app.report.pairs import (
    OnePerson,
    PairSide,
    build_curves,
    build_report,
    build_sources,
    build_two_bars,
    describe_source,
    format_cautions,
    format_person,
    format_start,
    format_unconfirmed,
    is_confirmed,
    load_pair_words,
)
from app.report.words.numbers import (
    NONE,
    Clock,
    format_angle,
    format_angle_range,
    format_duration,
    format_ends,
    format_number,
    format_percent,
    format_range,
)
from app.report.words.subject import LONGEST_CODE, clean_text, cut_text
from app.report.words.wording import Language, Words, fill, load_wording
from fusion.exposure.types import LEAST_RANGED_S
from fusion.recording import MICROSECONDS

if TYPE_CHECKING:
    from fusion.arms import PairedArms, TrunkRelative

SCHEMA = "acromion.pair/1"


@dataclass(frozen=True, slots=True)
class TrunkClock:
    """When the trunk's first sample was taken, seconds after the left arm's, and who states it."""

    offset_s: float
    offset_from: Literal["clocks", "person"]


@dataclass(frozen=True, slots=True)
class ArmPair:
    """Two arms on one clock.

    ``offset_s``: when the right recording's first sample was taken, seconds after the left's; ``offset_from``
    says whether by the devices' clocks or by a person. ``trunk``: each arm relative to the trunk, whose clock
    is ``trunk_clock``, None without one. ``one_person``: whether all of them are of one person.
    """

    left: Kept
    right: Kept
    offset_s: float
    offset_from: Literal["clocks", "person"]
    shared: PairedArms
    trunk: tuple[TrunkRelative, TrunkRelative]
    trunk_clock: TrunkClock | None = None
    one_person: OnePerson = "codes"


def describe_pair(pair: ArmPair) -> dict[str, Any]:
    """Give the figures of both arms over the time they share, for JSON."""
    shared, clock = pair.shared, pair.trunk_clock
    document: dict[str, Any] = round_all(
        {
            "schema": SCHEMA,
            "left": describe_source(pair.left),
            "right": describe_source(pair.right),
            "one_person": pair.one_person,
            "clock": {"offset_s": pair.offset_s, "from": pair.offset_from},
            "trunk_clock": {"offset_s": clock.offset_s, "from": clock.offset_from} if clock else None,
            "shared_s": shared.shared_s,
            "arms": {
                side: {
                    "percentiles_deg": {str(p): deg for p, deg in share.percentiles_deg.items()},
                    "time_above_percent": {f"{c:g}": value for c, value in share.percent_above.items()},
                }
                for side, share in (("left", shared.left), ("right", shared.right))
            },
            "both_above_60_percent": shared.both_above_60_percent,
            "right_to_left": {"time_above_60": shared.ratio_above_60, "elevation_p50": shared.ratio_p50},
            "intervals": {name: [range_.low, range_.high] for name, range_ in shared.intervals.items()},
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
    """Turn both arms into one report."""
    words, common = load_pair_words(language)["pair"], load_wording(language)
    sides = (PairSide(words["left"], pair.left), PairSide(words["right"], pair.right))
    shared, label = pair.shared, common["label"]
    order, sign = ("later", "+") if pair.offset_s > 0 else ("earlier", "−")
    if pair.offset_s == 0:
        order, sign = "together", ""
    offset = format_duration(abs(pair.offset_s), language)
    told_offset = fill(words["clock"][order], {"offset": offset})
    codes = dict.fromkeys(clean_text(side.kept.subject.subject) for side in sides)
    code = " / ".join(cut_text(code, LONGEST_CODE) for code in codes if code)
    bars = [  # over the shared time, so that the page has one value for each arm
        (side.name, shared.shared_s, arm.percent_above)
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
            Pair(words["offset"], sign + offset),
        ),
        verdict=_build_verdict(sides, words, common["verdict"]),
        sentences=_format_answers(pair, words, language),
        cautions=(
            format_person(pair.one_person, language),
            f"{told_offset} {words['clock'][pair.offset_from]}",  # nothing in the signals confirms it
            format_cautions(sides, language),
        ),
        figures=(build_two_bars(bars, words["bars_note"], language), _build_days(pair, sides, language)),
        sections=(
            _build_figures(pair, words["table"], language),
            _build_trunk(pair, words, language),
            *(Section("spread", common["section"]["spread"], figures=(chart,)) for chart in curves),
            build_sources(sides, language),
        ),
        range_note=_format_ranges_note(pair, words["ranges"]),
        needs_pose=format_unconfirmed(sides, "pair", language),
        first_limit=words["limits_with_trunk"] if any(t.percentiles_deg for t in pair.trunk) else "",
    )


def _build_verdict(sides: Sequence[PairSide], words: Words, verdicts: Words) -> VerdictLine:
    """Give the worse of the two, and name the arm of each."""
    levels = [side.kept.findings.quality.verdict for side in sides]
    worst = max(levels, key=("good", "caution", "poor").index)
    told = dict(zip(("left", "right"), (words["verdict"][level] for level in levels), strict=True))
    reason = words["verdict_both"] if len(set(levels)) == 1 else fill(words["verdict_each"], told)
    return VerdictLine(worst, verdicts[worst]["label"], reason)


def _format_answers(pair: ArmPair, words: Words, language: Language) -> tuple[str, ...]:
    entry, shared = words["sentence"], pair.shared
    ratio = format_number(shared.ratio_above_60, 2, language)
    figures = {
        "left": ("left_time_above_60_percent", format_percent(shared.left.percent_above[60], language)),
        "right": ("right_time_above_60_percent", format_percent(shared.right.percent_above[60], language)),
        "both": ("both_above_60_percent", format_percent(shared.both_above_60_percent, language)),
        "left_90": ("left_time_above_90_percent", format_percent(shared.left.percent_above[90], language)),
        "right_90": ("right_time_above_90_percent", format_percent(shared.right.percent_above[90], language)),
        "left_p50": ("left_elevation_p50_deg", format_angle(shared.left.percentiles_deg[50], language)),
        "right_p50": ("right_elevation_p50_deg", format_angle(shared.right.percentiles_deg[50], language)),
        "ratio": ("right_to_left_time_above_60", "" if ratio == NONE else ratio),
    }
    facts = {"shared": format_duration(shared.shared_s, language)}
    for key, (name, value) in figures.items():
        interval = _format_interval(pair, name, language)
        pattern = entry["ranged_inside" if key == "ratio" else "ranged"]  # which stands in brackets already
        facts[key] = fill(pattern, {"value": value, "range": interval}) if value and interval else value
    return tuple(fill(entry[key], facts) for key in ("above", "both", "median"))


def _format_interval(pair: ArmPair, name: str, language: Language) -> str:
    interval = pair.shared.intervals.get(name)
    if name.endswith("_percent"):
        return format_range(interval, language)
    if name.endswith("_deg"):
        return format_angle_range(interval, language)
    return format_ends(interval, 2, language)


def _format_ranges_note(pair: ArmPair, entry: Words) -> str:
    """State what the ranges hold, or that there are none."""
    if pair.shared.shared_s < LEAST_RANGED_S or not pair.shared.intervals:
        return str(entry["short" if pair.shared.shared_s < LEAST_RANGED_S else "none"])
    is_open = not (is_confirmed(pair.left.findings) and is_confirmed(pair.right.findings))
    return f"{entry['known']} {entry['unconfirmed']}" if is_open else str(entry["known"])


def _build_days(pair: ArmPair, sides: Sequence[PairSide], language: Language) -> Chart:
    """Draw both days one above the other on the clock of the one that began first."""
    entry, report_words = load_pair_words(language)["days"], load_wording(language)
    first_s = min(0.0, pair.offset_s)
    begins_s = (0.0 - first_s, pair.offset_s - first_s)
    lasts_s = [side.kept.findings.recording.duration_us / MICROSECONDS for side in sides]
    whole_s = max(begin + lasts for begin, lasts in zip(begins_s, lasts_s, strict=True))
    clock = Clock(Clock(pair.left.findings.recording.start, language).at(first_s), language)
    days = []
    for side, begin_s in zip(sides, begins_s, strict=True):
        own = build_timeline(side.kept.findings, clock, report_words)
        days.append((side.name, shift_day(own, begin_s, whole_s, clock, entry["absent"])))
    return build_two_days(days, entry, report_words)


def _build_figures(pair: ArmPair, entry: Words, language: Language) -> Section:
    shared, arms = pair.shared, (pair.shared.left, pair.shared.right)
    name = str(load_wording(language)["ranges"]["name"]["known"])
    ranges_label, rows = name[0].upper() + name[1:], []

    def add(label: str, cells: Iterable[str], names: Iterable[str]) -> None:
        """Add a row of figures, and the row of their ranges where any is known."""
        rows.append((label, *cells))
        ranges = tuple(_format_interval(pair, name, language) if name else "" for name in names)
        rows.extend([(ranges_label, *ranges)] if any(ranges) else [])

    def name_arms(name: str, ratio: str) -> tuple[str, str, str]:
        return f"left_{name}", f"right_{name}", f"right_to_left_{ratio}"

    for c in shared.left.percent_above:
        above = (format_percent(arm.percent_above[c], language) for arm in arms)
        ratio = format_number(shared.ratio_above_60 if c == 60 else None, 2, language)
        names = name_arms(f"time_above_{c:g}_percent", f"time_above_{c:g}")
        add(fill(entry["above"], {"threshold": f"{c:g}"}), (*above, ratio), names)
    for p in shared.left.percentiles_deg:
        angles = (format_angle(arm.percentiles_deg[p], language, 1) for arm in arms)
        ratio = format_number(shared.ratio_p50 if p == 50 else None, 2, language)
        names = name_arms(f"elevation_p{p}_deg", f"elevation_p{p}")
        add(fill(entry["percentile"], {"p": str(p)}), (*angles, ratio), names)
    both = (format_percent(shared.both_above_60_percent, language), NONE, NONE)
    add(entry["both"], both, ("both_above_60_percent", "", ""))
    table = Table.lay(entry, rows, entry["note"])
    return Section("figures", entry["title"], tables=(table,))


def _build_trunk(pair: ArmPair, words: Words, language: Language) -> Section:
    """Give the arm's elevation less the trunk's inclination, or state what is missing for it."""
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
    table = Table.lay(entry, rows)
    return Section("trunk", entry["title"], (entry["limit"],), tables=(table,))
