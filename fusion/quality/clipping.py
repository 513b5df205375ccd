"""Where a sensor was driven to the end of its range (RELIABILITY.md 88)."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.exposure.rows import IntArray, find_runs
from fusion.recording import MICROSECONDS, Recording, Segment, Span

MARGIN_S = 0.1
RANGE_SHARE = 0.999  # of the full scale: the highest count of a signed range lies just under it
FLAT_ROWS = 3
LOWEST_ACC_RANGE_G = 1.9
LOWEST_GYR_RANGE_DPS = 240.0

FloatMatrix = NDArray[np.float32]


def find_clipped(recording: Recording) -> list[Span]:
    """Find the stretches with a clipped sample, widened by 100 ms (in whole rows) on each side.

    Where the file tells the full scale, a sample within 0.1 % of it is clipped. Where it does not, a channel
    is taken to be clipped at its extreme of the whole recording if it rests exactly there for three rows or
    more and no sensor has so small a range (2 g, 245 deg/s).
    """
    acc_limits = find_limits(
        [segment.acc_g for segment in recording.segments], recording.acc_range_g, LOWEST_ACC_RANGE_G
    )
    gyr_limits = find_limits(
        [segment.gyr_dps for segment in recording.segments], recording.gyr_range_dps, LOWEST_GYR_RANGE_DPS
    )
    return [
        span for segment in recording.segments for span in _find_in_segment(segment, acc_limits, gyr_limits)
    ]


def find_limits(pieces: list[FloatMatrix], full_scale: float | None, least: float) -> FloatMatrix:
    """Give the values at or past which each axis is clipped, low and high, shape (2, 3); else infinite."""
    if full_scale is not None:
        limit = np.float32(full_scale * RANGE_SHARE)
        return np.array([[-limit] * 3, [limit] * 3], np.float32)
    limits = np.array([[-np.inf] * 3, [np.inf] * 3], np.float32)
    filled = [piece for piece in pieces if len(piece)]
    for axis in range(3 if filled else 0):
        for side, sign in ((0, -1.0), (1, 1.0)):
            extreme = max(sign * find_extreme(piece, axis, sign) for piece in filled)
            longest = max(measure_flat(piece, axis, np.float32(sign * extreme)) for piece in filled)
            if extreme >= least and longest >= FLAT_ROWS:
                limits[side, axis] = sign * extreme
    return limits


@njit(cache=True, nogil=True)
def find_extreme(samples, axis, sign):  # type: ignore[no-untyped-def]
    """Give the highest value of an axis, or the lowest where ``sign`` is -1."""
    extreme = samples[0, axis]
    for i in range(1, len(samples)):
        if sign * samples[i, axis] > sign * extreme:
            extreme = samples[i, axis]
    return extreme


@njit(cache=True, nogil=True)
def measure_flat(samples, axis, value):  # type: ignore[no-untyped-def]
    """Give the longest run of rows in which an axis rests at a value."""
    longest, run = 0, 0
    for i in range(len(samples)):
        run = run + 1 if samples[i, axis] == value else 0
        longest = max(longest, run)
    return longest


def _find_in_segment(segment: Segment, acc_limits: FloatMatrix, gyr_limits: FloatMatrix) -> list[Span]:
    clipped = np.zeros(len(segment), np.bool_)
    count = mark_outside(segment.acc_g, acc_limits, clipped)
    count += mark_outside(segment.gyr_dps, gyr_limits, clipped)
    if count == 0:
        return []
    margin_rows = math.ceil(MARGIN_S * segment.rate_hz)  # whole rows, so that no part of a row is left over
    margin = np.array([-margin_rows, margin_rows])
    rows: IntArray = np.clip(find_runs(clipped) + margin, 0, len(segment))
    times_us = segment.start_us + np.rint(rows * (MICROSECONDS / segment.rate_hz)).astype(np.int64)
    return [Span(start_us, end_us - start_us, "clipped") for start_us, end_us in times_us.tolist()]


@njit(cache=True, nogil=True)
def mark_outside(samples, limits, marked):  # type: ignore[no-untyped-def]
    """Mark the rows with an axis at or past a limit; return how many there are."""
    count = 0
    for i in range(len(samples)):
        for axis in range(3):
            if samples[i, axis] <= limits[0, axis] or samples[i, axis] >= limits[1, axis]:
                marked[i] = True
                count += 1
                break
    return count
