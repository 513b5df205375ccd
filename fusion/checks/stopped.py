"""Single axes that stop for a moment: stuck at one value, or at zero, while the sensor is turned.

An axis of a part with noise does not keep one value and then leap by many counts to where the movement has
gone meanwhile. Three signs are asked for: the same reading in several rows; a leap at one end that neither
the rows outside of it nor the sensor's other axes share; and either the same leap back at the other end, or
movement in between that other channels show. In the recordings in hand, taps and vibration included, no
reading that was measured shows them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion.checks.clipping import FLAT_TOP_SHARE
from fusion.numba_kernels import njit
from fusion.recording import MICROSECONDS, Segment, Span

# Ranges of rows: found where all channels rest, joined, and taken out of a segment.


# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)


LEAST_PART, MOST_TIMES = 0.1, 3.0
"""An axis reads 0.58 of gravity where all read alike."""
Rows = NDArray[np.int64]
Ranges = Sequence[tuple[int, int]]
"""First row and first row after, in order."""


@njit(cache=True, nogil=True)
def is_repeat(acc: NDArray[np.float32], gyr: NDArray[np.float32], row: int) -> bool:
    """Whether a row equals the one before on all channels."""
    for axis in range(3):
        if acc[row, axis] != acc[row - 1, axis] or gyr[row, axis] != gyr[row - 1, axis]:
            return False
    return True


@njit(cache=True, nogil=True)
def find_held_runs(acc: NDArray[np.float32], gyr: NDArray[np.float32], shortest_rows: int) -> Rows:
    """Runs in which all six channels keep their values, shape (m, 2).

    Such a run holds one of any ``shortest - 1`` repeats that follow each other: only there is looked around.
    """
    stride = max(shortest_rows - 1, 1)
    runs = np.empty((len(acc) // stride + 1, 2), np.int64)
    found, k = 0, stride
    while k < len(acc):
        first, stop = k, k
        while first > 0 and k - first < shortest_rows and is_repeat(acc, gyr, first):
            first -= 1
        while first < k and stop < len(acc) and is_repeat(acc, gyr, stop):
            stop += 1
        if stop - first >= shortest_rows:
            runs[found, 0], runs[found, 1] = first, stop
            found += 1
        k = max(k, stop - 1) + stride
    return runs[:found]


@njit(cache=True, nogil=True)
def is_filler(acc: NDArray[np.float32], gyr: NDArray[np.float32], row: int, usual_g: float) -> bool:
    """Whether each sensor shows one size on all axes, and the first one that gravity cannot have.

    ``usual_g``: length of the acceleration as a rule. So reads a sensor that does not answer: 0, or -1 count.
    """
    size = abs(acc[row, 0])
    if (
        abs(acc[row, 1]) != size
        or abs(acc[row, 2]) != size
        or LEAST_PART * usual_g <= size <= MOST_TIMES * usual_g
    ):
        return False
    return abs(gyr[row, 0]) == abs(gyr[row, 1]) and abs(gyr[row, 1]) == abs(gyr[row, 2])


@njit(cache=True, nogil=True)
def count_filler_runs(acc: NDArray[np.float32], gyr: NDArray[np.float32], usual_g: float) -> int:
    """How many runs of such rows there are."""
    count, was_one = 0, False
    for row in range(len(acc)):
        is_one = is_filler(acc, gyr, row, usual_g)
        count += int(is_one and not was_one)
        was_one = is_one
    return count


@njit(cache=True, nogil=True)
def find_filler_runs(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], usual_g: float, shortest_rows: int, most_rows: int
) -> Rows:
    """Runs of such rows, ``shortest_rows`` rows long or more and ``most_rows`` at most, shape (m, 2).

    Such a run covers one of any ``shortest_rows`` rows that follow each other: the search looks there only.
    """
    runs = np.empty((most_rows, 2), np.int64)
    found, k = 0, shortest_rows - 1
    while k < len(acc):
        first, stop = k, k
        while stop < len(acc) and is_filler(acc, gyr, stop, usual_g):
            stop += 1
        while (
            stop > k and first > 0 and k - first < shortest_rows and is_filler(acc, gyr, first - 1, usual_g)
        ):
            first -= 1
        if stop - first >= shortest_rows:
            runs[found, 0], runs[found, 1] = first, stop
            found += 1
        k = max(k, stop - 1) + shortest_rows
    return runs[:found]


@njit(cache=True, nogil=True)
def has_equal_sizes(values: NDArray[np.float32], low: float, high: float) -> bool:
    """Whether any row shows one size on all axes, under ``low`` or over ``high``; few files have such."""
    found = 0
    for row in range(len(values)):
        size = abs(values[row, 0])
        is_equal = int(size == abs(values[row, 1])) & int(size == abs(values[row, 2]))
        found += is_equal & (int(size < low) | int(size > high))
    return found > 0


@njit(cache=True, nogil=True)
def mark_fillers(acc: NDArray[np.float32], gyr: NDArray[np.float32], usual_g: float) -> NDArray[np.bool_]:
    """Which rows are such, shape (n,)."""
    marked = np.empty(len(acc), np.bool_)
    for row in range(len(acc)):
        marked[row] = is_filler(acc, gyr, row, usual_g)
    return marked


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


# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)


LEAP_G, LEAP_DPS = 0.1, 5.0
"""A leap by less, at the rates at which an arm moves, costs a fraction of a degree."""
MOVED_G, MOVED_DPS = 0.05, 5.0
LEAP_COUNTS, LEAP_STEPS = 10.0, 8.0
"""The size of a leap of coarse readings, in counts and in usual steps."""
SMOOTH_PART = 0.5
"""The steps around a leap are smaller than this part of it: a knock rings."""
FEWEST_ROWS, FEWEST_BETWEEN_LEAPS = 5, 3
PROVEN_STOPS = 3
SAMPLED_ROWS = 20_000
BLOCK_ROWS = 64

Values = NDArray[np.float32]
Stop = tuple[int, int, int]
"""Channel (0 to 2 accelerometer, 3 to 5 gyroscope), first row and first row after."""


@dataclass(frozen=True, slots=True)
class _Signs:
    """What a channel must show.

    ``leaps``: next to a run, and next to one or two rows of zero; ``moved``: its own sensor's other axes, or
    the other sensor; ``extreme``: from which size on a run is the end of the range.
    """

    leaps: tuple[float, float]
    moved: tuple[float, float]
    extreme: float


def find_stops(segments: Sequence[Segment]) -> list[list[Stop]]:
    """Find them in each segment.

    Where one channel stops often, always at one value, each rest at that value during movement is a stop.
    """
    found: list[list[Stop]] = [[] for _ in segments]
    for channel in range(6):
        signs = _choose_signs(segments, channel)
        stops = [_scan(segment, channel, signs) for segment in segments]
        value = _find_value(segments, channel, stops)
        if value is not None:
            stops = [_scan(segment, channel, signs, value) for segment in segments]
        for one, rows in zip(found, stops, strict=True):
            one += [(channel, first, stop) for first, stop in rows.tolist()]
    return found


def _sense(segment: Segment, channel: int) -> tuple[Values, Values]:
    """The channel's own sensor and the other one."""
    return (segment.acc_g, segment.gyr_dps) if channel < 3 else (segment.gyr_dps, segment.acc_g)


def _choose_signs(segments: Sequence[Segment], channel: int) -> _Signs:
    """A leap is at least ten of the channel's small steps; next to a zero or two, eight of its usual ones."""
    axis, is_acc = channel % 3, channel < 3
    own, _ = _sense(max(segments, key=len), channel)
    stride = max(2, len(own) // SAMPLED_ROWS)
    steps = np.abs(own[1::stride, axis] - own[: len(own) - 1 : stride, axis])
    small, usual = np.quantile(steps[steps > 0.0], [0.1, 0.5]).tolist() if steps.any() else (0.0, 0.0)
    leap = max(LEAP_G if is_acc else LEAP_DPS, LEAP_COUNTS * small)
    moved = (MOVED_G, MOVED_DPS) if is_acc else (MOVED_DPS, MOVED_G)
    columns = [_sense(segment, channel)[0][:, axis] for segment in segments]
    extreme = max(max(one.max(initial=0.0), -one.min(initial=0.0)) for one in columns)
    return _Signs((leap, max(leap, LEAP_STEPS * usual)), moved, FLAT_TOP_SHARE * float(extreme))


def _find_value(segments: Sequence[Segment], channel: int, stops: Sequence[Rows]) -> float | None:
    """The value at which a channel stops again and again, if it is mostly one."""
    pairs = list(zip(segments, stops, strict=True))
    values = np.concatenate([_sense(segment, channel)[0][rows[:, 0], channel % 3] for segment, rows in pairs])
    if len(values) < PROVEN_STOPS:
        return None
    named, counts = np.unique(values, return_counts=True)
    return float(named[counts.argmax()]) if 2 * counts.max() > len(values) else None


def _scan(segment: Segment, channel: int, signs: _Signs, value: float = np.nan) -> Rows:
    own, other = _sense(segment, channel)

    def scan(room: Rows) -> int:
        return scan_axis(own, other, channel % 3, signs.leaps, signs.moved, signs.extreme, value, room)

    found = np.empty((scan(np.empty((0, 2), np.int64)), 2), np.int64)
    if len(found):
        scan(found)
    return found


@njit(cache=True, nogil=True)
def scan_axis(  # noqa: PLR0913, PLR0917 (a kernel takes plain arrays)
    own: Values,
    other: Values,
    axis: int,
    leaps: tuple[float, float],
    moved: tuple[float, float],
    extreme: float,
    value: float,
    found: Rows,
) -> int:
    """Fill in the stops of one axis, as many as there is room for; return how many there are.

    Most rows stand in blocks without a leap, and are passed over: unless a value is given, no stop is there.
    """
    count, row, seen, is_passed = 0, 0, 0, False
    while row < len(own):
        if row >= seen:
            seen = min(row + BLOCK_ROWS, len(own))
            if np.isnan(value) and not has_leap(own, axis, row, seen, leaps[0]):
                row, is_passed = seen, True
                continue
        first = row - 1 if is_passed else row
        while is_passed and first > 0 and own[first - 1, axis] == own[first, axis]:
            first -= 1
        row, is_passed = find_end(own, axis, first), False
        if is_stop(own, other, axis, (first, row), leaps, moved, extreme, value):
            if count < len(found):
                found[count, 0], found[count, 1] = first, row
            count += 1
    return count


@njit(cache=True, nogil=True)
def has_leap(own: Values, axis: int, first_row: int, stop_row: int, least: float) -> bool:
    """Whether a reading is so far from the one before."""
    for row in range(max(first_row, 1), stop_row):
        if abs(own[row, axis] - own[row - 1, axis]) >= least:
            return True
    return False


@njit(cache=True, nogil=True)
def find_end(values: Values, axis: int, first_row: int) -> int:
    """The first row after a run of one value."""
    stop = first_row + 1
    while stop < len(values) and values[stop, axis] == values[first_row, axis]:
        stop += 1
    return stop


@njit(cache=True, nogil=True)
def is_stop(  # noqa: PLR0913, PLR0917 (a kernel takes plain arrays)
    own: Values,
    other: Values,
    axis: int,
    run: tuple[int, int],
    leaps: tuple[float, float],
    moved: tuple[float, float],
    extreme: float,
    value: float,
) -> bool:
    """Whether a run of one value shows the signs, or rests at the given value while other channels move."""
    first, stop = run
    held, is_long = own[first, axis], stop - first >= FEWEST_BETWEEN_LEAPS
    if not (is_long or held == 0.0) or abs(held) >= extreme:
        return False
    if is_plain_stop(own, other, axis, first, stop, leaps[0 if is_long else 1], moved):
        return True
    return held == value and stop - first >= FEWEST_ROWS and has_moved(own, other, axis, first, stop, moved)


@njit(cache=True, nogil=True)
def is_plain_stop(  # noqa: PLR0913, PLR0917 (a kernel takes plain arrays)
    own: Values,
    other: Values,
    axis: int,
    first_row: int,
    stop_row: int,
    leap: float,
    moved: tuple[float, float],
) -> bool:
    """Whether a run of one value is a stop: leaps at both ends that agree, or one and movement between."""
    if keeps_all(own, first_row, stop_row) and keeps_all(other, first_row, stop_row):
        return False
    before = measure_leap(own, axis, (first_row, stop_row), -1)
    after = measure_leap(own, axis, (first_row, stop_row), 1)
    if before * after > 0.0 and min(abs(before), abs(after)) >= leap:
        return abs(before - after) < SMOOTH_PART * max(abs(before), abs(after))
    if stop_row - first_row < FEWEST_ROWS or max(abs(before), abs(after)) < leap:
        return False
    return has_moved(own, other, axis, first_row, stop_row, moved)


@njit(cache=True, nogil=True)
def measure_leap(own: Values, axis: int, run: tuple[int, int], way: int) -> float:
    """How far the reading before a run (way -1), or after it (1), is from it.

    0 where the rows beyond leap too, or an axis that did not stop with it.
    """
    first, stop = run
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
        if abs(own[out, k] - own[row, k]) > most and k != axis and not keeps(own, k, first, stop):
            return 0.0
    return leap


@njit(cache=True, nogil=True)
def keeps(values: Values, axis: int, first_row: int, stop_row: int) -> bool:
    """Whether an axis shows one value in all rows."""
    for row in range(first_row + 1, stop_row):  # noqa: SIM110 (numba compiles no generator expressions)
        if values[row, axis] != values[first_row, axis]:
            return False
    return True


@njit(cache=True, nogil=True)
def keeps_all(values: Values, first_row: int, stop_row: int) -> bool:
    """Whether a sensor shows one reading in all rows of two or more."""
    if stop_row - first_row < 2:
        return False
    return (
        keeps(values, 0, first_row, stop_row)
        and keeps(values, 1, first_row, stop_row)
        and keeps(values, 2, first_row, stop_row)
    )


@njit(cache=True, nogil=True)
def has_moved(  # noqa: PLR0913, PLR0917 (a kernel takes plain arrays)
    own: Values, other: Values, axis: int, first_row: int, stop_row: int, moved: tuple[float, float]
) -> bool:
    """Whether another channel changed by more than noise between the first row and the last."""
    for k in range(3):
        if k != axis and measure_range(own, k, first_row, stop_row) > moved[0]:
            return True
        if measure_range(other, k, first_row, stop_row) > moved[1]:
            return True
    return False


@njit(cache=True, nogil=True)
def measure_range(values: Values, axis: int, first_row: int, stop_row: int) -> float:
    """Largest less smallest reading."""
    low = high = values[first_row, axis]
    for row in range(first_row + 1, stop_row):
        low = min(low, values[row, axis])
        high = max(high, values[row, axis])
    return high - low
