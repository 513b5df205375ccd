"""Exposure variation analysis (Mathiassen and Winkel 1991; EXPOSURE.md A6): how long each level is kept."""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.resampling import Resampling, find_ranges
from fusion.exposure.rows import add_rows, find_part_rows
from fusion.exposure.types import Eva, EvaSummary, Interval
from fusion.numba_kernels import inner, kernel
from fusion.recording import Float64Array, IntArray

ANGLE_EDGES_DEG = (0.0, 20.0, 30.0, 60.0, 90.0, 180.0)
DURATION_EDGES_S = (0.0, 1.0, 3.0, 7.0, 15.0, 31.0, 63.0, 127.0, 255.0, None)
SHAPE = (len(ANGLE_EDGES_DEG) - 1, len(DURATION_EDGES_S) - 1)
MIDDLE_OF_LONGEST_S = 255.0 * 1.5


class _Classes(NamedTuple):
    """What divides the rows of one segment, for the kernels.

    ``levels_deg``, rising, are the edges of the classes of angle at every error, and ``error_of`` the error
    that each belongs to; ``upper_rows`` the edges of the classes of duration; ``block_rows`` the first row of
    each 5-minute block.
    """

    levels_deg: Float64Array
    error_of: IntArray
    upper_rows: Float64Array
    block_rows: IntArray
    period_s: float


@dataclass(frozen=True, slots=True, eq=False)
class EvaTally:
    """Seconds by error of the angle, 5-minute block, angle class and duration of the uninterrupted stay.

    ``errors_deg`` has shape (g,), 0 in the middle; ``seconds``, shape (g, b, 5, 9), is filled in place.
    A stay counts in every block by its time there, in the class of its whole length.
    """

    errors_deg: Float64Array
    edges_us: IntArray
    seconds: Float64Array

    def add(self, angle: MetricAngle) -> None:
        """Count a segment: with an error b, a class begins b lower (see :mod:`fusion.exposure.episodes`)."""
        levels = np.array(ANGLE_EDGES_DEG[1:-1]) - self.errors_deg[:, np.newaxis]
        order = np.argsort(levels, axis=None, kind="stable")
        longest_s = np.array(DURATION_EDGES_S[1:-1], np.float64)
        upper_rows = np.ceil(longest_s * angle.rate_hz - 1e-3)  # a stay of an edge's length belongs above it
        classes = _Classes(
            np.round(levels.ravel()[order], 9),
            order // levels.shape[1],
            upper_rows,
            find_part_rows(angle, self.edges_us),
            1.0 / angle.rate_hz,
        )
        state = np.full((len(self.seconds), 2), -1)
        scan_classes(angle.elevation_deg, angle.valid, classes, state, self.seconds)

    def summarise(self) -> Eva:
        """Give the matrix of the angle as it was read, in percent of the analysed time."""
        seconds = self.seconds[len(self.errors_deg) // 2].sum(axis=0)
        return Eva(ANGLE_EDGES_DEG, DURATION_EDGES_S, 100.0 * seconds / seconds.sum())


def start_eva(errors_deg: Float64Array, edges_us: IntArray) -> EvaTally:
    """Start with nothing counted."""
    return EvaTally(errors_deg, edges_us, np.zeros((len(errors_deg), len(edges_us) - 1, *SHAPE)))


@kernel
def scan_classes(angle_deg, valid, classes, state, seconds):  # type: ignore[no-untyped-def]
    """Follow the class of every error at once: it changes only where the angle passes one of the levels.

    ``reached`` is how many of the levels, from the lowest, the angle has reached; ``state``, shape (g, 2),
    holds the first row and the class of the stay under way at each error.
    """
    levels, error_of = classes.levels_deg, classes.error_of
    block, reached, low, high = 0, -1, np.inf, -np.inf
    for i in range(len(angle_deg) + 1):
        if i == len(angle_deg) or not valid[i]:
            if reached >= 0:
                for error in range(len(state)):
                    block = _end_stay(error, i, state[error, 1], block, state, classes, seconds)
            reached, low, high = -1, np.inf, -np.inf
            continue
        x = angle_deg[i]
        if low <= x < high:
            continue
        if reached < 0:
            reached = 0
            for error in range(len(state)):
                state[error, 0], state[error, 1] = i, 0
        while reached < len(levels) and x >= levels[reached]:
            error = error_of[reached]
            block = _end_stay(error, i, state[error, 1] + 1, block, state, classes, seconds)
            reached += 1
        while reached > 0 and x < levels[reached - 1]:
            reached -= 1
            error = error_of[reached]
            block = _end_stay(error, i, state[error, 1] - 1, block, state, classes, seconds)
        low = levels[reached - 1] if reached > 0 else -np.inf
        high = levels[reached] if reached < len(levels) else np.inf


@inner
def _end_stay(error, row, new_level, block, state, classes, seconds):  # type: ignore[no-untyped-def]
    """Count the stay that ends before ``row``, and go to the class ``new_level``.

    ``block`` is a block that begins before ``row``; that of the row before is given back. Most stays lie in
    one block and are short, which is why both are looked for from there and from the shortest on.
    """
    upper_rows, block_rows, period_s = classes.upper_rows, classes.block_rows, classes.period_s
    first, level = state[error, 0], state[error, 1]
    if row > first:
        while block < seconds.shape[1] - 1 and block_rows[block + 1] < row:
            block += 1
        length = 0
        while length < len(upper_rows) and row - first >= upper_rows[length]:
            length += 1
        if first >= block_rows[block]:
            seconds[error, block, level, length] += (row - first) * period_s
        else:
            add_rows(first, row, period_s, block_rows, seconds[error, :, level, length])
    state[error, 0], state[error, 1] = row, new_level
    return block


def summarise_eva_matrix(eva: Eva) -> EvaSummary:
    """Give the marginals, the standard deviation of the cells and the centroid of the matrix.

    The centroid is in degrees (middles of the angle classes) and seconds (middles of the duration classes;
    the last, without an end, at one and a half times its beginning).
    """
    by_angle, by_duration = eva.percent.sum(axis=1), eva.percent.sum(axis=0)
    middle_deg, middle_s = _find_middles()
    return EvaSummary(
        by_angle_percent=tuple(by_angle.tolist()),
        by_duration_percent=tuple(by_duration.tolist()),
        cell_sd_percent=float(eva.percent.std()),
        centroid_deg=float(by_angle @ middle_deg / 100.0),
        centroid_s=float(by_duration @ middle_s / 100.0),
    )


def _find_middles() -> tuple[Float64Array, Float64Array]:
    ends = [edge if edge is not None else 2 * MIDDLE_OF_LONGEST_S - 255.0 for edge in DURATION_EDGES_S]
    edges_deg, edges_s = np.array(ANGLE_EDGES_DEG), np.array(ends)
    return (edges_deg[:-1] + edges_deg[1:]) / 2.0, (edges_s[:-1] + edges_s[1:]) / 2.0


@dataclass(frozen=True, slots=True, eq=False)
class EvaDraws:
    """The matrix of each draw, percent, shape (200, 5, 9)."""

    percent: Float64Array

    def find_cells(self) -> tuple[tuple[Interval, ...], ...]:
        """Give the interval of each cell, five rows of nine."""
        cells = find_ranges(self.percent.reshape(len(self.percent), -1))
        columns = SHAPE[1]
        return tuple(tuple(cells[row * columns : (row + 1) * columns]) for row in range(SHAPE[0]))

    def name_summaries(self) -> dict[str, Interval]:
        """Give the intervals of the sums over rows and columns, of the spread and of the centroid."""
        by_angle, by_duration = self.percent.sum(axis=2), self.percent.sum(axis=1)
        middle_deg, middle_s = _find_middles()
        figures = {
            **{f"eva_{name}_deg_percent": by_angle[:, k] for k, name in enumerate(name_classes())},
            **{f"eva_{name}_s_percent": by_duration[:, k] for k, name in enumerate(name_durations())},
            "eva_cell_sd_percent": self.percent.std(axis=(1, 2)),
            "eva_centroid_deg": by_angle @ middle_deg / 100.0,
            "eva_centroid_s": by_duration @ middle_s / 100.0,
        }
        return dict(zip(figures, find_ranges(np.stack(list(figures.values()), axis=1)), strict=True))


def draw_eva(tally: EvaTally, draws: Resampling) -> EvaDraws:
    """Draw the matrix again, with an error of the angle and with blocks of the day drawn again."""
    seconds = draws.sum_with_error(tally.seconds, tally.errors_deg)
    return EvaDraws(100.0 * seconds / seconds.sum(axis=(1, 2), keepdims=True))


def name_classes() -> list[str]:
    """Name the angle classes as in columns: ``20_30``."""
    return [f"{a:g}_{b:g}" for a, b in pairwise(ANGLE_EDGES_DEG)]


def name_durations() -> list[str]:
    """Name the duration classes as in columns: ``1_3``, the last ``255_up``."""
    ends = [*(f"{edge:g}" for edge in DURATION_EDGES_S if edge is not None), "up"]
    return [f"{a}_{b}" for a, b in pairwise(ends)]
