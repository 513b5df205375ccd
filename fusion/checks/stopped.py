"""Rows that hold no reading, and single axes that stop again and again while the sensor is turned.

An axis of a part with noise does not keep one value and then leap by many counts to where the movement has
gone meanwhile. Three signs are asked for: the same reading in several rows; a leap at one end that neither
the rows outside of it nor the sensor's other axes share; and either the same leap back at the other end, or
movement in between that other channels show. In the recordings in hand, taps and vibration included, no
reading that was measured shows them. Such a part is faulty and refused; nothing is put in its place.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.checks.clipping import FLAT_TOP_SHARE
from fusion.checks.summary import BLOCK_ROWS, SensorSummary, Summaries, summarise
from fusion.numba_kernels import inner, kernel
from fusion.recording import MICROSECONDS, Segment, Span

# Ranges of rows: found where all channels rest, joined, and taken out of a segment.


LEAST_PART, MOST_TIMES = 0.1, 3.0
"""An axis reads 0.58 of gravity where all read alike."""
Rows = NDArray[np.int64]
Values = NDArray[np.float32]
Ranges = Sequence[tuple[int, int]]
"""First row and first row after, in order."""


def find_held_runs(
    acc: SensorSummary, gyr: SensorSummary, shortest_rows: int, axes: tuple[int, int] = (0, 3)
) -> Rows:
    """Runs in which some axes (first, first after) of both sensors keep their values, shape (m, 2)."""
    if not all(sensor.keeps(axis, shortest_rows) for sensor in (acc, gyr) for axis in range(*axes)):
        return np.empty((0, 2), np.int64)
    runs = np.empty((len(acc.samples) // max(shortest_rows - 1, 1) + 1, 2), np.int64)
    return runs[: _find_held(acc.samples, gyr.samples, shortest_rows, axes, runs)]


@kernel
def _find_held(acc: Any, gyr: Any, shortest_rows: int, axes: Any, runs: Any) -> int:  # pragma: no cover
    """Such a run holds one of any ``shortest - 1`` repeats that follow each other: look around these only."""
    stride = max(shortest_rows - 1, 1)
    found, k = 0, stride
    while k < len(acc):
        first, stop = k, k
        while first > 0 and k - first < shortest_rows and _is_repeat(acc, gyr, first, axes):
            first -= 1
        while first < k and stop < len(acc) and _is_repeat(acc, gyr, stop, axes):
            stop += 1
        if stop - first >= shortest_rows:
            runs[found, 0], runs[found, 1] = first, stop
            found += 1
        k = max(k, stop - 1) + stride
    return found


@inner
def _is_repeat(acc: Any, gyr: Any, row: int, axes: Any) -> bool:  # pragma: no cover
    """Whether a row equals the one before on some axes of both sensors."""
    for axis in range(axes[0], axes[1]):
        if acc[row, axis] != acc[row - 1, axis] or gyr[row, axis] != gyr[row - 1, axis]:
            return False
    return True


def mark_fillers(acc: Values, gyr: Values, usual_g: float) -> NDArray[np.bool_]:
    """Which rows show one size on all axes of each sensor, and the first one that gravity cannot have, (n,).

    ``usual_g``: length of the acceleration as a rule. So reads a sensor that does not answer: 0, or -1 count.
    """
    marked = mark_equal(acc, LEAST_PART * usual_g, MOST_TIMES * usual_g)
    if marked.any():  # few files have such
        marked &= mark_equal(gyr, np.inf, np.inf)
    return marked


def mark_equal(values: Values, low: float, high: float) -> NDArray[np.bool_]:
    """Which rows show one size on all axes, under ``low`` or over ``high``, shape (n,)."""
    marked = np.empty(len(values), np.bool_)
    _mark_equal(values, low, high, marked)
    return marked


@kernel
def _mark_equal(values: Any, low: float, high: float, marked: Any) -> None:  # pragma: no cover
    for row in range(len(values)):
        size = abs(values[row, 0])
        is_equal = size == abs(values[row, 1]) and size == abs(values[row, 2])
        marked[row] = is_equal and (size < low or size > high)


def find_runs(marked: NDArray[np.bool_], shortest_rows: int = 1) -> Rows:
    """Runs of marked rows, so long at least, shape (m, 2): first row and first row after."""
    rows = np.flatnonzero(marked)
    is_first = np.diff(rows, prepend=-2) > 1
    runs = np.stack([rows[is_first], rows[np.roll(is_first, -1)] + 1], axis=1)
    return runs[runs[:, 1] - runs[:, 0] >= shortest_rows]


def place_rows(segment: Segment, first_row: int, stop_row: int, reason: str = "") -> Span:
    """Rows as a stretch of the recording."""
    start_us, end_us = (
        segment.start_us + round(row * MICROSECONDS / segment.rate_hz) for row in (first_row, stop_row)
    )
    return Span(start_us, end_us - start_us, reason)


def join_ranges(ranges: Ranges) -> list[tuple[int, int]]:
    """Make one of ranges, ordered by their first rows, that overlap or touch."""
    joined: list[tuple[int, int]] = []
    for first, stop in ranges:
        if joined and first <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(stop, joined[-1][1]))
        else:
            joined.append((first, stop))
    return joined


def cut_rows(segment: Segment, ranges: Ranges) -> list[Segment]:
    """What is left of a segment without some of its rows."""
    if not ranges:
        return [segment]
    edges = [0, *(row for pair in ranges for row in pair), len(segment)]
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [_take_rows(segment, first, stop) for first, stop in pairs if stop > first]


def _take_rows(segment: Segment, first_row: int, stop_row: int) -> Segment:
    """Rounded to the microsecond, yet never beyond the end of the whole."""
    bridged = [(max(a, first_row) - first_row, min(b, stop_row) - first_row) for a, b in segment.bridged]
    piece = replace(
        segment,
        start_us=place_rows(segment, 0, first_row).end_us,
        acc_g=segment.acc_g[first_row:stop_row],
        gyr_dps=segment.gyr_dps[first_row:stop_row],
        bridged=tuple((a, b) for a, b in bridged if b > a),
    )
    return replace(piece, start_us=piece.start_us - max(0, piece.end_us - segment.end_us))


LEAP_G, LEAP_DPS = 0.1, 5.0
"""A leap by less, at the rates at which an arm moves, costs a fraction of a degree."""
MOVED_G, MOVED_DPS = 0.05, 5.0
LEAP_COUNTS = 10.0
"""The size of a leap of coarse readings, in counts."""
SMOOTH_PART = 0.5
"""The steps around a leap are smaller than this part of it: a knock rings."""
FEWEST_ROWS, FEWEST_BETWEEN_LEAPS = 5, 3
PROVEN_STOPS = 5
SAMPLED_ROWS = 20_000


def find_stopping(segments: Sequence[Segment], known: Summaries = ()) -> int | None:
    """Find the channel (0 to 2 acceleration, 3 to 5 rate) that stops most: once a minute, five times.

    A sensor that holds most of its readings for several rows is slower than the table: it does not stop.
    """
    seen = summarise(segments, known)
    held = [_is_held([one.acc for one in seen]), _is_held([one.gyr for one in seen])]
    counts = [0 if held[channel // 3] else _count(seen, channel) for channel in range(6)]
    worst = int(np.argmax(counts))
    minutes = sum(segment.duration_us for segment in segments) / MICROSECONDS / 60.0
    return worst if counts[worst] >= max(PROVEN_STOPS, minutes) else None


def _is_held(sensors: Sequence[SensorSummary]) -> bool:
    """Whether a sensor gives most of its readings, all three axes at once, in two rows or more."""
    return 2 * sum(sensor.held for sensor in sensors) > sum(sensor.readings for sensor in sensors)


def _count(seen: Summaries, channel: int) -> int:
    """How often a channel stops; a leap is at least ten of its small steps."""
    axis, is_rate = channel % 3, channel >= 3
    sensors = [one.gyr if is_rate else one.acc for one in seen]
    own = max((sensor.samples for sensor in sensors), key=len)
    stride = max(2, len(own) // SAMPLED_ROWS)
    steps = np.abs(own[1::stride, axis] - own[: len(own) - 1 : stride, axis])
    small = float(np.quantile(steps[steps > 0.0], 0.1)) if steps.any() else 0.0
    leap = max(LEAP_DPS if is_rate else LEAP_G, LEAP_COUNTS * small)
    moved = (MOVED_DPS, MOVED_G) if is_rate else (MOVED_G, MOVED_DPS)
    extreme = FLAT_TOP_SHARE * max(sensor.find_extreme(axis) for sensor in sensors)
    found = 0
    for one, sensor in zip(seen, sensors, strict=True):
        blocks = _find_leaps(sensor, axis, leap)
        if len(blocks):
            other = one.acc if is_rate else one.gyr
            found += _count_stops(sensor.samples, other.samples, (axis, leap, moved, extreme), blocks)
    return found


def _find_leaps(sensor: SensorSummary, axis: int, leap: float) -> NDArray[np.intp]:
    """Blocks with a leap, and a value that is kept for three rows on either side of it."""
    is_kept = np.pad(sensor.kept[axis] >= FEWEST_BETWEEN_LEAPS - 1, 1)
    is_near = is_kept[:-2] | is_kept[1:-1] | is_kept[2:]
    return np.flatnonzero(is_near & (sensor.step[axis] >= np.float64(leap)))


@kernel
def _count_stops(own: Any, other: Any, rules: Any, blocks: Any) -> int:  # pragma: no cover
    """How many runs of one value that begin or end with a leap in some blocks are stops."""
    axis, leap, count = rules[0], rules[1], 0
    for block in blocks:
        for row in range(max(block * BLOCK_ROWS, 1), min((block + 1) * BLOCK_ROWS, len(own))):
            if abs(own[row, axis] - own[row - 1, axis]) < leap:
                continue
            stop, first = row + 1, row - 1
            while stop < len(own) and own[stop, axis] == own[row, axis]:
                stop += 1
            count += _is_stop(own, other, rules, row, stop)
            while first > 0 and own[first - 1, axis] == own[row - 1, axis]:
                first -= 1
            if first == 0 or abs(own[first, axis] - own[first - 1, axis]) < leap:  # else it is counted there
                count += _is_stop(own, other, rules, first, row)
    return count


@inner
def _is_stop(own: Any, other: Any, rules: Any, first: int, stop: int) -> int:  # pragma: no cover
    """1 for a run with leaps at both ends that agree, or one and movement between; else 0."""
    axis, leap, moved, extreme = rules
    if stop - first < FEWEST_BETWEEN_LEAPS or abs(own[first, axis]) >= extreme:
        return 0
    before, after = _measure_leap(own, axis, first, stop, -1), _measure_leap(own, axis, first, stop, 1)
    low, high = min(abs(before), abs(after)), max(abs(before), abs(after))
    if before * after > 0.0 and low >= leap:
        return int(high - low < SMOOTH_PART * high)
    if stop - first < FEWEST_ROWS or high < leap:
        return 0
    for k in range(3):
        if k != axis and _measure_range(own, k, first, stop) > moved[0]:
            return 1
        if _measure_range(other, k, first, stop) > moved[1]:
            return 1
    return 0


@inner
def _measure_leap(own: Any, axis: int, first: int, stop: int, way: int) -> Any:  # pragma: no cover
    """How far the reading before a run (way -1), or after it (1), is from it.

    0 where the rows beyond leap too, or an axis that did not stop with it.
    """
    row = first if way < 0 else stop - 1
    out = row + way
    if out + 2 * way < 0 or out + 2 * way >= len(own):
        return 0.0
    leap = own[out, axis] - own[row, axis]
    most = SMOOTH_PART * abs(leap)
    for k in range(2):
        if abs(own[out + (k + 1) * way, axis] - own[out + k * way, axis]) > most:
            return 0.0
    for k in range(3):
        is_far = k != axis and abs(own[out, k] - own[row, k]) > most
        if is_far and _measure_range(own, k, first, stop) > 0.0:
            return 0.0
    return leap


@inner
def _measure_range(values: Any, axis: int, first: int, stop: int) -> Any:  # pragma: no cover
    """Largest less smallest reading."""
    low = high = values[first, axis]
    for row in range(first + 1, stop):
        low = min(low, values[row, axis])
        high = max(high, values[row, axis])
    return high - low
