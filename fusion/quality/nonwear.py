"""Where the sensor may have lain on a desk: proposed to the person, never applied (EXPOSURE.md A15).

The rule is stricter than that of Acti4 and ActiPASS (90 min without activity), which would miss a sensor that
is taken off for lunch: ten minutes or more in which, in each 10 s, no axis of the accelerometer has a
standard deviation of 0.013 g or more. An arm at rest on a person moves more than that through breathing and
small corrections over ten minutes, but a sleeper's may not: hence only a proposal.
"""

import numpy as np

from fusion.exposure.rows import find_runs
from fusion.numba_kernels import njit
from fusion.recording import MICROSECONDS, Recording, Segment, Span
from fusion.still_limits import OFF_THE_ARM

SHORTEST_S = 600.0


def propose_nonwear(recording: Recording, left_out: tuple[Span, ...] = ()) -> tuple[Span, ...]:
    """Give the stretches in which the sensor may not have been worn.

    ``left_out`` are stretches that are not analysed anyway; a proposal that lies wholly in them is dropped.
    """
    found = (span for segment in recording.segments for span in _find_still(segment))
    return tuple(span for span in found if not _is_covered(span, left_out))


def _is_covered(span: Span, left_out: tuple[Span, ...]) -> bool:
    """Say whether less than the shortest proposal is left of a stretch."""
    shared_us = (min(span.end_us, other.end_us) - max(span.start_us, other.start_us) for other in left_out)
    left_us = span.duration_us - sum(max(us, 0) for us in shared_us)
    return left_us < SHORTEST_S * MICROSECONDS


def _find_still(segment: Segment) -> list[Span]:
    rows = round(OFF_THE_ARM.window_s * segment.rate_hz)
    windows = len(segment) // max(rows, 1)
    if windows * OFF_THE_ARM.window_s < SHORTEST_S:
        return []
    still = np.zeros(windows, np.bool_)
    mark_still(segment.acc_g, rows, OFF_THE_ARM.acc_sd_g, still)
    runs = find_runs(still)
    long_enough = runs[(runs[:, 1] - runs[:, 0]) * rows >= SHORTEST_S * segment.rate_hz - 1e-3 * rows]
    times_us = segment.start_us + np.rint(long_enough * (rows * MICROSECONDS / segment.rate_hz))
    return [Span(int(a), int(b - a), "not-worn") for a, b in times_us]


@njit(cache=True, nogil=True)
def mark_still(acc_g, rows, still_g, still):  # type: ignore[no-untyped-def]
    """Mark the windows of ``rows`` rows in which every axis' standard deviation is under ``still_g``."""
    for k in range(len(still)):
        still[k] = True
        for axis in range(3):
            first = acc_g[k * rows, axis]
            total, squares = 0.0, 0.0
            for i in range(k * rows, (k + 1) * rows):
                value = acc_g[i, axis] - first  # about a value of the window, so that nothing cancels
                total += value
                squares += value * value
            if squares / rows - (total / rows) ** 2 >= still_g * still_g:
                still[k] = False
                break
