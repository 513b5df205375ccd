"""The drawings of a comparison: Bland and Altman's plot, both angles over time, the error over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.report import svg

Words = tuple[str, str]
COLUMNS, ROWS = 60, 40


@dataclass(frozen=True, slots=True)
class Frame:
    """Where values fall on the sheet: ``across`` and ``upwards`` are (low, high)."""

    left: float
    right: float
    top: float
    bottom: float
    across: tuple[float, float]
    upwards: tuple[float, float]

    def x(self, value: float) -> float:
        """Give the place of a value, kept inside."""
        low, high = self.across
        return self.left + (self.right - self.left) * min(max((value - low) / (high - low), 0.0), 1.0)

    def y(self, value: float) -> float:
        """Give the place of a value, kept inside."""
        low, high = self.upwards
        return self.bottom - (self.bottom - self.top) * min(max((value - low) / (high - low), 0.0), 1.0)


@dataclass(frozen=True, slots=True)
class Axes:
    """Names of the axes, and the values at which they are marked."""

    across: str
    upwards: str
    across_ticks: Sequence[tuple[float, str]]
    upwards_ticks: Sequence[tuple[float, str]]


@dataclass(frozen=True, slots=True)
class Line:
    """One or more unbroken runs of points (x, y), in one stroke."""

    label: str
    runs: Sequence[Sequence[tuple[float, float]]]
    is_reference: bool


@dataclass(frozen=True, slots=True)
class Density:
    """How many rows fall into each cell (column, row), of ``COLUMNS`` by ``ROWS``; and the marked lines."""

    cells: Sequence[tuple[int, int, int]]
    marks: Sequence[tuple[float, str]]


def frame_plot(
    width: float, height: float, across: tuple[float, float], upwards: tuple[float, float]
) -> Frame:
    """Lay the frame of a drawing of this width."""
    return Frame(38, width - 8, 24, 24 + height, across, upwards)


def draw_density(key: str, density: Density, frame: Frame, axes: Axes, words: Words) -> str:
    """Draw shaded cells, the darker the more rows, under lines at the bias and the limits."""
    most = max((count for _, _, count in density.cells), default=1)
    wide, high = (frame.right - frame.left) / COLUMNS, (frame.bottom - frame.top) / ROWS
    cells = [
        svg.rect(
            frame.left + column * wide,
            frame.bottom - (row + 1) * high,
            wide + 0.1,
            high + 0.1,
            f'fill="{svg.RAMP[_shade(count, most)]}"',
        )
        for column, row, count in density.cells
    ]
    body = [
        *cells,
        *_draw_axes(frame, axes),
        *(part for mark in density.marks for part in _draw_mark(frame, mark)),
    ]
    return svg.picture(frame.right + 8, frame.bottom + 34, key, words, body)


def _shade(count: int, most: int) -> int:
    """Five shades, each for a share of the fullest cell five times that of the one before."""
    share = count / most
    return sum(share >= limit for limit in (1 / 625, 1 / 125, 1 / 25, 1 / 5))


def _draw_mark(frame: Frame, mark: tuple[float, str]) -> list[str]:
    value, label = mark
    y = frame.y(value)
    stroke = f'class="accent-line" stroke="{svg.ORANGE}" stroke-width="1.2" stroke-dasharray="5 3"'
    length = svg.estimate_width(label)
    plate = svg.rect(frame.right - length - 4, y - 12, length + 4, 11, f'class="paper" fill="{svg.PAPER}"')
    words = svg.text(frame.right - 2, y - 3, label, "strong", "end")
    return [svg.line(frame.left, y, frame.right, y, stroke), plate, words]


def draw_lines(key: str, lines: Sequence[Line], frame: Frame, axes: Axes, words: Words) -> str:
    """Draw curves: the reference wide and light, ours thin and dark upon it."""
    body = _draw_axes(frame, axes)
    at = frame.left
    for line in lines:
        stroke = _choose_stroke(is_reference=line.is_reference)
        body += [_draw_run(run, frame, stroke) for run in line.runs if len(run) > 1]
        body.append(svg.path(f"M{svg.number(at)} {svg.number(frame.bottom + 29)}l18 0", stroke))
        body.append(svg.text(at + 23, frame.bottom + 33, line.label))
        at += 40 + svg.estimate_width(line.label)
    return svg.picture(frame.right + 8, frame.bottom + 40, key, words, body)


def _choose_stroke(*, is_reference: bool) -> str:
    if is_reference:
        return f'class="accent-line" fill="none" stroke="{svg.ORANGE}" stroke-width="3" stroke-opacity="0.55"'
    return f'class="median" fill="none" stroke="{svg.RAMP[3]}" stroke-width="1.3"'


def _draw_run(run: Sequence[tuple[float, float]], frame: Frame, stroke: str) -> str:
    points = (f"{svg.number(frame.x(x))} {svg.number(frame.y(y))}" for x, y in run)
    return svg.path("M" + "L".join(points), f'{stroke} stroke-linejoin="round"')


def _draw_axes(frame: Frame, axes: Axes) -> list[str]:
    rule = f'class="rule" stroke="{svg.SOFT}"'
    dash = f'{rule} stroke-width="0.6" stroke-dasharray="2 3"'
    body = [
        svg.text(0, 11, axes.upwards),
        svg.text(frame.right, frame.bottom + 31, axes.across, "soft", "end"),
    ]
    for value, label in axes.upwards_ticks:
        y = frame.y(value)
        body += [
            svg.line(frame.left, y, frame.right, y, dash),
            svg.text(frame.left - 5, y + 3.8, label, "soft", "end"),
        ]
    for value, label in axes.across_ticks:
        x = frame.x(value)
        anchor = "end" if x > frame.right - 1 else "middle"
        body.append(svg.line(x, frame.bottom, x, frame.bottom + 4, rule))
        body.append(svg.text(x, frame.bottom + 16, label, "soft", anchor))
    return [*body, svg.line(frame.left, frame.bottom, frame.right, frame.bottom, rule)]
