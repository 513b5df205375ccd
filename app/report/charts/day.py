"""The day's timeline as SVG: each minute's P10 to P90 and median, and the time without analysis.

The 15 minutes with the most time above 60 deg are vermillion and bracketed. A triangle marks the longest
continuous time. Excluded and untrusted time is hatched; missing time stays white between dotted edges. Prints
in grey lose nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from acromion.app.report.charts import svg
from acromion.app.report.charts.svg import GUIDES_DEG, NARROW, Plot, Span
from acromion.app.report.findings import Findings
from acromion.app.report.model import Chart
from acromion.app.report.words.numbers import Clock, format_angle, format_duration, format_percent
from acromion.app.report.words.wording import Words, fill, join_clauses
from acromion.fusion.caveats import Caveat
from acromion.fusion.conventions import MAIN_THRESHOLD_DEG
from acromion.fusion.exposure.types import MinuteProfile
from acromion.fusion.recording import MICROSECONDS, find_uncovered, join_overlapping
from acromion.fusion.recording import Span as LeftOut

MINUTE_S = 60.0
WORST_WINDOW_S = 900
SHORTEST_MARK_S = 30.0
"""Shorter stretches are narrower than a line on the page; the time account includes them."""
LONG_S = 7200.0
"""Above two hours minutes are narrow: a thinner median keeps the band visible."""

_LANE_PX = 22.0
_DATE_PX = 14.0
"""Height of the periods below the plot."""
_SHORTEST_NAME = 5
"""Minimum number of characters of a name, including its rank, that is worth writing."""

_OUTER = f'{svg.BAND} fill-opacity="0.45"'
_TICK_STEPS_S = (60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400)

# Data of the day.


@dataclass(frozen=True, slots=True)
class MinuteBand:
    """One minute of the day: P10, median and P90 of its elevation."""

    start_s: float
    end_s: float
    low_deg: float
    middle_deg: float
    high_deg: float


Run = tuple[MinuteBand, ...]
"""Consecutive minutes without a gap."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A stretch without analysed time, and its label. Excluded and untrusted time is hatched."""

    start_s: float
    end_s: float
    kind: Literal["left out", "missing"]
    label: str


@dataclass(frozen=True, slots=True)
class Block:
    """A named period below the timeline.

    ``rank``: 1 to 3 for those with the most time above 60 deg; 0 if their ranges overlap; None for others.
    """

    start_s: float
    end_s: float
    label: str
    rank: int | None


@dataclass(frozen=True, slots=True)
class Day:
    """All data of the timeline.

    ``longest_start_s``: start of the longest episode above 60 deg; ``blocks`` are below the plot.
    """

    duration_s: float
    clock: Clock
    runs: tuple[Run, ...]
    marks: tuple[Mark, ...]
    worst: Span | None
    longest_start_s: float | None = None
    blocks: tuple[Block, ...] = ()


def build_timeline(findings: Findings, clock: Clock, words: Words) -> Day:
    """Build the timeline of a recording."""
    duration_s = findings.recording.duration_us / MICROSECONDS
    runs = _build_runs(findings.exposure.minutes, duration_s)
    doubted = (
        LeftOut(round(a * MICROSECONDS), round((b - a) * MICROSECONDS), "untrusted")
        for flag in findings.quality.flags
        if flag.code == Caveat.UNTRUSTED
        for a, b in flag.spans_s
    )
    left_out = merge_spans((*findings.exclusions, *doubted))
    marks = [Mark(a, b, "left out", format_reason(reason, words)) for a, b, reason in left_out]
    known = [(b.start_s, b.end_s) for run in runs for b in run] + [(a, b) for a, b, _ in left_out]
    missing = find_uncovered(known, 0.0, duration_s, 0.0)
    marks += [Mark(a, b, "missing", words["day"]["missing"]) for a, b in missing]
    shown = (mark for mark in marks if mark.end_s - mark.start_s >= SHORTEST_MARK_S)
    worst = (
        (w.start_s, w.start_s + w.length_s)
        for w in findings.exposure.peak_windows
        if w.length_s == WORST_WINDOW_S and w.start_s is not None and w.percent_above_60
    )
    stays = (e for e in findings.exposure.episodes if e.threshold_deg == MAIN_THRESHOLD_DEG)
    return Day(
        duration_s=duration_s,
        clock=clock,
        runs=runs,
        marks=tuple(sorted(shown, key=lambda mark: mark.start_s)),
        worst=next(worst, None),
        longest_start_s=next((stay.longest_start_s for stay in stays), None),
    )


def shift_day(day: Day, by_s: float, duration_s: float, clock: Clock, absent: str) -> Day:
    """Move a day to a longer axis that starts ``by_s`` earlier; mark time outside the day as ``absent``."""
    runs = tuple(
        tuple(replace(b, start_s=b.start_s + by_s, end_s=b.end_s + by_s) for b in run) for run in day.runs
    )
    marks = [replace(m, start_s=m.start_s + by_s, end_s=m.end_s + by_s) for m in day.marks]
    outside = ((0.0, by_s), (by_s + day.duration_s, duration_s))
    marks += [Mark(a, b, "missing", absent) for a, b in outside if b - a >= SHORTEST_MARK_S]
    return Day(duration_s, clock, runs, tuple(sorted(marks, key=lambda mark: mark.start_s)), None)


def format_reason(reason: str, words: Words) -> str:
    """Return the reason for an exclusion in words; an unknown one (a word of the diary) stays unchanged."""
    return str(words["reason"].get(reason) or reason or fill(words["day"]["left_out"], {"reasons": ""}))


def merge_spans(spans: Iterable[LeftOut]) -> list[tuple[float, float, str]]:
    """Join stretches with the same reason that touch or overlap; in s, in order of time."""
    by_reason: dict[str, list[tuple[int, int]]] = {}
    for span in spans:
        by_reason.setdefault(span.reason, []).append((span.start_us, span.end_us))
    return sorted(
        (start_us / MICROSECONDS, end_us / MICROSECONDS, reason)
        for reason, of_reason in by_reason.items()
        for start_us, end_us in join_overlapping(of_reason)
    )


def _build_runs(minutes: MinuteProfile, duration_s: float) -> tuple[Run, ...]:
    kept = np.isfinite(minutes.p50_deg) & (minutes.analysed_s > 0)
    columns = (minutes.start_s, minutes.p10_deg, minutes.p50_deg, minutes.p90_deg)
    runs: list[list[MinuteBand]] = []
    for start_s, *angles_deg in zip(*(column[kept].tolist() for column in columns), strict=True):
        if not runs or start_s > runs[-1][-1].end_s + 1e-6:
            runs.append([])
        runs[-1].append(MinuteBand(start_s, min(start_s + MINUTE_S, duration_s), *angles_deg))
    return tuple(map(tuple, runs))


# With words and table.


@dataclass(frozen=True, slots=True)
class DayLabels:
    """Words of the timeline; ``worst`` and ``longest`` are beside their marks in the legend.

    ``left_out`` has a place for those of the ``reasons`` whose marks are too narrow for their labels.
    """

    title: str
    description: str
    band: str
    median: str
    left_out: str
    missing: str
    worst: str = ""
    longest: str = ""
    inner: str = ""
    """P25 to P75, if a lighter band surrounds it."""
    reasons: frozenset[str] = frozenset()


def build_day(findings: Findings, blocks: tuple[Block, ...], clock: Clock, words: Words) -> Chart:
    """Build the timeline of the day, with the periods below it."""
    exposure, entry, language = findings.exposure, words["day"], clock.language
    day = replace(build_timeline(findings, clock, words), blocks=blocks)
    percent = next((w.percent_above_60 for w in exposure.peak_windows if w.length_s == WORST_WINDOW_S), None)
    stay = next(e for e in exposure.episodes if e.threshold_deg == MAIN_THRESHOLD_DEG)
    marks = (f"{m.label}, {clock.format_range(m.start_s, m.end_s)}" for m in day.marks)
    facts = {
        "start": clock.format(0),
        "end": clock.format(day.duration_s),
        **{f"p{p}": format_angle(exposure.percentiles_deg.get(p), language) for p in (10, 50, 90)},
        "marks": join_clauses(marks, language),
    }
    labels = replace(
        build_day_labels(entry["title"], fill(entry["alternative"], facts), words),
        worst=fill(entry["worst"], {"percent": format_percent(percent, language)}),
        longest=fill(entry["longest"], {"duration": format_duration(stay.longest_s, language)}),
    )
    chart = Chart.draw(
        (labels.title, labels.description),
        lambda _, width_px: draw_day(day, labels, width_px),
        entry["columns"],
        (_format_band(band, clock) for run in day.runs for band in run),
    )
    return replace(chart, table=replace(chart.table, note=entry["table_note"]))


def build_two_days(days: Sequence[tuple[str, Day]], entry: Words, words: Words) -> Chart:
    """Build two days, one above the other, on one clock; each has its name at the top left."""
    _, last = days[-1]
    clock = last.clock
    facts = {"start": clock.format(0), "end": clock.format(last.duration_s)}
    labels = build_day_labels(entry["title"], fill(entry["alternative"], facts), words)
    return Chart.draw(
        (labels.title, labels.description),
        lambda _, width_px: _draw_two_days(days, labels, width_px),
        entry["columns"],
        ((name, *_format_band(band, clock)) for name, day in days for run in day.runs for band in run),
    )


def build_day_labels(title: str, description: str, words: Words) -> DayLabels:
    """Return the words of a timeline; its legend is the same in every report."""
    band, median, left_out, missing = (
        words["day"][name] for name in ("band", "median", "left_out", "missing")
    )
    reasons = frozenset(words["reason"].values())
    return DayLabels(title, description, band, median, left_out, missing, reasons=reasons)


def _format_band(band: MinuteBand, clock: Clock) -> tuple[str, ...]:
    angles_deg = (band.low_deg, band.middle_deg, band.high_deg)
    return clock.format(band.start_s), *(format_angle(deg, clock.language) for deg in angles_deg)


# One day, or two.


def draw_day(day: Day, labels: DayLabels, width_px: float) -> str:
    """Draw elevation through the day: each minute's P10 to P90, its median, the tasks, the gaps."""
    key = f"day{width_px:.0f}"
    plot = _lay_out(day, 36, width_px - 4, 22, 138 if width_px > NARROW else 190)
    axis = replace(plot, bottom_px=plot.bottom_px + (_LANE_PX if day.blocks else 0.0))
    named = _name_reasons(labels, (day,), plot)
    legend, height = _draw_legend((day,), named, axis.bottom_px + 38 + _measure_dates(day), key, width_px)
    body = [
        svg.define_hatch(key),
        *_draw_panel(day, plot, key),
        *(stroke for block in day.blocks for stroke in _draw_block(block, plot)),
        *_draw_time_axis(day, axis),
    ]
    if day.worst is not None:
        start, end = map(plot.x, day.worst)
        body.append(_draw_bracket(start, end, plot.top_px))
    if day.longest_start_s is not None:  # above the bracket
        body.append(_draw_triangle(plot.x(day.longest_start_s), plot.top_px - 9))
    return svg.picture(width_px, height, key, (labels.title, labels.description), body + legend)


def _draw_two_days(days: Sequence[tuple[str, Day]], labels: DayLabels, width_px: float) -> str:
    key, height = f"days{width_px:.0f}", 120.0 if width_px > NARROW else 130.0
    body, plot = [svg.define_hatch(key)], Plot(0, 0)
    top_deg = _find_top([day for _, day in days])
    for rank, (name, day) in enumerate(days):
        top = 18 + rank * (height + 28)
        plot = _lay_out(day, 32, width_px - 4, top, top + height, top_deg)
        body += [*_draw_panel(day, plot, key), svg.text(plot.left_px, top - 6, name, "strong")]
    every = [day for _, day in days]
    named = _name_reasons(labels, every, plot)
    below_px = plot.bottom_px + 38 + _measure_dates(every[-1])
    legend, bottom = _draw_legend(every, named, below_px, key, width_px)
    body += _draw_time_axis(every[-1], plot) + legend
    return svg.picture(width_px, bottom, key, (labels.title, labels.description), body)


def _lay_out(
    day: Day, left_px: float, right_px: float, top_px: float, bottom_px: float, top_deg: float = 180.0
) -> Plot:
    across = (0.0, max(day.duration_s, 1.0))
    return Plot(left_px, right_px, top_px, bottom_px, across, (0.0, top_deg))


def _find_top(days: Sequence[Day]) -> float:
    """Return the end of one scale for several days: 120 deg, or 180 deg if a band is higher."""
    return 120.0 if all(b.high_deg <= 120.0 for day in days for run in day.runs for b in run) else 180.0


# Several days overlaid.


@dataclass(frozen=True, slots=True)
class Overlay:
    """Several days on one clock.

    ``day``: P10 to P90 and median per quarter hour, missing if there are too few days; ``inner``: P25 to P75,
    in the same runs. ``counts``: start and end of each quarter hour in s on the axis, and its number of days,
    of ``days`` in total.
    """

    name: str
    day: Day
    inner: tuple[Run, ...]
    counts: tuple[tuple[float, float, int], ...]
    days: int
    counts_label: str


def draw_overlays(panels: Sequence[Overlay], labels: DayLabels, width_px: float) -> str:
    """Draw overlaid days, two panels side by side if there is space.

    Below each axis is the number of days behind each time.
    """
    key, across = f"over{width_px:.0f}", 2 if len(panels) > 1 and width_px > NARROW else 1
    room = (width_px + 16) / across - 16
    body, bottom = [svg.define_hatch(key)], 0.0
    top_deg = _find_top([panel.day for panel in panels])
    for rank, overlay in enumerate(panels):
        left, top = (rank % across) * (room + 16), 24 + (rank // across) * 224.0
        plot, day = _lay_out(overlay.day, left + 36, left + room - 4, top, top + 130, top_deg), overlay.day
        body += [
            svg.text(left, top - 13, overlay.name, "strong"),
            *_draw_guides(plot),
            *(stroke for mark in day.marks for stroke in _draw_mark(mark, plot, key)),
            *(_draw_band(run, plot, _OUTER) for run in day.runs),
            *(_draw_band(run, plot, svg.BAND) for run in overlay.inner),
            *(_draw_median(run, plot, 1.8) for run in day.runs),
            *_draw_time_axis(day, plot),
            *_draw_counts(overlay, plot),
        ]
        bottom = plot.bottom_px + 76
    legend, height = _draw_legend([panel.day for panel in panels], labels, bottom, key, width_px)
    return svg.picture(width_px, height, key, (labels.title, labels.description), body + legend)


def _draw_counts(overlay: Overlay, plot: Plot) -> list[str]:
    """Draw a bar for each quarter hour; its height is the share of all days."""
    bottom = plot.bottom_px + 56
    body = [svg.line(plot.left_px, bottom, plot.right_px, bottom, svg.RULE)]
    for start_s, end_s, days in overlay.counts:
        x, height = plot.x(start_s), 18.0 * days / max(overlay.days, 1)
        place = (x, bottom - height, max(plot.x(end_s) - x - 0.5, 0.5), height)
        body.append(svg.rect(*place, f'class="mark" fill="{svg.RAMP[2]}"'))
    body.append(svg.text(plot.left_px - 5, bottom, str(overlay.days), "soft", "end"))
    return [*body, svg.text(plot.left_px, bottom - 22, overlay.counts_label)]


# Parts of a panel.


def _draw_panel(day: Day, plot: Plot, key: str) -> list[str]:
    """Draw minutes as steps, because a value belongs to its whole minute, with the gaps around them."""
    weight = 0.9 if plot.across[1] > LONG_S else 1.5
    body = [
        *_draw_guides(plot),
        *(stroke for mark in day.marks for stroke in _draw_mark(mark, plot, key)),
    ]
    for run in day.runs:
        body += [_draw_band(run, plot, svg.BAND), _draw_median(run, plot, weight)]
    return body + [stroke for mark in day.marks for stroke in _draw_mark_label(mark, plot)]


def _draw_guides(plot: Plot) -> list[str]:
    body = []
    for degrees in (deg for deg in (0, *GUIDES_DEG, 120, 180) if deg <= plot.upwards[1]):
        y = plot.y(degrees)
        if degrees in GUIDES_DEG:
            weight = "1" if degrees == 60 else "0.7"
            dash = f'{svg.RULE} stroke-width="{weight}" stroke-dasharray="3 3"'
            body.append(svg.line(plot.left_px, y, plot.right_px, y, dash))
        kind = "strong" if degrees == 60 else "soft"
        body.append(svg.text(plot.left_px - 5, y + 3.8, f"{degrees}°", kind, "end"))
    return [*body, plot.draw_baseline()]


def _draw_mark(mark: Mark, plot: Plot, key: str) -> list[str]:
    x, end = plot.x(mark.start_s), plot.x(mark.end_s)
    place = (x, plot.top_px, end - x, plot.bottom_px - plot.top_px)
    ground = svg.rect(*place, svg.PLATE)
    if mark.kind == "left out":
        return [ground, svg.rect(*place, f'fill="url(#{key}-h)" fill-opacity="0.55"')]
    edge = f'{svg.RULE} stroke-width="0.7" stroke-dasharray="1.5 2"'
    return [ground, *(svg.line(at, plot.top_px, at, plot.bottom_px, edge) for at in (x, end))]


def _draw_mark_label(mark: Mark, plot: Plot) -> list[str]:
    """Draw the label of a stretch: horizontal if it fits, vertical in a narrow one, else none."""
    x, room = (plot.x(mark.start_s) + plot.x(mark.end_s)) / 2, plot.x(mark.end_s) - plot.x(mark.start_s)
    length = svg.estimate_width(mark.label) + 8
    y = (plot.top_px + plot.bottom_px) / 2
    words = svg.text(x, y + 3.8, mark.label, "ink", "middle")
    if room >= length:
        return [svg.rect(x - length / 2, y - 8, length, 16, svg.PLATE), words]
    if room < 11.5 or length > plot.bottom_px - plot.top_px:
        return []
    turned = f'<g transform="rotate(-90 {svg.number(x)} {svg.number(y)})">'
    return [turned, svg.rect(x - length / 2, y - 5.5, length, 11, svg.PLATE), words, "</g>"]


def _draw_band(run: Run, plot: Plot, attributes: str) -> str:
    last = run[-1]
    back = "".join(
        f"V{svg.number(plot.y(band.low_deg))}H{svg.number(plot.x(band.start_s))}" for band in reversed(run)
    )
    upper = _step_through(run, [band.high_deg for band in run], plot)
    lower = f"{svg.number(plot.x(last.end_s))} {svg.number(plot.y(last.low_deg))}{back}"
    return svg.path(f"M{upper}L{lower}Z", attributes)


def _draw_median(run: Run, plot: Plot, weight: float) -> str:
    middle = _step_through(run, [band.middle_deg for band in run], plot)
    return svg.path(f"M{middle}", f'{svg.CURVE} stroke-width="{weight}" stroke-linejoin="round"')


def _step_through(run: Run, degrees: Sequence[float], plot: Plot) -> str:
    steps = [f"{svg.number(plot.x(run[0].start_s))} {svg.number(plot.y(degrees[0]))}"]
    for band, value in zip(run, degrees, strict=True):
        steps.append(f"V{svg.number(plot.y(value))}H{svg.number(plot.x(band.end_s))}")
    return "".join(steps)


def _draw_time_axis(day: Day, plot: Plot) -> list[str]:
    """Draw ticks at the finest round step whose labels fit, from the first whole hour."""
    most = int((plot.right_px - plot.left_px) // (svg.estimate_width("00:00:00") + 10))
    fitting = (step for step in _TICK_STEPS_S if day.duration_s / step <= max(most, 1))
    step = next(fitting, _TICK_STEPS_S[-1])
    body, at, date = [], day.clock.seconds_to_whole_hour() % step, ""
    while at <= day.duration_s:
        x, label = plot.x(at), day.clock.format_tick(at)
        on = day.clock.format_offset(at) or day.clock.format_day(at)
        half = svg.estimate_width(label) / 2
        place = min(max(x, half), plot.right_px + 4 - half)
        body.append(svg.line(x, plot.bottom_px, x, plot.bottom_px + 4, svg.RULE))
        body.append(svg.text(place, plot.bottom_px + 16, label, "soft", "middle"))
        if on != date:  # below the first time of each date, and below a time that the clock shows twice
            half = svg.estimate_width(on) / 2
            place = min(max(x, half), plot.right_px + 4 - half)
            body.append(svg.text(place, plot.bottom_px + 16 + _DATE_PX, on, "soft", "middle"))
        at, date = at + step, on
    return body


def _measure_dates(day: Day) -> float:
    """Return the height of the dates below the time axis; 0 for a recording of one date and one offset."""
    offsets = {at.utcoffset() for at in map(day.clock.at, (0.0, day.duration_s)) if at}
    return _DATE_PX if day.clock.format_day(0.0) or len(offsets) > 1 else 0.0


def _draw_block(block: Block, plot: Plot) -> list[str]:
    """Draw a period below the plot, with its rank and as much of its name as fits."""
    x, end, y = plot.x(block.start_s), plot.x(block.end_s), plot.bottom_px + 2
    kind, colour = ("bar edge", svg.RAMP[0]) if block.rank is not None else ("paper edge", svg.PAPER)
    frame = f'class="{kind}" fill="{colour}" stroke="{svg.SOFT}"'
    rank = str(block.rank or "")
    shown = svg.shorten(f"{rank} {block.label}".strip(), end - x - 4)
    if len(shown) < _SHORTEST_NAME:
        shown = rank if svg.estimate_width(rank) <= end - x else ""
    return [
        svg.rect(x, y, max(end - x, 1.0), _LANE_PX - 4, frame),
        svg.text((x + end) / 2, y + 13, shown, "ink" if block.rank is None else "onlight", "middle"),
    ]


def _draw_bracket(start_px: float, end_px: float, bottom_px: float) -> str:
    """Draw a bracket over the 15 minutes with the most time above 60 deg."""
    low, high = svg.number(bottom_px), svg.number(bottom_px - 6)
    commands = f"M{svg.number(start_px)} {low}V{high}H{svg.number(end_px)}V{low}"
    return svg.path(commands, f'{svg.ACCENT_CURVE} stroke-width="2"')


def _draw_triangle(x_px: float, bottom_px: float) -> str:
    commands = f"M{svg.number(x_px)} {svg.number(bottom_px)}l-5 -9h10Z"
    return svg.path(commands, f'class="mark" fill="{svg.RAMP[3]}"')


def _name_reasons(labels: DayLabels, days: Sequence[Day], plot: Plot) -> DayLabels:
    """Name the known reasons of the time left out that no label in the plot names."""
    marks = [mark for day in days for mark in day.marks]
    drawn = {mark.label for mark in marks if _draw_mark_label(mark, plot)}
    others = dict.fromkeys(mark.label for mark in marks if mark.label in labels.reasons - drawn)
    return replace(labels, left_out=fill(labels.left_out, {"reasons": ", ".join(others)}))


def _draw_legend(
    days: Sequence[Day], labels: DayLabels, y_px: float, key: str, width_px: float
) -> tuple[list[str], float]:
    """Draw a legend of the parts in use; return its strokes and the end of the drawing."""
    kinds = {mark.kind for day in days for mark in day.marks}
    median = f'{svg.MEDIAN} stroke-width="1.8"'

    def box(attributes: str) -> Callable[[float, float], str]:
        return lambda x, y: svg.rect(x, y - 9, 15, 10, attributes)

    keys: list[tuple[bool, str, Callable[[float, float], str]]] = [
        (True, labels.band, box(_OUTER if labels.inner else svg.BAND)),
        (True, labels.inner, box(svg.BAND)),
        (True, labels.median, lambda x, y: svg.line(x, y - 4, x + 15, y - 4, median)),
        (
            "left out" in kinds,
            labels.left_out,
            box(f'class="edge" fill="url(#{key}-h)" stroke="{svg.SOFT}" stroke-width="0.5"'),
        ),
        ("missing" in kinds, labels.missing, box(f'{svg.EDGE} stroke-dasharray="1.5 2"')),
        (days[0].worst is not None, labels.worst, lambda x, y: _draw_bracket(x, x + 15, y)),
        (days[0].longest_start_s is not None, labels.longest, lambda x, y: _draw_triangle(x + 7, y)),
    ]
    body, x = [], 0.5
    for is_drawn, words, draw in keys:
        if not is_drawn or not words:
            continue
        first, *others = svg.break_lines(words, width_px - 20)
        length = 20 + svg.estimate_width(first) + 8
        if x > 1 and x + length > width_px:
            x, y_px = 0.5, y_px + 18
        body += [draw(x, y_px), svg.text(x + 20, y_px, first)]
        body += [svg.text(x + 20, y_px + 15 * k, line) for k, line in enumerate(others, 1)]
        x, y_px = x + length, y_px + 15 * len(others)
    return body, y_px + 6
