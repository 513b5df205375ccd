"""The metric filter on vectors, in overlapping blocks, so that memory does not grow with the recording."""

from collections.abc import Iterator

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.exposure.metric_filter import PADDING_ROWS, design_filter
from fusion.orientation.on_demand import VerticalOnDemand

BLOCK_ROWS = 32_768
MARGIN_S = 2.0  # what a cut does to the filter at 5 Hz has died down to 1e-19 after 2 s


def filter_blocks(
    vectors: NDArray[np.float32] | VerticalOnDemand, rate_hz: float
) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Give the filtered vectors, shape (n, 3), as blocks (first row, vectors).

    Each block but the first begins with the last row of the one before, so that steps can be taken inside
    blocks. The sum over blocks is that of filtering the whole.
    """
    section = design_filter(rate_hz)
    margin = round(MARGIN_S * rate_hz)
    for first in range(0, max(len(vectors) - 1, 1), BLOCK_ROWS):
        stop = min(first + BLOCK_ROWS + 1, len(vectors))
        around = slice(max(first - margin, 0), stop + margin)
        filtered = filter_vectors(vectors[around], section)
        yield first, filtered[first - around.start : stop - around.start]


def filter_vectors(vectors: NDArray[np.float32], section: tuple[float, ...]) -> NDArray[np.float64]:
    """Low-pass vectors, shape (n, 3), without delay."""
    padding = min(PADDING_ROWS, len(vectors) - 1)
    padded = np.empty((len(vectors) + 2 * padding, 3))
    _filter_padded_vectors(vectors, padding, section, padded)
    return padded[padding : padding + len(vectors)]


@njit(cache=True, nogil=True)
def _filter_padded_vectors(vectors, padding, section, padded):  # type: ignore[no-untyped-def]
    """Write the odd extension into ``padded`` and filter it there, forth and back."""
    n = len(vectors)
    for c in range(3):
        for i in range(n):
            padded[padding + i, c] = vectors[i, c]
        for i in range(1, padding + 1):
            padded[padding - i, c] = 2.0 * vectors[0, c] - vectors[i, c]
            padded[padding + n - 1 + i, c] = 2.0 * vectors[n - 1, c] - vectors[n - 1 - i, c]
    _pass_vectors_in_place(padded, section)
    _pass_vectors_in_place(padded[::-1], section)


@njit(cache=True, nogil=True)
def _pass_vectors_in_place(v, section):  # type: ignore[no-untyped-def]
    """One pass in direct form I; the three axes side by side, for each waits on its own last row only."""
    b0, b1, b2, a1, a2 = section
    px, py, pz = v[0, 0], v[0, 1], v[0, 2]  # what came in: the row before, and the one before that
    qx, qy, qz = px, py, pz
    fx, fy, fz = px, py, pz  # what went out
    gx, gy, gz = px, py, pz
    for i in range(len(v)):
        x, y, z = v[i, 0], v[i, 1], v[i, 2]
        tx = b0 * x + b1 * px + b2 * qx - a2 * gx
        ty = b0 * y + b1 * py + b2 * qy - a2 * gy
        tz = b0 * z + b1 * pz + b2 * qz - a2 * gz
        qx, qy, qz, px, py, pz = px, py, pz, x, y, z
        gx, gy, gz = fx, fy, fz
        fx, fy, fz = tx - a1 * fx, ty - a1 * fy, tz - a1 * fz
        v[i, 0], v[i, 1], v[i, 2] = fx, fy, fz
