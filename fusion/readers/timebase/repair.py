"""Stamps that need mending before they are cut into segments: rows out of order, stamps too coarse, a clock
that followed daylight saving.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.numba_kernels import njit
from fusion.readers.samples import SampleColumns
from fusion.readers.timebase.clock import datetime_at_us, is_change_of_wall_clock
from fusion.readers.timebase.grid import steps_between
from fusion.recording import LONGEST_BRIDGE_US, MICROSECONDS, QualityFlag

# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)


LONGEST_DELAY_US = MICROSECONDS
"""A row that comes later than this is no late row: its clock was set."""
LONGEST_WINDOW_ROWS = 8192
EVEN_STEP = 0.4
"""Sorted rows lie at least so many periods apart, else two runs of samples would be mixed."""
COARSE_ROWS = 4.0
"""Rows that share a stamp on average, from which on the stamp is a count of something coarser."""
FULL_RUN = 0.1
EVEN_RUNS, SAME_COUNT = 10, 0.02
"""So many stamps one after the other with as many rows each, give or take one or 2 %, are a rate."""
HOUR_US = 3600 * MICROSECONDS
CHANGE_US = HOUR_US // 2
"""Clocks are changed at a full hour; here and there at half past."""
LONGEST_LOSS_US = 600 * MICROSECONDS
CLOCK_US = 2 * MICROSECONDS
FIRST_ROWS = 4097
PART_ROWS = 1 << 14


@njit(cache=True, nogil=True)
def find_late_window(stamps: NDArray[np.int64], row: int) -> tuple[int, int]:
    """The rows among which ``row`` and what follows it belong: first, and first after; (row, row): none."""
    highest = stamps[row - 1]
    if highest - stamps[row] > LONGEST_DELAY_US:
        return row, row
    first = row - 1
    while first > 0 and stamps[first - 1] > stamps[row]:
        first -= 1
    stop = row
    while stop < len(stamps) and stamps[stop] < highest:
        if stop - first > LONGEST_WINDOW_ROWS:
            return row, row
        stop += 1
    return first, stop


@njit(cache=True, nogil=True)
def is_even(
    stamps: NDArray[np.int64], order: NDArray[np.int64], window: tuple[int, int], least: float
) -> bool:
    """Whether the sorted window and its neighbours are never closer than ``least``."""
    first, stop = window
    before = stamps[first - 1] if first > 0 else stamps[first + order[0]] - 2 * np.int64(least) - 1
    for k in order:
        if stamps[first + k] - before < least:
            return False
        before = stamps[first + k]
    return stop == len(stamps) or stamps[stop] - before >= least


@njit(cache=True, nogil=True)
def sort_windows(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], stamps: NDArray[np.int64], least_us: float
) -> int:
    """Put rows that came late into their place, in place; return how many came late."""
    late = 0
    row = 1
    while row < len(stamps):
        if stamps[row] >= stamps[row - 1]:
            row += 1
            continue
        first, stop = find_late_window(stamps, row)
        if stop > first:
            order = np.argsort(stamps[first:stop], kind="mergesort")
            if is_even(stamps, order, (first, stop), least_us):
                late += stop - row
                stamps[first:stop] = stamps[first:stop][order]
                acc[first:stop] = acc[first:stop][order]
                gyr[first:stop] = gyr[first:stop][order]
                row = stop
                continue
        row += 1
    return late


@njit(cache=True, nogil=True)
def count_backward(stamps: NDArray[np.int64]) -> int:
    """How many stamps are earlier than the one before."""
    backward = 0
    for row in range(1, len(stamps)):
        backward += int(stamps[row] < stamps[row - 1])
    return backward


@njit(cache=True, nogil=True)
def find_backward(stamps: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """The ``count`` rows whose stamps are earlier than the one before; nothing as long as the log is made."""
    rows = np.empty(count, np.int64)
    found = 0
    for row in range(1, len(stamps)):
        if found < count and stamps[row] < stamps[row - 1]:
            rows[found] = row
            found += 1
    return rows


def sort_late_rows(columns: SampleColumns, period_us: float) -> tuple[QualityFlag, ...]:
    """Sort rows that came at most a second late; whatever is more is a clock that was set."""
    if count_backward(columns.stamps) == 0:
        return ()  # of all kernels this one takes longest to compile, and few files need it
    late = sort_windows(columns.acc, columns.gyr, columns.stamps, EVEN_STEP * period_us)
    return (QualityFlag(Caveat.ORDER, late),) if late else ()


@njit(cache=True, nogil=True)
def spread_runs(
    stamps: NDArray[np.int64], edges: NDArray[np.int64], step_us: float, usual: NDArray[np.float64]
) -> None:
    """Place the rows of each run of equal stamps evenly over the time until the next stamp, in place.

    ``usual``: how many rows such a run has where none is lost, one for each.
    """
    for run in range(len(edges) - 1):
        first, stop = edges[run], edges[run + 1]
        rows = stop - first
        length_us = step_us
        if stop < len(stamps) and 0 < stamps[stop] - stamps[first] < 1.5 * step_us:
            length_us = float(stamps[stop] - stamps[first])
        is_full = abs(rows - usual[run]) <= FULL_RUN * usual[run]
        share_us = length_us / (rows if is_full or rows > usual[run] else usual[run])
        began_within = run == 0 and rows < usual[run]
        late = usual[run] - rows if began_within else 0.0
        base = stamps[first]
        for k in range(rows):
            stamps[first + k] = base + np.int64(np.round((k + late) * share_us))


def find_usual_counts(counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Give the rows that a stamp has where none is lost: those of its stretch, if it is one of an even rate.

    Others take those of the even stretch before, or of the first one; without any, the median holds for all.
    """
    usual = np.full(len(counts), float(np.median(counts)))
    differs = np.abs(np.diff(counts)) > np.maximum(1.0, SAME_COUNT * counts[1:])
    edges = np.concatenate([[0], np.flatnonzero(differs) + 1, [len(counts)]])
    stretches = [(int(a), int(b)) for a, b in pairwise(edges) if b - a >= EVEN_RUNS]
    starts = [0, *(first for first, _ in stretches[1:]), len(counts)]
    for (first, stop), (start, end) in zip(stretches, pairwise(starts), strict=False):
        usual[start:end] = float(np.median(counts[first:stop]))
    return usual


@njit(cache=True, nogil=True)
def count_runs(stamps: NDArray[np.int64]) -> int:
    """How many runs of equal stamps there are."""
    runs = 1
    for k in range(1, len(stamps)):
        runs += int(stamps[k] != stamps[k - 1])
    return runs


def spread_coarse_stamps(stamps: NDArray[np.int64]) -> tuple[QualityFlag, ...]:
    """Give the rows that share a stamp (whole seconds, say) times of their own, in place.

    The n rows of a second T lie at T + k/n, as those of a `.gt3x` do; where clearly fewer than usual share a
    stamp, they keep the usual distance and the rest is a hole.
    """
    if count_runs(stamps) < 3 or len(stamps) < COARSE_ROWS * count_runs(stamps):
        return ()
    edges = np.concatenate([[0], np.flatnonzero(np.diff(stamps)) + 1, [len(stamps)]])
    counts = np.diff(edges)
    steps = np.diff(stamps[edges[:-1]])
    if not np.any(steps > 0):
        return ()
    step_us = float(np.median(steps[steps > 0]))
    spread_runs(stamps, edges.astype(np.int64), step_us, find_usual_counts(counts))
    return (QualityFlag(Caveat.JITTER),)


def undo_daylight_saving(stamps: NDArray[np.int64]) -> tuple[QualityFlag, ...]:
    """Take an hour's step out of wall-clock stamps where the clocks were changed, in place.

    Only a step of one hour, at a moment at which the clocks of some zone step so, is taken for that; rows may
    be lost around it for up to ten minutes. The stamps go on by the clock of the first row.
    """
    first_steps = np.diff(stamps[:FIRST_ROWS])
    advances = first_steps[first_steps > 0]  # many rows share a coarse stamp
    usual = float(np.median(advances)) if len(advances) else 0.0
    flags: tuple[QualityFlag, ...] = ()
    for place in _find_long_steps(stamps, HOUR_US // 2):
        step_us = int(stamps[place + 1] - stamps[place])
        hour_us = HOUR_US if step_us > 0 else -HOUR_US
        lost_us = step_us - hour_us - usual
        if not -max(1.5 * usual, 1.0) <= lost_us <= LONGEST_LOSS_US:
            continue
        next_us = int(stamps[place]) + round(usual)
        changed_us = -(-next_us // CHANGE_US) * CHANGE_US if lost_us > CLOCK_US else next_us
        reading = datetime_at_us(changed_us) if changed_us <= next_us + lost_us + CLOCK_US else None
        if reading is None or not is_change_of_wall_clock(reading, hour_us // MICROSECONDS):
            continue
        at_s = float(stamps[place + 1] - hour_us - stamps[0]) / MICROSECONDS
        stamps[place + 1 :] -= np.int64(hour_us)
        flags += (QualityFlag(Caveat.DST, 1, 0.0, at_s, at_s, {"step_s": hour_us // MICROSECONDS}),)
    return flags


def _find_long_steps(stamps: NDArray[np.int64], longer_than_us: int) -> list[int]:
    """Rows after which the clock steps far either way; in parts, so that no array as long is made."""
    return [
        first + int(place)
        for first in range(0, len(stamps), PART_ROWS)
        for place in np.flatnonzero(np.abs(np.diff(stamps[first : first + PART_ROWS + 1])) > longer_than_us)
    ]


# Rows that stand in a table twice: a copy that went on from too early, or a file put after itself.


# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)


LEAST_ROWS = 10
"""So many rows alike in all readings and in their stamps, and not all one, come about by copying only."""
MOST_STEPS = 64
"""Steps back that are looked into: each takes a look through the rows before it."""


def leave_out_repeats(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Take out, in place, rows that come again after a step back of the clock (W-DUP, in rows)."""
    stamps = columns.stamps[: columns.rows]
    count = count_backward(stamps)
    if not 0 < count <= MOST_STEPS:
        return ()
    kept = np.ones(columns.rows, np.bool_)
    for row in find_backward(stamps, count).tolist():
        first = find_alike(columns.acc, columns.gyr, stamps, row)
        rows = count_alike(columns.acc, columns.gyr, stamps, first, row) if first < row else 0
        if rows >= LEAST_ROWS and np.ptp(columns.acc[row : row + rows], axis=0).any():
            kept[row : row + rows] = False
    repeated = columns.rows - int(kept.sum())
    if repeated == 0:
        return ()
    columns.keep(kept)
    return (QualityFlag(Caveat.DUP, repeated),)


@njit(cache=True, nogil=True)
def is_alike(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], stamps: NDArray[np.int64], one: int, other: int
) -> bool:
    """Whether two rows have the same stamp and the same readings."""
    if stamps[one] != stamps[other]:
        return False
    for axis in range(3):
        if acc[one, axis] != acc[other, axis] or gyr[one, axis] != gyr[other, axis]:
            return False
    return True


@njit(cache=True, nogil=True)
def find_alike(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], stamps: NDArray[np.int64], row: int
) -> int:
    """The first row that is as ``row``; itself if none before it is."""
    for k in range(row):
        if is_alike(acc, gyr, stamps, k, row):
            return k
    return row


@njit(cache=True, nogil=True)
def count_alike(
    acc: NDArray[np.float32], gyr: NDArray[np.float32], stamps: NDArray[np.int64], first: int, row: int
) -> int:
    """How many rows from ``row`` on repeat those from ``first`` on."""
    count = 0
    while row + count < len(stamps) and is_alike(acc, gyr, stamps, first + count, row + count):
        count += 1
    return count


# Rows in the order of their time: a table turned round, and pieces put together in the wrong order.
#
# A logger writes in the order of time; a program that sorts, or a person who pastes, may not keep it.
# Pieces are put in order only where the stamps leave no doubt: they do not overlap, but for rows that stand
# in both, and at least once one goes on where another ends. All else is a clock that was set (W-CLOCK-
# BACK).


# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)


TURNED_SHARE = 0.9
"""So many of the steps run backwards in a table that was turned round."""
PACE_ROWS = 1024
JOIN_US = MICROSECONDS
"""A piece that begins so soon after the end of another goes on from there."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How the stamps of a table usually advance: from row to row on average, and in one step of the clock."""

    period_us: float
    step_us: float

    @property
    def is_coarse(self) -> bool:
        """Whether many rows share a stamp."""
        return self.step_us >= COARSE_ROWS * self.period_us

    @property
    def longest_us(self) -> float:
        """A longer step forward than this separates two pieces."""
        return max(1.5 * self.step_us, LONGEST_BRIDGE_US)


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Rows between two long steps of the clock, in the order of the file; shape (n,) each."""

    first: NDArray[np.int64]
    stop: NDArray[np.int64]
    low_us: NDArray[np.int64]
    high_us: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.first)


def measure_pace(stamps: NDArray[np.int64]) -> Pace:
    """Measure how the stamps usually advance; zeros where they do not."""
    steps = steps_between(stamps, 1)
    paces = steps_between(stamps, min(PACE_ROWS, max(1, len(stamps) // 8)))
    usual = [float(np.median(found[found > 0])) if np.any(found > 0) else 0.0 for found in (paces, steps)]
    return Pace(*usual)


@njit(cache=True, nogil=True)
def find_edges(stamps: NDArray[np.int64], longest_us: float, back_us: int, edges: NDArray[np.int64]) -> int:
    """Write the rows before which the clock steps far either way; return how many there are in all."""
    found = 0
    for row in range(1, len(stamps)):
        step = stamps[row] - stamps[row - 1]
        if step > longest_us or step < -back_us:
            if found < len(edges):
                edges[found] = row
            found += 1
    return found


def find_pieces(stamps: NDArray[np.int64], pace: Pace) -> Pieces:
    """Cut the rows at long steps of the clock; rows at most a second late stay where they are."""
    limits = (pace.longest_us, LONGEST_DELAY_US)
    edges = np.empty(find_edges(stamps, *limits, np.empty(0, np.int64)), np.int64)
    find_edges(stamps, *limits, edges)
    first = np.concatenate([np.zeros(1, np.int64), edges])
    stop = np.append(edges, len(stamps))
    return Pieces(first, stop, np.minimum.reduceat(stamps, first), np.maximum.reduceat(stamps, first))


@njit(cache=True, nogil=True)
def count_forward(stamps: NDArray[np.int64]) -> int:
    """How many stamps are later than the one before."""
    forward = 0
    for row in range(1, len(stamps)):
        forward += int(stamps[row] > stamps[row - 1])
    return forward


def turn_round(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Put a table that stands with its newest row first into the order of time, in place (W-REVERSED)."""
    stamps = columns.stamps[: columns.rows]
    backward = count_backward(stamps)
    if backward == 0 or backward < TURNED_SHARE * (backward + count_forward(stamps)) or len(stamps) < 3:
        return ()
    for values in (columns.acc, columns.gyr, columns.stamps):
        turn_rows(values.reshape(len(values), -1), columns.rows)
    return (QualityFlag(Caveat.REVERSED),)


@njit(cache=True, nogil=True)
def turn_rows(values: NDArray[np.float32], rows: int) -> None:
    """Turn the first ``rows`` of an array, shape (n, m), round, in place."""
    for row in range(rows // 2):
        for place in range(values.shape[1]):
            other = values[rows - 1 - row, place]
            values[rows - 1 - row, place] = values[row, place]
            values[row, place] = other


def order_pieces(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Put pieces that stand in the wrong order into that of their stamps (W-PIECES, in pieces that moved).

    Rows that two pieces share at a seam are counted once (W-DUP).
    """
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    pieces = find_pieces(stamps, pace)
    order = np.lexsort((pieces.high_us, pieces.low_us))
    moved = int(np.count_nonzero(order != np.arange(len(order))))
    if moved == 0:
        return ()
    begins = find_begins(columns, pieces, order, pace)
    if begins is None or not goes_on(pieces, order, begins, pace):
        return ()
    repeated = int((begins - pieces.first).sum())
    places = [(int(begins[k]), int(pieces.stop[k])) for k in order]
    gather_rows(columns, places)
    flags = (QualityFlag(Caveat.PIECES, moved),)
    return (*flags, QualityFlag(Caveat.DUP, repeated)) if repeated else flags


def find_begins(
    columns: SampleColumns, pieces: Pieces, order: NDArray[np.int64], pace: Pace
) -> NDArray[np.int64] | None:
    """The row at which each piece begins that no piece before it in time has; None where two contradict."""
    begins = pieces.first.copy()
    stamps = columns.stamps[: columns.rows]
    for before, after in pairwise(order.tolist()):
        high_us = int(pieces.high_us[before])
        if pieces.low_us[after] > high_us - int(pace.is_coarse):
            continue
        first, stop = int(pieces.first[after]), int(pieces.stop[after])
        shared = int(np.count_nonzero(stamps[first:stop] <= high_us))
        twin = int(pieces.first[before]) + int(
            np.searchsorted(stamps[pieces.first[before] : pieces.stop[before]], stamps[first])
        )
        if shared == stop - first or not _is_copy(columns, twin, first, shared):
            return None
        begins[after] = first + shared
    return begins


def _is_copy(columns: SampleColumns, twin: int, first: int, shared: int) -> bool:
    stamps = columns.stamps[: columns.rows]
    return count_alike(columns.acc, columns.gyr, stamps, min(twin, first), max(twin, first)) >= shared


def goes_on(pieces: Pieces, order: NDArray[np.int64], begins: NDArray[np.int64], pace: Pace) -> bool:
    """Whether a piece goes on where another ends that does not stand just before it in the file.

    Where what stands between the two in the file fits into the time between them, that is no proof: then it
    may be rows with a strange stamp.
    """
    before, after = order[:-1], order[1:]
    step_us = pieces.low_us[after] - pieces.high_us[before]
    between_us = (pieces.first[after] - pieces.stop[before]) * pace.period_us
    is_filled = (after > before) & (between_us <= step_us + pace.period_us)
    is_new = (after != before + 1) & ~is_filled
    return bool(np.any(is_new & ((step_us <= JOIN_US) | (begins[after] > pieces.first[after]))))


def gather_rows(columns: SampleColumns, places: list[tuple[int, int]]) -> None:
    """Keep some stretches of rows, in a new order; one column at a time, so that memory holds one twice."""
    columns.acc = np.concatenate([columns.acc[first:stop] for first, stop in places])
    columns.gyr = np.concatenate([columns.gyr[first:stop] for first, stop in places])
    columns.stamps = np.concatenate([columns.stamps[first:stop] for first, stop in places])
    columns.rows = len(columns.acc)


# Counters that start over: micros() and millis() of 32 bits, and loggers' own of 24 or 16.


# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)


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
    return (QualityFlag(Caveat.WRAP, wraps),) if wraps else ()


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
