"""Turn a table of samples into a recording: plan of the columns, rows, stamps, clock."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta, timezone
from itertools import pairwise
from math import isfinite
from statistics import median
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import format_offset, is_clock_set
from acromion.fusion.errors import (
    CutByExcel,
    NoGravity,
    NoGyroscope,
    SeveralSensors,
    UnknownColumns,
    UnreadableRows,
    UnusableProfile,
    UnusableTime,
)
from acromion.fusion.readers.samples import SampleColumns, drop_blank_rows
from acromion.fusion.readers.source import Source
from acromion.fusion.readers.tables import csv_lines
from acromion.fusion.readers.tables.columns import (
    ENDS_IN_TIME,
    EPOCH,
    GYROSCOPE,
    IN_MICROSECONDS,
    UNIT_NAMES,
    Column,
    OffsetChange,
    StampWriter,
    TimeUnit,
    Vector,
    check_both_units,
    choose_acceleration,
    choose_vector,
    count_from_1970,
    find_time_unit,
    flag_changes,
    guess_exponent,
    name_missing,
    parse_zone_s,
    rewrite_pieces,
)
from acromion.fusion.readers.tables.csv_lines import IGNORED, STAMP
from acromion.fusion.readers.tables.layout import (
    ARRIVAL,
    CALENDAR,
    UTC_NAME,
    TextLayout,
    drop_lines,
    find_sensors,
    read_line_pieces,
    read_text_pieces,
    split_fields,
)
from acromion.fusion.readers.time.clock import datetime_at_us, trust_clock
from acromion.fusion.readers.time.grid import Grid, repair_row_times
from acromion.fusion.recording import (
    MICROSECONDS,
    QualityFlag,
    Recording,
    acc_scale_g,
    flag_counts,
    gyr_scale_dps,
)

PACKET_NUMBERS = 65_536
"""Xsens' packet counter starts over here (MT Manager and DOT user manuals)."""
JUDGED_ROWS = 1001
"""The median of so many first stamps gives the kind of number: single ones may be outliers."""
WRAPPING_EXPONENTS = (0, 2, 3)
"""Of micros(), tenths of a millisecond and millis(), which start over."""


@dataclass(frozen=True, slots=True)
class TimeColumn:
    """The kind of a table's stamps: microseconds, or numbers of rows or packets.

    ``kind``: "row number" if no column holds a time; "packet counter": the 16-bit number of a packet;
    "number": a number in some unit; "calendar": a date with a time, or a time of day.
    ``unit``: unit of a number, and whether the header states another.
    ``offset_s``: seconds east of UTC that calendar stamps carry; None: a bare wall clock.
    ``has_date``: False for times of day.
    ``is_doubtful``: day and month may be the other way round.
    """

    kind: Literal["row number", "packet counter", "number", "calendar"] = "row number"
    unit: TimeUnit = IN_MICROSECONDS
    offset_s: int | None = None
    has_date: bool = True
    is_doubtful: bool = False

    @property
    def has_times(self) -> bool:
        """Whether a column holds times, not numbers of rows or packets."""
        return self.kind in ("number", "calendar")

    def counts_since_1970(self, stamp_us: int) -> bool:
        """Whether the stamps, of which this is one, are numbers since 1970."""
        return self.kind == "number" and not self.unit.is_days and read_epoch(stamp_us) is not None

    def read_start(self, first_us: int) -> datetime | None:
        """Read the first stamp: a calendar's, a spreadsheet's, or an epoch, which counts UTC."""
        if self.kind == "calendar" or self.unit.is_days:
            moment = datetime_at_us(first_us)
            if moment is None or self.offset_s is None:
                return moment
            return moment.replace(tzinfo=timezone(timedelta(seconds=self.offset_s)))
        return read_epoch(first_us) if self.kind == "number" else None

    def describe(self, first_us: int) -> str:
        """Return in a word or two what the stamps are."""
        if self.counts_since_1970(first_us):
            return "number since 1970"
        if self.unit.is_days:
            return "calendar"
        return self.kind if self.has_date else "time of day"

    def repair(self, columns: SampleColumns, changes: Sequence[OffsetChange] = ()) -> tuple[QualityFlag, ...]:
        """Repair the order and the stamps of the rows, in place; return the caveats.

        Stamps with an offset already follow the first row's clock; ``changes``: changes of the offset. Only
        stamps without an offset may contain the one-hour step of daylight saving.
        """
        has_offset = self.offset_s is not None
        is_epoch = self.counts_since_1970(int(np.median(columns.stamps[:JUDGED_ROWS])))
        is_count = self.kind == "number" and not is_epoch and self.unit.exponent in WRAPPING_EXPONENTS
        flags = repair_row_times(
            columns,
            tick_us=int(10**self.unit.exponent) if is_count else 0,
            is_wall_clock=self.unit.is_days or (self.kind == "calendar" and not has_offset),
        )
        return flags + flag_changes(changes, int(columns.stamps[0])) if has_offset else flags


def read_epoch(first_stamp_us: int) -> datetime | None:
    """Return microseconds since 1970 as a time in UTC; None if a counter from power-on can reach them."""
    moment = datetime_at_us(first_stamp_us)
    return moment.replace(tzinfo=UTC) if moment is not None and is_clock_set(moment) else None


# Which column goes where.

LONGEST_LIST = 400


@dataclass(frozen=True, slots=True)
class TablePlan:
    """How a table is read: its layout, and which column goes where.

    ``layout``: how the table is written.
    ``targets``: for each column -1 ignored, 0 the stamp, 1 to 3 acceleration, 4 to 6 angular rate.
    ``time``: what the stamps are.
    ``acc_scale``, ``gyr_scale``: factors to g and deg/s.
    ``gravity``: columns of the gravity that the acceleration may lack; None if it lacks none.
    """

    layout: TextLayout
    targets: tuple[int, ...]
    time: TimeColumn = TimeColumn()
    acc_scale: float = 1.0
    gyr_scale: float = 1.0
    gravity: Vector | None = None

    @property
    def acceleration(self) -> Column:
        """Its first column."""
        return self.layout.columns[self.targets.index(1)]

    @property
    def angular_rate(self) -> Column:
        """Its first column; in a table of the thigh without one, that of the acceleration."""
        return self.layout.columns[self.targets.index(4 if 4 in self.targets else 1)]


def plan_table(layout: TextLayout, *, is_thigh: bool = False) -> TablePlan:
    """Decide which column goes where, and with which factor.

    If the header states no unit, the factor is 1 and :mod:`acromion.fusion.checks.physics` finds the unit. On
    the thigh, a table may have no gyroscope.

    Raises NoGyroscope, NoGravity, SeveralSensors, UnknownColumns or UnknownUnit.
    """
    layout = choose_sensor(layout)
    acc, gravity = choose_acceleration(layout.columns)
    gyr = choose_vector(layout.columns, "gyr")
    if acc is None or (gyr is None and not is_thigh):
        _refuse_columns(layout)
    if gyr is not None:
        check_both_units(layout.columns, acc, gyr)
    targets = [IGNORED] * layout.n_columns
    for axis in range(3):
        targets[acc[axis]] = 1 + axis
        if gyr is not None:
            targets[gyr[axis]] = 4 + axis
    place, time = choose_stamp(layout)
    if place is not None:
        if targets[place] != IGNORED:  # a profile that counts the columns without the time
            raise UnknownColumns(why="time counted")
        targets[place] = STAMP
    return TablePlan(
        layout,
        tuple(targets),
        time,
        acc_scale_g(layout.columns[acc[0]].unit) or 1.0,
        (gyr_scale_dps(layout.columns[gyr[0]].unit) if gyr else None) or 1.0,
        gravity,
    )


def choose_sensor(layout: TextLayout, sensor: str = "") -> TextLayout:
    """Keep the columns of one sensor if a table contains several.

    Raises SeveralSensors if no sensor was chosen, or if none has that name; UnusableProfile if the only one
    has none.
    """
    sensors = find_sensors(layout.columns)
    names = ", ".join(name for name in sensors if name)[:LONGEST_LIST]
    if sensor and names and sensor not in sensors:
        raise SeveralSensors(n=len(sensors), list=names, wanted=sensor)
    if sensor and sensors and not names:
        raise UnusableProfile(why="one sensor, unnamed", name="sensor")
    if len(sensors) == 1:
        sensor = next(iter(sensors))
    if all(choose_vector(layout.columns, channel) for channel in ("acc", "gyr")):
        return layout
    if sensors and sensor not in sensors:
        raise SeveralSensors(n=len(sensors), list=names)
    return replace(layout, columns=sensors[sensor]) if sensors else layout


def _refuse_columns(layout: TextLayout) -> NoReturn:
    if layout.misfit_header:
        raise explain_misfit(layout)
    channels = {column.channel for column in layout.columns}
    is_named = any(GYROSCOPE.search(column.name) for column in layout.columns)  # `gyroscope_alpha`
    if "acc" in channels and "gyr" not in channels and not is_named:
        raise NoGyroscope
    if {"gyr", "linear"} <= channels and "acc" not in channels:
        raise NoGravity
    names = (layout.header or "").strip()[:LONGEST_LIST]
    raise UnknownColumns(list=names, **name_missing(layout.columns))


def explain_misfit(layout: TextLayout) -> UnknownColumns:
    """Return the error for rows with more or fewer fields than the header has names."""
    names = layout.misfit_header[:LONGEST_LIST]
    is_wide = layout.n_columns > len(split_fields(layout.misfit_header, layout.delimiter))
    return UnknownColumns(
        list=names, why="wide rows" if is_wide else "narrow rows", line=layout.first_line + 1
    )


def choose_stamp(layout: TextLayout) -> tuple[int | None, TimeColumn]:
    """Return place and kind of the stamp column; without times, a packet counter shows lost packets.

    Raises UnusableTime if the only time is the part of a second, without the second.
    """
    columns, calendars, has_part = layout.columns, find_calendars(layout), False
    places = [k for k, column in enumerate(columns) if column.channel == "time"]
    places.sort(key=lambda k: (columns[k].name == ARRIVAL, columns[k].unit is None))
    if layout.header is not None and not columns[0].name:
        places.append(0)  # the index that programs write before the columns has no name
    named = [k for k, c in enumerate(columns) if c.channel == "other" and ENDS_IN_TIME.search(c.name)]
    for place in (*places, *calendars, *named):
        fields = [row[place] for row in layout.sample_rows if len(row) > place]
        if place in calendars:
            return place, choose_calendar(layout, place)
        if place - 1 in calendars and not any(fields):  # the time of the date in the column before
            return place - 1, choose_calendar(layout, place - 1)
        times = read_times(fields, layout.decimal)
        distances = {after - before for before, after in pairwise(times)}
        if layout.columns[place].unit is None and distances == {1.0} and times[0] in (0.0, 1.0):
            continue  # it counts the rows
        unit = find_time_unit(times, layout.columns[place].unit) if times else None
        if unit is not None and _is_part_of_second(times, unit):
            has_part = True
        elif unit is not None:
            return place, TimeColumn("number", unit)
    for place, column in enumerate(layout.columns):
        if column.channel == "counter" and column.name.strip().lower() == "packetcounter":
            fields = [row[place] for row in layout.sample_rows if len(row) > place]
            is_whole = all(field.isascii() and field.isdigit() for field in fields)
            steps = [(int(b) - int(a)) % PACKET_NUMBERS for a, b in pairwise(fields)] if is_whole else []
            if steps and median(steps) == 1:
                return place, TimeColumn("packet counter")
            break
    if has_part:
        raise UnusableTime(why="form")
    return None, TimeColumn()


def find_unnamed_time(layout: TextLayout, columns: Sequence[Column]) -> tuple[int, str] | None:
    """Return the first column of another name that advances as stamps do, and its unit; None for none."""
    for place, column in enumerate(columns):
        fields = [row[place] for row in layout.sample_rows if len(row) > place]
        times = read_times(fields, layout.decimal) if column.channel == "other" else []
        distances = {after - before for before, after in pairwise(times)}
        exponent = guess_exponent(times) if distances - {1.0} and min(distances) > 0.0 else None
        if exponent is not None:
            return place, UNIT_NAMES[exponent]
    return None


def _is_part_of_second(times: Sequence[float], unit: TimeUnit) -> bool:
    """Return whether a column starts over each second: milliseconds beside a time in whole seconds."""
    second = MICROSECONDS / 10.0**unit.exponent
    falls = any(before - after > 0.5 * second for before, after in pairwise(times))
    return falls and all(0.0 <= time < second for time in times)


def find_calendars(layout: TextLayout) -> list[int]:
    """Return the columns with dates and times, or times of day; their names do not matter."""
    rows = layout.sample_rows
    return [
        k
        for k in range(layout.n_columns)
        if rows and all(len(row) > k and CALENDAR.fullmatch(row[k]) for row in rows)
    ]


def choose_calendar(layout: TextLayout, place: int) -> TimeColumn:
    """Describe a column of dates with times, or of times of day; its name may state that it is in UTC."""
    dates = layout.dates
    offset_s = 0 if UTC_NAME.search(layout.columns[place].name) else None
    if dates is None:
        return TimeColumn("calendar", offset_s=offset_s)
    offset_s = offset_s if dates.offset_s is None else dates.offset_s
    return TimeColumn("calendar", IN_MICROSECONDS, offset_s, dates.has_date, dates.is_doubtful)


def read_times(fields: Sequence[str], decimal: str) -> list[float]:
    """Return the fields as numbers; empty if one is not a number or all are absent."""
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
STAMP_KINDS = {
    "row number": csv_lines.COUNTER,
    "packet counter": csv_lines.NUMERIC_TIME,
    "number": csv_lines.NUMERIC_TIME,
    "calendar": csv_lines.CALENDAR_TIME,
}


@dataclass(frozen=True, slots=True, eq=False)
class TableRows:
    """The rows of a table.

    ``changes``: changes of the stamps' offset from UTC; ``flags``: dropped rows, with the reason.
    """

    columns: SampleColumns
    flags: tuple[QualityFlag, ...]
    changes: tuple[OffsetChange, ...] = ()


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
    tally = np.zeros(csv_lines.TALLY_PLACES, np.int64)
    done_bytes = 0
    writer = StampWriter(layout.dates) if layout.dates and not layout.dates.is_iso else None
    is_whole = False

    def watch_end(pieces: Iterable[bytes]) -> Iterator[bytes]:
        nonlocal is_whole
        for piece in pieces:
            is_whole = piece.endswith((b"\n", b"\r"))
            yield piece

    rows_writer = replace(layout.writer) if layout.writer else None  # with no row begun
    pieces = rewrite_pieces(rewrite_pieces(watch_end(read_text_pieces(source)), rows_writer), writer)
    if layout.is_single_spaced:
        pieces = (piece.replace(b" ", b"\t") for piece in pieces)
    lines = read_line_pieces(drop_lines(pieces, layout.first_line))
    for piece_bytes, (acc, gyr, stamps, found) in csv_lines.read_pieces(lines, _make_rules(plan)):
        rows = columns.extend(len(stamps))
        columns.acc[rows], columns.gyr[rows], columns.stamps[rows] = acc, gyr, stamps
        if plan.time.kind == "row number":
            columns.stamps[rows] += tally[csv_lines.SAMPLES]
        if found[csv_lines.BAD]:
            tally[csv_lines.FIRST_BAD_LINE] = (
                tally[csv_lines.FIRST_BAD_LINE] or tally[csv_lines.LINES] + found[csv_lines.FIRST_BAD_LINE]
            )
            tally[csv_lines.LAST_BAD_LINE] = tally[csv_lines.LINES] + found[csv_lines.LAST_BAD_LINE]
        found[csv_lines.FIRST_BAD_LINE] = found[csv_lines.LAST_BAD_LINE] = 0
        tally += found
        if done_bytes <= FORECAST_BYTES < done_bytes + piece_bytes:
            columns.reserve(done_bytes + piece_bytes, source.size_bytes)
        done_bytes += piece_bytes
    columns.trim()
    if plan.time.unit.is_days:
        count_from_1970(columns.stamps)
    bad, first_bad = int(tally[csv_lines.BAD]), int(tally[csv_lines.FIRST_BAD_LINE]) + layout.first_line
    if bad > MAX_BAD_PART * int(tally[csv_lines.LINES] - tally[csv_lines.BLANKS]) and bad > 1:
        raise UnreadableRows(k=bad, line=first_bad)
    if layout.first_line + int(tally[csv_lines.LINES]) == EXCEL_ROWS:
        raise CutByExcel
    is_whole_row = plan.time.kind != "row number" and 4 in plan.targets
    flags = drop_blank_rows(columns) if is_whole_row else ()
    tail = int(not is_whole and bad > 0 and tally[csv_lines.LAST_BAD_LINE] == tally[csv_lines.LINES])
    if bad > tail:
        flags += (QualityFlag(Caveat.ROWS_DROPPED, bad - tail, facts={"line": first_bad}),)
    counts = {
        Caveat.TRUNC_TAIL: tail,
        Caveat.NAN: int(tally[csv_lines.ABSENT]),
        Caveat.HEADER_REPEAT: int(tally[csv_lines.HEADERS]),
    }
    return TableRows(columns, flags + flag_counts(counts), tuple(writer.changes) if writer else ())


def _make_rules(plan: TablePlan) -> csv_lines.Rules:
    layout = plan.layout
    columns = np.full(7, -1, np.int64)
    for column, target in enumerate(plan.targets):
        if target != IGNORED:
            columns[target] = column
    if columns[4] < 0:  # a table of one sensor: only lines with six readings are read on the plain path
        columns[4:] = columns[1:4]
    fewest, most = layout.fields_of_a_row
    more = (IGNORED,) * (most - len(plan.targets))
    return csv_lines.Rules(
        header=np.frombuffer((layout.header or "").split("\0")[0].encode(), np.uint8),
        targets=np.array((*plan.targets, *more), np.int64),
        fewest=max(fewest, int(columns.max()) + 1),
        columns=columns,
        scales=np.array([1.0] + 3 * [plan.acc_scale] + 3 * [plan.gyr_scale]),
        delimiter=ord(layout.delimiter),
        decimal=ord(layout.decimal),
        stamp_kind=STAMP_KINDS[plan.time.kind],
        stamp_exponent=plan.time.unit.exponent,
    )


# Gravity that a phone or a watch removed from the acceleration and wrote in separate columns.

LOOKED_AT_ROWS = 20_000
STEADY_PART = 0.05
"""Columns called gravity keep their length within this part in nine of ten rows; else they are not used."""
NEAR_ONE = 0.1
CORE_MOTION = "rotationrate"
"""Core Motion's word for the gyroscope. Its gravity points down, and at rest so does the sum."""


def add_gravity(source: Source, plan: TablePlan, columns: SampleColumns) -> bool:
    """Read a table again for gravity that its acceleration may lack; return whether it was added."""
    if plan.gravity is None:
        return False
    targets = [IGNORED if 1 <= target <= 3 else target for target in plan.targets]
    for axis, place in enumerate(plan.gravity):
        targets[place] = 1 + axis
    unit, device = plan.layout.columns[plan.gravity[0]].unit, plan.layout.device
    scale_g = acc_scale_g(unit) or plan.acc_scale
    beside = replace(plan, targets=tuple(targets), acc_scale=scale_g, gravity=None)
    gravity = read_table(source, beside).columns
    acc, gyr = plan.acceleration, plan.angular_rate
    has_own_unit = acc.unit != unit and not (device and acc.unit == device.acc_unit)
    return put_back_gravity(columns, gravity, scale_g, acc, gyr, has_own_unit=has_own_unit)


def put_back_gravity(
    columns: SampleColumns,
    gravity: SampleColumns,
    scale_g: float,
    acc: Column,
    gyr: Column,
    *,
    has_own_unit: bool,
) -> bool:
    """Add gravity to an acceleration that lacks it, in place; return whether it did.

    ``gravity`` was scaled by ``scale_g``, which does not matter: it is 1 g long. The acceleration has the
    same unit, unless header or profile state another. Rows without gravity are dropped. The sign of
    Core Motion's readings, in g, is reversed, so that the sum is what an accelerometer measures.

    Raises NoGravity if the acceleration's name says that it lacks gravity and the columns contain none.
    """
    order = np.argsort(gravity.stamps, kind="stable")
    stamps = gravity.stamps[order]
    place = np.searchsorted(stamps, columns.stamps).clip(max=max(len(stamps) - 1, 0))
    has_gravity = stamps[place] == columns.stamps if len(stamps) else np.zeros(columns.rows, np.bool_)
    looked_at = np.flatnonzero(has_gravity)[:: max(1, columns.rows // LOOKED_AT_ROWS)]
    parts_g, acc_g = gravity.acc[order[place[looked_at]]], columns.acc[looked_at]
    lengths_g = np.linalg.norm(parts_g, axis=1)
    low, length_g, high = np.quantile(lengths_g, [0.05, 0.5, 0.95]) if len(looked_at) else np.zeros(3)
    if length_g == 0.0 or high - low > STEADY_PART * length_g:
        if acc.channel == "linear":
            raise NoGravity
        return False
    if acc.channel != "linear" and holds_gravity(acc_g, parts_g):
        return False
    is_core_motion = CORE_MOTION in gyr.name.lower() and abs(length_g / scale_g - 1.0) < NEAR_ONE
    if has_own_unit and acc_scale_g(acc.unit):
        gravity.acc[:] /= np.float32(length_g)
        length_g = 1.0
    columns.acc[:] += gravity.acc[order[place]]
    columns.acc[:] *= np.float32((-1.0 if is_core_motion else 1.0) / length_g)
    columns.keep(has_gravity)
    return True


def holds_gravity(acc: NDArray[np.floating[Any]], gravity: NDArray[np.floating[Any]]) -> bool:
    """Return whether an acceleration, (n, 3), includes the gravity beside it: without it, it is shorter.

    The gravity may be written with the other sign.
    """
    without = min(np.median(np.linalg.norm(acc + sign * gravity, axis=1)) for sign in (-1.0, 1.0))
    return bool(without < np.median(np.linalg.norm(acc, axis=1)))


# The clock at the first row, and the recording.

START_TOLERANCE = timedelta(minutes=1)
START_NAMES = ("start", "starttime", "start_time")
STATED_START = re.compile(
    r"(\d{4}[-/]\d{2}[-/]\d{2})[T_ ](\d{2}:\d{2}:\d{2})(?:[._,](\d{1,6}))?"
    r"(?: ?(Z|[A-Za-z]{2,5}|[+-]\d{2}:?\d{2}))?"
)


@dataclass(frozen=True, slots=True)
class TableClock:
    """The clock at the first row, its zone as the file gives it, and their caveats."""

    start: datetime | None
    time_zone: str | None
    flags: tuple[QualityFlag, ...] = ()


def _read_stated_start(facts: Mapping[str, str]) -> datetime | None:
    """Read the start that the preamble states: ISO, or `2026-03-02_07:00:00_086 CET`; None for others."""
    text = next((facts[name] for name in START_NAMES if name in facts), "").strip(", ")
    with suppress(ValueError):
        return datetime.fromisoformat(text)
    found = STATED_START.fullmatch(text)
    if found is None:
        return None
    day, clock, fraction, zone = found.groups()
    offset_s = parse_zone_s(zone) if zone else None
    with suppress(ValueError):
        moment = datetime.fromisoformat(f"{day.replace('/', '-')}T{clock}.{(fraction or '0'):0<6}")
        return moment if offset_s is None else moment.replace(tzinfo=timezone(timedelta(seconds=offset_s)))
    return None


def find_clock_place(layout: TextLayout, time: TimeColumn, first_us: int) -> int | None:
    """Return the column of a calendar beside stamps that count from power-on; None for none."""
    is_count = time.kind == "number" and time.read_start(first_us) is None
    calendars = find_calendars(layout) if is_count else []
    return calendars[0] if calendars else None


def find_clock(layout: TextLayout, time: TimeColumn, first_us: int) -> TableClock:
    """Read the clock at the first row: from the preamble (`# start: 2026-03-02T07:58:00-05:00`) or a stamp.

    If both exist and differ, the rows' time is used; the preamble's offset applies to both. Stamps that count
    from power-on leave the start to a calendar in another column.
    """
    start, place = time.read_start(first_us), find_clock_place(layout, time, first_us)
    if place is not None:
        time = choose_calendar(layout, place)
        with suppress(ValueError):
            moment = datetime.fromisoformat(layout.sample_rows[0][place].strip("Z").replace(",", "."))
            start = time.read_start((moment - EPOCH) // timedelta(microseconds=1))
    flags: tuple[QualityFlag, ...] = ()
    stated = _read_stated_start(layout.facts())
    if stated is not None:
        if time.kind != "calendar" or start is None or not time.has_date:
            return build_clock(stated)
        if start.tzinfo is None or stated.tzinfo is None:
            start = start.replace(tzinfo=start.tzinfo or stated.tzinfo)
            stated = stated.replace(tzinfo=start.tzinfo)
        if abs(stated - start) <= START_TOLERANCE:
            return build_clock(stated)
        facts = {"header": f"{stated:%Y-%m-%d %H:%M:%S}", "first": f"{start:%Y-%m-%d %H:%M:%S}"}
        return build_clock(start, (QualityFlag(Caveat.START, facts=facts),))
    if start is not None and not time.has_date:
        return build_clock(None, (QualityFlag(Caveat.NO_DATE, facts={"time_of_day": f"{start:%H:%M:%S}"}),))
    if start is not None and time.is_doubtful:
        flags = (QualityFlag(Caveat.DATE_ORDER, facts={"date": f"{start:%Y-%m-%d}"}),)
    return build_clock(start, flags)


def build_clock(start: datetime | None, flags: tuple[QualityFlag, ...] = ()) -> TableClock:
    """Keep a plausible start, with its zone; flag one in UTC (W-UTC)."""
    start, unset = trust_clock(start)
    offset = start.utcoffset() if start else None
    if offset is None:
        return TableClock(start, None, (*flags, *unset))
    if not offset:
        flags = (*flags, QualityFlag(Caveat.UTC))
    return TableClock(start, format_offset(round(offset.total_seconds())), (*flags, *unset))


def build_recording(
    grid: Grid,
    clock: TableClock,
    flags: Iterable[QualityFlag],
    understood: Mapping[str, str],
    *,
    device: str = "other",
    **facts: Any,
) -> Recording:
    """Build a recording from the segments, the clock and the caveats of any table.

    ``flags``: the caveats before those of the clock; ``facts``: further fields of the recording.
    """
    return Recording(
        device=device,
        sha256="",
        start=clock.start,
        time_zone=clock.time_zone,
        duration_us=grid.duration_us,
        segments=grid.segments,
        flags=(*flags, *clock.flags),
        understood=understood,
        **facts,
    )
