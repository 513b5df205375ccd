"""Numbers as text, millions of rows at a time: fixed decimals from whole numbers, so nothing is rounded."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
WholeNumbers = NDArray[np.int64]

_COMMA, _DOT, _MINUS, _NEWLINE, _ZERO = 44, 46, 45, 10, 48


@njit(cache=True, nogil=True)
def put_digits(out: Bytes, at: int, value: int, width: int) -> int:  # pragma: no cover - compiled
    """Write ``value`` >= 0 with leading zeros to at least ``width`` digits; returns the place after it."""
    digits, rest = 1, value // 10
    while rest > 0:
        digits += 1
        rest //= 10
    end = at + max(digits, width)
    for place in range(end - 1, at - 1, -1):
        out[place] = _ZERO + value % 10
        value //= 10
    return end


@njit(cache=True, nogil=True)
def put_fixed(out: Bytes, at: int, value: int, decimals: int) -> int:  # pragma: no cover - compiled
    """Write ``value`` / 10**decimals with all its decimals; returns the place after it."""
    if value < 0:
        out[at] = _MINUS
        at += 1
        value = -value
    one = 10**decimals
    at = put_digits(out, at, value // one, 1)
    out[at] = _DOT
    return put_digits(out, at + 1, value % one, decimals)


@njit(cache=True, nogil=True)
def put_counter_rows(
    out: Bytes, counter: WholeNumbers, values: WholeNumbers, decimals: WholeNumbers
) -> int:  # pragma: no cover - compiled
    """Write rows ``counter,value,...``; ``values`` (n, columns) are in units of 10**-decimals.

    Returns the number of bytes written; ``out`` must hold 24 bytes for each number.
    """
    at = 0
    for i in range(values.shape[0]):
        at = put_digits(out, at, counter[i], 1)
        for column in range(values.shape[1]):
            out[at] = _COMMA
            at = put_fixed(out, at + 1, values[i, column], decimals[column])
        out[at] = _NEWLINE
        at += 1
    return at


@njit(cache=True, nogil=True)
def put_stamped_rows(out: Bytes, seconds: Bytes, values: WholeNumbers) -> int:  # pragma: no cover - compiled
    """Write 100 rows for each second: ``SECOND.ff00000,value,...`` with values in millionths.

    ``seconds`` (s, width): the stamp of each second as text; ``values`` (100 s, columns). Returns the number
    of bytes written; ``out`` must hold 24 bytes for each number and 32 for the stamp.
    """
    at = 0
    for i in range(values.shape[0]):
        for place in range(seconds.shape[1]):
            out[at + place] = seconds[i // 100, place]
        at += seconds.shape[1]
        out[at] = _DOT
        at = put_digits(out, at + 1, (i % 100) * 100_000, 7)
        for column in range(values.shape[1]):
            out[at] = _COMMA
            at = put_fixed(out, at + 1, values[i, column], 6)
        out[at] = _NEWLINE
        at += 1
    return at
