"""A table of samples, from its layout to rows with a clock: plan of the columns, rows, stamps."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta, timezone
from itertools import pairwise
from math import isfinite
from statistics import median
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import CutByExcel, NoGravity, NoGyroscope, SeveralSensors, UnknownColumns, UnreadableRows
from fusion.readers.samples import MOST_ROWS, SampleColumns, drop_blank_rows
from fusion.readers.source import Source
from fusion.readers.tables.careful_path import (
    ABSENT,
    BAD,
    BLANKS,
    CALENDAR_TIME,
    COUNTER,
    FIRST_BAD_LINE,
    HEADERS,
    IGNORED,
    LAST_BAD_LINE,
    LINES,
    NUMERIC_TIME,
    SAMPLES,
    STAMP,
    TALLY_PLACES,
    Destination,
    LineForm,
    Rules,
)
from fusion.readers.tables.columns import (
    IN_MICROSECONDS,
    Column,
    TimeUnit,
    Vector,
    choose_acceleration,
    choose_vector,
    count_from_1970,
    find_time_unit,
    name_missing,
)
from fusion.readers.tables.dates import OffsetChange, StampWriter, flag_changes, rewrite_pieces
from fusion.readers.tables.fast_path import parse_lines
from fusion.readers.tables.header import CALENDAR, find_sensors
from fusion.readers.tables.layout import TextLayout, drop_lines, read_line_pieces, read_text_pieces
from fusion.readers.tables.plain_rows import PlainRows, read_plain_rows
from fusion.readers.timebase.clock import datetime_at_us, format_offset, is_clock_set, trust_clock
from fusion.readers.timebase.row_times import repair_row_times
from fusion.recording import QualityFlag, flag_counts
from fusion.units import acc_scale_g, gyr_scale_dps

# Which column goes where.


PACKET_NUMBERS = 65_536
"""Xsens' packet counter starts over here (MT Manager and DOT user manuals)."""


@dataclass(frozen=True, slots=True)
class TablePlan:
    """How a table is read: its layout, and which column goes where.

    Attributes
    ----------
    layout
        How the table is written.
    targets
        For each column -1 ignored, 0 the stamp, 1 to 3 acceleration, 4 to 6 angular rate.
    stamp_kind, stamp_exponent
        Where the stamps come from (:mod:`fusion.readers.tables.careful_path`), and the power of ten to
        microseconds.
    acc_scale, gyr_scale
        Factors to g and deg/s.
    counts_packets
        The stamp is the 16-bit number of a packet, not a time.
    unit
        That of a numeric stamp, and whether the header states another.
    gravity
        Columns of the gravity that the acceleration may lack; None if it lacks none.
    """

    layout: TextLayout
    targets: tuple[int, ...]
    stamp_kind: int = COUNTER
    stamp_exponent: int = 0
    acc_scale: float = 1.0
    gyr_scale: float = 1.0
    counts_packets: bool = False
    unit: TimeUnit = IN_MICROSECONDS
    gravity: Vector | None = None

    @property
    def has_times(self) -> bool:
        """Whether a column holds times, not numbers of rows or packets."""
        return self.stamp_kind != COUNTER and not self.counts_packets

    @property
    def acceleration(self) -> Column:
        """Its first column."""
        return self.layout.columns[self.targets.index(1)]

    @property
    def angular_rate(self) -> Column:
        """Its first column."""
        return self.layout.columns[self.targets.index(4)]


def plan_table(layout: TextLayout) -> TablePlan:
    """Decide which column goes where, and with which factor.

    A unit that the header does not state is left to :mod:`fusion.checks.physics`: the factor is then 1.

    Raises
    ------
    NoGyroscope, NoGravity, SeveralSensors, UnknownColumns
    """
    layout = choose_sensor(layout)
    acc, gravity = choose_acceleration(layout.columns)
    gyr = choose_vector(layout.columns, "gyr")
    if acc is None or gyr is None:
        _refuse_columns(layout)
    targets = [IGNORED] * layout.n_columns
    for axis in range(3):
        targets[acc[axis]], targets[gyr[axis]] = 1 + axis, 4 + axis
    stamp, kind, unit = _choose_stamp(layout)
    packets = _find_packet_counter(layout) if stamp is None else None
    if packets is not None:
        stamp, kind = packets, NUMERIC_TIME
    if stamp is not None:
        targets[stamp] = STAMP
    return TablePlan(
        layout,
        tuple(targets),
        kind,
        unit.exponent,
        acc_scale_g(layout.columns[acc[0]].unit) or 1.0,
        gyr_scale_dps(layout.columns[gyr[0]].unit) or 1.0,
        counts_packets=packets is not None,
        unit=unit,
        gravity=gravity,
    )


def plan_gravity(plan: TablePlan) -> TablePlan | None:
    """Plan to read the gravity columns in place of the acceleration; None if there are none.

    Gravity without a unit is in the unit of the acceleration.
    """
    if plan.gravity is None:
        return None
    targets = [IGNORED if 1 <= target <= 3 else target for target in plan.targets]
    for axis, place in enumerate(plan.gravity):
        targets[place] = 1 + axis
    scale = acc_scale_g(plan.layout.columns[plan.gravity[0]].unit) or plan.acc_scale
    return replace(plan, targets=tuple(targets), acc_scale=scale, gravity=None)


def choose_sensor(layout: TextLayout, sensor: str = "") -> TextLayout:
    """Leave the columns of one sensor, where a table holds several.

    Raises
    ------
    SeveralSensors
        Nobody said which one is on the arm, or none has that name.
    """
    sensors = find_sensors(layout.columns)
    names = ", ".join(name for name in sensors if name)[:LONGEST_LIST]
    if sensor and names and sensor not in sensors:
        raise SeveralSensors(n=len(sensors), list=names, wanted=sensor)
    if len(sensors) == 1:
        sensor = next(iter(sensors))
    if all(choose_vector(layout.columns, channel) for channel in ("acc", "gyr")):
        return layout
    if sensors and sensor not in sensors:
        raise SeveralSensors(n=len(sensors), list=names)
    return replace(layout, columns=sensors[sensor]) if sensors else layout


LONGEST_LIST = 400


def _refuse_columns(layout: TextLayout) -> NoReturn:
    columns = layout.columns
    has_acc = any(column.channel == "acc" for column in columns)
    has_gyr = any(column.channel == "gyr" for column in columns)
    if has_gyr and not has_acc and any(column.channel == "linear" for column in columns):
        raise NoGravity
    if has_acc and not has_gyr:
        raise NoGyroscope
    raise UnknownColumns(list=(layout.header or "").strip()[:LONGEST_LIST], missing=name_missing(columns))


def _choose_stamp(layout: TextLayout) -> tuple[int | None, int, TimeUnit]:
    """Place, kind and unit of the stamp column."""
    places = [k for k, column in enumerate(layout.columns) if column.channel == "time"]
    places.sort(key=lambda k: layout.columns[k].unit is None)
    if layout.header is not None and not layout.columns[0].name:
        places.append(0)  # the index that programs write before the columns has no name
    for place in places:
        fields = [row[place] for row in layout.sample_rows if len(row) > place]
        if all(CALENDAR.fullmatch(field) for field in fields):
            return place, CALENDAR_TIME, IN_MICROSECONDS
        times = read_times(fields, layout.decimal)
        if is_row_number(times, layout.columns[place]):
            continue
        unit = find_time_unit(times, layout.columns[place].unit) if times else None
        if unit is not None:
            return place, NUMERIC_TIME, unit
    return None, COUNTER, IN_MICROSECONDS


def is_row_number(times: Sequence[float], column: Column) -> bool:
    """Whether a column without a unit counts the rows: whole numbers, each one more than the one before."""
    steps = {after - before for before, after in pairwise(times)}
    return column.unit is None and steps == {1.0} and times[0] in (0.0, 1.0)


def _find_packet_counter(layout: TextLayout) -> int | None:
    """Place of Xsens' packet counter where it counts up: in a table without time it tells of lost packets."""
    for place, column in enumerate(layout.columns):
        if column.channel == "counter" and column.name.strip().lower() == "packetcounter":
            fields = [row[place] for row in layout.sample_rows if len(row) > place]
            is_whole = all(field.isascii() and field.isdigit() for field in fields)
            steps = [(int(b) - int(a)) % PACKET_NUMBERS for a, b in pairwise(fields)] if is_whole else []
            return place if steps and median(steps) == 1 else None
    return None


def read_times(fields: Sequence[str], decimal: str) -> list[float]:
    """The fields as numbers; an empty list where one of them is no number, or all are absent."""
    try:
        times = [float(field.replace(decimal, ".")) for field in fields if field]
    except ValueError:
        return []
    return times if any(map(isfinite, times)) else []


# The rows, piece by piece.


EXCEL_ROWS = 1_048_576
MAX_BAD_PART = 0.05
FORECAST_BYTES = 1 << 18
"""After so many bytes the number of rows in the file is foreseen."""


@dataclass(frozen=True, slots=True, eq=False)
class TableRows:
    """The rows of a table, and what was met while they were read.

    Attributes
    ----------
    plan
        How the table was read.
    columns
        The samples; stamps in microseconds, or row numbers where the layout has no time.
    tally
        Counts of lines and rows, shape (8,); its places stand in :mod:`fusion.readers.tables.careful_path`.
    is_cut
        The last line does not end.
    changes
        Where the offset from UTC that the stamps carry changed.
    blank
        The caveat of rows of zeros without a stamp, which are left out.
    """

    plan: TablePlan
    columns: SampleColumns
    tally: NDArray[np.int64]
    is_cut: bool
    changes: tuple[OffsetChange, ...] = ()
    blank: tuple[QualityFlag, ...] = ()

    @property
    def first_bad_line(self) -> int:
        """The number in the file of the first line that could not be read, counted from 1."""
        return int(self.tally[FIRST_BAD_LINE]) + self.plan.layout.first_line

    @property
    def flags(self) -> tuple[QualityFlag, ...]:
        """Rows that were left out and why."""
        bad = int(self.tally[BAD])
        tail = int(self.is_cut and bad > 0 and self.tally[LAST_BAD_LINE] == self.tally[LINES])
        flags = self.blank
        if bad > tail:
            flags += (QualityFlag(Caveat.ROWS_DROPPED, bad - tail, facts={"line": self.first_bad_line}),)
        counts = {
            Caveat.TRUNC_TAIL: tail,
            Caveat.NAN: int(self.tally[ABSENT]),
            Caveat.HEADER_REPEAT: int(self.tally[HEADERS]),
        }
        return flags + flag_counts(counts)


def read_table(source: Source, plan: TablePlan) -> TableRows:
    """Read all rows, piece by piece.

    Raises
    ------
    UnreadableRows
        More than 5 % of the lines cannot be read.
    CutByExcel
        Exactly as many lines as Excel holds.
    """
    layout = plan.layout
    columns = SampleColumns(source)
    tally = np.zeros(TALLY_PLACES, np.int64)
    rules = make_rules(plan)
    done_bytes = 0
    has_reserved = False
    end = LastBytes()
    writer = StampWriter(layout.dates) if layout.dates and not layout.dates.is_iso else None
    pieces = _rewrite(end.watch(read_text_pieces(source)), layout, writer)
    for plain in read_plain_rows(drop_lines(read_line_pieces(pieces), layout.first_line), rules):
        columns.make_room(plain.most_rows)
        _take_rows(plain, columns, tally, counts_rows=plan.stamp_kind == COUNTER)
        if plain.rest is not None:
            destination = Destination(columns.acc, columns.gyr, columns.stamps, tally)
            columns.rows = parse_lines(plain.rest, rules, destination, columns.rows)
        done_bytes += len(plain)
        if not has_reserved and done_bytes > FORECAST_BYTES:
            has_reserved = True
            columns.reserve(
                round(1.02 * min(columns.rows * source.size_bytes / done_bytes, MOST_ROWS)) + plain.most_rows
            )
    columns.trim()
    if plan.unit.is_days:
        count_from_1970(columns.stamps)
    changes = tuple(writer.changes) if writer else ()
    rows = TableRows(plan, columns, tally, not end.is_whole, changes)
    _refuse_rows(rows)
    return rows if plan.stamp_kind == COUNTER else replace(rows, blank=drop_blank_rows(columns))


def _take_rows(
    plain: PlainRows, columns: SampleColumns, tally: NDArray[np.int64], *, counts_rows: bool
) -> None:
    """Put the plain rows of a piece behind those read before it."""
    acc, gyr, stamps, found = plain.found
    first, stop = columns.rows, columns.rows + len(stamps)
    columns.acc[first:stop], columns.gyr[first:stop] = acc, gyr
    columns.stamps[first:stop] = stamps
    if counts_rows:
        columns.stamps[first:stop] += tally[SAMPLES]
    tally += found
    columns.rows = stop


def _rewrite(pieces: Iterable[bytes], layout: TextLayout, writer: StampWriter | None) -> Iterator[bytes]:
    """Bring names within the rows, stamps and separators into the form that the kernels read."""
    pieces = rewrite_pieces(rewrite_pieces(pieces, layout.labels), writer)
    return (piece.replace(b" ", b"\t") for piece in pieces) if layout.is_single_spaced else iter(pieces)


def make_rules(plan: TablePlan) -> Rules:
    """The plan as the kernels take it."""
    layout = plan.layout
    columns = np.full(7, -1, np.int64)
    for column, target in enumerate(plan.targets):
        if target != IGNORED:
            columns[target] = column
    return Rules(
        header=np.frombuffer((layout.header or "").split("\0")[0].encode(), np.uint8),
        line=LineForm(
            targets=np.array(plan.targets, np.int64),
            delimiter_byte=ord(layout.delimiter),
            decimal_byte=ord(layout.decimal),
            stamp_kind=plan.stamp_kind,
            stamp_exponent=plan.stamp_exponent,
        ),
        columns=columns,
        scales=np.array([1.0] + 3 * [plan.acc_scale] + 3 * [plan.gyr_scale]),
    )


class LastBytes:
    """Whether the last line of the text that passed ends with a line end."""

    def __init__(self) -> None:
        self.is_whole = False

    def watch(self, pieces: Iterable[bytes]) -> Iterator[bytes]:
        """Pass the pieces on."""
        for piece in pieces:
            self.is_whole = piece.endswith((b"\n", b"\r"))
            yield piece


def _refuse_rows(rows: TableRows) -> None:
    lines = int(rows.tally[LINES] - rows.tally[BLANKS])
    bad = int(rows.tally[BAD])
    if bad > MAX_BAD_PART * lines and bad > 1:
        raise UnreadableRows(k=bad, line=rows.first_bad_line)
    if rows.plan.layout.first_line + int(rows.tally[LINES]) == EXCEL_ROWS:
        raise CutByExcel


# The clock of the rows: when it began, by which offset, and whether that changed.


START_TOLERANCE = timedelta(minutes=1)
JUDGED_ROWS = 1001
"""The median of so many first stamps gives the kind of number: single ones may be outliers."""


@dataclass(frozen=True, slots=True)
class TableClock:
    """The clock at the first row, its zone as the file gives it, and their caveats."""

    start: datetime | None
    time_zone: str | None
    flags: tuple[QualityFlag, ...]


def repair_stamps(rows: TableRows) -> tuple[QualityFlag, ...]:
    """Repair the order and the stamps of the rows, in place; give the caveats.

    Stamps that carry an offset were put on the first row's clock as they were read. Only a bare wall clock
    may hold the hour's step of daylight saving.
    """
    plan, stamps = rows.plan, rows.columns.stamps
    dates = plan.layout.dates
    is_calendar = plan.stamp_kind == CALENDAR_TIME
    has_offset = dates is not None and dates.offset_s is not None
    is_epoch = counts_since_1970(plan, int(np.median(stamps[:JUDGED_ROWS])))
    flags = repair_row_times(
        rows.columns,
        tick_us=0 if is_calendar or is_epoch else find_tick_us(plan),
        is_wall_clock=plan.unit.is_days or (is_calendar and not has_offset),
    )
    if is_calendar and has_offset:
        flags += flag_changes(rows.changes, int(rows.columns.stamps[0]))
    return flags


def find_tick_us(plan: TablePlan) -> int:
    """Microseconds in a count of micros() or millis(), which start over; 0 for other stamps."""
    if plan.stamp_kind != NUMERIC_TIME or plan.counts_packets or plan.stamp_exponent not in (0, 2, 3):
        return 0
    return int(10**plan.stamp_exponent)


def read_epoch(first_stamp_us: int) -> datetime | None:
    """Microseconds since 1970 as a time in UTC; None for what a counter from power-on can show."""
    moment = datetime_at_us(first_stamp_us)
    return moment.replace(tzinfo=UTC) if moment is not None and is_clock_set(moment) else None


def counts_since_1970(plan: TablePlan, first_stamp_us: int) -> bool:
    """Whether the stamps of a table are numbers since 1970."""
    is_number = plan.stamp_kind == NUMERIC_TIME and not plan.counts_packets and not plan.unit.is_days
    return is_number and read_epoch(first_stamp_us) is not None


def find_clock(plan: TablePlan, first_stamp_us: int) -> TableClock:
    """Read the clock at the first row: from the preamble, from a calendar column, or from an epoch.

    An epoch (seconds, milli-, micro- or nanoseconds since 1970) counts UTC.
    """
    layout = plan.layout
    start = read_preamble_start(layout)
    flags: tuple[QualityFlag, ...] = ()
    if start is not None and plan.stamp_kind == CALENDAR_TIME:
        start, flags = _compare_starts(start, layout, first_stamp_us)
    elif start is None and plan.stamp_kind == CALENDAR_TIME:
        start = _read_stamp(layout, first_stamp_us)
        if layout.dates is not None and not layout.dates.has_date and start is not None:
            flags = (QualityFlag(Caveat.NO_DATE, facts={"time_of_day": f"{start:%H:%M:%S}"}),)
            start = None
        elif layout.dates is not None and layout.dates.is_doubtful and start is not None:
            flags = (QualityFlag(Caveat.DATE_ORDER, facts={"date": f"{start:%Y-%m-%d}"}),)
    elif start is None and plan.unit.is_days:
        start = datetime_at_us(first_stamp_us)
    elif start is None and counts_since_1970(plan, first_stamp_us):
        start = read_epoch(first_stamp_us)
    return build_clock(start, flags)


def _compare_starts(
    stated: datetime, layout: TextLayout, first_stamp_us: int
) -> tuple[datetime, tuple[QualityFlag, ...]]:
    """Take the rows' own time where the preamble's start differs; the preamble's offset holds for both."""
    stamp = _read_stamp(layout, first_stamp_us)
    if stamp is None or (layout.dates is not None and not layout.dates.has_date):
        return stated, ()
    if stamp.tzinfo is None or stated.tzinfo is None:
        stamp = stamp.replace(tzinfo=stamp.tzinfo or stated.tzinfo)
        stated = stated.replace(tzinfo=stamp.tzinfo)
    if abs(stated - stamp) <= START_TOLERANCE:
        return stated, ()
    facts = {"header": f"{stated:%Y-%m-%d %H:%M:%S}", "first": f"{stamp:%Y-%m-%d %H:%M:%S}"}
    return stamp, (QualityFlag(Caveat.START, facts=facts),)


def build_clock(start: datetime | None, flags: tuple[QualityFlag, ...] = ()) -> TableClock:
    """Keep a start that a clock that was set can show, with its zone; flag one in UTC (W-UTC)."""
    start, unset = trust_clock(start)
    offset = start.utcoffset() if start else None
    if offset is None:
        return TableClock(start, None, (*flags, *unset))
    if not offset:
        flags = (*flags, QualityFlag(Caveat.UTC))
    return TableClock(start, format_offset(round(offset.total_seconds())), (*flags, *unset))


def read_preamble_start(layout: TextLayout) -> datetime | None:
    """`# start: 2026-03-02T07:58:00-05:00`; None where there is none that can be read."""
    try:
        return datetime.fromisoformat(layout.facts().get("start", ""))
    except ValueError:
        return None


def _read_stamp(layout: TextLayout, stamp_us: int) -> datetime | None:
    moment = datetime_at_us(stamp_us)
    if moment is None or layout.dates is None or layout.dates.offset_s is None:
        return moment
    return moment.replace(tzinfo=timezone(timedelta(seconds=layout.dates.offset_s)))
