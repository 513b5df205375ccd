"""Stamped rows before they are cut into segments: what keeps a day-long log whole, and nothing more.

A counter that starts over, an hour of daylight saving, a copied block, a clock that stopped or left for a
while. Rows in any other order are not put right: the newest first is refused, and a piece in the wrong place
reads like a clock that was set (W-CLOCK-BACK). :func:`repair_row_times` stands first; the steps follow in the
order in which it takes them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import UnusableTime
from fusion.readers.samples import SampleColumns
from fusion.readers.timebase.clock import datetime_at_us, is_change_of_wall_clock
from fusion.readers.timebase.grid import count_backward, steps_between
from fusion.readers.timebase.row_kernels import LONGEST_DELAY_US, find_equal_runs
from fusion.recording import LONGEST_BRIDGE_US, MICROSECONDS, QualityFlag, flag_counts


def repair_row_times(
    columns: SampleColumns, *, tick_us: int = 0, is_wall_clock: bool = False
) -> tuple[QualityFlag, ...]:
    """Mend the stamps of rows, in place, or leave rows out; give the caveats.

    A table whose stamps only advance is passed once and left as it is.

    Parameters
    ----------
    columns
        Rows with stamps in microseconds.
    tick_us
        Microseconds of one count, where the stamps are those of a counter that may start over; else 0.
    is_wall_clock
        The stamps are those of a clock that may follow daylight saving.

    Raises
    ------
    UnusableTime
        The newest row stands first, or the clock stands still for most rows.
    """
    stamps = columns.stamps[: columns.rows]
    backward = count_backward(stamps)
    forward = np.count_nonzero(stamps[1:] > stamps[:-1]) if backward else 0
    if len(stamps) >= 3 and backward and backward >= TURNED_SHARE * (backward + forward):
        raise UnusableTime(why="reversed")
    flags = undo_daylight_saving(columns.stamps) if is_wall_clock else ()
    flags += unwrap_counter(columns.stamps, tick_us)
    flags += leave_out_stopped(columns)
    if count_backward(columns.stamps) == 0 and not has_outlying_ends(columns.stamps):
        return flags
    flags += leave_out_repeats(columns)
    return flags + place_outliers(columns) + leave_out_ends(columns)


TURNED_SHARE = 0.9
"""So many of the steps run backwards in a table that was turned round."""


# A wall clock that followed daylight saving.

HOUR_US = 3600 * MICROSECONDS
CHANGE_US = HOUR_US // 2
"""Clocks are changed at a full hour; here and there at half past."""
LONGEST_LOSS_US = 600 * MICROSECONDS
CHANGE_TOLERANCE_US = 2 * MICROSECONDS
FIRST_ROWS = 4097
PART_ROWS = 1 << 14


def undo_daylight_saving(stamps: NDArray[np.int64]) -> tuple[QualityFlag, ...]:
    """Take an hour's step out of wall-clock stamps where the clocks were changed, in place.

    Only a step of one hour, at a moment at which the clocks of some zone step so, is taken for that; rows may
    be lost around it for up to ten minutes. The stamps go on by the clock of the first row.
    """
    first_steps = np.diff(stamps[:FIRST_ROWS])
    advances = first_steps[first_steps > 0]  # many rows share a coarse stamp
    usual_us = float(np.median(advances)) if len(advances) else 0.0
    flags: tuple[QualityFlag, ...] = ()
    for place in _find_long_steps(stamps, HOUR_US // 2):
        step_us = int(stamps[place + 1] - stamps[place])
        hour_us = HOUR_US if step_us > 0 else -HOUR_US
        lost_us = step_us - hour_us - usual_us
        if not -max(1.5 * usual_us, 1.0) <= lost_us <= LONGEST_LOSS_US:
            continue
        next_us = int(stamps[place]) + round(usual_us)
        changed_us = -(-next_us // CHANGE_US) * CHANGE_US if lost_us > CHANGE_TOLERANCE_US else next_us
        reading = (
            datetime_at_us(changed_us) if changed_us <= next_us + lost_us + CHANGE_TOLERANCE_US else None
        )
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


# Counters that start over: micros() and millis() of 32 bits.

BITS = 32
MARGIN_US = 60 * MICROSECONDS
"""A wrap is one only near both ends of the counter: a logger that started again is none."""


def unwrap_counter(stamps: NDArray[np.int64], tick_us: int) -> tuple[QualityFlag, ...]:
    """Undo the wraps of a counter of ``tick_us`` a count, in place (W-WRAP); 0 where stamps are no counts."""
    if tick_us == 0 or count_backward(stamps) == 0:
        return ()
    wrap_us = 2**BITS * tick_us
    is_wrap = (stamps[:-1] > wrap_us - MARGIN_US) & (stamps[1:] < MARGIN_US)
    stamps[1:] += wrap_us * np.cumsum(is_wrap)
    return flag_counts({Caveat.WRAP: int(is_wrap.sum())})


# How the stamps advance, and the pieces between two long steps of the clock.

PACE_ROWS = 1024


@dataclass(frozen=True, slots=True)
class Pace:
    """How the stamps of a table usually advance: from row to row on average, and in one step of the clock."""

    period_us: float
    step_us: float

    @property
    def longest_us(self) -> float:
        """A longer step forward than this separates two pieces."""
        return max(1.5 * self.step_us, LONGEST_BRIDGE_US)


def measure_pace(stamps: NDArray[np.int64]) -> Pace:
    """Measure how the stamps usually advance; zeros where they do not."""
    steps = steps_between(stamps, 1)
    paces = steps_between(stamps, min(PACE_ROWS, max(1, len(stamps) // 8)))
    usual = [float(np.median(found[found > 0])) if np.any(found > 0) else 0.0 for found in (paces, steps)]
    return Pace(*usual)


# A clock that stood still, and one that left for a while and came back.

FAR_US = 60 * MICROSECONDS
"""A single row at either end of a file, so far from the others, is an outlier."""
LOOKED_AT_ROWS = 8193
SHORTEST_STOP_US, SHORTEST_STOP_STEPS = 500_000, 3.0
"""So long, and so many steps of the clock, rows bear one stamp only where the clock stopped."""
LEAST_TIMED_PART = 0.5
FREE_STOPS, BETWEEN_STOPS_US = 3, 60 * MICROSECONDS
"""More than a few, and more than one a minute, are rows that came in bunches."""


def leave_out_stopped(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Leave out rows of one and the same stamp: nobody can say when they were measured (W-ROWS-DROPPED).

    Raises
    ------
    UnusableTime
        Most rows would be left out.
    """
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    if pace.period_us <= 0.0 or pace.step_us <= 0.0:
        return ()
    longest_us = max(SHORTEST_STOP_US, SHORTEST_STOP_STEPS * pace.step_us)
    runs = find_equal_runs(stamps, int(longest_us / pace.period_us) + 1)
    if not 0 < len(runs) <= FREE_STOPS + columns.rows * pace.period_us / BETWEEN_STOPS_US:
        return ()
    kept = np.ones(columns.rows, np.bool_)
    for first, stop in runs.tolist():
        kept[first:stop] = False
    if np.count_nonzero(kept) < LEAST_TIMED_PART * columns.rows:
        raise UnusableTime(why="constant")
    return _leave_out(columns, kept)


def has_outlying_ends(stamps: NDArray[np.int64]) -> bool:
    """Whether the first stamps, or the last one, lie over a minute before or after the others."""
    if len(stamps) < 3:
        return False
    differs = stamps[:LOOKED_AT_ROWS] != stamps[0]
    second = int(np.argmax(differs)) if differs.any() else 1
    return bool(stamps[second] - stamps[0] > FAR_US or stamps[-1] - stamps[-2] > FAR_US)


def place_outliers(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Put rows whose clock left for a while and came back after the rows before them (W-CLOCK-FWD).

    They keep the distances of their own stamps, unless these stood still.
    """
    stamps = columns.stamps[: columns.rows]
    pace = measure_pace(stamps)
    steps = np.diff(stamps)  # rows at most a second late stay where they are
    edges = np.flatnonzero((steps > pace.longest_us) | (steps < -LONGEST_DELAY_US)) + 1
    first, stop = edges[:-1], edges[1:]  # pieces between two long steps of the clock
    if len(first) == 0:
        return ()
    low_us, high_us = (extreme.reduceat(stamps, edges)[:-1] for extreme in (np.minimum, np.maximum))
    before_us, after_us = stamps[first - 1], stamps[stop % len(stamps)]
    span_us = high_us - low_us
    is_outside = (high_us < before_us) | (low_us > after_us)
    is_away = is_outside & (after_us - before_us - span_us >= pace.period_us)
    for k in np.flatnonzero(is_away):
        rows = int(stop[k] - first[k])
        room_us = min(float(after_us[k] - before_us[k]), (rows + 1) * pace.period_us)
        stood_still = span_us[k] < 0.5 * (rows - 1) * pace.period_us
        even_us = np.linspace(0.0, room_us, rows + 2)[1:-1]
        own_us = stamps[first[k] : stop[k]] - low_us[k] + min(pace.period_us, even_us[0])
        stamps[first[k] : stop[k]] = before_us[k] + np.rint(even_us if stood_still else own_us).astype(
            np.int64
        )
    return flag_counts({Caveat.CLOCK_FWD: int((stop - first)[is_away].sum())})


def leave_out_ends(columns: SampleColumns) -> tuple[QualityFlag, ...]:
    """Leave out a first or a last row that lies alone, over a minute from the others (W-ROWS-DROPPED)."""
    stamps = columns.stamps[: columns.rows]
    kept = np.ones(len(stamps), np.bool_)
    if len(stamps) >= 3:
        kept[0] = abs(stamps[1] - stamps[0]) <= FAR_US
        kept[-1] = abs(stamps[-1] - stamps[-2]) <= FAR_US
    return _leave_out(columns, kept)


def _leave_out(columns: SampleColumns, kept: NDArray[np.bool_]) -> tuple[QualityFlag, ...]:
    dropped = int(np.count_nonzero(~kept))
    if dropped:
        columns.keep(kept)
    return flag_counts({Caveat.ROWS_DROPPED: dropped})


# Rows that stand in a table twice: a copy that went on from too early, or a file put after itself.

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
    for row in (np.flatnonzero(stamps[1:] < stamps[:-1]) + 1).tolist():
        rows = _count_repeated(columns, row)
        if rows >= LEAST_ROWS and np.ptp(columns.acc[row : row + rows], axis=0).any():
            kept[row : row + rows] = False
    repeated = columns.rows - int(kept.sum())
    if repeated == 0:
        return ()
    columns.keep(kept)
    return (QualityFlag(Caveat.DUP, repeated),)


def _count_repeated(columns: SampleColumns, row: int) -> int:
    """How many rows from ``row`` on repeat, stamps and readings, those from the first that is like it on."""
    stamps, acc, gyr = columns.stamps[: columns.rows], columns.acc, columns.gyr
    like = np.flatnonzero(stamps[:row] == stamps[row])
    like = like[((acc[like] == acc[row]) & (gyr[like] == gyr[row])).all(axis=1)]
    if len(like) == 0:
        return 0
    first, rows = int(like[0]), len(stamps) - row
    differs = stamps[first : first + rows] != stamps[row:]
    rows = int(np.argmax(differs)) if differs.any() else rows
    is_same = (acc[first : first + rows] == acc[row : row + rows]) & (
        gyr[first : first + rows] == gyr[row : row + rows]
    )
    differs = ~is_same.all(axis=1)
    return int(np.argmax(differs)) if differs.any() else rows
