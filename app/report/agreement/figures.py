"""The charts of a comparison, with their words and the tables behind them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from app.report.charts.agreement import (
    COLUMNS,
    ROWS,
    Axes,
    Density,
    Line,
    draw_density,
    draw_lines,
    frame_plot,
)
from app.report.charts.svg import NARROW, WIDE
from app.report.model import Chart, Table
from app.report.words.numbers import format_angle, format_elapsed, format_number
from app.report.words.wording import Language, Words, fill

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fusion.agreement import Agreement, Pairs

    Vector = NDArray[np.float64]

SHOWN_S = 30.0
MOST_POINTS = 600
STEPS = 60
"""Stretches of the error over time."""


def draw_bland_altman(pairs: Pairs, overall: Agreement, words: Words, language: Language) -> Chart:
    """Plot the difference over the mean of both, as a density, with bias and limits of agreement."""
    middle = (pairs.ours_deg + pairs.reference_deg) / 2.0
    error = pairs.ours_deg - pairs.reference_deg
    reach = _round_up(float(np.quantile(np.abs(error), 0.999)), overall.loa_high_deg, -overall.loa_low_deg)
    entry = words["bland_altman"]
    facts = {
        "bias": format_angle(overall.bias_deg, language, 1),
        "low": format_angle(overall.loa_low_deg, language, 1),
        "high": format_angle(overall.loa_high_deg, language, 1),
    }
    told = (entry["title"], fill(entry["alternative"], facts))
    marks = (
        (overall.loa_high_deg, fill(entry["high"], facts)),
        (overall.bias_deg, fill(entry["bias"], facts)),
        (overall.loa_low_deg, fill(entry["low"], facts)),
    )
    density = Density(_count_cells(middle, error, reach), marks)
    axes = Axes(entry["across"], entry["upwards"], _mark_angles(language), _mark_errors(reach, language))
    drawn = {
        width: draw_density(
            f"ba{width:.0f}", density, frame_plot(width, 190, (0, 180), (-reach, reach)), axes, told
        )
        for width in (WIDE, NARROW)
    }
    return Chart(*told, drawn[WIDE], drawn[NARROW], _tabulate_limits(overall, entry, language), entry["note"])


def _round_up(*values: float) -> float:
    """Give the next whole step of 1, 2 or 5 times a power of ten above all values."""
    most = max((value for value in values if np.isfinite(value)), default=1.0)
    power = 10.0 ** np.floor(np.log10(max(most, 0.1)))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= most * 1.05 or step == 10))


def _count_cells(middle: Vector, error: Vector, reach_deg: float) -> list[tuple[int, int, int]]:
    counts = np.histogram2d(
        np.clip(middle, 0, 180),
        np.clip(error, -reach_deg, reach_deg),
        (COLUMNS, ROWS),
        ((0, 180), (-reach_deg, reach_deg)),
    )[0]
    return [(column, row, int(counts[column, row])) for column, row in np.argwhere(counts).tolist()]


def _mark_angles(language: Language) -> list[tuple[float, str]]:
    return [(angle, format_angle(angle, language)) for angle in range(0, 181, 30)]


def _mark_errors(reach_deg: float, language: Language) -> list[tuple[float, str]]:
    decimals = 0 if reach_deg >= 2 else 1
    return [
        (part * reach_deg, format_angle(part * reach_deg, language, decimals))
        for part in (-1, -0.5, 0, 0.5, 1)
    ]


def _tabulate_limits(overall: Agreement, entry: Words, language: Language) -> Table:
    cells = (overall.bias_deg, overall.sd_deg, overall.loa_low_deg, overall.loa_high_deg)
    row = (entry["row"], *(format_angle(value, language, 2) for value in cells))
    return Table(entry["title"], tuple(entry["columns"]), (row,))


def draw_overlay(pairs: Pairs, words: Words, language: Language) -> Chart:
    """Show both angles in the half minute in which they differ most."""
    start_s = find_worst(pairs)
    shown = pairs.cut(start_s, start_s + SHOWN_S)
    entry = words["overlay"]
    facts = {
        "start": format_elapsed(start_s),
        "rmse": format_angle(
            float(np.sqrt(np.mean((shown.ours_deg - shown.reference_deg) ** 2))), language, 1
        ),
    }
    told = (entry["title"], fill(entry["alternative"], facts))
    lines = [
        Line(entry["reference"], _thin(shown, is_reference=True), is_reference=True),
        Line(entry["ours"], _thin(shown, is_reference=False), is_reference=False),
    ]
    ticks = [(start_s + step, format_number(step, 0, language)) for step in range(0, int(SHOWN_S) + 1, 5)]
    axes = Axes(fill(entry["across"], facts), entry["upwards"], ticks, _mark_angles(language))
    drawn = {
        width: draw_lines(
            f"ov{width:.0f}",
            lines,
            frame_plot(width, 170, (start_s, start_s + SHOWN_S), (0, 180)),
            axes,
            told,
        )
        for width in (WIDE, NARROW)
    }
    return Chart(*told, drawn[WIDE], drawn[NARROW], _tabulate_overlay(shown, entry, language))


def find_worst(pairs: Pairs) -> float:
    """Give the start of the 30 s, cut in steps of 15 s, with the largest mean square difference."""
    time_s = np.concatenate([run.time_s for run in pairs.runs])
    squares = (pairs.ours_deg - pairs.reference_deg) ** 2
    half_s, first_s = SHOWN_S / 2, float(time_s[0])
    places = ((time_s - first_s) // half_s).astype(np.int64)
    sums = np.bincount(places, squares)
    both = sums[:-1] + sums[1:] if len(sums) > 1 else sums
    return first_s + half_s * int(np.argmax(both))


def _thin(pairs: Pairs, *, is_reference: bool) -> list[list[tuple[float, float]]]:
    step = max(1, sum(len(run) for run in pairs.runs) // MOST_POINTS)
    return [
        list(zip(run.time_s[::step].tolist(), values[::step].tolist(), strict=True))
        for run in pairs.runs
        for values in (run.reference_deg if is_reference else run.ours_deg,)
    ]


def _tabulate_overlay(pairs: Pairs, entry: Words, language: Language) -> Table:
    """Give one row for each second of what is shown."""
    rows = []
    for run in pairs.runs:
        for at in range(0, len(run), max(1, round(run.rate_hz))):
            values = (run.reference_deg[at], run.ours_deg[at])
            told = tuple(format_angle(float(value), language, 1) for value in values)
            rows.append((format_number(float(run.time_s[at]), 1, language), *told))
    return Table(entry["title"], tuple(entry["columns"]), tuple(rows))


def draw_error_over_time(pairs: Pairs, words: Words, language: Language) -> Chart | None:
    """Show the mean difference and the root mean square through the whole common time; not under a minute."""
    time_s = np.concatenate([run.time_s for run in pairs.runs])
    start_s, end_s = float(time_s[0]), float(time_s[-1])
    if end_s - start_s < 2 * SHOWN_S:
        return None
    edges = np.linspace(start_s, end_s, STEPS + 1)
    means, sizes = _average(time_s, pairs.ours_deg - pairs.reference_deg, edges)
    reach = _round_up(*np.abs(means[np.isfinite(means)]), *sizes[np.isfinite(sizes)])
    entry = words["error_over_time"]
    told = (entry["title"], entry["alternative"])
    middles = (edges[:-1] + edges[1:]) / 2
    lines = [
        Line(entry["rmse"], _break(middles, sizes), is_reference=True),
        Line(entry["bias"], _break(middles, means), is_reference=False),
    ]
    ticks = [(at, format_elapsed(at)) for at in np.linspace(start_s, end_s, 4).tolist()]
    axes = Axes(entry["across"], entry["upwards"], ticks, _mark_errors(reach, language))
    drawn = {
        width: draw_lines(
            f"et{width:.0f}", lines, frame_plot(width, 120, (start_s, end_s), (-reach, reach)), axes, told
        )
        for width in (WIDE, NARROW)
    }
    rows = tuple(
        (
            format_elapsed(float(at)),
            format_angle(float(mean), language, 2),
            format_angle(float(size), language, 2),
        )
        for at, mean, size in zip(middles, means, sizes, strict=True)
    )
    return Chart(*told, drawn[WIDE], drawn[NARROW], Table(told[0], tuple(entry["columns"]), rows))


def _average(time_s: Vector, error: Vector, edges: Vector) -> tuple[Vector, Vector]:
    """Give mean and root mean square in each stretch; NaN where nothing was measured."""
    places = np.clip(np.searchsorted(edges, time_s, "right") - 1, 0, STEPS - 1)
    counts = np.bincount(places, minlength=STEPS).astype(np.float64)
    counts[counts == 0] = np.nan
    means = np.bincount(places, error, STEPS) / counts
    return means, np.sqrt(np.bincount(places, error**2, STEPS) / counts)


def _break(middles: Vector, values: Vector) -> list[list[tuple[float, float]]]:
    """Cut a curve where it has no value."""
    runs: list[list[tuple[float, float]]] = [[]]
    for x, y in zip(middles.tolist(), values.tolist(), strict=True):
        if np.isfinite(y):
            runs[-1].append((x, y))
        elif runs[-1]:
            runs.append([])
    return runs
