"""Exposure variation analysis (Mathiassen and Winkel 1991): how long each level is kept."""

from itertools import pairwise

import numpy as np

from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.resampling import Figures, Resampling
from fusion.exposure.types import Eva, EvaSummary
from fusion.numba_kernels import inner, kernel
from fusion.recording import Float64Array, IntArray
from fusion.runs import add_rows, find_part_rows

ANGLE_EDGES_DEG = (0.0, 20.0, 30.0, 60.0, 90.0, 180.0)
DURATION_EDGES_S = (0.0, 1.0, 3.0, 7.0, 15.0, 31.0, 63.0, 127.0, 255.0, None)
SHAPE = (len(ANGLE_EDGES_DEG) - 1, len(DURATION_EDGES_S) - 1)
MIDDLES_DEG = np.array([(low + high) / 2.0 for low, high in pairwise(ANGLE_EDGES_DEG)])
MIDDLES_S = np.array(
    [
        (low or 0.0) * 1.5 if high is None else ((low or 0.0) + high) / 2.0
        for low, high in pairwise(DURATION_EDGES_S)
    ]
)
"""The last class, without an end, counts as one and a half times its beginning."""


class EvaTally:
    """Seconds by error of the angle, 5-minute block, angle class and duration of the uninterrupted stay.

    ``seconds``, shape (g, b, 5, 9). A stay counts in every block by its time there, in the class of its whole
    length.
    """

    def __init__(self, errors_deg: Float64Array, edges_us: IntArray) -> None:
        """Start with nothing counted; ``errors_deg``, shape (g,), has 0 in the middle."""
        self.errors_deg, self.edges_us = errors_deg, edges_us
        self.seconds = np.zeros((len(errors_deg), len(edges_us) - 1, *SHAPE))

    def add(self, angle: MetricAngle) -> None:
        """Count a segment: with an error b, a class begins b lower."""
        levels = np.array(ANGLE_EDGES_DEG[1:-1]) - self.errors_deg[:, np.newaxis]
        order = np.argsort(levels, axis=None, kind="stable")
        longest_s = np.array(DURATION_EDGES_S[1:-1], np.float64)
        upper_rows = np.ceil(longest_s * angle.rate_hz - 1e-3)  # a stay of an edge's length belongs above it
        block_rows = find_part_rows(angle, self.edges_us)
        lengths = (upper_rows, block_rows, 1.0 / angle.rate_hz)
        state = np.full((len(self.seconds), 2), -1)
        levels_deg, error_of = np.round(levels.ravel()[order], 9), order // levels.shape[1]
        _scan_classes(angle.elevation_deg, angle.valid, levels_deg, error_of, lengths, state, self.seconds)

    def summarise(self) -> Eva:
        """Return the matrix of the angle as it was read, in percent of the analysed time."""
        seconds = self.seconds[len(self.errors_deg) // 2].sum(axis=0)
        return Eva(ANGLE_EDGES_DEG, DURATION_EDGES_S, 100.0 * seconds / seconds.sum())

    def draw(self, draws: Resampling) -> tuple[Figures, Figures]:
        """Draw the cells, row by row, and the marginals, the spread and the centroid."""
        seconds = draws.sum_with_error(self.seconds, self.errors_deg)
        percent = 100.0 * seconds / seconds.sum(axis=(1, 2), keepdims=True)
        by_angle, by_duration = percent.sum(axis=2), percent.sum(axis=1)
        summaries = {
            **{f"eva_{name}_deg_percent": by_angle[:, k] for k, name in enumerate(name_classes())},
            **{f"eva_{name}_s_percent": by_duration[:, k] for k, name in enumerate(name_durations())},
            "eva_cell_sd_percent": percent.std(axis=(1, 2)),
            "eva_centroid_deg": by_angle @ MIDDLES_DEG / 100.0,
            "eva_centroid_s": by_duration @ MIDDLES_S / 100.0,
        }
        return {str(k): cell for k, cell in enumerate(percent.reshape(len(percent), -1).T)}, summaries


@kernel
def _scan_classes(angle_deg, valid, levels, error_of, lengths, state, seconds):  # type: ignore[no-untyped-def]
    """Follow the class of every error at once: it changes only where the angle passes one of the levels.

    ``levels``, rising, are the edges of the classes of angle at every error, and ``error_of`` the error that
    each belongs to; ``lengths`` the edges of the classes of duration, the first row of each block, and the
    seconds of a row. ``reached`` is how many of the levels the angle has reached; ``state``, shape (g, 2),
    holds the first row and the class of the stay under way at each error.
    """
    block, reached, low, high = 0, -1, np.inf, -np.inf
    for i in range(len(angle_deg) + 1):
        if i == len(angle_deg) or not valid[i]:
            if reached >= 0:
                for error in range(len(state)):
                    block = _end_stay(error, i, state[error, 1], block, state, lengths, seconds)
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
            block = _end_stay(error, i, state[error, 1] + 1, block, state, lengths, seconds)
            reached += 1
        while reached > 0 and x < levels[reached - 1]:
            reached -= 1
            error = error_of[reached]
            block = _end_stay(error, i, state[error, 1] - 1, block, state, lengths, seconds)
        low = levels[reached - 1] if reached > 0 else -np.inf
        high = levels[reached] if reached < len(levels) else np.inf


@inner
def _end_stay(error, row, new_level, block, state, lengths, seconds):  # type: ignore[no-untyped-def]
    """Count the stay that ends before ``row``, and go to the class ``new_level``.

    ``block`` is a block that begins before ``row``; that of the row before is given back. Most stays lie in
    one block and are short, which is why both are looked for from there and from the shortest on.
    """
    upper_rows, block_rows, period_s = lengths
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
    """Return the marginals, the standard deviation of the cells and the centroid of the matrix.

    The centroid is in degrees (middles of the angle classes) and seconds (middles of the duration classes).
    """
    by_angle, by_duration = eva.percent.sum(axis=1), eva.percent.sum(axis=0)
    return EvaSummary(
        by_angle_percent=tuple(by_angle.tolist()),
        by_duration_percent=tuple(by_duration.tolist()),
        cell_sd_percent=float(eva.percent.std()),
        centroid_deg=float(by_angle @ MIDDLES_DEG / 100.0),
        centroid_s=float(by_duration @ MIDDLES_S / 100.0),
    )


def name_classes() -> list[str]:
    """Name the angle classes as in columns: ``20_30``."""
    return [f"{a:g}_{b:g}" for a, b in pairwise(ANGLE_EDGES_DEG)]


def name_durations() -> list[str]:
    """Name the duration classes as in columns: ``1_3``, the last ``255_up``."""
    ends = [*(f"{edge:g}" for edge in DURATION_EDGES_S if edge is not None), "up"]
    return [f"{a}_{b}" for a, b in pairwise(ends)]
