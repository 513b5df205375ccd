"""The answer in three plain sentences; an interval only where the exposure carries one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from app.report.clock import Clock
from app.report.day import WORST_WINDOW_S
from app.report.numbers import (
    NARROW,
    SHORTEST_RATED_S,
    format_clock,
    format_duration,
    format_duration_range,
    format_elapsed,
    format_number,
    format_percent,
    format_range,
    format_rate,
)
from app.report.wording import Language, Words, fill
from fusion.exposure.types import Entries, Episodes, Exposure, Interval

MAIN_THRESHOLD_DEG = 60
WORST_RANGE = f"worst_{WORST_WINDOW_S // 60}_min_above_60_percent"


@dataclass(frozen=True, slots=True)
class Teller:
    """What every sentence needs: the words, the language, the clock and the name of the arm."""

    words: Words
    language: Language
    clock: Clock
    arm: str


def tell_answers(exposure: Exposure, teller: Teller) -> tuple[str, str, str]:
    """Say how long, how often and when the arm was raised above 60 deg."""
    return (
        _tell_time_above(exposure, teller),
        _tell_entries(exposure, teller),
        _tell_worst_window(exposure, teller),
    )


def _tell_time_above(exposure: Exposure, teller: Teller) -> str:
    above = next(t for t in exposure.time_above if t.threshold_deg == MAIN_THRESHOLD_DEG)
    facts = {
        "arm": teller.arm,
        "above": format_duration(above.duration_s, teller.language),
        "analysed": format_duration(exposure.analysed_s, teller.language),
        "percent": format_percent(above.percent, teller.language),
        "range": format_range(above.interval, teller.language),
    }
    return fill(teller.words["sentence"]["time_above"], facts)


def _tell_entries(exposure: Exposure, teller: Teller) -> str:
    entries = next(e for e in exposure.entries if e.threshold_deg == MAIN_THRESHOLD_DEG)
    episodes = next(e for e in exposure.episodes if e.threshold_deg == MAIN_THRESHOLD_DEG)
    is_rated = exposure.analysed_s >= SHORTEST_RATED_S
    facts = {
        "arm": teller.arm,
        "count": format_number(entries.count, 0, teller.language),
        "per_hour": format_rate(entries.per_hour, teller.language) if is_rated else "",
        "longest": _tell_longest(episodes, exposure.intervals, teller),
    }
    return fill(teller.words["sentence"][_choose_entries(entries)], facts)


def _choose_entries(entries: Entries) -> str:
    return {0: "entries_none", 1: "entries_one"}.get(entries.count, "entries_many")


def _tell_longest(episodes: Episodes, ranges: Mapping[str, Interval], teller: Teller) -> str:
    """Say how long the longest stay was, with its range, and, where known, when it began."""
    if not episodes.longest_s:
        return ""
    interval = ranges.get(f"episodes_above_{MAIN_THRESHOLD_DEG}_longest_s")
    longest = format_duration(episodes.longest_s, teller.language)
    if interval is not None:
        told = {"longest": longest, "range": format_duration_range(interval, teller.language)}
        longest = fill(teller.words["sentence"]["longest_range"], told)
    if episodes.longest_start_s is None:
        return longest
    moment = teller.clock.at(episodes.longest_start_s)
    key = "longest_at" if moment else "longest_after"
    time = format_clock(moment, teller.language) if moment else format_elapsed(episodes.longest_start_s)
    return fill(teller.words["sentence"][key], {"longest": longest, "time": time})


def _tell_worst_window(exposure: Exposure, teller: Teller) -> str:
    window = next((w for w in exposure.peak_windows if w.length_s == WORST_WINDOW_S), None)
    if window is None or window.start_s is None:
        return str(teller.words["sentence"]["window_absent"])
    if not window.percent_above_60:
        return str(teller.words["sentence"]["window_zero"])
    facts = {
        "start": teller.clock.tell(window.start_s),
        "end": teller.clock.tell(window.start_s + window.length_s),
        "percent": format_percent(window.percent_above_60, teller.language),
        "range": format_range(exposure.intervals.get(WORST_RANGE), teller.language),
    }
    key = "window_elapsed" if teller.clock.start is None else "window"
    return fill(teller.words["sentence"][key], facts).replace(" – ", f"{NARROW}–{NARROW}")
