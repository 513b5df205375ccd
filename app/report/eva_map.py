"""Exposure variation as SVG: a heat map with its numbers (elevation by how long the arm stayed in it).

Source: Mathiassen and Winkel 1991. Every cell bears its number, so that the shade is only help.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from app.report import svg
from app.report.svg import NARROW

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


def draw_eva(shown: HeatMap, words: tuple[str, str], width: float) -> str:
    """Draw the map; on a telephone turned, so that its numbers stay as large."""
    grid = _turn(shown) if width <= NARROW else _keep(shown)
    left = max(svg.estimate_width(name) for name in (*grid.rows, grid.sums)) + 8
    cell = (width - left) / (len(grid.columns) + 1)
    body = [svg.text(0, 25, grid.corner), svg.text(left if grid.corner else 0, 10, grid.above)]
    for rank, name in enumerate((*grid.columns, grid.sums)):
        body.append(svg.text(left + (rank + 0.5) * cell, 25, name, "soft", "middle"))
    for rank in range(len(grid.rows)):
        body += _draw_row(grid, rank, left, cell)
    y = 32 + len(grid.rows) * 22 + 15
    body.append(svg.text(0, y, grid.sums))
    for rank, told in enumerate(grid.column_sums):
        body.append(svg.text(left + (rank + 0.5) * cell, y, told, "ink", "middle"))
    return svg.picture(width, y + 6, f"eva{width:.0f}", words, body)


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


def _draw_row(grid: _Grid, rank: int, left: float, cell: float) -> list[str]:
    y = 32 + rank * 22.0
    body = [svg.text(0, y + 15, grid.rows[rank], "ink")]
    for place, (percent, told) in enumerate(zip(grid.percent[rank], grid.told[rank], strict=True)):
        body += _draw_cell(left + place * cell, y, cell, percent, told)
    middle = left + (len(grid.columns) + 0.5) * cell
    return [*body, svg.text(middle, y + 15, grid.row_sums[rank], "ink", "middle")]


def _draw_cell(x: float, y: float, cell: float, percent: float, told: str) -> list[str]:
    shade = sum(percent >= least for least in SHADES_PERCENT) - 1
    ground = 'class="paper" fill="#ffffff"' if shade < 0 else f'class="bar" fill="{svg.RAMP[shade]}"'
    edge = f'class="edge" fill="none" stroke="{svg.SOFT}" stroke-width="0.4"'
    kind = "soft" if shade < 0 else "onlight" if shade < 2 else "light"
    return [
        svg.rect(x, y, cell, 22, ground),
        svg.rect(x, y, cell, 22, edge),
        svg.text(x + cell / 2, y + 15, told, kind, "middle"),
    ]
