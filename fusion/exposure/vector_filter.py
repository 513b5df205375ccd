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
    section, steady = design_filter(rate_hz)
    margin = round(MARGIN_S * rate_hz)
    for first in range(0, max(len(vectors) - 1, 1), BLOCK_ROWS):
        stop = min(first + BLOCK_ROWS + 1, len(vectors))
        around = slice(max(first - margin, 0), stop + margin)
        filtered = filter_vectors(vectors[around], section, steady)
        yield first, filtered[first - around.start : stop - around.start]


def filter_vectors(
    vectors: NDArray[np.float32], section: NDArray[np.float64], steady: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Low-pass vectors, shape (n, 3), without delay."""
    padding = min(PADDING_ROWS, len(vectors) - 1)
    padded = np.empty((len(vectors) + 2 * padding, 3))
    _filter_padded_vectors(vectors, padding, section, steady, padded)
    return padded[padding : padding + len(vectors)]


@njit(cache=True, nogil=True)
def _filter_padded_vectors(vectors, padding, section, steady, padded):  # type: ignore[no-untyped-def]
    """Write the odd extension into ``padded`` and filter it there, forth and back."""
    n = len(vectors)
    for c in range(3):
        for i in range(n):
            padded[padding + i, c] = vectors[i, c]
        for i in range(1, padding + 1):
            padded[padding - i, c] = 2.0 * vectors[0, c] - vectors[i, c]
            padded[padding + n - 1 + i, c] = 2.0 * vectors[n - 1, c] - vectors[n - 1 - i, c]
    _pass_vectors_in_place(padded, section, steady)
    _pass_vectors_in_place(padded[::-1], section, steady)


@njit(cache=True, nogil=True)
def _pass_vectors_in_place(v, section, steady):  # type: ignore[no-untyped-def]
    """One pass; the three axes side by side, for each waits on its own last row only."""
    b0, b1, b2, a1, a2 = section
    p0, q0, r0 = steady[0] * v[0, 0], steady[0] * v[0, 1], steady[0] * v[0, 2]
    p1, q1, r1 = steady[1] * v[0, 0], steady[1] * v[0, 1], steady[1] * v[0, 2]
    for i in range(len(v)):
        x, y, z = v[i, 0], v[i, 1], v[i, 2]
        fx, fy, fz = b0 * x + p0, b0 * y + q0, b0 * z + r0
        p0, q0, r0 = b1 * x - a1 * fx + p1, b1 * y - a1 * fy + q1, b1 * z - a1 * fz + r1
        p1, q1, r1 = b2 * x - a2 * fx, b2 * y - a2 * fy, b2 * z - a2 * fz
        v[i, 0], v[i, 1], v[i, 2] = fx, fy, fz
