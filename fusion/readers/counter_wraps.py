"""Counters that start over: micros() and millis() of 32 bits, and loggers' own of 24 or 16."""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.readers.stamp_repair import count_backward, find_backward
from fusion.recording import MICROSECONDS, QualityFlag

BITS = (32, 24, 16)
MARGIN_US = 60 * MICROSECONDS
"""A wrap is one only near both ends of the counter: a logger that started again is none."""
ON_TIME_US = MICROSECONDS
"""So soon after the last row the next one comes at a wrap, but for holes."""


def unwrap_counter(stamps: NDArray[np.int64], tick_us: int) -> tuple[QualityFlag, ...]:
    """Undo the wraps of a counter of ``tick_us`` a count, in place (W-WRAP); 0 where stamps are no counts."""
    if tick_us == 0 or count_backward(stamps) == 0:
        return ()
    wraps = _unwrap_even(stamps, tick_us) or lift_wraps(stamps, 2 ** BITS[0] * tick_us, MARGIN_US)
    return (QualityFlag("W-WRAP", wraps),) if wraps else ()


def _unwrap_even(stamps: NDArray[np.int64], tick_us: int) -> int:
    """Undo wraps where every long step back, made up for by the counter's whole range, can be one.

    Most lead on without a hole, which a clock that was set does not; returns how many. A counter may have a
    sign: then it starts over at half its range below zero.
    """
    lowest, highest = int(stamps.min()), int(stamps.max())
    for bits in BITS:
        wrap_us = 2**bits * tick_us
        start_us = -wrap_us // 2 if lowest < 0 else 0
        if lowest < start_us or highest >= start_us + wrap_us:
            continue
        rows = find_backward(stamps, count_backward(stamps))
        rows = rows[stamps[rows - 1] - stamps[rows] > wrap_us // 2]
        led_us = stamps[rows] + wrap_us - stamps[rows - 1]
        if len(rows) and 2 * np.count_nonzero(led_us <= min(ON_TIME_US, wrap_us // 2)) > len(rows):
            add_wraps(stamps, rows, wrap_us)
            return len(rows)
    return 0


@njit(cache=True, nogil=True)
def add_wraps(stamps: NDArray[np.int64], rows: NDArray[np.int64], wrap_us: int) -> None:
    """Add a counter's range from each of ``rows`` on, in place."""
    for wrap in range(len(rows)):
        stop = rows[wrap + 1] if wrap + 1 < len(rows) else len(stamps)
        for row in range(rows[wrap], stop):
            stamps[row] += (wrap + 1) * wrap_us


@njit(cache=True, nogil=True)
def lift_wraps(stamps: NDArray[np.int64], wrap_us: int, margin_us: int) -> int:
    """Undo wraps from within ``margin_us`` of the counter's end to within as much of its start, in place."""
    shift = np.int64(0)
    wraps = 0
    previous_raw = stamps[0]
    for k in range(1, len(stamps)):
        raw = stamps[k]
        if previous_raw > wrap_us - margin_us and raw < margin_us:
            shift += wrap_us
            wraps += 1
        previous_raw = raw
        stamps[k] = raw + shift
    return wraps
