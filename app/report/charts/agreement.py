"""Charts of a comparison: the Bland-Altman plot, both angles over time, the error over time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from acromion.app.report.charts import svg
from acromion.app.report.charts.svg import NARROW, Plot, Span
from acromion.app.report.model import Chart
from acromion.app.report.words.numbers import format_angle, format_elapsed, format_number
from acromion.app.report.words.wording import (
    Language,
    Words,
    clean_text,
    fill,
    find_device_name,
    load_wording,
)
from acromion.fusion.comparison.change import QUASI_STATIC, TABLE_1

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acromion.fusion.comparison.agreement import Agreement, AgreementCell, AgreementEntry
    from acromion.fusion.comparison.alignment import Pairs

    Vector = NDArray[np.float64]

SHOWN_S = 30.0
MOST_POINTS = 600
STEPS = 60
"""Number of intervals of the error over time."""
COLUMNS, ROWS = 60, 40
"""Cells of the Bland-Altman plot."""
_PLOT = Plot(38, 0, 24)
_DEGREES = (0.0, 180.0)
Tick = tuple[float, str]

# The three charts of one comparison.


def draw_bland_altman(pairs: Pairs, overall: Agreement, words: Words, language: Language) -> Chart:
    """Plot the difference over the mean of both as a density, with bias and limits of agreement."""
    middle = (pairs.ours_deg + pairs.reference_deg) / 2.0
    error = pairs.ours_deg - pairs.reference_deg
    reach = _round_up(float(np.quantile(np.abs(error), 0.999)), overall.loa_high_deg, -overall.loa_low_deg)
    ends_deg = (-reach, reach)
    counts = np.histogram2d(
        np.clip(middle, *_DEGREES), np.clip(error, *ends_deg), (COLUMNS, ROWS), (_DEGREES, ends_deg)
    )[0].astype(int)
    entry, limits = words["bland_altman"], (overall.loa_low_deg, overall.loa_high_deg)
    edges = (format_angle(value, language, 1) for value in (overall.bias_deg, *limits))
    facts = dict(zip(("bias", "low", "high"), edges, strict=True))
    marks = (
        (overall.loa_high_deg, fill(entry["high"], facts)),
        (overall.bias_deg, fill(entry["bias"], facts)),
        (overall.loa_low_deg, fill(entry["low"], facts)),
    )
    axes = _Axes(entry["across"], entry["upwards"], _mark_angles(language), _mark_errors(reach, language))

    def draw(shown: tuple[str, str], width_px: float) -> str:
        plot = replace(_PLOT, right_px=width_px - 8, bottom_px=214, across=_DEGREES, upwards=ends_deg)
        body = [
            *_draw_cells(counts, plot),
            *_draw_axes(plot, axes),
            *(part for mark in marks for part in _draw_mark(plot, *mark)),
        ]
        return svg.picture(width_px, plot.bottom_px + 34, f"ba{width_px:.0f}", shown, body)

    cells = (overall.bias_deg, overall.sd_deg, *limits)
    row = (entry["row"], *(format_angle(value, language, 2) for value in cells))
    alternative = fill(entry["alternative"], facts)
    return Chart.draw((entry["title"], alternative), draw, entry["columns"], (row,), entry["note"])


def draw_overlay(pairs: Pairs, words: Words, language: Language) -> Chart:
    """Draw both angles in the half minute with the largest difference."""
    start_s = find_worst(pairs)
    end_s = start_s + SHOWN_S
    shown, entry = pairs.cut(start_s, end_s), words["overlay"]
    rmse_deg = float(np.sqrt(np.mean((shown.ours_deg - shown.reference_deg) ** 2)))
    facts = {"start": format_elapsed(start_s), "rmse": format_angle(rmse_deg, language, 1)}
    step = max(1, sum(len(run) for run in shown.runs) // MOST_POINTS)
    reference, ours = (
        [list(zip(*(part[::step].tolist() for part in run), strict=True)) for run in runs]
        for runs in (
            [(run.time_s, run.reference_deg) for run in shown.runs],
            [(run.time_s, run.ours_deg) for run in shown.runs],
        )
    )
    ticks = [(start_s + at, format_number(at, 0, language)) for at in range(0, int(SHOWN_S) + 1, 5)]
    axes = _Axes(fill(entry["across"], facts), entry["upwards"], ticks, _mark_angles(language))
    plot = replace(_PLOT, bottom_px=194, across=(start_s, end_s))
    rows = (  # one per second
        (
            format_number(float(run.time_s[at]), 1, language),
            *(format_angle(float(one[at]), language, 1) for one in (run.reference_deg, run.ours_deg)),
        )
        for run in shown.runs
        for at in range(0, len(run), max(1, round(run.rate_hz)))
    )
    return Chart.draw(
        (entry["title"], fill(entry["alternative"], facts)),
        _draw_two_lines("ov", (entry["reference"], reference), (entry["ours"], ours), plot, axes),
        entry["columns"],
        rows,
    )


def find_worst(pairs: Pairs) -> float:
    """Return the start of the 30 s, in steps of 15 s, with the largest mean square difference."""
    time_s = np.concatenate([run.time_s for run in pairs.runs])
    squares = (pairs.ours_deg - pairs.reference_deg) ** 2
    half_s, first_s = SHOWN_S / 2, float(time_s[0])
    places = ((time_s - first_s) // half_s).astype(np.int64)
    sums = np.bincount(places, squares)
    both = sums[:-1] + sums[1:] if len(sums) > 1 else sums
    return first_s + half_s * int(np.argmax(both))


def draw_error_over_time(pairs: Pairs, words: Words, language: Language) -> Chart | None:
    """Draw mean difference and root mean square over the whole common time; None under a minute."""
    time_s = np.concatenate([run.time_s for run in pairs.runs])
    start_s, end_s = float(time_s[0]), float(time_s[-1])
    if end_s - start_s < 2 * SHOWN_S:
        return None
    edges, error = np.linspace(start_s, end_s, STEPS + 1), pairs.ours_deg - pairs.reference_deg
    places = np.clip(np.searchsorted(edges, time_s, "right") - 1, 0, STEPS - 1)
    counts = np.bincount(places, minlength=STEPS).astype(np.float64)
    counts[counts == 0] = np.nan  # not measured
    means = np.bincount(places, error, STEPS) / counts
    sizes = np.sqrt(np.bincount(places, error**2, STEPS) / counts)
    reach = _round_up(*np.abs(means[np.isfinite(means)]), *sizes[np.isfinite(sizes)])
    entry, middles = words["error_over_time"], (edges[:-1] + edges[1:]) / 2
    ticks = [(at, format_elapsed(at)) for at in np.linspace(start_s, end_s, 4).tolist()]
    axes = _Axes(entry["across"], entry["upwards"], ticks, _mark_errors(reach, language))
    plot = replace(_PLOT, bottom_px=144, across=(start_s, end_s), upwards=(-reach, reach))
    lines = (entry["rmse"], _break(middles, sizes)), (entry["bias"], _break(middles, means))
    rows = (
        (format_elapsed(at), format_angle(mean, language, 2), format_angle(size, language, 2))
        for at, mean, size in zip(middles.tolist(), means.tolist(), sizes.tolist(), strict=True)
    )
    return Chart.draw(
        (entry["title"], entry["alternative"]),
        _draw_two_lines("et", *lines, plot, axes),
        entry["columns"],
        rows,
    )


def _round_up(*values: float) -> float:
    """Round up to the next step of 1, 2 or 5 times a power of ten."""
    most = max((value for value in values if np.isfinite(value)), default=1.0)
    power = 10.0 ** np.floor(np.log10(max(most, 0.1)))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= most * 1.05 or step == 10))


def _mark_angles(language: Language) -> list[Tick]:
    return [(angle, format_angle(angle, language)) for angle in range(0, 181, 30)]


def _mark_errors(reach_deg: float, language: Language) -> list[Tick]:
    decimals, errors_deg = 0 if reach_deg >= 2 else 1, (part * reach_deg for part in (-1, -0.5, 0, 0.5, 1))
    return [(error_deg, format_angle(error_deg, language, decimals)) for error_deg in errors_deg]


def _break(middles: Vector, values: Vector) -> list[list[Span]]:
    runs: list[list[Span]] = [[]]
    for x, y in zip(middles.tolist(), values.tolist(), strict=True):
        if np.isfinite(y):
            runs[-1].append((x, y))
        elif runs[-1]:
            runs.append([])
    return runs


# Parts of these charts.


@dataclass(frozen=True, slots=True)
class _Axes:
    """Axis labels and ticks."""

    across: str
    upwards: str
    across_ticks: Sequence[Tick]
    upwards_ticks: Sequence[Tick]


def _draw_axes(plot: Plot, axes: _Axes) -> list[str]:
    dash = f'{svg.RULE} stroke-width="0.6" stroke-dasharray="2 3"'
    body = [
        svg.text(0, 11, axes.upwards),
        svg.text(plot.right_px, plot.bottom_px + 31, axes.across, "soft", "end"),
    ]
    for value, label in axes.upwards_ticks:
        y = plot.y(value)
        body.append(svg.line(plot.left_px, y, plot.right_px, y, dash))
        body.append(svg.text(plot.left_px - 5, y + 3.8, label, "soft", "end"))
    for value, label in axes.across_ticks:
        x = plot.x(value)
        anchor = "end" if x > plot.right_px - 1 else "middle"
        body.append(svg.line(x, plot.bottom_px, x, plot.bottom_px + 4, svg.RULE))
        body.append(svg.text(x, plot.bottom_px + 16, label, "soft", anchor))
    return [*body, plot.draw_baseline()]


def _draw_cells(counts: NDArray[np.int_], plot: Plot) -> Iterable[str]:
    """Draw the number of rows in each cell; each shade covers a fivefold range of shares."""
    wide, high = (plot.right_px - plot.left_px) / COLUMNS, (plot.bottom_px - plot.top_px) / ROWS
    for column, row in np.argwhere(counts).tolist():
        share = counts[column, row] / counts.max()
        shade = sum(share >= limit for limit in (1 / 625, 1 / 125, 1 / 25, 1 / 5))
        place = (plot.left_px + column * wide, plot.bottom_px - (row + 1) * high, wide + 0.1, high + 0.1)
        yield svg.rect(*place, f'fill="{svg.RAMP[shade]}"')


def _draw_mark(plot: Plot, value: float, label: str) -> list[str]:
    y, length = plot.y(value), svg.estimate_width(label)
    stroke = f'{svg.ACCENT} stroke-width="1.2" stroke-dasharray="5 3"'
    return [
        svg.line(plot.left_px, y, plot.right_px, y, stroke),
        svg.rect(plot.right_px - length - 4, y - 12, length + 4, 11, svg.PLATE),
        svg.text(plot.right_px - 2, y - 3, label, "strong", "end"),
    ]


def _draw_two_lines(
    key: str,
    reference: tuple[str, list[list[Span]]],
    ours: tuple[str, list[list[Span]]],
    plot: Plot,
    axes: _Axes,
) -> Callable[[tuple[str, str], float], str]:
    """Draw curves of unbroken runs: the reference wide and light, ours thin and dark on top."""
    strokes = (
        f'{svg.ACCENT_CURVE} stroke-width="3" stroke-opacity="0.55"',
        f'{svg.CURVE} stroke-width="1.3"',
    )

    def draw(words: tuple[str, str], width_px: float) -> str:
        placed = replace(plot, right_px=width_px - 8)
        body, x, bottom = _draw_axes(placed, axes), plot.left_px, plot.bottom_px
        for (label, runs), stroke in zip((reference, ours), strokes, strict=True):
            joined = f'{stroke} stroke-linejoin="round"'
            body += [placed.follow(run, joined) for run in runs if len(run) > 1]
            body.append(svg.path(f"M{svg.number(x)} {svg.number(bottom + 29)}l18 0", stroke))
            body.append(svg.text(x + 23, bottom + 33, label))
            x += 40 + svg.estimate_width(label)
        return svg.picture(width_px, bottom + 40, f"{key}{width_px:.0f}", words, body)

    return draw


# A study: each person's error in each task.


ROW_PX = 19
TOP_PX = 26
STEPS_DEG = (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0)


def find_paper_row(cell: AgreementCell) -> dict[str, float | None] | None:
    """Return the paper's figures for this task and device, if it has them."""
    paper = TABLE_1.get(cell.device, {}).get(cell.paper_task or 0)
    if paper is None:
        return None
    r = None if cell.paper_task in QUASI_STATIC else paper.r
    return {"r": r, "rmse_deg": paper.rmse_deg, "mean_absolute_error_deg": paper.absolute_deg}


def draw_study(
    entries: Sequence[AgreementEntry],
    cells: Sequence[AgreementCell],
    device: str,
    words: Words,
    language: Language,
) -> Chart:
    """Draw a row for each task of a device: a ring per person, a bar at the mean, a mark for the paper."""
    entry, name = words["study_figure"], find_device_name(load_wording(language), device)
    rows = [
        _StudyRow(
            clean_text(cell.task),
            [e.agreement.rmse_deg for e in entries if (e.task, e.device) == (cell.task, device)],
            cell.rmse_deg.mean,
            paper["rmse_deg"] if (paper := find_paper_row(cell)) else None,
        )
        for cell in cells
        if cell.device == device
    ]
    return Chart.draw(
        (fill(entry["title"], {"device": name}), fill(entry["alternative"], {"device": name})),
        lambda labels, width_px: _draw_study(
            rows, f"st-{device}-{width_px:.0f}", labels, entry, language, width_px
        ),
        entry["columns"],
        (
            (row.task, *(format_angle(deg, language, 2) for deg in (row.mean_deg, row.paper_deg)))
            for row in rows
        ),
    )


@dataclass(frozen=True, slots=True)
class _StudyRow:
    """One task: the errors of each person, their mean, and the paper's."""

    task: str
    errors_deg: Sequence[float]
    mean_deg: float
    paper_deg: float | None


def _draw_study(
    rows: Sequence[_StudyRow],
    key: str,
    labels: tuple[str, str],
    entry: Words,
    language: Language,
    width_px: float,
) -> str:
    left, bottom = 190.0 if width_px > NARROW else 110.0, TOP_PX + ROW_PX * len(rows)
    papers = [row.paper_deg for row in rows if row.paper_deg is not None]
    most = max([*papers, *(error_deg for row in rows for error_deg in row.errors_deg), 0.5])
    step = next((step for step in STEPS_DEG if most / step <= 6), STEPS_DEG[-1])
    px_per_deg = (width_px - left - 14) / (most * 1.03)
    dash, body = f'{svg.RULE} stroke-width="0.6" stroke-dasharray="2 3"', []
    for k in range(int(most / step) + 1):
        x, label = left + k * step * px_per_deg, format_angle(k * step, language, 0 if step >= 1 else 2)
        body.append(svg.line(x, TOP_PX - 4, x, bottom, dash))
        body.append(svg.text(x, bottom + 15, label, "soft", "middle"))
    for rank, row in enumerate(rows):
        y = TOP_PX + ROW_PX * (rank + 0.5)
        body.append(svg.text(0, y + 4, svg.shorten(row.task, left - 8), "ink"))
        body += [_draw_ring(left + error_deg * px_per_deg, y) for error_deg in row.errors_deg]
        body.append(_draw_bar(left + row.mean_deg * px_per_deg, y))
        if row.paper_deg is not None:
            body.append(_draw_diamond(left + row.paper_deg * px_per_deg, y))
    x, y = min(left, 60.0), bottom + 36
    for name, draw in (("person", _draw_ring), ("mean", _draw_bar), ("paper", _draw_diamond)):
        body += [draw(x, y - 4), svg.text(x + 9, y, entry[name])]
        x += 26 + svg.estimate_width(entry[name])
    return svg.picture(width_px, bottom + 44, key, labels, body)


def _draw_ring(x_px: float, y_px: float) -> str:
    arcs = "a3.2 3.2 0 1 0 6.4 0a3.2 3.2 0 1 0 -6.4 0"
    return svg.path(f"M{svg.number(x_px - 3.2)} {svg.number(y_px)}{arcs}", f'{svg.CURVE} stroke-width="1.2"')


def _draw_bar(x_px: float, y_px: float) -> str:
    return svg.line(x_px, y_px - 7, x_px, y_px + 7, f'{svg.MEDIAN} stroke-width="2.4"')


def _draw_diamond(x_px: float, y_px: float) -> str:
    colour = f'class="accent-line" fill="{svg.ORANGE}" stroke="{svg.ORANGE}"'
    return svg.path(f"M{svg.number(x_px - 4.5)} {svg.number(y_px)}l4.5 -4.5l4.5 4.5l-4.5 4.5Z", colour)
