"""Read a board's lines as they arrive: identify the columns, then return the values of each whole row.

The header is read as that of a file (:mod:`acromion.fusion.readers.tables`): by the device table and the
column names. Units must be stated, because there is no motion yet that could show them.
"""

import math
import re
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.errors import FusionError, UnknownColumns, UnknownRate, UnknownUnit, UnusableTime
from acromion.fusion.live.session import Frames
from acromion.fusion.readers.tables.csv import choose_rate_hz, read_positive
from acromion.fusion.readers.tables.csv_lines import STAMP
from acromion.fusion.readers.tables.layout import TextLayout, find_layout, is_row, split_fields
from acromion.fusion.readers.tables.rows import plan_table
from acromion.fusion.readers.time.grid import estimate_period_us
from acromion.fusion.recording import MICROSECONDS, acc_scale_g, gyr_scale_dps

# The clock of a stream: counters that wrap, boards that restart.

STAMP_SIZE = 1 << 32
"""``micros()`` wraps here, every 71.6 minutes."""
COUNTER_SIZES = (1 << 8, 1 << 16, 1 << 32)
LONGEST_LOSS = 0.25
"""A counter that jumps by up to this part of its size has lost frames; by more, it restarted."""
LONGEST_STEP_US = 60 * MICROSECONDS
"""A longer jump means that the board was reset."""
LONGEST_DELAY_US = MICROSECONDS // 2
"""Rows without a timestamp that arrive later than this follow a loss; up to it they were delayed."""
ARRIVAL_GAIN, MOST_PULL = 0.005, 0.05
"""For rows without a timestamp: share of the difference to the arrivals that is corrected per row, and its
limit in periods.
"""


@dataclass(slots=True)
class StreamClock:
    """Assigns each frame a time that never goes back, and a counter that never wraps.

    Frames without timestamps are one period apart and follow the arrivals slowly, because frames arrive in
    bursts. Frames without a counter are counted by their time: a step of more than 1.5 periods, or without
    timestamps a delay of more than half a second, counts as lost frames. After a restart of the board the
    time advances by the time between arrivals.
    """

    period_us: float
    restarts: int = 0
    _stamp: int = -1
    _count: int = -1
    _time_us: int = -1
    _counter: int = -1
    _arrived_us: int = 0
    _origin_us: int = 0

    def place(self, stamp_us: int | None, count: int | None, arrived_us: int) -> tuple[int, int]:
        """Return time (us) and counter of the next frame.

        ``stamp_us``, ``count``: as written by the board, or None.
        ``arrived_us``: from a local clock that never goes back.
        """
        if self._time_us < 0:
            time_us, counter = 0, 0
            self._origin_us = arrived_us
        elif stamp_us is None:
            time_us, counter = self._place_unstamped(count, arrived_us)
        else:
            step_us = self._step(stamp_us, arrived_us)
            time_us = self._time_us + step_us
            counter = self._counter + self._count_step(count, step_us)
        self._stamp = -1 if stamp_us is None else stamp_us
        self._count = -1 if count is None else count
        self._time_us, self._counter, self._arrived_us = time_us, counter, arrived_us
        return time_us, counter

    def _place_unstamped(self, count: int | None, arrived_us: int) -> tuple[int, int]:
        restarts = self.restarts
        steps = self._count_step(count, round(self.period_us))
        due_us = self._time_us + steps * self.period_us
        late_us = arrived_us - self._origin_us - due_us
        is_unnumbered = count is None or self.restarts > restarts
        if is_unnumbered and late_us > LONGEST_DELAY_US:
            steps += round(late_us / self.period_us)
            due_us += late_us
        else:
            most_us = MOST_PULL * self.period_us
            due_us += max(-most_us, min(ARRIVAL_GAIN * late_us, most_us))
        return max(self._time_us + 1, round(due_us)), self._counter + steps

    def _step(self, stamp_us: int, arrived_us: int) -> int:
        """Return the microseconds since the previous frame, at least one."""
        between_us = max(1, arrived_us - self._arrived_us)
        if self._stamp < 0:
            return between_us
        step_us = stamp_us - self._stamp
        if step_us < 0 and self._stamp < STAMP_SIZE:
            step_us += STAMP_SIZE
        if 0 < step_us <= max(LONGEST_STEP_US, 2 * between_us):
            return step_us
        self.restarts += 1
        self._count = -1  # its counter also restarted
        return max(between_us, round(self.period_us))

    def _count_step(self, count: int | None, step_us: int) -> int:
        """Return the frames since the previous one, including this one; at least one."""
        if count is not None and self._count >= 0:
            step = count - self._count
            if step > 0:
                return step
            for size in COUNTER_SIZES:
                if self._count < size and 0 < step + size <= LONGEST_LOSS * size:
                    return step + size
            self.restarts += 1
        periods = step_us / self.period_us
        return max(1, round(periods)) if periods > 1.5 else 1


# The lines of a stream.

ROWS_TO_LEARN = 25
"""Number of rows after the header that are examined before its columns are determined."""
ROWS_TO_TIME = 200
"""This many rows, two seconds of a usual board, determine the rate."""
HEAD_LINES = 40
LONGEST_LINE_BYTES = 4096
DELIMITERS = (",", ";", "\t", " ")
WORDS = re.compile(r"[A-Za-z#]")
MOST_G, MOST_DPS = 64.0, 10_000.0
"""No sensor measures more: a torn line that happens to have enough fields."""
MOST_NUMBER = 1 << 53
"""No timestamp or counter is larger."""
RATE_TOLERANCE = 0.1
"""If the rate differs from that of the first seconds by more, the board was reconfigured and its angle would
be wrong.
"""


@dataclass(frozen=True, slots=True)
class Row:
    """One sample as the board wrote it; ``stamp_us`` and ``count`` are None if it writes none."""

    stamp_us: int | None
    count: int | None
    arrived_us: int
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class LineFacts:
    """The header's statements: the board, its ranges, and its rate, stated or measured."""

    device: str
    rate_hz: float
    acc_range_g: float | None = None
    gyr_range_dps: float | None = None


@dataclass(frozen=True, slots=True)
class _Columns:
    """The meaning of each field, and the factors to microseconds, g and deg/s."""

    layout: TextLayout
    stamp: int | None
    count: int | None
    places: tuple[int, ...]
    to_us: float
    factors: tuple[float, ...]


class LineReader:
    """Processes bytes in chunks of any size; returns frames once header and rate are known.

    Torn lines and lines without a row are skipped and counted; their rows count as lost.
    """

    def __init__(self) -> None:
        self.torn = 0
        self.facts: LineFacts | None = None
        self._carried = b""
        self._head: deque[str] = deque(maxlen=HEAD_LINES)
        self._learned_from: deque[tuple[str, int]] = deque(maxlen=ROWS_TO_LEARN)
        self._columns: _Columns | None = None
        self._waiting: list[Row] = []
        self._clock: StreamClock | None = None
        self._changed: _Columns | None = None
        self._recent = np.empty((0, 2), np.int64)

    @property
    def restarts(self) -> int:
        """How often the board restarted."""
        return self._clock.restarts if self._clock else 0

    def feed(self, piece: bytes, arrived_us: int) -> Frames | None:
        """Process the next bytes; return None until header and rate are known.

        Raises
        ------
        acromion.fusion.errors.UnknownColumns, acromion.fusion.errors.UnknownUnit,
        acromion.fusion.errors.UnreadableFile
            The rows have no header, or one without columns and units.
        acromion.fusion.errors.UnknownRate
        acromion.fusion.errors.UnusableTime
            The rate changed.
        """
        rows = [row for line in self._split(piece) for row in self._take(line, arrived_us)]
        if self._clock is None:
            self._waiting += rows
            if len(self._waiting) < ROWS_TO_TIME or self._columns is None:
                return None
            self._waiting = rows = _drop_before_restart(self._waiting)
            if len(rows) < ROWS_TO_TIME:
                return None
            self._waiting = []
            self._start_clock(rows, self._columns)
        return self._place(rows)

    def finish(self) -> Frames | None:
        """Return the rows that still wait for the rate when the stream ends; None if there are none.

        Raises UnknownRate.
        """
        rows, columns = _drop_before_restart(self._waiting), self._columns
        self._waiting = []
        if columns is None or len(rows) < 2:
            return None
        self._start_clock(rows, columns)
        return self._place(rows)

    def _split(self, piece: bytes) -> Iterator[str]:
        *lines, self._carried = (self._carried + piece).split(b"\n")
        if len(self._carried) > LONGEST_LINE_BYTES:
            self._carried = b""
            self.torn += 1
        for line in lines:
            if len(line) > LONGEST_LINE_BYTES:
                self.torn += 1
            else:
                yield line.decode("utf-8", "replace").strip("\r\0 ")

    def _take(self, line: str, arrived_us: int) -> Iterator[Row]:
        """Yield the row of a line, after any rows that arrived before the header was known."""
        if self._columns is not None:
            row = self._parse(line, arrived_us, self._follow_header(line, self._columns))
            if row is not None:
                yield row
            return
        if any(is_row(line, mark) for mark in DELIMITERS):
            self._learned_from.append((line, arrived_us))
        elif WORDS.search(line):
            if self._learned_from:
                self._head.clear()
                self._learned_from.clear()
            self._head.append(line)
        if len(self._learned_from) == ROWS_TO_LEARN and self._head:
            columns = self._columns = _parse_header([*self._head, *(text for text, _ in self._learned_from)])
            parsed = (self._parse(text, came_us, columns) for text, came_us in self._learned_from)
            yield from (row for row in parsed if row is not None)

    def _parse(self, line: str, arrived_us: int, columns: _Columns) -> Row | None:
        fields = split_fields(line, columns.layout.delimiter)
        if len(fields) != columns.layout.n_columns:
            self._take_words(line, columns)
            return None
        try:
            values = tuple(
                float(fields[place]) * factor
                for place, factor in zip(columns.places, columns.factors, strict=True)
            )
            stamp_us = None if columns.stamp is None else round(float(fields[columns.stamp]) * columns.to_us)
            count = None if columns.count is None else int(fields[columns.count])
        except (ValueError, OverflowError):
            self._take_words(line, columns)
            return None
        is_whole = all(map(math.isfinite, values))
        is_possible = max(map(abs, values[:3])) <= MOST_G and max(map(abs, values[3:])) <= MOST_DPS
        if not (is_whole and is_possible) or max(abs(stamp_us or 0), abs(count or 0)) > MOST_NUMBER:
            self.torn += 1
            return None
        return Row(stamp_us, count, arrived_us, values)

    def _take_words(self, line: str, columns: _Columns) -> None:
        """Handle a line that is not a row: a line above the table, another header, or a torn line.

        A board that restarts writes the lines above the table again.
        """
        layout = columns.layout
        if not line or line.startswith(("#", "%", "//")) or line in (layout.header, *layout.preamble):
            return
        self._changed = _parse_changed_header(line)
        self.torn += self._changed is None

    def _follow_header(self, line: str, columns: _Columns) -> _Columns:
        """Switch to the columns of a changed header if this row has as many; otherwise that line was torn."""
        changed, self._changed = self._changed, None
        if changed is None:
            return columns
        if len(split_fields(line, changed.layout.delimiter)) != changed.layout.n_columns:
            self.torn += 1
            return columns
        self._columns = changed
        return changed

    def _start_clock(self, rows: list[Row], columns: _Columns) -> None:
        rate_hz = choose_rate_hz(columns.layout, None) or _measure_rate_hz(rows)
        self._clock = StreamClock(MICROSECONDS / rate_hz)
        said, device = columns.layout.facts(), columns.layout.device
        self.facts = LineFacts(
            device.device if device else "other",
            rate_hz,
            read_positive(said.get("acc_range_g")),
            read_positive(said.get("gyr_range_dps")),
        )

    def _place(self, rows: list[Row]) -> Frames:
        assert self._clock is not None
        placed = [self._clock.place(row.stamp_us, row.count, row.arrived_us) for row in rows]
        times = np.array(placed, np.int64).reshape(-1, 2)
        if rows and rows[-1].stamp_us is not None:
            self._check_rate(times, self._clock.period_us)
        values = np.array([row.values for row in rows], np.float32).reshape(-1, 6)
        return Frames(times[:, 0], times[:, 1], values[:, :3].copy(), values[:, 3:].copy())

    def _check_rate(self, times: NDArray[np.int64], period_us: float) -> None:
        """Compare the period of the last rows with that of the first."""
        self._recent = np.concatenate([self._recent, times])[-ROWS_TO_TIME:]
        if len(self._recent) < ROWS_TO_TIME:
            return
        steps = np.diff(self._recent, axis=0)
        measured_us = float(np.median(steps[:, 0] / steps[:, 1]))
        if abs(measured_us / period_us - 1.0) > RATE_TOLERANCE:
            raise UnusableTime(why="rate changed")


def _parse_changed_header(line: str) -> _Columns | None:
    """Read the header of a reconfigured board; None if the line is not a header."""
    delimiter = next((mark for mark in DELIMITERS if mark in line), "")
    if not delimiter or not WORDS.search(line):
        return None
    row = delimiter.join("1" for _ in split_fields(line, delimiter))
    try:
        return _parse_header([line, *[row] * ROWS_TO_LEARN])
    except FusionError:
        return None


def _drop_before_restart(rows: list[Row]) -> list[Row]:
    """Drop the rows before a restart of the board; opening the port resets many boards."""
    stamps = [row.stamp_us for row in rows if row.stamp_us is not None]
    falls = [
        k for k, (before, after) in enumerate(pairwise(stamps), 1) if -STAMP_SIZE // 2 < after - before < 0
    ]
    return rows[falls[-1] :] if falls else rows


def _parse_header(lines: Sequence[str]) -> _Columns:
    layout = find_layout("\n".join([*lines, ""]))
    if layout is None or layout.header is None or layout.writer is not None:
        raise UnknownColumns(why="no header")
    plan = plan_table(layout)
    by_target = {target: place for place, target in enumerate(plan.targets)}
    places = tuple(by_target[target] for target in range(1, 7))
    for sensor, place, scale in (
        ("accelerometer", places[0], acc_scale_g),
        ("gyroscope", places[3], gyr_scale_dps),
    ):
        if scale(plan.layout.columns[place].unit) is None:
            raise UnknownUnit(sensor=sensor)
    # x of both sensors is reversed if the device is left-handed.
    device = plan.layout.device
    factor = device.left_gyr_factor if device else 1.0
    turn, gyr = (1.0 if factor == 1.0 else -1.0), plan.gyr_scale * factor
    return _Columns(
        plan.layout,
        by_target.get(STAMP) if plan.time.kind == "number" else None,
        next((k for k, column in enumerate(plan.layout.columns) if column.channel == "counter"), None),
        places,
        10.0**plan.time.unit.exponent,
        (turn * plan.acc_scale, plan.acc_scale, plan.acc_scale, turn * gyr, gyr, gyr),
    )


def _measure_rate_hz(rows: Sequence[Row]) -> float:
    """Measure the rate by the timestamps (a step back of about 2^32 us is a wrap), or else by the arrivals.

    Rows arrive in bursts: those of the first burst were sent earlier.

    Raises UnknownRate or UnusableTime.
    """
    stamps = [row.stamp_us for row in rows if row.stamp_us is not None]
    if not stamps:
        arrivals = np.array([row.arrived_us for row in rows], np.int64)
        if arrivals[-1] <= arrivals[0]:
            raise UnknownRate
        return (
            MICROSECONDS
            * float(np.mean(arrivals > arrivals[0]))
            * len(arrivals)
            / int(arrivals[-1] - arrivals[0])
        )
    times = np.array(stamps, np.int64)
    times[1:] += (1 << 32) * np.cumsum(np.diff(times) < -(1 << 31))
    if np.any(np.diff(times) < 0):
        raise UnknownRate
    return MICROSECONDS / estimate_period_us(times)
