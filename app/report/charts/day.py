"""The day's timeline as SVG: each minute's P10 to P90 and median, and what was not analysed.

The 15 minutes with the most time above 60 deg are vermillion and bracketed, the longest continuous time has a
triangle, excluded time is hatched, missing time stays white between dotted edges: grey paper loses nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from app.report.analysis.day import Block, Day, Mark, MinuteBand
from app.report.charts import svg
from app.report.charts.svg import NARROW

TOP_DEG = 180.0
GUIDES_DEG = (30, 60, 90)
LONG_S = 7200.0
"""Beyond two hours minutes stand so close that a thinner median leaves the band to be seen."""

_LANE_PX = 22.0
"""Height of the periods under the plot."""
_SHORTEST_NAME = 5
"""Signs of a name, its rank included, that are worth writing."""

_INNER = f'class="band" fill="{svg.RAMP[1]}"'
_OUTER = f'{_INNER} fill-opacity="0.45"'
_TICK_STEPS_S = (60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400)


@dataclass(frozen=True, slots=True)
class DayLabels:
    """The words of the timeline; ``worst`` and ``longest`` stand beside their marks in the legend."""

    title: str
    description: str
    band: str
    median: str
    left_out: str
    missing: str
    worst: str = ""
    longest: str = ""
    inner: str = ""
    """P25 to P75, where the band is drawn lighter around it."""


@dataclass(frozen=True, slots=True)
class _Plot:
    """Where seconds and degrees fall on the sheet."""

    left_px: float
    right_px: float
    top_px: float
    bottom_px: float
    duration_s: float

    def x(self, time_s: float) -> float:
        share = min(max(time_s / self.duration_s, 0.0), 1.0)
        return self.left_px + (self.right_px - self.left_px) * share

    def y(self, angle_deg: float) -> float:
        return self.bottom_px - (self.bottom_px - self.top_px) * angle_deg / TOP_DEG


def draw_day(day: Day, labels: DayLabels, width_px: float) -> str:
    """Draw elevation through the day: each minute's P10 to P90, its median, the tasks, the gaps."""
    key = f"day{width_px:.0f}"
    plot = _Plot(36, width_px - 4, 22, 156 if width_px > NARROW else 190, max(day.duration_s, 1.0))
    axis = replace(plot, bottom_px=plot.bottom_px + (_LANE_PX if day.blocks else 0.0))
    legend, height = _draw_day_legend((day,), labels, axis.bottom_px + 38, key, width_px)
    body = [
        svg.define_hatch(key),
        *_draw_panel(day, plot, key),
        *(stroke for block in day.blocks for stroke in _draw_block(block, plot)),
        *_draw_time_axis(day, axis),
        *_draw_bracket(day, plot),
        *_draw_longest(day, plot),
        *legend,
    ]
    return svg.picture(width_px, height, key, (labels.title, labels.description), body)


def draw_two_days(days: Sequence[tuple[str, Day]], labels: DayLabels, width_px: float) -> str:
    """Draw days one above the other, on one clock; each is named at its top left."""
    key = f"days{width_px:.0f}"
    height = 120.0 if width_px > NARROW else 130.0
    body, plot = [svg.define_hatch(key)], _Plot(32, width_px - 4, 0, 0, 1.0)
    for rank, (name, day) in enumerate(days):
        top = 18 + rank * (height + 28)
        plot = _Plot(32, width_px - 4, top, top + height, max(day.duration_s, 1.0))
        body += _draw_panel(day, plot, key)
        body.append(svg.text(plot.left_px, top - 6, name, "strong"))
    shown = tuple(day for _, day in days)
    legend, bottom = _draw_day_legend(shown, labels, plot.bottom_px + 38, key, width_px)
    body += _draw_time_axis(days[-1][1], plot) + legend
    return svg.picture(width_px, bottom, key, (labels.title, labels.description), body)


@dataclass(frozen=True, slots=True)
class Overlay:
    """Several days on one clock.

    Attributes
    ----------
    name
        Of which arm, say.
    day
        P10 to P90 and median by quarter hour; missing where too few days are.
    inner
        P25 to P75, in the same runs.
    counts
        Quarter hours with the days that they rest upon: start and end, s on the axis, and days.
    days
        All days.
    counts_label
        Words of the lane of counts.
    """

    name: str
    day: Day
    inner: tuple[tuple[MinuteBand, ...], ...]
    counts: tuple[tuple[float, float, int], ...]
    days: int
    counts_label: str


def draw_overlays(panels: Sequence[Overlay], labels: DayLabels, width_px: float) -> str:
    """Draw days laid over one another, two panels beside one another where there is room.

    Below each axis stand the days that each time rests upon.
    """
    key, across = f"over{width_px:.0f}", 2 if len(panels) > 1 and width_px > NARROW else 1
    room = (width_px + 16) / across - 16
    body, bottom = [svg.define_hatch(key)], 0.0
    for rank, overlay in enumerate(panels):
        left, top = (rank % across) * (room + 16), 24 + (rank // across) * 224.0
        plot = _Plot(left + 36, left + room - 4, top, top + 130, max(overlay.day.duration_s, 1.0))
        body += [svg.text(left, top - 13, overlay.name, "strong"), *_draw_overlay(overlay, plot, key)]
        bottom = plot.bottom_px + 76
    legend, height = _draw_day_legend([panel.day for panel in panels], labels, bottom, key, width_px)
    return svg.picture(width_px, height, key, (labels.title, labels.description), body + legend)


def _draw_overlay(overlay: Overlay, plot: _Plot, key: str) -> list[str]:
    day = overlay.day
    return [
        *_draw_guides(plot),
        *(stroke for mark in day.marks for stroke in _draw_mark(mark, plot, key)),
        *(_draw_band(run, plot, _OUTER) for run in day.runs),
        *(_draw_band(run, plot) for run in overlay.inner),
        *(_draw_median(run, plot, 1.8) for run in day.runs),
        *_draw_time_axis(day, plot),
        *_draw_counts(overlay, plot),
    ]


def _draw_counts(overlay: Overlay, plot: _Plot) -> list[str]:
    """Draw a bar for each quarter hour, as high as its share of all days."""
    bottom = plot.bottom_px + 56
    body = [svg.line(plot.left_px, bottom, plot.right_px, bottom, f'class="rule" stroke="{svg.SOFT}"')]
    for start_s, end_s, days in overlay.counts:
        x, height = plot.x(start_s), 18.0 * days / max(overlay.days, 1)
        place = (x, bottom - height, max(plot.x(end_s) - x - 0.5, 0.5), height)
        body.append(svg.rect(*place, f'class="mark" fill="{svg.RAMP[2]}"'))
    body.append(svg.text(plot.left_px - 5, bottom, str(overlay.days), "soft", "end"))
    return [*body, svg.text(plot.left_px, bottom - 22, overlay.counts_label)]


def _draw_panel(day: Day, plot: _Plot, key: str) -> list[str]:
    return [
        *_draw_guides(plot),
        *(stroke for mark in day.marks for stroke in _draw_mark(mark, plot, key)),
        *(stroke for run in day.runs for stroke in _draw_run(run, plot)),
        *(stroke for mark in day.marks for stroke in _draw_mark_label(mark, plot)),
    ]


def _draw_guides(plot: _Plot) -> list[str]:
    body = []
    for degrees in range(0, 181, 30):
        y = plot.y(degrees)
        if degrees in GUIDES_DEG:
            weight = "1" if degrees == 60 else "0.7"
            dash = f'class="rule" stroke="{svg.SOFT}" stroke-width="{weight}" stroke-dasharray="3 3"'
            body.append(svg.line(plot.left_px, y, plot.right_px, y, dash))
        kind = "strong" if degrees == 60 else "soft"
        if degrees % 60 == 0 or degrees in GUIDES_DEG:
            body.append(svg.text(plot.left_px - 5, y + 3.8, f"{degrees}°", kind, "end"))
    frame = f'class="rule" stroke="{svg.SOFT}"'
    return [*body, svg.line(plot.left_px, plot.bottom_px, plot.right_px, plot.bottom_px, frame)]


def _draw_mark(mark: Mark, plot: _Plot, key: str) -> list[str]:
    x, end = plot.x(mark.start_s), plot.x(mark.end_s)
    height = plot.bottom_px - plot.top_px
    ground = svg.rect(x, plot.top_px, end - x, height, f'class="paper" fill="{svg.PAPER}"')
    edge = f'class="rule" stroke="{svg.SOFT}" stroke-width="0.7" stroke-dasharray="1.5 2"'
    edges = [svg.line(at, plot.top_px, at, plot.bottom_px, edge) for at in (x, end)]
    if mark.kind == "missing":
        return [ground, *edges]
    hatch = svg.rect(x, plot.top_px, end - x, height, f'fill="url(#{key}-h)" fill-opacity="0.55"')
    return [ground, hatch]


def _draw_mark_label(mark: Mark, plot: _Plot) -> list[str]:
    """Write what the stretch is: across where there is room, upwards in a narrow one, else nothing."""
    x, room = (plot.x(mark.start_s) + plot.x(mark.end_s)) / 2, plot.x(mark.end_s) - plot.x(mark.start_s)
    length = svg.estimate_width(mark.label) + 8
    y = (plot.top_px + plot.bottom_px) / 2
    plate = f'class="paper" fill="{svg.PAPER}"'
    words = svg.text(x, y + 3.8, mark.label, "ink", "middle")
    if room >= length:
        return [svg.rect(x - length / 2, y - 8, length, 16, plate), words]
    if room < 11.5 or length > plot.bottom_px - plot.top_px:
        return []
    turned = f'<g transform="rotate(-90 {svg.number(x)} {svg.number(y)})">'
    return [turned, svg.rect(x - length / 2, y - 5.5, length, 11, plate), words, "</g>"]


def _draw_run(run: tuple[MinuteBand, ...], plot: _Plot) -> list[str]:
    """Draw minutes as steps, for a value belongs to its whole minute."""
    return [_draw_band(run, plot), _draw_median(run, plot, 0.9 if plot.duration_s > LONG_S else 1.5)]


def _draw_band(run: tuple[MinuteBand, ...], plot: _Plot, attributes: str = _INNER) -> str:
    upper, lower = _step_through(run, [band.high_deg for band in run], plot), _step_back(run, plot)
    return svg.path(f"M{upper}L{lower}Z", attributes)


def _draw_median(run: tuple[MinuteBand, ...], plot: _Plot, weight: float) -> str:
    middle = _step_through(run, [band.middle_deg for band in run], plot)
    stroke = f'class="median" fill="none" stroke="{svg.RAMP[3]}" stroke-width="{weight}"'
    return svg.path(f"M{middle}", f'{stroke} stroke-linejoin="round"')


def _step_through(run: tuple[MinuteBand, ...], degrees: Sequence[float], plot: _Plot) -> str:
    steps = [f"{svg.number(plot.x(run[0].start_s))} {svg.number(plot.y(degrees[0]))}"]
    for band, value in zip(run, degrees, strict=True):
        steps.append(f"V{svg.number(plot.y(value))}H{svg.number(plot.x(band.end_s))}")
    return "".join(steps)


def _step_back(run: tuple[MinuteBand, ...], plot: _Plot) -> str:
    last = run[-1]
    first = f"{svg.number(plot.x(last.end_s))} {svg.number(plot.y(last.low_deg))}"
    steps = (
        f"V{svg.number(plot.y(band.low_deg))}H{svg.number(plot.x(band.start_s))}" for band in reversed(run)
    )
    return first + "".join(steps)


def _draw_time_axis(day: Day, plot: _Plot) -> list[str]:
    room = svg.estimate_width("00:00:00") + 10
    step = _choose_tick_step(day.duration_s, int((plot.right_px - plot.left_px) // room))
    first = day.clock.seconds_to_whole_hour() % step
    body, at = [], first
    while at <= day.duration_s:
        x = plot.x(at)
        label = day.clock.format_tick(at)
        half = svg.estimate_width(label) / 2
        place = min(max(x, half), plot.right_px + 4 - half)
        body.append(svg.line(x, plot.bottom_px, x, plot.bottom_px + 4, f'class="rule" stroke="{svg.SOFT}"'))
        body.append(svg.text(place, plot.bottom_px + 16, label, "soft", "middle"))
        at += step
    return body


def _choose_tick_step(duration_s: float, most: int) -> int:
    """Take the finest round step with at most ``most`` ticks."""
    fitting = (step for step in _TICK_STEPS_S if duration_s / step <= max(most, 1))
    return next(fitting, _TICK_STEPS_S[-1])


def _draw_block(block: Block, plot: _Plot) -> list[str]:
    """Draw a period under the plot, with its rank and as much of its name as fits."""
    x, end, y = plot.x(block.start_s), plot.x(block.end_s), plot.bottom_px + 2
    ground = (
        f'class="bar edge" fill="{svg.RAMP[0]}"' if block.rank else f'class="paper edge" fill="{svg.PAPER}"'
    )
    frame = svg.rect(x, y, max(end - x, 1.0), _LANE_PX - 4, f'{ground} stroke="{svg.SOFT}"')
    rank = str(block.rank or "")
    told = svg.shorten(f"{rank} {block.label}".strip(), end - x - 4)
    if len(told) < _SHORTEST_NAME:
        told = rank if svg.estimate_width(rank) <= end - x else ""
    return [frame, svg.text((x + end) / 2, y + 13, told, "onlight" if block.rank else "ink", "middle")]


def _draw_bracket(day: Day, plot: _Plot) -> list[str]:
    """Bracket the 15 minutes with the most time above 60 deg, above the plot."""
    if day.worst is None:
        return []
    x, end = (plot.x(seconds) for seconds in day.worst)
    return [_draw_bracket_at(x, end, plot.top_px)]


def _draw_bracket_at(start_px: float, end_px: float, bottom_px: float) -> str:
    low, high = svg.number(bottom_px), svg.number(bottom_px - 6)
    commands = f"M{svg.number(start_px)} {low}V{high}H{svg.number(end_px)}V{low}"
    return svg.path(commands, f'class="accent-line" fill="none" stroke="{svg.ORANGE}" stroke-width="2"')


def _draw_longest(day: Day, plot: _Plot) -> list[str]:
    """Point a triangle at the longest continuous time above 60 deg, over the bracket."""
    if day.longest_start_s is None:
        return []
    return [_draw_triangle_at(plot.x(day.longest_start_s), plot.top_px - 9)]


def _draw_triangle_at(x_px: float, bottom_px: float) -> str:
    commands = f"M{svg.number(x_px)} {svg.number(bottom_px)}l-5 -9h10Z"
    return svg.path(commands, f'class="mark" fill="{svg.RAMP[3]}"')


def _draw_day_legend(
    days: Sequence[Day], labels: DayLabels, y_px: float, key: str, width_px: float
) -> tuple[list[str], float]:
    """Explain what is drawn, and only that; give the strokes and where the drawing ends."""
    body, x = [], 0.5
    for words, draw in _list_keys(days, labels, key):
        first, *others = svg.break_lines(words, width_px - 20)
        length = 20 + svg.estimate_width(first) + 8
        if x > 1 and x + length > width_px:
            x, y_px = 0.5, y_px + 18
        body += [draw(x, y_px), svg.text(x + 20, y_px, first)]
        body += [svg.text(x + 20, y_px + 15 * k, line) for k, line in enumerate(others, 1)]
        x, y_px = x + length, y_px + 15 * len(others)
    return body, y_px + 6


def _list_keys(
    days: Sequence[Day], labels: DayLabels, key: str
) -> list[tuple[str, Callable[[float, float], str]]]:
    kinds = {mark.kind for day in days for mark in day.marks}
    hatch = f'class="edge" fill="url(#{key}-h)" stroke="{svg.SOFT}" stroke-width="0.5"'
    dots = f'class="edge" fill="none" stroke="{svg.SOFT}" stroke-dasharray="1.5 2"'
    keys = (
        (True, labels.band, partial(_draw_key, attributes=_OUTER if labels.inner else _INNER)),
        (True, labels.inner, partial(_draw_key, attributes=_INNER)),
        (True, labels.median, partial(_draw_key, attributes="")),
        ("left out" in kinds, labels.left_out, partial(_draw_key, attributes=hatch)),
        ("missing" in kinds, labels.missing, partial(_draw_key, attributes=dots)),
        (days[0].worst is not None, labels.worst, lambda x, y: _draw_bracket_at(x, x + 15, y)),
        (
            days[0].longest_start_s is not None,
            labels.longest,
            lambda x, y: _draw_triangle_at(x + 7, y),
        ),
    )
    return [(words, draw) for is_drawn, words, draw in keys if is_drawn and words]


def _draw_key(x_px: float, y_px: float, attributes: str) -> str:
    if attributes:
        return svg.rect(x_px, y_px - 9, 15, 10, attributes)
    return svg.line(
        x_px, y_px - 4, x_px + 15, y_px - 4, f'class="median" stroke="{svg.RAMP[3]}" stroke-width="1.8"'
    )
