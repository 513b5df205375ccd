"""The distribution of elevation as SVG: how much of the time the arm stayed below each angle (APDF).

Amplitude probability distribution function (Jonsson 1982): the curve rises from 0 % at 0 deg to 100 % at
180 deg; four percentiles are marked, each with the range allowing for measurement error where one is known;
what the error of the N-pose may add to it is hatched.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from app.report.charts import svg
from app.report.charts.svg import NARROW

TOP_DEG = 180
GUIDES_DEG = (30, 60, 90)


@dataclass(frozen=True, slots=True)
class MarkedPercentile:
    """A percentile on the curve; ``interval``, and where the N-pose's error may raise it to, in degrees."""

    percent: int
    angle_deg: float
    interval: tuple[float, float] | None
    label: str
    raised_deg: float | None = None


@dataclass(frozen=True, slots=True)
class Distribution:
    """``below_percent[d]``: share of the time below d degrees, d from 0 to 180."""

    below_percent: Sequence[float]
    marks: tuple[MarkedPercentile, ...]
    axes: tuple[str, str]
    """Names of the axes: across, and up."""


@dataclass(frozen=True, slots=True)
class _Plot:
    left_px: float
    right_px: float
    top_px: float
    bottom_px: float

    def x(self, angle_deg: float) -> float:
        return self.left_px + (self.right_px - self.left_px) * angle_deg / TOP_DEG

    def y(self, percent: float) -> float:
        return self.bottom_px - (self.bottom_px - self.top_px) * percent / 100


def draw_apdf(shown: Distribution, words: tuple[str, str], width_px: float) -> str:
    """Draw the curve with its percentiles; guide lines at 30, 60 and 90 deg."""
    plot, key = _Plot(40, width_px - 8, 22, 200 if width_px > NARROW else 230), f"apdf{width_px:.0f}"
    is_hatched = any(mark.raised_deg is not None for mark in shown.marks)
    body = [
        *([svg.define_hatch(key)] if is_hatched else []),
        *_draw_frame(plot, shown.axes),
        _draw_curve(shown.below_percent, plot),
        *(stroke for mark in shown.marks for stroke in _draw_mark(mark, plot, key)),
    ]
    return svg.picture(width_px, plot.bottom_px + 34, key, words, body)


def _draw_frame(plot: _Plot, axes: tuple[str, str]) -> list[str]:
    rule = f'class="rule" stroke="{svg.SOFT}"'
    dash = f'{rule} stroke-width="0.7" stroke-dasharray="3 3"'
    body = [svg.line(plot.x(angle), plot.top_px, plot.x(angle), plot.bottom_px, dash) for angle in GUIDES_DEG]
    for percent in (0, 25, 50, 75, 100):
        y = plot.y(percent)
        body.append(svg.line(plot.left_px - 4, y, plot.left_px, y, rule))
        body.append(svg.text(plot.left_px - 7, y + 3.8, f"{percent}", "soft", "end"))
    for angle in range(0, TOP_DEG + 1, 30):
        kind = "strong" if angle == 60 else "soft"
        anchor = "end" if angle == TOP_DEG else "middle"
        x = min(plot.x(angle), plot.right_px + 6) if angle == TOP_DEG else plot.x(angle)
        body.append(svg.text(x, plot.bottom_px + 15, f"{angle}°", kind, anchor))
    across, upwards = axes
    body.append(svg.text(plot.right_px, plot.bottom_px + 30, across, "soft", "end"))
    body.append(svg.text(0, 10, upwards))
    body.append(svg.line(plot.left_px, plot.top_px, plot.left_px, plot.bottom_px, rule))
    return [*body, svg.line(plot.left_px, plot.bottom_px, plot.right_px, plot.bottom_px, rule)]


def _draw_curve(below_percent: Sequence[float], plot: _Plot) -> str:
    points = (
        f"{svg.number(plot.x(degrees))} {svg.number(plot.y(percent))}"
        for degrees, percent in enumerate(below_percent)
    )
    stroke = f'class="median" fill="none" stroke="{svg.RAMP[3]}" stroke-width="1.8"'
    return svg.path("M" + "L".join(points), f'{stroke} stroke-linejoin="round"')


def _draw_mark(mark: MarkedPercentile, plot: _Plot, key: str) -> list[str]:
    """Mark the point; its label stands to the right, where the curve has already risen above it."""
    x, y = plot.x(mark.angle_deg), plot.y(mark.percent)
    body, end = [], x
    if mark.interval is not None:
        low, end = (plot.x(value) for value in mark.interval)
        bar = f'class="accent-line" stroke="{svg.ORANGE}" stroke-width="1.6"'
        body = [
            svg.line(low, y, end, y, bar),
            *(svg.line(at, y - 3, at, y + 3, bar) for at in (low, end)),
        ]
    if mark.raised_deg is not None and plot.x(mark.raised_deg) > end:
        raised = plot.x(mark.raised_deg)
        body += svg.hatch(end, y - 3, raised - end, 6, key)
        end = raised
    dot = f"M{svg.number(x - 4)} {svg.number(y)}l4 -4l4 4l-4 4Z"
    body.append(svg.path(dot, f'class="mark" fill="{svg.RAMP[3]}" stroke="{svg.PAPER}"'))
    return [*body, *_label(mark, x if mark.percent > 50 else max(x, end), y, plot)]


def _label(mark: MarkedPercentile, x_px: float, y_px: float, plot: _Plot) -> list[str]:
    """Write beside a low percentile, below a high one, where the curve is flat; a plate hides the guides."""
    length = svg.estimate_width(mark.label)
    place = min(x_px + 8, plot.right_px - length)
    baseline = y_px + (15 if mark.percent > 50 else 3.8)
    plate = svg.rect(place - 2, baseline - 9, length, 11, f'class="paper" fill="{svg.PAPER}"')
    return [plate, svg.text(place, baseline, mark.label, "strong")]


# ------------------------------------------------------------------ two distributions in one picture
#
# The blue curve is solid and the vermillion one dashed, so that they differ on grey paper.


_STYLES = (
    f'class="median" fill="none" stroke="{svg.RAMP[3]}" stroke-width="2"',
    f'class="accent-line" fill="none" stroke="{svg.ORANGE}" stroke-width="2" stroke-dasharray="6 3"',
)


@dataclass(frozen=True, slots=True)
class Curve:
    """``below_percent[d]``: share of the time below d degrees, d from 0 to 180."""

    name: str
    below_percent: Sequence[float]


def draw_two_curves(
    curves: tuple[Curve, Curve], axes: tuple[str, str], words: tuple[str, str], width_px: float
) -> str:
    """Draw both curves to one scale; guide lines at 30, 60 and 90 deg."""
    left, right, top, bottom = 40.0, width_px - 8, 40.0, 210.0 if width_px > NARROW else 240.0

    def place(angle_deg: float, percent: float) -> str:
        x = left + (right - left) * angle_deg / TOP_DEG
        return f"{svg.number(x)} {svg.number(bottom - (bottom - top) * percent / 100)}"

    body = _draw_curve_frame(left, right, top, bottom, axes)
    for curve, style in zip(curves, _STYLES, strict=True):
        points = (place(degrees, percent) for degrees, percent in enumerate(curve.below_percent))
        body.append(svg.path("M" + "L".join(points), style))
    body += _draw_curve_names(curves, left)
    return svg.picture(width_px, bottom + 34, f"curves{width_px:.0f}", words, body)


def _draw_curve_frame(
    left_px: float, right_px: float, top_px: float, bottom_px: float, axes: tuple[str, str]
) -> list[str]:
    rule = f'class="rule" stroke="{svg.SOFT}"'
    body = [
        svg.line(left_px, top_px, left_px, bottom_px, rule),
        svg.line(left_px, bottom_px, right_px, bottom_px, rule),
    ]
    for percent in (0, 25, 50, 75, 100):
        y = bottom_px - (bottom_px - top_px) * percent / 100
        body += [
            svg.line(left_px - 4, y, left_px, y, rule),
            svg.text(left_px - 7, y + 3.8, f"{percent}", "soft", "end"),
        ]
    for angle in range(0, TOP_DEG + 1, 30):
        x = left_px + (right_px - left_px) * angle / TOP_DEG
        if angle in GUIDES_DEG:
            body.append(
                svg.line(x, top_px, x, bottom_px, f'{rule} stroke-width="0.7" stroke-dasharray="3 3"')
            )
        anchor = "end" if angle == TOP_DEG else "middle"
        shown = min(x, right_px + 6) if angle == TOP_DEG else x
        body.append(svg.text(shown, bottom_px + 15, f"{angle}°", "strong" if angle == 60 else "soft", anchor))
    across, upwards = axes
    return [*body, svg.text(right_px, bottom_px + 30, across, "soft", "end"), svg.text(0, 28, upwards)]


def _draw_curve_names(curves: tuple[Curve, Curve], left_px: float) -> list[str]:
    body, x = [], left_px
    for curve, style in zip(curves, _STYLES, strict=True):
        body += [svg.line(x, 6, x + 26, 6, style), svg.text(x + 31, 10, curve.name, "ink")]
        x += 31 + svg.estimate_width(curve.name) + 16
    return body


# ------------------------------------------------------------------ exposure variation
#
# A heat map of elevation by the length of stay (Mathiassen and Winkel 1991). Every cell shows its number, so
# that nothing depends on the shade.


SHADES_PERCENT = (0.05, 1.0, 3.0, 6.0, 12.0)
"""From which share of the time on each shade of the ramp applies; below the first a cell stays white."""


@dataclass(frozen=True, slots=True)
class HeatMap:
    """Cells (rows: elevation, low to high; columns: duration) in percent and as text; sums of both ways."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    percent: Sequence[Sequence[float]]
    told: tuple[tuple[str, ...], ...]
    row_sums: tuple[str, ...]
    column_sums: tuple[str, ...]
    axes: tuple[str, str, str]
    """Names: of the rows, of the columns, of the sums."""


@dataclass(frozen=True, slots=True)
class _Grid:
    """One drawing: rows from top to bottom, columns from left to right."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    percent: Sequence[Sequence[float]]
    told: Sequence[Sequence[str]]
    row_sums: tuple[str, ...]
    column_sums: tuple[str, ...]
    corner: str
    above: str
    sums: str


def draw_eva(shown: HeatMap, words: tuple[str, str], width_px: float) -> str:
    """Draw the map; on a telephone turned, so that its numbers stay as large."""
    grid = _turn(shown) if width_px <= NARROW else _keep(shown)
    left = max(svg.estimate_width(name) for name in (*grid.rows, grid.sums)) + 8
    cell = (width_px - left) / (len(grid.columns) + 1)
    body = [svg.text(0, 25, grid.corner), svg.text(left if grid.corner else 0, 10, grid.above)]
    for rank, name in enumerate((*grid.columns, grid.sums)):
        body.append(svg.text(left + (rank + 0.5) * cell, 25, name, "soft", "middle"))
    for rank in range(len(grid.rows)):
        body += _draw_row(grid, rank, left, cell)
    y = 32 + len(grid.rows) * 22 + 15
    body.append(svg.text(0, y, grid.sums))
    for rank, told in enumerate(grid.column_sums):
        body.append(svg.text(left + (rank + 0.5) * cell, y, told, "ink", "middle"))
    return svg.picture(width_px, y + 6, f"eva{width_px:.0f}", words, body)


def _keep(shown: HeatMap) -> _Grid:
    """Put the highest elevation on top."""
    return _Grid(
        shown.rows[::-1],
        shown.columns,
        shown.percent[::-1],
        shown.told[::-1],
        shown.row_sums[::-1],
        shown.column_sums,
        corner=shown.axes[0],
        above=shown.axes[1],
        sums=shown.axes[2],
    )


def _turn(shown: HeatMap) -> _Grid:
    return _Grid(
        shown.columns,
        shown.rows,
        list(zip(*shown.percent, strict=True)),
        list(zip(*shown.told, strict=True)),
        shown.column_sums,
        shown.row_sums,
        corner="",
        above=shown.axes[1],
        sums=shown.axes[2],
    )


def _draw_row(grid: _Grid, rank: int, left_px: float, cell_px: float) -> list[str]:
    y = 32 + rank * 22.0
    body = [svg.text(0, y + 15, grid.rows[rank], "ink")]
    for place, (percent, told) in enumerate(zip(grid.percent[rank], grid.told[rank], strict=True)):
        body += _draw_cell(left_px + place * cell_px, y, cell_px, percent, told)
    middle = left_px + (len(grid.columns) + 0.5) * cell_px
    return [*body, svg.text(middle, y + 15, grid.row_sums[rank], "ink", "middle")]


def _draw_cell(x_px: float, y_px: float, cell_px: float, percent: float, told: str) -> list[str]:
    shade = sum(percent >= least for least in SHADES_PERCENT) - 1
    ground = 'class="paper" fill="#ffffff"' if shade < 0 else f'class="bar" fill="{svg.RAMP[shade]}"'
    edge = f'class="edge" fill="none" stroke="{svg.SOFT}" stroke-width="0.4"'
    kind = "soft" if shade < 0 else "onlight" if shade < 2 else "light"
    return [
        svg.rect(x_px, y_px, cell_px, 22, ground),
        svg.rect(x_px, y_px, cell_px, 22, edge),
        svg.text(x_px + cell_px / 2, y_px + 15, told, kind, "middle"),
    ]
