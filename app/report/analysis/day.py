"""The day as the timeline draws it: minutes with values, stretches left out, stretches missing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from app.report.findings import Findings
from app.report.words.numbers import Clock
from app.report.words.wording import Words
from fusion.conventions import MAIN_THRESHOLD_DEG
from fusion.exposure.types import Episodes, MinuteProfile, PeakWindow
from fusion.recording import MICROSECONDS, Span

MINUTE_S = 60.0
WORST_WINDOW_S = 900
SHORTEST_MARK_S = 30.0
"""Shorter stretches are narrower than a line on the page; they stand in the time account."""

Stretch = tuple[float, float]


@dataclass(frozen=True, slots=True)
class MinuteBand:
    """One minute of the day: P10, median and P90 of the elevation in it."""

    start_s: float
    end_s: float
    low_deg: float
    middle_deg: float
    high_deg: float


@dataclass(frozen=True, slots=True)
class Mark:
    """A stretch without analysed time, and what to call it. What is left out is hatched."""

    start_s: float
    end_s: float
    kind: Literal["left out", "missing"]
    label: str


@dataclass(frozen=True, slots=True)
class Block:
    """A period with a name under the timeline; ``rank`` is 1 to 3 where it has the most time above 60 deg."""

    start_s: float
    end_s: float
    label: str
    rank: int | None


@dataclass(frozen=True, slots=True)
class Day:
    """Everything the timeline needs; ``runs`` are unbroken series of minutes.

    ``longest_start_s`` is when the longest continuous time above 60 deg began; ``blocks`` stand under the
    plot.
    """

    duration_s: float
    clock: Clock
    runs: tuple[tuple[MinuteBand, ...], ...]
    marks: tuple[Mark, ...]
    worst: Stretch | None
    longest_start_s: float | None = None
    blocks: tuple[Block, ...] = ()


def build_timeline(findings: Findings, clock: Clock, words: Words) -> Day:
    """Build the timeline of a recording."""
    duration_s = findings.recording.duration_us / MICROSECONDS
    bands = _build_bands(findings.exposure.minutes, duration_s)
    left_out = merge_spans(findings.exclusions)
    missing = _find_missing([(band.start_s, band.end_s) for band in bands], left_out, duration_s)
    marks = [Mark(a, b, "left out", format_reason(reason, words)) for a, b, reason in left_out]
    marks += [Mark(a, b, "missing", words["day"]["missing"]) for a, b in missing]
    shown = (mark for mark in marks if mark.end_s - mark.start_s >= SHORTEST_MARK_S)
    return Day(
        duration_s=duration_s,
        clock=clock,
        runs=_split_runs(bands),
        marks=tuple(sorted(shown, key=lambda mark: mark.start_s)),
        worst=_find_worst(findings.exposure.peak_windows),
        longest_start_s=_find_longest(findings.exposure.episodes),
    )


def shift_day(day: Day, by_s: float, duration_s: float, clock: Clock, absent: str) -> Day:
    """Move a day onto a longer axis that begins ``by_s`` earlier; time outside it is marked ``absent``."""
    runs = tuple(
        tuple(replace(b, start_s=b.start_s + by_s, end_s=b.end_s + by_s) for b in run) for run in day.runs
    )
    marks = [replace(m, start_s=m.start_s + by_s, end_s=m.end_s + by_s) for m in day.marks]
    outside = ((0.0, by_s), (by_s + day.duration_s, duration_s))
    marks += [Mark(a, b, "missing", absent) for a, b in outside if b - a >= SHORTEST_MARK_S]
    return Day(duration_s, clock, runs, tuple(sorted(marks, key=lambda mark: mark.start_s)), None)


def format_reason(reason: str, words: Words) -> str:
    """Write a reason for leaving time out; an unknown one (a diary's own word) stays as it is."""
    return str(words["reason"].get(reason, reason or words["day"]["left_out"]))


def merge_spans(spans: Iterable[Span]) -> list[tuple[float, float, str]]:
    """Join stretches of one reason that touch or overlap; seconds, in time order."""
    merged: list[tuple[int, int, str]] = []
    for span in sorted(spans, key=lambda s: (s.reason, s.start_us)):
        if merged and merged[-1][2] == span.reason and span.start_us <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(merged[-1][1], span.end_us), span.reason)
        else:
            merged.append((span.start_us, span.end_us, span.reason))
    return sorted((a / MICROSECONDS, b / MICROSECONDS, reason) for a, b, reason in merged)


def _build_bands(minutes: MinuteProfile, duration_s: float) -> list[MinuteBand]:
    kept = np.isfinite(minutes.p50_deg) & (minutes.analysed_s > 0)
    columns = (minutes.start_s, minutes.p10_deg, minutes.p50_deg, minutes.p90_deg)
    return [
        MinuteBand(float(start), min(float(start) + MINUTE_S, duration_s), float(lo), float(mid), float(hi))
        for start, lo, mid, hi in zip(*(column[kept] for column in columns), strict=True)
    ]


def _split_runs(bands: list[MinuteBand]) -> tuple[tuple[MinuteBand, ...], ...]:
    runs: list[list[MinuteBand]] = []
    for band in bands:
        if runs and band.start_s <= runs[-1][-1].end_s + 1e-6:
            runs[-1].append(band)
        else:
            runs.append([band])
    return tuple(tuple(run) for run in runs)


def _find_missing(
    analysed: list[Stretch], left_out: list[tuple[float, float, str]], duration_s: float
) -> list[Stretch]:
    """Give what neither a minute with values nor a stretch left out covers."""
    covered = sorted(analysed + [(a, b) for a, b, _ in left_out])
    missing, reached = [], 0.0
    for start, end in [*covered, (duration_s, duration_s)]:
        if start > reached:
            missing.append((reached, start))
        reached = max(reached, end)
    return missing


def _find_worst(windows: Iterable[PeakWindow]) -> Stretch | None:
    for window in windows:
        if window.length_s == WORST_WINDOW_S and window.start_s is not None and window.percent_above_60:
            return window.start_s, window.start_s + window.length_s
    return None


def _find_longest(episodes: Iterable[Episodes]) -> float | None:
    return next((stay.longest_start_s for stay in episodes if stay.threshold_deg == MAIN_THRESHOLD_DEG), None)
