"""Exposure variation analysis (Mathiassen and Winkel 1991; EXPOSURE.md A6): how long each level is kept."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.types import Eva

ANGLE_EDGES_DEG = (0.0, 20.0, 30.0, 60.0, 90.0, 180.0)
DURATION_EDGES_S = (0.0, 1.0, 3.0, 7.0, 15.0, 31.0, 63.0, 127.0, 255.0, None)
SHAPE = (len(ANGLE_EDGES_DEG) - 1, len(DURATION_EDGES_S) - 1)

FloatMatrix = NDArray[np.float64]


def tally_eva(angle: MetricAngle) -> FloatMatrix:
    """Give the seconds of one segment by angle class and duration of the uninterrupted stay, shape (5, 9)."""
    upper_deg = np.array(ANGLE_EDGES_DEG[1:-1])
    longest_s = np.array(DURATION_EDGES_S[1:-1], np.float64)
    upper_rows = np.ceil(longest_s * angle.rate_hz - 1e-3)  # a stay of an edge's length belongs above it
    counts = np.zeros(SHAPE, np.int64)
    count_stays(angle.elevation_deg, angle.valid, upper_deg, upper_rows, counts)
    return counts / angle.rate_hz


@njit(cache=True, nogil=True)
def count_stays(angle_deg, valid, upper_deg, upper_rows, counts):  # type: ignore[no-untyped-def]
    """Add the rows of each stay in one angle class to that class and the class of the stay's length."""
    level, rows = -1, 0
    for i in range(len(angle_deg) + 1):
        here = -1
        if i < len(angle_deg) and valid[i]:
            here = np.searchsorted(upper_deg, angle_deg[i], side="right")
        if here != level:
            if level >= 0:
                counts[level, np.searchsorted(upper_rows, rows, side="right")] += rows
            level, rows = here, 0
        rows += 1


def summarise_eva(seconds: FloatMatrix) -> Eva:
    """Turn the day's seconds, shape (5, 9), into percent of the analysed time."""
    return Eva(ANGLE_EDGES_DEG, DURATION_EDGES_S, 100.0 * seconds / seconds.sum())
