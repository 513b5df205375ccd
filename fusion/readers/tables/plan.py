"""From a table's column names to a plan for reading it: channels, units, stamps."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone
from itertools import pairwise
from statistics import median

import numpy as np

from fusion.caveats import Caveat
from fusion.errors import NoGyroscope, UnknownColumns
from fusion.readers.gt3x.read import name_offset
from fusion.readers.tables.careful_path import CALENDAR_TIME, COUNTER, IGNORED, NUMERIC_TIME, STAMP
from fusion.readers.tables.columns import IN_MICROSECONDS, Column, TimeUnit, choose_vector, settle_unit
from fusion.readers.tables.dates import flag_changes
from fusion.readers.tables.layout import CALENDAR, TextLayout
from fusion.readers.tables.rows import TablePlan, TableRows
from fusion.readers.timebase.clock import datetime_at_us, is_clock_set, trust_clock
from fusion.readers.timebase.row_times import settle_rows
from fusion.recording import QualityFlag
from fusion.units import acc_scale_g, gyr_scale_dps

PACKET_NUMBERS = 65_536
"""Xsens' packet counter starts over here (MT Manager and DOT user manuals)."""
COUNTER_WORDS = ("micros", "millis", "time_us", "time_ms", "timestamp (us)")


def plan_table(layout: TextLayout) -> TablePlan:
    """Decide which column goes where, and with which factor.

    A unit that the header does not state is left to :mod:`fusion.checks.physics`: the factor is then 1.

    Raises
    ------
    NoGyroscope, UnknownColumns
    """
    acc, gyr = choose_vector(layout.columns, "acc"), choose_vector(layout.columns, "gyr")
    if acc is None or gyr is None:
        _refuse_columns(layout.columns)
    assert acc is not None
    assert gyr is not None
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
        tuple(targets),
        kind,
        unit.exponent,
        acc_scale_g(layout.columns[acc[0]].unit) or 1.0,
        gyr_scale_dps(layout.columns[gyr[0]].unit) or 1.0,
        counts_packets=packets is not None,
        unit=unit,
    )


def _refuse_columns(columns: Sequence[Column]) -> None:
    has_acc = any(column.channel == "acc" for column in columns)
    has_gyr = any(column.channel == "gyr" for column in columns)
    if has_acc and not has_gyr:
        raise NoGyroscope
    raise UnknownColumns(list=", ".join(column.name for column in columns)[:200])


def _choose_stamp(layout: TextLayout) -> tuple[int | None, int, TimeUnit]:
    """Place, kind and unit of the stamp column."""
    places = [k for k, column in enumerate(layout.columns) if column.channel == "time"]
    places.sort(key=lambda k: layout.columns[k].unit is None)
    for place in places:
        fields = [row[place] for row in layout.sample_rows if len(row) > place]
        if all(CALENDAR.fullmatch(field) for field in fields):
            return place, CALENDAR_TIME, IN_MICROSECONDS
        times = read_times(fields, layout.decimal)
        unit = settle_unit(times, layout.columns[place].unit) if times else None
        if unit is not None:
            return place, NUMERIC_TIME, unit
    return None, COUNTER, IN_MICROSECONDS


def _find_packet_counter(layout: TextLayout) -> int | None:
    """Place of Xsens' packet counter where it counts up: in a table without time it tells of lost packets."""
    for place, column in enumerate(layout.columns):
        if column.channel == "counter" and column.name.strip().lower() == "packetcounter":
            fields = [row[place] for row in layout.sample_rows if len(row) > place]
            steps = (
                [(int(b) - int(a)) % PACKET_NUMBERS for a, b in pairwise(fields)]
                if _are_whole(fields)
                else []
            )
            return place if steps and median(steps) == 1 else None
    return None


def _are_whole(fields: Sequence[str]) -> bool:
    return all(field.isascii() and field.isdigit() for field in fields)


def read_times(fields: Sequence[str], decimal: str) -> list[float]:
    """The fields as numbers; none where one of them is none."""
    try:
        return [float(field.replace(decimal, ".")) for field in fields if field]
    except ValueError:
        return []


def find_tick_us(plan: TablePlan) -> int:
    """Microseconds in a count of micros() or millis(), which start over; 0 for other stamps."""
    if plan.stamp_kind != NUMERIC_TIME or plan.counts_packets or plan.stamp_exponent not in (0, 3):
        return 0
    return int(10**plan.stamp_exponent)


# What the stamps of a table say of the clock: when it began, by which offset, and whether that changed.


START_TOLERANCE = timedelta(minutes=1)
SETTLED_ROWS = 1001
"""So many first stamps tell what kind of number they are, though some be strange."""


@dataclass(frozen=True, slots=True)
class TableClock:
    """The clock at the first row, its zone as the file tells it, and what is to be said of them."""

    start: datetime | None
    time_zone: str | None
    flags: tuple[QualityFlag, ...]


def settle_stamps(rows: TableRows, layout: TextLayout, plan: TablePlan) -> tuple[QualityFlag, ...]:
    """Bring the rows into order and take changes of the clock out of their stamps, in place; say what was.

    Stamps with an offset were told by that of the first row as they were read; only of a bare wall clock has
    an hour's step to be judged.
    """
    stamps = rows.columns.stamps
    is_calendar = plan.stamp_kind == CALENDAR_TIME
    has_offset = layout.dates is not None and layout.dates.offset_s is not None
    is_epoch = counts_since_1970(plan, int(np.median(stamps[:SETTLED_ROWS])))
    flags = settle_rows(
        rows.columns,
        tick_us=0 if is_calendar or is_epoch else find_tick_us(plan),
        is_wall_clock=is_calendar and not has_offset,
    )
    if is_calendar and has_offset:
        turned = any(flag.code == Caveat.REVERSED for flag in flags)
        changes = [change.turn_round() for change in reversed(rows.changes)] if turned else rows.changes
        flags += flag_changes(changes, int(rows.columns.stamps[0]))
    return flags


def read_epoch(first_stamp_us: int) -> datetime | None:
    """Take a number for the time since 1970, in UTC, where no counter from power-on comes as far."""
    moment = datetime_at_us(first_stamp_us)
    return moment.replace(tzinfo=UTC) if moment is not None and is_clock_set(moment) else None


def counts_since_1970(plan: TablePlan, first_stamp_us: int) -> bool:
    """Whether the stamps of a table are numbers of that kind."""
    is_number = plan.stamp_kind == NUMERIC_TIME and not plan.counts_packets
    return is_number and read_epoch(first_stamp_us) is not None


def tell_clock(layout: TextLayout, plan: TablePlan, first_stamp_us: int) -> TableClock:
    """Read the clock at the first row: from the preamble, from a calendar column, or from an epoch.

    An epoch (seconds, milli-, micro- or nanoseconds since 1970) counts UTC.
    """
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
    elif start is None and counts_since_1970(plan, first_stamp_us):
        start = read_epoch(first_stamp_us)
    return judge_clock(start, flags)


def _compare_starts(
    told: datetime, layout: TextLayout, first_stamp_us: int
) -> tuple[datetime, tuple[QualityFlag, ...]]:
    """Take the rows' own time where the preamble's start is another; its offset is the preamble's to tell."""
    stamp = _read_stamp(layout, first_stamp_us)
    if stamp is None or (layout.dates is not None and not layout.dates.has_date):
        return told, ()
    if stamp.tzinfo is None or told.tzinfo is None:
        stamp = stamp.replace(tzinfo=stamp.tzinfo or told.tzinfo)
        told = told.replace(tzinfo=stamp.tzinfo)
    if abs(told - stamp) <= START_TOLERANCE:
        return told, ()
    facts = {"header": f"{told:%Y-%m-%d %H:%M:%S}", "first": f"{stamp:%Y-%m-%d %H:%M:%S}"}
    return stamp, (QualityFlag(Caveat.START, facts=facts),)


def judge_clock(start: datetime | None, flags: tuple[QualityFlag, ...] = ()) -> TableClock:
    """Keep a clock that can have been set; name its zone; say where it is UTC."""
    start, unset = trust_clock(start)
    offset = start.utcoffset() if start else None
    if offset is None:
        return TableClock(start, None, (*flags, *unset))
    if not offset:
        flags = (*flags, QualityFlag(Caveat.UTC))
    return TableClock(start, name_offset(round(offset.total_seconds())), (*flags, *unset))


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
